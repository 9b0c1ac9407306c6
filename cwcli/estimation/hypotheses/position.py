"""Hypotheses on positions in the map, which should be east and north of the first fix in metres."""

from __future__ import annotations

from cwcli.estimation.hypotheses.base import Hypothesis


def _axes_hypothesis(
    name: str, fault: str, action: str, east: tuple[float, float], north: tuple[float, float]
) -> Hypothesis:
    return Hypothesis(name, "axes", fault, action, (east, north), (0.0, 0.0))


MIRRORED_MAP_FAULT_ENDING = "with the wrong sign, unless all that measures turns has it"
"""End of the fault of a mirrored map: relative motion does not tell it from mirrored headings and turn rates."""
POSITION_AXES_HYPOTHESES = (
    _axes_hypothesis("north-east", "has north before east", "axes exchanged", (0.0, 1.0), (1.0, 0.0)),
    _axes_hypothesis(
        "west-north", f"has its longitude or east {MIRRORED_MAP_FAULT_ENDING}", "mirrored", (-1.0, 0.0), (0.0, 1.0)
    ),
    _axes_hypothesis(
        "east-south", f"has its latitude or north {MIRRORED_MAP_FAULT_ENDING}", "mirrored", (1.0, 0.0), (0.0, -1.0)
    ),
)
"""Hypotheses on the axes of `Kind.POSITION`: exchanged or mirrored."""
