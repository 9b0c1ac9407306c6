"""Distances of the two: of the centres, of the outlines, and to a vehicle straight ahead, in metres and seconds."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.outlines import signed_outline_distance_m
from cwcli.measures.pair import MetresAtStamps, Pair, SecondsAtStamps


def centre_distance(pair: Pair) -> MetresAtStamps:
    """Distance (m) of the centres at each stamp, (n,)."""
    return pair.distance_m


DISTANCE = Measure(
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


def gap_of_outlines(pair: Pair) -> MetresAtStamps:
    """Distance (m) of the outlines at each stamp, (n,); NaN beyond 200 m of centre distance."""
    at = pair.relative_motion
    found = signed_outline_distance_m(
        at.dx_m, at.dy_m, at.host_heading_rad, at.other_heading_rad, pair.host_size, pair.other_size
    )
    return pair.expand_near_rows_to_all_rows(found)


GAP = Measure(
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


def headway_to_vehicle_ahead(pair: Pair) -> MetresAtStamps:
    """Gap (m) to the other where it is straight ahead, at each stamp, (n,); else NaN."""
    return pair.expand_near_rows_to_all_rows(pair.other_in_host_axes.headway_if_straight_ahead_m)


HEADWAY = Measure(
    summary="gap to a vehicle ahead in the host's way",
    symbol="HW",
    column="headway_m",
    critical="low",
    formula="x_o - (extents of both along the host's heading) / 2, where |y_o| is less than that across",
    source="ISO 15623; Jansson 2005",
    compute=headway_to_vehicle_ahead,
    is_symmetric=False,
    undefined="nothing is ahead of the host within the width of the two outlines",
    misleads="in curves: what is straight ahead is not in the lane",
    is_pointwise=True,
)


def time_headway(pair: Pair) -> SecondsAtStamps:
    """Time headway (s) to the other where it is straight ahead, at each stamp, (n,); else NaN."""
    at = pair.other_in_host_axes
    with np.errstate(divide="ignore", invalid="ignore"):
        return pair.expand_near_rows_to_all_rows(
            np.where(at.host_speed_mps > 0.0, at.headway_if_straight_ahead_m / at.host_speed_mps, np.nan)
        )


THW = Measure(
    summary="time until the host is where a vehicle ahead is now",
    symbol="THW",
    column="thw_s",
    critical="low",
    formula="HW / v_e",
    source="ISO 15623; Jansson 2005",
    compute=time_headway,
    is_symmetric=False,
    threshold=0.9,
    threshold_source="half the two seconds of driving schools (Vogel 2003: 0.9 s is often fined)",
    undefined="nothing is ahead of the host within the width of the two outlines, or the host stands",
    misleads="in dense traffic, where many drive at 0.8 s for hours; it does not depend on the closing speed",
    is_pointwise=True,
)
