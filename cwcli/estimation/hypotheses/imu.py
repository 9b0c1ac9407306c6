"""Hypotheses on an IMU, which should have x forward, y left and z up, and measure in m/s^2 and rad/s."""

from __future__ import annotations

import math
from itertools import permutations, product

import numpy as np

from cwcli.estimation.hypotheses.base import Hypothesis
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import STANDARD_GRAVITY_MPS2

AXIS_NAMES = ("x", "y", "z")
"""Names of the axes of an IMU."""
ZERO_IMU_OFFSET = (0.0,) * 6
"""Offset of a hypothesis without one: zero for the three accelerations and the three turn rates."""


def _scale_hypothesis(name: str, group: str, fault: str, action: str, accel: float, gyro: float) -> Hypothesis:
    diagonal = np.diag([accel] * 3 + [gyro] * 3)
    return Hypothesis(name, group, fault, action, tuple(map(tuple, diagonal.tolist())), ZERO_IMU_OFFSET)


def imu_axes_hypothesis(forward_axis: int, left_axis: int, up_axis: int) -> Hypothesis:
    """Return the hypothesis that these axes of the IMU point forward, left and up.

    Args:
        forward_axis, left_axis, up_axis: 1, 2, 3 for x, y, z; negative for an axis that points the other way.
    """
    names = [("-" if axis < 0 else "") + AXIS_NAMES[abs(axis) - 1] for axis in (forward_axis, left_axis, up_axis)]
    rotation = np.zeros((6, 6))
    for row, axis in enumerate((forward_axis, left_axis, up_axis)):
        rotation[row, abs(axis) - 1] = rotation[row + 3, abs(axis) + 2] = math.copysign(1.0, axis)
    fault = f"is mounted with {names[0]} forward, {names[1]} left and {names[2]} up, not x, y and z"
    return Hypothesis(",".join(names), "axes", fault, "turned", tuple(map(tuple, rotation.tolist())), ZERO_IMU_OFFSET)


def signed_axis_rotations() -> tuple[tuple[int, int, int], ...]:
    """Return the 24 rotations onto axes: which axes (1 to 3 with sign) point forward, left and up."""
    found = []
    for order, signs in product(permutations((1, 2, 3)), product((1, -1), repeat=3)):
        axes = tuple(sign * axis for sign, axis in zip(signs, order, strict=True))
        matrix = np.zeros((3, 3))
        for row, axis in enumerate(axes):
            matrix[row, abs(axis) - 1] = math.copysign(1.0, axis)
        if np.linalg.det(matrix) > 0.0:
            found.append((axes[0], axes[1], axes[2]))
    return tuple(sorted(found, key=lambda axes: axes != (1, 2, 3)))


def _accel_unit_hypothesis(name: str, fault: str, mps2_per_unit: float) -> Hypothesis:
    return _scale_hypothesis(name, "accel unit", f"measures acceleration in {fault}", "converted", mps2_per_unit, 1.0)


def _gyro_unit_hypothesis(name: str, fault: str, radps_per_unit: float) -> Hypothesis:
    return _scale_hypothesis(name, "gyro unit", f"measures turn rates in {fault}", "converted", 1.0, radps_per_unit)


ACCEL_UNIT_HYPOTHESES = (
    _accel_unit_hypothesis("g", "g, not m/s^2", STANDARD_GRAVITY_MPS2),
    _accel_unit_hypothesis("mg", "mg, not m/s^2", 1e-3 * STANDARD_GRAVITY_MPS2),
    _accel_unit_hypothesis("cm/s^2", "cm/s^2, not m/s^2", 0.01),
    _accel_unit_hypothesis("ft/s^2", "feet/s^2, not m/s^2", 0.3048),
    _accel_unit_hypothesis(
        "m/s^2-read-as-g", "m/s^2, but was converted as if it were in g", 1.0 / STANDARD_GRAVITY_MPS2
    ),
)
"""Hypotheses on the unit of an accelerometer."""
GYRO_UNIT_HYPOTHESES = (
    _gyro_unit_hypothesis("degrees/s", "degrees/s, not rad/s", math.pi / 180.0),
    _gyro_unit_hypothesis("milliradians/s", "milliradians/s, not rad/s", 1e-3),
    _gyro_unit_hypothesis(
        "rad/s-read-as-degrees/s", "rad/s, but was converted as if it were in degrees/s", 180.0 / math.pi
    ),
)
"""Hypotheses on the unit of a gyroscope."""
GYRO_REVERSED_HYPOTHESIS = _scale_hypothesis(
    "gyro-reversed", "gyro sign", "has a gyroscope with the wrong sign", "reversed", 1.0, -1.0
)
"""Hypothesis that the gyroscope has the wrong sign."""
IMU_SIGN_HYPOTHESES = (
    _scale_hypothesis(
        "accel-reversed", "accel sign", "has an accelerometer with the wrong sign", "reversed", -1.0, 1.0
    ),
    GYRO_REVERSED_HYPOTHESIS,
)
"""Two hypotheses: that the accelerometer has the wrong sign, and that the gyroscope has."""
IMU_AXES_HYPOTHESES = tuple(imu_axes_hypothesis(*axes) for axes in signed_axis_rotations()[1:])
"""The 23 rotations onto axes besides the right one."""
IMU_UNIT_SIGN_AND_AXES_HYPOTHESES = (
    *ACCEL_UNIT_HYPOTHESES,
    *GYRO_UNIT_HYPOTHESES,
    *IMU_SIGN_HYPOTHESES,
    *IMU_AXES_HYPOTHESES,
)
"""Hypotheses on units, signs and axes of a source of `Kind.IMU`."""


def imu_tilt_hypothesis(mean_force: FloatArray) -> Hypothesis:
    """Return the hypothesis that an IMU is tilted: the shortest turn takes its mean specific force (3,) to z.

    Rodrigues' formula: R = I + K + K K / (1 + c), with K the cross product by u x z and c their scalar product, u z.
    """
    u = mean_force / np.linalg.norm(mean_force)
    cross = np.array([[0.0, 0.0, -u[0]], [0.0, 0.0, -u[1]], [u[0], u[1], 0.0]])
    turn = np.eye(3) + cross + cross @ cross / (1.0 + u[2])
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = turn
    tilt_deg = math.degrees(math.acos(min(1.0, float(u[2]))))
    fault = f"is mounted tilted by {tilt_deg:.0f} degrees"
    return Hypothesis("tilted", "tilt", fault, "levelled", tuple(map(tuple, matrix.tolist())), ZERO_IMU_OFFSET)
