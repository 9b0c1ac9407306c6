"""SBG Systems' `SbgGpsPos`, `SbgGpsVel`, `SbgEkfNav`, `SbgEkfEuler` and `SbgImuData` (package `sbg_driver`).

Their axes are north-east-down or east-north-up by the driver's settings; only the frame name shows which: the driver
calls it `imu_link_ned` or `imu_link`. Messages of a frame whose name says neither are not used, but positions are:
latitude and longitude have names of their own. What the driver calls east-north-up in `SbgImuData` are other axes of
the device from one of its versions to the next, so that it counts in north-east-down alone: forward, right, down.
"""

from __future__ import annotations

import re

import numpy as np

from cwcli.signals.angles import wrap_angle
from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.gnss import (
    GnssFix,
    axes_covariance,
    heading_builder,
    heading_of_compass,
    position_builder,
    velocity_builder,
)
from cwcli.signals.canonical import ImuSignal
from cwcli.signals.clocks import settle
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.leaf_fields import frame_id, numbers, stamps, vector
from cwcli.signals.limits import MAX_ACCEL_MPS2, MAX_TURN_RATE_RADPS, reject_unusable
from cwcli.signals.quality import BoolArray, Quality, RowLedger

NO_AXES = "the frame name contains neither ned (north-east-down) nor enu (east-north-up)"
"""The reason for rejecting messages whose frame name does not say which axes they use."""
NO_IMU_AXES = "the frame name does not contain ned (north-east-down)"
"""The reason for rejecting inertial messages whose axes are not known."""
DRIVERS_ENU = "imu_link"
"""The frame id that the driver gives to its east-north-up messages."""


def read_gps_pos(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read positions of `SbgGpsPos`; without known axes, the larger accuracy counts in every direction."""
    accuracy = _horizontal(columns, "position_accuracy")
    return GnssFix(
        *stamps(columns),
        is_fix=(numbers(columns, "status.status") == 0) & (numbers(columns, "status.type") > 0),
        latitude_deg=numbers(columns, "latitude"),
        longitude_deg=numbers(columns, "longitude"),
        altitude_m=numbers(columns, "altitude") + numbers(columns, "undulation"),
        position_covariance_m2=_covariance(columns, accuracy),
    )


def read_gps_vel(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read velocities of `SbgGpsVel`."""
    is_solved = (numbers(columns, "status.vel_status") == 0) & (numbers(columns, "status.vel_type") > 0)
    return _velocity(columns, ledger, is_solved)


def read_ekf_nav(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read the filter's position from `SbgEkfNav`; older drivers have it as a vector."""
    accuracy = _horizontal(columns, "position_accuracy")
    return GnssFix(
        *stamps(columns),
        is_fix=numbers(columns, "status.position_valid") == 1,
        latitude_deg=numbers(columns, "latitude", "position.x"),
        longitude_deg=numbers(columns, "longitude", "position.y"),
        altitude_m=numbers(columns, "altitude", "position.z") + numbers(columns, "undulation"),
        position_covariance_m2=_covariance(columns, accuracy),
    )


def read_ekf_velocity(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read the filter's velocity from `SbgEkfNav`."""
    return _velocity(columns, ledger, numbers(columns, "status.velocity_valid") == 1)


def read_ekf_euler(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read the filter's heading (rad) from `SbgEkfEuler`."""
    axes = _axes(columns)
    if not axes:
        ledger.reject(np.ones(len(columns), np.bool_), NO_AXES)
    angle_rad = numbers(columns, "angle.z")
    angle_rad = np.where(np.abs(angle_rad) <= 4.0 * np.pi, angle_rad, np.nan)
    heading_rad = wrap_angle(angle_rad) if axes == "enu" else heading_of_compass(np.rad2deg(angle_rad))
    with np.errstate(over="ignore"):
        variance = numbers(columns, "accuracy.z") ** 2
    is_valid = numbers(columns, "status.heading_valid") == 1
    return GnssFix(*stamps(columns), is_valid, heading_rad=heading_rad, heading_variance_rad2=variance)


def build_imu(columns: Columns, reading: Reading) -> tuple[ImuSignal, Quality]:
    """Build inertial measurements from `SbgImuData`, in the vehicle's axes: forward, left, up."""
    ledger = RowLedger(columns, reading.role)
    if _axes(columns) != "ned":
        ledger.reject(np.ones(len(columns), np.bool_), NO_IMU_AXES)
    flipped = np.array([1.0, -1.0, -1.0])
    accel_mps2, gyro_radps = flipped * vector(columns, "accel"), flipped * vector(columns, "gyro")
    reject_unusable(ledger, accel_mps2, MAX_ACCEL_MPS2)
    reject_unusable(ledger, gyro_radps, MAX_TURN_RATE_RADPS)
    timeline = settle(ledger, *stamps(columns), reading.clock, [accel_mps2, gyro_radps])
    rows = timeline.rows
    nothing = np.full((len(rows), 3), np.nan)
    signal = ImuSignal(
        source=columns.topic,
        stamp_ns=timeline.stamp_ns,
        log_time_ns=columns.log_time_ns[rows],
        accel_mps2=accel_mps2[rows],
        gyro_radps=gyro_radps[rows],
        accel_variance=nothing,
        gyro_variance=nothing,
    )
    return signal, ledger.quality


build_position = position_builder(read_gps_pos)
build_velocity = velocity_builder(read_gps_vel)
build_ekf_position = position_builder(read_ekf_nav)
build_ekf_velocity = velocity_builder(read_ekf_velocity)
build_heading = heading_builder(read_ekf_euler)


def _axes(columns: Columns) -> str:
    """Return `ned`, `enu`, or "" where the frame name does not say which axes are used."""
    frame = frame_id(columns).lower()
    parts = set(re.split(r"[^a-z]+", frame))
    found = parts & {"ned", "enu"}
    return found.pop() if len(found) == 1 else "enu" if frame == DRIVERS_ENU else ""


def _horizontal(columns: Columns, name: str) -> FloatArray:
    """Read east and north of a vector, (n, 2), as far as the axes are known."""
    x, y = numbers(columns, f"{name}.x"), numbers(columns, f"{name}.y")
    return np.stack([y, x] if _axes(columns) == "ned" else [x, y], axis=1)


def _covariance(columns: Columns, accuracy: FloatArray) -> FloatArray:
    if not _axes(columns):
        accuracy = np.repeat(accuracy.max(axis=1, keepdims=True), 2, axis=1)
    return axes_covariance(accuracy[:, 0], accuracy[:, 1])


def _velocity(columns: Columns, ledger: RowLedger, is_valid: BoolArray) -> GnssFix:
    if not _axes(columns):
        ledger.reject(np.ones(len(columns), np.bool_), NO_AXES)
    return GnssFix(
        *stamps(columns),
        is_fix=is_valid,
        velocity_mps=_horizontal(columns, "velocity"),
        velocity_covariance_m2ps2=_covariance(columns, _horizontal(columns, "velocity_accuracy")),
    )
