"""Flags of states that deserve less trust: at the start, after a reset, across a gap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.estimation.measurements import RATE_KINDS, Kind
from cwcli.estimation.median import median
from cwcli.estimation.passes import FilterStart, SensorSeries
from cwcli.estimation.start import first_heading_time_s
from cwcli.kernels.ekf import UpdateStatus
from cwcli.signals.columns import FloatArray
from cwcli.signals.vehicle_state import StateFlag

SETTLING_TIME_S = 2.0
"""Time for which states are flagged after a start or reset, s: two time constants of the jerk."""
MIN_GAP_S = 2.0
"""Least duration of a gap between used positions, s. Chosen by hand; not fitted."""
MIN_GAP_STEPS = 3.0
"""Least duration of a gap in usual steps of the positions. Chosen by hand; not fitted."""
N_RECENT_STEPS = 5
"""Number of last steps whose median is the usual step online. Chosen by hand; not fitted."""


def compute_state_flags(
    series: Sequence[SensorSeries],
    status: Sequence[npt.NDArray[np.int8]],
    output_s: FloatArray,
    *,
    start: FilterStart,
    restarts: Sequence[FilterStart] = (),
    causal: bool,
) -> npt.NDArray[np.uint8]:
    """The flags of a track's states; `schemas/cwcli/v1/vehicle_state.proto` says what they mean.

    Args:
        series: At least one POSITION with a row.
        status: Per series, shape (k,): see `PassResult`.
        output_s: Shape (m,), increasing: times of the states.
        start, restarts: Starts of the filter.
        causal: The states are those of the filter alone; then a flag uses no later measurement.

    Returns:
        Shape (m,): `StateFlag`s.
    """
    flags = np.zeros(len(output_s), np.uint8)

    def mark(flag: StateFlag, begin_s: float, end_s: float) -> None:
        first, last = np.searchsorted(output_s, (begin_s, end_s))
        flags[first:last] |= np.uint8(flag)

    shown_s = start.time_s if causal else max(start.time_s, first_heading_time_s(series))
    mark(StateFlag.STARTING, -np.inf, shown_s + SETTLING_TIME_S)
    for each in restarts:
        mark(StateFlag.STARTING, each.time_s, each.time_s + SETTLING_TIME_S)
    for s, found in zip(series, status, strict=True):
        if s.kind in RATE_KINDS:
            continue
        time = s.time_s - s.latency_s
        believed = np.flatnonzero(found >= UpdateStatus.USED)
        for row in np.flatnonzero(found == UpdateStatus.USED_AFTER_RESET):
            before = believed[np.searchsorted(believed, row) - 1] if row > believed[0] else -1
            begin = row if causal else before + 1
            mark(StateFlag.AFTER_RESET, float(time[begin]), float(time[row]) + SETTLING_TIME_S)
    for begin_s, end_s in _find_position_gaps_s(series, status, causal=causal):
        mark(StateFlag.BRIDGED, begin_s, end_s)
    return flags


def _find_position_gaps_s(
    series: Sequence[SensorSeries], status: Sequence[npt.NDArray[np.int8]], *, causal: bool
) -> list[tuple[float, float]]:
    """Return begin and end (s) of each gap in the used positions, and of the time after the last one."""
    used = [
        (s.time_s - s.latency_s)[found >= UpdateStatus.USED]
        for s, found in zip(series, status, strict=True)
        if s.kind is Kind.POSITION
    ]
    time = np.sort(np.concatenate(used))
    if not len(time):
        return [] if causal else [(-np.inf, np.inf)]
    least_s = np.maximum(MIN_GAP_S, MIN_GAP_STEPS * (_recent_median_steps_s(time) if causal else _median_step_s(time)))
    ends = np.append(time[1:], np.inf)
    just_behind = np.nextafter(time, np.inf)
    begins = time + least_s if causal else just_behind
    return [(float(begins[k]), float(ends[k])) for k in np.flatnonzero(ends - time > least_s)]


def _median_step_s(time_s: FloatArray) -> FloatArray:
    """Return the median step of the whole log, (1,), s."""
    return np.array([median(np.diff(time_s)) if len(time_s) > 1 else 0.0])


def _recent_median_steps_s(time_s: FloatArray) -> FloatArray:
    """Return the median of the last few steps before each time, (n,), s; 0 where there is none."""
    known = np.concatenate([np.full(N_RECENT_STEPS, np.nan), np.diff(time_s)])
    recent = np.sort(np.lib.stride_tricks.sliding_window_view(known, N_RECENT_STEPS), axis=1)
    count = np.isfinite(recent).sum(axis=1)
    middle = np.take_along_axis(recent, np.maximum((count - 1) // 2, 0)[:, None], axis=1)[:, 0]
    return np.asarray(np.nan_to_num(middle, nan=0.0))
