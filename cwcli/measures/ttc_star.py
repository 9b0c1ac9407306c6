"""TTC*: time to collision along predicted paths, at constant speeds and yaw rates."""

from __future__ import annotations

from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair, SecondsAtStamps
from cwcli.measures.predicted import first_overlap_time_s


def time_to_predicted_collision(pair: Pair) -> SecondsAtStamps:
    """Time to collision (s) along paths of constant speed and yaw rate, at each stamp, (n,); NaN if there is none."""
    return pair.expand_to_all_rows(first_overlap_time_s(pair))


MEASURE = Measure(
    summary="time to collision along paths of constant speed and yaw rate",
    symbol="TTC*",
    column="ttc_star_s",
    critical="low",
    formula="least t in [0, 5 s] at which the rectangles overlap along their arcs, in steps of 0.1 s, linear between",
    source="CommonRoad-CriMe (Lin and Althoff 2023), on paths of constant speed and yaw rate",
    compute=time_to_predicted_collision,
    threshold=1.0,
    threshold_source="as for TTC",
    undefined="the paths do not meet within 5 s",
    misleads="at the end of a curve, where the yaw rate changes",
    is_pointwise=True,
)
