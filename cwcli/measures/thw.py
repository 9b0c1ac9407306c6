"""Time headway: time until the host's front is where the rear of the vehicle ahead is now."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair, SecondsAtStamps


def time_headway(pair: Pair) -> SecondsAtStamps:
    """Time headway (s) to the other where it is straight ahead, at each stamp, (n,); else NaN."""
    at = pair.other_in_host_axes
    with np.errstate(divide="ignore", invalid="ignore"):
        return pair.expand_to_all_rows(
            np.where(at.host_speed_mps > 0.0, at.headway_if_straight_ahead_m / at.host_speed_mps, np.nan)
        )


MEASURE = Measure(
    summary="time until the host is where a vehicle ahead is now",
    symbol="THW",
    column="thw_s",
    critical="low",
    formula="HW / v_e",
    source="ISO 15623; Jansson 2005",
    compute=time_headway,
    is_symmetric=False,
    threshold=0.9,
    threshold_source="half the two seconds of driving schools (Vogel 2003: 0.9 s is often fined)",
    undefined="nothing is ahead of the host within the width of the two outlines, or the host stands",
    misleads="in dense traffic, where many drive at 0.8 s for hours; it does not depend on the closing speed",
    is_pointwise=True,
)
