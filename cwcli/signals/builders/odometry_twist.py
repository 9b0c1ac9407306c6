"""The twist of an `Odometry`: horizontal velocity in the axes of the pose, speed, and yaw rate about the vertical.

By the message's definition the twist is in the child frame, whose axes the whole orientation turns into those of the
pose: a device that is pitched sees a part of the speed in its z.
"""

from __future__ import annotations

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.builders.motion import nan_if_always_zero, read_rotation_matrices
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.direction_of_travel import ComplexArray, travel_direction_and_signed_speed
from cwcli.signals.leaf_fields import find_field, read_matrix, read_numbers, read_stamps
from cwcli.signals.quality import RowLedger

MIN_SPEED_OF_ROWS_THAT_TELL_TWIST_AXES_MPS = 0.5
"""Least speed in m/s of rows that tell in which axes a twist is. Chosen by hand."""
MIN_MOVING_ROWS_THAT_TELL_TWIST_AXES = 10
"""Least number of rows in motion that tell in which axes a twist is. Chosen by hand; not fitted."""
MAX_SIDEWAYS_TO_FORWARD_SPEED_RATIO = 0.1
"""Greatest sideways part of a car's velocity, as a share of its forward part. Chosen by hand."""
MIN_POSITION_EXTENT_OF_MOVED_CAR_M = 2.0
"""Least extent of the positions, m, of a car that moved: a twist of zeros throughout was then never filled. Chosen by
hand."""
MAX_MEASURED_VELOCITY_VARIANCE_M2PS2 = 1e3
"""Greatest variance of a measured component of a velocity, (m/s)^2; one of more than 30 m/s of sigma is stated but not
measured. Chosen by hand."""


@dataclass(frozen=True)
class Twist:
    """What the messages say of the motion, shape (n,) each, NaN where not known.

    Attributes:
        velocity: Horizontal, x + iy in the axes of the pose, m/s; NaN where no orientation turns it there.
        speed_mps: Horizontal, in the direction of travel, negative in reverse.
        speed_variance: In (m/s)^2, unchecked.
        yaw_rate_radps: About the vertical, counter-clockwise positive.
        yaw_rate_variance: In (rad/s)^2, unchecked.
    """

    velocity: ComplexArray
    speed_mps: FloatArray
    speed_variance: FloatArray
    yaw_rate_radps: FloatArray
    yaw_rate_variance: FloatArray


def read_twist(columns: Columns, ledger: RowLedger, position_m: FloatArray, yaw_rad: FloatArray) -> Twist:
    """Read the twist of an `Odometry`.

    Some senders put it in the axes of the pose; the way from pose to pose tells, and it is then taken as it stands.
    Where no orientation is given and the twist points to the side, too, as no car drives, the speed is its magnitude.

    Args:
        columns: n messages.
        position_m: Shape (n, 3).
        yaw_rad: Shape (n,), NaN where no orientation is given.
    """
    n = len(columns)
    nothing = np.full(n, np.nan)
    if find_field(columns, "twist.twist.linear.x") is None or _is_twist_never_filled(columns, ledger, position_m):
        return Twist(nothing + 0j, nothing, nothing, _read_yaw_rate(columns, ledger, None), nothing)
    covariance = read_matrix(columns, "twist.covariance", 36).reshape(n, 6, 6)
    linear, variance = _zero_unmeasured_components(_read_twist_vector(columns, "linear"), covariance[:, :3, :3])
    yaw_rate_variance = covariance[:, 5, 5]
    if not np.isfinite(yaw_rad).any():
        speed, towards = _speed_and_direction_without_orientation(ledger, linear)
        yaw_rate = _read_yaw_rate(columns, ledger, None)
        return Twist(nothing + 0j, speed, _variance_along(variance, towards), yaw_rate, yaw_rate_variance)
    rotation = read_rotation_matrices(columns, "pose.pose.orientation")
    in_map, in_child = linear[:, 0] + 1j * linear[:, 1], _rotated_horizontal_part(rotation, linear)
    if _is_twist_in_map_axes(columns, position_m, in_map, in_child):
        ledger.add_note("the twist is in the axes of the pose, not of the child frame: it is used without rotation")
        velocity, rotation = in_map, np.broadcast_to(np.eye(3), rotation.shape)
        yaw_rate = _read_yaw_rate(columns, ledger, None)
    else:
        velocity, yaw_rate = in_child, _read_yaw_rate(columns, ledger, rotation)
    heading, speed = travel_direction_and_signed_speed(velocity, yaw_rad, 0.0)
    ahead = np.column_stack([np.cos(heading), np.sin(heading), np.zeros(n)])
    towards = np.einsum("nij,ni->nj", rotation, ahead)
    is_turned = np.isfinite(velocity)
    return Twist(
        velocity,
        np.where(is_turned, speed, linear[:, 0]),
        np.where(is_turned, _variance_along(variance, towards), variance[:, 0, 0]),
        yaw_rate,
        yaw_rate_variance,
    )


def _read_twist_vector(columns: Columns, name: str) -> FloatArray:
    """A vector of the twist, shape (n, 3); z is 0 where the message has none."""
    vector = np.stack([read_numbers(columns, f"twist.twist.{name}.{axis}") for axis in "xyz"], axis=1)
    vector[:, 2] = np.where(np.isfinite(vector[:, 2]), vector[:, 2], 0.0)
    return vector


def _is_twist_never_filled(columns: Columns, ledger: RowLedger, position_m: FloatArray) -> bool:
    """Whether the velocity is exactly 0 in every message of a car that moved."""
    if len(columns) < 2 or _read_twist_vector(columns, "linear").any():
        return False
    known = position_m[np.isfinite(position_m[:, :2]).all(axis=1), :2]
    if not len(known) or float(np.ptp(known, axis=0).max()) < MIN_POSITION_EXTENT_OF_MOVED_CAR_M:
        return False
    ledger.add_note("the twist is exactly 0 in every message though the position moves, taken as not measured")
    return True


def _zero_unmeasured_components(velocity_mps: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Velocities (n, 3) and covariances (n, 3, 3) in which sideways and upward components are 0 where not measured."""
    velocity_mps, variance = velocity_mps.copy(), variance.copy()
    for axis in (1, 2):
        is_unmeasured = variance[:, axis, axis] > MAX_MEASURED_VELOCITY_VARIANCE_M2PS2
        velocity_mps[is_unmeasured, axis] = 0.0
        variance[is_unmeasured, axis, :] = 0.0
        variance[is_unmeasured, :, axis] = 0.0
    return velocity_mps, variance


def _speed_and_direction_without_orientation(ledger: RowLedger, linear: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The speed (n,) and the direction (n, 3) that it is taken in, where no orientation is given."""
    towards = np.zeros_like(linear)
    towards[:, 0] = 1.0
    x, y = linear[:, 0], linear[:, 1]
    if np.nansum(np.abs(y)) <= MAX_SIDEWAYS_TO_FORWARD_SPEED_RATIO * np.nansum(np.abs(x)):
        return x, towards
    ledger.add_note("the speed is the magnitude of the twist")
    angle = np.arctan2(y, x)
    return np.hypot(x, y), np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(x))])


def _rotated_horizontal_part(rotation: FloatArray, vector: FloatArray) -> ComplexArray:
    """The horizontal part of turned vectors, x + iy, shape (n,)."""
    rotated = np.einsum("nij,nj->ni", rotation[:, :2], vector)
    return np.asarray(rotated[:, 0] + 1j * rotated[:, 1])


def _variance_along(covariance: FloatArray, towards: FloatArray) -> FloatArray:
    """The variance along unit vectors (n, 3) of covariances (n, 3, 3)."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(
            np.einsum("ni,nij,nj->n", towards, np.where(towards[:, :, None] == 0.0, 0.0, covariance), towards)
        )


def _read_yaw_rate(columns: Columns, ledger: RowLedger, rotation: FloatArray | None) -> FloatArray:
    """About the vertical, (n,): the angular velocity turned by the orientation, or its z as it stands."""
    about_z = nan_if_always_zero(ledger, read_numbers(columns, "twist.twist.angular.z"), "yaw rate")
    if rotation is None:
        return about_z
    angular = np.stack([read_numbers(columns, f"twist.twist.angular.{axis}") for axis in "xyz"], axis=1)
    angular[:, :2] = np.where(np.isfinite(angular[:, :2]), angular[:, :2], 0.0)
    vertical = np.einsum("nj,nj->n", rotation[:, 2], angular)
    return np.where(np.isfinite(vertical) & np.isfinite(about_z), vertical, about_z)


def _is_twist_in_map_axes(
    columns: Columns, position_m: FloatArray, in_map: ComplexArray, in_child: ComplexArray
) -> bool:
    """Whether the way from pose to pose follows the twist clearly better as it stands than turned by the yaw."""
    stamp_ns, has_stamp = read_stamps(columns)
    step_s = np.diff(stamp_ns) * 1e-9
    with np.errstate(divide="ignore", invalid="ignore"):
        driven = np.diff(position_m[:, 0] + 1j * position_m[:, 1]) / step_s
    as_map, as_child = (0.5 * (each[:-1] + each[1:]) for each in (in_map, in_child))
    use = has_stamp[:-1] & has_stamp[1:] & (step_s > 0.0) & np.isfinite(driven)
    use &= (
        np.isfinite(as_map) & np.isfinite(as_child) & (np.abs(in_map[:-1]) > MIN_SPEED_OF_ROWS_THAT_TELL_TWIST_AXES_MPS)
    )
    if np.count_nonzero(use) < MIN_MOVING_ROWS_THAT_TELL_TWIST_AXES:
        return False
    return bool(np.mean(np.abs(driven - as_map)[use]) < 0.5 * np.mean(np.abs(driven - as_child)[use]))
