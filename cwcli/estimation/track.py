"""Entry points of the estimator: measurements in, a track with diagnostics out."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np

from cwcli.array_memory import bound_array_memory_and_get_old_handler
from cwcli.errors import DataError
from cwcli.estimation.calibrated import (
    apply_calibrated_noise_and_empty_unknown,
    bias_contradiction_notes,
    calibrated_imu_mountings,
    require_known_sources_and_note_unknown,
)
from cwcli.estimation.calibration_check import notes_on_worse_prediction_with_calibration
from cwcli.estimation.coarse_fixes import covariance_from_coarse_fixes
from cwcli.estimation.coarse_speeds import keep_changes_and_standstills_of_coarse_speeds_and_note
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.consistency import effective_sample_count
from cwcli.estimation.contradiction import Contradiction, SourceQuantity
from cwcli.estimation.correction import Correction
from cwcli.estimation.delay_variance import covariance_from_clock_error, covariance_from_unknown_delays, delay_sigmas_s
from cwcli.estimation.fix_scatter import (
    covariance_from_lasting_errors,
    noise_sigma_from_scatter_about_neighbours,
    scatter_about_neighbours,
)
from cwcli.estimation.fixes_behind_gaps import add_jumps_hidden_by_gaps, find_contradictions_of_fixes_behind_gaps
from cwcli.estimation.fixes_of_two_places import (
    covariance_from_fixes_of_two_places,
    find_contradictions_of_fixes_of_two_places,
    find_fixes_of_two_places,
)
from cwcli.estimation.gaps import find_filter_restarts_after_gaps
from cwcli.estimation.jumping_fixes import do_fixes_jump_for_good
from cwcli.estimation.leave_one_out import (
    can_third_source_judge,
    contradiction_of_spoiling_sources,
    empty_series_of_quantities,
    find_spoiling_sources,
    raise_noise_of_fixes_to_reported,
)
from cwcli.estimation.lever_arms import move_states_and_covariances_to_antenna, set_lever_arms_of_user
from cwcli.estimation.limit_check import (
    doubt_sentence_on_lasting_errors,
    find_contradictions_of_changing_latencies,
    find_values_beyond_sensor_limits,
)
from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, Kind, Measurements
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.model import MANOEUVRE_SIGMA_FACTOR_LIMITS, MotionParameters
from cwcli.estimation.net_acceleration import reports_without_net_acceleration
from cwcli.estimation.parameter import Parameter, ParameterStatus, SlowError
from cwcli.estimation.passes import (
    N_MOTION_STATES,
    STATUS_OF_ROW_BEFORE_START,
    FilterStart,
    PassResult,
    SensorSeries,
    notes_on_rows_before_start,
    run_filter_pass,
)
from cwcli.estimation.prepare import (
    PreparedSeries,
    clean_and_sort_measurements_and_note,
    earliest_stamp_ns,
    prepare_without_looking_ahead,
    seconds_since_zero_time,
)
from cwcli.estimation.result import GatedMeasurements, SourceReport, Track
from cwcli.estimation.score import row_log_likelihoods
from cwcli.estimation.sensor_model import SeriesIndexAndErrorName
from cwcli.estimation.sensor_search import FoundSensorModel
from cwcli.estimation.slow_drift import (
    covariance_from_fix_drifts,
    find_contradictions_of_drifting_fixes,
    largest_slow_position_error_or_nan_m,
    slow_changes_along_to_across_or_nan,
)
from cwcli.estimation.song2016 import estimate_track_with_song2016
from cwcli.estimation.source_clocks import align_source_clocks_and_note, notes_on_hidden_clock_steps
from cwcli.estimation.source_judgement import (
    JudgedSources,
    correct_and_list_imu_units_and_tilt,
    correct_and_list_user_faults,
    judge_sources,
)
from cwcli.estimation.standstill_error import (
    covariance_from_standstill_errors,
    standstill_errors_of_best_position_source,
)
from cwcli.estimation.start import (
    find_full_filter_start,
    replace_infinite_start_by_end_of_rows,
    set_states_before_start_in_place,
)
from cwcli.estimation.state_flags import compute_state_flags, covariance_widened_at_rejected_rows
from cwcli.estimation.tune import TunedSeries, tune_latencies_and_noise
from cwcli.kernels.ekf import UpdateStatus
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.metrics.chi_square import chi_square_mean_bounds, nis_gate_limit
from cwcli.signals.columns import FloatArray, Int64Array, StateRows, Strings
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import StateFlag
from cwcli.work_share import part_of_work, report_work

MIN_ROWS_FOR_REPORTED_NIS = 20
"""Least number of rows of a source whose NIS is reported. Chosen by hand; not fitted."""
MIN_WAIT_FOR_POSITION_TO_REFINE_START_S = 3.0
"""Time without a position after the start from which the start is refined, s. Chosen by hand; not fitted."""
MAX_START_REFINEMENT_ROUNDS = 6
"""Greatest number of refinements of the start. Chosen by hand; not fitted."""
MAX_POSITION_CHANGE_OF_CONVERGED_START_M = 0.5
"""The start has converged when its position moves by less than this, m. Chosen by hand; not fitted."""
WORKER_ENVIRONMENT_VARIABLE = "_CWCLI_WORKER"
"""Environment variable that is set in a worker of a run over many logs, where the other workers use the processors."""
Group = TypeVar("Group")
Result = TypeVar("Result")


def estimate_track(
    measurements: Sequence[Measurements],
    config: EstimatorConfig,
    output_stamp_ns: Int64Array | None = None,
) -> Track:
    """Estimate one vehicle's track.

    Args:
        measurements: Any mix of sources and kinds; at least one POSITION.
        output_stamp_ns: Shape (m,), increasing: times of the states. None: a grid of `config.rate_hz` over
            the span of the measurements.

    Raises:
        DataError: If no position is finite.
    """
    if config.model == "song2016":
        return estimate_track_with_song2016(measurements, config, output_stamp_ns)
    if output_stamp_ns is None:
        last_ns = max(int(m.stamp_ns.max()) for m in measurements if len(m))
        step_ns = round(NS_PER_S / config.rate_hz)
        output_stamp_ns = np.arange(earliest_stamp_ns(measurements), last_ns + 1, step_ns, dtype=np.int64)
    return _tune_and_estimate_without_spoiling_source(measurements, config, output_stamp_ns)[1]


def estimate_hindsight_and_online_tracks(
    measurements: Sequence[Measurements],
    config: EstimatorConfig,
    output_stamp_ns: Int64Array,
    *,
    blind: bool,
    online_input: tuple[Sequence[Measurements], Int64Array] | None = None,
) -> tuple[Track, Track]:
    """Estimate a vehicle's track in hindsight and online (by the filter alone); returns both.

    Where the online track uses the parameters of the log, they are searched once for both.

    Args:
        measurements, config, output_stamp_ns: See `estimate_track`; with `config.causal` both tracks are those of the
            filter.
        blind: The online track takes no parameter from the log, see `EstimatorConfig`.
        online_input: Measurements and output stamps of the online track, if they are fewer.

    Raises:
        DataError: If no position is finite.
    """
    online = replace(config, causal=True, blind=blind)
    hindsight = online if config.causal else config
    if online_input is None and not blind and config.model == "cwcli":
        settled, track = _tune_and_estimate_without_spoiling_source(measurements, hindsight, output_stamp_ns)
        return track, track if config.causal else _filter_and_smooth(settled, online, output_stamp_ns)
    known, known_stamp_ns = online_input or (measurements, output_stamp_ns)
    track = estimate_track(known, online, known_stamp_ns)
    if config.causal and online_input is None:
        track = _add_calibration_notes(track, measurements, online)
        return track, track
    found = estimate_track(measurements, hindsight, output_stamp_ns)
    return _add_calibration_notes(found, measurements, hindsight), track


def _add_calibration_notes(track: Track, measurements: Sequence[Measurements], config: EstimatorConfig) -> Track:
    """The track, with a note where its calibration predicts the log worse than what the log says of itself."""
    if config.calibration is None:
        return track
    return replace(track, notes=(*track.notes, *notes_on_worse_prediction_with_calibration(measurements, config)))


@dataclass(frozen=True)
class _TunedMeasurements:
    """Series before and after tuning, with the stamp of second 0 and notes.

    `contradictions`, `corrections` and `unchecked` are what the sources show before anything is estimated.
    `measurements` are those before cleaning, their clocks aligned.
    """

    epoch_ns: int
    prepared: list[PreparedSeries]
    tuned: TunedSeries
    notes: tuple[str, ...]
    contradictions: tuple[Contradiction, ...] = ()
    corrections: tuple[Correction, ...] = ()
    measurements: Sequence[Measurements] = ()
    unchecked: frozenset[SourceQuantity] = frozenset()


def _prepare_and_tune(measurements: Sequence[Measurements], config: EstimatorConfig) -> _TunedMeasurements:
    """Clean the measurements, and tune latencies, noise and sensor errors.

    Raises:
        DataError: If no position is finite.
    """
    if not any(m.kind is Kind.POSITION and np.isfinite(m.values).all(axis=1).any() for m in measurements):
        raise DataError("no finite position among the measurements")
    clock_notes: list[str] = []
    if config.compares_sources:
        measurements, clock_notes = align_source_clocks_and_note(
            measurements,
            corrects=not (config.blind or config.takes_no_online_parameter_from_log),
            trusted=config.sources_with_trusted_clock,
        )
    positions = [m for m in measurements if m.kind is Kind.POSITION]
    zero_ns = earliest_stamp_ns(
        positions if config.blind else measurements
    )  # a row that comes later may be of an earlier time

    def prepare_series_with_lever_arms(current: Sequence[Measurements]) -> tuple[list[PreparedSeries], list[str]]:
        prepared, notes = _prepare_series_and_notes(current, zero_ns, config)
        return set_lever_arms_of_user(prepared, config.lever_arms), notes

    aligned = measurements
    measurements, by_user = correct_and_list_user_faults(measurements, config.source_units)
    trusted = {*config.trusted_sources, *config.source_units}
    # Where no state may depend on what the whole log shows, it is told, and nothing is changed.
    looks_ahead = not (config.blind or (config.causal and config.calibration is not None))
    if config.compares_sources:
        judged_sources = judge_sources(
            measurements,
            prepare_series_with_lever_arms,
            trusted=trusted,
            looks_ahead=looks_ahead,
        )
    else:
        corrected, found = (
            correct_and_list_imu_units_and_tilt(measurements, trusted) if looks_ahead else (measurements, [])
        )
        judged_sources = JudgedSources(*prepare_series_with_lever_arms(corrected), tuple(found), ())
    if looks_ahead:
        prepared, coarse_notes = keep_changes_and_standstills_of_coarse_speeds_and_note(judged_sources.prepared)
        judged_sources = replace(judged_sources, prepared=prepared, notes=[*judged_sources.notes, *coarse_notes])
    corrections = (*by_user, *judged_sources.corrections)
    notes = (
        *clock_notes,
        *(each.sentence_on_fault_and_undoing for each in corrections),
        *(
            f"{each.contradiction_sentence}; {each.votes_and_left_out_sources_text}"
            for each in judged_sources.contradictions
        ),
        *judged_sources.notes,
    )
    tuned = tune_latencies_and_noise(judged_sources.prepared, config, MotionParameters())
    return _TunedMeasurements(
        zero_ns,
        judged_sources.prepared,
        tuned,
        notes,
        judged_sources.contradictions,
        corrections,
        aligned,
        judged_sources.unchecked,
    )


def _tune_and_estimate_without_spoiling_source(
    measurements: Sequence[Measurements], config: EstimatorConfig, output_stamp_ns: Int64Array
) -> tuple[_TunedMeasurements, Track]:
    """Tune and estimate, without a source that spoils all others; see `leave_one_out`."""
    with part_of_work(0.0, 0.8):
        settled = _prepare_and_tune(measurements, config)
    with part_of_work(0.8, 0.9):
        track = _filter_and_smooth(settled, config, output_stamp_ns)
    if not config.compares_sources or config.blind or config.calibration is not None:
        return settled, track
    tried: dict[tuple[SourceQuantity, ...], tuple[_TunedMeasurements, Track]] = {}

    def reports_without(quantities: tuple[SourceQuantity, ...]) -> Sequence[SourceReport]:
        prepared = empty_series_of_quantities(settled.prepared, quantities)
        tuned = tune_latencies_and_noise(prepared, config, MotionParameters())
        one_less = replace(settled, prepared=prepared, tuned=tuned)
        tried[quantities] = one_less, _filter_and_smooth(one_less, config, output_stamp_ns)
        return tried[quantities][1].sources

    if _do_any_fixes_jump_for_good(settled.prepared) or any(each.explains_misfits for each in track.contradictions):
        # Some of the fixes are wrong themselves, and no other source is to be blamed for it.
        return settled, track
    left_out = find_spoiling_sources(track.sources, reports_without, {*config.trusted_sources, *config.source_units})
    if not left_out:
        return settled, track
    better, track_without = tried[left_out]
    found = contradiction_of_spoiling_sources(track_without.sources, left_out, settled.prepared)
    # Of an IMU with another wrong part it is known that it is the wrong one.
    is_known_wrong = any(left_out[0].source == each.source for c in settled.contradictions for each in c.left_out)
    if not is_known_wrong and not can_third_source_judge(track.sources, left_out):
        series = tuple(raise_noise_of_fixes_to_reported(better.tuned.series, track.sources))
        delays = better.tuned.delay_sigmas.elementwise_max(settled.tuned.delay_sigmas)
        better = replace(better, tuned=replace(better.tuned, series=series, delay_sigmas=delays))
    notes = (*better.notes, f"{found.contradiction_sentence}; {found.votes_and_left_out_sources_text}")
    better = replace(better, contradictions=(*better.contradictions, found), notes=notes)
    return better, _filter_and_smooth(better, config, output_stamp_ns)


def _do_any_fixes_jump_for_good(prepared: Sequence[PreparedSeries]) -> bool:
    fixes = (p.series for p in prepared if p.series.kind is Kind.POSITION and len(p.series) > 2)
    return any(
        do_fixes_jump_for_good(
            s.time_s, s.values, max(scatter_about_neighbours(s.values[:, k : k + 1]) for k in (0, 1))
        )
        for s in fixes
    )


def _filter_and_smooth(
    tuned_measurements: _TunedMeasurements, config: EstimatorConfig, output_stamp_ns: Int64Array
) -> Track:
    """Find the start, filter and smooth; for `config` and `output_stamp_ns` see `estimate_track`."""
    prepared, tuned, notes = tuned_measurements.prepared, tuned_measurements.tuned, list(tuned_measurements.notes)
    output_s = seconds_since_zero_time(output_stamp_ns, tuned_measurements.epoch_ns)
    start = find_full_filter_start(tuned.series, tuned.prior, causal=config.causal)
    start.state[N_MOTION_STATES:] = tuned.mean[N_MOTION_STATES:]
    start = replace_infinite_start_by_end_of_rows(start, tuned.series, output_s)
    if not config.causal:
        start = _refine_start_by_smoothing(tuned, start, config.reset_after)
    restarts = find_filter_restarts_after_gaps(tuned.series, causal=config.causal)
    result = run_filter_pass(
        tuned.series, start, tuned.motion, output_s,
        smooth=not config.causal, reset_after=config.reset_after,
        restarts=restarts,
    )  # fmt: skip
    if config.causal:
        set_states_before_start_in_place(
            result.state, result.covariance, tuned.series, start_s=start.time_s, output_s=output_s, prior=tuned.prior
        )
        notes += notes_on_rows_before_start(tuned.series, result)
    reports = tuple(
        replace(report, is_checked=SourceQuantity(report.source, report.kind) not in tuned_measurements.unchecked)
        for report in (_build_source_report(p, tuned, i, result, output_s) for i, p in enumerate(prepared))
    )
    reports = add_jumps_hidden_by_gaps(tuned.series, result.nis, result.status, reports)
    flags = compute_state_flags(
        tuned.series, result.status, output_s, start=start, restarts=restarts, causal=config.causal
    )
    if config.calibration is None and not config.blind:  # else the mountings are not from this drive
        # The filter alone does not know the speed at its start.
        known = (flags & StateFlag.STARTING == 0) | (not config.causal)
        reports = reports_without_net_acceleration(reports, output_stamp_ns[known], result.state[known])
    notes += tuned.notes
    if config.calibration is not None:
        for s, report in zip(tuned.series, reports, strict=True):
            notes += bias_contradiction_notes(s, report.bias, report.bias_sigma, config.calibration)
    for r in reports:
        if r.n_resets and r.kind not in KINDS_THAT_IMU_MEASURES_TOO:
            often = "once" if r.n_resets == 1 else f"{r.n_resets} times"
            notes.append(f"{r.source}: {r.kind.name.lower()} used again after repeated rejections by the gate, {often}")
    jumped = [r.source for r in reports if r.n_resets and r.kind is Kind.POSITION]
    notes += notes_on_hidden_clock_steps(tuned_measurements.measurements, jumped)
    state, covariance = move_states_and_covariances_to_antenna(tuned.series, result.state, result.covariance)
    if config.causal:
        covariance = covariance_widened_at_rejected_rows(covariance, tuned.series, result, output_s)

    def states_of(series: Sequence[SensorSeries]) -> StateRows:
        pass_at_antenna = run_filter_pass(
            series, start, tuned.motion, output_s,
            smooth=not config.causal, reset_after=config.reset_after, restarts=restarts,
        )  # fmt: skip
        return move_states_and_covariances_to_antenna(series, pass_at_antenna.state, pass_at_antenna.covariance)[0]

    two_places = find_fixes_of_two_places([] if config.blind else tuned.series, output_s, state)
    sigmas_s = delay_sigmas_s(tuned.series, tuned.latencies, tuned.delay_sigmas)
    covariance = (
        covariance
        + covariance_from_unknown_delays(tuned.series, sigmas_s, state, states_of, causal=config.causal)
        + covariance_from_clock_error(state, tuned.delay_sigmas.clock)
        + covariance_from_coarse_fixes(tuned.series)
        + covariance_from_fixes_of_two_places(two_places)
    )
    if not config.blind and not (config.causal and config.calibration is not None):
        without_model = [s for i, s in enumerate(tuned.series) if i not in tuned.sensors.model.slow]
        errors = standstill_errors_of_best_position_source(without_model, output_s, state, covariance)
        covariance = covariance + covariance_from_standstill_errors(state, errors)
        covariance = covariance + covariance_from_fix_drifts(reports) + covariance_from_lasting_errors(reports)
    contradictions = tuned_measurements.contradictions
    if not config.blind:
        contradictions = (
            *contradictions,
            *find_contradictions_of_fixes_of_two_places(two_places),
            *find_contradictions_of_fixes_behind_gaps(tuned.series, result.nis, result.status, reports),
        )
        contradictions = (*contradictions, *find_values_beyond_sensor_limits(reports, contradictions))
        contradictions = (*contradictions, *find_contradictions_of_changing_latencies(reports, contradictions))
        if not contradictions and (doubt := doubt_sentence_on_lasting_errors(reports)):
            notes.append(doubt)
    return Track(
        output_stamp_ns,
        state,
        covariance,
        flags,
        reports,
        result.log_likelihood,
        tuple(notes),
        {name: getattr(tuned.parameters, name) for name in MANOEUVRE_SIGMA_FACTOR_LIMITS},
        _collect_gated_rows(tuned, result, tuned_measurements.epoch_ns, config.gate_probability),
        contradictions
        if config.blind
        else (*contradictions, *find_contradictions_of_drifting_fixes(reports, contradictions)),
        tuned_measurements.corrections,
    )


def _collect_gated_rows(tuned: TunedSeries, result: PassResult, zero_ns: int, probability: float) -> GatedMeasurements:
    """Collect the rows of all series that the gate rejected."""
    rows = [np.flatnonzero(status == UpdateStatus.GATED) for status in result.status]
    counts = [len(own) for own in rows]
    time_s = np.concatenate([s.time_s[own] for s, own in zip(tuned.series, rows, strict=True)])
    nis = np.concatenate([found[own, 0] for found, own in zip(result.nis, rows, strict=True)])
    code = np.repeat(np.arange(len(rows), dtype=np.int32), counts)
    bound = np.array([nis_gate_limit(probability, s.n_values_per_row) for s in tuned.series])[code]
    order = np.argsort(time_s, kind="stable")
    return GatedMeasurements(
        zero_ns + np.rint(time_s[order] * NS_PER_S).astype(np.int64),
        Strings(code[order], tuple(s.source for s in tuned.series)).merge_equal_values(),
        Strings(code[order], tuple(s.kind.name.lower() for s in tuned.series)).merge_equal_values(),
        nis[order],
        bound[order],
    )


def _prepare_series_and_notes(
    measurements: Sequence[Measurements], zero_ns: int, config: EstimatorConfig
) -> tuple[list[PreparedSeries], list[str]]:
    """Return the series and notes, with the calibration if there is one, and without looking ahead where required."""
    calibration = config.calibration
    if calibration is None:
        return (
            (prepare_without_looking_ahead(measurements, zero_ns, {}), [])
            if config.blind
            else clean_and_sort_measurements_and_note(measurements, zero_ns)
        )
    unknown = require_known_sources_and_note_unknown(
        calibration, measurements, causal=config.causal and not config.blind
    )
    mountings = calibrated_imu_mountings(calibration)
    if config.causal:
        return apply_calibrated_noise_and_empty_unknown(
            prepare_without_looking_ahead(measurements, zero_ns, mountings), calibration
        ), unknown
    prepared, notes = clean_and_sort_measurements_and_note(measurements, zero_ns, mountings)
    return prepared, [*unknown, *notes]


def _refine_start_by_smoothing(tuned: TunedSeries, start: FilterStart, reset_after: int) -> FilterStart:
    """Refine the start by the smoother if the first position comes long after it.

    Until the first position place, speed and heading are hardly known, and a filter that is linearised far from the
    truth becomes sure of a wrong state. The covariance of the start is kept.
    """
    first_s = min(float(s.time_s[0] - s.latency_s) for s in tuned.series if s.kind is Kind.POSITION and len(s))
    if first_s - start.time_s < MIN_WAIT_FOR_POSITION_TO_REFINE_START_S:
        return start
    start_time_s = np.array([start.time_s])
    for _ in range(MAX_START_REFINEMENT_ROUNDS):
        found = run_filter_pass(tuned.series, start, tuned.motion, start_time_s, smooth=True, reset_after=reset_after)
        state = found.state[0]
        if not np.isfinite(state).all():
            break
        moved_m = float(np.hypot(*(state[:2] - start.state[:2])))
        start = replace(start, state=state)
        if moved_m < MAX_POSITION_CHANGE_OF_CONVERGED_START_M:
            break
    return start


def _build_source_report(
    prepared_series: PreparedSeries, tuned: TunedSeries, i: int, result: PassResult, output_s: FloatArray
) -> SourceReport:
    s, latency, stated = tuned.series[i], tuned.latencies[i], prepared_series.series
    nis, status = result.nis[i][:, 0], result.status[i]
    mean, bounds, inside = float("nan"), (float("nan"), float("nan")), None
    if int((status != STATUS_OF_ROW_BEFORE_START).sum()) >= MIN_ROWS_FOR_REPORTED_NIS:
        was_used = (
            nis[status >= UpdateStatus.USED]
            if (status >= UpdateStatus.USED).any()
            else nis[status == UpdateStatus.GATED]
        )
        mean = float(was_used.mean())
        bounds = chi_square_mean_bounds(s.n_values_per_row, effective_sample_count(was_used))
        inside = bounds[0] <= mean <= bounds[1]
    bias, bias_sigma = float("nan"), float("nan")
    if s.bias_state >= 0 and len(result.state):
        middle = len(result.state) // 2
        bias = float(result.state[middle, s.bias_state])
        bias_sigma = float(np.sqrt(max(result.covariance[middle, s.bias_state, s.bias_state], 0.0)))
    found, slow = tuned.sensors, tuned.sensors.model.slow.get(i)
    variance = s.noise[:, 0] if s.n_values_per_row == 1 else 0.5 * (s.noise[:, 0] + s.noise[:, 2])
    return SourceReport(
        source=s.source,
        kind=s.kind,
        n_read=prepared_series.n_read,
        n_used=int((status >= UpdateStatus.USED).sum()),
        n_gated=int((status == UpdateStatus.GATED).sum()),
        n_not_finite=prepared_series.n_not_finite,
        n_interpolated=prepared_series.n_interpolated,
        n_repeated=prepared_series.n_repeated,
        n_held_back=prepared_series.n_held_back,
        n_resets=int((status == UpdateStatus.USED_AFTER_RESET).sum()),
        nis_mean=mean,
        nis_dof=s.n_values_per_row,
        nis_bounds=bounds,
        nis_inside=inside,
        sigma=float(np.sqrt(variance.mean())) if len(s) else float("nan"),
        scatter=float("nan") if s.kind in KINDS_THAT_IMU_MEASURES_TOO else noise_sigma_from_scatter_about_neighbours(s),
        log_likelihood=float(np.nansum(row_log_likelihoods(s, result.nis[i]))),
        noise_origin=s.noise_origin,
        noise_scale=(
            float(s.noise[:, 0].mean() / stated.noise[:, 0].mean())
            if stated.noise_origin.startswith("message") and len(s)
            else float("nan")
        ),
        stamp_error=s.stamp_error,
        interval_s=median_of_finite_values(np.diff(s.time_s)) if len(s) > 1 else float("nan"),
        latency=latency,
        latency_to_reference=tuned.latencies_to_reference[i],
        mounting=prepared_series.mounting,
        bias=bias,
        bias_sigma=bias_sigma,
        scale=_parameter_from_last_state(found, (i, "scale"), s.scale_state, result, 1.0),
        lever_arm_m=_parameter_from_last_state(found, (i, "lever"), s.lever_state, result, 0.0),
        ahead_m=_parameter_from_last_state(found, (i, "ahead"), s.ahead_state, result, 0.0),
        slow_error=SlowError(
            found.beyond.get((i, "slow"), float("nan")) if slow is None else slow.sigma,
            float("nan") if slow is None else slow.time_s,
            found.status.get((i, "slow"), ParameterStatus.OFF),
            largest_slow_position_error_or_nan_m(s, result.state),
            slow_changes_along_to_across_or_nan(s, output_s, result.state),
        ),
        follows_pitch_rate=i in found.model.pitch_compensated,
    )


def _parameter_from_last_state(
    found_model: FoundSensorModel, error: SeriesIndexAndErrorName, state_index: int, result: PassResult, offset: float
) -> Parameter:
    """Return a constant of a source from the last filter state; `offset` is its value at state 0."""
    status = found_model.status.get(error, ParameterStatus.OFF)
    if state_index < 0:
        return Parameter(found_model.beyond.get(error, float("nan")), status=status)
    sigma = float(np.sqrt(max(result.last_covariance[state_index, state_index], 0.0)))
    return Parameter(offset + float(result.last_state[state_index]), sigma, status)


def estimate_tracks(
    groups: Sequence[tuple[Sequence[Measurements], Int64Array | None]],
    config: EstimatorConfig,
) -> list[Track]:
    """Estimate many vehicles' tracks, in threads: `estimate_track` for each (measurements, output stamps)."""
    return map_in_threads(lambda group: estimate_track(group[0], config, group[1]), groups)


def map_in_threads(estimate: Callable[[Group], Result], groups: Sequence[Group]) -> list[Result]:
    """Apply `estimate` to each group in threads; a worker process uses only one thread."""
    if len(groups) < 2 or WORKER_ENVIRONMENT_VARIABLE in os.environ:
        return [estimate(group) for group in groups]
    n_threads = min(len(groups), os.cpu_count() or 1)
    with ThreadPoolExecutor(n_threads, initializer=bound_array_memory_and_get_old_handler) as pool:
        found = []
        for result in pool.map(estimate, groups):
            found.append(result)
            report_work("vehicles", len(found), len(groups))
        return found
