"""Level an IMU: convert its raw rows to a forward acceleration and a yaw rate."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import AccelGyroRows, FloatArray, median_of_values

MIN_MEAN_SPECIFIC_FORCE_OF_GRAVITY_MPS2 = 5.0
"""Least mean specific force that is taken for gravity, m/s^2; chosen as about half of it."""
N_BLOCKS_FOR_MOUNTING_SIGMA = 10
"""Number of parts of a log whose scatter gives the sigma of the mounting; chosen by hand."""
INTERPOLATED_IMU_WINDOW_SAMPLES = 15
"""Number of consecutive samples in which most must lie on a straight line to count as interpolated; chosen by hand."""
MIN_MEAN_TURN_RATE_OF_CIRCLING_RADPS = 0.1
"""Least mean turn rate of a vehicle that drives in circles, rad/s: twice the bias of a phone's gyroscope."""
MAX_INTERPOLATED_CURVATURE_RATIO = 0.02
"""Greatest curvature of an interpolated sample, relative to the median curvature of the signal; chosen by hand."""


@dataclass(frozen=True)
class ImuMounting:
    """Pitch and roll of an IMU against the vertical.

    Attributes:
        nose_up_rad: Angle of its forward axis above the horizon.
        left_up_rad: Angle by which its left axis is turned up about the forward axis.
        sigma_rad: One sigma of each, by the scatter of the mean specific force over N_MOUNTING_BLOCKS parts of the log.
    """

    nose_up_rad: float
    left_up_rad: float
    sigma_rad: float = float("nan")

    @classmethod
    def from_mean_specific_force(cls, force: FloatArray, gyro: FloatArray) -> ImuMounting | None:
        """Find the mounting by the mean direction of the specific force (n, 3); None without an upward gravity in it.

        The part that is proportional to the turn rate (n, 3) about that direction is acceleration in bends and is
        subtracted first: a drive with more turns to one side would otherwise seem rolled. Where the vehicle drives in
        circles all the time, acceleration and gravity cannot be told apart, and the axis of the turn is the vertical.
        """
        axis = find_steady_turn_axis(gyro)
        turning = None if axis is None else cls._from_steady_turn(force.mean(axis=0), axis)
        if turning is not None:
            return turning
        force = _remove_turning_from_specific_force(force, gyro)
        up = force.mean(axis=0) if len(force) else np.zeros(3)
        norm = float(np.linalg.norm(up))
        if not (norm > MIN_MEAN_SPECIFIC_FORCE_OF_GRAVITY_MPS2 and up[2] > 0.5 * norm):
            return None
        parts = [
            part.mean(axis=0)[:2] / norm for part in np.array_split(force, N_BLOCKS_FOR_MOUNTING_SIGMA) if len(part)
        ]
        sigma_rad = float(np.mean(np.std(parts, axis=0, ddof=1))) / len(parts) ** 0.5 if len(parts) > 1 else np.nan
        return cls(float(np.arcsin(up[0] / norm)), float(np.arctan2(up[1], up[2])), sigma_rad)

    @classmethod
    def _from_steady_turn(cls, force: FloatArray, axis: FloatArray) -> ImuMounting | None:
        """Find the mounting by the mean specific force (3,) and the axis (3,) of a turn that lasts for the whole drive.

        The acceleration in the turn is level and to the side, so that the force along the axis is gravity, and the one
        along the forward axis is gravity's share. No sigma is given: the bias of the gyroscope is not known.
        """
        gravity = float(force @ axis)
        up = axis * math.copysign(1.0, gravity)
        if not (abs(gravity) > MIN_MEAN_SPECIFIC_FORCE_OF_GRAVITY_MPS2 and up[2] > 0.5):
            return None
        nose_up = min(max(float(force[0]) / abs(gravity), -1.0), 1.0)
        return cls(math.asin(nose_up), math.atan2(float(up[1]), float(up[2])))

    @property
    def up_unit_vector_in_imu_axes(self) -> FloatArray:
        """Unit vector of the vertical in the IMU's axes, (3,)."""
        level = np.cos(self.nose_up_rad)
        return np.array([np.sin(self.nose_up_rad), level * np.sin(self.left_up_rad), level * np.cos(self.left_up_rad)])

    @property
    def left_unit_vector_in_imu_axes(self) -> FloatArray:
        """Unit vector of the level left axis in the IMU's axes, (3,)."""
        return np.array([0.0, np.cos(self.left_up_rad), -np.sin(self.left_up_rad)])


@dataclass(frozen=True)
class LevelledImu:
    """Acceleration, yaw rate and pitch rate of a levelled IMU, as the filter uses them.

    Attributes:
        time_s: Shape (n,).
        accel_mps2: Shape (n,): along the body's forward axis, gravity through a pitched mount still in it (it is
            the bias that the filter finds).
        yaw_rate_radps: Shape (n,): about the vertical.
        pitch_rate_radps: Shape (n,): about the left axis, nose down positive; see
            `_remove_bias_and_yaw_from_pitch_rate`.
        accel_variance, yaw_rate_variance: Shape (n,), NaN where the message does not say.
        n_interpolated: Samples left out because they were interpolated before the log was made.
        mounting: The mounting that was compensated; None: the axes are used unchanged.
    """

    time_s: FloatArray
    accel_mps2: FloatArray
    yaw_rate_radps: FloatArray
    pitch_rate_radps: FloatArray
    accel_variance: FloatArray
    yaw_rate_variance: FloatArray
    n_interpolated: int
    mounting: ImuMounting | None


def level_imu_by_gravity(
    time_s: FloatArray, values: AccelGyroRows, variance: FloatArray | None, mounting: ImuMounting | None = None
) -> LevelledImu:
    """Level an IMU by the mean direction of gravity and leave out interpolated samples.

    The yaw rate is the gyroscope's component along the mean specific force: apart from bends the accelerations of a
    drive average out over minutes and gravity remains, so a pitched or rolled mount needs no calibration.

    Args:
        values: Shape (n, 6): accelerometer, gyroscope (forward, left, up).
        variance: Shape (n, 6) or None.
        mounting: Known from other drives; None: found here.
    """
    invented = interpolated_sample_mask(time_s, values)
    known, mounting = mounting, mounting or ImuMounting.from_mean_specific_force(values[:, :3], values[:, 3:])
    # An IMU whose gravity was taken out already, or no accelerometer: trust the mounting.
    up = np.array([0.0, 0.0, 1.0]) if mounting is None else mounting.up_unit_vector_in_imu_axes
    keep = ~invented
    yaw_rate = values[keep, 3:] @ up
    if variance is None:
        variance = np.full(values.shape, np.nan)
    return LevelledImu(
        time_s[keep],
        values[keep, 0],
        yaw_rate,
        _remove_bias_and_yaw_from_pitch_rate(values[keep, 4], yaw_rate)
        if known is None
        else values[keep, 3:] @ known.left_unit_vector_in_imu_axes,
        variance[keep, 0],
        variance[keep, 5],
        int(invented.sum()),
        mounting,
    )


def find_steady_turn_axis(gyro: FloatArray) -> FloatArray | None:
    """Return the axis (3,) about which a vehicle turns all the time, by its turn rates (n, 3), or None.

    The mean turn rate is then larger than its scatter, as on a skid pad. In other drives bends to both sides and
    straight roads make it small.
    """
    if not len(gyro):
        return None
    mean = gyro.mean(axis=0)
    rate = float(np.linalg.norm(mean))
    if rate < MIN_MEAN_TURN_RATE_OF_CIRCLING_RADPS or rate**2 < float(gyro.var(axis=0).sum()):
        return None
    return np.asarray(mean / rate)


def _remove_turning_from_specific_force(force: FloatArray, gyro: FloatArray) -> FloatArray:
    """Return the specific force (n, 3) without acceleration in bends: each axis minus its regression on the yaw rate.

    The acceleration v w to the left has about the mean speed of the bends as its slope over w.
    """
    mean = force.mean(axis=0) if len(force) else np.zeros(3)
    yaw_rate = gyro @ mean / max(float(np.linalg.norm(mean)), 1e-9)
    turning = yaw_rate - np.mean(yaw_rate) if len(yaw_rate) else yaw_rate
    power = float(np.einsum("i,i", turning, turning))
    if not power > 0.0:
        return force
    slope = np.einsum("i,ij->j", turning, force) / power
    return np.asarray(force - yaw_rate[:, None] * slope)


def _remove_bias_and_yaw_from_pitch_rate(left_axis_rate_radps: FloatArray, yaw_rate_radps: FloatArray) -> FloatArray:
    """Return the turn rate about the left axis without its bias and without its share of the yaw rate.

    Pitching of road and body does not correlate with turning, so the part that does is due to a rolled mount. Least
    squares find it without the accelerometer, whose left axis measures acceleration in bends too.
    """
    turning = yaw_rate_radps - np.mean(yaw_rate_radps) if len(yaw_rate_radps) else yaw_rate_radps
    power = float(np.einsum("i,i", turning, turning))
    share = float(np.einsum("i,i", left_axis_rate_radps, turning)) / power if power > 0.0 else 0.0
    rest = left_axis_rate_radps - share * yaw_rate_radps
    return rest - median_of_values(rest) if len(rest) else rest


def interpolated_sample_mask(time_s: FloatArray, values: FloatArray) -> npt.NDArray[np.bool_]:
    """Find runs of samples that lie on a straight line in every axis at once.

    Recorders and data sets fill gaps of an IMU by linear interpolation. Such samples carry no measurement; believed,
    they bend the track. A real sensor's noise never lets six axes be straight over many samples. A signal whose
    curvature is mostly zero (a noise-free simulation) is left alone.

    Args:
        values: Shape (n, k).

    Returns:
        Shape (n,), True where a sample is interpolated.
    """
    n = len(time_s)
    none = np.zeros(n, bool)
    if n < 4 * INTERPOLATED_IMU_WINDOW_SAMPLES:
        return none
    step = np.diff(time_s)
    slope = np.diff(values, axis=0) / np.maximum(step, 1e-9)[:, None]
    curvature = np.abs(np.diff(slope, axis=0))
    usual = np.array([median_of_values(column) for column in curvature.T])
    axes = usual > 0.0
    if not axes.any():
        return none
    straight = none.copy()
    straight[1:-1] = (curvature[:, axes] < MAX_INTERPOLATED_CURVATURE_RATIO * usual[axes]).all(axis=1)
    if straight.mean() > 0.5:
        return none
    near = np.convolve(straight, np.ones(INTERPOLATED_IMU_WINDOW_SAMPLES), mode="same")
    return near > INTERPOLATED_IMU_WINDOW_SAMPLES // 2
