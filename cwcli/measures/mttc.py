"""Modified time to collision: when the outlines would touch if both kept acceleration and heading."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.contact import EdgeProjections, accelerated_contact_time_s
from cwcli.measures.pair import Pair, SecondsAtStamps


def modified_time_to_collision(pair: Pair) -> SecondsAtStamps:
    """Time to collision (s) at constant accelerations, at each stamp, (n,); NaN if there is none."""
    at = pair.other_in_host_axes
    ax, ay = at.other_accel_mps2
    found = accelerated_contact_time_s(EdgeProjections.from_pair(pair), ax - at.host_accel_mps2, ay)
    return pair.expand_to_all_rows(np.where(found < np.inf, found, np.nan))


MEASURE = Measure(
    summary="time to collision of the outlines at constant accelerations",
    symbol="MTTC",
    column="mttc_s",
    critical="low",
    formula="least t >= 0 at which the rectangles overlap, moved by v_e t + a_e t^2 / 2 and v_o t + a_o t^2 / 2",
    source="Ozbay et al. 2008; Jansson 2005, eq. 5.24",
    compute=modified_time_to_collision,
    threshold=1.0,
    threshold_source="as for TTC",
    undefined="the two are not on a collision course at these accelerations",
    misleads="for a braking car far ahead: the formula lets it drive backwards after it has stopped",
    is_pointwise=True,
)
