"""PICUD: the gap that is left when the vehicle ahead brakes to a stand and the host does so after its reaction."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import MetresAtStamps, Pair

BRAKING_MPS2 = 3.3
"""Deceleration of both, m/s^2, of Uno et al. 2002."""
REACTION_S = 1.0
"""Reaction time of the host, s, of Uno et al. 2002."""


def gap_after_urgent_braking(pair: Pair) -> MetresAtStamps:
    """Gap (m) to a vehicle straight ahead after both have stopped, at each stamp, (n,); negative: they touch before."""
    at = pair.other_in_host_axes
    own, theirs = np.maximum(at.host_speed_mps, 0.0), np.maximum(at.vx_mps + at.host_speed_mps, 0.0)
    left_m = at.headway_if_straight_ahead_m + (theirs**2 - own**2) / (2.0 * BRAKING_MPS2) - REACTION_S * own
    return pair.expand_to_all_rows(np.where(at.is_straight_ahead, left_m, np.nan))


MEASURE = Measure(
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
