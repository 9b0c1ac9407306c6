"""Kinds of comparisons of two sources, and the text on a contradiction that each finds."""

from __future__ import annotations

import math
from enum import StrEnum

from cwcli.estimation.measurements import Kind

UNIT_NAME_BY_SIZE_OF_1_MPS = {3.6: "km/h", 2.2369: "miles/h", 1.9438: "knots", 3.2808: "feet/s", 100.0: "cm/s"}
"""Size of 1 m/s in other units of speed -> name of the unit (NIST SP 811)."""
UNIT_RATIO_TOLERANCE = 0.04
"""Relative difference up to which a ratio suggests a unit. Chosen for worn tyres and noise; not fitted."""


MIN_STATED_TURN_RATIO = 0.05
"""Least ratio of the turn of one source to that of another that a text states; below it the text says that only one of
them turns. Chosen by hand; not fitted."""


class SourceComparisonCheck(StrEnum):
    """Comparison of two sources.

    Attributes:
        WAY: The ratio of the distances in a step.
        TURN: The ratio of the changes of heading.
        YAW_RATE_BIAS: The difference of the yaw rates where the car hardly turns, rad/s.
        COURSE: The difference of heading or course, rad.
        SPEED_CHANGE: The ratio of the changes of speed.
        ACCEL_BIAS: The difference of the accelerations, m/s^2.
        SLOW_ACCEL: The time after which an acceleration that lasts is no more seen, s.
    """

    WAY = "way"
    TURN = "turn"
    YAW_RATE_BIAS = "yaw rate bias"
    COURSE = "course"
    SPEED_CHANGE = "speed change"
    ACCEL_BIAS = "accel bias"
    SLOW_ACCEL = "slow accel"

    def ratio_or_difference_with_sources_exchanged(self, ratio_or_difference: float) -> float:
        """Return the number with the two sources exchanged."""
        if self in (SourceComparisonCheck.WAY, SourceComparisonCheck.TURN, SourceComparisonCheck.SPEED_CHANGE):
            return (
                math.copysign(math.inf, ratio_or_difference)
                if ratio_or_difference == 0.0
                else 1.0 / ratio_or_difference
            )
        return ratio_or_difference if self is SourceComparisonCheck.SLOW_ACCEL else -ratio_or_difference

    def contradiction_text(self, blamed_kind: Kind, other_kind: Kind, ratio_or_difference: float) -> str:
        """Return a text on how one source contradicts another."""
        if self is SourceComparisonCheck.WAY:
            return _distance_contradiction_text(blamed_kind, other_kind, ratio_or_difference)
        if self is SourceComparisonCheck.TURN:
            return _turn_contradiction_text(ratio_or_difference)
        if self is SourceComparisonCheck.YAW_RATE_BIAS:
            return f"its yaw rate is {ratio_or_difference:+.2f} rad/s off"
        if self is SourceComparisonCheck.COURSE:
            side = "left" if ratio_or_difference > 0.0 else "right"
            return f"it points {abs(math.degrees(ratio_or_difference)):.0f} degrees to the {side} of it"
        if self is SourceComparisonCheck.SPEED_CHANGE:
            axis = "its forward axis shows" if blamed_kind is Kind.ACCEL else "it shows"
            return f"{axis} {ratio_or_difference:.2f} times the change of speed"
        return _forward_acceleration_contradiction_text(
            blamed_kind, ratio_or_difference, is_slow=self is SourceComparisonCheck.SLOW_ACCEL
        )


def _forward_acceleration_contradiction_text(blamed_kind: Kind, difference_or_time_s: float, *, is_slow: bool) -> str:
    if not is_slow:
        return f"its forward acceleration is {difference_or_time_s:+.2f} m/s^2 off"
    name = "it" if blamed_kind is Kind.ACCEL else "the other one"
    return f"{name} loses accelerations in {difference_or_time_s:.0f} s, as if its slow part were filtered out"


def _turn_contradiction_text(turn_ratio: float) -> str:
    if abs(turn_ratio) < MIN_STATED_TURN_RATIO or not math.isfinite(turn_ratio):
        return f"it {'turns' if turn_ratio else 'does not turn'} where the other one does{' not' * bool(turn_ratio)}"
    if -1.6 < turn_ratio < -0.6:
        return "it turns the other way"
    return f"it turns {turn_ratio:.2f} times as far"


def _distance_contradiction_text(blamed_kind: Kind, other_kind: Kind, distance_ratio: float) -> str:
    if distance_ratio < 0.0:
        return f"it reads {distance_ratio:.2f} times the way: its sign is wrong"
    if other_kind is Kind.POSITION:
        ratio_text = f"the car covered {distance_ratio:.2f} times the distance between the fixes"
    elif blamed_kind is Kind.POSITION:
        ratio_text = f"the fixes lie {distance_ratio:.2f} times as far apart as the car went"
    else:
        ratio_text = f"its way is {distance_ratio:.2f} times as long"
    unit = next(
        (
            name
            for factor, name in UNIT_NAME_BY_SIZE_OF_1_MPS.items()
            if abs(distance_ratio / factor - 1.0) < UNIT_RATIO_TOLERANCE
        ),
        "",
    )
    return f"{ratio_text}, as if {unit} were taken for m/s" if unit and blamed_kind is not Kind.POSITION else ratio_text
