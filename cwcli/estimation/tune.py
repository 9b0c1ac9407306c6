"""What the log itself shows before the last pass: latencies, noise, and how strongly the car manoeuvres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cwcli.estimation.calibrated import calibrated_motion, with_bias_priors, with_latencies
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.latency import Latency, LatencyStatus, latency_roles, references
from cwcli.estimation.latency_clock import Told, on_agreed_clock
from cwcli.estimation.latency_search import find_latencies
from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import ModelParameters
from cwcli.estimation.noise import settle_noise
from cwcli.estimation.passes import N_MOTION, Series
from cwcli.estimation.prepare import PreparedSeries
from cwcli.kernels import ekf
from cwcli.metrics.chi_square import gate_nis
from cwcli.signals.columns import FloatArray

ACCEL_BIAS_PRIOR = 3.0  # m/s^2: gravity through 18 degrees of pitch
YAW_RATE_BIAS_PRIOR = 0.02  # rad/s


@dataclass(frozen=True)
class TunedSeries:
    """Series with latency, noise, bias states and gates settled.

    Attributes:
        series, latencies: Parallel to what was prepared.
        motion: Motion model, with the random walks of the parameter states.
        mean, prior: Shape (n,): prior means and variances of the parameter states; motion states are zero there.
        compared: What the log itself says of each latency, see `SourceReport`.
        parameters: Of the motion model.
        notes: Remarks for the user.
    """

    series: tuple[Series, ...]
    latencies: tuple[Latency, ...]
    motion: ekf.ProcessModel
    mean: FloatArray
    prior: FloatArray
    compared: tuple[Latency, ...]
    parameters: ModelParameters
    notes: tuple[str, ...]


def tune(prepared: Sequence[PreparedSeries], config: EstimatorConfig, parameters: ModelParameters) -> TunedSeries:
    """Find latencies, noise and manoeuvre intensity, and lay out the parameter states.

    Args:
        prepared: All series; at least one POSITION with a row.
        config: Settings.
        parameters: Motion model to begin with.
    """
    series, walk, prior = with_bias_states(prepared, parameters)
    compared = find_latencies(series, latency_roles(series, config), parameters, walk, prior)
    mean, calibration = np.zeros_like(prior), config.calibration
    if calibration is None:
        latencies, moved = on_agreed_clock(_told(series, compared))
    else:
        latencies, moved = with_latencies(series, compared, calibration, causal=config.causal)
        mean, prior = with_bias_priors(series, prior, calibration)
    series = [replace(s, latency_s=latency.applied_s) for s, latency in zip(series, latencies, strict=True)]
    if calibration is not None and config.causal:
        parameters = calibrated_motion(parameters, calibration)
    else:
        series, parameters = settle_noise(series, parameters, walk, prior)
    gated = tuple(replace(s, gate_nis=gate_nis(config.gate_probability, s.width)) for s in series)
    unknown = (
        f"{s.source}: latency of {s.kind.name.lower()} not observable{_bound(latency)}, not corrected"
        for s, latency in zip(series, latencies, strict=True)
        if latency.status is LatencyStatus.NOT_OBSERVABLE and len(s)
    )
    return TunedSeries(
        gated,
        tuple(latencies),
        parameters.motion(walk),
        mean,
        prior,
        tuple(compared),
        parameters,
        (*moved, *unknown),
    )


def _bound(latency: Latency) -> str:
    return f" (to {1e3 * latency.bound_s:.0f} ms at best)" if np.isfinite(latency.bound_s) else ""


def _told(series: Sequence[Series], latencies: Sequence[Latency]) -> list[Told]:
    return [
        Told(s.source, s.kind, is_reference, latency)
        for s, is_reference, latency in zip(series, references(series), latencies, strict=True)
    ]


def with_bias_states(
    prepared: Sequence[PreparedSeries], parameters: ModelParameters
) -> tuple[list[Series], FloatArray, FloatArray]:
    """Give every IMU series a bias state. Returns series, random walk variances and prior variances, both (n,)."""
    series, walk, prior = [], [0.0] * N_MOTION, [0.0] * N_MOTION
    for p in prepared:
        if p.biased and len(p.series):
            series.append(replace(p.series, bias_state=len(walk)))
            accel = p.series.kind is Kind.ACCEL
            walk.append((parameters.accel_bias_walk if accel else parameters.yaw_rate_bias_walk) ** 2)
            prior.append((ACCEL_BIAS_PRIOR if accel else YAW_RATE_BIAS_PRIOR) ** 2)
        else:
            series.append(p.series)
    return series, np.array(walk), np.array(prior)
