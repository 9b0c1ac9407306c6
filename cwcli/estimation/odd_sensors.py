"""Sensors in other units or other ways up, and first rows that nothing after them agrees with: recognised and told."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median
from cwcli.signals.columns import FloatArray

GRAVITY_MPS2 = 9.80665
IN_G = (0.8, 1.2)  # mean specific force of an IMU that measures it in g
UPRIGHT = 0.8  # part of it along the vertical axis, so that it is no steady acceleration
FASTEST_TURN_RADPS = 3.0  # no car turns faster for a hundredth of a drive; in degrees every bend is more
FASTEST_CHANGE = {Kind.POSITION: 100.0, Kind.VELOCITY: 12.0, Kind.SPEED: 12.0}  # m/s; m/s^2: tyres hold no more
CLEAR_STEPS = 6.0
AGREEING_ROWS = 4
STUCK_ROWS, STUCK_S = 20, 2.0
SELDOM = 0.1  # of the other rows repeat the one before: a coarse signal would more often


def in_si_units(values: FloatArray, variance: FloatArray | None) -> tuple[FloatArray, FloatArray | None, list[str]]:
    """An IMU's rows in m/s^2 and rad/s with the roof up, by the size and the side of what they say.

    Args:
        values: Shape (n, 6): accelerometer, gyroscope (forward, left, up).
        variance: Shape (n, 6) or None.

    Returns:
        Both, and what was changed, in words.
    """
    words: list[str] = []
    if not len(values):
        return values, variance, words
    factor = np.ones(6)
    force = values[:, :3].mean(axis=0)
    norm = float(np.linalg.norm(force))
    if IN_G[0] < norm < IN_G[1] and abs(force[2]) > UPRIGHT * norm:
        factor[:3] = GRAVITY_MPS2
        words.append(f"gravity reads {norm:.2f}: accelerations taken as g, not m/s^2")
    if norm * factor[2] > 0.5 * GRAVITY_MPS2 and force[2] < -UPRIGHT * norm:
        factor[[1, 2, 4, 5]] *= -1.0
        words.append("gravity points upward: taken as mounted upside down, and turned about its forward axis")
    fast = float(np.quantile(np.abs(values[:, 5]), 0.99))
    if fast > FASTEST_TURN_RADPS:
        factor[3:] *= np.pi / 180.0
        words.append(f"yaw rates reach {fast:.0f}: taken as degrees per second, not rad/s")
    if not words:
        return values, variance, words
    return values * factor, None if variance is None else variance * factor**2, words


def first_row_is_apart(kind: Kind, time_s: FloatArray, values: FloatArray) -> bool:
    """Whether the first row is one that no car could get away from, while those after it agree with each other.

    Receivers and buses say a zero or their last place before they have measured anything. Such a row starts the
    filter at a speed or place that it is sure of, and good rows are rejected for long.

    Args:
        kind: Of the rows.
        time_s: Shape (n,), sorted.
        values: Shape (n, d).
    """
    if kind not in FASTEST_CHANGE or len(time_s) < 2 * AGREEING_ROWS:
        return False
    change = np.sqrt(np.square(np.diff(values, axis=0)).sum(axis=1))
    most = FASTEST_CHANGE[kind] * np.diff(time_s) + CLEAR_STEPS * median(change)
    return bool(change[0] > most[0] and (change[1:AGREEING_ROWS] <= most[1:AGREEING_ROWS]).all())


def stuck_rows(kind: Kind, time_s: FloatArray, values: FloatArray) -> npt.NDArray[np.bool_]:
    """Rows of a speed or velocity that goes on saying one number, other than zero, though it usually changes. (n,).

    Args:
        kind: Of the rows.
        time_s: Shape (n,), sorted.
        values: Shape (n, d).
    """
    n = len(time_s)
    stuck = np.zeros(n, np.bool_)
    if kind not in (Kind.SPEED, Kind.VELOCITY) or n < 2 * STUCK_ROWS:
        return stuck
    same = (np.diff(values, axis=0) == 0.0).all(axis=1) & (values[1:] != 0.0).any(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], same, [False])).astype(np.int8)))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):  # rows begin .. end are one number
        if end - begin >= STUCK_ROWS and time_s[end] - time_s[begin] >= STUCK_S:
            stuck[begin + 1 : end + 1] = True
    elsewhere = same[~stuck[1:]]
    return stuck if len(elsewhere) and elsewhere.mean() < SELDOM else np.zeros(n, np.bool_)
