"""Hypotheses on a heading, which should be counter-clockwise from east, in radians."""

from __future__ import annotations

import math

from cwcli.estimation.hypotheses.base import Hypothesis

QUARTER_TURN_RAD = math.pi / 2.0
"""A quarter of a turn, rad."""


def _unit_hypothesis(name: str, fault: str, rad_per_unit: float) -> Hypothesis:
    return Hypothesis.of_scalar(name, "unit", fault, "converted", factor=rad_per_unit)


def _angle_convention_hypothesis(name: str, fault: str, sign: float, quarter_turns: int) -> Hypothesis:
    return Hypothesis.of_scalar(
        name, "convention", fault, "turned", factor=sign, offset=quarter_turns * QUARTER_TURN_RAD
    )


HEADING_UNIT_AND_CONVENTION_HYPOTHESES = (
    _unit_hypothesis("degrees", "is in degrees, not radians", math.pi / 180.0),
    _unit_hypothesis("milliradians", "is in milliradians, not radians", 1e-3),
    _unit_hypothesis("gradians", "is in gradians, not radians", math.pi / 200.0),
    _unit_hypothesis(
        "radians-read-as-degrees", "is in radians, but was converted as if it were in degrees", 180.0 / math.pi
    ),
    _angle_convention_hypothesis(
        "clockwise-from-north", "counts clockwise from north, not counter-clockwise from east", -1.0, 1
    ),
    _angle_convention_hypothesis("clockwise-from-east", "counts clockwise from east, not counter-clockwise", -1.0, 0),
    _angle_convention_hypothesis(
        "clockwise-from-south", "counts clockwise from south, not counter-clockwise from east", -1.0, -1
    ),
    _angle_convention_hypothesis(
        "clockwise-from-west", "counts clockwise from west, not counter-clockwise from east", -1.0, 2
    ),
    _angle_convention_hypothesis("from-north", "counts from north, not from east", 1.0, 1),
    _angle_convention_hypothesis("from-south", "counts from south or points to the left, not from east", 1.0, -1),
    _angle_convention_hypothesis("backward", "points backward", 1.0, 2),
)
"""Units and conventions of `Kind.HEADING`."""
