"""Deceleration rate to avoid a crash: the braking that the closing vehicle needs within the gap."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.gap import MEASURE as GAP
from cwcli.measures.pair import Mps2AtStamps, Pair
from cwcli.measures.ttc import MEASURE as TTC
from cwcli.signals.columns import FloatArray


def deceleration_to_avoid_crash(pair: Pair) -> Mps2AtStamps:
    """Deceleration (m/s^2) that avoids a crash at each stamp, (n,); NaN off a collision course, infinity in contact."""
    near = pair.near_rows
    gap, ttc, closing = (
        pair.evaluate_measure(GAP)[near],
        pair.evaluate_measure(TTC)[near],
        closing_speed_of_centres_mps(pair),
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = closing**2 / (2.0 * gap)
    brakes = (closing > 0.0) & np.isfinite(ttc)  # only a pair on the way to contact needs to brake at all
    return pair.expand_to_all_rows(np.where(brakes, np.where(gap > 0.0, needed, np.inf), np.nan))


def closing_speed_of_centres_mps(pair: Pair) -> FloatArray:
    """Closing speed of the centres (m/s) in the rows `near`, (m,); NaN for centres at the same place."""
    at = pair.relative_motion
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-(at.dx_m * at.dvx_mps + at.dy_m * at.dvy_mps) / pair.distance_m[pair.near_rows])


MEASURE = Measure(
    summary="deceleration needed to avoid contact",
    symbol="DRAC",
    column="drac_mps2",
    critical="high",
    formula="v_c^2 / (2 d) with v_c the closing speed of the centres; infinity in contact",
    source="Cooper and Ferguson 1976",
    compute=deceleration_to_avoid_crash,
    threshold=3.35,
    threshold_source="Archer 2005",
    undefined="the two are not on a collision course, or do not close",
    misleads="when the other brakes or accelerates; at a crossing, where braking is not the only way out",
    is_pointwise=True,
    with_warnings=True,
    clause=lambda threshold: f"a braking of {threshold:g} m/s² was needed to avoid contact",
)
