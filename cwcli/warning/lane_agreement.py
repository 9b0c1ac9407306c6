"""Frames that a lane departure may be raised from: their boundary has been seen for a while, and has not jumped.

A lane method that takes another line for the boundary moves it by decimetres at once: to a rule that looks where the
tyre will be, that is a departure. A car can't do it, so a boundary counts once it has agreed with itself for some time.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

BoolArray = npt.NDArray[np.bool_]

STEP_M, STEP_MPS = 0.1, 1.5
"""Between two frames a boundary beside the camera moves by at most this, and this times the time between them."""
MAX_GAP_S = 0.5
"""Frames farther apart say nothing of each other."""


def firm_sides(
    stamp_ns: Int64Array,
    lines: tuple[FloatArray, FloatArray],
    is_seen: BoolArray | None,
    steady_s: FloatArray | None,
    agree_s: float,
) -> tuple[BoolArray, BoolArray]:
    """Whether the left and the right boundary may be warned from, shape (n,) each.

    Args:
        stamp_ns: Shape (n,), increasing.
        lines: Left and right, shape (n, 3); the first column is the place beside the camera.
        is_seen, steady_s: As the lane method tells them, see `lane_departure.Boundaries`.
        agree_s: For how long a boundary must have been seen without a jump.
    """
    n, least_s = len(stamp_ns), agree_s - 1e-9
    seen = np.ones(n, np.bool_) if is_seen is None else is_seen
    steady = seen if steady_s is None else seen & ~(steady_s < least_s)
    left, right = (steady & (agreed_s(stamp_ns, line[:, 0], seen) >= least_s) for line in lines)
    return left, right


def agreed_s(stamp_ns: Int64Array, place_m: FloatArray, is_seen: BoolArray) -> FloatArray:
    """For how long each frame's boundary has been seen without a jump.

    Args:
        stamp_ns: Shape (n,), increasing.
        place_m: Shape (n,): of the boundary beside the camera; NaN where it is not found.
        is_seen: Shape (n,): False where it is only carried on.

    Returns:
        Shape (n,), seconds; -1 where it is not seen.
    """
    n = len(stamp_ns)
    seen = is_seen & np.isfinite(place_m)
    dt_s = np.diff(stamp_ns) / NS_PER_S
    with np.errstate(invalid="ignore"):
        agrees = np.abs(np.diff(place_m)) <= STEP_M + STEP_MPS * dt_s
    goes_on = np.zeros(n, np.bool_)
    goes_on[1:] = seen[1:] & seen[:-1] & agrees & (dt_s <= MAX_GAP_S)
    begin = np.maximum.accumulate(np.where(goes_on, 0, np.arange(n)))
    return np.where(seen, (stamp_ns - stamp_ns[begin]) / NS_PER_S if n else 0.0, -1.0)
