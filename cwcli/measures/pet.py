"""Post-encroachment time: between one vehicle leaving a spot and the other entering it. For a follower the time gap."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.outlines import overlap_margin
from cwcli.measures.pair import Pair, interpolate
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import NS_PER_S

LIMIT_S = 5.0
STEP_S = 0.1


def post_encroachment_time(pair: Pair) -> FloatArray:
    """The smallest lag at which one's outline, taken that much later, overlaps the other's, (): 0 for a collision."""
    host, other = pair.host.stamp_ns, pair.other.stamp_ns
    if not (len(host) and len(other)):
        return np.array(np.nan)
    first, last = max(int(host[0]), int(other[0])), min(int(host[-1]), int(other[-1]))
    at_ns = np.arange(first, last + 1, round(STEP_S * NS_PER_S))
    own, theirs = (interpolate(track, at_ns, pair.max_gap_s) for track in (pair.host, pair.other))
    reach = 0.5 * (np.hypot(*pair.host_size) + np.hypot(*pair.other_size))
    n_lags = min(round(LIMIT_S / STEP_S), len(at_ns) - 1) + 1 if last > first else 0
    for lag in range(n_lags):
        for early, late, early_size, late_size in (
            (own, theirs, pair.host_size, pair.other_size),
            (theirs, own, pair.other_size, pair.host_size),
        ):
            before, after = early[: len(early) - lag], late[lag:]
            dx, dy = after[:, 0] - before[:, 0], after[:, 1] - before[:, 1]
            near = np.flatnonzero(dx**2 + dy**2 <= reach**2)
            if not len(near):
                continue
            margin = overlap_margin(dx[near], dy[near], before[near, 3], after[near, 3], early_size, late_size)
            if (margin <= 0.0).any():
                return np.array(lag * STEP_S)
    return np.array(np.nan)


MEASURE = Measure(
    summary="post-encroachment time",
    symbol="PET",
    column="pet_s",
    critical="low",
    formula="least |t_1 - t_2| with overlapping outlines, of one at t_1 and of the other at t_2, in steps of 0.1 s",
    source="Allen, Shin and Cooper 1978",
    of=post_encroachment_time,
    note="post-encroachment time in steps of 0.1 s; NaN: none below 5 s",
    is_series=False,
)
