"""RSS, longitudinal: the gap along the host's heading less the safe gap."""

from __future__ import annotations

import numpy as np

from cwcli.measures import safe_distance
from cwcli.measures.base import Measure
from cwcli.measures.pair import MetresAtStamps, Pair


def rss_longitudinal_margin(pair: Pair) -> MetresAtStamps:
    """Longitudinal gap (m) beyond the safe one of RSS at each stamp, (n,), for whoever drives behind or for both."""
    at = pair.other_in_host_axes
    gap = np.maximum(np.abs(at.x_m) - at.reach_x_m, 0.0)
    own, theirs = at.host_speed_mps, at.vx_mps + at.host_speed_mps
    safe = np.where(
        at.cos_turn < 0.0,
        safe_distance.safe_gap_opposite_direction_m(own, -theirs),
        np.where(
            at.x_m > 0.0,
            safe_distance.safe_gap_same_direction_m(own, theirs, safe_distance.HOST_RESPONSE_TIME_S),
            safe_distance.safe_gap_same_direction_m(theirs, own, safe_distance.OTHER_RESPONSE_TIME_S),
        ),
    )
    leaves = (at.cos_turn < 0.0) & (at.x_m < 0.0)
    along = np.abs(at.cos_turn) > MIN_HEADING_COSINE
    return pair.expand_to_all_rows(np.where(along & ~leaves, gap - safe, np.nan))


MIN_HEADING_COSINE = 0.7
"""Smallest cosine of the angle between the headings, about 45 degrees. Chosen by hand; not fitted."""


MEASURE = Measure(
    summary="gap along the way beyond the safe one of RSS",
    symbol="d_long - d_RSS",
    column="rss_long_m",
    critical="low",
    formula=(
        "d - max(v_r t + a t^2 / 2 + (v_r + a t)^2 / (2 b_min) - v_f^2 / (2 b_max), 0) in one direction, d - the sum "
        "of both ways to stop towards each other; t 1 s (other: 2 s), a 3.5, b_min 4 (3 in its own lane), b_max 8 "
        "m/s^2"
    ),
    source="Shalev-Shwartz et al. 2017, definitions 1 and 2; values of ad-rss-lib",
    compute=rss_longitudinal_margin,
    is_symmetric=False,
    undefined="the headings are more than 45 degrees off one line, or the two drive away from each other",
    misleads="alone: beside each other it is negative; RSS asks for both of its distances at once",
    is_pointwise=True,
)
