"""The safe distances of Responsibility-Sensitive Safety, RSS (Shalev-Shwartz, Shammah and Shashua 2017).

A gap is safe if no contact follows when one vehicle accelerates for its response time and then brakes gently, whatever
the other does within its limits. The values are those of ad-rss-lib: IEEE 2846 names the assumptions and gives no
numbers.
"""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import MetresAtStamps, Mps2AtStamps, Pair
from cwcli.signals.columns import FloatArray

HOST_RESPONSE_TIME_S = 1.0
"""Response time of the host, s (ad-rss-lib)."""
OTHER_RESPONSE_TIME_S = 2.0
"""Response time of the other, s (ad-rss-lib)."""
MAX_ACCEL_IN_RESPONSE_TIME_MPS2 = 3.5
"""Largest acceleration during the response time (ad-rss-lib)."""
MIN_BRAKING_AFTER_RESPONSE_MPS2 = 4.0
"""Least braking after the response time (ad-rss-lib)."""
MIN_BRAKING_IN_OWN_LANE_MPS2 = 3.0
"""Least braking of a vehicle in its own lane against oncoming traffic (ad-rss-lib)."""
MAX_LEAD_BRAKING_MPS2 = 8.0
"""Largest braking of a vehicle ahead (ad-rss-lib)."""
MAX_LATERAL_ACCEL_IN_RESPONSE_TIME_MPS2 = 0.2
"""Largest lateral acceleration towards the other during the response time (ad-rss-lib)."""
MIN_LATERAL_BRAKING_AFTER_RESPONSE_MPS2 = 0.8
"""Least lateral braking after the response time (ad-rss-lib)."""
RSS_LATERAL_FLUCTUATION_M = 0.1
"""Lateral fluctuation of a vehicle that keeps its lane, m (ad-rss-lib)."""
MIN_COSINE_BETWEEN_HEADINGS = 0.7
"""Smallest cosine of the angle between the headings, about 45 degrees. Chosen by hand; not fitted."""


def stopping_distance_m(
    speed_mps: FloatArray | float, response_s: float | FloatArray, accel_mps2: float, braking_mps2: float
) -> FloatArray:
    """Distance (m) to standstill: acceleration for `response_s`, then braking; signed as the acceleration.

    A negative speed points against the axis. A vehicle that still moves against the acceleration then need not brake.
    """
    speed = np.asarray(speed_mps, np.float64)
    after = speed + accel_mps2 * response_s
    way = speed * response_s + 0.5 * accel_mps2 * response_s**2
    brakes = np.sign(after) == np.sign(accel_mps2)
    return np.asarray(way + np.where(brakes, np.sign(accel_mps2) * after**2 / (2.0 * braking_mps2), 0.0))


def safe_gap_same_direction_m(
    rear_mps: FloatArray | float, front_mps: FloatArray | float, response_s: float
) -> FloatArray:
    """Safe gap behind a vehicle that drives in the same direction, metres; definition 1."""
    rear = stopping_distance_m(
        np.maximum(rear_mps, 0.0), response_s, MAX_ACCEL_IN_RESPONSE_TIME_MPS2, MIN_BRAKING_AFTER_RESPONSE_MPS2
    )
    return np.asarray(np.maximum(rear - np.maximum(front_mps, 0.0) ** 2 / (2.0 * MAX_LEAD_BRAKING_MPS2), 0.0))


def safe_gap_opposite_direction_m(host_mps: FloatArray | float, other_mps: FloatArray | float) -> FloatArray:
    """Safe gap of vehicles that drive towards each other, the host in its own lane, metres; definition 2."""
    own = stopping_distance_m(
        np.maximum(host_mps, 0.0), HOST_RESPONSE_TIME_S, MAX_ACCEL_IN_RESPONSE_TIME_MPS2, MIN_BRAKING_IN_OWN_LANE_MPS2
    )
    return own + stopping_distance_m(
        np.maximum(other_mps, 0.0),
        OTHER_RESPONSE_TIME_S,
        MAX_ACCEL_IN_RESPONSE_TIME_MPS2,
        MIN_BRAKING_AFTER_RESPONSE_MPS2,
    )


def safe_lateral_gap_m(
    left_mps: FloatArray | float,
    right_mps: FloatArray | float,
    left_response_s: float | FloatArray,
    right_response_s: float | FloatArray,
    fluctuation_m: float = RSS_LATERAL_FLUCTUATION_M,
) -> FloatArray:
    """Safe lateral gap of two vehicles, metres; lateral speeds are positive to the right; definition 6."""
    left = stopping_distance_m(
        left_mps, left_response_s, MAX_LATERAL_ACCEL_IN_RESPONSE_TIME_MPS2, MIN_LATERAL_BRAKING_AFTER_RESPONSE_MPS2
    )
    right = stopping_distance_m(
        right_mps, right_response_s, -MAX_LATERAL_ACCEL_IN_RESPONSE_TIME_MPS2, MIN_LATERAL_BRAKING_AFTER_RESPONSE_MPS2
    )
    return np.asarray(np.maximum(left - right, 0.0) + fluctuation_m)


def rss_longitudinal_margin(pair: Pair) -> MetresAtStamps:
    """Longitudinal gap (m) beyond the safe one of RSS at each stamp, (n,), for whoever drives behind or for both."""
    at = pair.other_in_host_axes
    gap = np.maximum(np.abs(at.x_m) - at.reach_x_m, 0.0)
    own, theirs = at.host_speed_mps, at.vx_mps + at.host_speed_mps
    safe = np.where(
        at.cos_turn < 0.0,
        safe_gap_opposite_direction_m(own, -theirs),
        np.where(
            at.x_m > 0.0,
            safe_gap_same_direction_m(own, theirs, HOST_RESPONSE_TIME_S),
            safe_gap_same_direction_m(theirs, own, OTHER_RESPONSE_TIME_S),
        ),
    )
    leaves = (at.cos_turn < 0.0) & (at.x_m < 0.0)
    along = np.abs(at.cos_turn) > MIN_COSINE_BETWEEN_HEADINGS
    return pair.expand_near_rows_to_all_rows(np.where(along & ~leaves, gap - safe, np.nan))


RSS_LONG = Measure(
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


def rss_lateral_margin(pair: Pair) -> MetresAtStamps:
    """Lateral gap (m) beyond the safe one of RSS at each stamp, (n,), across the host's heading."""
    at = pair.other_in_host_axes
    gap = np.maximum(np.abs(at.y_m) - at.reach_y_m, 0.0)
    toward = np.where(at.y_m > 0.0, -at.vy_mps, at.vy_mps)
    # The host moves along its heading, so that it has no speed across.
    safe = safe_lateral_gap_m(toward, 0.0, OTHER_RESPONSE_TIME_S, HOST_RESPONSE_TIME_S)
    return pair.expand_near_rows_to_all_rows(gap - safe)


RSS_LAT = Measure(
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


def rss_required_host_braking_mps2(pair: Pair) -> Mps2AtStamps:
    """Braking (m/s^2) that RSS demands of the host at each stamp, (n,): 0 where one of both distances is safe."""
    at, near = pair.other_in_host_axes, pair.near_rows
    along, across = pair.evaluate_measure(RSS_LONG)[near], pair.evaluate_measure(RSS_LAT)[near]
    toward = at.cos_turn < 0.0
    braking = np.where(toward, MIN_BRAKING_IN_OWN_LANE_MPS2, MIN_BRAKING_AFTER_RESPONSE_MPS2)
    is_rear = at.x_m > 0.0
    dangerous = (along < 0.0) & (across < 0.0) & is_rear
    return pair.expand_near_rows_to_all_rows(np.where(np.isnan(along), np.nan, np.where(dangerous, braking, 0.0)))


RSS_RESPONSE = Measure(
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
