"""What the log itself shows before the last pass: latencies, noise, and how strongly the car manoeuvres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cwcli.estimation.calibrated import calibrated_model, calibrated_motion, with_latencies, with_priors
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.latency import Latency, LatencyStatus, latency_roles, references, straightened, within_limits
from cwcli.estimation.latency_clock import Told, on_agreed_clock
from cwcli.estimation.latency_search import find_latencies
from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import ModelParameters, simulated_motion
from cwcli.estimation.noise import settle_noise
from cwcli.estimation.passes import N_MOTION, Series
from cwcli.estimation.prepare import PreparedSeries
from cwcli.estimation.sensor_model import Layout, lay_out
from cwcli.estimation.sensor_search import FoundModel, find_sensor_model, if_better, unclear_places
from cwcli.kernels import ekf
from cwcli.metrics.chi_square import gate_nis
from cwcli.signals.columns import FloatArray

ACCEL_BIAS_PRIOR = 3.0  # m/s^2: gravity through 18 degrees of pitch
YAW_RATE_BIAS_PRIOR = 0.02  # rad/s
MS_PER_MINUTE = 6e4  # of a rate in seconds per second


@dataclass(frozen=True)
class TunedSeries:
    """Series with latency, noise, bias states and gates settled.

    Attributes:
        series, latencies: Parallel to what was prepared.
        motion: Motion model, with the random walks of the parameter states.
        mean, prior: Shape (n,): prior means and variances of the parameter states; motion states are zero there.
        compared: What the log itself says of each latency, see `SourceReport`.
        parameters: Of the motion model.
        sensors: What else than white noise was found of each series.
        notes: Remarks for the user.
    """

    series: tuple[Series, ...]
    latencies: tuple[Latency, ...]
    motion: ekf.ProcessModel
    mean: FloatArray
    prior: FloatArray
    compared: tuple[Latency, ...]
    parameters: ModelParameters
    sensors: FoundModel
    notes: tuple[str, ...]


def tune(prepared: Sequence[PreparedSeries], config: EstimatorConfig, parameters: ModelParameters) -> TunedSeries:
    """Find latencies, noise and manoeuvre intensity, and lay out the parameter states.

    Args:
        prepared: All series; at least one POSITION with a row.
        config: Settings.
        parameters: Motion model to begin with.
    """
    series, walk, prior = with_bias_states(prepared, parameters)
    base = Layout(series, parameters, walk, prior)
    compared, latencies, moved, sensors = _latencies_and_sensors(base, config)
    layout = lay_out(_corrected(base, latencies), sensors.model)
    mean, prior = np.zeros_like(layout.prior), layout.prior
    if config.calibration is not None:
        mean, prior = with_priors(layout.series, prior, config.calibration)
    if layout.series and all(s.is_exact for s in layout.series):
        series, parameters = layout.series, simulated_motion(layout.parameters)
    elif config.calibration is not None and config.causal:
        series, parameters = layout.series, calibrated_motion(layout.parameters, config.calibration)
    elif config.blind:
        series, parameters = layout.series, layout.parameters
    else:
        series, parameters = settle_noise(layout.series, layout.parameters, layout.walk, layout.prior)
    gated = tuple(s if s.is_exact else replace(s, gate_nis=gate_nis(config.gate_probability, s.width)) for s in series)
    unknown = (
        f"{s.source}: latency of {s.kind.name.lower()} not observable{_bound(latency)}, not corrected"
        for s, latency in zip(series, latencies, strict=True)
        if latency.status is LatencyStatus.NOT_OBSERVABLE and len(s) and not config.blind
    )
    drifting = (
        f"{s.source}: latency of {s.kind.name.lower()} drifts by {MS_PER_MINUTE * latency.drift:.0f} ms per minute, "
        "corrected along a line"
        for s, latency in zip(series, latencies, strict=True)
        if latency.status is LatencyStatus.DRIFTS
    )
    return TunedSeries(
        gated,
        tuple(latencies),
        parameters.motion(layout.walk),
        mean,
        prior,
        tuple(compared),
        parameters,
        sensors,
        (*moved, *unknown, *drifting),
    )


def _bound(latency: Latency) -> str:
    return f" (to {1e3 * latency.bound_s:.0f} ms at best)" if np.isfinite(latency.bound_s) else ""


def _told(series: Sequence[Series], latencies: Sequence[Latency]) -> list[Told]:
    return [
        Told(s.source, s.kind, is_reference, latency)
        for s, is_reference, latency in zip(series, references(series), latencies, strict=True)
    ]


def _latencies_and_sensors(
    base: Layout, config: EstimatorConfig
) -> tuple[list[Latency], list[Latency], list[str], FoundModel]:
    """Find the latencies and the sensors' errors: each as well as the other is known, then each once more.

    Args:
        base: Series with their biases alone; stamps as they are.
        config: Settings.

    Returns:
        What the log says of the latencies; what is made of them; notes; the sensors' errors.
    """
    roles = latency_roles(base.series, config)
    told = _latencies(base, roles, config)
    if config.sensor_model == "none":
        return *told, FoundModel()
    if config.calibration is not None and config.causal:
        return *told, calibrated_model(base.series, config.calibration)
    if config.blind:
        return *told, FoundModel()
    # The likeliest latencies, clear or not: what is found with them then moves with the stamps.
    likeliest = _corrected(base, told[0], likeliest=True)
    found = find_sensor_model(_settled(likeliest))
    if found.model.parts and None in roles:
        told = _latencies(lay_out(base, found.model), roles, config)
        unclear = unclear_places(found, base.series, [each.left_s for each in told[1]])
        if unclear:  # a latency or a place: of the two the latency is the likelier
            found = found.without_ahead(unclear)
            told = _latencies(lay_out(base, found.model), roles, config)
        corrected = _corrected(base, told[1])
        if found.model.ahead or [s.latency_s for s in corrected.series] != [s.latency_s for s in likeliest.series]:
            found = find_sensor_model(_settled(corrected), found, [each.left_s for each in told[1]])
    if not found.model.parts:
        return *told, found
    plain = _corrected(base, told[1])
    return *told, if_better(found, _settled(plain), _settled(lay_out(plain, found.model)))


def _latencies(
    layout: Layout, roles: Sequence[Latency | None], config: EstimatorConfig
) -> tuple[list[Latency], list[Latency], list[str]]:
    """What the log says of the latencies, what is made of them, and notes.

    A latency beyond what sensors have is no latency: other drives are not told of it, and it is not corrected.

    A slow error of the fixes takes no part: it would hide a latency, and the scatter over the log's blocks, which is a
    latency's sigma, has it already.
    """
    series = [replace(s, slow_state=-1) if s.kind is Kind.POSITION else s for s in layout.series]
    if config.blind:
        compared = [Latency(LatencyStatus.NOT_OBSERVABLE) if role is None else role for role in roles]
    else:
        compared = find_latencies(series, roles, layout.parameters, layout.walk, layout.prior)
    found = [within_limits(each) for each in compared]
    compared = [
        Latency(LatencyStatus.NOT_OBSERVABLE) if each.status is LatencyStatus.CONTRADICTS else each for each in found
    ]
    if config.calibration is None:
        latencies, notes = on_agreed_clock(_told(series, found))
    else:
        latencies, notes = with_latencies(series, found, config.calibration, causal=config.causal)
    return compared, [within_limits(each) for each in latencies], notes


def _corrected(layout: Layout, latencies: Sequence[Latency], *, likeliest: bool = False) -> Layout:
    """The layout with its stamps corrected; `likeliest`: by what is not significant, too."""
    corrections = [
        latency.found_s
        if likeliest and np.isfinite(latency.found_s) and latency.status is not LatencyStatus.CONTRADICTS
        else latency.applied_s
        for latency in latencies
    ]
    series = [
        replace(straightened(s, latency), latency_s=found_s)
        for s, latency, found_s in zip(layout.series, latencies, corrections, strict=True)
    ]
    return replace(layout, series=series)


def _settled(layout: Layout) -> Layout:
    """The layout with the noise that goes with it, roughly."""
    series, parameters = settle_noise(layout.series, layout.parameters, layout.walk, layout.prior, every_row=False)
    return replace(layout, series=series, parameters=parameters)


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
