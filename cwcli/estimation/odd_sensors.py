"""Recognise sensors in wrong units or upside down, stuck rows, and first rows that the following ones contradict."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median
from cwcli.signals.columns import FloatArray

GRAVITY_MPS2 = 9.80665
"""Standard gravity, m/s^2 (CGPM 1901)."""
GRAVITY_RANGE_IN_G = (0.8, 1.2)
"""Range of the mean specific force of an IMU that measures in g. Chosen by hand; not fitted."""
MIN_VERTICAL_SHARE = 0.8
"""Least share of the mean specific force along the vertical axis, so that it is gravity. Chosen by hand; not fitted."""
MAX_YAW_RATE_RADPS = 3.0
"""Yaw rate that no car exceeds for a hundredth of a drive, rad/s. Chosen: in degrees every bend exceeds it."""
MAX_CHANGE_PER_SECOND = {Kind.POSITION: 100.0, Kind.VELOCITY: 12.0, Kind.SPEED: 12.0}
"""Greatest change per second of a position (m) and of velocity and speed (m/s). Chosen: tyres hold no more."""
MIN_JUMP_IN_MEDIAN_STEPS = 6.0
"""Median steps by which a jump must exceed the greatest change. Chosen by hand; not fitted."""
N_AGREEING_ROWS = 4
"""Number of first rows that are compared. Chosen by hand; not fitted."""
MIN_STUCK_ROWS, MIN_STUCK_DURATION_S = 20, 2.0
"""Least number of repeated rows and least duration (s) of a stuck source. Chosen by hand; not fitted."""
MAX_REPEATED_ROW_SHARE = 0.1
"""Greatest share of repeats in the other rows: a coarse signal repeats more often. Chosen by hand; not fitted."""


def convert_imu_to_si_units(
    values: FloatArray, variance: FloatArray | None
) -> tuple[FloatArray, FloatArray | None, list[str]]:
    """Convert the rows of an IMU to m/s^2 and rad/s, mounted upright, by the size and direction of their values.

    Args:
        values: Shape (n, 6): accelerometer, gyroscope (forward, left, up).
        variance: Shape (n, 6) or None.

    Returns:
        Values, variances and a text on each change.
    """
    words: list[str] = []
    if not len(values):
        return values, variance, words
    factor = np.ones(6)
    force = values[:, :3].mean(axis=0)
    norm = float(np.linalg.norm(force))
    if GRAVITY_RANGE_IN_G[0] < norm < GRAVITY_RANGE_IN_G[1] and abs(force[2]) > MIN_VERTICAL_SHARE * norm:
        factor[:3] = GRAVITY_MPS2
        words.append(f"gravity reads {norm:.2f}: accelerations taken as g, not m/s^2")
    if norm * factor[2] > 0.5 * GRAVITY_MPS2 and force[2] < -MIN_VERTICAL_SHARE * norm:
        factor[[1, 2, 4, 5]] *= -1.0
        words.append("gravity points upward: taken as mounted upside down, and turned about its forward axis")
    fast = float(np.quantile(np.abs(values[:, 5]), 0.99))
    if fast > MAX_YAW_RATE_RADPS:
        factor[3:] *= np.pi / 180.0
        words.append(f"yaw rates reach {fast:.0f}: taken as degrees per second, not rad/s")
    if not words:
        return values, variance, words
    return values * factor, None if variance is None else variance * factor**2, words


def is_first_row_contradicted(kind: Kind, time_s: FloatArray, values: FloatArray) -> bool:
    """Whether the first row differs from the second by more than a car can move, while the next rows agree.

    Receivers and buses send a zero or their last position before they have measured anything. A filter that starts
    there is sure of a wrong state and rejects good rows for long.

    Args:
        kind: Kind of the rows.
        time_s: Shape (n,), sorted.
        values: Shape (n, d).
    """
    if kind not in MAX_CHANGE_PER_SECOND or len(time_s) < 2 * N_AGREEING_ROWS:
        return False
    change = np.sqrt(np.square(np.diff(values, axis=0)).sum(axis=1))
    most = MAX_CHANGE_PER_SECOND[kind] * np.diff(time_s) + MIN_JUMP_IN_MEDIAN_STEPS * median(change)
    return bool(change[0] > most[0] and (change[1:N_AGREEING_ROWS] <= most[1:N_AGREEING_ROWS]).all())


def stuck_row_mask(kind: Kind, time_s: FloatArray, values: FloatArray) -> npt.NDArray[np.bool_]:
    """Return a mask (n,) of rows in which a speed or velocity that usually changes repeats a value other than zero.

    Args:
        kind: Kind of the rows.
        time_s: Shape (n,), sorted.
        values: Shape (n, d).
    """
    n = len(time_s)
    stuck = np.zeros(n, np.bool_)
    if kind not in (Kind.SPEED, Kind.VELOCITY) or n < 2 * MIN_STUCK_ROWS:
        return stuck
    same = (np.diff(values, axis=0) == 0.0).all(axis=1) & (values[1:] != 0.0).any(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], same, [False])).astype(np.int8)))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):  # rows begin .. end are one number
        if end - begin >= MIN_STUCK_ROWS and time_s[end] - time_s[begin] >= MIN_STUCK_DURATION_S:
            stuck[begin + 1 : end + 1] = True
    elsewhere = same[~stuck[1:]]
    return stuck if len(elsewhere) and elsewhere.mean() < MAX_REPEATED_ROW_SHARE else np.zeros(n, np.bool_)
