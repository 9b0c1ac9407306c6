"""Deceleration to safety time: the braking that keeps a safety time behind the vehicle straight ahead."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import Mps2AtStamps, Pair

SAFETY_TIME_S = 2.0
"""The safety time behind a vehicle ahead, s: the two seconds of driving schools."""


def deceleration_to_safety_time(pair: Pair) -> Mps2AtStamps:
    """Deceleration (m/s^2) that keeps the safety time, at each stamp, (n,); infinity where it is lost already."""
    at = pair.other_in_host_axes
    left_m = at.headway_if_straight_ahead_m - np.maximum(at.vx_mps + at.host_speed_mps, 0.0) * SAFETY_TIME_S
    closes = at.is_straight_ahead & (at.vx_mps < 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(left_m > 0.0, 1.5 * at.vx_mps**2 / left_m, np.inf)
    return pair.expand_to_all_rows(np.where(closes, needed, np.nan))


MEASURE = Measure(
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
