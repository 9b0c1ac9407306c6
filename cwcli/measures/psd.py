"""Proportion of stopping distance: the distance to contact over the distance needed to stop."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.msd import MEASURE as MSD
from cwcli.measures.pair import Pair, RatiosAtStamps
from cwcli.measures.ttc import MEASURE as TTC


def proportion_of_stopping_distance(pair: Pair) -> RatiosAtStamps:
    """Proportion of stopping distance at each stamp, (n,); NaN off a collision course or at standstill."""
    way_m = pair.evaluate_measure(TTC)[pair.near_rows] * np.abs(pair.other_in_host_axes.host_speed_mps)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = way_m / pair.evaluate_measure(MSD)[pair.near_rows]
    return pair.expand_to_all_rows(np.where(np.isfinite(share), share, np.nan))


MEASURE = Measure(
    summary="way to contact over the distance in which the host can stop",
    symbol="PSD",
    column="psd",
    critical="low",
    formula="|v_e| TTC / MSD",
    source="Allen, Shin and Cooper 1978",
    compute=proportion_of_stopping_distance,
    is_symmetric=False,
    threshold=1.0,
    threshold_source="below 1 the host can't stop before the contact",
    undefined="the two are not on a collision course, or the host stands",
    misleads="when the other moves away from the spot",
    is_pointwise=True,
)
