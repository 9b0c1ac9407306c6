"""Crash potential index: mean probability that the needed braking exceeded what the car could do."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair, PairNumber
from cwcli.measures.required_acceleration import A_LONG_REQ
from cwcli.signals.columns import FloatArray
from cwcli.signals.normal_distribution import normal_cdf

AVAILABLE_BRAKING_MEAN_MPS2, AVAILABLE_BRAKING_SIGMA_MPS2 = 8.45, 1.40
"""The available braking is normal with this mean and sigma, m/s^2 (Cunto and Saccomanno 2007)."""
MIN_AVAILABLE_BRAKING_MPS2, MAX_AVAILABLE_BRAKING_MPS2 = 4.23, 12.68
"""The normal distribution of the available braking is truncated to these limits, m/s^2 (same source)."""


def crash_potential_index_of_pair(pair: Pair) -> PairNumber:
    """Crash potential index of the pair, (), over moments with both positions; without a vehicle ahead it counts 0."""
    known = ~np.isnan(pair.distance_m)
    if not known.any():
        return np.array(np.nan)
    needed = np.nan_to_num(-pair.evaluate_measure(A_LONG_REQ)[known], nan=0.0, posinf=MAX_AVAILABLE_BRAKING_MPS2)
    weights = pair.stamp_weights_s[known] if pair.stamp_weights_s.any() else None
    return np.array(np.average(braking_shortfall_probability(needed), weights=weights))


def braking_shortfall_probability(needed_mps2: FloatArray) -> FloatArray:
    """Probability that the maximum available deceleration, a truncated normal, is below what is needed, (n,)."""
    bounds = np.array([MIN_AVAILABLE_BRAKING_MPS2, MAX_AVAILABLE_BRAKING_MPS2])
    low, high = normal_cdf((bounds - AVAILABLE_BRAKING_MEAN_MPS2) / AVAILABLE_BRAKING_SIGMA_MPS2)
    at = normal_cdf(
        (np.clip(needed_mps2, MIN_AVAILABLE_BRAKING_MPS2, MAX_AVAILABLE_BRAKING_MPS2) - AVAILABLE_BRAKING_MEAN_MPS2)
        / AVAILABLE_BRAKING_SIGMA_MPS2
    )
    return np.asarray((at - low) / (high - low))


MEASURE = Measure(
    summary="mean probability that the needed braking was more than the car could do",
    symbol="CPI",
    column="cpi",
    critical="high",
    formula="mean over time of P(MADR <= -a_long,req), MADR normal 8.45, 1.40 m/s^2 within 4.23 to 12.68",
    source="Cunto and Saccomanno 2007",
    compute=crash_potential_index_of_pair,
    is_series=False,
    is_symmetric=False,
    undefined="both positions were never known at the same time",
    misleads="for a long drive: one bad second hardly shows in the mean",
)
