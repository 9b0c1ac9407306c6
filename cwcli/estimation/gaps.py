"""Restarts of the filter after long gaps in the measurements."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.passes import N_MOTION_STATES, FilterStart, SensorSeries
from cwcli.estimation.start import MAX_GYROSCOPE_GAP_S, MIN_DISPLACEMENT_SHOWING_HEADING_M, find_filter_start

MAX_TIME_WITHOUT_HEADING_EVIDENCE_S = 5.0
"""Longest time, s, with neither a position nor a velocity nor a heading after which the filter goes on. After a longer
one without a gyroscope it starts anew.

Chosen: a car may turn by half a radian in it (`start.UNMEASURED_TURN_SIGMA_RADPS`)."""
MIN_MOVEMENT_ACROSS_GAP_SIGMAS = 5.0
"""Least difference of the positions across a gap, in sigmas, at which the car counts as moved. Chosen by hand; not
fitted."""
KINDS_SHOWING_HEADING = (Kind.POSITION, Kind.VELOCITY, Kind.HEADING)
"""Kinds from which the filter learns the heading."""


def find_filter_restarts_after_gaps(series: Sequence[SensorSeries], *, causal: bool) -> list[FilterStart]:
    """Return a new filter start behind each long gap in which the car moved and no source measured the heading.

    Behind such a gap the heading may be wrong by any angle. The filter, linearised about it, would become sure of a
    wrong state and explain the first fixes by impossible speeds.

    Args:
        series: Series with their final latencies and noise.
        causal: See `find_filter_start`: the restart then waits until a heading is known; there is none where that never
            happens.
    """
    times = np.sort(np.concatenate([s.time_s - s.latency_s for s in series if s.kind in KINDS_SHOWING_HEADING]))
    before_gaps = np.flatnonzero(np.diff(times) > MAX_TIME_WITHOUT_HEADING_EVIDENCE_S)
    gaps = [
        (begin, end)
        for begin, end in zip(times[before_gaps].tolist(), times[before_gaps + 1].tolist(), strict=True)
        if not _is_yaw_rate_mostly_measured(series, begin, end)
    ]
    found = []
    for i, (begin, end) in enumerate(gaps):
        stop = gaps[i + 1][0] if i + 1 < len(gaps) else np.inf
        later = [s.select_rows((s.time_s - s.latency_s >= end) & (s.time_s - s.latency_s <= stop)) for s in series]
        if not any(s.kind is Kind.POSITION and len(s) for s in later):
            continue
        start = find_filter_start(later, N_MOTION_STATES, causal=causal)
        known = [s.select_rows(s.time_s - s.latency_s <= start.time_s) for s in series] if causal else series
        if np.isfinite(start.time_s) and _has_position_changed_between(known, begin, end):
            found.append(start)
    return found


def _is_yaw_rate_mostly_measured(series: Sequence[SensorSeries], begin_s: float, end_s: float) -> bool:
    """Whether a yaw rate was measured for more than half of the time between two times (s)."""
    for s in series:
        if s.kind is Kind.YAW_RATE:
            time = s.time_s - s.latency_s
            inside = time[(time > begin_s) & (time < end_s)]
            gap_s = np.diff(np.concatenate(([begin_s], inside, [end_s])))
            if float(gap_s[gap_s > MAX_GYROSCOPE_GAP_S].sum()) < 0.5 * (end_s - begin_s):
                return True
    return False


def _has_position_changed_between(series: Sequence[SensorSeries], begin_s: float, end_s: float) -> bool:
    """Whether the positions before and behind a gap (s) differ by more than their noise."""
    for s in series:
        if s.kind is Kind.POSITION and len(s) > 1:
            time = s.time_s - s.latency_s
            first = min(int(np.searchsorted(time, end_s)), len(s) - 1)
            last = max(int(np.searchsorted(time, begin_s, side="right")) - 1, 0)
            sigma = float(np.sqrt(max(median_of_finite_values(s.noise[:, 0]), median_of_finite_values(s.noise[:, 2]))))
            if float(np.hypot(*(s.values[first] - s.values[last]))) > max(
                MIN_DISPLACEMENT_SHOWING_HEADING_M, MIN_MOVEMENT_ACROSS_GAP_SIGMAS * sigma
            ):
                return True
    return False
