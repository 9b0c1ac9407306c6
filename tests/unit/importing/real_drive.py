"""A drive as receivers record it, and what a log tells of it.

It begins with a stop of 8 s, stops once more, passes midnight UTC, and lies south of the equator. Its fixes drift
by decimeters, its speeds have noise, and its course is arbitrary while the car stands.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.logs.read.reader import Log

FloatArray = npt.NDArray[np.float64]
START = datetime(2024, 3, 9, 23, 59, 20, tzinfo=UTC)
START_NS = int(START.timestamp()) * 10**9
GPS_WEEK, GPS_TOW_S = 2304, 6 * 86400 + 86360 + 18.0
"""GPS week and seconds of the week of the first row; 18 leap seconds."""
LATITUDE_DEG, LONGITUDE_DEG = -33.9, 151.1
METERS_PER_DEGREE = 6_371_000.0 * np.pi / 180


@dataclass(frozen=True)
class Recorded:
    """The motion at 10 Hz, and what the sensors say of it; n rows.

    Attributes:
        t_s: From 0.
        x_m, y_m, z_m: East, north and height.
        speed_mps, heading_rad, rate_radps, accel_mps2: True motion; heading counter-clockwise from east.
        lat_deg, lon_deg, height_m, gps_speed_mps, course_deg: As a receiver prints them.
        east_mps, north_mps: As a receiver prints them.
        wheel_mps: As the car's bus has it.
        force_mps2, turn_radps: As an IMU whose axes are forward, left and up has them; (n, 3).
    """

    t_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    z_m: FloatArray
    speed_mps: FloatArray
    heading_rad: FloatArray
    rate_radps: FloatArray
    accel_mps2: FloatArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    height_m: FloatArray
    gps_speed_mps: FloatArray
    course_deg: FloatArray
    east_mps: FloatArray
    north_mps: FloatArray
    wheel_mps: FloatArray
    force_mps2: FloatArray
    turn_radps: FloatArray


def record_drive(n: int = 1200, step_s: float = 0.1) -> Recorded:
    """Integrate the motion in hundredths of a row, and add what sensors add."""
    rng = np.random.default_rng(20240309)
    fine = np.arange(n * 100) * step_s / 100
    speed = np.interp(
        fine, [0, 8, 18, 30, 36, 44, 56, 62, 68, 80, 95, 110, 120], [0, 0, 14, 14, 6, 12, 12, 0, 0, 15, 22, 22, 18]
    )
    bend = np.interp(
        fine,
        [0, 30, 32, 40, 42, 46, 48, 54, 56, 76, 78, 84, 86, 100, 104, 112, 116],
        [0, 0, 0.03, 0.03, 0, 0, -0.025, -0.025, 0, 0, 0.012, 0.012, 0, 0, -0.008, -0.008, 0],
    )
    rate = speed * bend
    heading = 0.35 + np.cumsum(rate) * step_s / 100
    x, y = (np.cumsum(speed * each(heading)) * step_s / 100 for each in (np.cos, np.sin))
    rows = slice(0, None, 100)
    t, speed, accel, rate, heading, x, y = (
        each[rows] for each in (fine, speed, np.gradient(speed, fine), rate, heading, x, y)
    )
    z = 58.0 + 0.01 * np.hypot(x, y)

    def drift(sigma: float, seconds: float) -> FloatArray:
        keep = np.exp(-step_s / seconds)
        values = np.zeros(n)
        for k in range(1, n):
            values[k] = keep * values[k - 1] + rng.normal(0, sigma * np.sqrt(1 - keep**2))
        return values

    moving = speed > 0.2
    gps_speed = np.maximum(speed + rng.normal(0, 0.05, n), 0.0)
    course = np.where(moving, 90 - np.degrees(heading) + rng.normal(0, 0.4, n), rng.uniform(0, 360, n))
    force = np.stack([accel, speed * rate, np.full(n, 9.80665)], axis=1) + rng.normal(0, 0.08, (n, 3))
    turn = np.stack([np.zeros(n), np.zeros(n), rate], axis=1) + rng.normal(0, 0.004, (n, 3))
    north, east = y + drift(0.5, 40), x + drift(0.5, 40)
    return Recorded(
        t, x, y, z, speed, heading, rate, accel,
        LATITUDE_DEG + north / METERS_PER_DEGREE,
        LONGITUDE_DEG + east / METERS_PER_DEGREE / np.cos(np.deg2rad(LATITUDE_DEG)),
        z + drift(1.0, 40),
        gps_speed,
        np.mod(course, 360.0),
        speed * np.cos(heading) + rng.normal(0, 0.05, n),
        speed * np.sin(heading) + rng.normal(0, 0.05, n),
        speed * 1.002 + rng.normal(0, 0.02, n),
        force,
        turn,
    )  # fmt: skip


R = record_drive()
N = len(R.t_s)
ALL, SECONDS = slice(None), slice(0, None, 10)
"""Rows of a receiver of 10 Hz, and of 1 Hz."""


def times(pattern: str, rows: slice = SECONDS, hours: float = 0.0, cut: int = 0) -> list[str]:
    """Print the times of rows; `cut` removes characters from their ends (microseconds to milliseconds)."""
    texts = [(START + timedelta(hours=hours, seconds=round(t, 3))).strftime(pattern) for t in R.t_s[rows].tolist()]
    return [text[:-cut] if cut else text for text in texts]


def show(values: FloatArray, n: int, rows: slice = SECONDS) -> list[str]:
    """Print values with n digits behind the point."""
    return [f"{value:.{n}f}" for value in values[rows].tolist()]


def measure_errors(path: Path, start_ns: int = START_NS) -> dict[str, float]:  # noqa: PLR0912
    """Return the 95th percentile of the error of each quantity of a log: m, m/s, rad, rad/s, m/s^2.

    A topic that is none of the usual ones has its number of messages.
    """
    found: dict[str, float] = {}
    with Log.open(path) as log:
        for topic in sorted(channel.topic for channel in log.index.channels.values()):
            columns = log.columns(topic)
            since_s = (columns.log_time_ns - start_ns) / 1e9
            is_of_drive = (since_s > -60) & (since_s < R.t_s[-1] + 60)

            def column(name: str, columns: Any = columns) -> FloatArray:
                return np.asarray(columns.fields[name], np.float64)

            def true(values: FloatArray, since_s: FloatArray = since_s) -> FloatArray:
                return np.interp(since_s, R.t_s, values)

            def keep(name: str, error: FloatArray, is_of_drive: Any = is_of_drive) -> None:
                error = error[np.isfinite(error) & is_of_drive]
                found[name] = float(np.percentile(np.abs(error), 95)) if len(error) else float("inf")

            heading = true(R.heading_rad)
            if topic == "/gps/fix":
                north = (column("latitude") - LATITUDE_DEG) * METERS_PER_DEGREE - true(R.y_m)
                east = (column("longitude") - LONGITUDE_DEG) * METERS_PER_DEGREE * np.cos(np.deg2rad(LATITUDE_DEG))
                keep("fix", np.hypot(east - true(R.x_m), north))
                if np.isfinite(column("altitude")).any():
                    keep("height", column("altitude") - true(R.z_m))
            elif topic == "/gps/velocity":
                east = column("twist.linear.x") - true(R.speed_mps) * np.cos(heading)
                keep("velocity", np.hypot(east, column("twist.linear.y") - true(R.speed_mps) * np.sin(heading)))
            elif topic == "/vehicle/twist":
                if np.isfinite(column("twist.linear.x")).any():
                    keep("speed", column("twist.linear.x") - true(R.speed_mps))
                if np.isfinite(column("twist.angular.z")).any():
                    keep("rate", column("twist.angular.z") - true(R.rate_radps))
            elif topic == "/vehicle/heading":
                angle = 2 * np.arctan2(column("quaternion.z"), column("quaternion.w")) - heading
                keep("heading", np.angle(np.exp(1j * angle)))
            elif topic == "/pose":
                x, y = column("pose.position.x"), column("pose.position.y")
                keep("pose", np.hypot(x - x[0] - true(R.x_m) + R.x_m[0], y - y[0] - true(R.y_m) + R.y_m[0]))
                angle = 2 * np.arctan2(column("pose.orientation.z"), column("pose.orientation.w")) - heading
                keep("pose_heading", np.angle(np.exp(1j * angle)))
            elif topic == "/imu/data":
                if (column("angular_velocity_covariance")[:, 0] >= 0).any():
                    keep("gyro", column("angular_velocity.z") - true(R.rate_radps))
                if (column("linear_acceleration_covariance")[:, 0] >= 0).any():
                    ahead = column("linear_acceleration.x") - true(R.accel_mps2)
                    left = column("linear_acceleration.y") - true(R.speed_mps * R.rate_radps)
                    up = column("linear_acceleration.z")
                    up = up - (0.0 if abs(up.mean()) < 1.0 else 9.80665)  # some files are without gravity
                    keep("accel", np.sqrt(ahead**2 + left**2 + up**2))
            else:
                found[topic] = float(len(columns))
    return found
