"""A drive by hand: what exact sensors of a car would say that accelerates, brakes and turns left and right."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cwcli.estimation.measurements import QUANTITY_BY_KIND, Kind
from cwcli.estimation.passes import SensorSeries

RATE_HZ = 20.0
Values = Mapping[Kind, np.ndarray]


def made_drive(
    duration_s: float = 120.0, *, backwards: bool = False, is_oval: bool = False
) -> tuple[np.ndarray, Values]:
    """Times (n,) and what each kind of sensor reads, (n,) or (n, 2).

    In each 20 s the car brakes by 2 m/s^2 for 4 s, turns by 1.6 rad in 4 s (now left, now right) and accelerates by
    2 m/s^2 for 4 s; else it drives straight with 14 m/s. On an oval it turns to the left alone, by 3 rad in 12 s.
    """
    time_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    phase, block = time_s % 20.0, (time_s // 20.0).astype(int)
    accel = np.where((phase >= 4.0) & (phase < 8.0), -2.0, np.where((phase >= 12.0) & (phase < 16.0), 2.0, 0.0))
    yaw_rate = np.where((phase >= 8.0) & (phase < 12.0), np.where(block % 2, -0.4, 0.4), 0.0)
    if is_oval:
        yaw_rate = np.where((phase >= 6.0) & (phase < 18.0), 0.25, 0.0)

    def integral(rate: np.ndarray) -> np.ndarray:
        return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) / RATE_HZ)])

    speed, course = 14.0 + integral(accel), 0.3 + integral(yaw_rate)
    x, y = integral(speed * np.cos(course)), integral(speed * np.sin(course))
    sign = -1.0 if backwards else 1.0
    return time_s, {
        Kind.POSITION: np.column_stack([x, y]),
        Kind.VELOCITY: np.column_stack([speed * np.cos(course), speed * np.sin(course)]),
        Kind.SPEED: sign * speed,
        Kind.HEADING: course + (np.pi if backwards else 0.0),
        Kind.ACCEL: sign * accel,
        Kind.YAW_RATE: yaw_rate,
    }


def as_series(kind: Kind, time_s: np.ndarray, values: np.ndarray, source: str = "") -> SensorSeries:
    """A series of one kind; its source is named like it."""
    padded = np.zeros((len(time_s), 2))
    padded[:, : QUANTITY_BY_KIND[kind].width] = values.reshape(len(time_s), -1)
    return SensorSeries(
        source or f"/{kind.name.lower()}", kind, time_s, padded, np.tile([1.0, 0.0, 1.0], (len(time_s), 1))
    )


def drive_series(values: Values, time_s: np.ndarray, *kinds: Kind) -> list[SensorSeries]:
    """Series of some kinds, in their order."""
    return [as_series(kind, time_s, values[kind]) for kind in kinds]
