"""RSS, lateral: the gap across the host's heading less the safe gap."""

from __future__ import annotations

import numpy as np

from cwcli.measures import safe_distance
from cwcli.measures.base import Measure
from cwcli.measures.pair import MetresAtStamps, Pair


def rss_lateral_margin(pair: Pair) -> MetresAtStamps:
    """Lateral gap (m) beyond the safe one of RSS at each stamp, (n,), across the host's heading."""
    at = pair.other_in_host_axes
    gap = np.maximum(np.abs(at.y_m) - at.reach_y_m, 0.0)
    toward = np.where(at.y_m > 0.0, -at.vy_mps, at.vy_mps)
    # The host moves along its heading, so that it has no speed across.
    safe = safe_distance.safe_lateral_gap_m(
        toward, 0.0, safe_distance.OTHER_RESPONSE_TIME_S, safe_distance.HOST_RESPONSE_TIME_S
    )
    return pair.expand_to_all_rows(gap - safe)


MEASURE = Measure(
    summary="gap across the way beyond the safe one of RSS",
    symbol="d_lat - d_RSS",
    column="rss_lat_m",
    critical="low",
    formula=(
        "d - mu - max(v_1 t + a t^2 / 2 + (v_1 + a t)^2 / (2 b) - (v_2 t - a t^2 / 2 - (v_2 - a t)^2 / (2 b)), 0), a "
        "0.2, b 0.8 m/s^2, mu 0.1 m"
    ),
    source="Shalev-Shwartz et al. 2017, definition 6; values of ad-rss-lib",
    compute=rss_lateral_margin,
    is_symmetric=False,
    undefined="the centres are more than 200 m apart",
    misleads="alone: behind each other it is negative; RSS asks for both of its distances at once",
    is_pointwise=True,
)
