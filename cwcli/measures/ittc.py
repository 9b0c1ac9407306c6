"""Inverse time to collision, which grows as the other looms larger, and is 0 where the two do not close."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair
from cwcli.signals.columns import FloatArray


def inverse_time_to_collision(pair: Pair) -> FloatArray:
    """Closing speed over gap (Hz) of a vehicle straight ahead at each stamp, (n,); infinity in contact."""
    at = pair.other_in_host_axes
    closing_mps = -at.vx_mps
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.where(closing_mps > 0.0, closing_mps / at.headway_if_straight_ahead_m, 0.0)
    return pair.expand_to_all_rows(np.where(at.is_straight_ahead, rate, np.nan))


MEASURE = Measure(
    summary="inverse time to collision with a vehicle ahead",
    symbol="1/TTC",
    column="ittc_hz",
    critical="high",
    formula="(v_e - v_o) / HW where the host closes, else 0; infinity in contact",
    source="Hayward 1972, as given by the repository regenesis90/SSM_feasibility (ITTC)",
    compute=inverse_time_to_collision,
    is_symmetric=False,
    threshold=1.0,
    threshold_source="as for TTC",
    undefined="nothing is ahead of the host within the width of the two outlines",
    misleads="when the one ahead brakes or accelerates",
    is_pointwise=True,
)
