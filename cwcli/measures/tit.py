"""Time-integrated time to collision."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair
from cwcli.measures.tet import EXPOSURE_TTC_S
from cwcli.measures.ttc import MEASURE as TTC
from cwcli.signals.columns import FloatArray


def time_integrated_ttc(pair: Pair) -> FloatArray:
    """Integral of the pair over time of how far the time to collision is below 2 s, s^2, ()."""
    if not np.isfinite(pair.distance_m).any():
        return np.array(np.nan)
    below = EXPOSURE_TTC_S - pair.evaluate_measure(TTC)
    return np.array((pair.stamp_weights_s * np.where(below > 0.0, below, 0.0)).sum())


MEASURE = Measure(
    summary="how far TTC was below 2 s, times how long",
    symbol="TIT",
    column="tit_s2",
    critical="high",
    formula="sum of (2 s - TTC) dt where TTC <= 2 s",
    source="Minderhoud and Bovy 2001",
    compute=time_integrated_ttc,
    is_series=False,
    undefined="both positions were never known at the same time",
    misleads="as for TET",
)
