"""Distance of the outlines, as rectangles under any heading; where they overlap, minus the penetration depth."""

from __future__ import annotations

from cwcli.measures.base import Measure
from cwcli.measures.outlines import signed_outline_distance_m
from cwcli.measures.pair import MetresAtStamps, Pair


def gap_of_outlines(pair: Pair) -> MetresAtStamps:
    """Distance (m) of the outlines at each stamp, (n,); NaN beyond 200 m of centre distance."""
    at = pair.relative_motion
    found = signed_outline_distance_m(
        at.dx_m, at.dy_m, at.host_heading_rad, at.other_heading_rad, pair.host_size, pair.other_size
    )
    return pair.expand_to_all_rows(found)


MEASURE = Measure(
    summary="distance of the outlines",
    symbol="d",
    column="gap_m",
    critical="low",
    formula="least distance of the two rectangles; where they overlap, minus the least shift that parts them",
    source="separating-axis theorem (Gottschalk et al. 1996)",
    compute=gap_of_outlines,
    note="of the outlines; negative: penetration depth",
    threshold=0.0,
    threshold_source="they touch",
    undefined="the centres are more than 200 m apart",
    misleads="on narrow roads, where two that pass each other safely are near",
    is_pointwise=True,
    with_warnings=True,
    clause=lambda threshold: f"the two were less than {threshold:g} m apart" if threshold else "the two touched",
)
