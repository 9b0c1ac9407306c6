"""Headway: the gap to the vehicle straight ahead."""

from __future__ import annotations

from cwcli.measures.base import Measure
from cwcli.measures.pair import MetresAtStamps, Pair


def headway_to_vehicle_ahead(pair: Pair) -> MetresAtStamps:
    """Gap (m) to the other where it is straight ahead, at each stamp, (n,); else NaN."""
    return pair.expand_to_all_rows(pair.other_in_host_axes.headway_if_straight_ahead_m)


MEASURE = Measure(
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
