"""Poses in a Cartesian frame: `Odometry`, `PoseInFrame`, `PoseStamped`, and `VehicleState` of simulated logs."""

from __future__ import annotations

import numpy as np

from cwcli.signals.angles import wrap_angle
from cwcli.signals.build_motion import BODY_FRAMES, MAP_FRAMES, NOT_FINITE, build_twist, filled, yaw_of
from cwcli.signals.canonical import PoseSignal, SpeedSignal, VelocitySignal
from cwcli.signals.clocks import settle
from cwcli.signals.codec import Reading, Role
from cwcli.signals.columns import Columns, FloatArray, Int64Array
from cwcli.signals.covariances import given_plane_covariance
from cwcli.signals.leaves import find, frame_id, matrix, numbers, stamps, vector, whole_numbers
from cwcli.signals.quality import BoolArray, Quality, RowLedger


def build_pose(columns: Columns, reading: Reading) -> tuple[PoseSignal, Quality]:
    """Build poses. An orientation that is the identity in every message is taken as not given (yaw NaN).

    The twist of an `Odometry` is in the child frame: its x is the speed. Where there is no orientation, or the child
    frame is a map frame, the speed is the magnitude of the velocity.
    """
    ledger = RowLedger(columns, reading.role)
    base = "pose.pose" if find(columns, "pose.pose.position.x") is not None else "pose"
    position_m = vector(columns, f"{base}.position")
    yaw_rad = _given_yaw(columns, ledger, f"{base}.orientation")
    speed_mps, yaw_rate = _motion(columns, ledger, yaw_rad)
    ledger.reject(~(np.isfinite(position_m[:, 0]) & np.isfinite(position_m[:, 1])), NOT_FINITE)
    covariance = matrix(columns, "pose.covariance", 36)
    plane_m2 = given_plane_covariance(ledger, covariance[:, 0], covariance[:, 1], covariance[:, 7])
    return _pose(columns, reading, ledger, position_m, yaw_rad, speed_mps, yaw_rate, plane_m2, *stamps(columns))


def build_vehicle_state(columns: Columns, reading: Reading) -> tuple[PoseSignal, Quality]:
    """Build poses from `cwcli.v1.VehicleState` (the truth channel of a simulated log)."""
    ledger = RowLedger(columns, reading.role)
    position_m = np.stack([numbers(columns, "x_m"), numbers(columns, "y_m"), np.zeros(len(columns))], axis=1)
    ledger.reject(~(np.isfinite(position_m[:, 0]) & np.isfinite(position_m[:, 1])), NOT_FINITE)
    stamp_ns, has_stamp = whole_numbers(columns, "stamp_ns")
    nothing = np.full((len(columns), 3), np.nan)
    heading_rad = wrap_angle(numbers(columns, "heading_rad"))
    speed_mps, yaw_rate = numbers(columns, "speed_mps"), numbers(columns, "yaw_rate_radps")
    has_stamp &= stamp_ns > 0
    return _pose(columns, reading, ledger, position_m, heading_rad, speed_mps, yaw_rate, nothing, stamp_ns, has_stamp)


def build_odometry_speed(columns: Columns, reading: Reading) -> tuple[VelocitySignal | SpeedSignal, Quality]:
    """Build the speed from the twist of an `Odometry` (child frame)."""
    forced = Reading(role=Role.EGO_SPEED, clock=reading.clock, is_override=True)
    return build_twist(columns, forced)


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
) -> tuple[PoseSignal, Quality]:
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
    )
    return signal, ledger.quality


def _given_yaw(columns: Columns, ledger: RowLedger, base: str) -> FloatArray:
    yaw_rad = yaw_of(columns, base)
    w = numbers(columns, f"{base}.w")
    if len(w) > 1 and np.all(w == 1.0):
        ledger.note("orientation is the identity in every message, taken as not given")
        return np.full(len(columns), np.nan)
    return yaw_rad


def _motion(columns: Columns, ledger: RowLedger, yaw_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Speed and yaw rate of the twist, NaN where the message has none."""
    if find(columns, "twist.twist.linear.x") is None:
        nothing = np.full(len(columns), np.nan)
        return nothing, nothing
    x_mps, y_mps = numbers(columns, "twist.twist.linear.x"), numbers(columns, "twist.twist.linear.y")
    yaw_rate = filled(ledger, numbers(columns, "twist.twist.angular.z"), "yaw rate")
    child = frame_id(columns, "child_frame_id")
    is_map = child in MAP_FRAMES or (child == frame_id(columns) and child not in BODY_FRAMES)
    if is_map or not np.isfinite(yaw_rad).any():
        ledger.note("the speed is the magnitude of the twist")
        return np.hypot(x_mps, y_mps), yaw_rate
    return x_mps, yaw_rate
