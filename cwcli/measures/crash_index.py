"""Ozbay's crash index: the difference of the kinetic energies at the predicted crash, over the time until then."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.mttc import MEASURE as MTTC
from cwcli.measures.pair import Pair
from cwcli.signals.columns import FloatArray


def crash_index(pair: Pair) -> FloatArray:
    """Crash index (m^2/s^3) with a vehicle straight ahead at each stamp, (n,); infinity in contact.

    Speeds are along the host's heading; one that drives the other way, or backwards by then, counts as standing.
    """
    at = pair.other_in_host_axes
    until_s = pair.evaluate_measure(MTTC)[pair.near_rows]
    theirs_mps = at.vx_mps + at.host_speed_mps
    own = np.maximum(at.host_speed_mps + at.host_accel_mps2 * until_s, 0.0)
    theirs = np.maximum(theirs_mps + at.other_accel_mps2[0] * until_s, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        index = np.where(until_s > 0.0, (own**2 - theirs**2) / (2.0 * until_s), np.inf)
    return pair.expand_to_all_rows(np.where(at.is_straight_ahead & np.isfinite(until_s), index, np.nan))


MEASURE = Measure(
    summary="energy that a crash with a vehicle ahead sets free, over the time until then",
    symbol="CrI",
    column="crash_index",
    critical="high",
    formula="((v_e + a_e t)^2 - (v_o + a_o t)^2) / (2 t) in m^2/s^3 per unit of mass, t = MTTC; infinity in contact",
    source="Ozbay et al. 2008, as given by the repository regenesis90/SSM_feasibility (CI_MTTC)",
    compute=crash_index,
    is_symmetric=False,
    undefined="nothing is ahead of the host within the width of the two outlines, or the MTTC has no value",
    misleads="for another that drives towards the host: it counts as standing",
    is_pointwise=True,
)
