"""Kinds of comparisons of two sources, and the text on a contradiction that each finds."""

from __future__ import annotations

import math
from enum import StrEnum

from cwcli.estimation.measurements import Kind

SPEED_UNITS = {3.6: "km/h", 2.2369: "miles/h", 1.9438: "knots", 3.2808: "feet/s", 100.0: "cm/s"}
"""Size of 1 m/s in other units of speed -> name of the unit (NIST SP 811)."""
UNIT_TOLERANCE = 0.04
"""Relative difference up to which a ratio suggests a unit. Chosen for worn tyres and noise; not fitted."""


LEAST_RATIO = 0.05
"""Least ratio that a text states; a smaller one is reported as no motion. Chosen by hand; not fitted."""


class Check(StrEnum):
    """Comparison of two sources.

    Attributes:
        WAY: The ratio of the distances in a step.
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
        """Return the number with the two sources exchanged."""
        if self in (Check.WAY, Check.TURN, Check.SPEED_CHANGE):
            return math.copysign(math.inf, number) if number == 0.0 else 1.0 / number
        return -number

    def words(self, who: Kind, against: Kind, number: float) -> str:
        """Return a text on how one source contradicts another.

        Args:
            who, against: Measured quantity of the blamed source and of the other one.
            number: Ratio or difference of the first relative to the second.
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
