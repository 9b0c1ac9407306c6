"""Find an accelerometer whose slow part was filtered out, by the fixes.

A high-pass filter of first order with the time constant T makes y of an acceleration a, with y' = a' - y / T. So
a = y + V / T, with V the integral of y: what the changes of speed by the fixes have beyond those by the accelerometer
is then in proportion to V. For a right accelerometer it is not: it is noise, slopes, a bias and its drift.

One that is mounted behind the rear axle also reads w^2 for each metre, with the turn rate w, and w' for each metre to
the side. A car that is slow in its turns has a small V there: what a lever arm explains is told from a filter first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.step_motion import StepMotion, means_between_edges, trapezoidal_integral
from cwcli.signals.columns import FloatArray
from cwcli.signals.normal_distribution import SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION

MIN_STEPS_FOR_SLOW_PART = 12
"""Least number of changes of speed from step to step: four for each fitted number. Chosen by hand; not fitted."""
MIN_INVERSE_TIME_CONSTANT_IN_SIGMAS = 8.0
"""Least 1 / T in sigmas. Chosen by hand, not fitted: slopes that wander look like it by 3 sigmas (Dickey and Fuller),
and the errors of fixes last for some steps."""
MAX_TIME_CONSTANT_OF_HIGH_PASS_S = 30.0
"""Greatest time constant that is told from slopes, s: hills of a few hundred metres last as long. Chosen by hand."""
MAX_SLOW_PART_RESIDUAL_IN_SCATTERS = 4.0
"""Greatest residual, in scatters, that the second pass uses; jumps of fixes lie beyond. Chosen by hand."""
MIN_SUM_OF_SQUARES_LEFT_BY_LINE_SHARE = 1e-12
"""Least share of the integral's sum of squares that a line leaves; below it is rounding. Chosen by hand."""


def high_pass_time_constant_of_accelerometer_s(
    accel: StepMotion, fixes: StepMotion, step_s: float, of_lever_arm: Sequence[FloatArray] = ()
) -> float:
    """Return the time constant of the high-pass filter behind an accelerometer; NaN where none shows.

    Args:
        accel, fixes: Motion by the accelerometer and the fixes in the same n steps.
        step_s: Length of the steps.
        of_lever_arm: Columns (n - 1,) in proportion to which a lever arm adds to the changes of speed; see
            `speed_changes_of_lever_arm`.
    """
    own, true = accel.speed_change_to_next_step_mps, fixes.speed_change_to_next_step_mps
    rows = np.isfinite(own) & np.isfinite(true)
    integral = np.concatenate(([0.0], np.cumsum(np.where(np.isfinite(own), own, 0.0))))
    way = 0.5 * step_s * (integral[1:] + integral[:-1])
    slope, sigma = math.nan, math.nan
    for _ in range(2):
        steps = np.flatnonzero(rows)
        if len(steps) < MIN_STEPS_FOR_SLOW_PART:
            return math.nan
        free_way, missing, *others = (
            _subtract_fitted_line(values[steps], steps) for values in (way, true - own, *of_lever_arm)
        )
        if others:
            basis, _ = np.linalg.qr(np.column_stack(others))
            free_way, missing = (values - basis @ (basis.T @ values) for values in (free_way, missing))
        power = float(free_way @ free_way)
        if not power > MIN_SUM_OF_SQUARES_LEFT_BY_LINE_SHARE * float(way[steps] @ way[steps]):
            return math.nan
        slope = float(free_way @ missing) / power
        rest = missing - slope * free_way
        sigma = math.sqrt(float(rest @ rest) / (len(steps) - 3 - len(others)) / power)
        scatter = SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION * median_of_finite_values(np.abs(rest))
        rows[steps] = np.abs(rest) <= MAX_SLOW_PART_RESIDUAL_IN_SCATTERS * scatter
    is_clear = slope > MIN_INVERSE_TIME_CONSTANT_IN_SIGMAS * sigma and slope * MAX_TIME_CONSTANT_OF_HIGH_PASS_S > 1.0
    return 1.0 / slope if is_clear else math.nan


def speed_changes_of_lever_arm(yaw_rate: SensorSeries, edges_s: FloatArray) -> list[FloatArray]:
    """Return by what the mean speed seems to change from step to step for each metre of a lever arm.

    Args:
        yaw_rate: Turn rates w of the car.
        edges_s: Shape (n + 1,): edges of the steps.

    Returns:
        Columns (n - 1,), m/s: the integral of w^2 for a metre ahead, and w for one to the side, up to their signs.
    """
    time_s, rate = yaw_rate.time_s, yaw_rate.values[:, 0]
    return [np.diff(means_between_edges(time_s, x, edges_s)) for x in (trapezoidal_integral(time_s, rate**2), rate)]


def _subtract_fitted_line(values: FloatArray, steps: npt.NDArray[np.intp]) -> FloatArray:
    """Return values (n,) at steps (n,) less the line that fits them best: the bias of a sensor, and its drift."""
    centred_steps = steps - steps.mean()
    centred = values - values.mean()
    return np.asarray(centred - centred_steps * float(centred_steps @ centred) / float(centred_steps @ centred_steps))
