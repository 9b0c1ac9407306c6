"""Time exposed to, and time-integrated, small times to collision."""

from __future__ import annotations

import numpy as np

from cwcli.lazy_dataclass import replace
from cwcli.measures.base import Measure
from cwcli.measures.collision_time import TTC
from cwcli.measures.pair import Pair, PairNumber

MAX_TTC_OF_EXPOSURE_S = 2.0
"""Greatest time to collision, s, that counts as exposure (TET and TIT). Chosen by hand; not fitted."""


def time_exposed_to_short_ttc_of_pair_s(pair: Pair) -> PairNumber:
    """Time (s) that the pair spends with a time to collision of at most 2 s, ()."""
    if not np.isfinite(pair.distance_m).any():
        return np.array(np.nan)
    return np.array(pair.stamp_weights_s[pair.evaluate_measure(TTC) <= MAX_TTC_OF_EXPOSURE_S].sum())


def total_time_integrated_ttc_of_pair_s2(pair: Pair) -> PairNumber:
    """Integral of the pair over time of how far the time to collision is below 2 s, s^2, ()."""
    if not np.isfinite(pair.distance_m).any():
        return np.array(np.nan)
    below = MAX_TTC_OF_EXPOSURE_S - pair.evaluate_measure(TTC)
    return np.array((pair.stamp_weights_s * np.where(below > 0.0, below, 0.0)).sum())


TET = Measure(
    summary="time with a TTC of at most 2 s",
    symbol="TET",
    column="tet_s",
    critical="high",
    formula="sum of dt where TTC <= 2 s",
    source="Minderhoud and Bovy 2001",
    compute=time_exposed_to_short_ttc_of_pair_s,
    is_series=False,
    undefined="both positions were never known at the same time",
    misleads="for a long drive: it adds up many moments of which none was dangerous",
)
TIT = replace(
    TET,
    summary="how far TTC was below 2 s, times how long",
    symbol="TIT",
    column="tit_s2",
    formula="sum of (2 s - TTC) dt where TTC <= 2 s",
    compute=total_time_integrated_ttc_of_pair_s2,
    misleads="as for TET",
)
