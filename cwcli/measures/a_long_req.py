"""Required longitudinal acceleration: it just avoids the vehicle straight ahead."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import Mps2AtStamps, Pair


def required_longitudinal_acceleration(pair: Pair) -> Mps2AtStamps:
    """Required longitudinal acceleration (m/s^2) at each stamp, (n,), at most 0; -inf in contact while closing."""
    at = pair.other_in_host_axes
    closing = np.minimum(at.vx_mps, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(closing < 0.0, closing**2 / (2.0 * at.headway_if_straight_ahead_m), 0.0)
    needed = np.minimum(at.other_accel_mps2[0] - relative, 0.0)
    return pair.expand_to_all_rows(np.where(at.is_straight_ahead, needed, np.nan))


MEASURE = Measure(
    summary="longitudinal acceleration that just avoids a vehicle ahead",
    symbol="a_long,req",
    column="a_long_req_mps2",
    critical="low",
    formula="min(a_o - v_r^2 / (2 HW), 0), v_r = min(v_o - v_e, 0)",
    source="Jansson 2005, section 5.3.5; Asljung et al. 2017, eq. 8",
    compute=required_longitudinal_acceleration,
    is_symmetric=False,
    undefined="nothing is ahead of the host within the width of the two outlines",
    misleads=(
        "in curves: what is straight ahead is not in the lane; for a vehicle ahead that brakes to a stop before the "
        "gap is used up"
    ),
    is_pointwise=True,
)
