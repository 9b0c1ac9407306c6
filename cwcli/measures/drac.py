"""Deceleration rate to avoid a crash: what the closing one would have to brake by, against the gap."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.gap import MEASURE as GAP
from cwcli.measures.pair import Pair
from cwcli.measures.ttc import MEASURE as TTC
from cwcli.signals.columns import FloatArray


def deceleration(pair: Pair) -> FloatArray:
    """At each stamp, (n,); 0 for a pair that is not on the way to contact, infinity where the outlines touch."""
    at, near = pair.relative, pair.near
    gap, ttc = pair.value(GAP)[near], pair.value(TTC)[near]
    with np.errstate(divide="ignore", invalid="ignore"):
        closing = -(at.dx_m * at.dvx_mps + at.dy_m * at.dvy_mps) / pair.distance_m[near]
        needed = closing**2 / (2.0 * gap)
    brakes = (closing > 0.0) & np.isfinite(ttc)  # only a pair on the way to contact needs to brake at all
    return pair.spread(np.where(brakes, np.where(gap > 0.0, needed, np.inf), 0.0), 0.0)


MEASURE = Measure(
    summary="deceleration needed to avoid contact",
    symbol="DRAC",
    column="drac_mps2",
    critical="high",
    formula="v_c^2 / (2 d) with v_c the closing speed of the centres; 0 off a collision course, inf in contact",
    source="Cooper and Ferguson 1976",
    of=deceleration,
    threshold=3.35,
    clause=lambda threshold: f"a braking of {threshold:g} m/s² was needed to avoid contact",
)
