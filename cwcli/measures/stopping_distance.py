"""Stopping distances, and what is left of the gap after stopping."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.collision_time import TTC
from cwcli.measures.limits import CAR_BRAKING_LIMIT_MPS2
from cwcli.measures.pair import MetresAtStamps, Pair, RatiosAtStamps


def host_minimum_stopping_distance_m(pair: Pair) -> MetresAtStamps:
    """Distance (m) in which the host can stop, at each stamp, (n,)."""
    speed = pair.other_in_host_axes.host_speed_mps
    return pair.expand_near_rows_to_all_rows(speed**2 / (2.0 * CAR_BRAKING_LIMIT_MPS2))


MSD = Measure(
    summary="distance in which the host can stop",
    symbol="MSD",
    column="msd_m",
    critical="high",
    formula="v_e^2 / (2 a), a = 11.5 m/s^2",
    source="Allen, Shin and Cooper 1978",
    compute=host_minimum_stopping_distance_m,
    is_symmetric=False,
    is_of_host=True,
    undefined="the centres are more than 200 m apart",
    misleads="it assumes no reaction time and a dry road",
    is_pointwise=True,
)


def way_to_contact_per_stopping_distance(pair: Pair) -> RatiosAtStamps:
    """Way to contact over stopping distance at each stamp, (n,); NaN off a collision course or at standstill."""
    way_m = pair.evaluate_measure(TTC)[pair.near_rows] * np.abs(pair.other_in_host_axes.host_speed_mps)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = way_m / pair.evaluate_measure(MSD)[pair.near_rows]
    return pair.expand_near_rows_to_all_rows(np.where(np.isfinite(share), share, np.nan))


CONTACT_PSD = Measure(
    summary="way to contact over the distance in which the host can stop",
    symbol="PSD_c",
    column="contact_psd",
    critical="low",
    formula="|v_e| TTC / MSD",
    source="the proportion of stopping distance of Allen, Shin and Cooper 1978, to the contact alone",
    compute=way_to_contact_per_stopping_distance,
    is_symmetric=False,
    threshold=1.0,
    threshold_source="below 1 the host can't stop before the contact",
    undefined="the two are not on a collision course, or the host stands",
    misleads="when the other moves away from the spot",
    is_pointwise=True,
)


PICUD_BRAKING_MPS2 = 3.3
"""Deceleration of both, m/s^2, of Uno et al. 2002."""
PICUD_REACTION_TIME_S = 1.0
"""Reaction time of the host, s, of Uno et al. 2002."""


def gap_after_urgent_braking(pair: Pair) -> MetresAtStamps:
    """Gap (m) to a vehicle straight ahead after both have stopped, at each stamp, (n,); negative: they touch before."""
    at = pair.other_in_host_axes
    own, theirs = np.maximum(at.host_speed_mps, 0.0), np.maximum(at.vx_mps + at.host_speed_mps, 0.0)
    left_m = (
        at.headway_if_straight_ahead_m + (theirs**2 - own**2) / (2.0 * PICUD_BRAKING_MPS2) - PICUD_REACTION_TIME_S * own
    )
    return pair.expand_near_rows_to_all_rows(np.where(at.is_straight_ahead, left_m, np.nan))


PICUD = Measure(
    summary="gap that is left when a vehicle ahead and then the host brake to a stand",
    symbol="PICUD",
    column="picud_m",
    critical="low",
    formula="HW + (v_o^2 - v_e^2) / (2 a) - v_e t_r, with a = 3.3 m/s^2, t_r = 1 s",
    source="Uno et al. 2002, as given by the repository regenesis90/SSM_feasibility",
    compute=gap_after_urgent_braking,
    is_symmetric=False,
    threshold=0.0,
    threshold_source="Uno et al. 2002",
    undefined="nothing is ahead of the host within the width of the two outlines",
    misleads="in dense traffic, where most drivers keep less; for an oncoming vehicle, which counts as standing",
    is_pointwise=True,
)
