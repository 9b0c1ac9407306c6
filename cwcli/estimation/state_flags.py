"""Flags of states that deserve less trust: at the start, after a reset, across a gap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.passes import FilterStart, PassResult, SensorSeries
from cwcli.estimation.start import first_heading_time_s
from cwcli.kernels.ekf import UpdateStatus
from cwcli.signals.columns import FloatArray
from cwcli.signals.vehicle_state import HEADING, SPEED, StateFlag, X, Y

FLAGGED_TIME_AFTER_START_S = 2.0
"""Time for which states are flagged after a start or reset, s: two time constants of the jerk."""
MAX_AGE_IN_WHOLE_START_STATE_S = 1.0
"""Greatest age in s of position, speed and heading at the start that still make a whole state: the period of slow
senders. Chosen by hand."""
MIN_VELOCITY_SIGMAS_FOR_COURSE = 10.0
"""Least size of a velocity, in its sigmas, that tells the heading. Chosen: the course is then good to 0.1 rad."""
MIN_TIME_FLAGGED_AFTER_REJECTION_S = 0.3
"""Time after a rejected row from which online states are flagged, too, s. Chosen: three periods of usual messages."""
SQUARED_REJECTED_INNOVATION_IN_STATE_VARIANCE_SHARE = 0.5
"""Share of the squared innovation that the variance of a state holds while rows are rejected.

Chosen: the state and the rejected rows are taken to be right with the same probability, once they have been rejected
for `REJECTION_TIME_OF_EVEN_DOUBT_S`; before, the share grows with the square of the time: most rejections
are short, and outliers."""
REJECTION_TIME_OF_EVEN_DOUBT_S = 2.0
"""Time of rejections after which the rows are as likely right as the state, s: they are then believed (`ekf.pyx`)."""
MIN_POSITION_GAP_S = 2.0
"""Least duration of a gap between used positions, s. Chosen by hand; not fitted."""
MIN_POSITION_GAP_IN_USUAL_STEPS = 3.0
"""Least duration of a gap in usual steps of the positions. Chosen by hand; not fitted."""
WIDENED_STATES_BY_REJECTED_KIND = {
    Kind.POSITION: (X, Y),
    Kind.VELOCITY: (SPEED,),
    Kind.SPEED: (SPEED,),
    Kind.HEADING: (HEADING,),
}
"""States whose variance grows while rows of a kind are rejected."""
N_STEPS_FOR_MEDIAN_STEP = 5
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

    def set_flag_between(flag: StateFlag, begin_s: FloatArray, end_s: FloatArray) -> None:
        flags[_inside_any_interval_mask(output_s, begin_s, end_s)] |= np.uint8(flag)

    shown_s = start.time_s if causal else max(start.time_s, first_heading_time_s(series))
    restart_s = np.array([each.time_s for each in restarts])
    started_s = np.append(restart_s, shown_s)
    set_flag_between(StateFlag.STARTING, np.append(restart_s, -np.inf), _settling_ends_s(series, started_s))
    for s, found in zip(series, status, strict=True):
        if s.kind in KINDS_THAT_IMU_MEASURES_TOO:
            continue
        time = s.time_s - s.latency_s
        believed = np.flatnonzero(found >= UpdateStatus.USED)
        rows = np.flatnonzero(found == UpdateStatus.USED_AFTER_RESET)
        # the first row behind the last one that was believed before
        begins = rows if causal else np.append(-1, believed)[np.searchsorted(believed, rows)] + 1
        set_flag_between(StateFlag.AFTER_RESET, time[begins], time[rows] + FLAGGED_TIME_AFTER_START_S)
    if causal:
        for s, found in zip(series, status, strict=True):
            set_flag_between(StateFlag.REJECTING, *begins_ends_and_rows_of_rejecting_spans(s, found)[:2])
    set_flag_between(StateFlag.BRIDGED, *_begins_and_ends_of_position_gaps_s(series, status, causal=causal))
    return flags


def _settling_ends_s(series: Sequence[SensorSeries], start_s: FloatArray) -> FloatArray:
    """Return when the states behind each start (k,), s, have settled, (k,).

    They have when position, speed and heading have all been measured, at most `MAX_AGE_IN_WHOLE_START_STATE_S` before
    the start, else after `FLAGGED_TIME_AFTER_START_S`.
    """
    ends_s = np.asarray(start_s + FLAGGED_TIME_AFTER_START_S)
    position_s: list[FloatArray] = []
    speed_s: list[FloatArray] = []
    heading_s: list[FloatArray] = []
    for s in series:
        time_s = s.time_s - s.latency_s
        if s.kind is Kind.POSITION:
            position_s.append(time_s)
        elif s.kind is Kind.SPEED:
            speed_s.append(time_s)
        elif s.kind is Kind.HEADING:
            heading_s.append(time_s)
        elif s.kind is Kind.VELOCITY:
            speed_s.append(time_s)
            over_ground = np.hypot(s.values[:, 0], s.values[:, 1])
            sigma = np.sqrt(np.maximum(s.noise[:, 0], s.noise[:, 2]))
            heading_s.append(time_s[over_ground > np.maximum(1.0, MIN_VELOCITY_SIGMAS_FOR_COURSE * sigma)])
    if not (position_s and speed_s and heading_s):
        return ends_s
    whole_s = np.copy(start_s)
    for parts in (position_s, speed_s, heading_s):
        measured_s = np.append(np.sort(np.concatenate(parts)), np.inf)
        first_s = measured_s[np.searchsorted(measured_s[:-1], start_s - MAX_AGE_IN_WHOLE_START_STATE_S)]
        whole_s = np.maximum(whole_s, first_s)
    return np.minimum(ends_s, whole_s)


def begins_ends_and_rows_of_rejecting_spans(
    s: SensorSeries, status: npt.NDArray[np.int8]
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.intp]]:
    """Find the spans in which a source is rejected, from what is known in them.

    Args:
        s: Any series; an inertial one has no spans, because it is believed again after two rows.
        status: Shape (n,): see `PassResult`.

    Returns:
        Begins and ends of the spans (s), one span a rejected row that counts, and the rows, (k,) each. A span ends with
        the next row.
    """
    time_s = s.time_s - s.latency_s
    rejected = status == UpdateStatus.GATED
    if s.kind in KINDS_THAT_IMU_MEASURES_TOO or not rejected.any():
        return np.zeros(0), np.zeros(0), np.zeros(0, np.intp)
    rows = np.flatnonzero(rejected)
    is_first = ~np.append(False, rejected)[rows]
    begins = np.where(is_first, time_s[rows] + MIN_TIME_FLAGGED_AFTER_REJECTION_S, time_s[rows])
    ends = np.append(time_s, np.inf)[rows + 1]
    counts = begins < ends
    return begins[counts], ends[counts], rows[counts]


def covariance_widened_at_rejected_rows(
    covariance: FloatArray,
    series: Sequence[SensorSeries],
    result: PassResult,
    output_s: FloatArray,
) -> FloatArray:
    """Return the covariance (m, n, n) of online states, larger where rows are rejected.

    The state may be the one that errs; then it errs by the innovation.

    Args:
        output_s: Shape (m,), increasing: times of the states.
    """
    grown = covariance
    for s, found, status in zip(series, result.nis, result.status, strict=True):
        states = WIDENED_STATES_BY_REJECTED_KIND.get(s.kind)
        begins, ends, rows = begins_ends_and_rows_of_rejecting_spans(s, status)
        if states is None or not len(rows):
            continue
        grown = covariance.copy() if grown is covariance else grown
        first, last = np.searchsorted(output_s, begins), np.searchsorted(output_s, ends)
        time_s, used = s.time_s - s.latency_s, np.flatnonzero(status != UpdateStatus.GATED)
        since = np.append(-1, used)[np.searchsorted(used, rows)] + 1  # the first rejected row behind the last other one
        share = (
            SQUARED_REJECTED_INNOVATION_IN_STATE_VARIANCE_SHARE
            * np.minimum((time_s[rows] - time_s[since]) / REJECTION_TIME_OF_EVEN_DOUBT_S, 1.0) ** 2
        )
        for begin, end, variance in zip(first.tolist(), last.tolist(), share * found[rows, 1], strict=True):
            for i in states:
                grown[begin:end, i, i] += variance
    return grown


def _inside_any_interval_mask(time_s: FloatArray, begin_s: FloatArray, end_s: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which times (n,), increasing, lie in one of the intervals [begin_s, end_s), (k,) each."""
    first, last = np.searchsorted(time_s, begin_s), np.searchsorted(time_s, end_s)
    is_some = last > first
    n = len(time_s) + 1
    steps = np.bincount(first[is_some], minlength=n) - np.bincount(last[is_some], minlength=n)
    inside: npt.NDArray[np.bool_] = np.cumsum(steps)[:-1] > 0
    return inside


def _begins_and_ends_of_position_gaps_s(
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
    least_s = np.maximum(
        MIN_POSITION_GAP_S,
        MIN_POSITION_GAP_IN_USUAL_STEPS * (_recent_median_steps_s(time) if causal else _median_step_s(time)),
    )
    ends = np.append(time[1:], np.inf)
    just_behind = np.nextafter(time, np.inf)
    begins = time + least_s if causal else just_behind
    is_long = ends - time > least_s
    return begins[is_long], ends[is_long]


def _median_step_s(time_s: FloatArray) -> FloatArray:
    """Return the median step of the whole log, (1,), s."""
    return np.array([median_of_finite_values(np.diff(time_s)) if len(time_s) > 1 else 0.0])


def _recent_median_steps_s(time_s: FloatArray) -> FloatArray:
    """Return the median of the last few steps before each time, (n,), s; 0 where there is none."""
    known = np.concatenate([np.full(N_STEPS_FOR_MEDIAN_STEP, np.nan), np.diff(time_s)])
    recent = np.sort(np.lib.stride_tricks.sliding_window_view(known, N_STEPS_FOR_MEDIAN_STEP), axis=1)
    count = np.isfinite(recent).sum(axis=1)
    middle = np.take_along_axis(recent, np.maximum((count - 1) // 2, 0)[:, None], axis=1)[:, 0]
    return np.asarray(np.nan_to_num(middle, nan=0.0))
