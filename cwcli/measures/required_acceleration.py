"""Accelerations that just avoid contact, and their shares of what the car can do."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.collision_time import TTC
from cwcli.measures.limits import CAR_BRAKING_LIMIT_MPS2, CAR_LATERAL_LIMIT_MPS2
from cwcli.measures.pair import Mps2AtStamps, Pair, RatiosAtStamps


def required_longitudinal_acceleration(pair: Pair) -> Mps2AtStamps:
    """Required longitudinal acceleration (m/s^2) at each stamp, (n,), at most 0; -inf in contact while closing."""
    at = pair.other_in_host_axes
    closing = np.minimum(at.vx_mps, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(closing < 0.0, closing**2 / (2.0 * at.headway_if_straight_ahead_m), 0.0)
    needed = np.minimum(at.other_accel_mps2[0] - relative, 0.0)
    return pair.expand_near_rows_to_all_rows(np.where(at.is_straight_ahead, needed, np.nan))


A_LONG_REQ = Measure(
    summary="longitudinal acceleration that just avoids a vehicle ahead",
    symbol="a_long,req",
    column="a_long_req_mps2",
    critical="low",
    formula="min(a_o - v_r^2 / (2 HW), 0), v_r = min(v_o - v_e, 0)",
    source="Jansson 2005, section 5.3.5; Asljung et al. 2017, eq. 8",
    compute=required_longitudinal_acceleration,
    is_symmetric=False,
    undefined="nothing is ahead of the host within the width of the two outlines",
    misleads=(
        "in curves: what is straight ahead is not in the lane; for a vehicle ahead that brakes to a stop before the "
        "gap is used up"
    ),
    is_pointwise=True,
)


def required_lateral_acceleration(pair: Pair) -> Mps2AtStamps:
    """Required lateral acceleration (m/s^2) at each stamp, (n,); infinity where the outlines touch."""
    at, near = pair.other_in_host_axes, pair.near_rows
    ttc = pair.evaluate_measure(TTC)[near]
    ahead = at.x_m > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = [
            np.abs(at.other_accel_mps2[1] - 2.0 * (side * at.reach_y_m - at.y_m - at.vy_mps * ttc) / ttc**2)
            for side in (-1.0, 1.0)
        ]
    needed = np.where(ttc > 0.0, np.minimum(*sides), np.inf)
    return pair.expand_near_rows_to_all_rows(np.where(ahead & np.isfinite(ttc), needed, np.nan))


A_LAT_REQ = Measure(
    summary="lateral acceleration that just steers past the other",
    symbol="a_lat,req",
    column="a_lat_req_mps2",
    critical="high",
    formula="min over left and right of |a_o,y - 2 (+-w - y_o - v_r,y TTC) / TTC^2|, w half of both extents across",
    source="Jansson 2005, section 5.3.8",
    compute=required_lateral_acceleration,
    is_symmetric=False,
    undefined="the other is not ahead, or the two are not on a collision course",
    misleads="where there is no room beside the lane",
    is_pointwise=True,
)


def required_acceleration(pair: Pair) -> Mps2AtStamps:
    """Required acceleration (m/s^2) at each stamp, (n,)."""
    return np.hypot(pair.evaluate_measure(A_LONG_REQ), pair.evaluate_measure(A_LAT_REQ))


A_REQ = Measure(
    summary="longitudinal and lateral required accelerations together",
    symbol="a_req",
    column="a_req_mps2",
    critical="high",
    formula="sqrt(a_long,req^2 + a_lat,req^2)",
    source="Jansson 2005, section 5.3",
    compute=required_acceleration,
    is_symmetric=False,
    undefined="one of the two is undefined",
    misleads="the car needs one of the two, not both",
    is_pointwise=True,
)


def brake_threat_number(pair: Pair) -> RatiosAtStamps:
    """Brake threat number at each stamp, (n,): 1 needs all the braking that the car can do."""
    return -pair.evaluate_measure(A_LONG_REQ) / CAR_BRAKING_LIMIT_MPS2


BTN = Measure(
    summary="share of the braking that the car can do",
    symbol="BTN",
    column="btn",
    critical="high",
    formula="a_long,req / a_min, a_min = -11.5 m/s^2",
    source="Jansson 2005; Asljung et al. 2017, eq. 9",
    compute=brake_threat_number,
    is_symmetric=False,
    threshold=1.0,
    threshold_source="beyond 1 braking alone no longer helps",
    undefined="nothing is ahead of the host within the width of the two outlines",
    misleads="on wet roads, where the car can do less",
    is_pointwise=True,
)


def steer_threat_number(pair: Pair) -> RatiosAtStamps:
    """Steer threat number at each stamp, (n,): 1 needs all the lateral acceleration that the car can do."""
    return pair.evaluate_measure(A_LAT_REQ) / CAR_LATERAL_LIMIT_MPS2


STN = Measure(
    summary="share of the steering that the car can do",
    symbol="STN",
    column="stn",
    critical="high",
    formula="a_lat,req / a_lat,max, a_lat,max = 8 m/s^2",
    source="Jansson 2005; Brannstrom et al. 2008",
    compute=steer_threat_number,
    is_symmetric=False,
    threshold=1.0,
    threshold_source="beyond 1 steering alone no longer helps",
    undefined="as for a_lat,req",
    misleads="as for a_lat,req",
    is_pointwise=True,
)
