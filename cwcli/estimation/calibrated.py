"""Apply the constants of a calibration to an estimate.

The filter alone (`causal`) uses them unchanged and takes nothing that the log would only show later. With the smoother
they are a prior. In both cases the log is compared with them, and a note reports a contradiction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cwcli.errors import UsageError
from cwcli.estimation.calibration import UNKNOWN_CONSTANT, Calibration, Constant, ConstantStatus
from cwcli.estimation.imu import ImuMounting
from cwcli.estimation.latency import MIN_SIGNIFICANT_SIGMAS, Latency, LatencyStatus, is_latency_reference_by_series
from cwcli.estimation.measurements import QUANTITY_BY_KIND, Kind, Measurements
from cwcli.estimation.model import MANOEUVRE_SIGMA_FACTOR_LIMITS, MotionParameters
from cwcli.estimation.parameter import Parameter, ParameterStatus
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.prepare import PreparedSeries
from cwcli.estimation.sensor_model import GaussMarkovError, SensorModel
from cwcli.estimation.sensor_search import FoundSensorModel
from cwcli.lazy_dataclass import replace
from cwcli.signals.columns import FloatArray

FOUND_LATENCY_STATUSES = (LatencyStatus.APPLIED, LatencyStatus.NOT_SIGNIFICANT)
"""Statuses of latencies for which the search found a value in the log."""


def require_known_sources_and_note_unknown(
    calibration: Calibration, measurements: Sequence[Measurements], *, causal: bool
) -> list[str]:
    """Check that a calibration knows the sources of a log; returns notes on the sources that it does not know.

    Raises:
        UsageError: It knows none of the sources, or no position source where `causal` allows nothing else.
    """
    sources = list(dict.fromkeys(m.source for m in measurements))
    known = [source for source in sources if source in calibration.sensors]
    positions = [m.source for m in measurements if m.kind is Kind.POSITION]
    has_position = any(calibration.has_quantity(source, Kind.POSITION) for source in positions)
    lacking = not known or (causal and not has_position)
    if lacking:
        what = "a position" if known else "any source"
        raise UsageError(
            f"this is not the calibration of this car: it does not know {what} of the log ({', '.join(sources)})",
            where=calibration.name,
            hint=f"it knows {', '.join(calibration.sensors)}",
        )
    use_elsewhere = "left out" if causal else "used as without a calibration, and left out of the online states"
    use_of_positions = "used as without a calibration, in the online states with the noise that its messages state"
    return [
        f"{source}: the calibration {calibration.name} does not know it; "
        f"{use_of_positions if source in positions and not has_position else use_elsewhere}"
        for source in sources
        if source not in known
    ]


def calibrated_imu_mountings(calibration: Calibration) -> dict[str, ImuMounting]:
    """Return the IMU mountings of a calibration by source, of those that it knows."""
    angles = {
        source: [calibration.find_constant_or_unknown(source, "imu", name) for name in ("nose_up_rad", "left_up_rad")]
        for source in calibration.sensors
    }
    return {
        source: ImuMounting(nose.value, left.value, max(nose.sigma_in_another_drive, left.sigma_in_another_drive))
        for source, (nose, left) in angles.items()
        if nose.has_value and left.has_value
    }


def apply_calibrated_noise_and_empty_unknown(
    prepared: Sequence[PreparedSeries], calibration: Calibration
) -> list[PreparedSeries]:
    """Return the series with the noise of the calibration; series that it does not know become empty.

    If it knows no position source, positions keep the noise of their messages, because every state needs a position.
    """
    has_position = any(
        p.series.kind is Kind.POSITION and calibration.has_quantity(p.series.source, p.series.kind) for p in prepared
    )
    return [
        replace(p, series=with_calibrated_noise_and_stamp_error(p.series, calibration))
        if calibration.has_quantity(p.series.source, p.series.kind)
        else p
        if p.series.kind is Kind.POSITION and not has_position
        else replace(p, series=p.series.select_rows(np.zeros(len(p.series), np.bool_)))
        for p in prepared
    ]


def with_calibrated_noise_and_stamp_error(s: SensorSeries, calibration: Calibration) -> SensorSeries:
    """Return a series with the noise, the stamp error and the row interval of the calibration."""
    sigma, scale = (
        calibration.find_constant_or_unknown(s.source, s.kind, name) for name in ("noise_sigma", "noise_scale")
    )
    interval_s = calibration.find_constant_or_unknown(s.source, s.kind, "interval_s").value
    s = replace(s, interval_s=interval_s if interval_s > 0.0 else s.interval_s)
    stamps = calibration.find_constant_or_unknown(s.source, s.kind, "stamp_sigma_s")
    if stamps.has_value:
        s = replace(s, stamp_error=Parameter(stamps.value, stamps.sigma_in_another_drive, ParameterStatus.GIVEN))
    if scale.has_value:
        return replace(s.scale_noise_variance(scale.value), noise_origin="calibration")
    variance = sigma.value**2 if sigma.has_value else QUANTITY_BY_KIND[s.kind].default_sigma ** 2
    noise = np.zeros_like(s.noise)
    noise[:, 0] = variance
    if s.n_values_per_row == 2:
        noise[:, 2] = variance
    return replace(s, noise=noise, noise_origin="calibration" if sigma.has_value else "default")


def motion_with_calibrated_manoeuvres(parameters: MotionParameters, calibration: Calibration) -> MotionParameters:
    """Return the motion parameters with the jerk and yaw acceleration sigmas of the calibration."""
    jerk, yaw_accel = (calibration.motion.get(name, UNKNOWN_CONSTANT).value for name in MANOEUVRE_SIGMA_FACTOR_LIMITS)
    return replace(
        parameters,
        jerk_sigma_mps3=jerk if jerk > 0.0 else parameters.jerk_sigma_mps3,
        yaw_accel_sigma_radps2=yaw_accel if yaw_accel > 0.0 else parameters.yaw_accel_sigma_radps2,
    )


def sensor_model_from_calibration(series: Sequence[SensorSeries], calibration: Calibration) -> FoundSensorModel:
    """Return the sensor model of the calibration; where there is a pitch gyroscope, gravity is compensated with it."""
    slow: dict[int, GaussMarkovError] = {}
    follows, scaled, levered, ahead = set(), set(), set(), set()
    for i, s in enumerate(series):
        sigma, time_s = (
            calibration.find_constant_or_unknown(s.source, s.kind, name) for name in ("slow_sigma", "slow_time_s")
        )
        if sigma.has_value and time_s.has_value and sigma.value > 0.0 and time_s.value > 0.0:
            slow[i] = GaussMarkovError(sigma.value, time_s.value)
            if s.pitch_rate is not None:
                follows.add(i)
        if s.kind is Kind.SPEED and calibration.find_constant_or_unknown(s.source, s.kind, "scale").has_value:
            scaled.add(i)
        if s.kind is Kind.SPEED and calibration.find_constant_or_unknown(s.source, s.kind, "lever_arm_m").has_value:
            levered.add(i)
        if s.place_m is None and calibration.find_constant_or_unknown(s.source, s.kind, "ahead_m").has_value:
            ahead.add(i)
    model = SensorModel(slow, frozenset(follows), frozenset(scaled), frozenset(levered), frozenset(ahead))
    return FoundSensorModel(model, dict.fromkeys(model.modelled_errors, ParameterStatus.GIVEN))


def prior_means_and_variances_from_calibration(
    series: Sequence[SensorSeries], prior: FloatArray, calibration: Calibration
) -> tuple[FloatArray, FloatArray]:
    """Return prior means and variances (n,) of parameter states: biases, scales and lever arms of the calibration."""
    mean, prior = np.zeros_like(prior), prior.copy()
    for s in series:
        for name, state, none in (
            ("bias", s.bias_state, 0.0), ("scale", s.scale_state, 1.0), ("lever_arm_m", s.lever_state, 0.0),
            ("ahead_m", s.ahead_state, 0.0),
        ):  # fmt: skip
            known = calibration.find_constant_or_unknown(s.source, s.kind, name) if state >= 0 else UNKNOWN_CONSTANT
            if known.has_value:
                mean[state] = known.value - none
                prior[state] = max(known.sigma_in_another_drive, 1e-9) ** 2
    return mean, prior


def fuse_latencies_with_calibration_and_note(
    series: Sequence[SensorSeries], latencies_of_log: Sequence[Latency], calibration: Calibration, *, causal: bool
) -> tuple[list[Latency], list[str]]:
    """Combine the latencies of log and calibration, on the calibration's clock; returns them and notes.

    Args:
        latencies_of_log: Latencies found in the log, parallel to `series`, relative to the reference source of
            `references`.
        causal: Use the latencies of the calibration unchanged; else the weighted mean of both, unless they contradict.
    """
    reference = next(
        (
            calibration.find_constant_or_unknown(s.source, s.kind, "latency_s")
            for s, is_reference in zip(series, is_latency_reference_by_series(series), strict=True)
            if is_reference and calibration.find_constant_or_unknown(s.source, s.kind, "latency_s").has_value
        ),
        Constant(value=0.0, sigma=0.0),
    )
    latencies, notes = [], []
    for s, latency in zip(series, latencies_of_log, strict=True):
        constant = calibration.find_constant_or_unknown(s.source, s.kind, "latency_s")
        if latency.status in (LatencyStatus.GIVEN, LatencyStatus.OFF):
            latencies.append(latency)
            continue
        is_found = latency.status in FOUND_LATENCY_STATUSES
        own_s = latency.found_s + reference.value
        if not constant.has_value:
            if causal and latency.status is not LatencyStatus.REFERENCE:  # what the log shows comes from later rows
                latencies.append(Latency(LatencyStatus.NOT_OBSERVABLE))
            else:
                latencies.append(replace(latency, found_s=own_s) if is_found else latency)
            continue
        known = Latency(LatencyStatus.CALIBRATED, constant.value, constant.sigma_in_another_drive, latency.bound_s)
        if not is_found and constant.status is ConstantStatus.REFERENCE:
            latencies.append(Latency(LatencyStatus.REFERENCE))
            continue
        if not constant.is_usable_in_any_drive:
            notes.append(_disagreeing_drives_note(s, constant, calibration))
            unknown = Latency(LatencyStatus.NOT_OBSERVABLE, bound_s=latency.bound_s)
            latencies.append(replace(latency, found_s=own_s) if is_found and not causal else unknown)
            continue
        if not is_found:
            latencies.append(known)
            continue
        sigma_s = math.hypot(latency.sigma_s, reference.sigma_in_another_drive)
        is_contradicted = abs(own_s - known.found_s) > MIN_SIGNIFICANT_SIGMAS * math.hypot(sigma_s, known.sigma_s)
        if is_contradicted:
            notes.append(
                f"{s.source}: {s.kind.name.lower()} is late by {_format_value_and_sigma_ms(own_s, sigma_s)} in this "
                "log, by "
                f"{_format_value_and_sigma_ms(known.found_s, known.sigma_s)} in the calibration {calibration.name}; "
                f"{'the calibration counts' if causal else 'the log counts'}"
            )
        if causal:
            latencies.append(known)
        elif is_contradicted:
            latencies.append(replace(latency, found_s=own_s, sigma_s=sigma_s))
        else:
            weight, prior_weight = sigma_s**-2, max(known.sigma_s, 1e-9) ** -2
            fused_s = (weight * own_s + prior_weight * known.found_s) / (weight + prior_weight)
            latencies.append(replace(known, found_s=fused_s, sigma_s=(weight + prior_weight) ** -0.5))
    return latencies, notes


def _disagreeing_drives_note(s: SensorSeries, constant: Constant, calibration: Calibration) -> str:
    return (
        f"{s.source}: the drives of the calibration {calibration.name} disagree on the latency of "
        f"{s.kind.name.lower()} ({_format_value_and_sigma_ms(constant.value, constant.sigma)}, from drive to drive by "
        f"{1e3 * constant.spread:.0f} ms), so it is not used"
    )


def bias_contradiction_notes(s: SensorSeries, bias: float, sigma: float, calibration: Calibration) -> list[str]:
    """Return a note if the bias found in the log differs significantly from that of the calibration."""
    constant = calibration.find_constant_or_unknown(s.source, s.kind, "bias")
    allowed = (
        MIN_SIGNIFICANT_SIGMAS * math.hypot(sigma, constant.sigma_in_another_drive) if constant.has_value else math.inf
    )
    if not abs(bias - constant.value) > allowed:
        return []
    unit, quantity = QUANTITY_BY_KIND[s.kind].unit, s.kind.name.lower().replace("_", " ")
    return [
        f"{s.source}: the bias of {quantity} is {bias:.3g} +- {sigma:.2g} {unit} in this log, "
        f"{constant.value:.3g} +- {constant.sigma_in_another_drive:.2g} {unit} in the calibration {calibration.name}"
    ]


def _format_value_and_sigma_ms(value_s: float, sigma_s: float) -> str:
    return f"{1e3 * value_s:.0f} +- {1e3 * sigma_s:.0f} ms"
