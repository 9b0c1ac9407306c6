"""song2016's six-state extended Kalman filter, exactly (eq. 1-8).

State and measurement vector X = Z = [x, y, v, heading, a, yaw rate], one synchronous vector each 0.05 s, measurement
matrix I. Components of R are independent, so that the update by one component after the other (in the kernel) equals
the matrix update of eq. 8. The heading innovation is wrapped, which the paper does not need to say.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.errors import DataError
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.latency import UNSEARCHED_LATENCY, latency_given_by_user
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.passes import N_MOTION_STATES, SensorSeries, notes_on_rows_before_start, run_filter_pass
from cwcli.estimation.prepare import (
    clean_and_sort_measurements_and_note,
    earliest_stamp_ns,
    prepare_without_looking_ahead,
    seconds_since_zero_time,
)
from cwcli.estimation.result import SourceReport, Track
from cwcli.estimation.source_judgement import correct_and_list_imu_units_and_tilt, correct_and_list_user_faults
from cwcli.estimation.start import (
    UNKNOWN_STATE_SIGMAS,
    find_filter_start,
    replace_infinite_start_by_end_of_rows,
    set_states_before_start_in_place,
)
from cwcli.estimation.state_flags import compute_state_flags
from cwcli.kernels import ekf
from cwcli.kernels.ekf import UpdateStatus
from cwcli.lazy_dataclass import replace
from cwcli.signals.columns import FloatArray, Int64Array, sort_distinct_values
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import ACCEL, JERK, YAW_RATE

SAMPLING_TIME_S = 0.05
"""Sampling time dT of eq. 2, s; song2016 samples at 20 Hz."""
JERK_ROOT_SPECTRAL_DENSITY = 0.2
"""Root of the jerk's spectral density, m/s^3 per root Hz. Chosen: see `process_noise_covariance`."""
YAW_ACCEL_ROOT_SPECTRAL_DENSITY = 0.02
"""Root of the yaw acceleration's spectral density, rad/s^2 per root Hz. Chosen: see `process_noise_covariance`."""
DERIVATIVE_SLOPE_WINDOW_SAMPLES = 8
"""Number of samples (0.35 s) whose least-squares slope gives jerk and yaw acceleration.

The paper says that they are "computed from the measured" values, not how. Chosen on the paper's drives: with 0.2 s the
models with jerk are the worse ones, and a longer window sees a manoeuvre too late for fig. 9."""
MAX_PAUSE_FILLED_WITH_STEPS_S = 60.0
"""Longest pause of all measurements, s, through which steps are made; the filter counts a longer one as a minute.
Chosen by hand."""
DIFFERENTIATED_STATES = slice(ACCEL, YAW_RATE + 1)
"""Slice of the states whose slopes are appended: acceleration and yaw rate."""

MEASUREMENT_VECTOR_KINDS = (Kind.POSITION, Kind.SPEED, Kind.HEADING, Kind.ACCEL, Kind.YAW_RATE)
"""Kinds of the paper's measurement vector, in its order."""


def process_noise_covariance(
    step_s: float, jerk: float = JERK_ROOT_SPECTRAL_DENSITY, yaw_accel: float = YAW_ACCEL_ROOT_SPECTRAL_DENSITY
) -> FloatArray:
    """Return Q of eq. 4, which the paper leaves open.

    Eq. 2 holds a and the yaw rate constant over a step. Their changes within it are taken as white noise: a jerk
    of spectral density (0.2 m/s^3)^2/Hz lets the acceleration change by 0.2 m/s^2 (one sigma) within a second, a yaw
    acceleration of (0.02 rad/s^2)^2/Hz the yaw rate by 0.02 rad/s. Less would smooth more and lag more: at the values
    with which the filter's own covariance would give table 1's reductions of a and of the yaw rate (0.08 and 0.0016)
    the lag makes both errors larger than the measurement's on the drives of the paper: docs/papers/song2016-choices.md.
    Both are integrated over the step into speed and heading; their share of the position within one step is below a
    millimetre and left out.

    Args:
        step_s: dT of eq. 2.
        jerk, yaw_accel: Roots of the spectral densities.

    Returns:
        Shape (6, 6).
    """
    q = np.zeros((6, 6))
    for rate, value, density in ((4, 2, jerk**2), (5, 3, yaw_accel**2)):
        q[rate, rate] = density * step_s
        q[rate, value] = q[value, rate] = density * step_s**2 / 2
        q[value, value] = density * step_s**3 / 3
    return q


def estimate_track_with_song2016(
    measurements: Sequence[Measurements], config: EstimatorConfig, output_stamp_ns: Int64Array | None
) -> Track:
    """Run the paper's filter on a log: see `estimate_track` for arguments and errors.

    The paper's measurement vector is synchronous. A log's sensors are not: each measurement goes to the nearest step
    of a 0.05 s grid (the last one where several meet), and a component that was not measured at a step is left out of
    the update there, never invented. Latencies are corrected only where given. Jerk and yaw acceleration are no states
    of this model: see `append_jerk_and_yaw_acceleration`. Without `causal` the same model is smoothed, which the paper
    does not do.
    """
    zero_ns = earliest_stamp_ns(measurements)
    measurements, corrections = correct_and_list_user_faults(measurements, config.source_units)
    if not config.blind:
        measurements, found = correct_and_list_imu_units_and_tilt(
            measurements, {*config.trusted_sources, *config.source_units}
        )
        corrections += found
    prepared, notes = (
        (prepare_without_looking_ahead(measurements, zero_ns, {}), [])
        if config.blind
        else clean_and_sort_measurements_and_note(measurements, zero_ns)
    )
    latencies = [latency_given_by_user(p.series, config) or UNSEARCHED_LATENCY for p in prepared]
    step = config.song2016_step_s
    series = [
        _last_row_of_each_step(replace(p.series, latency_s=latency.applied_s), step)
        for p, latency in zip(prepared, latencies, strict=True)
    ]
    if not any(s.kind is Kind.POSITION and len(s) for s in series):
        raise DataError("no finite position among the measurements")
    end = max(float(s.time_s[-1]) for s in series if len(s))
    if output_stamp_ns is None:
        output_stamp_ns = np.arange(
            zero_ns, zero_ns + round(end * NS_PER_S) + 1, round(step * NS_PER_S), dtype=np.int64
        )
    # The states are known at the steps; between them the step before holds.
    output_time_s = seconds_since_zero_time(output_stamp_ns, zero_ns)
    start = replace_infinite_start_by_end_of_rows(
        find_filter_start(series, 6, causal=config.causal), series, output_time_s
    )
    begin = round(start.time_s / step) * step
    wanted_step = np.maximum(np.floor(output_time_s / step + 1e-6).astype(np.int64), round(begin / step))
    steps = _step_numbers_without_pauses(series, round(begin / step), wanted_step, step)
    result = run_filter_pass(
        series, replace(start, time_s=begin), ekf.ProcessModel.song2016(process_noise_covariance(step)),
        np.asarray(steps * step, float), smooth=not config.causal, reset_after=config.reset_after,
    )  # fmt: skip
    all_states, all_covariances = append_jerk_and_yaw_acceleration(result.state, result.covariance, steps, step)
    row = np.searchsorted(steps, wanted_step)
    state, covariance = all_states[row], all_covariances[row]
    _extrapolate_states_in_place(state, np.maximum(output_time_s - steps[row] * step, 0.0))
    if config.causal:
        set_states_before_start_in_place(
            state, covariance, series, start_s=begin, output_s=output_time_s, prior=np.zeros(N_MOTION_STATES)
        )
        notes += notes_on_rows_before_start(series, result)
    reports = tuple(
        SourceReport(
            s.source, s.kind, n_read=p.n_read, n_used=int((status >= UpdateStatus.USED).sum()),
            n_gated=int((status == UpdateStatus.GATED).sum()),
            n_not_finite=p.n_not_finite, n_interpolated=p.n_interpolated,
            nis_mean=float(nis[:, 0].mean()) if len(nis) else float("nan"),
            nis_dof=s.n_values_per_row, noise_origin=s.noise_origin, latency=latency,
            sigma=float(np.sqrt(s.noise[:, 0].mean())) if len(s) else float("nan"),
        )
        for p, s, latency, nis, status in zip(prepared, series, latencies, result.nis, result.status, strict=True)
    )  # fmt: skip
    flags = compute_state_flags(
        series, result.status, output_time_s, start=replace(start, time_s=begin), causal=config.causal
    )
    return Track(
        output_stamp_ns, state, covariance, flags, reports, result.log_likelihood,
        (*(each.sentence_on_fault_and_undoing for each in corrections), *notes), corrections=tuple(corrections),
    )  # fmt: skip


def append_jerk_and_yaw_acceleration(
    state: FloatArray, covariance: FloatArray, steps: Int64Array, step_s: float = SAMPLING_TIME_S
) -> tuple[FloatArray, FloatArray]:
    """Add the jerk and the yaw acceleration that eq. 10 needs: see `DERIVATIVE_SLOPE_WINDOW_SAMPLES`.

    Their covariance is that of a slope through values with independent errors. Where fewer steps lie in a row before
    (at the start, after a pause) they are 0 with the variance of an unknown state.

    Args:
        state, covariance: Shapes (n, 6) and (n, 6, 6), at the steps.

    Returns:
        Shapes (n, 8) and (n, 8, 8), order `vehicle_state.STATE_NAMES`.
    """
    n, before = len(state), DERIVATIVE_SLOPE_WINDOW_SAMPLES - 1
    is_known = np.zeros(n, np.bool_)
    is_known[before:] = steps[before:] - steps[: max(n - before, 0)] == before
    more_state = np.column_stack(
        [least_squares_slope_of_last_samples(state[:, k], step_s=step_s) for k in (ACCEL, YAW_RATE)]
    )
    weights = least_squares_slope_weights(DERIVATIVE_SLOPE_WINDOW_SAMPLES, step_s)
    more = np.where(
        is_known[:, None, None],
        weights @ weights * covariance[:, DIFFERENTIATED_STATES, DIFFERENTIATED_STATES],
        np.diag(np.square(UNKNOWN_STATE_SIGMAS[JERK:])),
    )
    whole = np.zeros((n, N_MOTION_STATES, N_MOTION_STATES))
    whole[:, :JERK, :JERK], whole[:, JERK:, JERK:] = covariance, more
    return np.column_stack([state, np.where(is_known[:, None], more_state, 0.0)]), whole


def least_squares_slope_weights(samples: int, step_s: float) -> FloatArray:
    """Return the weights (samples,), oldest first, that give the least-squares slope per second."""
    offsets = np.arange(samples) - (samples - 1) / 2.0
    return np.asarray(offsets / (offsets @ offsets) / step_s)


def least_squares_slope_of_last_samples(
    values: FloatArray, samples: int = DERIVATIVE_SLOPE_WINDOW_SAMPLES, *, step_s: float = SAMPLING_TIME_S
) -> FloatArray:
    """Return the least-squares slope per second over the last `samples` values, (n,); 0 until there are so many."""
    slope = np.zeros_like(values)
    if len(values) >= samples:
        slope[samples - 1 :] = np.convolve(values, least_squares_slope_weights(samples, step_s)[::-1], mode="valid")
    return slope


def filtered_states_and_covariances_of_matrix(
    measurement_matrix: FloatArray,
    sigma: Sequence[float],
    *,
    step_s: float = SAMPLING_TIME_S,
    process_noise: FloatArray | None = None,
    smooth: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Run eq. 8 over a synchronous measurement matrix, as in the paper.

    Args:
        measurement_matrix: Shape (n, 6): x, y, v, heading, a, yaw rate; NaN = not measured at this step.
        sigma: One sigma of each component (root of the diagonal of R, eq. 5).

    Returns:
        States (n, 6) and covariances (n, 6, 6); the first state is the first vector with covariance R.
    """
    n = len(measurement_matrix)
    variance: FloatArray = np.square(np.asarray(sigma, dtype=np.float64))
    # Five updates a step (the position is one of width 2), the first vector being the start.
    values = np.zeros((n, len(MEASUREMENT_VECTOR_KINDS), 2))
    values[:, 0] = measurement_matrix[:, :2]
    values[:, 1:, 0] = measurement_matrix[:, 2:]
    measured = np.isfinite(values[:, :, 0])
    measured[:, 0] &= np.isfinite(values[:, 0, 1])
    measured[0] = False
    noise = np.zeros((len(MEASUREMENT_VECTOR_KINDS), 3))
    noise[0, [0, 2]] = variance[:2]
    noise[1:, 0] = variance[2:]
    update = np.flatnonzero(measured)
    kind = np.tile(np.arange(len(MEASUREMENT_VECTOR_KINDS), dtype=np.int32), n).take(update)
    events = ekf.Events(
        time_s=step_s * np.arange(n, dtype=np.float64),
        first=np.concatenate(([0], np.cumsum(np.count_nonzero(measured, axis=1)))).astype(np.int32),
        out_row=np.arange(n, dtype=np.int32),
        source=kind,
        values=values.reshape(-1, 2).take(update, axis=0),
        noise=noise.take(kind, axis=0),
    )
    sensor = np.array(MEASUREMENT_VECTOR_KINDS, np.int32)
    sources = ekf.SourceTable(
        sensor=sensor,
        parameters=np.full((len(sensor), 6), -1, np.int32),
        place_m=np.zeros((len(sensor), 2)),
        stamp_sigma_s=np.zeros(len(sensor)),
        gate_nis=np.zeros(len(sensor)),
        patience=np.ones(len(sensor), np.int32),
        sender=np.full(len(sensor), -1, np.int32),
    )
    motion = ekf.ProcessModel.song2016(process_noise_covariance(step_s) if process_noise is None else process_noise)
    result = ekf.run(
        events, sources, motion, np.array(measurement_matrix[0], dtype=np.float64), np.diag(variance), n, smooth=smooth
    )
    return result.state, result.covariance


def _step_numbers_without_pauses(
    series: Sequence[SensorSeries], first_step: int, wanted_steps: Int64Array, step_s: float
) -> Int64Array:
    """Return the step numbers from `first_step` to the last measurement, without long pauses, and the wanted ones."""
    measured = np.concatenate([np.round(s.time_s / step_s).astype(np.int64) for s in series])
    ends = sort_distinct_values(np.append(measured[measured >= first_step], first_step))
    rows_between_ends = np.diff(ends)
    each = np.where(rows_between_ends * step_s > MAX_PAUSE_FILLED_WITH_STEPS_S, 1, rows_between_ends)
    within = np.arange(each.sum()) - np.repeat(np.cumsum(each) - each, each)
    return sort_distinct_values(np.concatenate([np.repeat(ends[:-1], each) + within, ends[-1:], wanted_steps]))


def _last_row_of_each_step(s: SensorSeries, step_s: float) -> SensorSeries:
    """Move the stamps, corrected for the latency, to the nearest step; the last row of a step stays."""
    slot = np.round((s.time_s - s.latency_s) / step_s).astype(np.int64)
    last = np.append(slot[1:] != slot[:-1], True) if len(slot) else np.zeros(0, bool)
    return replace(
        s, time_s=slot[last] * step_s, values=s.values[last], noise=s.noise[last], latency_s=0.0, bias_state=-1
    )


def _extrapolate_states_in_place(state: FloatArray, dt_s: FloatArray) -> None:
    """Carry states forward by less than a step with eq. 2 (in place)."""
    distance = state[:, 2] * dt_s + 0.5 * state[:, 4] * dt_s**2
    state[:, 0] += distance * np.cos(state[:, 3])
    state[:, 1] += distance * np.sin(state[:, 3])
    state[:, 2] += state[:, 4] * dt_s
    state[:, 3] += state[:, 5] * dt_s
