"""Required lateral acceleration: it just steers past the other by the time to collision."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import Mps2AtStamps, Pair
from cwcli.measures.ttc import MEASURE as TTC


def required_lateral_acceleration(pair: Pair) -> Mps2AtStamps:
    """Required lateral acceleration (m/s^2) at each stamp, (n,); infinity where the outlines touch."""
    at, near = pair.other_in_host_axes, pair.near_rows
    ttc = pair.evaluate_measure(TTC)[near]
    ahead = at.x_m > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = [
            np.abs(at.other_accel_mps2[1] - 2.0 * (side * at.reach_y_m - at.y_m - at.vy_mps * ttc) / ttc**2)
            for side in (-1.0, 1.0)
        ]
    needed = np.where(ttc > 0.0, np.minimum(*sides), np.inf)
    return pair.expand_to_all_rows(np.where(ahead & np.isfinite(ttc), needed, np.nan))


MEASURE = Measure(
    summary="lateral acceleration that just steers past the other",
    symbol="a_lat,req",
    column="a_lat_req_mps2",
    critical="high",
    formula="min over left and right of |a_o,y - 2 (+-w - y_o - v_r,y TTC) / TTC^2|, w half of both extents across",
    source="Jansson 2005, section 5.3.8",
    compute=required_lateral_acceleration,
    is_symmetric=False,
    undefined="the other is not ahead, or the two are not on a collision course",
    misleads="where there is no room beside the lane",
    is_pointwise=True,
)
