"""The comparisons of two sources, and what a contradiction found by each is called."""

from __future__ import annotations

import math
from enum import StrEnum

from cwcli.estimation.measurements import Kind

SPEED_UNITS = {3.6: "km/h", 2.2369: "miles/h", 1.9438: "knots", 3.2808: "feet/s", 100.0: "cm/s"}
"""How many of a unit are 1 m/s."""
UNIT_TOLERANCE = 0.04
"""Part by which a ratio may differ from that of a unit, so that the unit is guessed: worn tyres and noise."""


LEAST_RATIO = 0.05
"""A ratio below this is told as none."""


class Check(StrEnum):
    """What is compared of two sources.

    Attributes:
        WAY: The ratio of the ways in a step.
        TURN: The ratio of the changes of heading.
        YAW_RATE_BIAS: The difference of the yaw rates where the car hardly turns, rad/s.
        COURSE: The difference of heading or course, rad.
        SPEED_CHANGE: The ratio of the changes of speed.
        ACCEL_BIAS: The difference of the accelerations, m/s^2.
    """

    WAY = "way"
    TURN = "turn"
    YAW_RATE_BIAS = "yaw rate bias"
    COURSE = "course"
    SPEED_CHANGE = "speed change"
    ACCEL_BIAS = "accel bias"

    def inverse(self, number: float) -> float:
        """The number as it is with the two sources exchanged."""
        if self in (Check.WAY, Check.TURN, Check.SPEED_CHANGE):
            return math.copysign(math.inf, number) if number == 0.0 else 1.0 / number
        return -number

    def words(self, who: Kind, against: Kind, number: float) -> str:
        """What shows that one source contradicts another.

        Args:
            who, against: What the one that is blamed measures, and what the other one does.
            number: Of the first against the second.
        """
        if self is Check.WAY:
            return _way_words(who, against, number)
        if self is Check.TURN:
            return _turn_words(number)
        if self is Check.YAW_RATE_BIAS:
            return f"its yaw rate is {number:+.2f} rad/s off"
        if self is Check.COURSE:
            side = "left" if number > 0.0 else "right"
            return f"it points {abs(math.degrees(number)):.0f} degrees to the {side} of it"
        if self is Check.SPEED_CHANGE:
            axis = "its forward axis shows" if who is Kind.ACCEL else "it shows"
            return f"{axis} {number:.2f} times the change of speed"
        return f"its forward acceleration is {number:+.2f} m/s^2 off"


def _turn_words(number: float) -> str:
    if abs(number) < LEAST_RATIO or not math.isfinite(number):
        return f"it {'turns' if number else 'does not turn'} where the other one does{' not' * bool(number)}"
    if -1.6 < number < -0.6:
        return "it turns the other way"
    return f"it turns {number:.2f} times as far"


def _way_words(who: Kind, against: Kind, number: float) -> str:
    if number < 0.0:
        return f"it reads {number:.2f} times the way: its sign is wrong"
    if against is Kind.POSITION:
        told = f"the car covered {number:.2f} times the distance between the fixes"
    elif who is Kind.POSITION:
        told = f"the fixes lie {number:.2f} times as far apart as the car went"
    else:
        told = f"its way is {number:.2f} times as long"
    unit = next((name for factor, name in SPEED_UNITS.items() if abs(number / factor - 1.0) < UNIT_TOLERANCE), "")
    return f"{told}, as if {unit} were taken for m/s" if unit and who is not Kind.POSITION else told
