"""Poses in a Cartesian frame: `Odometry`, `PoseInFrame`, `PoseStamped`, and `VehicleState` of simulated logs."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.signals.angles import wrap_angle
from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.motion import BodyMotion, build_speed, filled, yaw_of
from cwcli.signals.canonical import PoseSignal, SpeedSignal
from cwcli.signals.clocks import settle
from cwcli.signals.columns import Columns, FloatArray, Int64Array
from cwcli.signals.covariances import given_plane_covariance, given_variances
from cwcli.signals.leaf_fields import find, frame_id, matrix, numbers, stamps, vector, whole_numbers
from cwcli.signals.limits import MAX_POSITION_M, MAX_SPEED_MPS, MAX_TURN_RATE_RADPS, reject_unusable, within
from cwcli.signals.quality import BoolArray, Quality, RowLedger

ComplexArray = npt.NDArray[np.complex128]

MIN_SPEED_FOR_AXES_MPS = 0.5
"""The speed in m/s above which a row helps to tell in which axes a twist is. Chosen by hand; not fitted."""
MIN_ROWS_FOR_AXES = 10
"""The number of such rows that are needed to tell. Chosen by hand; not fitted."""
MAX_SLIP = 0.1
"""The largest ratio (1) of sideways to forward speed that a car drives with; chosen by hand."""


def build_pose(columns: Columns, reading: Reading) -> tuple[PoseSignal, Quality]:
    """Build poses. An orientation that is the identity in every message is taken as not given (yaw NaN).

    Speed and yaw rate are those of the twist of an `Odometry`; only a truth is compared with them.
    """
    ledger = RowLedger(columns, reading.role)
    base = "pose.pose" if find(columns, "pose.pose.position.x") is not None else "pose"
    position_m = vector(columns, f"{base}.position")
    yaw_rad = _given_yaw(columns, ledger, f"{base}.orientation")
    motion = _motion(columns, ledger, position_m, yaw_rad)
    reject_unusable(ledger, position_m[:, :2], MAX_POSITION_M)
    covariance = matrix(columns, "pose.covariance", 36)
    plane_m2 = given_plane_covariance(ledger, covariance[:, 0], covariance[:, 1], covariance[:, 7])
    heading_variance = given_variances(ledger, covariance[:, 35])
    return _pose(
        columns,
        reading,
        ledger,
        position_m,
        yaw_rad,
        motion.speed_mps,
        motion.yaw_rate_radps,
        plane_m2,
        *stamps(columns),
        yaw_variance_rad2=heading_variance,
    )


def build_vehicle_state(columns: Columns, reading: Reading) -> tuple[PoseSignal, Quality]:
    """Build poses from `cwcli.v1.VehicleState` (the truth channel of a simulated log)."""
    ledger = RowLedger(columns, reading.role)
    position_m = np.stack([numbers(columns, "x_m"), numbers(columns, "y_m"), np.zeros(len(columns))], axis=1)
    reject_unusable(ledger, position_m[:, :2], MAX_POSITION_M)
    stamp_ns, has_stamp = whole_numbers(columns, "stamp_ns")
    nothing = np.full((len(columns), 3), np.nan)
    heading_rad = wrap_angle(numbers(columns, "heading_rad"))
    speed_mps, yaw_rate = numbers(columns, "speed_mps"), numbers(columns, "yaw_rate_radps")
    has_stamp &= stamp_ns > 0
    more = {name: numbers(columns, name) for name in ("latitude_deg", "longitude_deg", "accel_mps2")}
    return _pose(
        columns, reading, ledger, position_m, heading_rad, speed_mps, yaw_rate, nothing, stamp_ns, has_stamp, **more
    )


def build_odometry_speed(columns: Columns, reading: Reading) -> tuple[SpeedSignal, Quality]:
    """Build the speed from the twist of an `Odometry`."""
    ledger = RowLedger(columns, reading.role)
    yaw_rad = _given_yaw(columns, ledger, "pose.pose.orientation")
    motion = _motion(columns, ledger, vector(columns, "pose.pose.position"), yaw_rad)
    return build_speed(columns, reading, ledger, motion)


def _pose(
    columns: Columns,
    reading: Reading,
    ledger: RowLedger,
    position_m: FloatArray,
    yaw_rad: FloatArray,
    speed_mps: FloatArray,
    yaw_rate_radps: FloatArray,
    covariance_m2: FloatArray,
    stamp_ns: Int64Array,
    has_stamp: BoolArray,
    **more: Any,
) -> tuple[PoseSignal, Quality]:
    speed_mps = within(ledger, speed_mps, MAX_SPEED_MPS, "speed")
    yaw_rate_radps = within(ledger, yaw_rate_radps, MAX_TURN_RATE_RADPS, "yaw rate")
    timeline = settle(ledger, stamp_ns, has_stamp, reading.clock, [position_m, yaw_rad])
    rows = timeline.rows
    signal = PoseSignal(
        source=columns.topic,
        frame_id=frame_id(columns),
        stamp_ns=timeline.stamp_ns,
        log_time_ns=columns.log_time_ns[rows],
        x_m=position_m[rows, 0],
        y_m=position_m[rows, 1],
        z_m=position_m[rows, 2],
        yaw_rad=yaw_rad[rows],
        speed_mps=speed_mps[rows],
        yaw_rate_radps=yaw_rate_radps[rows],
        covariance_m2=covariance_m2[rows],
        **{name: values[rows] for name, values in more.items()},
    )
    return signal, ledger.quality


def _given_yaw(columns: Columns, ledger: RowLedger, base: str) -> FloatArray:
    yaw_rad = yaw_of(columns, base)
    w = numbers(columns, f"{base}.w")
    if len(w) > 1 and np.all(w == 1.0):
        ledger.note("orientation is the identity in every message, taken as not given")
        return np.full(len(columns), np.nan)
    return yaw_rad


def _motion(columns: Columns, ledger: RowLedger, position_m: FloatArray, yaw_rad: FloatArray) -> BodyMotion:
    """Return speed and yaw rate from the twist of an `Odometry`, NaN where the message has none.

    It is in the child frame, so its x is the speed, whatever the frame of the pose is called. Some senders put it in
    the axes of the pose; the path from pose to pose shows that, and it is rotated by the yaw. Where no orientation is
    given and the twist points to the side, too, as no car drives, the speed is its magnitude.
    """
    n = len(columns)
    if find(columns, "twist.twist.linear.x") is None:
        return BodyMotion(*np.full((4, n), np.nan))
    twist = numbers(columns, "twist.twist.linear.x") + 1j * numbers(columns, "twist.twist.linear.y")
    forward = np.ones(n, np.complex128)
    if np.isfinite(yaw_rad).any():
        if _is_map_twist(columns, position_m, yaw_rad, twist):
            ledger.note("the twist is in the axes of the pose, not of the child frame: it is rotated by the yaw")
            forward = np.exp(1j * yaw_rad)
    elif np.nansum(np.abs(twist.imag)) > MAX_SLIP * np.nansum(np.abs(twist.real)):
        ledger.note("the speed is the magnitude of the twist")
        forward = np.exp(1j * np.angle(twist))
    covariance = matrix(columns, "twist.covariance", 36)
    variance, x, y = covariance[:, 0], forward.real, forward.imag
    if y.any():
        with np.errstate(invalid="ignore", over="ignore"):
            variance = x * x * variance + 2.0 * x * y * covariance[:, 1] + y * y * covariance[:, 7]
    return BodyMotion(
        speed_mps=(twist * forward.conj()).real,
        yaw_rate_radps=filled(ledger, numbers(columns, "twist.twist.angular.z"), "yaw rate"),
        speed_variance=variance,
        yaw_rate_variance=covariance[:, 35],
    )


def _is_map_twist(columns: Columns, position_m: FloatArray, yaw_rad: FloatArray, twist: ComplexArray) -> bool:
    """Return whether the path from pose to pose fits the twist as it is clearly better than the twist turned by the
    yaw."""
    stamp_ns, has_stamp = stamps(columns)
    step_s = np.diff(stamp_ns) * 1e-9
    with np.errstate(divide="ignore", invalid="ignore"):
        driven = np.diff(position_m[:, 0] + 1j * position_m[:, 1]) / step_s
    middle = 0.5 * (twist[:-1] + twist[1:])
    use = has_stamp[:-1] & has_stamp[1:] & (step_s > 0.0) & np.isfinite(driven) & np.isfinite(middle * yaw_rad[:-1])
    use &= np.abs(middle) > MIN_SPEED_FOR_AXES_MPS
    if np.count_nonzero(use) < MIN_ROWS_FOR_AXES:
        return False
    as_map = np.mean(np.abs(driven - middle)[use])
    as_child = np.mean(np.abs(driven - middle * np.exp(1j * yaw_rad[:-1]))[use])
    return bool(as_map < 0.5 * as_child)
