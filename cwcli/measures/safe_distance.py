"""The safe distances of Responsibility-Sensitive Safety, RSS (Shalev-Shwartz, Shammah and Shashua 2017).

A gap is safe if no contact follows when one vehicle accelerates for its response time and then brakes gently, whatever
the other does within its limits. The values are those of ad-rss-lib: IEEE 2846 names the assumptions and gives no
numbers.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray

HOST_RESPONSE_TIME_S = 1.0
"""Response time of the host, s (ad-rss-lib)."""
OTHER_RESPONSE_TIME_S = 2.0
"""Response time of the other, s (ad-rss-lib)."""
RESPONSE_ACCEL_MPS2 = 3.5
"""Largest acceleration during the response time (ad-rss-lib)."""
MIN_BRAKING_MPS2 = 4.0
"""Least braking after the response time (ad-rss-lib)."""
MIN_BRAKING_IN_OWN_LANE_MPS2 = 3.0
"""Least braking of a vehicle in its own lane against oncoming traffic (ad-rss-lib)."""
MAX_BRAKING_MPS2 = 8.0
"""Largest braking of a vehicle ahead (ad-rss-lib)."""
LATERAL_ACCEL_MPS2 = 0.2
"""Largest lateral acceleration towards the other during the response time (ad-rss-lib)."""
LATERAL_BRAKING_MPS2 = 0.8
"""Least lateral braking after the response time (ad-rss-lib)."""
LATERAL_FLUCTUATION_M = 0.1
"""Lateral fluctuation of a vehicle that keeps its lane, m (ad-rss-lib)."""


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
    rear = stopping_distance_m(np.maximum(rear_mps, 0.0), response_s, RESPONSE_ACCEL_MPS2, MIN_BRAKING_MPS2)
    return np.asarray(np.maximum(rear - np.maximum(front_mps, 0.0) ** 2 / (2.0 * MAX_BRAKING_MPS2), 0.0))


def safe_gap_opposite_direction_m(host_mps: FloatArray | float, other_mps: FloatArray | float) -> FloatArray:
    """Safe gap of vehicles that drive towards each other, the host in its own lane, metres; definition 2."""
    own = stopping_distance_m(
        np.maximum(host_mps, 0.0), HOST_RESPONSE_TIME_S, RESPONSE_ACCEL_MPS2, MIN_BRAKING_IN_OWN_LANE_MPS2
    )
    return own + stopping_distance_m(
        np.maximum(other_mps, 0.0), OTHER_RESPONSE_TIME_S, RESPONSE_ACCEL_MPS2, MIN_BRAKING_MPS2
    )


def safe_lateral_gap_m(
    left_mps: FloatArray | float,
    right_mps: FloatArray | float,
    left_response_s: float | FloatArray,
    right_response_s: float | FloatArray,
    fluctuation_m: float = LATERAL_FLUCTUATION_M,
) -> FloatArray:
    """Safe lateral gap of two vehicles, metres; lateral speeds are positive to the right; definition 6."""
    left = stopping_distance_m(left_mps, left_response_s, LATERAL_ACCEL_MPS2, LATERAL_BRAKING_MPS2)
    right = stopping_distance_m(right_mps, right_response_s, -LATERAL_ACCEL_MPS2, LATERAL_BRAKING_MPS2)
    return np.asarray(np.maximum(left - right, 0.0) + fluctuation_m)
