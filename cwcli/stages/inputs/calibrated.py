"""Signals as a calibration says that they should have been: on one clock, without bias and scale."""

from __future__ import annotations

import numpy as np

from cwcli.errors import UsageError
from cwcli.estimation.calibrated import calibrated_imu_mountings
from cwcli.estimation.calibration import Calibration
from cwcli.estimation.measurements import Kind
from cwcli.lazy_dataclass import replace
from cwcli.signals.canonical import ImuSignal, Signal, SpeedSignal, VelocitySignal
from cwcli.signals.units import NS_PER_S
from cwcli.stages.inputs.sources import UP_AXIS_COLUMN_OF_GYRO, SensorSignals


def apply_calibration_to_sources(sources: SensorSignals, calibration: Calibration | None) -> SensorSignals:
    """Correct the speed, velocity and gyroscope signals of the sources that the calibration knows.

    Raises:
        UsageError: There are such signals, and the calibration knows none of their sources.
    """
    if calibration is None:
        return sources
    signals = [s for found in sources.by_role.values() for s in found if _is_calibrated_signal(s)]
    known = [s.source for s in signals if s.source in calibration.sensors]
    if signals and not known:
        raise UsageError(
            "this is not the calibration of this car: it does not know "
            f"{', '.join(dict.fromkeys(s.source for s in signals))}",
            where=calibration.name,
            hint=f"it knows {', '.join(calibration.sensors)}",
        )
    by_role = {
        role: tuple(_apply_calibration(signal, calibration) for signal in found)
        for role, found in sources.by_role.items()
    }
    return replace(sources, by_role=by_role)


def _is_calibrated_signal(signal: Signal) -> bool:
    """Return whether the signal is of a kind that a calibration corrects."""
    return isinstance(signal, SpeedSignal | VelocitySignal | ImuSignal)


def _apply_calibration(signal: Signal, calibration: Calibration) -> Signal:
    """Return the signal without the latency, scale, bias and tilt that the calibration knows of it."""
    if isinstance(signal, SpeedSignal):
        scale = calibration.find_constant_or_unknown(signal.source, Kind.SPEED, "scale").value
        return replace(
            signal,
            stamp_ns=signal.stamp_ns - _calibrated_latency_ns(calibration, signal.source, Kind.SPEED),
            speed_mps=signal.speed_mps / (scale if scale > 0.0 else 1.0),
            yaw_rate_radps=signal.yaw_rate_radps - _calibrated_bias(calibration, signal.source),
        )
    if isinstance(signal, VelocitySignal):
        return replace(
            signal, stamp_ns=signal.stamp_ns - _calibrated_latency_ns(calibration, signal.source, Kind.VELOCITY)
        )
    if isinstance(signal, ImuSignal):
        mounting = calibrated_imu_mountings(calibration).get(signal.source)
        gyro_radps = signal.gyro_radps.copy()
        if mounting is not None:
            gyro_radps[:, UP_AXIS_COLUMN_OF_GYRO] = signal.gyro_radps @ mounting.up_unit_vector_in_imu_axes
        gyro_radps[:, UP_AXIS_COLUMN_OF_GYRO] -= _calibrated_bias(calibration, signal.source)
        stamp_ns = signal.stamp_ns - _calibrated_latency_ns(calibration, signal.source, Kind.YAW_RATE)
        return replace(signal, stamp_ns=stamp_ns, gyro_radps=gyro_radps)
    return signal


def _calibrated_latency_ns(calibration: Calibration, source: str, kind: Kind) -> int:
    """Return the latency of a source for one quantity [ns]; 0 where it is not known."""
    latency_s = calibration.find_constant_or_unknown(source, kind, "latency_s").value
    return 0 if np.isnan(latency_s) else round(latency_s * NS_PER_S)


def _calibrated_bias(calibration: Calibration, source: str) -> float:
    """Return the bias of a source's yaw rate [rad/s]; 0 where it is not known."""
    return float(np.nan_to_num(calibration.find_constant_or_unknown(source, Kind.YAW_RATE, "bias").value))
