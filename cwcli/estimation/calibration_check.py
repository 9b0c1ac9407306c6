"""Check whether a calibration fits a log: its rows are predicted with the calibration's constants and with its own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.calibrated import apply_calibrated_noise_and_empty_unknown, calibrated_imu_mountings
from cwcli.estimation.calibration import Calibration
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.latency import CORRECTED_LATENCY_STATUSES, MIN_SIGNIFICANT_SIGMAS, Latency, LatencyStatus
from cwcli.estimation.lever_arms import set_lever_arms_of_user
from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, QUANTITY_BY_KIND, Kind, Measurements
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.passes import N_MOTION_STATES, SensorSeries, run_filter_pass
from cwcli.estimation.prepare import PreparedSeries, clean_and_sort_measurements_and_note, earliest_stamp_ns
from cwcli.estimation.score import INNOVATION_CAP_PROBABILITY, is_prediction_clearly_better, row_log_likelihoods
from cwcli.estimation.source_judgement import correct_and_list_imu_units_and_tilt
from cwcli.estimation.start import find_full_filter_start
from cwcli.estimation.tune import TunedSeries, tune_latencies_and_noise
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.metrics.chi_square import nis_gate_limit
from cwcli.signals.columns import FloatArray

MIN_REPORTED_LOG_LIKELIHOOD_LOSS_PER_ROW = 0.02
"""Loss of log-likelihood per row of a source from which a note reports it.

Chosen by tests.studies.city_drive: fixes with 0.6 m of noise that are corrected by 100 ms too much lose 0.04, those
with the right calibration less than 0.002; noise that is wrong by 14 % costs as much."""
MAX_LISTED_CONTRADICTIONS = 2
"""Greatest number of contradictions that a note lists; chosen for short notes."""
MIN_LISTED_NOISE_RATIO = 1.25
"""Least ratio of a noise sigma to that of the calibration, or its inverse, that a note lists. Chosen by hand."""


@dataclass(frozen=True)
class _PredictedLog:
    """A log as the filter predicts it: its tuned series, and the log-likelihood of each row by source and kind."""

    tuned: TunedSeries
    scores: dict[tuple[str, Kind], FloatArray]


def notes_on_worse_prediction_with_calibration(
    measurements: Sequence[Measurements], config: EstimatorConfig
) -> list[str]:
    """Return a note if the log is predicted clearly worse with the calibration's constants than with its own; else [].

    The filter alone predicts each row from those before it, for the sources that the calibration knows. The log's own
    constants are found from the whole log; no state depends on this comparison.

    Args:
        measurements: Measurements of the ego; at least one finite POSITION.
    """
    calibration = config.calibration
    assert calibration is not None
    own_config = replace(config, calibration=None, causal=False, blind=False)
    own = _tune_and_predict_log(
        _empty_series_unknown_to_calibration(_prepare_series(measurements, config, None), calibration), own_config
    )
    of_car = apply_calibrated_noise_and_empty_unknown(_prepare_series(measurements, config, calibration), calibration)
    calibrated = _tune_and_predict_log(of_car, replace(config, causal=True, blind=True))
    gains = _row_log_likelihood_gains_of_own_constants(own, calibrated)
    worse = [
        (source, kind)
        for (source, kind), gain in gains.items()
        if float(gain.mean()) >= MIN_REPORTED_LOG_LIKELIHOOD_LOSS_PER_ROW and is_prediction_clearly_better(gain, 0.0)
    ]
    total = sum(float(gain.sum()) for gain in gains.values())
    if not worse or total <= 0.0:
        return []
    names = ", ".join(f"{kind.name.lower()} of {source}" for source, kind in worse)
    contradictions = _texts_on_differing_latencies_and_noises(own, calibrated, calibration)
    return [
        f"the calibration {calibration.name} makes this log worse: with its constants the filter predicts the {names} "
        f"worse than with what the log says of itself (log-likelihood {-total:.0f})"
        + "".join(f"; {each}" for each in contradictions)
    ]


def _prepare_series(
    measurements: Sequence[Measurements], config: EstimatorConfig, calibration: Calibration | None
) -> list[PreparedSeries]:
    mountings = {} if calibration is None else calibrated_imu_mountings(calibration)
    prepared, _ = clean_and_sort_measurements_and_note(
        correct_and_list_imu_units_and_tilt(measurements)[0], earliest_stamp_ns(measurements), mountings
    )
    return set_lever_arms_of_user(prepared, config.lever_arms)


def _empty_series_unknown_to_calibration(
    prepared: Sequence[PreparedSeries], calibration: Calibration
) -> list[PreparedSeries]:
    """Return the series with their own noise; those that the calibration does not know become empty."""
    calibrated_series = apply_calibrated_noise_and_empty_unknown(prepared, calibration)
    return [own if len(known.series) else known for own, known in zip(prepared, calibrated_series, strict=True)]


def _tune_and_predict_log(prepared: Sequence[PreparedSeries], config: EstimatorConfig) -> _PredictedLog:
    tuned = tune_latencies_and_noise(prepared, config, MotionParameters())
    series = [replace(s, gate_nis=nis_gate_limit(INNOVATION_CAP_PROBABILITY, s.n_values_per_row)) for s in tuned.series]
    start = find_full_filter_start(series, tuned.prior, causal=True)
    start.state[N_MOTION_STATES:] = tuned.mean[N_MOTION_STATES:]
    result = run_filter_pass(series, start, tuned.motion, np.zeros(0), smooth=False, reset_after=config.reset_after)
    scores = {
        (s.source, s.kind): row_log_likelihoods(s, nis)
        for s, nis in zip(series, result.nis, strict=True)
        if s.kind not in KINDS_THAT_IMU_MEASURES_TOO and len(s)
    }
    return _PredictedLog(tuned, scores)


def _row_log_likelihood_gains_of_own_constants(
    own: _PredictedLog, calibrated: _PredictedLog
) -> dict[tuple[str, Kind], FloatArray]:
    """Return the log-likelihood that the log's own constants gain per row, by source and kind."""
    gains = {}
    for key, score in own.scores.items():
        other = calibrated.scores.get(key)
        if other is not None and len(other) == len(score):
            gain = score - other
            gains[key] = gain[np.isfinite(gain)]
    return {key: gain for key, gain in gains.items() if len(gain)}


def _texts_on_differing_latencies_and_noises(
    own: _PredictedLog, calibrated: _PredictedLog, calibration: Calibration
) -> list[str]:
    """Return texts on what differs most, with both values: latencies in units of their sigmas, then the noise."""
    differences = []
    pairs = zip(own.tuned.series, own.tuned.latencies, calibrated.tuned.latencies, strict=True)
    for s, found, used in pairs:
        if not len(s) or used.status not in CORRECTED_LATENCY_STATUSES:
            continue
        known = calibration.find_constant_or_unknown(s.source, s.kind, "latency_s")
        own_s, sigma_s = _found_latency_and_sigma_s(found)
        off = abs(own_s - used.applied_s) / max(float(np.hypot(sigma_s, known.sigma)), 1e-3)
        text = (
            f"latency of {s.source} {s.kind.name.lower()} found on it: {1e3 * own_s:.0f} +- {1e3 * sigma_s:.0f} ms, "
            f"calibrated: {1e3 * used.applied_s:.0f} +- {1e3 * known.sigma_in_another_drive:.0f} ms"
        )
        differences.append((off, text))
    texts = [text for off, text in sorted(differences, reverse=True) if off > MIN_SIGNIFICANT_SIGMAS]
    for found_series, used_series in zip(own.tuned.series, calibrated.tuned.series, strict=True):
        sigma, of_car = _root_mean_square_noise_sigma(found_series), _root_mean_square_noise_sigma(used_series)
        if (
            found_series.kind not in KINDS_THAT_IMU_MEASURES_TOO
            and not 1.0 / MIN_LISTED_NOISE_RATIO < sigma / of_car < MIN_LISTED_NOISE_RATIO
        ):
            what, unit = found_series.kind.name.lower(), QUANTITY_BY_KIND[found_series.kind].unit
            texts.append(
                f"noise of {found_series.source} {what} found on it: {sigma:.2g} {unit}, "
                f"calibrated: {of_car:.2g} {unit}"
            )
    return texts[:MAX_LISTED_CONTRADICTIONS]


def _root_mean_square_noise_sigma(s: SensorSeries) -> float:
    """Return the root of the mean variance of a series' first axis; 1 for an empty one."""
    return float(np.sqrt(s.noise[:, 0].mean())) if len(s) else 1.0


def _found_latency_and_sigma_s(latency: Latency) -> tuple[float, float]:
    """Return latency and sigma (s) that were found in the log; both 0 for the reference."""
    if latency.status is LatencyStatus.REFERENCE or not np.isfinite(latency.found_s):
        return 0.0, 0.0
    return latency.found_s, latency.sigma_s
