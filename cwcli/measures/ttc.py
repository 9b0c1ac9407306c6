"""Time to collision: when the outlines would touch if both kept velocity and heading."""

from __future__ import annotations

from cwcli.measures.base import Measure
from cwcli.measures.outlines import time_to_contact
from cwcli.measures.pair import Pair
from cwcli.signals.columns import FloatArray


def time_to_collision(pair: Pair) -> FloatArray:
    """At each stamp, (n,); infinity where they never would, and beyond 100 m of centre distance."""
    at = pair.relative
    found = time_to_contact(
        at.dx_m,
        at.dy_m,
        at.dvx_mps,
        at.dvy_mps,
        at.host_heading_rad,
        at.other_heading_rad,
        pair.host_size,
        pair.other_size,
    )
    return pair.spread(found, float("inf"))


MEASURE = Measure(
    summary="time to collision of the outlines at constant velocities",
    symbol="TTC",
    column="ttc_s",
    critical="low",
    formula="least t >= 0 at which the rectangles overlap, moved by v_e t and v_o t",
    source="Hayward 1972; ISO 15623",
    of=time_to_collision,
    note="of the outlines at constant velocities; inf: never on a collision course",
    threshold=1.0,
    clause=lambda threshold: f"the two were {threshold:g} s from contact",
)
