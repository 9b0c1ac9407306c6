"""RSS, proper response: the braking that the host owes where both of its safe distances are violated."""

from __future__ import annotations

import numpy as np

from cwcli.measures import safe_distance
from cwcli.measures.base import Measure
from cwcli.measures.pair import Mps2AtStamps, Pair
from cwcli.measures.rss_lat import MEASURE as RSS_LAT
from cwcli.measures.rss_long import MEASURE as RSS_LONG


def rss_required_host_braking_mps2(pair: Pair) -> Mps2AtStamps:
    """Braking (m/s^2) that RSS demands of the host at each stamp, (n,): 0 where one of both distances is safe."""
    at, near = pair.other_in_host_axes, pair.near_rows
    along, across = pair.evaluate_measure(RSS_LONG)[near], pair.evaluate_measure(RSS_LAT)[near]
    toward = at.cos_turn < 0.0
    braking = np.where(toward, safe_distance.MIN_BRAKING_IN_OWN_LANE_MPS2, safe_distance.MIN_BRAKING_MPS2)
    is_rear = at.x_m > 0.0
    dangerous = (along < 0.0) & (across < 0.0) & is_rear
    return pair.expand_to_all_rows(np.where(np.isnan(along), np.nan, np.where(dangerous, braking, 0.0)))


MEASURE = Measure(
    summary="braking that RSS asks of the host",
    symbol="b_RSS",
    column="rss_response_mps2",
    critical="high",
    formula=(
        "b_min where d_long and d_lat are both below their safe values and the other is ahead (3 m/s^2 towards each "
        "other in the own lane), else 0"
    ),
    source="Shalev-Shwartz et al. 2017, definitions 3 and 5; values of ad-rss-lib",
    compute=rss_required_host_braking_mps2,
    is_symmetric=False,
    undefined="as for rss_long",
    misleads="at a cut-in: RSS then asks for braking across, which the host can't see as its own duty",
    is_pointwise=True,
    is_stepped=True,
)
