"""Predicted post-encroachment time: at constant speeds along the present headings."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.crossing import StraightCrossing
from cwcli.measures.pair import Pair, SecondsAtStamps


def predicted_post_encroachment_time(pair: Pair) -> SecondsAtStamps:
    """Predicted post-encroachment time (s) at each stamp, (n,); 0 where both would be in the area at once."""
    at = StraightCrossing(pair)
    gap = np.maximum(at.host_entry_s - at.other_exit_s, at.other_entry_s - at.host_exit_s)
    return pair.expand_to_all_rows(np.where(at.is_crossing_ahead, np.maximum(gap, 0.0), np.nan))


MEASURE = Measure(
    summary="post-encroachment time at constant speeds",
    symbol="PPET",
    column="ppet_s",
    critical="low",
    formula=(
        "max(t_entry,e - t_exit,o, t_entry,o - t_exit,e, 0) of the area that both outlines sweep, straight on at "
        "constant speeds"
    ),
    source="Allen, Shin and Cooper 1978; SUMO device.ssm",
    compute=predicted_post_encroachment_time,
    threshold=1.0,
    threshold_source="cwcli; SUMO reports from 2 s",
    undefined="the ways cross under less than 30 degrees, or one has left the area, or stands",
    misleads="for a vehicle that brakes before the crossing",
    is_pointwise=True,
)
