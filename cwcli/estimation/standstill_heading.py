"""Find headings that are turned round while the car stands, as receivers do that derive a heading from their motion."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import FloatArray

MIN_HEADING_JUMP_RAD = math.pi / 2.0
"""Least change of heading between two neighbouring rows, rad, that no car makes: a quarter of a turn."""
MAX_JUMP_GAP_S = 1.0
"""Longest time in s between two rows whose change counts as a jump: a car turns by 0.6 rad/s at most. Chosen by
hand."""
MAX_STANDING_SPEED_MPS = 1.0
"""Greatest measured speed of a car that stands, m/s: the noise of fixes and wheel speeds. Chosen by hand."""
MIN_MOVING_SPEED_MPS = 2.0
"""Least speed at which a heading is taken for right, m/s. Chosen by hand; not fitted."""


def has_heading_jumps(time_s: FloatArray, heading_rad: FloatArray) -> bool:
    """Whether a heading (n,) at sorted times (n,) jumps between neighbouring rows."""
    if len(heading_rad) < 2:
        return False
    change = np.abs((np.diff(heading_rad) + math.pi) % (2.0 * math.pi) - math.pi)
    return bool(((change > MIN_HEADING_JUMP_RAD) & (np.diff(time_s) < MAX_JUMP_GAP_S)).any())


def heading_flipped_at_standstill_mask(
    time_s: FloatArray, heading_rad: FloatArray, speed_mps: FloatArray
) -> npt.NDArray[np.bool_]:
    """Return a mask (n,) of rows at standstill that point away from the headings of the drive before and after.

    A car that stands does not turn. So a heading at standstill that differs by more than a quarter of a turn from the
    last one before it and from the first one after it is wrong.

    Args:
        speed_mps: Shape (n,): absolute speed at the rows, from another source; NaN where it is not known.
    """
    with np.errstate(invalid="ignore"):
        moving = np.flatnonzero(speed_mps > MIN_MOVING_SPEED_MPS)
        standing = speed_mps < MAX_STANDING_SPEED_MPS
    if not len(moving):
        return np.zeros(len(time_s), np.bool_)
    next_moving = np.searchsorted(moving, np.arange(len(time_s)))
    before = moving[np.maximum(next_moving - 1, 0)]
    after = moving[np.minimum(next_moving, len(moving) - 1)]
    is_far_from_before_and_after = [
        np.cos(heading_rad - heading_rad[rows]) < math.cos(MIN_HEADING_JUMP_RAD) for rows in (before, after)
    ]
    return np.asarray(standing & is_far_from_before_and_after[0] & is_far_from_before_and_after[1])
