"""Proactive and critical fuzzy safety of the gap to a vehicle ahead (Mattas et al. 2020), which UN R157 names."""

from __future__ import annotations

import numpy as np

from cwcli.lazy_dataclass import replace
from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair, RatiosAtStamps
from cwcli.signals.columns import FloatArray

FOLLOWER_RESPONSE_TIME_S = 0.75
"""Response time of the following driver, s (Mattas et al. 2020)."""
COMFORTABLE_BRAKING_MPS2, HARDEST_BRAKING_MPS2 = 4.0, 6.0
"""Comfortable and hardest braking of the following driver, m/s^2 (Mattas et al. 2020)."""
LEAD_BRAKING_MPS2 = 7.0
"""Braking of the vehicle ahead, m/s^2 (Mattas et al. 2020)."""
SAFETY_MARGIN_M = 2.0
"""Safety margin between the vehicles, m (Mattas et al. 2020)."""


def proactive_unsafety_of_gap(gap_m: FloatArray, speed_mps: FloatArray, ahead_mps: FloatArray) -> FloatArray:
    """PFS: if the vehicle ahead brakes, 1 where the hardest braking is not enough, 0 where the comfortable one is."""
    ways = [
        speed_mps * FOLLOWER_RESPONSE_TIME_S + speed_mps**2 / (2.0 * braking) - ahead_mps**2 / (2.0 * LEAD_BRAKING_MPS2)
        for braking in (COMFORTABLE_BRAKING_MPS2, HARDEST_BRAKING_MPS2)
    ]
    return _unsafe_share_of_gap(gap_m - SAFETY_MARGIN_M, ways[0] + SAFETY_MARGIN_M, ways[1])


def critical_unsafety_of_gap(
    gap_m: FloatArray, speed_mps: FloatArray, ahead_mps: FloatArray, accel_mps2: FloatArray
) -> FloatArray:
    """CFS: as PFS for a vehicle ahead that keeps its speed; the follower keeps its acceleration until it responds."""
    accel = np.maximum(accel_mps2, -COMFORTABLE_BRAKING_MPS2)
    closing = speed_mps - ahead_mps
    after = closing + accel * FOLLOWER_RESPONSE_TIME_S
    way = (closing + 0.5 * accel * FOLLOWER_RESPONSE_TIME_S) * FOLLOWER_RESPONSE_TIME_S
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


def proactive_fuzzy_safety(pair: Pair) -> RatiosAtStamps:
    """Proactive fuzzy safety at each stamp, (n,), from 0 (safe) to 1 (unsafe): if the vehicle ahead brakes."""
    at = pair.other_in_host_axes
    ahead = at.vx_mps + at.host_speed_mps
    return pair.expand_near_rows_to_all_rows(
        proactive_unsafety_of_gap(at.headway_if_straight_ahead_m, at.host_speed_mps, ahead)
    )


def critical_fuzzy_safety(pair: Pair) -> RatiosAtStamps:
    """Critical fuzzy safety at each stamp, (n,), from 0 (safe) to 1 (unsafe): if the vehicle ahead keeps its speed."""
    at = pair.other_in_host_axes
    ahead = at.vx_mps + at.host_speed_mps
    return pair.expand_near_rows_to_all_rows(
        critical_unsafety_of_gap(at.headway_if_straight_ahead_m, at.host_speed_mps, ahead, at.host_accel_mps2)
    )


PFS = Measure(
    summary="how unsafe the gap would be if the vehicle ahead braked",
    symbol="PFS",
    column="pfs",
    critical="high",
    formula=(
        "1 below u t + u^2 / (2 b_max) - u_l^2 / (2 b_l), 0 above u t + u^2 / (2 b_min) - u_l^2 / (2 b_l) + 2 m, "
        "linear between, of HW - 2 m; t 0.75 s, b 4 to 6, b_l 7 m/s^2"
    ),
    source="Mattas et al. 2020; UN R157",
    compute=proactive_fuzzy_safety,
    is_symmetric=False,
    threshold=0.99,
    threshold_source="1 is unsafe by definition",
    undefined="nothing is ahead of the host within the width of the two outlines",
    misleads="in dense traffic, where everybody follows more closely",
    is_pointwise=True,
    clause=lambda threshold: (
        f"the gap would have been unsafe (PFS above {threshold:g}) if the vehicle ahead had braked"
    ),
)
CFS = replace(
    PFS,
    summary="how hard it is to avoid a vehicle ahead at its present speed",
    symbol="CFS",
    column="cfs",
    formula=(
        "1 below (u + a t / 2 - u_l) t + (u + a t - u_l)^2 / (2 b_max), 0 above the same with b_min, linear between, "
        "of HW; 0 when not closing; t 0.75 s, b 4 to 6 m/s^2, a at least -b_min"
    ),
    compute=critical_fuzzy_safety,
    misleads="for a vehicle ahead that brakes",
    clause=lambda threshold: f"a vehicle ahead could hardly be avoided at its present speed (CFS above {threshold:g})",
)
