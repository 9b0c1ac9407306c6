"""A second drive, which stops on its way, and a comparison of a log with it at the stamps of the log's own messages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cwcli.logs.read.reader import Log
from tests.unit.importing.drive import METERS_PER_DEGREE, START_S, Drive, FloatArray

LATITUDE_DEG, LONGITUDE_DEG = 47.4, -3.2
"""West of Greenwich, so that a lost sign shows."""


def make_other_drive(n: int = 900, step_s: float = 0.1) -> Drive:
    """Return a drive that starts, turns right, stops for 10 s and turns left; integrated in hundredths of a row."""
    fine = np.arange(n * 100) * step_s / 100
    speed = np.interp(fine, [0, 5, 15, 30, 38, 48, 58, 75, 90], [4, 9, 14, 14, 0, 0, 11, 16, 12])
    accel = np.gradient(speed, fine)
    rate = speed * np.interp(
        fine, [0, 12, 14, 22, 24, 55, 60, 70, 73, 90], [0, 0, -0.012, -0.012, 0, 0, 0.01, 0.01, 0, 0]
    )
    heading = 2.5 + np.cumsum(rate) * step_s / 100
    x, y = (np.cumsum(speed * each(heading)) * step_s / 100 for each in (np.cos, np.sin))
    rows = slice(0, None, 100)
    lat = LATITUDE_DEG + y / METERS_PER_DEGREE
    lon = LONGITUDE_DEG + x / METERS_PER_DEGREE / np.cos(np.deg2rad(LATITUDE_DEG))
    course_deg = np.mod(90.0 - np.degrees(heading), 360.0)
    return Drive(*(each[rows] for each in (fine, x, y, speed, accel, heading, rate, lat, lon, course_deg)))


DRIVE = make_other_drive()


@dataclass(frozen=True)
class Truth:
    """The drive at the stamps of a channel; `start_ns` is the stamp of its first moment."""

    start_ns: int

    def at(self, stamp_ns: np.ndarray, values: FloatArray) -> FloatArray:
        return np.interp((np.asarray(stamp_ns, np.int64) - self.start_ns) / 1e9, DRIVE.t_s, values)


def errors_by_channel(log_path: Path, start_ns: int = START_S * 10**9) -> dict[str, float]:
    """Return the 95th percentile of the error of each channel: m, m/s, rad or rad/s."""
    truth = Truth(start_ns)
    found: dict[str, float] = {}
    with Log.open(log_path) as log:
        for topic in sorted(channel.topic for channel in log.index.channels.values()):
            columns = log.columns(topic)
            fields = columns.fields
            stamps = columns.log_time_ns

            def column(path: str, fields: Mapping[str, Any] = fields) -> FloatArray:
                return np.asarray(fields[path], np.float64)

            def true(values: FloatArray, stamps: np.ndarray = stamps) -> FloatArray:
                return truth.at(stamps, values)

            def keep(name: str, error: FloatArray) -> None:
                found[name] = float(np.percentile(np.abs(error), 95)) if len(error) else float("inf")

            if topic == "/gps/fix":
                north = (column("latitude") - true(DRIVE.lat_deg)) * METERS_PER_DEGREE
                east = (column("longitude") - true(DRIVE.lon_deg)) * METERS_PER_DEGREE * np.cos(np.deg2rad(47.4))
                keep("fix", np.hypot(east, north))
            elif topic == "/gps/velocity":
                east = column("twist.linear.x") - true(DRIVE.speed_mps) * np.cos(true(DRIVE.heading_rad))
                north = column("twist.linear.y") - true(DRIVE.speed_mps) * np.sin(true(DRIVE.heading_rad))
                keep("velocity", np.hypot(east, north))
            elif topic == "/vehicle/twist":
                keep("speed", column("twist.linear.x") - true(DRIVE.speed_mps))
                rate = column("twist.angular.z")
                if np.isfinite(rate).any():
                    keep("yaw_rate", rate - true(DRIVE.yaw_rate_radps))
            elif topic == "/vehicle/heading":
                angle = 2 * np.arctan2(column("quaternion.z"), column("quaternion.w")) - true(DRIVE.heading_rad)
                keep("heading", np.angle(np.exp(1j * angle)))
            elif topic == "/pose":
                x, y = column("pose.position.x"), column("pose.position.y")
                keep("pose", np.hypot(x - true(DRIVE.x_m), y - true(DRIVE.y_m)))
            elif topic == "/imu/data":
                if (column("angular_velocity_covariance")[:, 0] >= 0).any():
                    keep("gyro", column("angular_velocity.z") - true(DRIVE.yaw_rate_radps))
                if (column("linear_acceleration_covariance")[:, 0] >= 0).any():
                    ahead = column("linear_acceleration.x") - true(DRIVE.accel_mps2)
                    left = column("linear_acceleration.y") - true(DRIVE.speed_mps * DRIVE.yaw_rate_radps)
                    keep("accel", np.sqrt(ahead**2 + left**2 + (column("linear_acceleration.z") - 9.80665) ** 2))
            else:
                found[topic] = float(len(columns)) if "image" not in topic else 0.0
    return found
