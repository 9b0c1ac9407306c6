"""Conflict index: the energy that a crash would have released, by how narrowly it was missed."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair, PairNumber
from cwcli.measures.pet import encroachment_lag_and_states

VEHICLE_MASS_KG = 1500.0
"""The assumed mass of each vehicle, kg: messages carry none. Chosen: a passenger car's."""
ENERGY_WEIGHT, PET_DECAY_1PS = 1.0, 1.0
"""Share of the energy that counts, and how fast it fades with PET, 1/s. Chosen by hand; not fitted."""


def conflict_index_of_pair_kj(pair: Pair) -> PairNumber:
    """Conflict index of the pair, (), kJ."""
    pet_s, own, theirs = encroachment_lag_and_states(pair)
    if np.isnan(pet_s):
        return np.array(np.nan)
    change = theirs[0] * np.exp(1j * theirs[1]) - own[0] * np.exp(1j * own[1])
    energy_kj = 0.25e-3 * VEHICLE_MASS_KG * np.abs(change) ** 2  # of two equal masses that stay together
    return np.array(ENERGY_WEIGHT * energy_kj / np.exp(PET_DECAY_1PS * pet_s))


MEASURE = Measure(
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
