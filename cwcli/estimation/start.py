"""Start of the filter: time and initial state, with a heading from the first source that shows one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import (
    MAX_TIME_OF_USED_ROW_BEFORE_FILTER_START_S,
    N_MOTION_STATES,
    FilterStart,
    SensorSeries,
)
from cwcli.lazy_dataclass import replace
from cwcli.signals.columns import FloatArray

MIN_DISPLACEMENT_SHOWING_HEADING_M = 2.0
"""Least displacement that shows a heading, m. Chosen by hand; not fitted."""
MIN_DISPLACEMENT_DURATION_GIVING_SPEED_S = 0.5
"""Least time over which a displacement gives a speed, s. Chosen so that a burst of rows gives none."""
MIN_DISPLACEMENT_SHOWING_HEADING_SIGMAS = 10.0
"""Least displacement that shows a heading, in sigmas of the position.

Chosen: the heading is then good to about 0.15 rad, which the filter's linearisation bears."""
UNKNOWN_HEADING_SIGMA_RAD = 1.8
"""One sigma of an unknown heading, rad: that of a uniform distribution over the circle."""
UNMEASURED_TURN_SIGMA_RADPS = 0.1
"""One sigma of the turn while no source measures it, rad per second. Chosen by hand; not fitted."""
GYROSCOPE_BIAS_SIGMA_RADPS = 0.01
"""One sigma of a gyroscope's bias before it is estimated, rad/s. Chosen by hand; not fitted."""
MAX_GYROSCOPE_GAP_S = 0.5
"""Longest gap of a gyroscope, s, in which the yaw rate counts as measured. Chosen by hand; not fitted."""
UNKNOWN_SPEED_SIGMA_MPS = 10.0
"""One sigma of an unknown speed, m/s. Chosen by hand; not fitted."""
UNKNOWN_STATE_SIGMAS = (0.0, 0.0, UNKNOWN_SPEED_SIGMA_MPS, UNKNOWN_HEADING_SIGMA_RAD, 2.0, 0.3, 1.0, 0.2)
"""Sigmas of the eight states before a heading is known; the position has that of its measurement."""


class HeadingCandidate(NamedTuple):
    """The first heading that a source shows, with the speed then.

    Attributes:
        time_s: When it is known.
        heading_rad, heading_sigma_rad: The heading and one sigma of it.
        speed_mps, speed_sigma_mps: The speed, negative in reverse, and one sigma of it.
    """

    time_s: float
    heading_rad: float
    heading_sigma_rad: float
    speed_mps: float
    speed_sigma_mps: float


def find_filter_start(series: Sequence[SensorSeries], n_states: int, *, causal: bool) -> FilterStart:
    """Find start time and initial state of the filter.

    The smoother may look ahead: it starts at the first measurement with the heading that a later displacement or
    course shows (turned back by the gyroscope where there is one). The filter alone starts when a heading and a
    position are known.

    Args:
        series: At least one POSITION with one row.
        n_states: Length of the state (6, or 8 and parameters).
        causal: Use nothing later than the start.

    Returns:
        The start; parameter states are zero with zero variance (the caller fills them). With `causal` its time is
        infinite where no heading ever becomes known.
    """
    if causal:
        positions = [float(s.time_s[0] - s.latency_s) for s in series if s.kind is Kind.POSITION and len(s)]
        begin = max(first_heading_time_s(series), min(positions, default=np.inf))
        if not np.isfinite(begin):
            return FilterStart(np.inf, np.zeros(n_states), np.eye(n_states))
        series = [s.select_rows(s.time_s - s.latency_s <= begin) for s in series]
        _, heading, heading_sigma, speed, speed_sigma = max(_heading_candidates(series, newest=True))
    else:
        begin = min(float(s.time_s[0] - s.latency_s) for s in series if len(s))
        unknown = HeadingCandidate(0.0, 0.0, UNKNOWN_HEADING_SIGMA_RAD, 0.0, UNKNOWN_SPEED_SIGMA_MPS)
        heading_s, heading, heading_sigma, speed, speed_sigma = min(_heading_candidates(series), default=unknown)
    if not causal and heading_s > begin:
        turned_angle_rad, turned_sigma = _turned_angle_and_sigma_rad(series, begin, heading_s)
        heading -= turned_angle_rad
        heading_sigma = min(np.hypot(heading_sigma, turned_sigma), UNKNOWN_HEADING_SIGMA_RAD)
        speed, speed_sigma = _speed_and_sigma_at(series, begin)
    x, y, position_sigma = _x_y_and_sigma_at(series, begin, speed if np.isfinite(heading) else 0.0)
    state, sigma = np.zeros(n_states), np.zeros(n_states)
    state[:4] = x, y, speed, heading
    sigma[:6] = position_sigma, position_sigma, speed_sigma, heading_sigma, 2.0, 0.3
    if n_states >= N_MOTION_STATES:
        sigma[6:8] = 1.0, 0.2
    return FilterStart(begin, state, np.diag(sigma**2))


def first_heading_time_s(series: Sequence[SensorSeries]) -> float:
    """Return the time (s) at which a heading is first known; infinity if never."""
    return min((each.time_s for each in _heading_candidates(series)), default=np.inf)


def _heading_candidates(series: Sequence[SensorSeries], *, newest: bool = False) -> list[HeadingCandidate]:
    """Return the first heading of each source that shows one; with `newest` the last of headings and velocities."""
    candidates: list[HeadingCandidate] = []
    for s in series:
        if not len(s):
            continue
        time = s.time_s - s.latency_s
        if s.kind is Kind.HEADING:
            i = -1 if newest else 0
            said = float(time[i]), float(s.values[i, 0]), float(np.sqrt(s.noise[i, 0]))
            candidates.append(HeadingCandidate(*said, *_speed_and_sigma_at(series, float(time[i]))))
        elif s.kind is Kind.VELOCITY:
            speed = np.hypot(s.values[:, 0], s.values[:, 1])
            sigma = np.sqrt(np.maximum(s.noise[:, 0], s.noise[:, 2]))
            fast = np.flatnonzero(speed > np.maximum(1.0, 4.0 * sigma))
            if len(fast):
                i = fast[-1 if newest else 0]
                angle = float(np.arctan2(s.values[i, 1], s.values[i, 0]))
                heading_sigma, speed_sigma = float(sigma[i] / speed[i]) + 0.02, float(sigma[i]) + 0.1
                moving = HeadingCandidate(float(time[i]), angle, heading_sigma, float(speed[i]), speed_sigma)
                candidates.append(_reverse_course_if_reversing(series, moving))
        elif s.kind is Kind.POSITION:
            displacement = _heading_candidate_from_first_displacement(s)
            if displacement is not None:
                candidates.append(_reverse_course_if_reversing(series, displacement))
    return candidates


def _reverse_course_if_reversing(series: Sequence[SensorSeries], course: HeadingCandidate) -> HeadingCandidate:
    """Return a course as the heading: turned by half a turn, at a negative speed, where the vehicle is reversing."""
    if _driving_direction_sign_at(series, course.time_s) < 0:
        return course._replace(heading_rad=course.heading_rad + np.pi, speed_mps=-abs(course.speed_mps))
    return course


def _heading_candidate_from_first_displacement(s: SensorSeries) -> HeadingCandidate | None:
    """Return the first displacement that is clear of the noise, from a point that may itself lie later.

    The noise is that of the rows so far, so that later rows do not change when a heading becomes known. The share of
    stamp errors uses the speed at the last of these rows.
    """
    time = s.time_s - s.latency_s
    variance = np.maximum(s.noise[:, 0], s.noise[:, 2])
    sigmas = np.sqrt(np.cumsum(variance) / np.arange(1, len(s) + 1) + _stamp_error_variances_m2(s))
    limit = np.maximum(MIN_DISPLACEMENT_SHOWING_HEADING_M, MIN_DISPLACEMENT_SHOWING_HEADING_SIGMAS * sigmas)
    anchor = s.values[0]
    distance = np.hypot(s.values[:, 0] - anchor[0], s.values[:, 1] - anchor[1])
    beyond = np.flatnonzero(distance > limit)
    if not len(beyond):
        return None
    j = int(beyond[0])
    sigma, far = float(sigmas[j]), float(limit[j])
    # The last point still near the anchor: a long standstill before it says nothing of the speed. Messages that were
    # held back come in a burst, and their stamps say nothing of it either.
    near = np.flatnonzero(distance[:j] < 0.5 * far)
    i = int(near[-1]) if len(near) else 0
    while i > 0 and time[j] - time[i] < MIN_DISPLACEMENT_DURATION_GIVING_SPEED_S:
        i -= 1
    dx, dy = s.values[j] - s.values[i]
    dt = max(float(time[j] - time[i]), 0.1)
    length = float(np.hypot(dx, dy))
    uncertain = max(np.sqrt(2.0) * sigma, 0.1 * length)
    return HeadingCandidate(
        float(time[j]),
        float(np.arctan2(dy, dx)),
        min(np.sqrt(2.0) * sigma / length + 0.05, UNKNOWN_HEADING_SIGMA_RAD),
        length / dt,
        uncertain / dt + 1.0,
    )


def _stamp_error_variances_m2(s: SensorSeries) -> FloatArray:
    """Return the variance (n,), m^2, that stamp errors add to each row: (sigma_t v)^2.

    The speed is that over the time before the row, long enough against the stamp errors, so that nothing looks ahead.
    At the first rows it is a bound from the displacement so far.
    """
    sigma_s = s.stamp_error.value
    if s.kind is not Kind.POSITION or not sigma_s > 0.0 or not len(s):
        return np.zeros(len(s))
    span = max(MIN_DISPLACEMENT_DURATION_GIVING_SPEED_S, MIN_DISPLACEMENT_SHOWING_HEADING_SIGMAS * sigma_s)
    before = np.maximum(np.searchsorted(s.time_s, s.time_s - span, side="right") - 1, 0)
    way = np.hypot(*(s.values - s.values[before]).T)
    return np.asarray((sigma_s * way / np.maximum(s.time_s - s.time_s[before], sigma_s)) ** 2)


def _stamp_error_variance_of_row_m2(s: SensorSeries, i: int) -> float:
    """Return the variance (m^2) that stamp errors add to a row; the first rows use the speed of later ones."""
    span = max(MIN_DISPLACEMENT_DURATION_GIVING_SPEED_S, MIN_DISPLACEMENT_SHOWING_HEADING_SIGMAS * s.stamp_error.value)
    known = min(int(np.searchsorted(s.time_s, s.time_s[0] + span)), len(s) - 1)
    return float(_stamp_error_variances_m2(s)[max(i, known)])


def _index_of_last_row_not_after(s: SensorSeries, time_s: float) -> int:
    """Return the index of the last row not after `time_s`, or of the first row."""
    return max(int(np.searchsorted(s.time_s - s.latency_s, time_s, side="right")) - 1, 0)


def _speed_and_sigma_at(series: Sequence[SensorSeries], time_s: float) -> tuple[float, float]:
    """Return speed and sigma about a time."""
    for kind in (Kind.SPEED, Kind.VELOCITY):
        for s in series:
            if s.kind is kind and len(s):
                i = _index_of_last_row_not_after(s, time_s)
                late = abs(float(s.time_s[i] - s.latency_s - time_s))
                sigma = float(np.sqrt(s.noise[i, 0])) + 2.0 * late + 0.1
                value = s.values[i, 0] if kind is Kind.SPEED else np.hypot(*s.values[i])
                return float(value), min(sigma, UNKNOWN_SPEED_SIGMA_MPS)
    for s in series:
        if s.kind is Kind.POSITION and len(s) > 1:
            time = s.time_s - s.latency_s
            j = min(int(np.searchsorted(time, time_s + 1.0)) + 1, len(s) - 1)
            i = _index_of_last_row_not_after(s, time_s)
            if j > i and time[j] > time[i]:
                span = float(time[j] - time[i])
                speed = float(np.hypot(*(s.values[j] - s.values[i]))) / span
                late = abs(float(time[i]) - time_s)
                sigma = (
                    float(np.sqrt(2.0 * (s.noise[i, 0] + _stamp_error_variance_of_row_m2(s, i)))) / span
                    + 2.0
                    + 2.0 * late
                )
                return speed, min(sigma, UNKNOWN_SPEED_SIGMA_MPS)
    return 0.0, UNKNOWN_SPEED_SIGMA_MPS


def _driving_direction_sign_at(series: Sequence[SensorSeries], time_s: float) -> float:
    """Return -1 if a speed source says that the vehicle was reversing."""
    for s in series:
        if s.kind is Kind.SPEED and len(s):
            i = _index_of_last_row_not_after(s, time_s)
            return -1.0 if s.values[i, 0] < -max(0.3, 3.0 * float(np.sqrt(s.noise[i, 0]))) else 1.0
    return 1.0


def _x_y_and_sigma_at(series: Sequence[SensorSeries], time_s: float, speed_mps: float) -> tuple[float, float, float]:
    """Return x, y and sigma about a time."""
    best: tuple[float, float, float, float] | None = None
    for s in series:
        if s.kind is Kind.POSITION and len(s):
            i = _index_of_last_row_not_after(s, time_s)
            late = abs(float(s.time_s[i] - s.latency_s - time_s))
            sigma = float(np.sqrt(max(s.noise[i, 0], s.noise[i, 2]) + _stamp_error_variance_of_row_m2(s, i)))
            if best is None or late < best[0]:
                reach = late * (abs(speed_mps) + 3.0)
                best = (late, float(s.values[i, 0]), float(s.values[i, 1]), float(np.hypot(3.0 * sigma, reach)) + 1.0)
    if best is None:
        return 0.0, 0.0, 1e3
    return best[1:]


def _turned_angle_and_sigma_rad(series: Sequence[SensorSeries], begin_s: float, end_s: float) -> tuple[float, float]:
    """Return the angle turned between two times by the gyroscope, and its sigma; (0, something large) without one."""
    span = end_s - begin_s
    for s in series:
        if s.kind is Kind.YAW_RATE and len(s) > 1:
            time = s.time_s - s.latency_s
            inside = slice(time.searchsorted(begin_s), time.searchsorted(end_s, side="right"))
            t, w = time[inside], s.values[inside, 0]
            gap = np.diff(np.concatenate(([begin_s], t, [end_s])))
            missing = float(gap[gap > MAX_GYROSCOPE_GAP_S].sum())
            if len(t) > 1 and missing < 0.5 * span:
                sigma = np.hypot(UNMEASURED_TURN_SIGMA_RADPS * missing, GYROSCOPE_BIAS_SIGMA_RADPS * span)
                turned_rad = float((0.5 * (w[1:] + w[:-1]) * np.diff(t)).sum())
                return turned_rad, float(np.hypot(0.02, sigma))
    return 0.0, max(0.3, UNMEASURED_TURN_SIGMA_RADPS * span)


def find_full_filter_start(series: Sequence[SensorSeries], prior_variances: FloatArray, *, causal: bool) -> FilterStart:
    """Return `find_filter_start` with the prior variances of the parameter states put in.

    Args:
        series, causal: See `find_filter_start`.
        prior_variances: Shape (n,): variances; the first eight are not used.
    """
    start = find_filter_start(series, len(prior_variances), causal=causal)
    index = np.arange(N_MOTION_STATES, len(prior_variances))
    start.covariance[index, index] = prior_variances[index]
    return start


def replace_infinite_start_by_end_of_rows(
    start: FilterStart, series: Sequence[SensorSeries], output_s: FloatArray
) -> FilterStart:
    """Return the start; an infinite time is replaced by one after all rows and outputs, so that a pass can run."""
    if np.isfinite(start.time_s):
        return start
    ends = [float((s.time_s - s.latency_s).max()) for s in series if len(s)]
    return replace(start, time_s=max([*ends, *output_s[-1:].tolist()]) + 1.0)


def set_states_before_start_in_place(
    state: FloatArray,
    covariance: FloatArray,
    series: Sequence[SensorSeries],
    *,
    start_s: float,
    output_s: FloatArray,
    prior: FloatArray,
) -> None:
    """Set the states before the start to the last position with all else unknown (in place).

    Args:
        state, covariance: Shapes (m, n) and (m, n, n), at `output_s`.
        series: At least one POSITION with one row.
        start_s: Where the filter starts.
        output_s: Shape (m,).
        prior: Shape (n,): variances of the parameter states; the first eight are not used.
    """
    early = np.flatnonzero(output_s < start_s - MAX_TIME_OF_USED_ROW_BEFORE_FILTER_START_S)
    if not len(early):
        return
    position = next(s for s in series if s.kind is Kind.POSITION and len(s))
    time = position.time_s - position.latency_s
    row = np.maximum(np.searchsorted(time, output_s[early], side="right") - 1, 0)
    state[early] = 0.0
    state[early, :2] = position.values[row]
    covariance[early] = 0.0
    index = np.arange(state.shape[1])
    covariance[early[:, None], index, index] = np.concatenate(
        (np.square(UNKNOWN_STATE_SIGMAS), prior[N_MOTION_STATES:])
    )
    # A position may be old by the time from its stamp, which may err, at an unknown speed.
    age = np.hypot(output_s[early] - time[row], position.stamp_error.value)
    for axis in (0, 1):
        covariance[early, axis, axis] = position.noise[row, 2 * axis] + (UNKNOWN_SPEED_SIGMA_MPS * age) ** 2
