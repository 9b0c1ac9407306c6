"""Find rows in which a sensor repeats one value although the car moves: it is stuck, saturated or switched off."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.odd_sensors import (
    MAX_REPEATS_AMONG_OTHER_ROWS_SHARE,
    MIN_STUCK_DURATION_S,
    MIN_STUCK_ROWS,
    begin_and_end_of_true_stretches,
    stuck_row_mask,
)
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import (
    BoolArray,
    EastNorthRows,
    FloatArray,
    ValueRows,
    median_of_values,
    sort_distinct_values,
)

MIN_MOVING_SPEED_MPS = 3.0
"""Least mean speed in m/s, by the fixes, of a car that surely moves, so that a repeated zero is a fault. Chosen by
hand."""
MIN_REPETITIONS_OF_FROZEN_FIX = 4
"""Least number of repetitions of a fix that is held. Chosen by hand: a receiver once a second that holds for 4 s."""
MAX_FROZEN_FIX_CHANGE_M = 1e-3
"""Greatest change in m, east or north, of a fix that is held: a height that goes on moves the place in the map by less.
Chosen below the noise of every receiver."""
MIN_DURATION_OF_RESTING_FIXES_S = 5.0
"""Least time, s, for which fixes with noise rest although the car moves on. Chosen: in less a fix rounded to 11 m,
a ten thousandth of a degree, rests lawfully at walking speed."""
N_LAST_RESTING_ROWS_THAT_GIVE_NOISE, RESTING_RADIUS_IN_SIGMAS, MIN_RESTING_RADIUS_M = 5, 4.0, 0.3
"""Last resting rows whose scatter tells the noise, and how far from the last one the others rest: so many sigmas, and
at least so many metres. Chosen by hand; not fitted."""
MOTION_CHECK_TIME_AROUND_REST_S = 1.0
"""Time before and after a rest, s, in which a car that did not stand moves. Chosen by hand: a car stops more slowly."""
MAX_TIME_STEP_OF_JUMP_TO_USUAL = 3.0
"""Longest step, in usual ones, in which the fixes jump to where the car is. Chosen by hand: behind a pause they may."""
MIN_CONSECUTIVE_SATURATED_IMU_ROWS, MIN_SATURATED_ACCELEROMETER_STRETCHES = 5, 4
"""Least number of rows in a row at the end of the range of an axis, and of such stretches of an accelerometer. Chosen
by hand; noise never repeats so long."""
MIN_ROWS_AT_END_OF_RANGE_TO_NEXT_VALUE = 3.0
"""Least number of rows at the end of a range, relative to that at the value beside it. Chosen by hand."""
MAX_NOISELESS_SECOND_TO_FIRST_DIFFERENCES_RATIO = 0.5
"""Greatest ratio of the summed absolute second differences of a signal without noise to its summed absolute first
differences; white noise has sqrt(3) = 1.73. Chosen by hand; not fitted."""
MAX_CHANGE_AFTER_REPETITION_TO_USUAL = 3.0
"""Greatest change of a noiseless signal after a repetition, relative to its greatest usual change; beyond it the signal
was stuck. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class FixMotion:
    """Smoothed positions of a vehicle, for its mean speed between two times.

    Attributes:
        time_s: Shape (n,), sorted.
        values: Shape (n, 2), m.
    """

    time_s: FloatArray
    values: FloatArray

    def mean_speed_mps(self, begin_s: float, end_s: float) -> float:
        """Return the distance between two times over the time; 0 where there are no fixes about it."""
        if len(self.time_s) < 2 or begin_s >= self.time_s[-1] or end_s <= self.time_s[0]:
            return 0.0
        begin, end = (
            np.array([np.interp(t, self.time_s, column) for column in self.values.T]) for t in (begin_s, end_s)
        )
        return float(np.hypot(*(end - begin))) / (end_s - begin_s)


def frozen_row_mask(kind: Kind, time_s: FloatArray, values: ValueRows, fixes: FixMotion) -> BoolArray:
    """Return a mask (n,) of rows that repeat a value which usually changes.

    A speed and a velocity may repeat a zero, and a heading any value, as long as the car stands.

    Args:
        values: Shape (n, d), finite.
        fixes: Positions of the same vehicle.
    """
    if kind is Kind.IMU:
        return _saturated_imu_mask(values) | _repeated_row_mask(time_s, values, lambda begin_s, end_s: True)
    if kind in (Kind.SPEED, Kind.VELOCITY):
        zero = (values == 0.0).all(axis=1)
        if len(zero) < 2 * MIN_STUCK_ROWS or zero.mean() > 1.0 - MAX_REPEATS_AMONG_OTHER_ROWS_SHARE:
            return stuck_row_mask(kind, time_s, values)
        frozen = np.zeros(len(time_s), np.bool_)
        for begin, end in begin_and_end_of_true_stretches(zero, MIN_STUCK_ROWS):
            is_long = time_s[end - 1] - time_s[begin] >= MIN_STUCK_DURATION_S
            if is_long and fixes.mean_speed_mps(time_s[begin], time_s[end - 1]) > MIN_MOVING_SPEED_MPS:
                frozen[begin:end] = True
        return stuck_row_mask(kind, time_s, values) | frozen
    if kind is Kind.HEADING:
        return _repeated_row_mask(
            time_s,
            np.unwrap(values, axis=0),
            lambda begin_s, end_s: fixes.mean_speed_mps(begin_s, end_s) > MIN_MOVING_SPEED_MPS,
        )
    if kind is Kind.POSITION:
        held = _frozen_fix_while_moving_mask(time_s, values)
        return held | _nearly_resting_fix_before_jump_mask(time_s, values, held)
    return np.zeros(len(time_s), np.bool_)


def _frozen_fix_while_moving_mask(time_s: FloatArray, fixes_m: EastNorthRows) -> BoolArray:
    """Return a mask (n,) of fixes (n, 2) that repeat the last one for long while the car moved on, as the next shows.

    A receiver without satellites may send its last fix again. One that holds the fix of a standing car does so, too,
    but the next fix is then near.
    """
    is_held = np.zeros(len(time_s), np.bool_)
    same = np.abs(np.diff(fixes_m, axis=0)).max(axis=1) <= MAX_FROZEN_FIX_CHANGE_M
    for begin, end in begin_and_end_of_true_stretches(
        same, MIN_REPETITIONS_OF_FROZEN_FIX
    ):  # rows begin .. end are one fix
        if end + 1 < len(time_s) and time_s[end] - time_s[begin] >= MIN_STUCK_DURATION_S:
            way_m = float(np.hypot(*(fixes_m[end + 1] - fixes_m[begin])))
            is_held[begin + 1 : end + 1] = way_m > MIN_MOVING_SPEED_MPS * (time_s[end + 1] - time_s[begin])
    elsewhere = same[~is_held[1:]]
    # Of fixes that are repeated all the time `repeated_rows` knows more.
    is_usual = len(elsewhere) > 0 and elsewhere.mean() >= MAX_REPEATS_AMONG_OTHER_ROWS_SHARE
    return np.zeros(len(time_s), np.bool_) if is_usual else is_held


def _nearly_resting_fix_before_jump_mask(time_s: FloatArray, fixes_m: EastNorthRows, is_frozen: BoolArray) -> BoolArray:
    """Return a mask (n,) of fixes (n, 2) that rest with some noise, between a moving car and a jump to where it is.

    A receiver without satellites may filter its last fix on and on. One of a car that stands comes to rest more slowly,
    and the next fix is near. Fixes that are known to be held are not looked at.
    """
    resting = np.zeros(len(time_s), np.bool_)
    if len(time_s) < 2 * MIN_STUCK_ROWS:
        return resting
    step_s, step_m = np.diff(time_s), np.hypot(*np.diff(fixes_m, axis=0).T)
    is_jump = (
        ~is_frozen[:-1]
        & (step_m > MIN_MOVING_SPEED_MPS * MIN_DURATION_OF_RESTING_FIXES_S)
        & (step_s < MAX_TIME_STEP_OF_JUMP_TO_USUAL * median_of_values(step_s))
    )

    def is_moving(row: int, other_s: float) -> bool:
        other = int(np.clip(np.searchsorted(time_s, other_s), 0, len(time_s) - 1))
        way_m = float(np.hypot(*(fixes_m[other] - fixes_m[row])))
        return way_m > MIN_MOVING_SPEED_MPS * abs(float(time_s[other] - time_s[row])) > 0.0

    for last in np.flatnonzero(is_jump).tolist():
        noise_m = float(np.hypot(*fixes_m[max(last - N_LAST_RESTING_ROWS_THAT_GIVE_NOISE, 0) : last + 1].std(axis=0)))
        radius_m = max(RESTING_RADIUS_IN_SIGMAS * noise_m, MIN_RESTING_RADIUS_M)
        far_rows = np.flatnonzero(np.hypot(*(fixes_m[:last] - fixes_m[last]).T) > radius_m)
        begin = int(far_rows[-1]) + 1 if len(far_rows) else 0
        lasts_long = time_s[last] - time_s[begin] >= MIN_DURATION_OF_RESTING_FIXES_S
        goes_on = step_m[last] > max(radius_m, MIN_MOVING_SPEED_MPS * (time_s[last + 1] - time_s[begin]))
        if (
            lasts_long
            and goes_on
            and is_moving(begin, time_s[begin] - MOTION_CHECK_TIME_AROUND_REST_S)
            and is_moving(last + 1, time_s[last + 1] + MOTION_CHECK_TIME_AROUND_REST_S)
        ):
            resting[begin + 1 : last + 1] = True
    return resting


def _repeated_row_mask(time_s: FloatArray, values: ValueRows, is_fault: Callable[[float, float], bool]) -> BoolArray:
    """Return a mask (n,) of rows that repeat one value for long in stretches that are a fault.

    Only where other rows hardly repeat: a coarse signal repeats often.
    """
    frozen = np.zeros(len(time_s), np.bool_)
    if len(time_s) < 2 * MIN_STUCK_ROWS:
        return frozen
    same = (np.diff(values, axis=0) == 0.0).all(axis=1)
    if not same.any():
        return frozen
    long = np.zeros(len(time_s), np.bool_)
    for begin, end in begin_and_end_of_true_stretches(same, MIN_STUCK_ROWS):  # rows begin .. end are one number
        if time_s[end] - time_s[begin] >= MIN_STUCK_DURATION_S:
            long[begin + 1 : end + 1] = True
            if is_fault(time_s[begin], time_s[end]):
                frozen[begin + 1 : end + 1] = True
    elsewhere = same[~long[1:]]
    is_usual = not len(elsewhere) or elsewhere.mean() >= MAX_REPEATS_AMONG_OTHER_ROWS_SHARE
    if is_usual or _continues_smoothly_after_repetitions(values, long):
        return np.zeros(len(time_s), np.bool_)
    return frozen


def _continues_smoothly_after_repetitions(values: ValueRows, is_long_repetition: BoolArray) -> bool:
    """Whether a signal (n, d) without noise goes on after its repetitions (n,) as it usually changes.

    A simulated sensor without noise repeats its value while the car stands or drives on evenly. One that was stuck
    jumps to the value that it has missed.
    """
    change = np.abs(np.diff(values, axis=0))
    bend = np.abs(np.diff(values, 2, axis=0))
    usual = ~(is_long_repetition[1:] | is_long_repetition[:-1])
    both = usual[1:] & usual[:-1]
    most = change[usual].max(axis=0, initial=0.0)
    is_smooth = (
        bend[both].sum(axis=0) <= MAX_NOISELESS_SECOND_TO_FIRST_DIFFERENCES_RATIO * change[usual].sum(axis=0)
    ).all()
    after = change[is_long_repetition[:-1] & ~is_long_repetition[1:]]
    return bool(is_smooth and most.any() and (after <= MAX_CHANGE_AFTER_REPETITION_TO_USUAL * most).all())


def _saturated_imu_mask(values: FloatArray) -> BoolArray:
    """Return a mask (n,) of the rows in which an axis of the gyroscope or accelerometer stays at the end of its range.

    Noise makes an axis of few values reach the last one less often than the value beside it. An accelerometer may stay
    at its greatest value once or twice, while the car brakes hardest, and one coarser than its noise for as long.
    """
    saturated = np.zeros(len(values), np.bool_)
    if len(values) < 2 * MIN_STUCK_ROWS:
        return saturated
    for k, column in enumerate(values.T):
        for limit, sign in ((column.max(), 1.0), (column.min(), -1.0)):
            at_end = column == limit
            n = int(at_end.sum())
            if not MIN_CONSECUTIVE_SATURATED_IMU_ROWS <= n < 0.5 * len(column):
                continue
            next_value = sign * (sign * column[~at_end]).max()
            if n < MIN_ROWS_AT_END_OF_RANGE_TO_NEXT_VALUE * int((column == next_value).sum()):
                continue
            stretches = begin_and_end_of_true_stretches(at_end, MIN_CONSECUTIVE_SATURATED_IMU_ROWS)
            if k < 3 and (
                len(stretches) < MIN_SATURATED_ACCELEROMETER_STRETCHES
                or np.diff(sort_distinct_values(column)).min() > median_of_values(np.abs(np.diff(column)))
            ):
                continue
            for begin, end in stretches:
                saturated[begin:end] = True
    return saturated
