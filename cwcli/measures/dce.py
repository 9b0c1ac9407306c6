"""Distance of the closest encounter: how near the outlines will come if both keep velocity and heading."""

from __future__ import annotations

from cwcli.measures.base import Measure
from cwcli.measures.encounter import time_and_distance_of_closest_encounter
from cwcli.measures.pair import MetresAtStamps, Pair


def distance_of_closest_encounter(pair: Pair) -> MetresAtStamps:
    """Distance (m) of the outlines at their closest encounter, computed at each stamp, (n,)."""
    _, distance_m = time_and_distance_of_closest_encounter(pair)
    return pair.expand_to_all_rows(distance_m)


MEASURE = Measure(
    summary="distance of the outlines at the closest encounter",
    symbol="DCE",
    column="dce_m",
    critical="low",
    formula="least distance of the rectangles for t >= 0, moved by v_e t and v_o t; 0 on a collision course",
    source="Eggert 2014",
    compute=distance_of_closest_encounter,
    undefined="the centres are more than 200 m apart",
    misleads="far ahead in time: a small DCE in 20 s means little; read it with TTCE",
    is_pointwise=True,
)
