"""Modified deceleration rate to avoid a crash: the driver's reaction time counts."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.drac import closing_speed
from cwcli.measures.pair import Pair
from cwcli.measures.ttc import MEASURE as TTC
from cwcli.signals.columns import FloatArray

REACTION_S = 1.0
"""The driver's reaction time, s (SUMO device.ssm)."""


def modified_deceleration(pair: Pair) -> FloatArray:
    """Deceleration (m/s^2) that avoids a crash after the reaction at each stamp, (n,); infinity if it is too late."""
    ttc = pair.value(TTC)[pair.near]
    closing = closing_speed(pair)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(ttc > REACTION_S, closing / (2.0 * (ttc - REACTION_S)), np.inf)
    return pair.spread(np.where(np.isfinite(ttc) & (closing > 0.0), needed, np.nan))


MEASURE = Measure(
    summary="deceleration needed to avoid contact after 1 s of reaction",
    symbol="MDRAC",
    column="mdrac_mps2",
    critical="high",
    formula="v_c / (2 (TTC - t_r)), t_r = 1 s; infinity where TTC <= t_r",
    source="Fu and Sayed 2021; SUMO device.ssm",
    of=modified_deceleration,
    threshold=3.4,
    threshold_source="SUMO device.ssm",
    undefined="the two are not on a collision course, or do not close",
    misleads="for a driver who brakes already: the reaction time is counted again",
    is_pointwise=True,
)
