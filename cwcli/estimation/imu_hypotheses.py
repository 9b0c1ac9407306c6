"""Find units, signs and axes of an IMU by gravity and by what the other sources say of turns and changes of speed.

Everything that the estimate uses of an IMU is linear in its six values. So the values are integrated once over each
step, and the log-likelihood of each axis as the forward, left and upward one, in each unit, is looked up in tables.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from cwcli.estimation.hypotheses.base import Hypothesis
from cwcli.estimation.hypotheses.imu import (
    ACCEL_UNIT_HYPOTHESES,
    GYRO_UNIT_HYPOTHESES,
    IMU_SIGN_HYPOTHESES,
    imu_axes_hypothesis,
    signed_axis_rotations,
)
from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.source_hypotheses import (
    LOG_LIKELIHOOD_COST_OF_SECOND_FAULT,
    MAX_DISTANCE_RATIO_ERROR,
    MIN_LOG_LIKELIHOOD_GAIN_OF_HYPOTHESIS,
    MIN_LOG_LIKELIHOOD_MARGIN_TO_NEXT,
    step_motions_and_edges_for_evidence,
)
from cwcli.estimation.step_evidence import (
    MIN_COMPARED_STEPS,
    MIN_LATERAL_SIGMA_MPS2,
    MIN_SPEED_CHANGE_SIGMA_MPS,
    MIN_TURN_SIGMA_RAD,
    StepResiduals,
    log_likelihood_gains_of_candidates,
)
from cwcli.estimation.step_motion import StepMotion, covered_step_mask, means_between_edges, trapezoidal_integral
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import AccelGyroRows, FloatArray
from cwcli.signals.units import STANDARD_GRAVITY_MPS2

SPECIFIC_FORCE_OVER_GRAVITY_RANGE = (0.8, 1.2)
"""Range of the mean specific force relative to gravity in the right unit: bends and slopes change it by less. Chosen by
hand; not fitted."""
SPECIFIC_FORCE_OVER_GRAVITY_SIGMA = 0.05
"""One sigma of the mean specific force relative to gravity: bends, and an accelerometer's scale of 3 %. Chosen by hand;
not fitted."""
MAX_SPECIFIC_FORCE_OVER_GRAVITY_IF_REMOVED = 0.3
"""Greatest mean specific force relative to gravity where gravity was removed. Chosen by hand; not fitted."""
IMU_TILT_SIGMA_RAD = math.radians(20.0)
"""One sigma of the tilt of an IMU against the axes of the car: phones in a holder. Chosen by hand; not fitted."""
MIN_GRAVITY_LOG_LIKELIHOOD = -30.0
"""Least log-likelihood of gravity: an impossible one, but no more than thirty clear steps of motion can outweigh.
Chosen by hand; not fitted."""
REMOVED_GRAVITY_LOG_LIKELIHOOD = -15.0
"""Log-likelihood that gravity was removed. Chosen between an upright IMU (0) and an impossible one: with gravity in one
unit, another unit in which it were removed is unlikely."""
SIGNED_IMU_AXES = (1, 2, 3, -1, -2, -3)
"""The axes x, y and z of an IMU in both directions."""


@dataclass(frozen=True)
class ImuFinding:
    """Units, signs and axes of an IMU.

    Attributes:
        hypothesis: What is wrong.
        gain: Log-likelihood beyond that of the values as they are.
        is_forward_clear: Whether the forward axis is known, too, and not only the upward one.
        changes_yaw_rate: Whether the yaw rate is another one with it.
    """

    hypothesis: Hypothesis
    gain: float
    is_forward_clear: bool
    changes_yaw_rate: bool


@dataclass(frozen=True)
class _ImuFault:
    """One combination of faults with its log-likelihood.

    Attributes:
        axes: Axes that point forward, left and up, 1 to 3 with sign.
        accel_sign, gyro_sign: 1 or -1.
        accel_unit, gyro_unit: Index of the unit; 0 is the right one.
        total: Log-likelihood beyond that without a fault, minus the cost of the faults.
    """

    axes: tuple[int, int, int]
    accel_sign: int
    gyro_sign: int
    accel_unit: int
    gyro_unit: int
    total: float

    @property
    def signed_yaw_axis_and_unit(self) -> tuple[int, int]:
        """What the yaw rate is read from."""
        return self.axes[2] * self.gyro_sign, self.gyro_unit

    @property
    def signed_forward_axis_and_unit(self) -> tuple[int, int]:
        """What the forward acceleration is read from."""
        return self.axes[0] * self.accel_sign, self.accel_unit

    def to_hypothesis(self) -> Hypothesis | None:
        """Return the combination as one hypothesis; None without a fault."""
        parts = [
            *([ACCEL_UNIT_HYPOTHESES[self.accel_unit - 1]] if self.accel_unit else []),
            *([GYRO_UNIT_HYPOTHESES[self.gyro_unit - 1]] if self.gyro_unit else []),
            *([IMU_SIGN_HYPOTHESES[0]] if self.accel_sign < 0 else []),
            *([IMU_SIGN_HYPOTHESES[1]] if self.gyro_sign < 0 else []),
            *([imu_axes_hypothesis(*self.axes)] if self.axes != (1, 2, 3) else []),
        ]
        found: Hypothesis | None = None
        for part in parts:
            found = part if found is None else part.combine_after(found)
        return found


def find_imu_unit_sign_or_axis_fault(
    time_s: FloatArray, values: AccelGyroRows, others: Sequence[SensorSeries]
) -> ImuFinding | None:
    """Return units, signs and axes that clearly explain an IMU better than none, or None.

    Args:
        values: Shape (n, 6): accelerometer and gyroscope.
        others: Series of the other sources, at least one a position.
    """
    motions, edges_s = step_motions_and_edges_for_evidence(others)
    if len(edges_s) < MIN_COMPARED_STEPS or len(time_s) < 2:
        return None
    known = covered_step_mask(time_s, edges_s)
    rate = np.column_stack([means_between_edges(time_s, column, edges_s) for column in values.T])
    integrals = [trapezoidal_integral(time_s, column) for column in values.T]
    integral = np.column_stack([means_between_edges(time_s, column, edges_s) for column in integrals])
    rate[~known] = integral[~known] = np.nan
    change = np.diff(integral, axis=0)
    gyro_units = [1.0, *(each.matrix[3][3] for each in GYRO_UNIT_HYPOTHESES)]
    accel_units = [1.0, *(each.matrix[0][0] for each in ACCEL_UNIT_HYPOTHESES)]
    yaw = _log_likelihood_gains_over_nominal_axis_and_unit(
        change[:, 3:], gyro_units, 3, [m.turn_rad for m in motions], MIN_TURN_SIGMA_RAD, is_angle=True
    )
    forward = _log_likelihood_gains_over_nominal_axis_and_unit(
        change[:, :3], accel_units, 1, [m.speed_change_to_next_step_mps for m in motions], MIN_SPEED_CHANGE_SIGMA_MPS
    )
    step_s = float(edges_s[1] - edges_s[0])
    lateral = _log_likelihood_gains_over_nominal_axis_and_unit(
        rate[1:-1, :3],
        accel_units,
        2,
        [_speed_times_turn_rate_mps2(m, step_s) for m in motions],
        MIN_LATERAL_SIGMA_MPS2,
    )
    force = values[:, :3].mean(axis=0)
    gravity = {
        (axis, unit): _gravity_log_likelihood(force * factor, axis)
        for axis, (unit, factor) in product(SIGNED_IMU_AXES, enumerate(accel_units))
    }
    faults = [
        _ImuFault(
            axes, accel_sign, gyro_sign, accel_unit, gyro_unit,
            yaw[axes[2] * gyro_sign, gyro_unit]
            + forward[axes[0] * accel_sign, accel_unit]
            + lateral[axes[1] * accel_sign, accel_unit]
            + gravity[axes[2] * accel_sign, accel_unit]
            - gravity[3, 0]
            - LOG_LIKELIHOOD_COST_OF_SECOND_FAULT
            * ((axes != (1, 2, 3)) + (accel_sign < 0) + (gyro_sign < 0) + bool(accel_unit) + bool(gyro_unit)),
        )
        for axes, accel_sign, gyro_sign, accel_unit, gyro_unit in _iter_axes_signs_and_units(
            len(accel_units), len(gyro_units)
        )
    ]  # fmt: skip
    best = max(faults, key=lambda each: each.total)
    hypothesis = best.to_hypothesis()
    if hypothesis is None or best.total < MIN_LOG_LIKELIHOOD_GAIN_OF_HYPOTHESIS:
        return None
    yaw_rival = max(each.total for each in faults if each.signed_yaw_axis_and_unit != best.signed_yaw_axis_and_unit)
    forward_rival = max(each.total for each in faults if not _reads_same_forward_acceleration(each, best, accel_units))
    if best.total - yaw_rival < MIN_LOG_LIKELIHOOD_MARGIN_TO_NEXT:
        return None
    # A mirrored map makes both the turns and the lateral acceleration of a right IMU seem reversed.
    is_mirrored = best.signed_yaw_axis_and_unit == (-3, 0) and best.axes[1] * best.accel_sign == -2
    if is_mirrored and not any(m.kind in (Kind.HEADING, Kind.VELOCITY) for m in motions):
        return None
    return ImuFinding(
        hypothesis,
        best.total,
        best.total - forward_rival >= MIN_LOG_LIKELIHOOD_MARGIN_TO_NEXT,
        changes_yaw_rate=best.signed_yaw_axis_and_unit != (3, 0),
    )


def _reads_same_forward_acceleration(one: _ImuFault, other: _ImuFault, units: Sequence[float]) -> bool:
    """Whether two combinations read nearly the same forward acceleration; 1 mg and 1 cm/s^2 differ by 2 %."""
    ratio = units[one.accel_unit] / units[other.accel_unit]
    return (
        one.signed_forward_axis_and_unit[0] == other.signed_forward_axis_and_unit[0]
        and abs(ratio - 1.0) < MAX_DISTANCE_RATIO_ERROR
    )


def _iter_axes_signs_and_units(
    n_accel_units: int, n_gyro_units: int
) -> Iterator[tuple[tuple[int, int, int], int, int, int, int]]:
    yield from product(signed_axis_rotations(), (1, -1), (1, -1), range(n_accel_units), range(n_gyro_units))


def _log_likelihood_gains_over_nominal_axis_and_unit(
    axis_columns: FloatArray,
    units: Sequence[float],
    nominal_axis: int,
    references: Sequence[FloatArray],
    floor: float,
    *,
    is_angle: bool = False,
) -> dict[tuple[int, int], float]:
    """Return (signed axis, index of the unit) -> log-likelihood beyond that of the right axis in the right unit.

    Args:
        axis_columns: Shape (n, 3): what the axes show in each step.
        units: Factors to SI units, the first one 1.
        nominal_axis: The axis if nothing is wrong, 1 to 3.
        references: Of each other source what it should be, (n,).
        floor: Least scale of the residuals.
        is_angle: Differences are wrapped; of others the median is subtracted, because a constant is a bias.
    """
    used = [reference for reference in references if np.isfinite(reference).sum() >= MIN_COMPARED_STEPS]

    def axis_residuals_of_steps(axis: int, factor: float) -> list[StepResiduals]:
        column = math.copysign(factor, axis) * axis_columns[:, abs(axis) - 1]
        found = []
        for reference in used:
            difference = column - reference
            if is_angle:
                difference = (difference + math.pi) % (2.0 * math.pi) - math.pi
            else:
                known = difference[np.isfinite(difference)]
                difference = difference - (median_of_finite_values(known) if len(known) else 0.0)
            found.append(StepResiduals(difference, floor))
        return found

    keys = list(product(SIGNED_IMU_AXES, range(len(units))))
    gains = log_likelihood_gains_of_candidates(
        axis_residuals_of_steps(nominal_axis, 1.0), [axis_residuals_of_steps(axis, units[unit]) for axis, unit in keys]
    )
    return dict(zip(keys, gains, strict=True))


def _speed_times_turn_rate_mps2(m: StepMotion, step_s: float) -> FloatArray:
    """Return speed times turn rate in each step but the first and last, (n - 2,); NaN where a source has not both."""
    turn = m.turn_rad
    return np.asarray(m.speed_mps[1:-1] * (turn[:-1] + turn[1:]) / (2.0 * step_s))


def _gravity_log_likelihood(force_mps2: FloatArray, up: int) -> float:
    """Return the log-likelihood that a mean specific force (3,) is gravity along an axis; 0 without gravity in it."""
    norm = float(np.linalg.norm(force_mps2))
    share = norm / STANDARD_GRAVITY_MPS2
    if share < MAX_SPECIFIC_FORCE_OVER_GRAVITY_IF_REMOVED:
        return REMOVED_GRAVITY_LOG_LIKELIHOOD
    if not SPECIFIC_FORCE_OVER_GRAVITY_RANGE[0] < share < SPECIFIC_FORCE_OVER_GRAVITY_RANGE[1]:
        return MIN_GRAVITY_LOG_LIKELIHOOD
    tilt_rad = math.acos(
        max(-1.0, min(1.0, math.copysign(force_mps2[abs(up) - 1], up * force_mps2[abs(up) - 1]) / norm))
    )
    log_likelihood = -0.5 * (
        (tilt_rad / IMU_TILT_SIGMA_RAD) ** 2 + ((share - 1.0) / SPECIFIC_FORCE_OVER_GRAVITY_SIGMA) ** 2
    )
    return max(MIN_GRAVITY_LOG_LIKELIHOOD, log_likelihood)
