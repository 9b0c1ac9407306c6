"""Velocity, speed, heading, steering angle: twists, reports of Autoware, `QuaternionStamped`, an IMU's orientation.

A twist says in its frame_id whether it is in map axes (a velocity over ground) or in body axes (a speed). Where the
frame_id says neither, or the user named the channel for the role, the role decides.
"""

from __future__ import annotations

import numpy as np

from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.angles import rotation_matrices_of_unit_quaternions
from cwcli.signals.builders.base import Reading
from cwcli.signals.canonical import HeadingSignal, SpeedSignal, SteerSignal, VelocitySignal
from cwcli.signals.clocks import build_signal_and_quality, repair_and_order_times
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.covariances import usable_plane_covariance_or_nan, usable_variances_or_nan
from cwcli.signals.leaf_fields import read_frame_id, read_matrix, read_numbers, read_stamps
from cwcli.signals.limits import (
    MAX_ROAD_WHEEL_STEER_RAD,
    MAX_SPEED_MPS,
    MAX_TURN_RATE_RADPS,
    nan_beyond_limit,
    reject_rows_beyond_limit,
)
from cwcli.signals.quality import Quality, RowLedger
from cwcli.signals.role import Role

MAP_FRAME_IDS = frozenset(
    {"map", "enu", "earth", "world", "utm", "local_enu", "local", "map_enu", "navsat", "ecef_enu"}
)
"""The frame ids that mean east-north axes; collected from common drivers."""
BODY_FRAME_IDS = frozenset({"base_link", "base_footprint", "body", "vehicle", "car", "ego", "rear_axle", "base"})
"""The frame ids that mean the vehicle's axes; collected from common drivers."""
MIN_QUATERNION_NORM, MAX_QUATERNION_NORM = 1e-3, 1e3
"""The norms (1) of a quaternion below and above which it is not used; chosen by hand."""
NO_ORIENTATION_REASON = "orientation not given"
"""The reason for rejecting a message without a usable orientation."""


@dataclass(frozen=True)
class BodyMotion:
    """The motion of the body, shape (n,) each, NaN where not given.

    Attributes:
        speed_mps: In the direction of travel, negative in reverse.
        yaw_rate_radps: Counter-clockwise positive.
        speed_variance, yaw_rate_variance: Variances in (m/s)^2 and (rad/s)^2, unchecked.
    """

    speed_mps: FloatArray
    yaw_rate_radps: FloatArray
    speed_variance: FloatArray
    yaw_rate_variance: FloatArray


def build_twist(columns: Columns, reading: Reading) -> tuple[VelocitySignal | SpeedSignal, Quality]:
    """Build a velocity or a speed from `TwistStamped` or `TwistWithCovarianceStamped`, by frame_id and role."""
    base = "twist.twist" if "twist.twist.linear.x" in columns.fields else "twist"
    frame = read_frame_id(columns)
    is_map = reading.role == Role.EGO_VELOCITY
    if not reading.is_override:
        is_map = frame in MAP_FRAME_IDS or (is_map and frame not in BODY_FRAME_IDS)
    covariance = read_matrix(columns, "twist.covariance", 36)
    ledger = RowLedger(columns, reading.role)
    east_or_forward, north_or_left = (
        read_numbers(columns, f"{base}.linear.x"),
        read_numbers(columns, f"{base}.linear.y"),
    )
    if is_map:
        if frame in BODY_FRAME_IDS:
            ledger.add_note(f"frame_id {frame} names body axes; they are read as east and north, as the role requires")
        return _make_velocity_signal(columns, reading, ledger, east_or_forward, north_or_left, covariance)
    yaw_rate = nan_if_always_zero(ledger, read_numbers(columns, f"{base}.angular.z"), "yaw rate")
    speed = east_or_forward
    if frame in MAP_FRAME_IDS:
        speed = np.hypot(east_or_forward, north_or_left)
        ledger.add_note(f"frame_id {frame} names map axes, the speed is the magnitude of the velocity")
    return speed_signal_from_body_motion(
        columns, reading, ledger, BodyMotion(speed, yaw_rate, covariance[:, 0], covariance[:, 35])
    )


def build_speed_from_unstamped_twist(columns: Columns, reading: Reading) -> tuple[SpeedSignal, Quality]:
    """Build a speed from `Twist` or `TwistWithCovariance`, which have neither time nor frame: the log's, body axes."""
    base = "twist." if "twist.linear.x" in columns.fields else ""
    covariance = read_matrix(columns, "covariance", 36)
    ledger = RowLedger(columns, reading.role)
    yaw_rate = nan_if_always_zero(ledger, read_numbers(columns, f"{base}angular.z"), "yaw rate")
    motion = BodyMotion(read_numbers(columns, f"{base}linear.x"), yaw_rate, covariance[:, 0], covariance[:, 35])
    return speed_signal_from_body_motion(columns, replace(reading, clock="log"), ledger, motion)


def build_speed_from_unstamped_float(columns: Columns, reading: Reading) -> tuple[SpeedSignal, Quality]:
    """Build a speed from `Float32` or `Float64`, taken as m/s along the body, at the log's time."""
    nothing = np.full(len(columns), np.nan)
    motion = BodyMotion(read_numbers(columns, "data"), nothing, nothing, nothing)
    return speed_signal_from_body_motion(
        columns, replace(reading, clock="log"), RowLedger(columns, reading.role), motion
    )


def build_velocity_report(columns: Columns, reading: Reading) -> tuple[SpeedSignal, Quality]:
    """Build a speed from Autoware's `VelocityReport` (longitudinal_velocity m/s, heading_rate rad/s, left positive)."""
    ledger = RowLedger(columns, reading.role)
    yaw_rate = nan_if_always_zero(ledger, read_numbers(columns, "heading_rate"), "yaw rate")
    nothing = np.full(len(columns), np.nan)
    motion = BodyMotion(read_numbers(columns, "longitudinal_velocity"), yaw_rate, nothing, nothing)
    return speed_signal_from_body_motion(columns, reading, ledger, motion)


def build_quaternion_heading(columns: Columns, reading: Reading) -> tuple[HeadingSignal, Quality]:
    """Build a heading from `QuaternionStamped` or an `Imu`'s orientation: yaw of map-from-body, ENU (REP-103)."""
    base = "quaternion" if "quaternion.w" in columns.fields else "orientation"
    ledger = RowLedger(columns, reading.role)
    yaw_rad = read_yaw_rad(columns, base)
    orientation_covariance = read_matrix(columns, "orientation_covariance", 9)
    ledger.reject(orientation_covariance[:, 0] == -1.0, NO_ORIENTATION_REASON)
    ledger.reject(~np.isfinite(yaw_rad), NO_ORIENTATION_REASON)
    variance = usable_variances_or_nan(ledger, orientation_covariance[:, 8])
    timeline = repair_and_order_times(ledger, *read_stamps(columns), reading.clock, [yaw_rad])
    return build_signal_and_quality(HeadingSignal, ledger, timeline, heading_rad=yaw_rad, variance_rad2=variance)


def build_steering_report(columns: Columns, reading: Reading) -> tuple[SteerSignal, Quality]:
    """Build a steering angle of the front wheels; both message types count it in radians, left positive."""
    ledger = RowLedger(columns, reading.role)
    steer_rad = read_numbers(columns, "steering_tire_angle", "drive.steering_angle")
    reject_rows_beyond_limit(ledger, steer_rad, MAX_ROAD_WHEEL_STEER_RAD)
    timeline = repair_and_order_times(ledger, *read_stamps(columns), reading.clock, [steer_rad])
    return build_signal_and_quality(SteerSignal, ledger, timeline, steer_rad=steer_rad)


def read_yaw_rad(columns: Columns, base: str) -> FloatArray:
    """Yaw of the quaternion at `base`, radians in (-pi, pi], shape (n,); NaN for one that is far from unit length."""
    x, y, z, w = _read_unit_quaternion(columns, base)
    yaw_rad = np.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return np.where(np.isfinite(x), yaw_rad, np.nan)


def read_rotation_matrices(columns: Columns, base: str) -> FloatArray:
    """Rotation matrices of the quaternion at `base`, from the child's axes to the parent's, shape (n, 3, 3).

    NaN for one that is far from unit length.
    """
    return rotation_matrices_of_unit_quaternions(_read_unit_quaternion(columns, base))


def _read_unit_quaternion(columns: Columns, base: str) -> FloatArray:
    """x, y, z, w of unit length, shape (4, n); NaN for one that is far from it."""
    quaternion = np.stack([read_numbers(columns, f"{base}.{name}") for name in "xyzw"])
    is_given = (np.abs(quaternion) < MAX_QUATERNION_NORM).all(axis=0)
    length = np.sqrt((np.where(is_given, quaternion, 0.0) ** 2).sum(axis=0))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(length > MIN_QUATERNION_NORM, quaternion / length, np.nan)


def nan_if_always_zero(ledger: RowLedger, values: FloatArray, name: str) -> FloatArray:
    """Return the values (n,), or all NaN when every one is exactly 0, because the sender never fills the field.

    Args:
        values: Shape (n,), any unit; what is not finite becomes NaN.
    """
    if len(values) > 1 and not np.any(values):
        ledger.add_note(f"{name} is exactly 0 in every message, taken as not measured")
        return np.full(len(values), np.nan)
    return np.where(np.isfinite(values), values, np.nan)


def _make_velocity_signal(
    columns: Columns,
    reading: Reading,
    ledger: RowLedger,
    east_mps: FloatArray,
    north_mps: FloatArray,
    covariance: FloatArray,
) -> tuple[VelocitySignal, Quality]:
    reject_rows_beyond_limit(ledger, np.stack([east_mps, north_mps], axis=1), MAX_SPEED_MPS)
    plane = usable_plane_covariance_or_nan(ledger, covariance[:, 0], covariance[:, 1], covariance[:, 7])
    timeline = repair_and_order_times(ledger, *read_stamps(columns), reading.clock, [east_mps, north_mps])
    return build_signal_and_quality(
        VelocitySignal, ledger, timeline, east_mps=east_mps, north_mps=north_mps, covariance_m2ps2=plane
    )


def speed_signal_from_body_motion(
    columns: Columns, reading: Reading, ledger: RowLedger, motion: BodyMotion
) -> tuple[SpeedSignal, Quality]:
    """Build the speed signal from the body's motion; rows without a usable speed are rejected."""
    reject_rows_beyond_limit(ledger, motion.speed_mps, MAX_SPEED_MPS)
    yaw_rate_radps = nan_beyond_limit(ledger, motion.yaw_rate_radps, MAX_TURN_RATE_RADPS, "yaw rate")
    variances = usable_variances_or_nan(ledger, np.stack([motion.speed_variance, motion.yaw_rate_variance], axis=1))
    timeline = repair_and_order_times(ledger, *read_stamps(columns), reading.clock, [motion.speed_mps, yaw_rate_radps])
    return build_signal_and_quality(
        SpeedSignal,
        ledger,
        timeline,
        speed_mps=motion.speed_mps,
        yaw_rate_radps=yaw_rate_radps,
        speed_variance_m2ps2=variances[:, 0],
        yaw_rate_variance_rad2ps2=variances[:, 1],
    )
