"""Potential time to collision: of a host at constant speed behind a vehicle that brakes at constant deceleration."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair, SecondsAtStamps


def potential_time_to_collision(pair: Pair) -> SecondsAtStamps:
    """Time to collision (s) with a vehicle straight ahead at its deceleration, at each stamp, (n,); NaN if it has none.

    The gap d and its rate d' close at d + d' t - b t^2 / 2 = 0 with the deceleration b of the vehicle ahead, so
    t = (d' + sqrt(d'^2 + 2 b d)) / b; the collection prints the first sign for a positive closing speed. Written as
    2 d / (sqrt(d'^2 + 2 b d) - d') it holds for b = 0, too, and for a vehicle that accelerates away too slowly.
    """
    at = pair.other_in_host_axes
    braking = -at.other_accel_mps2[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.sqrt(at.vx_mps**2 + 2.0 * braking * at.headway_if_straight_ahead_m) - at.vx_mps
        time_s = 2.0 * at.headway_if_straight_ahead_m / rate
    return pair.expand_to_all_rows(np.where(at.is_straight_ahead & (rate > 0.0), time_s, np.nan))


MEASURE = Measure(
    summary="time to collision with a vehicle ahead at its deceleration and the host's constant speed",
    symbol="PTTC",
    column="pttc_s",
    critical="low",
    formula="(d' + sqrt(d'^2 + 2 b HW)) / b, with d' = v_o - v_e and the deceleration b = -a_o",
    source="Wakabayashi et al. 2003, as given by Westhofen et al. 2023 (criticality-metrics.readthedocs.io, PTTC)",
    compute=potential_time_to_collision,
    is_symmetric=False,
    threshold=1.0,
    threshold_source="as for TTC",
    undefined="nothing is ahead of the host within the width of the two outlines, or the host never reaches it",
    misleads="for a braking car far ahead: the formula lets it drive backwards after it has stopped",
    is_pointwise=True,
)
