"""Decelerations that the host needs behind or towards the other."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.collision_time import TTC
from cwcli.measures.distances import GAP
from cwcli.measures.pair import Mps2AtStamps, Pair
from cwcli.signals.columns import FloatArray


def deceleration_to_avoid_crash(pair: Pair) -> Mps2AtStamps:
    """Deceleration (m/s^2) that avoids a crash at each stamp, (n,); NaN off a collision course, infinity in contact."""
    near = pair.near_rows
    gap, ttc, closing = (
        pair.evaluate_measure(GAP)[near],
        pair.evaluate_measure(TTC)[near],
        closing_speed_of_centres_mps(pair),
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = closing**2 / (2.0 * gap)
    brakes = (closing > 0.0) & np.isfinite(ttc)  # only a pair on the way to contact needs to brake at all
    return pair.expand_near_rows_to_all_rows(np.where(brakes, np.where(gap > 0.0, needed, np.inf), np.nan))


def closing_speed_of_centres_mps(pair: Pair) -> FloatArray:
    """Closing speed of the centres (m/s) in the rows `near`, (m,); NaN for centres at the same place."""
    at = pair.relative_motion
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-(at.dx_m * at.dvx_mps + at.dy_m * at.dvy_mps) / pair.distance_m[pair.near_rows])


DRAC = Measure(
    summary="deceleration needed to avoid contact",
    symbol="DRAC",
    column="drac_mps2",
    critical="high",
    formula="v_c^2 / (2 d) with v_c the closing speed of the centres; infinity in contact",
    source="Cooper and Ferguson 1976",
    compute=deceleration_to_avoid_crash,
    threshold=3.35,
    threshold_source="Archer 2005",
    undefined="the two are not on a collision course, or do not close",
    misleads="when the other brakes or accelerates; at a crossing, where braking is not the only way out",
    is_pointwise=True,
    with_warnings=True,
    clause=lambda threshold: f"a braking of {threshold:g} m/s² was needed to avoid contact",
)


MDRAC_REACTION_TIME_S = 1.0
"""The driver's reaction time, s (SUMO device.ssm)."""


def modified_deceleration_to_avoid_crash(pair: Pair) -> Mps2AtStamps:
    """Deceleration (m/s^2) that avoids a crash after the reaction at each stamp, (n,); infinity if it is too late."""
    ttc = pair.evaluate_measure(TTC)[pair.near_rows]
    closing = closing_speed_of_centres_mps(pair)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(ttc > MDRAC_REACTION_TIME_S, closing / (2.0 * (ttc - MDRAC_REACTION_TIME_S)), np.inf)
    return pair.expand_near_rows_to_all_rows(np.where(np.isfinite(ttc) & (closing > 0.0), needed, np.nan))


MDRAC = Measure(
    summary="deceleration needed to avoid contact after 1 s of reaction",
    symbol="MDRAC",
    column="mdrac_mps2",
    critical="high",
    formula="v_c / (2 (TTC - t_r)), t_r = 1 s; infinity where TTC <= t_r",
    source="Fu and Sayed 2021; SUMO device.ssm",
    compute=modified_deceleration_to_avoid_crash,
    threshold=3.4,
    threshold_source="SUMO device.ssm",
    undefined="the two are not on a collision course, or do not close",
    misleads="for a driver who brakes already: the reaction time is counted again",
    is_pointwise=True,
)


DST_SAFETY_TIME_S = 2.0
"""The safety time behind a vehicle ahead, s: the two seconds of driving schools."""


def deceleration_to_safety_time(pair: Pair) -> Mps2AtStamps:
    """Deceleration (m/s^2) that keeps the safety time, at each stamp, (n,); infinity where it is lost already."""
    at = pair.other_in_host_axes
    left_m = at.headway_if_straight_ahead_m - np.maximum(at.vx_mps + at.host_speed_mps, 0.0) * DST_SAFETY_TIME_S
    closes = at.is_straight_ahead & (at.vx_mps < 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(left_m > 0.0, 1.5 * at.vx_mps**2 / left_m, np.inf)
    return pair.expand_near_rows_to_all_rows(np.where(closes, needed, np.nan))


DST = Measure(
    summary="deceleration that keeps 2 s behind a vehicle ahead",
    symbol="DST",
    column="dst_mps2",
    critical="high",
    formula="3 (v_e - v_o)^2 / (2 (HW - v_o t_s)), t_s = 2 s; infinity where HW <= v_o t_s",
    source="Schubert, Schulze and Wanielik 2010, eq. 17",
    compute=deceleration_to_safety_time,
    is_symmetric=False,
    undefined="nothing is ahead of the host within the width of the two outlines, or the host does not close",
    misleads="in dense traffic, where nobody keeps 2 s",
    is_pointwise=True,
)
