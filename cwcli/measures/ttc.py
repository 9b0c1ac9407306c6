"""Time to collision: when the outlines would touch if both kept velocity and heading."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.contact import EdgeProjections, straight_contact_time_s
from cwcli.measures.pair import Pair, SecondsAtStamps


def time_to_collision(pair: Pair) -> SecondsAtStamps:
    """Time to collision (s) at each stamp, (n,); NaN off a collision course, and beyond 200 m of centre distance."""
    found = straight_contact_time_s(EdgeProjections.from_pair(pair))
    return pair.expand_to_all_rows(np.where(found < np.inf, found, np.nan))


MEASURE = Measure(
    summary="time to collision of the outlines at constant velocities",
    symbol="TTC",
    column="ttc_s",
    critical="low",
    formula="least t >= 0 at which the rectangles overlap, moved by v_e t and v_o t",
    source="Hayward 1972; ISO 15623",
    compute=time_to_collision,
    note="of the outlines at constant velocities",
    threshold=1.0,
    threshold_source="cwcli; 1.5 s is usual for urban conflicts (van der Horst 1990)",
    undefined="the two are not on a collision course",
    misleads="in curves, where two on their own lanes are on a collision course for a moment; when either brakes",
    is_pointwise=True,
    with_warnings=True,
    clause=lambda threshold: f"the two were {threshold:g} s from contact",
)
