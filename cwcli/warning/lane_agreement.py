"""Find the frames whose boundaries may raise a lane departure: seen for a while, without a jump, and coming nearer.

A lane method that mistakes another line for the boundary moves it by decimetres at once, which a rule that predicts
the tyre's place takes for a departure. A car cannot move like that, so a boundary counts once it has agreed with itself
for some time. A lane is known less well far ahead than beside the car, and a predicted crossing depends on both: so a
boundary that a path crosses must have come nearer to the car, too.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import BoolArray, FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S
from cwcli.warning.types import LeftAndRight

MAX_BOUNDARY_STEP_M, MAX_BOUNDARY_SPEED_MPS = 0.1, 1.5
"""A boundary beside the camera moves by at most 0.1 m plus 1.5 m/s times the time between two frames; more is a jump.
Chosen by hand; not fitted."""
MAX_GAP_BETWEEN_COMPARED_FRAMES_S = 0.5
"""Longest time in s between two frames that are compared. Chosen by hand; not fitted."""
APPROACH_RATE_WINDOW_S = 0.5
"""The approach of a boundary is measured over this time, s. Chosen: 1 cm of noise at 10 frames a second is 0.02 m/s."""
MIN_APPROACH_FRAMES, MIN_TIME_SPREAD_S2, APPROACH_BOUND_SIGMAS = 3, 1e-6, 2.0
"""An approach needs 3 frames and this spread of their times (s^2); its bound is 2 sigmas off. Chosen by hand."""


def agreement_duration_of_left_and_right_s(
    stamp_ns: Int64Array,
    left_and_right_lines: LeftAndRight,
    is_seen: BoolArray | None,
    steady_s: FloatArray | None,
    agree_s: float,
) -> LeftAndRight:
    """For how long the left and the right boundary have agreed, s, (n,) each; -1 where they may not raise a warning.

    Args:
        stamp_ns: Shape (n,), increasing.
        left_and_right_lines: Left and right, shape (n, 3); the first column is the place beside the camera.
        is_seen, steady_s: From the lane method, see `lane_departure.LaneBoundaries`.
        agree_s: For how long a boundary must have been seen without a jump.
    """
    n, least_s = len(stamp_ns), agree_s - 1e-9
    has_frame = np.ones(n, np.bool_) if is_seen is None else is_seen
    agreed = [agreement_duration_s(stamp_ns, line[:, 0], has_frame) for line in left_and_right_lines]
    if steady_s is not None:
        agreed = [np.fmin(each, steady_s) for each in agreed]
    left, right = (np.where(each >= least_s, each, -1.0) for each in agreed)
    return left, right


def agreement_duration_s(stamp_ns: Int64Array, place_m: FloatArray, is_seen: BoolArray) -> FloatArray:
    """For how long each frame's boundary has been seen without a jump.

    Args:
        stamp_ns: Shape (n,), increasing.
        place_m: Shape (n,): of the boundary beside the camera; NaN where it is not found.
        is_seen: Shape (n,): False where it is only extrapolated from earlier frames.

    Returns:
        Shape (n,), seconds; -1 where it is not seen.
    """
    n = len(stamp_ns)
    is_known = is_seen & np.isfinite(place_m)
    dt_s = np.diff(stamp_ns) / NS_PER_S
    with np.errstate(invalid="ignore"):
        agrees = np.abs(np.diff(place_m)) <= MAX_BOUNDARY_STEP_M + MAX_BOUNDARY_SPEED_MPS * dt_s
    goes_on = np.zeros(n, np.bool_)
    goes_on[1:] = is_known[1:] & is_known[:-1] & agrees & (dt_s <= MAX_GAP_BETWEEN_COMPARED_FRAMES_S)
    begin = np.maximum.accumulate(np.where(goes_on, 0, np.arange(n)))
    return np.where(is_known, (stamp_ns - stamp_ns[begin]) / NS_PER_S if n else 0.0, -1.0)


def approach_speed_bound_mps(stamp_ns: Int64Array, gap_m: FloatArray, agreed_s: FloatArray) -> FloatArray:
    """An upper bound of how fast each frame's gap shrinks, m/s: the slope of least squares and two of its sigmas.

    Args:
        stamp_ns: Shape (n,), increasing.
        gap_m: Shape (n,): of a tyre beside its boundary, as measured; NaN where it is not known.
        agreed_s: Shape (n,): for how long the boundary has agreed; of that the last `APPROACH_RATE_WINDOW_S` count.

    Returns:
        Shape (n,); infinite with two frames or fewer.
    """
    n = len(stamp_ns)
    row_numbers = np.arange(n)
    first = np.searchsorted(
        stamp_ns, stamp_ns - (np.clip(agreed_s, 0.0, APPROACH_RATE_WINDOW_S) * NS_PER_S + 1.0).astype(np.int64)
    )
    sums = np.zeros((6, n))
    for back in range(int(np.max(row_numbers - first, initial=-1)) + 1):
        at = np.maximum(row_numbers - back, 0)
        known = (at >= first) & (row_numbers >= back) & np.isfinite(gap_m[at])
        time = (stamp_ns[at] - stamp_ns) / NS_PER_S
        gap = np.where(known, gap_m[at], 0.0)
        terms = np.stack([np.ones(n), time, gap, gap**2, time * gap, time**2])
        sums += np.where(known, terms, 0.0)
    count, times, gaps, squares, shared, spread = sums
    each = np.maximum(count, 1.0)
    spread = spread - times**2 / each
    tells = (count >= MIN_APPROACH_FRAMES) & (spread > MIN_TIME_SPREAD_S2)
    spread = np.where(tells, spread, 1.0)
    slope = (shared - times * gaps / each) / spread
    left = np.maximum(squares - gaps**2 / each - slope**2 * spread, 0.0)
    sigma = np.sqrt(left / np.maximum(count - 2.0, 1.0) / spread)
    return np.where(tells, APPROACH_BOUND_SIGMAS * sigma - slope, np.inf)
