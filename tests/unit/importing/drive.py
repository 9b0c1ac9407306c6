"""A drive whose every number is known, and how other programs write it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
START_S = 1_700_000_000
"""2023-11-14T22:13:20Z."""
N, STEP_S = 600, 0.1
METERS_PER_DEGREE = 111_195.0
LATITUDE_DEG, LONGITUDE_DEG = 48.137, 11.575


@dataclass(frozen=True)
class Drive:
    """A minute at 10 Hz, turning both ways; n rows.

    Attributes:
        t_s: From 0.
        x_m, y_m: East and north.
        speed_mps, accel_mps2, heading_rad, yaw_rate_radps: Heading counter-clockwise from east.
        lat_deg, lon_deg, course_deg: The same for maps; course clockwise from north.
    """

    t_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    speed_mps: FloatArray
    accel_mps2: FloatArray
    heading_rad: FloatArray
    yaw_rate_radps: FloatArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    course_deg: FloatArray

    @property
    def stamp_ns(self) -> npt.NDArray[np.int64]:
        return START_S * 10**9 + np.rint(self.t_s * 1e9).astype(np.int64)


def make_drive() -> Drive:
    """Integrate the motion in steps of a hundredth of a row."""
    fine = np.arange(N * 100) * STEP_S / 100
    speed, rate = 10.0 + 3.0 * np.sin(fine / 6.0), 0.15 * np.sin(fine / 8.0)
    heading = 0.6 + 0.15 * 8.0 * (1.0 - np.cos(fine / 8.0))
    x = np.cumsum(speed * np.cos(heading)) * STEP_S / 100
    y = np.cumsum(speed * np.sin(heading)) * STEP_S / 100
    rows = slice(0, None, 100)
    lat = LATITUDE_DEG + y / METERS_PER_DEGREE
    lon = LONGITUDE_DEG + x / METERS_PER_DEGREE / np.cos(np.deg2rad(LATITUDE_DEG))
    course = np.mod(90.0 - np.degrees(heading), 360.0)
    columns = (fine, x, y, speed, 0.5 * np.cos(fine / 6.0), heading, rate, lat, lon, course)
    return Drive(*(each[rows] for each in columns))


DRIVE = make_drive()


def write_table(
    path: Path, names: str, columns: list[list[str]], separator: str = ",", encoding: str = "utf-8"
) -> Path:
    """Write separated text: a line of names (and more lines, where `names` has them), then the rows."""
    rows = [separator.join(row) for row in zip(*columns, strict=True)]
    path.write_bytes("\n".join([names, *rows, ""]).encode(encoding))
    return path


def digits(values: FloatArray, n: int) -> list[str]:
    return [f"{value:.{n}f}" for value in values.tolist()]


def epoch(digits_of_second: int = 3) -> list[str]:
    return [f"{START_S + t:.{digits_of_second}f}" for t in DRIVE.t_s.tolist()]


def iso(drive: Drive, ending: str = "Z", pattern: str = "%Y-%m-%dT%H:%M:%S", hours: int = 0) -> list[str]:
    from datetime import UTC, datetime, timedelta

    moments = [
        datetime.fromtimestamp(START_S, UTC) + timedelta(hours=hours, milliseconds=round(t * 1000))
        for t in drive.t_s.tolist()
    ]
    return [f"{moment.strftime(pattern)}.{moment.microsecond // 1000:03d}{ending}" for moment in moments]
