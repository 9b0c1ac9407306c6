"""The fuzzy safety of a gap to a vehicle ahead (Mattas et al. 2020), which UN R157 names; arrays of one shape."""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray

RESPONSE_TIME_S = 0.75
"""Response time of the following driver, s (Mattas et al. 2020)."""
COMFORTABLE_BRAKING_MPS2, HARDEST_BRAKING_MPS2 = 4.0, 6.0
"""Comfortable and hardest braking of the following driver, m/s^2 (Mattas et al. 2020)."""
BRAKING_AHEAD_MPS2 = 7.0
"""Braking of the vehicle ahead, m/s^2 (Mattas et al. 2020)."""
SAFETY_MARGIN_M = 2.0
"""Safety margin between the vehicles, m (Mattas et al. 2020)."""


def proactive_unsafety_of_gap(gap_m: FloatArray, speed_mps: FloatArray, ahead_mps: FloatArray) -> FloatArray:
    """PFS: if the vehicle ahead brakes, 1 where the hardest braking is not enough, 0 where the comfortable one is."""
    ways = [
        speed_mps * RESPONSE_TIME_S + speed_mps**2 / (2.0 * braking) - ahead_mps**2 / (2.0 * BRAKING_AHEAD_MPS2)
        for braking in (COMFORTABLE_BRAKING_MPS2, HARDEST_BRAKING_MPS2)
    ]
    return _unsafe_share_of_gap(gap_m - SAFETY_MARGIN_M, ways[0] + SAFETY_MARGIN_M, ways[1])


def critical_unsafety_of_gap(
    gap_m: FloatArray, speed_mps: FloatArray, ahead_mps: FloatArray, accel_mps2: FloatArray
) -> FloatArray:
    """CFS: as PFS for a vehicle ahead that keeps its speed; the follower keeps its acceleration until it responds."""
    accel = np.maximum(accel_mps2, -COMFORTABLE_BRAKING_MPS2)
    closing = speed_mps - ahead_mps
    after = closing + accel * RESPONSE_TIME_S
    way = (closing + 0.5 * accel * RESPONSE_TIME_S) * RESPONSE_TIME_S
    fuzzy = _unsafe_share_of_gap(
        gap_m, *(way + after**2 / (2.0 * braking) for braking in (COMFORTABLE_BRAKING_MPS2, HARDEST_BRAKING_MPS2))
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        stops_by_itself = np.where(gap_m < closing**2 / np.abs(2.0 * accel_mps2), 1.0, 0.0)
    found = np.where(closing <= 0.0, 0.0, np.where(after < 0.0, stops_by_itself, fuzzy))
    return np.where(np.isnan(gap_m), np.nan, found)


def _unsafe_share_of_gap(gap_m: FloatArray, safe_m: FloatArray, unsafe_m: FloatArray) -> FloatArray:
    """0 for gaps above the safe one, 1 below the unsafe one, linear between."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (gap_m - safe_m) / (unsafe_m - safe_m)
    return np.where(gap_m > safe_m, 0.0, np.where(gap_m < unsafe_m, 1.0, share))
