"""Poses in a Cartesian frame: `Odometry`, `PoseInFrame`, `PoseStamped`, `VehicleKinematicState`, and `VehicleState`
of simulated logs."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from cwcli.lazy_dataclass import replace
from cwcli.signals.angles import wrap_angle
from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.motion import BODY_FRAME_IDS, BodyMotion, read_yaw_rad, speed_signal_from_body_motion
from cwcli.signals.builders.odometry_twist import read_twist
from cwcli.signals.canonical import PoseSignal, SpeedSignal
from cwcli.signals.clocks import build_signal_and_quality, repair_and_order_times
from cwcli.signals.columns import Columns, Field, FloatArray, StampsNsAndIsGiven
from cwcli.signals.covariances import usable_plane_covariance_or_nan, usable_variances_or_nan
from cwcli.signals.direction_of_travel import (
    find_yaw_mounting,
    travel_direction_and_signed_speed,
    velocity_of_positions,
)
from cwcli.signals.leaf_fields import (
    find_field,
    read_frame_id,
    read_integers,
    read_matrix,
    read_numbers,
    read_stamps,
    read_vector,
)
from cwcli.signals.limits import (
    MAX_COORDINATE_M,
    MAX_SPEED_MPS,
    MAX_TURN_RATE_RADPS,
    nan_beyond_limit,
    reject_rows_beyond_limit,
)
from cwcli.signals.quality import Quality, RowLedger

ODOMETRY_POSITION_PATH, ODOMETRY_ORIENTATION_PATH = "pose.pose.position", "pose.pose.orientation"
"""The paths of position and orientation in an `Odometry`."""
KINEMATIC_STATE_PATHS_BY_ODOMETRY_FIELD = {
    f"{ODOMETRY_POSITION_PATH}.x": ("state.x", "state.pose.position.x"),
    f"{ODOMETRY_POSITION_PATH}.y": ("state.y", "state.pose.position.y"),
    f"{ODOMETRY_ORIENTATION_PATH}.x": ("state.pose.orientation.x",),
    f"{ODOMETRY_ORIENTATION_PATH}.y": ("state.pose.orientation.y",),
    f"{ODOMETRY_ORIENTATION_PATH}.z": ("state.heading.imag", "state.pose.orientation.z"),
    f"{ODOMETRY_ORIENTATION_PATH}.w": ("state.heading.real", "state.pose.orientation.w"),
    "twist.twist.linear.x": ("state.longitudinal_velocity_mps",),
    "twist.twist.linear.y": ("state.lateral_velocity_mps",),
    "twist.twist.angular.z": ("state.heading_rate_rps",),
}
"""The fields of this message, by the `Odometry` field that each of them fills."""


def build_pose(columns: Columns, reading: Reading) -> tuple[PoseSignal, Quality]:
    """Build poses. An orientation that is the identity in every message is taken as not given (yaw NaN).

    Speed, direction of travel and yaw rate are those of the twist of an `Odometry`, see `odometry_twist`; only a truth
    is compared with them. Without a twist the way from pose to pose tells how the device is mounted.
    """
    ledger = RowLedger(columns, reading.role)
    base = "pose.pose" if find_field(columns, "pose.pose.position.x") is not None else "pose"
    position_m = read_vector(columns, f"{base}.position")
    yaw_rad = _read_yaw_unless_identity(columns, ledger, f"{base}.orientation")
    twist = read_twist(columns, ledger, position_m, yaw_rad)
    reject_rows_beyond_limit(ledger, position_m[:, :2], MAX_COORDINATE_M)
    covariance = read_matrix(columns, "pose.covariance", 36)
    plane_m2 = usable_plane_covariance_or_nan(ledger, covariance[:, 0], covariance[:, 1], covariance[:, 7])
    heading_variance = usable_variances_or_nan(ledger, covariance[:, 35])
    signal, quality = _make_pose_signal(
        reading,
        ledger,
        position_m,
        yaw_rad,
        twist.speed_mps,
        twist.yaw_rate_radps,
        read_stamps(columns),
        covariance_m2=plane_m2,
        yaw_variance_rad2=heading_variance,
        velocity_mps=np.column_stack([twist.velocity.real, twist.velocity.imag]),
    )
    return _with_direction_of_travel(signal), quality


def build_vehicle_state(columns: Columns, reading: Reading) -> tuple[PoseSignal, Quality]:
    """Build poses from `cwcli.v1.VehicleState` (the truth channel of a simulated log)."""
    ledger = RowLedger(columns, reading.role)
    position_m = np.stack([read_numbers(columns, "x_m"), read_numbers(columns, "y_m"), np.zeros(len(columns))], axis=1)
    reject_rows_beyond_limit(ledger, position_m[:, :2], MAX_COORDINATE_M)
    stamp_ns, has_stamp = read_integers(columns, "stamp_ns")
    heading_rad = wrap_angle(read_numbers(columns, "heading_rad"))
    speed_mps, yaw_rate = read_numbers(columns, "speed_mps"), read_numbers(columns, "yaw_rate_radps")
    has_stamp &= stamp_ns > 0
    more = {name: read_numbers(columns, name) for name in ("latitude_deg", "longitude_deg", "accel_mps2")}
    more["covariance_m2"] = np.full((len(columns), 3), np.nan)
    stamps = stamp_ns, has_stamp
    return _make_pose_signal(reading, ledger, position_m, heading_rad, speed_mps, yaw_rate, stamps, **more)


def build_odometry_speed(columns: Columns, reading: Reading) -> tuple[SpeedSignal, Quality]:
    """Build the speed from the twist of an `Odometry`, see `odometry_twist`.

    A mounting of the device, which only the whole log would show, takes no part.
    """
    ledger = RowLedger(columns, reading.role)
    yaw_rad = _read_yaw_unless_identity(columns, ledger, "pose.pose.orientation")
    twist = read_twist(columns, ledger, read_vector(columns, "pose.pose.position"), yaw_rad)
    motion = BodyMotion(twist.speed_mps, twist.yaw_rate_radps, twist.speed_variance, twist.yaw_rate_variance)
    return speed_signal_from_body_motion(columns, reading, ledger, motion)


def build_kinematic_state_pose(columns: Columns, reading: Reading) -> tuple[PoseSignal, Quality]:
    """Build poses from a `VehicleKinematicState` of Autoware.Auto, where the frame does not move with the vehicle.

    Older ones have x, y and a heading whose two parts are w and z of a quaternion, half the angle; later ones a pose.
    """
    signal, quality = build_pose(_convert_to_odometry_columns(columns), reading)
    if _has_vehicle_fixed_frame(columns):
        quality.notes += ("its frame moves with the vehicle, so it has no position",)
    return signal, quality


def build_kinematic_state_speed(columns: Columns, reading: Reading) -> tuple[SpeedSignal, Quality]:
    """Build the speed and the yaw rate from a `VehicleKinematicState`."""
    return build_odometry_speed(_convert_to_odometry_columns(columns), reading)


def _convert_to_odometry_columns(columns: Columns) -> Columns:
    fields: dict[str, Field] = {name: field for name, field in columns.fields.items() if name.startswith("header.")}
    for name, paths in KINEMATIC_STATE_PATHS_BY_ODOMETRY_FIELD.items():
        found = find_field(columns, *paths)
        if found is not None:
            fields[name] = found
    zero = np.zeros(len(columns))
    fields = {
        f"{ODOMETRY_ORIENTATION_PATH}.x": zero,
        f"{ODOMETRY_ORIENTATION_PATH}.y": zero,
        f"{ODOMETRY_POSITION_PATH}.z": zero,
        **fields,
    }
    if _has_vehicle_fixed_frame(columns):
        fields |= {f"{ODOMETRY_POSITION_PATH}.{axis}": zero + np.nan for axis in "xy"}
    return replace(columns, fields=fields)


def _has_vehicle_fixed_frame(columns: Columns) -> bool:
    return read_frame_id(columns).lower() in BODY_FRAME_IDS


def _make_pose_signal(
    reading: Reading,
    ledger: RowLedger,
    position_m: FloatArray,
    yaw_rad: FloatArray,
    speed_mps: FloatArray,
    yaw_rate_radps: FloatArray,
    stamps_ns_and_is_given: StampsNsAndIsGiven,
    **other_columns: Any,
) -> tuple[PoseSignal, Quality]:
    """Make the signal; `other_columns`: its other columns, by row."""
    columns = ledger.columns
    speed_mps = nan_beyond_limit(ledger, speed_mps, MAX_SPEED_MPS, "speed")
    yaw_rate_radps = nan_beyond_limit(ledger, yaw_rate_radps, MAX_TURN_RATE_RADPS, "yaw rate")
    timeline = repair_and_order_times(ledger, *stamps_ns_and_is_given, reading.clock, [position_m, yaw_rad])
    return build_signal_and_quality(
        partial(PoseSignal, frame_id=read_frame_id(columns)),
        ledger,
        timeline,
        x_m=position_m[:, 0],
        y_m=position_m[:, 1],
        z_m=position_m[:, 2],
        yaw_rad=yaw_rad,
        speed_mps=speed_mps,
        yaw_rate_radps=yaw_rate_radps,
        **other_columns,
    )


def _with_direction_of_travel(signal: PoseSignal) -> PoseSignal:
    """The pose with the direction of travel, the speed along it, and how its device is mounted."""
    assert signal.velocity_mps is not None
    velocity = signal.velocity_mps[:, 0] + 1j * signal.velocity_mps[:, 1]
    has_velocity = bool(np.isfinite(velocity).any())
    xy_m = np.column_stack([signal.x_m, signal.y_m])
    shown = velocity if has_velocity else velocity_of_positions(signal.stamp_ns, xy_m)
    mounting = find_yaw_mounting(signal.stamp_ns, shown, signal.yaw_rad, signal.yaw_rate_radps)
    left_rad = 0.0 if mounting is None else mounting.correction_rad
    if not has_velocity:
        return replace(signal, heading_rad=wrap_angle(signal.yaw_rad - left_rad), mounting=mounting)
    heading_rad, speed_mps = travel_direction_and_signed_speed(velocity, signal.yaw_rad, left_rad)
    is_known = np.isfinite(velocity) & np.isfinite(signal.yaw_rad)
    return replace(
        signal,
        heading_rad=np.where(is_known, heading_rad, wrap_angle(signal.yaw_rad - left_rad)),
        speed_mps=np.where(is_known & np.isfinite(signal.speed_mps), speed_mps, signal.speed_mps),
        mounting=mounting,
    )


def _read_yaw_unless_identity(columns: Columns, ledger: RowLedger, base: str) -> FloatArray:
    yaw_rad = read_yaw_rad(columns, base)
    w = read_numbers(columns, f"{base}.w")
    if len(w) > 1 and np.all(w == 1.0):
        ledger.add_note("orientation is the identity in every message, taken as not given")
        return np.full(len(columns), np.nan)
    return yaw_rad
