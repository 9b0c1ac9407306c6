"""Time to the closest encounter: when the outlines will be nearest if both keep velocity and heading."""

from __future__ import annotations

from cwcli.measures.base import Measure
from cwcli.measures.encounter import time_and_distance_of_closest_encounter
from cwcli.measures.pair import Pair, SecondsAtStamps


def time_to_closest_encounter(pair: Pair) -> SecondsAtStamps:
    """Time to the closest encounter (s) at each stamp, (n,)."""
    time_s, _ = time_and_distance_of_closest_encounter(pair)
    return pair.expand_to_all_rows(time_s)


MEASURE = Measure(
    summary="time to the closest encounter at constant velocities",
    symbol="TTCE",
    column="ttce_s",
    critical="low",
    formula="first t >= 0 at which the distance of the rectangles, moved by v_e t and v_o t, is least",
    source="Eggert 2014",
    compute=time_to_closest_encounter,
    undefined="the centres are more than 200 m apart, or nothing moves relative to the other",
    misleads="alone: a short time does not mean a short distance; read it with DCE",
    is_pointwise=True,
)
