"""Long gaps: where the filter begins again behind one."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median
from cwcli.estimation.passes import N_MOTION, Series, Start
from cwcli.estimation.start import MIN_DISPLACEMENT_M, find_start

UNTOLD_S = 5.0  # in which a car turns by half a radian: see `start.UNKNOWN_TURN_RADPS`
MAX_GYRO_GAP_S = 0.5
STOOD_SIGMAS = 5.0
PLACED = (Kind.POSITION, Kind.VELOCITY, Kind.HEADING)


def restarts_after_gaps(series: Sequence[Series], *, causal: bool) -> list[Start]:
    """Where nothing told the heading for long while the car moved, begin again behind it as at the start of the log.

    The filter's expansion is about a heading that may be off by any angle there, and makes it sure of what is wrong:
    the first fixes would be explained by speeds that no car has.

    Args:
        series: Latencies and noise settled.
        causal: See `find_start`: then the restart waits until a heading has shown itself, and there is none where that
            never happens.
    """
    times = np.sort(np.concatenate([s.time_s - s.latency_s for s in series if s.kind in PLACED]))
    gaps = [
        (begin, end)
        for begin, end in itertools.pairwise(times.tolist())
        if end - begin > UNTOLD_S and not _has_gyroscope(series, begin, end)
    ]
    found = []
    for i, (begin, end) in enumerate(gaps):
        stop = gaps[i + 1][0] if i + 1 < len(gaps) else np.inf
        later = [s.at((s.time_s - s.latency_s >= end) & (s.time_s - s.latency_s <= stop)) for s in series]
        if not any(s.kind is Kind.POSITION and len(s) for s in later):
            continue
        start = find_start(later, N_MOTION, causal=causal)
        known = [s.at(s.time_s - s.latency_s <= start.time_s) for s in series] if causal else series
        if np.isfinite(start.time_s) and _has_moved(known, begin, end):
            found.append(start)
    return found


def _has_gyroscope(series: Sequence[Series], begin: float, end: float) -> bool:
    """Whether a yaw rate was measured for more than half of the time."""
    for s in series:
        if s.kind is Kind.YAW_RATE:
            time = s.time_s - s.latency_s
            inside = time[(time > begin) & (time < end)]
            gap_s = np.diff(np.concatenate(([begin], inside, [end])))
            if float(gap_s[gap_s > MAX_GYRO_GAP_S].sum()) < 0.5 * (end - begin):
                return True
    return False


def _has_moved(series: Sequence[Series], begin: float, end: float) -> bool:
    """Whether the positions before and behind a gap differ by more than their noise."""
    for s in series:
        if s.kind is Kind.POSITION and len(s) > 1:
            time = s.time_s - s.latency_s
            first = min(int(np.searchsorted(time, end)), len(s) - 1)
            last = max(int(np.searchsorted(time, begin, side="right")) - 1, 0)
            sigma = float(np.sqrt(max(median(s.noise[:, 0]), median(s.noise[:, 2]))))
            if float(np.hypot(*(s.values[first] - s.values[last]))) > max(MIN_DISPLACEMENT_M, STOOD_SIGMAS * sigma):
                return True
    return False
