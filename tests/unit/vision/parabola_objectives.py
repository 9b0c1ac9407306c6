"""The paper's objective of given parabolas, from the kernel."""

from __future__ import annotations

import numpy as np

from cwcli.kernels import lane_search
from cwcli.signals.columns import FloatArray
from cwcli.vision.objective import Int32Array, ResponseArray


def parabola_objectives(
    responses: ResponseArray, parabolas: FloatArray, *, is_left: bool
) -> tuple[FloatArray, Int32Array]:
    """Objectives F (eq. 2 or 3) of parabolas a, b, c (n, 3), -inf where no block is seen; and the numbers of blocks."""
    value, n_blocks = lane_search.objective(responses, np.ascontiguousarray(parabolas, np.float64), is_left=is_left)
    value[n_blocks == 0] = -np.inf
    return value, n_blocks
