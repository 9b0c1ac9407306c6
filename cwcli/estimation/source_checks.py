"""Whether two sources can both be right: way, turn, course and change of speed, step by step, without any filter.

A wrong unit, sign or axis multiplies what a source says by a constant. So of each pair of sources the ratio is taken in
every step in which one of them clearly moves, and its median over the log compared with what sensors can be. Each is
looked at in steps of several lengths: a latency, a bend or a jump of the fixes changes the ratio of short steps and of
long ones differently, a wrong unit does not. Only what contradicts in every length that has enough steps counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import combinations

import numpy as np

from cwcli.estimation.check_words import Check
from cwcli.estimation.contradiction import Contradiction, Quantity
from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median
from cwcli.estimation.passes import Series
from cwcli.estimation.sensor_limits import ACCEL_BIAS, SPEED_SCALE, YAW_RATE_BIAS, Limit
from cwcli.estimation.step_motion import (
    LEAST_CHORD_M,
    MEDIAN_ABSOLUTE_TO_SIGMA,
    StepMotion,
    motion_in_steps,
    step_edges,
)
from cwcli.signals.columns import FloatArray

STEPS_S = (1.0, 2.0, 4.0, 8.0)
"""Lengths of the steps, s: as long as a manoeuvre takes, and longer than sensors are late."""
MIN_STEPS = 4
"""Fewer clear steps of one length tell nothing: three agree by chance."""
ENOUGH_STEPS = 8
"""So many clear steps of all lengths together have to tell the same: a car turns five times in four minutes of town."""
STUDENT_99: Mapping[int, float] = {4: 5.84, 5: 4.60, 6: 4.03, 7: 3.71, 8: 3.50, 9: 3.36, 10: 3.25, 15: 2.98, 20: 2.86}
"""Number of values -> half the width of the 99 % interval in sigma of the mean (Student, two-sided); more: 2.86."""
MEDIAN_EFFICIENCY = 1.2533
"""Sigma of a median of normal values over that of their mean."""
LEAST_ROWS = 20
"""A source with fewer rows takes no part."""
TURN_RATIO = Limit(
    0.6, 1.6, "", "a MEMS gyroscope's scale errs by 3 %; the rest is room for latencies and for courses of short ways"
)
SPEED_CHANGE_RATIO = Limit(
    0.6, 1.6, "", "an accelerometer's scale errs by 3 %; the rest is room for slopes, latencies and the noise of fixes"
)
HEADING_OFFSET = Limit(
    -math.pi / 6.0, math.pi / 6.0, "rad", "a magnetic compass beside a car's iron errs by up to 30 degrees"
)
LEAST_TURN_RAD = 0.25
"""Change of heading from one step to the next that is a turn and not a lane's curve or noise, rad."""
LEAST_COURSE_TURN_RAD = 0.5
"""The same beside a course by fixes, rad: the chord of a step in which the car brakes and turns is off by up to 0.2."""
CLEAR_SIGMAS = 4.0
"""And it is so many sigma of what the noise of the fixes makes of it; a change of speed, too."""
LEAST_SPEED_CHANGE_MPS = 2.0
"""Change of mean speed from one step to the next that is braking or accelerating and not a slope, m/s."""
MOST_TURN_RAD = 2.5
"""A larger change of heading from one step to the next may have gone round the other way, rad."""
LEAST_COURSE_SPEED_MPS = 4.0
"""Slower, a car may drive backwards for long, m/s; 14 km/h."""
FIXES = (Kind.POSITION, Kind.VELOCITY)
BIASES = (Check.YAW_RATE_BIAS, Check.ACCEL_BIAS)
"""What can only contradict: that two agree where nothing happens does not tell that their units and signs do."""


class Judgement(StrEnum):
    """What the comparison of two sources says.

    Attributes:
        AGREE: They say the same, within what such sensors can differ by.
        CONTRADICT: They can't both be right.
        UNKNOWN: The log has too little in it to tell, or steps of different lengths tell different things.
    """

    AGREE = "agree"
    CONTRADICT = "contradict"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Comparison:
    """Two sources beside each other.

    Attributes:
        check: What was compared.
        one, other: The sources.
        judgement: What it says.
        number: What `one` says against `other`: a ratio, or a difference in SI units.
    """

    check: Check
    one: Quantity
    other: Quantity
    judgement: Judgement
    number: float

    def has(self, quantity: Quantity) -> bool:
        """Whether it is about a source."""
        return quantity in (self.one, self.other)

    def opposite(self, quantity: Quantity) -> Quantity:
        """The other one of the two sources."""
        return self.other if quantity == self.one else self.one

    def contradiction(self, who: Quantity) -> Contradiction:
        """As a contradiction for which one of the two is blamed."""
        number = self.number if who == self.one else self.check.inverse(self.number)
        against = self.opposite(who)
        return Contradiction(who, against, self.check.words(who.kind, against.kind, number))


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
    def of(cls, values: FloatArray) -> MedianInterval:
        """Of a column (n,); unknown with fewer than MIN_STEPS values."""
        n = len(values)
        if n < MIN_STEPS:
            return cls()
        middle = median(values)
        spread = MEDIAN_ABSOLUTE_TO_SIGMA * MEDIAN_EFFICIENCY * median(np.abs(values - middle))
        half = STUDENT_99[max(size for size in STUDENT_99 if size <= n)] * spread / math.sqrt(n)
        return cls(middle, middle - half, middle + half, n)

    def judged(self, limit: Limit) -> Judgement:
        """Against a range: the whole interval lies inside or outside."""
        if math.isnan(self.value):
            return Judgement.UNKNOWN
        if self.low > limit.high or self.high < limit.low:
            return Judgement.CONTRADICT
        return Judgement.AGREE if limit.holds(self.low) and limit.holds(self.high) else Judgement.UNKNOWN


@dataclass(frozen=True)
class Measured:
    """What steps of one length say of a pair.

    Attributes:
        judgement: UNKNOWN with a number: it may be either.
        number: The ratio or difference that they show; NaN with too few steps.
        n: In how many steps.
        half: Half the width of its interval.
        is_possible: The number lies in the range of what such sensors can differ by.
    """

    judgement: Judgement = Judgement.UNKNOWN
    number: float = math.nan
    n: int = 0
    half: float = math.inf
    is_possible: bool = False

    @classmethod
    def of(cls, interval: MedianInterval, limit: Limit) -> Measured:
        """A median against a range."""
        half = 0.5 * (interval.high - interval.low)
        return cls(interval.judged(limit), interval.value, interval.n, half, limit.holds(interval.value))


NOTHING = Measured()


def compare_sources(series: Sequence[Series]) -> list[Comparison]:
    """Compare each pair of sources in everything that both tell.

    Args:
        series: With at least one position, positions first; stamps as they are.
    """
    usable = [s for s in series if len(s) >= LEAST_ROWS and not s.is_exact]
    if len(usable) < 2 or not any(s.kind is Kind.POSITION for s in usable):
        return []
    by_length = []
    for step_s in STEPS_S:
        edges_s = step_edges(usable, step_s)
        if len(edges_s) > MIN_STEPS + 1:
            motions = [motion_in_steps(s, edges_s) for s in usable]
            by_length.append((step_s, with_reversing(motions)))
    found = []
    for j, i in combinations(range(len(usable)), 2):
        one, other = (Quantity(usable[k].source, usable[k].kind) for k in (i, j))
        for check, measure in _MEASURES.items():
            measured = [measure(motions[i], motions[j], step_s) for step_s, motions in by_length]
            judgement, number = joint_judgement(measured)
            if judgement is Judgement.UNKNOWN or (check in BIASES and judgement is Judgement.AGREE):
                continue
            found.append(Comparison(check, one, other, judgement, number))
            if judgement is Judgement.CONTRADICT and check in (Check.TURN, Check.SPEED_CHANGE):
                break  # what differs by a factor differs by a constant, too
    return found


def joint_judgement(measured: Sequence[Measured]) -> tuple[Judgement, float]:
    """What steps of all lengths say together, and the number that is known best.

    They contradict where steps of one length say so, those of every other length show a number that is impossible, too,
    and there are enough of them together. They agree where one length says so and none contradicts.
    """
    known = [each for each in measured if not math.isnan(each.number)]
    if not known:
        return Judgement.UNKNOWN, math.nan
    contrary = [each for each in known if each.judgement is Judgement.CONTRADICT]
    is_enough = sum(each.n for each in known) >= ENOUGH_STEPS
    if contrary and is_enough and not any(each.is_possible for each in known):
        return Judgement.CONTRADICT, min(contrary, key=lambda each: each.half).number
    agrees = any(each.judgement is Judgement.AGREE for each in known) and not contrary
    return Judgement.AGREE if agrees else Judgement.UNKNOWN, min(known, key=lambda each: each.half).number


def with_reversing(motions: Sequence[StepMotion]) -> list[StepMotion]:
    """The motions with the fixes' course and way turned round where the car drives backwards.

    It does where a speed is negative and a heading points against the course. One of both alone is a wrong sensor.

    Args:
        motions: Of the same steps.
    """
    speeds = [m.distance_m for m in motions if m.kind is Kind.SPEED]
    headings = [m.angle_rad for m in motions if m.kind is Kind.HEADING]
    if not speeds or not headings:
        return list(motions)
    found = []
    for m in motions:
        if m.kind not in FIXES:
            found.append(m)
            continue
        with np.errstate(invalid="ignore"):
            is_back = (speeds[0] < 0.0) & (np.cos(headings[0] - m.angle_rad) < 0.0)
        sign = np.where(is_back, -1.0, 1.0)
        angle = np.where(is_back, m.angle_rad + np.pi, m.angle_rad)
        found.append(replace(m, distance_m=sign * m.distance_m, speed_mps=sign * m.speed_mps, angle_rad=angle))
    return found


def _ratio(one: FloatArray, other: FloatArray, least: FloatArray | float, most: float, limit: Limit) -> Measured:
    """The median of one / other where the other lies clearly apart from zero."""
    with np.errstate(invalid="ignore"):
        rows = (np.abs(other) > least) & (np.abs(other) < most) & np.isfinite(one)
    return Measured.of(MedianInterval.of(one[rows] / other[rows]), limit)


def _ratio_both_ways(
    one: FloatArray, other: FloatArray, least: Sequence[FloatArray | float], most: float, limit: Limit
) -> Measured:
    """The ratio one / other, from where the other clearly moves and from where the one does.

    A sensor that does not react at all shows only where the other one is asked first.
    """
    forth = _ratio(one, other, least[1], most, limit)
    back = _ratio(other, one, least[0], most, Limit(1.0 / limit.high, 1.0 / limit.low, "", ""))
    if math.isnan(back.number) or forth.judgement is back.judgement:
        return forth
    if math.isnan(forth.number):
        return replace(back, number=Check.TURN.inverse(back.number))
    return replace(forth, judgement=Judgement.UNKNOWN, is_possible=forth.is_possible or back.is_possible)


def _way(one: StepMotion, other: StepMotion, step_s: float) -> Measured:
    pair = (one.kind, other.kind)
    if not set(pair) <= {*FIXES, Kind.SPEED} or pair == (Kind.POSITION, Kind.POSITION):
        return NOTHING
    limit = SPEED_SCALE
    if one.kind in FIXES and other.kind is Kind.SPEED:
        limit = Limit(1.0 / SPEED_SCALE.high, 1.0 / SPEED_SCALE.low, "", "")
    return _ratio(one.distance_m, other.distance_m, LEAST_CHORD_M, math.inf, limit)


def _turn(one: StepMotion, other: StepMotion, step_s: float) -> Measured:
    by_course = one.kind in FIXES or other.kind in FIXES
    least_rad = LEAST_COURSE_TURN_RAD if by_course else LEAST_TURN_RAD
    least = [np.fmax(least_rad, CLEAR_SIGMAS * m.turn_sigma_rad) for m in (one, other)]
    return _ratio_both_ways(one.turn_rad, other.turn_rad, least, MOST_TURN_RAD, TURN_RATIO)


def _yaw_rate_bias(one: StepMotion, other: StepMotion, step_s: float) -> Measured:
    if Kind.YAW_RATE not in (one.kind, other.kind):
        return NOTHING
    difference = one.turn_rad - other.turn_rad
    small = np.abs(other.turn_rad if one.kind is Kind.YAW_RATE else one.turn_rad) < LEAST_TURN_RAD
    return Measured.of(MedianInterval.of(difference[small & np.isfinite(difference)] / step_s), YAW_RATE_BIAS)


def _course(one: StepMotion, other: StepMotion, step_s: float) -> Measured:
    fixes = [m for m in (one, other) if m.kind in FIXES]
    if not (one.has_zero_angle and other.has_zero_angle and fixes):
        return NOTHING
    difference = one.angle_rad - other.angle_rad
    with np.errstate(invalid="ignore"):
        rows = np.isfinite(difference) & (np.abs(fixes[0].speed_mps) > LEAST_COURSE_SPEED_MPS)
    if not rows.any():
        return NOTHING
    middle = float(np.angle(np.exp(1j * difference[rows]).mean()))
    interval = MedianInterval.of((difference[rows] - middle + np.pi) % (2.0 * np.pi) - np.pi)
    # About the mean direction the median is small; the range moves with it.
    if math.isnan(interval.value):
        return NOTHING
    moved = middle - 2.0 * np.pi * round((middle + interval.value) / (2.0 * np.pi))
    return Measured.of(
        MedianInterval(moved + interval.value, moved + interval.low, moved + interval.high, interval.n), HEADING_OFFSET
    )


def _speed_changes(m: StepMotion) -> FloatArray:
    """The changes of speed, those of an accelerometer without its constant part."""
    change = m.speed_change_mps
    known = change[np.isfinite(change)]
    return change - median(known) if m.kind is Kind.ACCEL and len(known) else change


def _speed_change(one: StepMotion, other: StepMotion, step_s: float) -> Measured:
    if Kind.ACCEL not in (one.kind, other.kind):
        return NOTHING
    least = [max(LEAST_SPEED_CHANGE_MPS, CLEAR_SIGMAS * m.speed_change_sigma_mps) for m in (one, other)]
    return _ratio_both_ways(_speed_changes(one), _speed_changes(other), least, math.inf, SPEED_CHANGE_RATIO)


def _accel_bias(one: StepMotion, other: StepMotion, step_s: float) -> Measured:
    if (one.kind is Kind.ACCEL) == (other.kind is Kind.ACCEL):
        return NOTHING
    difference = one.speed_change_mps - other.speed_change_mps
    return Measured.of(MedianInterval.of(difference[np.isfinite(difference)] / step_s), ACCEL_BIAS)


_MEASURES: dict[Check, Callable[[StepMotion, StepMotion, float], Measured]] = {
    Check.WAY: _way,
    Check.TURN: _turn,
    Check.YAW_RATE_BIAS: _yaw_rate_bias,
    Check.COURSE: _course,
    Check.SPEED_CHANGE: _speed_change,
    Check.ACCEL_BIAS: _accel_bias,
}
