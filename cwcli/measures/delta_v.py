"""Delta v: how much the host's velocity would change in a crash at the present velocities."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.limits import OTHER_MASS_SHARE
from cwcli.measures.pair import Pair
from cwcli.measures.ttc import MEASURE as TTC
from cwcli.signals.columns import FloatArray


def host_velocity_change_in_crash_mps(pair: Pair) -> FloatArray:
    """Change of the host's velocity (m/s) in a crash, computed at each stamp, (n,); NaN off a collision course."""
    at = pair.relative_motion
    change = OTHER_MASS_SHARE * np.hypot(at.dvx_mps, at.dvy_mps)
    return pair.expand_to_all_rows(np.where(np.isfinite(pair.evaluate_measure(TTC)[pair.near_rows]), change, np.nan))


MEASURE = Measure(
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
