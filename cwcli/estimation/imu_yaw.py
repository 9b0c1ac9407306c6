"""Find how far a level IMU is turned about the vertical, by its horizontal accelerations and those of the others."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cwcli.estimation.hypotheses.base import Hypothesis
from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.source_hypotheses import step_motions_and_edges_for_evidence
from cwcli.estimation.step_motion import covered_step_mask, means_between_edges
from cwcli.signals.columns import AccelGyroRows, FloatArray

MIN_CORRECTED_MOUNTING_YAW_RAD = math.radians(6.0)
"""Least angle that is corrected: less adds a tenth of the lateral acceleration to the forward one. Chosen by hand; not
fitted."""
MIN_TIME_STEPS_WITH_IMU_AND_FIXES = 10
"""Least number of time steps with accelerations by both the IMU and the fixes. Chosen by hand; not fitted."""
MIN_CORRELATION_OF_IMU_AND_FIX_ACCELERATIONS = 0.8
"""Least correlation of the turned accelerations with those of the fixes. Chosen by hand; not fitted."""
MIN_MOUNTING_YAW_IN_SIGMAS = 4.0
"""Least angle in its sigmas: one log without a fault in 16,000. Not fitted."""
MIN_RMS_ACCELERATION_OF_FIXES_MPS2 = 0.5
"""Least root mean square of both accelerations of the fixes together, m/s^2: without a manoeuvre nothing shows. Chosen
by hand; not fitted."""


def find_imu_yaw_hypothesis_and_evidence(
    time_s: FloatArray, values: AccelGyroRows, others: Sequence[SensorSeries]
) -> tuple[Hypothesis, str] | None:
    """Return the turn of a level IMU about the vertical and what shows it, or None.

    The accelerations of a step by the IMU (forward f, left l) are those of the others (v', v w) turned by the angle.
    The speed v is that of a wheel, else of the fixes. The turn rate w is the IMU's own, which the angle does not
    change, else that of the fixes.
    The turn of least squares between two sets of vectors has the angle atan2(sum of cross products, sum of scalar
    products) (Horn, 1987, in the plane). Noise of either makes both sums smaller and does not move it.

    Args:
        values: Shape (n, 6): accelerometer and gyroscope, levelled.
        others: Series of fixes first, then of speeds and of the IMU's own yaw rate.
    """
    motions, edges_s = step_motions_and_edges_for_evidence(others)
    if len(edges_s) < MIN_TIME_STEPS_WITH_IMU_AND_FIXES + 3 or len(time_s) < MIN_TIME_STEPS_WITH_IMU_AND_FIXES:
        return None
    measured = np.column_stack([means_between_edges(time_s, column, edges_s) for column in values[:, :2].T])
    measured[~covered_step_mask(time_s, edges_s)] = np.nan
    speed = next((m for m in motions if m.kind is Kind.SPEED), motions[0])
    turning = next((m for m in motions if m.kind is Kind.YAW_RATE), motions[0])
    reference = _forward_and_left_accelerations_mps2(speed.speed_mps, turning.turn_rad, float(edges_s[1] - edges_s[0]))
    measured = measured[1:-1]
    rows = np.isfinite(measured).all(axis=1) & np.isfinite(reference).all(axis=1)
    n = int(rows.sum())
    if n < MIN_TIME_STEPS_WITH_IMU_AND_FIXES:
        return None
    f, r = (
        column[rows] - [median_of_finite_values(column[rows, 0]), median_of_finite_values(column[rows, 1])]
        for column in (measured, reference)
    )
    power = float(np.square(f).sum()) * float(np.square(r).sum())
    dot, cross = float((f * r).sum()), float((f[:, 1] * r[:, 0] - f[:, 0] * r[:, 1]).sum())
    if np.square(r).sum() < n * MIN_RMS_ACCELERATION_OF_FIXES_MPS2**2 or math.hypot(
        dot, cross
    ) < MIN_CORRELATION_OF_IMU_AND_FIX_ACCELERATIONS * math.sqrt(power):
        return None
    yaw_rad = math.atan2(cross, dot)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    rest = f @ np.array([[c, -s], [s, c]]) - r
    sigma_rad = math.sqrt(float(np.square(rest).sum()) / (2.0 * n) / float(np.square(r).sum()))
    if abs(yaw_rad) < max(MIN_CORRECTED_MOUNTING_YAW_RAD, MIN_MOUNTING_YAW_IN_SIGMAS * sigma_rad):
        return None
    matrix = np.eye(6)
    matrix[:2, :2] = matrix[3:5, 3:5] = ((c, s), (-s, c))
    side = "right" if yaw_rad > 0.0 else "left"
    fault = f"is mounted turned by {abs(math.degrees(yaw_rad)):.0f} degrees to the {side} about the vertical"
    hypothesis = Hypothesis("yawed", "yaw", fault, "turned back", tuple(map(tuple, matrix.tolist())), (0.0,) * 6)
    judges = ", ".join(dict.fromkeys(m.source for m in (speed, turning)))
    evidence = f"accelerations of {judges}, sigma {math.degrees(sigma_rad):.1f} degrees in {n} steps"
    return hypothesis, evidence


def _forward_and_left_accelerations_mps2(speed_mps: FloatArray, turn_rad: FloatArray, step_s: float) -> FloatArray:
    """Return forward and left acceleration in each step but the first and last, (n - 2, 2).

    Args:
        speed_mps: Shape (n,): mean speed in each step.
        turn_rad: Shape (n - 1,): turn from each step to the next.
        step_s: Length of a step.
    """
    forward = (speed_mps[2:] - speed_mps[:-2]) / (2.0 * step_s)
    return np.column_stack([forward, speed_mps[1:-1] * (turn_rad[:-1] + turn_rad[1:]) / (2.0 * step_s)])
