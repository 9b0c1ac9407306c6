"""Longitudinal and lateral jerk of the host."""

from __future__ import annotations

import numpy as np

from cwcli.lazy_dataclass import replace
from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair
from cwcli.signals.columns import FloatArray


def host_longitudinal_jerk_size_mps3(pair: Pair) -> FloatArray:
    """Size of the host's longitudinal jerk (m/s^3) at each stamp, (n,)."""
    return pair.expand_near_rows_to_all_rows(np.abs(pair.host_accel_yaw_rate_jerk[pair.near_rows, 2]))


def host_lateral_jerk_size_mps3(pair: Pair) -> FloatArray:
    """Size of the host's lateral jerk (m/s^3) at each stamp, (n,): that of v w with a constant yaw rate w."""
    accel, yaw_rate, _ = pair.host_accel_yaw_rate_jerk[pair.near_rows].T
    return pair.expand_near_rows_to_all_rows(np.abs(accel * yaw_rate))


LONG_JERK = Measure(
    summary="size of the host's longitudinal jerk",
    symbol="|j_x|",
    column="long_jerk_mps3",
    critical="high",
    formula="|d a_e / d t|",
    source="CommonRoad-CriMe, LongJ",
    compute=host_longitudinal_jerk_size_mps3,
    is_symmetric=False,
    is_of_host=True,
    undefined="the centres are more than 200 m apart",
    misleads="where the states are smoothed: peaks are lower",
    is_pointwise=True,
)
LAT_JERK = replace(
    LONG_JERK,
    summary="size of the host's lateral jerk at a constant yaw rate",
    symbol="|j_y|",
    column="lat_jerk_mps3",
    formula="|a_e w_e|",
    source="derivative of v w; CommonRoad-CriMe, LatJ",
    compute=host_lateral_jerk_size_mps3,
    misleads="while the yaw rate changes",
)
