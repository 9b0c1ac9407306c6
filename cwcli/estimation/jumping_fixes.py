"""Find stretches of fixes that lie beside the way: they begin and end with a jump that no car makes.

Reflections, a lost minus sign of a longitude or a receiver that guesses move fixes away for a while. The filter rejects
them for some seconds, then it believes them. But where the fixes jump away and back, those in between are wrong.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.sensor_limits import STAMP_SIGMA_RANGE
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import EastNorthRows, FloatArray

MIN_JUMP_IN_DIFFERENCE_SIGMAS = 8.0
"""Least jump of fixes in sigmas of the difference of two fixes, by their scatter. Chosen by hand: both neighbouring
steps must differ by it, which noise does once in 10^7 rows."""
MIN_FIX_JUMP_M = 3.3
"""Least jump of fixes, m: one sigma of the GPS Standard Positioning Service (2020; 8 m in 95 %)."""
MAX_CAR_ACCELERATION_MPS2 = 12.0
"""Greatest change of speed in a second that a car makes, m/s^2; tyres hold no more."""
MIN_STRETCH_OF_JUMPED_FIXES_S, MIN_JUMP_STRETCHES_TO_FIND_SHORTER_ONES_TOO = 2.0, 10
"""Least duration of a stretch that is found, s: after it the gate believes a source again; and number of stretches from
which on shorter ones are found, too. Chosen by hand."""
MAX_STAMP_ERROR_S = 4.0 * STAMP_SIGMA_RANGE.high
"""Greatest error of a stamp, s, that moves a fix along the way; farther ones may count as frequent stretches."""
MAX_FIX_INTERVAL_OF_JUMP_S = 5.0
"""Longest time between two fixes whose step may be a jump, s: in a longer one a car turns off. Chosen by hand."""
MAX_CAR_SPEED_MPS = 100.0
"""Greatest speed by which a car gets from the fixes before a stretch to those after it, m/s."""
MIN_FAR_JUMP_M = 100.0
"""Least jump, m, after which the way back need not be as long: reflections are shorter. Chosen by hand."""
MAX_RETURN_JUMP_DIFFERENCE_SHARE = 0.5
"""Greatest difference of the jumps there and back, as a share of the smaller one. Chosen by hand; the car goes on."""

MEASUREMENT_STEP_OF_USUAL_SPEED_S, MARGIN_ADDED_TO_TWICE_MEDIAN_SPEED_MPS = 1.0, 5.0
"""Time over which the usual speed is measured, s, and what is added to twice its median, m/s. Chosen by hand: in towns
the greatest speed is not twice the median."""

N_STEPS_OF_VELOCITY_AFTER_WRONG_FIX = 5
"""Number of steps that give the velocity after a single wrong fix. Chosen by hand."""
MAX_STEP_OVER_OUTLIER_TO_MIN_JUMP = 0.6
"""Greatest step over a single wrong fix, as a share of the least jump: five sigma of noise. Chosen by hand."""


@dataclass(frozen=True)
class _MaxDistance:
    """How far apart two fixes may lie between which others are wrong.

    Attributes:
        usual_speed_mps: Speed that the car hardly exceeds.
        least_jump_m: Distance beyond it that noise does not make.
    """

    usual_speed_mps: float
    least_jump_m: float


def fixes_jumped_away_mask(time_s: FloatArray, values: EastNorthRows, scatter_m: float) -> npt.NDArray[np.bool_]:
    """Return a mask (n,) of rows of fixes between a jump away from the way and one back to it.

    What lies between the jumps must be shorter than the longest stretch without any.

    Args:
        time_s: Shape (n,), increasing.
        values: Shape (n, 2), m.
        scatter_m: One sigma of the noise of a fix on each axis.
    """
    is_away = np.zeros(len(time_s), np.bool_)
    bound = _max_distance_of_fixes(time_s, values, scatter_m) if len(time_s) else _MaxDistance(0.0, 0.0)
    found = _stretches_between_jumps_away_and_back(
        time_s, values, _first_rows_after_jumps(time_s, values, bound), bound
    )
    # The gate rejects what is shorter by itself, unless there is so much of it that the noise grows.
    far = [
        (begin, end)
        for begin, end in found
        if np.hypot(*(values[begin] - values[max(begin - 1, 0)])) > MAX_STAMP_ERROR_S * bound.usual_speed_mps
    ]
    often = far if len(far) >= MIN_JUMP_STRETCHES_TO_FIND_SHORTER_ONES_TOO else []
    for begin, end in found:
        if (begin, end) in often or time_s[end - 1] - time_s[begin] >= MIN_STRETCH_OF_JUMPED_FIXES_S:
            is_away[begin:end] = True
    return is_away


def do_fixes_jump_for_good(time_s: FloatArray, values: EastNorthRows, scatter_m: float) -> bool:
    """Whether fixes jump as no car does, and no jump leads back: on one side they are wrong.

    For the arguments see `fixes_jumped_away_mask`.
    """
    if not len(time_s):
        return False
    bound = _max_distance_of_fixes(time_s, values, scatter_m)
    first_rows = _first_rows_after_jumps(time_s, values, bound)
    explained = _stretches_between_jumps_away_and_back(time_s, values, first_rows, bound)
    return any(not any(begin <= row <= end for begin, end in explained) for row in first_rows.tolist())


def _stretches_between_jumps_away_and_back(
    time_s: FloatArray, values: EastNorthRows, first_rows: npt.NDArray[np.intp], bound: _MaxDistance
) -> list[tuple[int, int]]:
    """Return begin and end of the stretches of rows between a jump away and one back, of any length."""
    if len(first_rows) < 2:
        return []
    begins = np.concatenate([[0], first_rows])
    lasts = np.concatenate([first_rows, [len(time_s)]]) - 1
    duration_s = time_s[lasts] - time_s[begins]
    anchor = int(duration_s.argmax())
    found: list[tuple[int, int]] = []
    for order in (range(anchor + 1, len(begins)), range(anchor - 1, -1, -1)):
        last_kept_stretch, skipped = anchor, list[int]()
        for stretch in order:
            if skipped and not _does_last_stretch_continue_first(
                time_s, values, begins, lasts, [last_kept_stretch, *skipped, stretch], bound
            ):
                skipped.append(stretch)
            elif skipped:
                found.append((int(begins[min(skipped)]), int(lasts[max(skipped)]) + 1))
                last_kept_stretch, skipped = stretch, []
            else:
                skipped.append(stretch)
    return found


def _first_rows_after_jumps(time_s: FloatArray, values: EastNorthRows, bound: _MaxDistance) -> npt.NDArray[np.intp]:
    """Return the rows to which a fix jumps: the step to them differs from those before and after it."""
    if len(time_s) < 4:
        return np.zeros(0, np.intp)
    step_s = np.diff(time_s)
    step_m = np.diff(values, axis=0)
    jump_m = np.full(len(step_s), np.inf)
    velocity_mps = step_m / np.maximum(step_s, 1e-3)[:, None]
    for before in (True, False):
        differs_m = np.full(len(step_s), np.inf)
        one, other = (slice(1, None), slice(None, -1)) if before else (slice(None, -1), slice(1, None))
        # A step is compared with a car that keeps the velocity of the step beside it, and with that step: where stamps
        # err, so does the velocity.
        differs_m[one] = np.minimum(
            np.hypot(*(step_m[one] - velocity_mps[other] * step_s[one][:, None]).T),
            np.hypot(*(step_m[one] - step_m[other]).T),
        )
        jump_m = np.minimum(jump_m, differs_m)
    least_m = bound.least_jump_m + 0.5 * MAX_CAR_ACCELERATION_MPS2 * step_s**2
    rows = np.flatnonzero((jump_m > least_m) & (step_s < MAX_FIX_INTERVAL_OF_JUMP_S)) + 1
    return rows[[not _is_jump_half_of_single_outlier(time_s, values, rows, row, bound) for row in rows.tolist()]]


def _is_jump_half_of_single_outlier(
    time_s: FloatArray, values: EastNorthRows, rows: npt.NDArray[np.intp], row: int, bound: _MaxDistance
) -> bool:
    """Whether a jump to a row is one side of a single wrong fix, whose other side is too small to be a jump."""
    for wrong, other_side in ((row - 1, row - 1), (row, row + 1)):
        if other_side in rows or not 0 < wrong < len(time_s) - 1:
            continue
        last = min(wrong + 1 + N_STEPS_OF_VELOCITY_AFTER_WRONG_FIX, len(time_s) - 1)
        if time_s[last] <= time_s[wrong + 1]:
            continue
        velocity = (values[last] - values[wrong + 1]) / (time_s[last] - time_s[wrong + 1])
        unexplained_move = values[wrong + 1] - values[wrong - 1] - velocity * (time_s[wrong + 1] - time_s[wrong - 1])
        if float(np.hypot(*unexplained_move)) < MAX_STEP_OVER_OUTLIER_TO_MIN_JUMP * bound.least_jump_m:
            return True
    return False


def _does_last_stretch_continue_first(
    time_s: FloatArray,
    values: EastNorthRows,
    begins: npt.NDArray[np.intp],
    lasts: npt.NDArray[np.intp],
    stretches: list[int],
    bound: _MaxDistance,
) -> bool:
    """Whether the last one of some stretches goes on where the first one ended, and those in between lie beside."""
    ordered = sorted(stretches)
    before, after = ordered[0], ordered[-1]
    way_m = float(np.hypot(*(values[begins[after]] - values[lasts[before]])))
    pause_s = float(time_s[begins[after]] - time_s[lasts[before]])
    if pause_s < MAX_FIX_INTERVAL_OF_JUMP_S:
        return way_m < bound.usual_speed_mps * pause_s + bound.least_jump_m
    if way_m > MAX_CAR_SPEED_MPS * pause_s:
        return False
    jump_away, back = (values[begins[b]] - values[lasts[a]] for a, b in ((before, ordered[1]), (ordered[-2], after)))
    least_m = min(float(np.hypot(*jump_away)), float(np.hypot(*back)))
    return least_m > MIN_FAR_JUMP_M or float(np.hypot(*(jump_away + back))) < MAX_RETURN_JUMP_DIFFERENCE_SHARE * least_m


def _max_distance_of_fixes(time_s: FloatArray, values: EastNorthRows, scatter_m: float) -> _MaxDistance:
    lag = max(1, int(np.searchsorted(time_s, time_s[0] + MEASUREMENT_STEP_OF_USUAL_SPEED_S)))
    speeds_mps = np.hypot(*(values[lag:] - values[:-lag]).T) / np.maximum(time_s[lag:] - time_s[:-lag], 1e-3)
    usual_mps = (
        2.0 * (median_of_finite_values(speeds_mps) if len(speeds_mps) else 0.0) + MARGIN_ADDED_TO_TWICE_MEDIAN_SPEED_MPS
    )
    return _MaxDistance(usual_mps, max(MIN_JUMP_IN_DIFFERENCE_SIGMAS * math.sqrt(2.0) * scatter_m, MIN_FIX_JUMP_M))
