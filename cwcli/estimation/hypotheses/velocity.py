"""Hypotheses on a velocity over ground, which should be east and north in m/s."""

from __future__ import annotations

from cwcli.estimation.hypotheses.base import Hypothesis
from cwcli.estimation.hypotheses.speed import SPEED_UNIT_AND_SIGN_HYPOTHESES
from cwcli.lazy_dataclass import replace

ZERO_VELOCITY_OFFSET = (0.0, 0.0)
"""Offset of a hypothesis without one: zero east and north."""


def _axes_hypothesis(name: str, fault: str, east: tuple[float, float], north: tuple[float, float]) -> Hypothesis:
    return Hypothesis(name, "axes", fault, "axes exchanged", (east, north), ZERO_VELOCITY_OFFSET)


VELOCITY_UNIT_AND_AXES_HYPOTHESES = (
    *(
        replace(each, matrix=((each.matrix[0][0], 0.0), (0.0, each.matrix[0][0])), offset=ZERO_VELOCITY_OFFSET)
        for each in SPEED_UNIT_AND_SIGN_HYPOTHESES
        if each.group == "unit"
    ),
    _axes_hypothesis("north-east", "has north before east", (0.0, 1.0), (1.0, 0.0)),
    _axes_hypothesis("west-north", "has west in place of east", (-1.0, 0.0), (0.0, 1.0)),
    _axes_hypothesis("east-south", "has south in place of north", (1.0, 0.0), (0.0, -1.0)),
    _axes_hypothesis("west-south", "points backward", (-1.0, 0.0), (0.0, -1.0)),
)
"""Hypotheses on the unit and the axes of a source of `Kind.VELOCITY`."""
