"""How severe a crash at the present velocities would be, and what else is near a crash."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.collision_time import MTTC, TTC
from cwcli.measures.encroachment import encroachment_lag_and_states
from cwcli.measures.pair import Pair, PairNumber
from cwcli.signals.columns import FloatArray

OTHER_VEHICLE_SHARE_OF_TOTAL_MASS = 0.5
"""The other's share of the mass of both: messages carry no masses, so they are taken as equal."""


def host_velocity_change_in_crash_mps(pair: Pair) -> FloatArray:
    """Change of the host's velocity (m/s) in a crash, computed at each stamp, (n,); NaN off a collision course."""
    at = pair.relative_motion
    change = OTHER_VEHICLE_SHARE_OF_TOTAL_MASS * np.hypot(at.dvx_mps, at.dvy_mps)
    return pair.expand_near_rows_to_all_rows(
        np.where(np.isfinite(pair.evaluate_measure(TTC)[pair.near_rows]), change, np.nan)
    )


DELTA_V = Measure(
    summary="change of velocity in a plastic crash at the present velocities",
    symbol="Delta v",
    column="delta_v_mps",
    critical="high",
    formula="m_o / (m_e + m_o) |v_o - v_e|, with equal masses",
    source="Shelby 2011; conservation of momentum",
    compute=host_velocity_change_in_crash_mps,
    undefined="the two are not on a collision course",
    misleads="with a lorry: messages carry no masses, so they are taken as equal",
    is_pointwise=True,
)


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
    return pair.expand_near_rows_to_all_rows(np.where(at.is_straight_ahead & np.isfinite(until_s), index, np.nan))


CRASH_INDEX = Measure(
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


VEHICLE_MASS_KG = 1500.0
"""The assumed mass of each vehicle, kg: messages carry none. Chosen: a passenger car's."""
SHARE_OF_COUNTED_ENERGY, ENERGY_DECAY_PER_PET_1PS = 1.0, 1.0
"""Share of the energy that counts, and how fast it fades with PET, 1/s. Chosen by hand; not fitted."""


def conflict_index_of_pair_kj(pair: Pair) -> PairNumber:
    """Conflict index of the pair, (), kJ."""
    pet_s, own, theirs = encroachment_lag_and_states(pair)
    if np.isnan(pet_s):
        return np.array(np.nan)
    change = theirs[0] * np.exp(1j * theirs[1]) - own[0] * np.exp(1j * own[1])
    energy_kj = 0.25e-3 * VEHICLE_MASS_KG * np.abs(change) ** 2  # of two equal masses that stay together
    return np.array(SHARE_OF_COUNTED_ENERGY * energy_kj / np.exp(ENERGY_DECAY_PER_PET_1PS * pet_s))


CI = Measure(
    summary="energy of the missed crash, by how narrowly it was missed",
    symbol="CI",
    column="ci_kj",
    critical="high",
    formula=(
        "alpha dK / exp(beta PET), dK = m / 4 |v_o - v_e|^2 at the two moments of PET, m = 1500 kg, alpha = 1, beta = "
        "1 / s"
    ),
    source="Alhajyaseen 2015",
    compute=conflict_index_of_pair_kj,
    is_series=False,
    undefined="as for PET",
    misleads="when following a vehicle, as for PET; messages carry no masses, so 1500 kg are assumed",
)
