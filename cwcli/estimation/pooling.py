"""Pool the constants of many logs of one car to its calibration.

Each constant is the mean of the logs, weighted by their inverse variances. Where they scatter by more than their sigmas
allow (Cochran's Q, a chi-square test), the drives differ: the rest of the scatter is a variance between drives, part of
the weights and of the sigma in another drive (DerSimonian and Laird, 1986). A latency on which drives disagree is used
only where it is farther from zero than they scatter.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import field

import numpy as np

from cwcli.estimation.calibration import Calibration, Constant, ConstantStatus
from cwcli.estimation.latency import Latency, LatencyStatus
from cwcli.estimation.latency_clock import SourceLatency, shift_latencies_to_agreed_clock_and_note
from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import MANOEUVRE_SIGMA_FACTOR_LIMITS
from cwcli.estimation.parameter import ParameterStatus
from cwcli.estimation.result import SourceReport, Track
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.metrics.chi_square import chi_square_quantile
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import ACCEL, SPEED, YAW_RATE

CHI_SQUARE_LEVEL_OF_AGREEMENT = 0.99
"""Logs disagree if their chi-square exceeds this quantile of its distribution. Chosen by hand; not fitted."""
CHI_SQUARE_LEVEL_FOR_SPREAD = 0.95
"""Logs get a spread if their chi-square exceeds this quantile of its distribution.

Chosen low, because Cochran's test has little power with few drives, and a false spread costs less than a missed one."""
MAX_SIGMA_OF_OBSERVABLE_POOLED_LATENCY_S = 0.05
"""Greatest sigma of a pooled latency, s, that counts as observable; the same as in the search for latencies."""
RELATIVE_SIGMA_OF_FITTED_CONSTANT = 0.1
"""Relative sigma of a fitted sigma of the motion and of a row interval. Chosen by hand; not fitted."""
SECONDS_PER_MINUTE = 60.0
"""Seconds in a minute."""


@dataclass(frozen=True)
class DriveEvidence:
    """Estimate from the log of one drive.

    Attributes:
        log: Name of the log.
        track: Track estimated from the whole log.
        camera_pitch_rad: Topic of a camera -> pitch and one sigma, where lanes were found without a given pitch.
    """

    log: str
    track: Track
    camera_pitch_rad: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def duration_minutes(self) -> float:
        """Minutes from the first to the last state."""
        stamp_ns = self.track.stamp_ns
        return float(stamp_ns[-1] - stamp_ns[0]) / NS_PER_S / SECONDS_PER_MINUTE if len(stamp_ns) else 0.0


@dataclass(frozen=True)
class ConstantOfDrive:
    """Value of a constant from one log: value, one sigma, minutes and name of the log."""

    value: float
    sigma: float
    minutes: float
    log: str = ""


def pool_constant_over_drives(constants: Sequence[ConstantOfDrive]) -> Constant:
    """Pool the values of a constant from several logs; values without a finite sigma are ignored."""
    constants = [
        each for each in constants if math.isfinite(each.value) and math.isfinite(each.sigma) and each.sigma > 0.0
    ]
    minutes = sum(each.minutes for each in constants)
    if not constants:
        return Constant()
    value, variance = (np.array([getattr(each, name) for each in constants]) for name in ("value", "sigma"))
    variance = variance**2
    mean, sigma, chi_square = _weighted_mean_sigma_and_chi_square(value, variance)
    dof, spread = len(constants) - 1, 0.0
    status = ConstantStatus.FOUND
    if dof and chi_square > chi_square_quantile(CHI_SQUARE_LEVEL_FOR_SPREAD, dof):
        weight = 1.0 / variance
        left = (chi_square - dof) / float(weight.sum() - (weight**2).sum() / weight.sum())
        spread = math.sqrt(max(left, 0.0))
        mean, sigma, _ = _weighted_mean_sigma_and_chi_square(value, variance + spread**2)
        status = (
            ConstantStatus.DISAGREE if chi_square > chi_square_quantile(CHI_SQUARE_LEVEL_OF_AGREEMENT, dof) else status
        )
    reduced = chi_square / dof if dof else math.nan
    of_logs = tuple((each.log, each.value, each.sigma) for each in constants)
    return Constant(status, mean, sigma, spread, reduced, len(constants), minutes, of_logs)


def _weighted_mean_sigma_and_chi_square(
    drive_values: np.ndarray, drive_variances: np.ndarray
) -> tuple[float, float, float]:
    """Return the mean weighted by inverse variance, its sigma, and the chi-square of the values about it."""
    weight = 1.0 / drive_variances
    mean = float(weight @ drive_values / weight.sum())
    return mean, float(weight.sum() ** -0.5), float((drive_values - mean) ** 2 @ weight)


def calibrate_from_drives(drives: Sequence[DriveEvidence], name: str = "") -> Calibration:
    """Calibrate a car from its drives.

    Args:
        drives: At least one; their tracks have been found with latencies.
    """
    reports = [(report, drive) for drive in drives for report in drive.track.sources if report.n_used]
    keys = dict.fromkeys((report.source, report.kind) for report, _ in reports)
    latencies = _pool_latencies(keys, reports)
    sensors: dict[str, dict[str, dict[str, Constant]]] = {}
    for key in keys:
        own = [(report, drive) for report, drive in reports if (report.source, report.kind) == key]
        constants = {"latency_s": latencies[key]}
        read = [(_values_and_sigmas_of_constants(r, drive.duration_minutes), drive) for r, drive in own]
        for constant in POOLED_CONSTANT_NAMES:
            said = [
                ConstantOfDrive(*found[constant], drive.duration_minutes, drive.log)
                for found, drive in read
                if constant in found
            ]
            if said:
                constants[constant] = pool_constant_over_drives(said)
        sensors.setdefault(key[0], {})[key[1].name.lower()] = constants
    for source, mounting in _pool_imu_mountings(drives).items():
        sensors[source]["imu"] = mounting
    for topic in dict.fromkeys(topic for drive in drives for topic in drive.camera_pitch_rad):
        said = [
            ConstantOfDrive(*d.camera_pitch_rad[topic], d.duration_minutes, d.log)
            for d in drives
            if topic in d.camera_pitch_rad
        ]
        sensors.setdefault(topic, {})["camera"] = {"pitch_rad": pool_constant_over_drives(said)}
    total_s = sum(drive.duration_minutes for drive in drives) * SECONDS_PER_MINUTE
    return Calibration(
        name=name,
        sensors=sensors,
        motion={
            name: pool_constant_over_drives(
                [
                    ConstantOfDrive(
                        d.track.manoeuvre_sigmas[name],
                        RELATIVE_SIGMA_OF_FITTED_CONSTANT * d.track.manoeuvre_sigmas[name],
                        d.duration_minutes,
                        d.log,
                    )
                    for d in drives
                ]
            )
            for name in MANOEUVRE_SIGMA_FACTOR_LIMITS
        },
        logs=tuple(drive.log for drive in drives),
        minutes=total_s / SECONDS_PER_MINUTE,
        evidence=_distance_and_rms_motion_of_drives(drives),
    )


POOLED_CONSTANT_NAMES = (
    "noise_sigma", "noise_scale", "stamp_sigma_s", "interval_s", "slow_sigma", "slow_time_s", "bias", "scale",
    "lever_arm_m", "ahead_m",
)  # fmt: skip
"""Names of the constants of a source that are pooled one by one, in the order of the calibration file."""


def _values_and_sigmas_of_constants(report: SourceReport, minutes: float) -> dict[str, tuple[float, float]]:
    """Return the constants that a drive of so many minutes shows of a source: name -> value and one sigma of it."""
    found = {"interval_s": (report.interval_s, RELATIVE_SIGMA_OF_FITTED_CONSTANT * report.interval_s)}
    if report.noise_origin == "log":  # the relative sigma of a sigma from n rows is 1 / sqrt(2 n)
        found["noise_sigma"] = report.sigma, report.sigma / math.sqrt(2.0 * report.n_used)
    elif report.noise_origin.startswith("message"):
        found["noise_scale"] = report.noise_scale, report.noise_scale * math.sqrt(2.0 / report.n_used)
    if math.isfinite(report.bias):
        found["bias"] = report.bias, report.bias_sigma
    if (slow := report.slow_error).status is ParameterStatus.USED:
        # A drive has as many independent values of the error as it has time constants.
        n = max(minutes * SECONDS_PER_MINUTE / slow.time_s, 1.0)
        found["slow_sigma"] = slow.sigma, slow.sigma / math.sqrt(2.0 * n)
        found["slow_time_s"] = slow.time_s, slow.time_s * math.sqrt(2.0 / n)
    for name, parameter in (
        ("stamp_sigma_s", report.stamp_error),
        ("scale", report.scale),
        ("lever_arm_m", report.lever_arm_m),
        ("ahead_m", report.ahead_m),
    ):
        if parameter.status in (ParameterStatus.USED, ParameterStatus.NOT_BETTER):
            found[name] = parameter.value, parameter.sigma
    return found


def _pool_latencies(
    keys: Collection[tuple[str, Kind]],
    reports: Sequence[tuple[SourceReport, DriveEvidence]],
) -> dict[tuple[str, Kind], Constant]:
    """Pool the latencies relative to the reference of the search, then shift them to the agreed clock."""
    found: dict[tuple[str, Kind], Constant] = {}
    pooled = []
    for key in keys:
        own = [(r.latency_to_reference, drive) for r, drive in reports if (r.source, r.kind) == key]
        constant = pool_constant_over_drives(
            [
                ConstantOfDrive(latency.found_s, latency.sigma_s, drive.duration_minutes, drive.log)
                for latency, drive in own
                if latency.status is not LatencyStatus.DRIFTS  # no constant of the car
            ]
        )
        if constant.status is ConstantStatus.FOUND and constant.sigma > MAX_SIGMA_OF_OBSERVABLE_POOLED_LATENCY_S:
            constant = replace(constant, status=ConstantStatus.NOT_OBSERVABLE, value=math.nan)
        is_reference = any(latency.status is LatencyStatus.REFERENCE for latency, _ in own)
        if is_reference:
            minutes = sum(drive.duration_minutes for _, drive in own)
            constant = Constant(ConstantStatus.REFERENCE, 0.0, 0.0, 0.0, math.nan, len(own), minutes)
        found[key] = constant
        pooled.append(
            SourceLatency(*key, is_reference=is_reference, latency=_constant_to_latency(constant, is_reference))
        )
    shifted, _ = shift_latencies_to_agreed_clock_and_note(pooled)
    for each, latency in zip(pooled, shifted, strict=True):
        key = (each.source, each.kind)
        if latency == each.latency or not found[key].has_value:
            continue
        if latency.status is LatencyStatus.REFERENCE:
            found[key] = replace(found[key], status=ConstantStatus.REFERENCE, value=0.0)
            continue
        status = ConstantStatus.FOUND if each.is_reference else found[key].status
        found[key] = replace(found[key], status=status, value=latency.found_s, sigma=latency.sigma_s)
    return found


def _constant_to_latency(constant: Constant, is_reference: bool) -> Latency:
    if is_reference:
        return Latency(LatencyStatus.REFERENCE)
    if not constant.has_value:
        return Latency(LatencyStatus.NOT_OBSERVABLE)
    is_clear = constant.is_usable_in_any_drive and abs(constant.value) > 3.0 * constant.sigma
    status = LatencyStatus.APPLIED if is_clear else LatencyStatus.NOT_SIGNIFICANT
    return Latency(status, constant.value, constant.sigma, constant.sigma)


def _pool_imu_mountings(drives: Sequence[DriveEvidence]) -> dict[str, dict[str, Constant]]:
    """Return the pooled mounting angles of each source with an IMU."""
    found: dict[str, dict[str, list[ConstantOfDrive]]] = {}
    for drive in drives:
        for report in drive.track.sources:
            if report.mounting is not None and report.kind is Kind.ACCEL and report.n_used:
                mine = found.setdefault(report.source, {"nose_up_rad": [], "left_up_rad": []})
                for name, angles in mine.items():
                    value, sigma = getattr(report.mounting, name), report.mounting.sigma_rad
                    angles.append(ConstantOfDrive(value, sigma, drive.duration_minutes, drive.log))
    return {
        source: {name: pool_constant_over_drives(said) for name, said in angles.items()}
        for source, angles in found.items()
    }


def _distance_and_rms_motion_of_drives(drives: Sequence[DriveEvidence]) -> dict[str, float]:
    """Return the distance driven and the root mean squares of acceleration and yaw rate, by the keys of
    `DRIVING_AMOUNT_KEYS`."""
    state = [drive.track.state for drive in drives if len(drive.track.stamp_ns) > 1]
    if not state:
        return {}
    way_m = sum(
        float(np.abs(drive.track.state[1:, SPEED]) @ np.diff(drive.track.stamp_ns)) / NS_PER_S for drive in drives
    )
    whole = np.concatenate(state)
    return {
        "distance_km": way_m / 1000.0,
        "accel_rms_mps2": float(np.sqrt(np.mean(whole[:, ACCEL] ** 2))),
        "yaw_rate_rms_radps": float(np.sqrt(np.mean(whole[:, YAW_RATE] ** 2))),
    }
