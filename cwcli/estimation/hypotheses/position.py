"""Hypotheses on positions in the map, which should be east and north of the first fix in metres."""

from __future__ import annotations

from cwcli.estimation.hypotheses.base import Hypothesis


def _axes_hypothesis(
    name: str, fault: str, action: str, east: tuple[float, float], north: tuple[float, float]
) -> Hypothesis:
    return Hypothesis(name, "axes", fault, action, (east, north), (0.0, 0.0))


POSITION = (
    _axes_hypothesis("north-east", "has north before east", "axes exchanged", (0.0, 1.0), (1.0, 0.0)),
    _axes_hypothesis(
        "west-north", "has its longitude or east with the wrong sign", "mirrored", (-1.0, 0.0), (0.0, 1.0)
    ),
    _axes_hypothesis(
        "east-south", "has its latitude or north with the wrong sign", "mirrored", (1.0, 0.0), (0.0, -1.0)
    ),
)
"""Hypotheses on the axes of `Kind.POSITION`: exchanged or mirrored."""
