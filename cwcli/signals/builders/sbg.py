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
    covariance_of_east_north_sigmas,
    heading_from_compass_or_nan,
)
from cwcli.signals.canonical import ImuSignal
from cwcli.signals.clocks import build_signal_and_quality, repair_and_order_times
from cwcli.signals.columns import BoolArray, Columns, FloatArray
from cwcli.signals.leaf_fields import read_frame_id, read_numbers, read_stamps, read_vector
from cwcli.signals.limits import MAX_ACCEL_MPS2, MAX_TURN_RATE_RADPS, reject_rows_beyond_limit
from cwcli.signals.quality import Quality, RowLedger

UNKNOWN_AXES_REASON = "the frame name contains neither ned (north-east-down) nor enu (east-north-up)"
"""The reason for rejecting messages whose frame name does not say which axes they use."""
DRIVER_ENU_FRAME_ID = "imu_link"
"""The frame id that the driver gives to its east-north-up messages."""


def read_sbg_gps_position(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read positions of `SbgGpsPos`; without known axes, the larger accuracy counts in every direction."""
    accuracy = _read_east_north(columns, "position_accuracy")
    return GnssFix(
        *read_stamps(columns),
        is_fix=(read_numbers(columns, "status.status") == 0) & (read_numbers(columns, "status.type") > 0),
        latitude_deg=read_numbers(columns, "latitude"),
        longitude_deg=read_numbers(columns, "longitude"),
        altitude_m=read_numbers(columns, "altitude") + read_numbers(columns, "undulation"),
        position_covariance_m2=_plane_covariance_of_accuracy(columns, accuracy),
    )


def read_gps_vel(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read velocities of `SbgGpsVel`."""
    is_solved = (read_numbers(columns, "status.vel_status") == 0) & (read_numbers(columns, "status.vel_type") > 0)
    return _read_velocity_fix(columns, ledger, is_solved)


def read_ekf_nav_position(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read the filter's position from `SbgEkfNav`; older drivers have it as a vector."""
    accuracy = _read_east_north(columns, "position_accuracy")
    return GnssFix(
        *read_stamps(columns),
        is_fix=read_numbers(columns, "status.position_valid") == 1,
        latitude_deg=read_numbers(columns, "latitude", "position.x"),
        longitude_deg=read_numbers(columns, "longitude", "position.y"),
        altitude_m=read_numbers(columns, "altitude", "position.z") + read_numbers(columns, "undulation"),
        position_covariance_m2=_plane_covariance_of_accuracy(columns, accuracy),
    )


def read_ekf_velocity(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read the filter's velocity from `SbgEkfNav`."""
    return _read_velocity_fix(columns, ledger, read_numbers(columns, "status.velocity_valid") == 1)


def read_ekf_euler(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read the filter's heading (rad) from `SbgEkfEuler`."""
    axes = _axes_of_frame_name(columns)
    if not axes:
        ledger.reject(np.ones(len(columns), np.bool_), UNKNOWN_AXES_REASON)
    angle_rad = read_numbers(columns, "angle.z")
    angle_rad = np.where(np.abs(angle_rad) <= 4.0 * np.pi, angle_rad, np.nan)
    heading_rad = wrap_angle(angle_rad) if axes == "enu" else heading_from_compass_or_nan(np.rad2deg(angle_rad))
    with np.errstate(over="ignore"):
        variance = read_numbers(columns, "accuracy.z") ** 2
    is_valid = read_numbers(columns, "status.heading_valid") == 1
    return GnssFix(*read_stamps(columns), is_valid, heading_rad=heading_rad, heading_variance_rad2=variance)


def build_imu(columns: Columns, reading: Reading) -> tuple[ImuSignal, Quality]:
    """Build inertial measurements from `SbgImuData`, in the vehicle's axes: forward, left, up."""
    ledger = RowLedger(columns, reading.role)
    if _axes_of_frame_name(columns) != "ned":
        ledger.reject(np.ones(len(columns), np.bool_), "the frame name does not contain ned (north-east-down)")
    flipped = np.array([1.0, -1.0, -1.0])
    accel_mps2, gyro_radps = flipped * read_vector(columns, "accel"), flipped * read_vector(columns, "gyro")
    reject_rows_beyond_limit(ledger, accel_mps2, MAX_ACCEL_MPS2)
    reject_rows_beyond_limit(ledger, gyro_radps, MAX_TURN_RATE_RADPS)
    timeline = repair_and_order_times(ledger, *read_stamps(columns), reading.clock, [accel_mps2, gyro_radps])
    nothing = np.full((len(columns), 3), np.nan)
    return build_signal_and_quality(
        ImuSignal,
        ledger,
        timeline,
        accel_mps2=accel_mps2,
        gyro_radps=gyro_radps,
        accel_variance=nothing,
        gyro_variance=nothing,
    )


def _axes_of_frame_name(columns: Columns) -> str:
    """Return `ned`, `enu`, or "" where the frame name does not say which axes are used."""
    frame = read_frame_id(columns).lower()
    parts = set(re.split(r"[^a-z]+", frame))
    found = parts & {"ned", "enu"}
    return found.pop() if len(found) == 1 else "enu" if frame == DRIVER_ENU_FRAME_ID else ""


def _read_east_north(columns: Columns, name: str) -> FloatArray:
    """Read east and north of a vector, (n, 2), as far as the axes are known."""
    x, y = read_numbers(columns, f"{name}.x"), read_numbers(columns, f"{name}.y")
    return np.stack([y, x] if _axes_of_frame_name(columns) == "ned" else [x, y], axis=1)


def _plane_covariance_of_accuracy(columns: Columns, accuracy: FloatArray) -> FloatArray:
    if not _axes_of_frame_name(columns):
        accuracy = np.repeat(accuracy.max(axis=1, keepdims=True), 2, axis=1)
    return covariance_of_east_north_sigmas(accuracy[:, 0], accuracy[:, 1])


def _read_velocity_fix(columns: Columns, ledger: RowLedger, is_valid: BoolArray) -> GnssFix:
    if not _axes_of_frame_name(columns):
        ledger.reject(np.ones(len(columns), np.bool_), UNKNOWN_AXES_REASON)
    return GnssFix(
        *read_stamps(columns),
        is_fix=is_valid,
        velocity_mps=_read_east_north(columns, "velocity"),
        velocity_covariance_m2ps2=_plane_covariance_of_accuracy(
            columns, _read_east_north(columns, "velocity_accuracy")
        ),
    )
