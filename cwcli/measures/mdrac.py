"""Modified deceleration rate to avoid a crash: the driver's reaction time counts."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.drac import closing_speed_of_centres_mps
from cwcli.measures.pair import Mps2AtStamps, Pair
from cwcli.measures.ttc import MEASURE as TTC

REACTION_TIME_S = 1.0
"""The driver's reaction time, s (SUMO device.ssm)."""


def modified_deceleration_to_avoid_crash(pair: Pair) -> Mps2AtStamps:
    """Deceleration (m/s^2) that avoids a crash after the reaction at each stamp, (n,); infinity if it is too late."""
    ttc = pair.evaluate_measure(TTC)[pair.near_rows]
    closing = closing_speed_of_centres_mps(pair)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(ttc > REACTION_TIME_S, closing / (2.0 * (ttc - REACTION_TIME_S)), np.inf)
    return pair.expand_to_all_rows(np.where(np.isfinite(ttc) & (closing > 0.0), needed, np.nan))


MEASURE = Measure(
    summary="deceleration needed to avoid contact after 1 s of reaction",
    symbol="MDRAC",
    column="mdrac_mps2",
    critical="high",
    formula="v_c / (2 (TTC - t_r)), t_r = 1 s; infinity where TTC <= t_r",
    source="Fu and Sayed 2021; SUMO device.ssm",
    compute=modified_deceleration_to_avoid_crash,
    threshold=3.4,
    threshold_source="SUMO device.ssm",
    undefined="the two are not on a collision course, or do not close",
    misleads="for a driver who brakes already: the reaction time is counted again",
    is_pointwise=True,
)
