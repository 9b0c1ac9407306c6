"""Distance of the centres; song2016 calls a distance below 2.5 m a collision."""

from __future__ import annotations

from cwcli.measures.base import Measure
from cwcli.measures.pair import MetresAtStamps, Pair


def centre_distance(pair: Pair) -> MetresAtStamps:
    """Distance (m) of the centres at each stamp, (n,)."""
    return pair.distance_m


MEASURE = Measure(
    summary="distance of the centres",
    symbol="d_c",
    column="distance_m",
    critical="low",
    formula="|p_o - p_e|",
    source="song2016, section 4",
    compute=centre_distance,
    threshold=2.5,
    threshold_source="song2016, section 4",
    misleads="for long vehicles: their outlines touch while the centres are far apart",
    is_pointwise=True,
    with_warnings=True,
    clause=lambda threshold: f"the two were closer than {threshold:g} m, centre to centre",
)
