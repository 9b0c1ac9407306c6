"""Compare two sources without a filter, step by step: distance, turn, course and change of speed.

A wrong unit, sign or axis multiplies the values of a source by a constant. So for each pair of sources the ratio is
taken in every step with clear motion, and its median over the log is compared with the range of such sensors. Steps of
several lengths are used: a latency, a bend or a jump of the fixes changes the ratio of short and long steps
differently, a wrong unit does not. A contradiction must show in every length that has enough steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from itertools import combinations

import numpy as np

from cwcli.estimation.check_texts import SourceComparisonCheck
from cwcli.estimation.contradiction import Contradiction, SourceQuantity
from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.sensor_limits import ACCEL_BIAS_RANGE, SPEED_SCALE_RANGE, YAW_RATE_BIAS_RANGE, ParameterRange
from cwcli.estimation.slow_accel import high_pass_time_constant_of_accelerometer_s, speed_changes_of_lever_arm
from cwcli.estimation.step_evidence import FIX_KINDS, MIN_COURSE_SPEED_MPS
from cwcli.estimation.step_motion import (
    MIN_FIX_DISTANCE_FOR_COURSE_M,
    StepMotion,
    compute_step_motion_by_source,
    step_edges_s,
)
from cwcli.estimation.turn_regression import regressed_turn_ratio
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import FloatArray
from cwcli.signals.normal_distribution import SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION

COMPARED_STEP_LENGTHS_S = (1.0, 2.0, 4.0, 8.0)
"""Lengths of the compared steps, s: as long as a manoeuvre takes, and longer than sensors are late. Chosen by hand."""
MIN_STEPS_OF_ONE_LENGTH = 4
"""Least number of clear steps of one length. Chosen: three agree by chance."""
MIN_STEPS_OF_ALL_LENGTHS = 8
"""Least number of clear steps of all lengths together. Chosen: a car turns five times in four minutes of town."""
STUDENT_99_QUANTILE_BY_N_VALUES: Mapping[int, float] = {
    4: 5.84,
    5: 4.60,
    6: 4.03,
    7: 3.71,
    8: 3.50,
    9: 3.36,
    10: 3.25,
    15: 2.98,
    20: 2.86,
}
"""Number of values -> half the width of the 99 % interval in sigma of the mean (Student, two-sided); more: 2.86."""
MEDIAN_TO_MEAN_SIGMA_RATIO = 1.2533
"""Sigma of the median of normal values divided by that of their mean: the square root of pi / 2."""
MIN_ROWS_OF_COMPARED_SOURCE = 20
"""Least number of rows of a source that is compared. Chosen by hand; not fitted."""
AGREEING_HEADING_CHANGE_RATIO_RANGE = ParameterRange(
    0.6, 1.6, "", "a MEMS gyroscope's scale errs by 3 %; the rest is room for latencies and for courses of short ways"
)
"""Range of the ratio of two changes of heading that agree; the value itself names its source."""
AGREEING_SPEED_CHANGE_RATIO_RANGE = ParameterRange(
    0.6, 1.6, "", "an accelerometer's scale errs by 3 %; the rest is room for slopes, latencies and the noise of fixes"
)
"""Range of the ratio of two changes of speed that agree; the value itself names its source."""
AGREEING_HEADING_DIFFERENCE_RANGE_RAD = ParameterRange(
    -math.pi / 6.0, math.pi / 6.0, "rad", "a magnetic compass beside a car's iron errs by up to 30 degrees"
)
"""Range in rad of the difference of two headings or courses that agree; the value itself names its source."""
MIN_HEADING_CHANGE_OF_TURN_RAD = 0.25
"""Least change of heading from one step to the next, rad, that counts as a turn: more than a lane bends or noise makes.
Chosen by hand."""
MIN_COURSE_CHANGE_OF_TURN_RAD = 0.5
"""Change of heading from one step to the next that is a turn where one of the two sources is a course by fixes, rad.
Chosen by hand, well above the 0.2 by which the chord of a step is off when the car brakes and turns."""
MIN_MOTION_CHANGE_SIGMAS = 4.0
"""Least turn or change of speed in sigmas of the noise of fixes. Chosen by hand; not fitted."""
MIN_SPEED_CHANGE_MPS = 2.0
"""Least change of the mean speed from one step to the next, m/s, that counts as braking or accelerating. Chosen by
hand."""
MAX_COMPARED_HEADING_CHANGE_RAD = 2.5
"""Largest change of heading from one step to the next, rad, that is compared; a larger one may have gone round the
other way. Chosen by hand."""
CHECKS_THAT_ONLY_CONTRADICT = (SourceComparisonCheck.YAW_RATE_BIAS, SourceComparisonCheck.ACCEL_BIAS)
"""Comparisons that can only contradict: agreement without motion does not show that units and signs agree."""


def student_99_half_width(n_values: int) -> float:
    """Return half the width of the 99 % interval in sigma of the mean of n values, four or more."""
    return STUDENT_99_QUANTILE_BY_N_VALUES[max(size for size in STUDENT_99_QUANTILE_BY_N_VALUES if size <= n_values)]


class Judgement(StrEnum):
    """Judgement on two sources.

    Attributes:
        AGREE: They agree within the limits of such sensors.
        CONTRADICT: They cannot both be right.
        UNKNOWN: The log does not suffice, or steps of different lengths disagree.
    """

    AGREE = "agree"
    CONTRADICT = "contradict"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class SourceComparison:
    """Result of the comparison of two sources.

    Attributes:
        check: Kind of comparison.
        one, other: The sources.
        judgement: Whether they agree.
        number: `one` relative to `other`: a ratio, or a difference in SI units.
    """

    check: SourceComparisonCheck
    one: SourceQuantity
    other: SourceQuantity
    judgement: Judgement
    number: float

    def involves_source(self, quantity: SourceQuantity) -> bool:
        """Whether a source is one of the two."""
        return quantity in (self.one, self.other)

    def other_source(self, quantity: SourceQuantity) -> SourceQuantity:
        """Return the other one of the two sources."""
        return self.other if quantity == self.one else self.one

    def to_contradiction(self, who: SourceQuantity) -> Contradiction:
        """Return it as a contradiction with one of the two blamed."""
        number = self.number if who == self.one else self.check.ratio_or_difference_with_sources_exchanged(self.number)
        against = self.other_source(who)
        return Contradiction(who, against, self.check.contradiction_text(who.kind, against.kind, number))


@dataclass(frozen=True)
class MedianInterval:
    """A median with its interval.

    Attributes:
        value: The median; NaN with too few values.
        low, high: Its 99 % interval, by the median of the absolute deviations.
        n: How many values it is of.
    """

    value: float = math.nan
    low: float = math.nan
    high: float = math.nan
    n: int = 0

    @classmethod
    def from_values(cls, values: FloatArray) -> MedianInterval:
        """Compute median and interval of a column (n,); unknown with fewer than MIN_STEPS_OF_ONE_LENGTH values."""
        n = len(values)
        if n < MIN_STEPS_OF_ONE_LENGTH:
            return cls()
        middle = median_of_finite_values(values)
        spread = (
            SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION
            * MEDIAN_TO_MEAN_SIGMA_RATIO
            * median_of_finite_values(np.abs(values - middle))
        )
        half = student_99_half_width(n) * spread / math.sqrt(n)
        return cls(middle, middle - half, middle + half, n)

    def judge_against_range(self, limit: ParameterRange) -> Judgement:
        """Judge the interval against a range: it agrees inside, contradicts outside, and is unknown across a bound."""
        if math.isnan(self.value):
            return Judgement.UNKNOWN
        if self.low > limit.high or self.high < limit.low:
            return Judgement.CONTRADICT
        return (
            Judgement.AGREE
            if limit.contains_or_is_nan(self.low) and limit.contains_or_is_nan(self.high)
            else Judgement.UNKNOWN
        )


@dataclass(frozen=True)
class StepComparison:
    """Comparison of a pair in steps of one length.

    Attributes:
        judgement: Whether the pair agrees.
        number: Median ratio or difference; NaN with too few steps.
        n: Number of steps.
        half: Half the width of its interval.
        is_possible: The number lies in the range of what such sensors can differ by.
    """

    judgement: Judgement = Judgement.UNKNOWN
    number: float = math.nan
    n: int = 0
    half: float = math.inf
    is_possible: bool = False

    @classmethod
    def from_median_interval(cls, interval: MedianInterval, limit: ParameterRange) -> StepComparison:
        """Compare a median with a range."""
        half = 0.5 * (interval.high - interval.low)
        return cls(
            interval.judge_against_range(limit),
            interval.value,
            interval.n,
            half,
            limit.contains_or_is_nan(interval.value),
        )


UNKNOWN_STEP_COMPARISON = StepComparison()
"""Comparison of a pair that cannot be compared."""


def compare_all_source_pairs(series: Sequence[SensorSeries]) -> list[SourceComparison]:
    """Compare each pair of sources in all quantities that both have.

    Args:
        series: Series with at least one position, positions first; stamps uncorrected.
    """
    usable = [s for s in series if len(s) >= MIN_ROWS_OF_COMPARED_SOURCE and not s.is_exact]
    if len(usable) < 2 or not any(s.kind is Kind.POSITION for s in usable):
        return []
    by_length = []
    for step_s in COMPARED_STEP_LENGTHS_S:
        edges_s = step_edges_s(usable, step_s)
        if len(edges_s) > MIN_STEPS_OF_ONE_LENGTH + 1:
            motions = [compute_step_motion_by_source(s, edges_s) for s in usable]
            by_length.append((step_s, reverse_fix_courses_while_reversing(motions)))
    found = []
    for j, i in combinations(range(len(usable)), 2):
        one, other = (SourceQuantity(usable[k].source, usable[k].kind) for k in (i, j))
        for check, measure in _COMPARE_FUNCTIONS.items():
            measured = [measure(motions[i], motions[j], step_s) for step_s, motions in by_length]
            judgement, number = joint_judgement_and_number_of_step_lengths(measured)
            if check is SourceComparisonCheck.TURN and judgement is Judgement.UNKNOWN:
                judgement, number = _judgement_and_ratio_of_regressed_turns(
                    [(motions[i], motions[j]) for _, motions in by_length]
                )
            if check is SourceComparisonCheck.SPEED_CHANGE and judgement is Judgement.UNKNOWN:
                pairs = [(motions[i], motions[j], s) for s, motions in by_length]
                found += _slow_part_contradiction(one, other, pairs, usable)
            if judgement is Judgement.UNKNOWN or (
                check in CHECKS_THAT_ONLY_CONTRADICT and judgement is Judgement.AGREE
            ):
                continue
            found.append(SourceComparison(check, one, other, judgement, number))
            if judgement is Judgement.CONTRADICT and check in (
                SourceComparisonCheck.TURN,
                SourceComparisonCheck.SPEED_CHANGE,
            ):
                break  # what differs by a factor differs by a constant, too
    return found


def _slow_part_contradiction(
    one: SourceQuantity,
    other: SourceQuantity,
    pairs: Sequence[tuple[StepMotion, StepMotion, float]],
    series: Sequence[SensorSeries],
) -> list[SourceComparison]:
    """Return a contradiction of an accelerometer without its slow part and the fixes, or nothing; see `slow_accel`.

    Args:
        one, other: The sources.
        pairs: Their motions, and the length of the steps, s.
        series: All series; the turn rate of one tells what a lever arm explains.
    """
    if {one.kind, other.kind} != {Kind.ACCEL, Kind.POSITION}:
        return []
    for first, second, step_s in reversed(pairs):
        accel, fixes = (first, second) if first.kind is Kind.ACCEL else (second, first)
        time_constant_s = high_pass_time_constant_of_accelerometer_s(accel, fixes, step_s)
        turning = next((s for s in series if s.kind is Kind.YAW_RATE), None)
        if turning is not None and math.isfinite(time_constant_s):
            of_lever_arm = speed_changes_of_lever_arm(turning, step_edges_s(series, step_s))
            time_constant_s = high_pass_time_constant_of_accelerometer_s(accel, fixes, step_s, of_lever_arm)
        if math.isfinite(time_constant_s):
            check = SourceComparisonCheck.SLOW_ACCEL
            return [SourceComparison(check, one, other, Judgement.CONTRADICT, time_constant_s)]
    return []


def joint_judgement_and_number_of_step_lengths(comparisons: Sequence[StepComparison]) -> tuple[Judgement, float]:
    """Judge steps of all lengths together; returns the judgement and the most precise number.

    They contradict where one length does, every other length shows an impossible number too, and there are enough steps
    in total. They agree where one length does and none contradicts.
    """
    known = [each for each in comparisons if not math.isnan(each.number)]
    if not known:
        return Judgement.UNKNOWN, math.nan
    contrary = [each for each in known if each.judgement is Judgement.CONTRADICT]
    is_enough = sum(each.n for each in known) >= MIN_STEPS_OF_ALL_LENGTHS
    if contrary and is_enough and not any(each.is_possible for each in known):
        return Judgement.CONTRADICT, min(contrary, key=lambda each: each.half).number
    agrees = any(each.judgement is Judgement.AGREE for each in known) and not contrary
    return Judgement.AGREE if agrees else Judgement.UNKNOWN, min(known, key=lambda each: each.half).number


def _judgement_and_ratio_of_regressed_turns(pairs: Sequence[tuple[StepMotion, StepMotion]]) -> tuple[Judgement, float]:
    """Judge the turns of a pair by a line through those of all steps; see `turn_regression`.

    Args:
        pairs: The motions in steps of `COMPARED_STEP_LENGTHS_S`, as far as the log is long enough.
    """
    ratios = [regressed_turn_ratio(*pair) for pair in pairs[1:]]  # not of those in steps of 1 s
    intervals = [MedianInterval(ratio.value, ratio.low, ratio.high, ratio.n) for ratio in ratios]
    return joint_judgement_and_number_of_step_lengths(
        [StepComparison.from_median_interval(interval, AGREEING_HEADING_CHANGE_RATIO_RANGE) for interval in intervals]
    )


def reverse_fix_courses_while_reversing(motions: Sequence[StepMotion]) -> list[StepMotion]:
    """Reverse course and distance of fixes in steps in which the car drives backwards.

    There a speed is negative and a heading points against the course; one of both alone is a wrong sensor.

    Args:
        motions: Motions of the sources in the same steps.
    """
    speeds = [m.distance_m for m in motions if m.kind is Kind.SPEED]
    headings = [m.angle_rad for m in motions if m.kind is Kind.HEADING]
    if not speeds or not headings:
        return list(motions)
    found = []
    for m in motions:
        if m.kind not in FIX_KINDS:
            found.append(m)
            continue
        with np.errstate(invalid="ignore"):
            is_back = (speeds[0] < 0.0) & (np.cos(headings[0] - m.angle_rad) < 0.0)
        sign = np.where(is_back, -1.0, 1.0)
        angle = np.where(is_back, m.angle_rad + np.pi, m.angle_rad)
        found.append(replace(m, distance_m=sign * m.distance_m, speed_mps=sign * m.speed_mps, angle_rad=angle))
    return found


def _compare_median_ratio_with_range(
    numerators: FloatArray,
    denominators: FloatArray,
    min_divisor: FloatArray | float,
    max_divisor: float,
    limit: ParameterRange,
) -> StepComparison:
    """Compare the median ratio with a range, over steps in which the denominator clearly differs from zero."""
    with np.errstate(invalid="ignore"):
        rows = (np.abs(denominators) > min_divisor) & (np.abs(denominators) < max_divisor) & np.isfinite(numerators)
    return StepComparison.from_median_interval(MedianInterval.from_values(numerators[rows] / denominators[rows]), limit)


def _compare_median_ratio_both_ways(
    numerators: FloatArray,
    denominators: FloatArray,
    min_changes: Sequence[FloatArray | float],
    max_change: float,
    limit: ParameterRange,
) -> StepComparison:
    """Compare the ratio with a range, over steps in which the denominator moves and those in which the numerator does.

    A sensor that never reacts shows only in steps that are chosen by the other one.
    """
    forth = _compare_median_ratio_with_range(numerators, denominators, min_changes[1], max_change, limit)
    back = _compare_median_ratio_with_range(
        denominators, numerators, min_changes[0], max_change, ParameterRange(1.0 / limit.high, 1.0 / limit.low, "", "")
    )
    if math.isnan(back.number) or forth.judgement is back.judgement:
        return forth
    if math.isnan(forth.number):
        return replace(back, number=SourceComparisonCheck.TURN.ratio_or_difference_with_sources_exchanged(back.number))
    return replace(forth, judgement=Judgement.UNKNOWN, is_possible=forth.is_possible or back.is_possible)


def _compare_distances(one: StepMotion, other: StepMotion, step_s: float) -> StepComparison:
    pair = (one.kind, other.kind)
    if not set(pair) <= {*FIX_KINDS, Kind.SPEED} or pair == (Kind.POSITION, Kind.POSITION):
        return UNKNOWN_STEP_COMPARISON
    limit = SPEED_SCALE_RANGE
    if one.kind in FIX_KINDS and other.kind is Kind.SPEED:
        limit = ParameterRange(1.0 / SPEED_SCALE_RANGE.high, 1.0 / SPEED_SCALE_RANGE.low, "", "")
    return _compare_median_ratio_with_range(
        one.distance_m, other.distance_m, MIN_FIX_DISTANCE_FOR_COURSE_M, math.inf, limit
    )


def _compare_turns(one: StepMotion, other: StepMotion, step_s: float) -> StepComparison:
    by_course = one.kind in FIX_KINDS or other.kind in FIX_KINDS
    least_rad = MIN_COURSE_CHANGE_OF_TURN_RAD if by_course else MIN_HEADING_CHANGE_OF_TURN_RAD
    least = [np.fmax(least_rad, MIN_MOTION_CHANGE_SIGMAS * m.turn_sigma_rad) for m in (one, other)]
    return _compare_median_ratio_both_ways(
        one.turn_rad, other.turn_rad, least, MAX_COMPARED_HEADING_CHANGE_RAD, AGREEING_HEADING_CHANGE_RATIO_RANGE
    )


def _compare_yaw_rates_going_straight(one: StepMotion, other: StepMotion, step_s: float) -> StepComparison:
    if Kind.YAW_RATE not in (one.kind, other.kind):
        return UNKNOWN_STEP_COMPARISON
    difference = one.turn_rad - other.turn_rad
    small = np.abs(other.turn_rad if one.kind is Kind.YAW_RATE else one.turn_rad) < MIN_HEADING_CHANGE_OF_TURN_RAD
    return StepComparison.from_median_interval(
        MedianInterval.from_values(difference[small & np.isfinite(difference)] / step_s), YAW_RATE_BIAS_RANGE
    )


def _judge_median_course_difference(one: StepMotion, other: StepMotion, step_s: float) -> StepComparison:
    """Judge whether the median difference of two courses is one that a heading offset explains."""
    fixes = [m for m in (one, other) if m.kind in FIX_KINDS]
    if not (one.has_zero_angle and other.has_zero_angle and fixes):
        return UNKNOWN_STEP_COMPARISON
    difference = one.angle_rad - other.angle_rad
    with np.errstate(invalid="ignore"):
        rows = np.isfinite(difference) & (np.abs(fixes[0].speed_mps) > MIN_COURSE_SPEED_MPS)
    if not rows.any():
        return UNKNOWN_STEP_COMPARISON
    middle = float(np.angle(np.exp(1j * difference[rows]).mean()))
    interval = MedianInterval.from_values((difference[rows] - middle + np.pi) % (2.0 * np.pi) - np.pi)
    # About the mean direction the median is small; the range moves with it.
    if math.isnan(interval.value):
        return UNKNOWN_STEP_COMPARISON
    nearest_difference = middle - 2.0 * np.pi * round((middle + interval.value) / (2.0 * np.pi))
    return StepComparison.from_median_interval(
        MedianInterval(
            nearest_difference + interval.value,
            nearest_difference + interval.low,
            nearest_difference + interval.high,
            interval.n,
        ),
        AGREEING_HEADING_DIFFERENCE_RANGE_RAD,
    )


def _speed_changes_of_both_minus_medians(one: StepMotion, other: StepMotion) -> tuple[FloatArray, FloatArray]:
    """Return the changes of speed of two sources, each without its median over the steps that both have.

    The median of an accelerometer's changes is its bias and that of the car. So it is subtracted from both: a car that
    accelerates evenly all the time shows nothing.
    """
    changes = one.speed_change_to_next_step_mps, other.speed_change_to_next_step_mps
    known = np.isfinite(changes[0]) & np.isfinite(changes[1])
    if not known.any():
        return changes
    return changes[0] - median_of_finite_values(changes[0][known]), changes[1] - median_of_finite_values(
        changes[1][known]
    )


def _compare_speed_changes(one: StepMotion, other: StepMotion, step_s: float) -> StepComparison:
    if Kind.ACCEL not in (one.kind, other.kind):
        return UNKNOWN_STEP_COMPARISON
    least = [max(MIN_SPEED_CHANGE_MPS, MIN_MOTION_CHANGE_SIGMAS * m.speed_change_sigma_mps) for m in (one, other)]
    return _compare_median_ratio_both_ways(
        *_speed_changes_of_both_minus_medians(one, other),
        least,
        math.inf,
        AGREEING_SPEED_CHANGE_RATIO_RANGE,
    )


def _compare_accelerations(one: StepMotion, other: StepMotion, step_s: float) -> StepComparison:
    if (one.kind is Kind.ACCEL) == (other.kind is Kind.ACCEL):
        return UNKNOWN_STEP_COMPARISON
    difference = one.speed_change_to_next_step_mps - other.speed_change_to_next_step_mps
    return StepComparison.from_median_interval(
        MedianInterval.from_values(difference[np.isfinite(difference)] / step_s), ACCEL_BIAS_RANGE
    )


_COMPARE_FUNCTIONS: dict[SourceComparisonCheck, Callable[[StepMotion, StepMotion, float], StepComparison]] = {
    SourceComparisonCheck.WAY: _compare_distances,
    SourceComparisonCheck.TURN: _compare_turns,
    SourceComparisonCheck.YAW_RATE_BIAS: _compare_yaw_rates_going_straight,
    SourceComparisonCheck.COURSE: _judge_median_course_difference,
    SourceComparisonCheck.SPEED_CHANGE: _compare_speed_changes,
    SourceComparisonCheck.ACCEL_BIAS: _compare_accelerations,
}
"""Function of each comparison: motions of two sources and step length (s) -> result."""
