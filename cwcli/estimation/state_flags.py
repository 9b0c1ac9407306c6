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

    def mark(flag: StateFlag, begin_s: FloatArray, end_s: FloatArray) -> None:
        flags[_inside_any_interval(output_s, begin_s, end_s)] |= np.uint8(flag)

    shown_s = start.time_s if causal else max(start.time_s, first_heading_time_s(series))
    restart_s = np.array([each.time_s for each in restarts])
    mark(StateFlag.STARTING, np.append(restart_s, -np.inf), np.append(restart_s, shown_s) + SETTLING_TIME_S)
    for s, found in zip(series, status, strict=True):
        if s.kind in RATE_KINDS:
            continue
        time = s.time_s - s.latency_s
        believed = np.flatnonzero(found >= UpdateStatus.USED)
        rows = np.flatnonzero(found == UpdateStatus.USED_AFTER_RESET)
        # the first row behind the last one that was believed before
        begins = rows if causal else np.append(-1, believed)[np.searchsorted(believed, rows)] + 1
        mark(StateFlag.AFTER_RESET, time[begins], time[rows] + SETTLING_TIME_S)
    mark(StateFlag.BRIDGED, *_find_position_gaps_s(series, status, causal=causal))
    return flags


def _inside_any_interval(time_s: FloatArray, begin_s: FloatArray, end_s: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which times (n,), increasing, lie in one of the intervals [begin_s, end_s), (k,) each."""
    first, last = np.searchsorted(time_s, begin_s), np.searchsorted(time_s, end_s)
    is_some = last > first
    n = len(time_s) + 1
    steps = np.bincount(first[is_some], minlength=n) - np.bincount(last[is_some], minlength=n)
    inside: npt.NDArray[np.bool_] = np.cumsum(steps)[:-1] > 0
    return inside


def _find_position_gaps_s(
    series: Sequence[SensorSeries], status: Sequence[npt.NDArray[np.int8]], *, causal: bool
) -> tuple[FloatArray, FloatArray]:
    """Return begins and ends (k,), s, of the gaps in the used positions, and of the time after the last one."""
    used = [
        (s.time_s - s.latency_s)[found >= UpdateStatus.USED]
        for s, found in zip(series, status, strict=True)
        if s.kind is Kind.POSITION
    ]
    time = np.sort(np.concatenate(used))
    if not len(time):
        return (np.zeros(0), np.zeros(0)) if causal else (np.array([-np.inf]), np.array([np.inf]))
    least_s = np.maximum(MIN_GAP_S, MIN_GAP_STEPS * (_recent_median_steps_s(time) if causal else _median_step_s(time)))
    ends = np.append(time[1:], np.inf)
    just_behind = np.nextafter(time, np.inf)
    begins = time + least_s if causal else just_behind
    is_long = ends - time > least_s
    return begins[is_long], ends[is_long]


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
