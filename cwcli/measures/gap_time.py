"""Gap time: between the arrivals of the two at the crossing of their ways."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.crossing import StraightCrossing
from cwcli.measures.pair import Pair, SecondsAtStamps


def gap_time(pair: Pair) -> SecondsAtStamps:
    """Time (s) between both arrivals at the crossing, at each stamp, (n,); NaN where no crossing is ahead."""
    at = StraightCrossing(pair)
    return pair.expand_to_all_rows(
        np.where(at.is_crossing_ahead, np.abs(at.host_arrival_s - at.other_arrival_s), np.nan)
    )


MEASURE = Measure(
    summary="time between both arrivals at the crossing of their ways",
    symbol="GT",
    column="gap_time_s",
    critical="low",
    formula="|s_e / v_e - s_o / v_o|, s the way of a centre to the crossing of the two straight ways",
    source="Allen, Shin and Cooper 1978, for the centres",
    compute=gap_time,
    undefined="the ways cross under less than 30 degrees, or one is past the crossing, or stands",
    misleads="for a vehicle that turns off before the crossing",
    is_pointwise=True,
)
