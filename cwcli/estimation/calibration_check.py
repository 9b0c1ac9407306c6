"""Check whether a calibration fits a log: its rows are predicted with the calibration's constants and with its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cwcli.estimation.calibrated import known_alone, known_mountings
from cwcli.estimation.calibration import Calibration
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.latency import CORRECTED, SIGNIFICANT_SIGMAS, Latency, LatencyStatus
from cwcli.estimation.lever_arms import placed
from cwcli.estimation.measurements import QUANTITIES, RATES, Kind, Measurements
from cwcli.estimation.model import ModelParameters
from cwcli.estimation.passes import N_MOTION, Series, run_pass
from cwcli.estimation.prepare import PreparedSeries, epoch_ns, prepare
from cwcli.estimation.score import GATE_PROBABILITY, clearly_better, row_scores
from cwcli.estimation.start import start_with_parameters
from cwcli.estimation.tune import TunedSeries, tune
from cwcli.metrics.chi_square import gate_nis
from cwcli.signals.columns import FloatArray

MIN_LOSS = 0.02
"""Loss of log-likelihood per row of a source from which a note reports it.

Chosen by tests.studies.city_drive: fixes with 0.6 m of noise that are corrected by 100 ms too much lose 0.04, those
with the right calibration less than 0.002; noise that is wrong by 14 % costs as much."""
MAX_TOLD = 2
"""Greatest number of contradictions that a note lists; chosen for short notes."""
NOISE_RATIO = 1.25
"""A note lists a noise sigma if it differs from that of the calibration by more than this factor; chosen by hand."""


@dataclass(frozen=True)
class _Prediction:
    """A log as the filter predicts it: its tuned series, and the log-likelihood of each row by source and kind."""

    tuned: TunedSeries
    scores: dict[tuple[str, Kind], FloatArray]


def notes_on_worse_prediction(measurements: Sequence[Measurements], config: EstimatorConfig) -> list[str]:
    """Return a note if the log is predicted clearly worse with the calibration's constants than with its own; else [].

    The filter alone predicts each row from those before it, for the sources that the calibration knows. The log's own
    constants are found from the whole log; no state depends on this comparison.

    Args:
        measurements: Measurements of the ego; at least one finite POSITION.
        config: Settings, with a calibration that knows the sources.
    """
    calibration = config.calibration
    assert calibration is not None
    own_config = replace(config, calibration=None, causal=False, blind=False)
    own = _predicted(_known(_prepared(measurements, config, None), calibration), own_config)
    of_car = known_alone(_prepared(measurements, config, calibration), calibration)
    calibrated = _predicted(of_car, replace(config, causal=True, blind=True))
    gains = _gains(own, calibrated)
    worse = [
        (source, kind)
        for (source, kind), gain in gains.items()
        if float(gain.mean()) >= MIN_LOSS and clearly_better(gain, 0.0)
    ]
    total = sum(float(gain.sum()) for gain in gains.values())
    if not worse or total <= 0.0:
        return []
    names = ", ".join(f"{kind.name.lower()} of {source}" for source, kind in worse)
    told = _contradictions(own, calibrated, calibration)
    return [
        f"the calibration {calibration.name} makes this log worse: with its constants the filter predicts the {names} "
        f"worse than with what the log says of itself (log-likelihood {-total:.0f})"
        + "".join(f"; {each}" for each in told)
    ]


def _prepared(
    measurements: Sequence[Measurements], config: EstimatorConfig, calibration: Calibration | None
) -> list[PreparedSeries]:
    mountings = {} if calibration is None else known_mountings(calibration)
    prepared, _ = prepare(measurements, epoch_ns(measurements), mountings)
    return placed(prepared, config.lever_arms)


def _known(prepared: Sequence[PreparedSeries], calibration: Calibration) -> list[PreparedSeries]:
    """Return the series with their own noise; those that `known_alone` leaves out become empty."""
    kept = known_alone(prepared, calibration)
    return [own if len(known.series) else known for own, known in zip(prepared, kept, strict=True)]


def _predicted(prepared: Sequence[PreparedSeries], config: EstimatorConfig) -> _Prediction:
    tuned = tune(prepared, config, ModelParameters())
    series = [replace(s, gate_nis=gate_nis(GATE_PROBABILITY, s.width)) for s in tuned.series]
    start = start_with_parameters(series, tuned.prior, causal=True)
    start.state[N_MOTION:] = tuned.mean[N_MOTION:]
    result = run_pass(series, start, tuned.motion, np.zeros(0), smooth=False, reset_after=config.reset_after)
    scores = {
        (s.source, s.kind): row_scores(s, nis)
        for s, nis in zip(series, result.nis, strict=True)
        if s.kind not in RATES and len(s)
    }
    return _Prediction(tuned, scores)


def _gains(own: _Prediction, calibrated: _Prediction) -> dict[tuple[str, Kind], FloatArray]:
    """Return the log-likelihood that the log's own constants gain per row, by source and kind."""
    gains = {}
    for key, score in own.scores.items():
        other = calibrated.scores.get(key)
        if other is not None and len(other) == len(score):
            gain = score - other
            gains[key] = gain[np.isfinite(gain)]
    return {key: gain for key, gain in gains.items() if len(gain)}


def _contradictions(own: _Prediction, calibrated: _Prediction, calibration: Calibration) -> list[str]:
    """Return texts on what differs most, with both values: latencies in units of their sigmas, then the noise."""
    differences = []
    pairs = zip(own.tuned.series, own.tuned.latencies, calibrated.tuned.latencies, strict=True)
    for s, found, used in pairs:
        if not len(s) or used.status not in CORRECTED:
            continue
        known = calibration.of(s.source, s.kind, "latency_s")
        own_s, sigma_s = _own(found)
        off = abs(own_s - used.applied_s) / max(float(np.hypot(sigma_s, known.sigma)), 1e-3)
        text = (
            f"latency of {s.source} {s.kind.name.lower()} found on it: {1e3 * own_s:.0f} +- {1e3 * sigma_s:.0f} ms, "
            f"calibrated: {1e3 * used.applied_s:.0f} +- {1e3 * known.drive_sigma:.0f} ms"
        )
        differences.append((off, text))
    told = [text for off, text in sorted(differences, reverse=True) if off > SIGNIFICANT_SIGMAS]
    for found_series, used_series in zip(own.tuned.series, calibrated.tuned.series, strict=True):
        sigma, of_car = _sigma(found_series), _sigma(used_series)
        if found_series.kind not in RATES and not 1.0 / NOISE_RATIO < sigma / of_car < NOISE_RATIO:
            told.append(
                f"noise of {found_series.source} {found_series.kind.name.lower()} found on it: {sigma:.2g} "
                f"{QUANTITIES[found_series.kind].unit}, calibrated: {of_car:.2g} {QUANTITIES[found_series.kind].unit}"
            )
    return told[:MAX_TOLD]


def _sigma(s: Series) -> float:
    """Return the root of the mean variance of a series' first axis; 1 for an empty one."""
    return float(np.sqrt(s.noise[:, 0].mean())) if len(s) else 1.0


def _own(found: Latency) -> tuple[float, float]:
    """Return latency and sigma (s) that were found in the log; both 0 for the reference."""
    if found.status is LatencyStatus.REFERENCE or not np.isfinite(found.found_s):
        return 0.0, 0.0
    return found.found_s, found.sigma_s
