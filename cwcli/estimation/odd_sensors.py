"""Recognise sensors in wrong units or upside down, stuck rows, and first rows that the following ones contradict."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.estimation.hypotheses.base import Hypothesis
from cwcli.estimation.hypotheses.imu import IMU_UNIT_SIGN_AND_AXES_HYPOTHESES, imu_tilt_hypothesis
from cwcli.estimation.imu import find_steady_turn_axis
from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.signals.columns import AccelGyroRows, BoolArray, FloatArray, ValueRows, quantile_of_values
from cwcli.signals.row_order import first_and_last_rows_of_runs
from cwcli.signals.units import STANDARD_GRAVITY_MPS2

MEAN_SPECIFIC_FORCE_RANGE_G = (0.8, 1.2)
"""Range of the mean specific force of an IMU that measures in g. Chosen by hand; not fitted."""
MAX_GRAVITY_IN_ANY_UNIT = 1.2e3
"""Greatest mean specific force that gravity has in any unit: 1000 mg, and a fifth. Values beyond are the counts of a
converter, such as 16384 for each g (InvenSense MPU-6050, range 2 g)."""
MIN_VERTICAL_SPECIFIC_FORCE_SHARE = 0.8
"""Least share of the mean specific force along the vertical axis, so that it is gravity. Chosen by hand; not fitted."""
MIN_GRAVITY_ON_Z_AXIS_OF_TILTED_IMU_SHARE, MAX_GRAVITY_ON_Z_AXIS_OF_TILTED_IMU_SHARE = 0.6, 0.966
"""Shares of gravity along the z axis of an IMU that is tilted and not turned onto another axis: 53 to 15 degrees. Less
than 15 degrees change the forward acceleration by 4 %; chosen by hand."""
MAX_PLAUSIBLE_YAW_RATE_RADPS = 3.0
"""Yaw rate that no car exceeds for a hundredth of a drive, rad/s. Chosen: in degrees every bend exceeds it."""
MAX_CHANGE_PER_SECOND_BY_KIND = {Kind.POSITION: 100.0, Kind.VELOCITY: 12.0, Kind.SPEED: 12.0}
"""Greatest change per second of a position (m) and of velocity and speed (m/s). Chosen: tyres hold no more."""
MIN_FIRST_ROW_JUMP_IN_MEDIAN_STEPS = 6.0
"""Median steps by which a jump must exceed the greatest change. Chosen by hand; not fitted."""
N_FIRST_ROWS_COMPARED = 4
"""Number of first rows that are compared. Chosen by hand; not fitted."""
MIN_STUCK_ROWS, MIN_STUCK_DURATION_S = 20, 2.0
"""Least number of repeated rows and least duration (s) of a stuck source. Chosen by hand; not fitted."""
MAX_REPEATS_AMONG_OTHER_ROWS_SHARE = 0.1
"""Greatest share of repeats in the other rows: a coarse signal repeats more often. Chosen by hand; not fitted."""


def find_impossible_imu_values(values: AccelGyroRows) -> list[tuple[Hypothesis, str]]:
    """Return faults of an IMU that the size and direction of its values alone show, with what shows each.

    Args:
        values: Shape (n, 6): accelerometer, gyroscope (forward, left, up); rows that are not finite do not count.
    """
    found: list[tuple[Hypothesis, str]] = []
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values):
        return found
    force = values[:, :3].mean(axis=0)
    norm = float(np.linalg.norm(force))
    if norm > MAX_GRAVITY_IN_ANY_UNIT:
        return found
    if (
        MEAN_SPECIFIC_FORCE_RANGE_G[0] < norm < MEAN_SPECIFIC_FORCE_RANGE_G[1]
        and abs(force[2]) > MIN_VERTICAL_SPECIFIC_FORCE_SHARE * norm
    ):
        found.append((_imu_hypothesis_by_name("g"), f"gravity reads {norm:.2f}"))
        norm *= STANDARD_GRAVITY_MPS2
    if norm > 0.5 * STANDARD_GRAVITY_MPS2 and force[2] < -MIN_VERTICAL_SPECIFIC_FORCE_SHARE * float(
        np.linalg.norm(force)
    ):
        found.append((_imu_hypothesis_by_name("x,-y,-z"), "gravity points upward"))
    fast = quantile_of_values(np.abs(values[:, 5]), 0.99)
    for name, radps in (("degrees/s", np.radians(fast)), ("milliradians/s", 1e-3 * fast)):
        if radps <= MAX_PLAUSIBLE_YAW_RATE_RADPS < fast:
            found.append((_imu_hypothesis_by_name(name), f"yaw rates reach {fast:.0f}"))
            break
    return found


def find_tilt_and_evidence(values: AccelGyroRows) -> tuple[Hypothesis, str] | None:
    """Return the tilt of an IMU in SI units whose z axis is clearly not vertical, but nearer to it than another axis.

    Args:
        values: Shape (n, 6): accelerometer, gyroscope; rows that are not finite do not count.
    """
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values):
        return None
    force = values[:, :3].mean(axis=0)
    share = float(np.linalg.norm(force)) / STANDARD_GRAVITY_MPS2
    upright = float(force[2]) / max(share * STANDARD_GRAVITY_MPS2, 1e-9)
    is_gravity = MEAN_SPECIFIC_FORCE_RANGE_G[0] < share < MEAN_SPECIFIC_FORCE_RANGE_G[1]
    if (
        not is_gravity
        or not MIN_GRAVITY_ON_Z_AXIS_OF_TILTED_IMU_SHARE < upright < MAX_GRAVITY_ON_Z_AXIS_OF_TILTED_IMU_SHARE
    ):
        return None
    axis = find_steady_turn_axis(values[:, 3:])
    if (
        axis is not None and abs(axis[2]) >= MAX_GRAVITY_ON_Z_AXIS_OF_TILTED_IMU_SHARE
    ):  # the force leans in the bend, the IMU does not
        return None
    across = float(np.hypot(*force[:2]))
    return imu_tilt_hypothesis(force), f"gravity reads {across:.1f} m/s^2 across its vertical axis"


def _imu_hypothesis_by_name(name: str) -> Hypothesis:
    return next(each for each in IMU_UNIT_SIGN_AND_AXES_HYPOTHESES if each.name == name)


def is_first_row_contradicted(kind: Kind, time_s: FloatArray, values: ValueRows) -> bool:
    """Whether the first row differs from the second by more than a car can move, while the next rows agree.

    Receivers and buses send a zero or their last position before they have measured anything. A filter that starts
    there is sure of a wrong state and rejects good rows for long.
    """
    if kind not in MAX_CHANGE_PER_SECOND_BY_KIND or len(time_s) < 2 * N_FIRST_ROWS_COMPARED:
        return False
    change = np.sqrt(np.square(np.diff(values, axis=0)).sum(axis=1))
    most = MAX_CHANGE_PER_SECOND_BY_KIND[kind] * np.diff(
        time_s
    ) + MIN_FIRST_ROW_JUMP_IN_MEDIAN_STEPS * median_of_finite_values(change)
    return bool(change[0] > most[0] and (change[1:N_FIRST_ROWS_COMPARED] <= most[1:N_FIRST_ROWS_COMPARED]).all())


def stuck_row_mask(kind: Kind, time_s: FloatArray, values: ValueRows) -> npt.NDArray[np.bool_]:
    """Return a mask (n,) of rows in which a speed or velocity that usually changes repeats a value other than zero."""
    n = len(time_s)
    stuck = np.zeros(n, np.bool_)
    if kind not in (Kind.SPEED, Kind.VELOCITY) or n < 2 * MIN_STUCK_ROWS:
        return stuck
    same = (np.diff(values, axis=0) == 0.0).all(axis=1) & (values[1:] != 0.0).any(axis=1)
    for begin, end in begin_and_end_of_true_stretches(same, MIN_STUCK_ROWS):  # rows begin .. end are one number
        if time_s[end] - time_s[begin] >= MIN_STUCK_DURATION_S:
            stuck[begin + 1 : end + 1] = True
    elsewhere = same[~stuck[1:]]
    return stuck if len(elsewhere) and elsewhere.mean() < MAX_REPEATS_AMONG_OTHER_ROWS_SHARE else np.zeros(n, np.bool_)


def begin_and_end_of_true_stretches(mask: BoolArray, min_rows: int) -> list[tuple[int, int]]:
    """Return begin and end (exclusive) of the stretches of True in a mask (n,) that have at least so many rows."""
    runs = first_and_last_rows_of_runs(mask)
    return [(first, last + 1) for first, last in runs if last + 1 - first >= min_rows]
