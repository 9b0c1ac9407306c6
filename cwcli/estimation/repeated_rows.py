"""Find rows that hold no new measurement: repeated ones, and ones interpolated between two measurements.

A driver that publishes ten times a second what a receiver measures once repeats each value with new stamps, or draws a
straight line between two values. Nine of ten such rows are wrong by what the car moved since, and all of them say again
what was said. A filter that believes them is sure of a wrong state.

A coarse value of a slow car repeats lawfully: it moves by less than one step of its resolution from row to row. A
repeated value gives itself away by the change that follows: it is that of many rows at once.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.estimation.measurements import QUANTITY_BY_KIND, Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, ValueRows

MIN_REPEATED_VALUES = 10
"""Least number of repeated values that show a pattern. Chosen by hand; not fitted."""
MIN_REPEATED_SHARE = 0.05
"""Least share of repeated values among those that should have changed. Chosen: ten a second published eleven times a
second repeat every tenth value."""
MIN_CHANGE_PER_ROW_IN_RESOLUTION_STEPS = 3.0
"""Least change per repeated row, in steps of the resolution, that shows a repetition. Chosen: rounding hides one."""
MIN_RESOLUTION_SHARE_OF_LEAST_NOISE = 0.01
"""Change, as a share of a kind's least noise (`QUANTITY_BY_KIND`), below which it is rounding. Chosen by hand."""
MIN_SMALL_CHANGES_TO_READ_OFF_RESOLUTION = 8
"""Least number of small changes from which a resolution is read off. Chosen: eight changes without a resolution look
like whole multiples of the least one in 1 of 15,000 cases."""
MAX_RESOLUTION_STEPS_OF_TESTED_CHANGE, RESOLUTION_TOLERANCE_IN_STEPS, MIN_SHARE_OF_VALUES_ON_RESOLUTION_STEPS = (
    10.5,
    0.15,
    0.9,
)
"""Changes up to so many steps are whole multiples of a resolution, within this tolerance in steps, in at least this
share. Chosen: of changes without a resolution 30 % lie within the tolerance."""
MAX_JUMP_AFTER_HOLD_TO_USUAL = 3.0
"""Greatest jump after a value that is held for several periods, relative to the usual change, of a car that stood.
Chosen by hand; not fitted."""
INTERPOLATION_TOLERANCE_IN_LEAST_NOISES = 0.24
"""Greatest distance of interpolated rows from their line, in least noises of the kind: 1.2 cm of a position, which is
one step of a ten millionth of a degree."""
MIN_DEPARTURE_OF_SMOOTH_MOTION_FROM_LINE_IN_TOLERANCES = 3.0
"""Least distance from the line, in tolerances, by which a car that changes its motion smoothly would leave it. Chosen
by hand."""
MIN_KNOT_BEND_TO_MEDIAN = 5.0
"""Least ratio of a knot's second difference to the median one. Chosen by hand; not fitted."""
MIN_INTERPOLATION_KNOTS, MIN_ROWS_PER_INTERPOLATION_KNOT = 12, 2.5
"""Least number of knots, and least number of rows for each. Chosen by hand; not fitted."""
MIN_SHARE_OF_REGULAR_KNOTS, KNOT_REGULARITY_TOLERANCE = 0.8, 0.15
"""Least share of lines that last a whole number of the usual duration, within this share of it. Chosen by hand."""
MIN_SHARE_OF_STRAIGHT_LINES = 0.9
"""Least share of lines on which all rows lie. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class StaleRows:
    """Rows without a new measurement.

    Attributes:
        is_repetition: Shape (n,): the row repeats the value before it.
        is_interpolated: Shape (n,): the row lies on the line between two measurements.
        period_s: Time between two measurements; NaN where there is no such row.
    """

    is_repetition: npt.NDArray[np.bool_]
    is_interpolated: npt.NDArray[np.bool_]
    period_s: float = float("nan")

    @property
    def n_repeated(self) -> int:
        """Number of repeated rows."""
        return int(np.count_nonzero(self.is_repetition))

    @property
    def n_interpolated(self) -> int:
        """Number of interpolated rows."""
        return int(np.count_nonzero(self.is_interpolated))

    @property
    def n_rows(self) -> int:
        """Number of rows without a new measurement."""
        return self.n_repeated + self.n_interpolated

    @property
    def repeated_or_interpolated_row_mask(self) -> npt.NDArray[np.bool_]:
        """Shape (n,): the row holds no new measurement."""
        return self.is_repetition | self.is_interpolated

    def notes_for_user(self, source: str, kind: Kind) -> list[str]:
        """Return what the user is told; empty where there is nothing to tell."""
        name = kind.name.lower().replace("_", " ")
        counts_and_reasons = [
            (self.n_repeated, "repeat the value before them while the vehicle moves"),
            (self.n_interpolated, "are interpolated between two measurements"),
        ]
        n = len(self.is_repetition)
        return [
            f"{source}: {count} of {n} {name} rows {why}: only one each {self.period_s:.2g} s is used"
            for count, why in counts_and_reasons
            if count
        ]


NO_STALE_ROWS = StaleRows(np.zeros(0, np.bool_), np.zeros(0, np.bool_))
"""Result for a source whose rows are not examined."""


def find_stale_rows(kind: Kind, time_s: FloatArray, values: ValueRows) -> StaleRows:
    """Find the rows of a source that hold no new measurement."""
    none = np.zeros(len(time_s), np.bool_)
    if len(time_s) < 2 * MIN_REPEATED_VALUES:
        return StaleRows(none, none)
    is_repetition, period_s = _repeated_row_mask_and_period_s(kind, time_s, values)
    if is_repetition.any():
        return StaleRows(is_repetition, none, period_s)
    if kind in (Kind.POSITION, Kind.VELOCITY, Kind.SPEED, Kind.HEADING):
        is_interpolated, period_s = _interpolated_row_mask_and_period_s(kind, time_s, values)
        return StaleRows(none, is_interpolated, period_s)
    return StaleRows(none, none)


def _repeated_row_mask_and_period_s(
    kind: Kind, time_s: FloatArray, values: ValueRows
) -> tuple[npt.NDArray[np.bool_], float]:
    """Find the rows that repeat the value before them; returns a mask (n,) and the time between two measurements, s."""
    n, none = len(time_s), np.zeros(len(time_s), np.bool_)
    is_new = np.ones(n, np.bool_)
    is_new[1:] = (values[1:] != values[:-1]).any(axis=1)
    if n - int(np.count_nonzero(is_new)) < MIN_REPEATED_VALUES:
        return none, float("nan")
    first = np.flatnonzero(is_new)  # of each run of one value
    length = np.diff(first)  # the last run has no change behind it
    change = np.abs(np.diff(values[first], axis=0))
    floor = MIN_RESOLUTION_SHARE_OF_LEAST_NOISE * _least_noise_sigma_of_kind(kind)
    step = np.array([quantisation_step_or_zero_or_infinity(change[:, k], floor) for k in range(values.shape[1])])
    per_row = change / length[:, None]
    should_change = (per_row > np.maximum(MIN_CHANGE_PER_ROW_IN_RESOLUTION_STEPS * step, floor)).any(axis=1)
    is_held = should_change & (length > 1)
    n_held = int(np.count_nonzero(is_held))
    if n_held < MIN_REPEATED_VALUES or n_held < MIN_REPEATED_SHARE * int(np.count_nonzero(should_change)):
        return none, float("nan")
    held_s = np.diff(time_s[first])[is_held]
    # Of stamps that are cut to whole seconds most differences are 0; their mean is right all the same.
    period_s = median_of_finite_values(held_s) or float(np.mean(held_s))
    if not period_s > 0.0:
        return none, float("nan")
    size = np.append(change.max(axis=1), 0.0)
    usual = median_of_finite_values(size[:-1][is_held])
    run = np.cumsum(is_new) - 1
    # A car that stands is measured again and again: one row a period stays.
    n_periods = np.floor((time_s - time_s[first][run]) / period_s + KNOT_REGULARITY_TOLERANCE)
    begins_period = np.zeros(n, np.bool_)
    begins_period[1:] = (n_periods[1:] > n_periods[:-1]) & ~is_new[1:]
    last = np.append(first[1:], n) - 1
    is_long = time_s[last] - time_s[first] > 1.5 * period_s
    return ~is_new & ~(begins_period & (is_long & (size <= MAX_JUMP_AFTER_HOLD_TO_USUAL * usual))[run]), period_s


def quantisation_step_or_zero_or_infinity(value_changes: FloatArray, floor: float) -> float:
    """Return the step of which the small changes (k,) of a column are whole multiples.

    It is 0 where there is none, and infinite where too few changes are there to tell.
    """
    value_changes = value_changes[value_changes > floor]
    if len(value_changes) < MIN_SMALL_CHANGES_TO_READ_OFF_RESOLUTION:
        return float("inf")
    least = float(value_changes.min())
    steps = value_changes[value_changes < MAX_RESOLUTION_STEPS_OF_TESTED_CHANGE * least] / least
    if len(steps) < MIN_SMALL_CHANGES_TO_READ_OFF_RESOLUTION:
        return 0.0
    is_whole = np.abs(steps - np.rint(steps)) < RESOLUTION_TOLERANCE_IN_STEPS
    return least if float(is_whole.mean()) >= MIN_SHARE_OF_VALUES_ON_RESOLUTION_STEPS else 0.0


def _interpolated_row_mask_and_period_s(
    kind: Kind, time_s: FloatArray, values: ValueRows
) -> tuple[npt.NDArray[np.bool_], float]:
    """Find the rows on straight lines between measurements; returns a mask (n,) and the time between two, s.

    The knots of the lines come at regular times; between them every row lies on its line, although the lines bend at
    the knots by more than a car that changes its motion smoothly would leave a line.
    """
    n, none = len(time_s), (np.zeros(len(time_s), np.bool_), float("nan"))
    tolerance = INTERPOLATION_TOLERANCE_IN_LEAST_NOISES * _least_noise_sigma_of_kind(kind)
    step_s = np.diff(time_s)
    if not (step_s > 0.0).all():
        return none
    values = np.unwrap(values, axis=0) if kind is Kind.HEADING else values
    slope = np.diff(values, axis=0) / step_s[:, None]
    bend = np.abs(np.diff(slope, axis=0)).max(axis=1) * np.minimum(step_s[1:], step_s[:-1])
    knots = np.flatnonzero(bend > max(MIN_KNOT_BEND_TO_MEDIAN * median_of_finite_values(bend), 0.25 * tolerance)) + 1
    if len(knots) < MIN_INTERPOLATION_KNOTS or n < MIN_ROWS_PER_INTERPOLATION_KNOT * len(knots):
        return none
    duration_s = np.diff(time_s[knots])
    period_s = median_of_finite_values(duration_s)
    n_periods = np.maximum(np.rint(duration_s / period_s), 1.0)
    is_regular = np.abs(duration_s / period_s - n_periods) < KNOT_REGULARITY_TOLERANCE
    if float(is_regular.mean()) < MIN_SHARE_OF_REGULAR_KNOTS or period_s < 1.5 * median_of_finite_values(step_s):
        return none
    line = np.clip(np.searchsorted(knots, np.arange(n), side="right") - 1, 0, len(knots) - 2)
    line_slope = np.diff(values[knots], axis=0) / duration_s[:, None]
    begin = knots[line]
    distance_from_line = np.abs(values - values[begin] - line_slope[line] * (time_s - time_s[begin])[:, None]).max(
        axis=1
    )
    inside = (np.arange(n) >= knots[0]) & (np.arange(n) <= knots[-1])
    leaves = np.bincount(line[inside], distance_from_line[inside] > tolerance, len(knots) - 1) > 0
    turns = np.abs(np.diff(line_slope, axis=0)).max(axis=1) * np.minimum(duration_s[1:], duration_s[:-1]) / 8.0
    if (
        float(leaves.mean()) > 1.0 - MIN_SHARE_OF_STRAIGHT_LINES
        or median_of_finite_values(turns) < MIN_DEPARTURE_OF_SMOOTH_MOTION_FROM_LINE_IN_TOLERANCES * tolerance
    ):
        return none
    # Where a car stands or drives on evenly a knot does not show: one row a period stays.
    since = (time_s - time_s[begin]) / period_s
    n_since = np.floor(since + 0.5 * median_of_finite_values(step_s) / period_s)
    begins_period = np.ones(n, np.bool_)
    begins_period[1:] = (n_since[1:] != n_since[:-1]) | (line[1:] != line[:-1])
    is_knot = np.zeros(n, np.bool_)
    is_knot[knots] = True
    near_end = np.zeros(n, np.bool_)
    near_end[:-1] = is_knot[1:]  # the row before a knot begins no period of its own
    return ~is_knot & ~(begins_period & ~near_end), period_s


def _least_noise_sigma_of_kind(kind: Kind) -> float:
    """Return the least noise sigma of a kind; of an IMU that of the yaw rate, the finer one of its two quantities."""
    return QUANTITY_BY_KIND[Kind.YAW_RATE if kind is Kind.IMU else kind].floor_sigma
