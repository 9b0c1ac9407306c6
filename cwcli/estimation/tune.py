"""Tune latencies, sensor errors, noise and manoeuvre intensity from the log before the last pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cwcli.estimation.calibrated import (
    fuse_latencies_with_calibration_and_note,
    motion_with_calibrated_manoeuvres,
    prior_means_and_variances_from_calibration,
    sensor_model_from_calibration,
)
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.delay_variance import DelaySigmas, delay_sigmas_of_best_known_sources, unphysical_lead_of_fixes_s
from cwcli.estimation.latency import (
    MIN_SIGNIFICANT_SIGMAS,
    MS_PER_MINUTE_OF_UNIT_DRIFT,
    Latency,
    LatencyStatus,
    is_latency_reference_by_series,
    latencies_known_without_search,
    mark_latency_beyond_limits,
    remove_latency_drift,
)
from cwcli.estimation.latency_clock import (
    SourceLatency,
    disputed_clock_sigma_s,
    shift_latencies_to_agreed_clock_and_note,
)
from cwcli.estimation.latency_odometry import refine_position_latencies
from cwcli.estimation.latency_search import find_latencies
from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import MotionParameters, motion_of_simulated_vehicle
from cwcli.estimation.noise import WindowFits, estimate_noise_and_manoeuvres
from cwcli.estimation.passes import N_MOTION_STATES, SensorSeries
from cwcli.estimation.prepare import PreparedSeries
from cwcli.estimation.sensor_model import SensorModel, StateLayout, add_sensor_error_states
from cwcli.estimation.sensor_search import (
    FoundSensorModel,
    find_sensor_errors,
    keep_sensor_model_if_better,
    may_show_sensor_errors,
    series_whose_forward_arm_may_be_latency,
)
from cwcli.estimation.trial import SEARCH_PROGRESS_UNIT_NAME, USUAL_PASSES_PER_SEARCH
from cwcli.kernels import ekf
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.metrics.chi_square import nis_gate_limit
from cwcli.signals.columns import FloatArray
from cwcli.work_share import part_of_work

ACCEL_BIAS_PRIOR_SIGMA_MPS2 = 3.0
"""One sigma of an accelerometer's bias, m/s^2. Chosen: gravity through 18 degrees of pitch."""
YAW_RATE_BIAS_PRIOR_SIGMA_RADPS = 0.02
"""One sigma of a gyroscope's bias, rad/s. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class TunedSeries:
    """Series with final latency, noise, bias states and gates.

    Attributes:
        series, latencies: Parallel to what was prepared.
        motion: Motion model, with the random walks of the parameter states.
        mean, prior: Shape (n,): prior means and variances of the parameter states; motion states are zero there.
        latencies_to_reference: Latencies found in the log, relative to the reference, see `SourceReport`.
        parameters: Parameters of the motion model.
        sensors: Sensor errors that were found besides white noise.
        notes: Remarks for the user.
        delay_sigmas: What is not known of the delays.
    """

    series: tuple[SensorSeries, ...]
    latencies: tuple[Latency, ...]
    motion: ekf.ProcessModel
    mean: FloatArray
    prior: FloatArray
    latencies_to_reference: tuple[Latency, ...]
    parameters: MotionParameters
    sensors: FoundSensorModel
    notes: tuple[str, ...]
    delay_sigmas: DelaySigmas = DelaySigmas()


def tune_latencies_and_noise(
    prepared: Sequence[PreparedSeries], config: EstimatorConfig, parameters: MotionParameters
) -> TunedSeries:
    """Find latencies, noise and manoeuvre intensity, and lay out the parameter states.

    Args:
        prepared: All series; at least one POSITION with a row.
        parameters: Motion model to begin with.
    """
    series, walk, prior = add_bias_states_and_their_variances(prepared, parameters)
    search = _ParameterSearch(StateLayout(series, parameters, walk, prior), config)
    (compared, latencies, moved_clock, clock_sigma_s), sensors = search.find_latencies_and_sensor_errors()
    layout = search.layout_with_latencies_and_errors(latencies, sensors.model)
    mean, prior = np.zeros_like(layout.prior), layout.prior
    if config.calibration is not None:
        mean, prior = prior_means_and_variances_from_calibration(layout.series, prior, config.calibration)
    if layout.series and all(s.is_exact for s in layout.series):
        series, parameters = layout.series, motion_of_simulated_vehicle(layout.parameters)
    elif config.calibration is not None and config.causal:
        series, parameters = layout.series, motion_with_calibrated_manoeuvres(layout.parameters, config.calibration)
    elif config.blind:
        series, parameters = layout.series, layout.parameters
    else:
        settled = estimate_noise_and_manoeuvres(layout, known_fits=search.window_fits)
        series, parameters = settled.series, settled.parameters
    gated = tuple(
        s if s.is_exact else replace(s, gate_nis=nis_gate_limit(config.gate_probability, s.n_values_per_row))
        for s in series
    )

    def of_three_sigma(latency: Latency) -> str:  # by the scatter over the log
        reach_ms = 1e3 * MIN_SIGNIFICANT_SIGMAS * latency.reach_s
        return f" (it may be up to {reach_ms:.0f} ms)" if np.isfinite(reach_ms) else ""

    unknown = (
        f"{s.source}: the latency of {s.kind.name.lower()} is not observable"
        # three sigma, by the scatter over the log
        + of_three_sigma(latency)
        + " and not corrected"
        for s, latency in zip(series, latencies, strict=True)
        if latency.status is LatencyStatus.NOT_OBSERVABLE and len(s) and not config.blind
    )
    drifting = (
        f"{s.source}: latency of {s.kind.name.lower()} drifts by {MS_PER_MINUTE_OF_UNIT_DRIFT * latency.drift:.0f} ms "
        "per minute, corrected along a line"
        for s, latency in zip(series, latencies, strict=True)
        if latency.status is LatencyStatus.DRIFTS
    )
    early = (
        f"{s.source}: its fixes seem {-1e3 * latency.applied_s:.0f} ms early; if its antenna is ahead of the rear "
        "axle, say so with --lever-arm"
        for s, latency in zip(series, latencies, strict=True)
        if unphysical_lead_of_fixes_s(s, latency)
    )
    return TunedSeries(
        gated,
        tuple(latencies),
        parameters.to_process_model(layout.walk),
        mean,
        prior,
        tuple(compared),
        parameters,
        sensors,
        (*moved_clock, *unknown, *drifting, *early),
        delay_sigmas_of_best_known_sources(series, latencies, clock_sigma_s),
    )


class _FoundLatencies(NamedTuple):
    """Latencies of all series, with notes.

    Attributes:
        compared: Found in the log, relative to the reference.
        applied: To correct.
        notes: Remarks for the user.
        clock_sigma_s: One sigma of the clock that the sources share, s.
    """

    compared: list[Latency]
    applied: list[Latency]
    notes: list[str]
    clock_sigma_s: float


class _ParameterSearch:
    """Search for latencies and sensor errors of one log; equal layouts are made and fitted once.

    Attributes:
        window_fits: Noise of the layouts so far.
    """

    def __init__(self, base: StateLayout, config: EstimatorConfig) -> None:
        """Begin with the series with their biases alone; stamps as they are."""
        self._base, self._config = base, config
        self._predetermined = latencies_known_without_search(base.series, config)
        self.window_fits: WindowFits = {}
        self._layouts: list[tuple[Sequence[Latency], SensorModel, StateLayout]] = []

    def find_latencies_and_sensor_errors(self) -> tuple[_FoundLatencies, FoundSensorModel]:
        """Find latencies and sensor errors in turn, each with the current values of the other."""
        base, config = self._base, self._config
        with part_of_work(0.0, 0.55):
            latencies = self._find_and_decide_latencies(base)
        if config.sensor_model == "none":
            return latencies, FoundSensorModel()
        if config.calibration is not None and config.causal:
            return latencies, sensor_model_from_calibration(base.series, config.calibration)
        if config.blind:
            return latencies, FoundSensorModel()
        # The likeliest latencies, clear or not: what is found with them then moves with the stamps.
        likeliest = _correct_stamps(base, latencies.compared, likeliest=True)
        if not may_show_sensor_errors(likeliest.series):
            return latencies, FoundSensorModel()
        with part_of_work(0.55, 0.8, SEARCH_PROGRESS_UNIT_NAME, USUAL_PASSES_PER_SEARCH):
            found = find_sensor_errors(self._estimate_noise_roughly(likeliest))
        if found.model.modelled_errors and None in self._predetermined:
            with part_of_work(0.8, 0.95):
                latencies = self._find_and_decide_latencies(add_sensor_error_states(base, found.model))
            remaining_s = [each.remaining_sigma_s for each in latencies.applied]
            unclear = series_whose_forward_arm_may_be_latency(found, base.series, remaining_s)
            notes = notes_on_arms_that_may_be_latencies(base.series, found.ahead_m, unclear)
            if unclear:  # a latency or a place: of the two the latency is the likelier
                found = found.mark_forward_arms_unobservable(unclear)
                latencies = self._find_and_decide_latencies(add_sensor_error_states(base, found.model))
            corrected = self.layout_with_latencies_and_errors(latencies.applied, SensorModel())
            if found.model.ahead or [s.latency_s for s in corrected.series] != [s.latency_s for s in likeliest.series]:
                remaining_s = [each.remaining_sigma_s for each in latencies.applied]
                found = find_sensor_errors(self._estimate_noise_roughly(corrected), found, remaining_s)
            if not found.model.ahead.intersection(unclear):
                latencies = latencies._replace(notes=[*latencies.notes, *notes])
        if not found.model.modelled_errors:
            return latencies, found
        plain, modelled = (
            self.layout_with_latencies_and_errors(latencies.applied, model) for model in (SensorModel(), found.model)
        )
        return latencies, keep_sensor_model_if_better(
            found, self._estimate_noise_roughly(plain), self._estimate_noise_roughly(modelled)
        )

    def layout_with_latencies_and_errors(self, latencies: Sequence[Latency], model: SensorModel) -> StateLayout:
        """Return the layout with these latencies corrected and these errors as states; the same one if asked again."""
        for known_latencies, known_model, layout in self._layouts:
            if (known_latencies, known_model) == (latencies, model):
                return layout
        layout = add_sensor_error_states(_correct_stamps(self._base, latencies), model)
        self._layouts.append((latencies, model, layout))
        return layout

    def _estimate_noise_roughly(self, layout: StateLayout) -> StateLayout:
        """Return the layout with noise and manoeuvre intensity estimated from a window of the log."""
        return estimate_noise_and_manoeuvres(layout, every_row=False, known_fits=self.window_fits)

    def _find_and_decide_latencies(self, layout: StateLayout) -> _FoundLatencies:
        """Find the latencies in the log, and decide which are applied.

        A latency beyond what sensors have is no latency: other drives are not told of it, and it is not corrected.

        A slow error of the fixes takes no part: it would hide a latency, and the scatter over the log's blocks, which
        is a latency's sigma, has it already.
        """
        config, predetermined = self._config, self._predetermined
        series = [replace(s, slow_state=-1) if s.kind is Kind.POSITION else s for s in layout.series]
        if config.blind:
            compared = [Latency(LatencyStatus.NOT_OBSERVABLE) if role is None else role for role in predetermined]
        else:
            compared = find_latencies(replace(layout, series=series), predetermined)
        if config.calibration is None and not config.blind:
            compared = refine_position_latencies(series, compared)
        found = [mark_latency_beyond_limits(each) for each in compared]
        compared = [
            Latency(LatencyStatus.NOT_OBSERVABLE) if each.status is LatencyStatus.CONTRADICTS else each
            for each in found
        ]
        if config.calibration is None:
            references = is_latency_reference_by_series(series)
            decided = [
                SourceLatency(s.source, s.kind, is_reference, latency)
                for s, is_reference, latency in zip(series, references, found, strict=True)
            ]
            latencies, notes = shift_latencies_to_agreed_clock_and_note(decided)
            clock_sigma_s = disputed_clock_sigma_s(decided, latencies)
        else:
            clock_sigma_s = 0.0
            latencies, notes = fuse_latencies_with_calibration_and_note(
                series, found, config.calibration, causal=config.causal
            )
        applied = [mark_latency_beyond_limits(each) for each in latencies]
        return _FoundLatencies(compared, applied, notes, clock_sigma_s)


def notes_on_arms_that_may_be_latencies(
    series: Sequence[SensorSeries], ahead_m: Mapping[int, tuple[float, float]], unclear: Sequence[int]
) -> list[str]:
    """Return notes on fixes that are late or those of an antenna ahead: with a latency the arm that was found is lost.

    Args:
        series: All series.
        ahead_m: Index of a series -> lever arm ahead that was found beside a latency, and its sigma.
        unclear: Those that are not used, because a latency explains as much.
    """
    return [
        f"{series[i].source}: its fixes are late, or its antenna stands about {ahead_m[i][0]:.1f} m ahead of the rear "
        "axle, which this log does not tell apart; say so with --latency or --lever-arm"
        for i in unclear
        if series[i].kind is Kind.POSITION and ahead_m[i][0] > MIN_SIGNIFICANT_SIGMAS * ahead_m[i][1]
    ]


def _correct_stamps(layout: StateLayout, latencies: Sequence[Latency], *, likeliest: bool = False) -> StateLayout:
    """Correct the stamps of a layout by the latencies; with `likeliest` also by those that are not significant."""
    corrections = [
        latency.found_s
        if likeliest and np.isfinite(latency.found_s) and latency.status is not LatencyStatus.CONTRADICTS
        else latency.applied_s
        for latency in latencies
    ]
    series = [
        replace(remove_latency_drift(s, latency), latency_s=found_s)
        for s, latency, found_s in zip(layout.series, latencies, corrections, strict=True)
    ]
    return replace(layout, series=series)


def add_bias_states_and_their_variances(
    prepared: Sequence[PreparedSeries], parameters: MotionParameters
) -> tuple[list[SensorSeries], FloatArray, FloatArray]:
    """Give every IMU series a bias state. Returns series, random walk variances and prior variances, both (n,)."""
    series, walk, prior = [], [0.0] * N_MOTION_STATES, [0.0] * N_MOTION_STATES
    for p in prepared:
        if p.has_bias and len(p.series):
            series.append(replace(p.series, bias_state=len(walk)))
            accel = p.series.kind is Kind.ACCEL
            walk.append((parameters.accel_bias_walk if accel else parameters.yaw_rate_bias_walk) ** 2)
            prior.append((ACCEL_BIAS_PRIOR_SIGMA_MPS2 if accel else YAW_RATE_BIAS_PRIOR_SIGMA_RADPS) ** 2)
        else:
            series.append(p.series)
    return series, np.array(walk), np.array(prior)
