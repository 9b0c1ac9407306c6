"""From a mounted IMU to a forward acceleration and a yaw rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import FloatArray

LEAST_GRAVITY_MPS2 = 5.0
LEVEL_BLOCKS = 10
INTERPOLATED_RUN = 15  # samples that are looked at together
INTERPOLATED_PART = 0.02  # of the usual curvature of the signal


@dataclass(frozen=True)
class ImuMounting:
    """How an IMU is turned against the vertical.

    Attributes:
        nose_up_rad: Its forward axis above the horizon.
        left_up_rad: Its left axis, about the forward one.
        sigma_rad: One sigma of each, by the scatter of the mean specific force over LEVEL_BLOCKS parts of the log.
    """

    nose_up_rad: float
    left_up_rad: float
    sigma_rad: float = float("nan")

    @classmethod
    def of(cls, force: FloatArray, gyro: FloatArray) -> ImuMounting | None:
        """By the mean direction of the specific force (n, 3); None where there is no gravity in it, or not upward.

        What goes with the turn rate (n, 3) about that direction is a bend's acceleration, and taken off first: a drive
        that turns to one side more than to the other would seem rolled.
        """
        force = _without_bends(force, gyro)
        up = force.mean(axis=0) if len(force) else np.zeros(3)
        norm = float(np.linalg.norm(up))
        if not (norm > LEAST_GRAVITY_MPS2 and up[2] > 0.5 * norm):
            return None
        parts = [part.mean(axis=0)[:2] / norm for part in np.array_split(force, LEVEL_BLOCKS) if len(part)]
        sigma_rad = float(np.mean(np.std(parts, axis=0, ddof=1))) / len(parts) ** 0.5 if len(parts) > 1 else np.nan
        return cls(float(np.arcsin(up[0] / norm)), float(np.arctan2(up[1], up[2])), sigma_rad)

    @property
    def up(self) -> FloatArray:
        """The vertical in the IMU's axes, (3,)."""
        level = np.cos(self.nose_up_rad)
        return np.array([np.sin(self.nose_up_rad), level * np.sin(self.left_up_rad), level * np.cos(self.left_up_rad)])

    @property
    def left(self) -> FloatArray:
        """The level left axis in the IMU's axes, (3,)."""
        return np.array([0.0, np.cos(self.left_up_rad), -np.sin(self.left_up_rad)])


@dataclass(frozen=True)
class LevelledImu:
    """What the filter takes from an IMU.

    Attributes:
        time_s: Shape (n,).
        accel_mps2: Shape (n,): along the body's forward axis, gravity through a pitched mount still in it (it is
            the bias that the filter finds).
        yaw_rate_radps: Shape (n,): about the vertical.
        pitch_rate_radps: Shape (n,): about the left axis, nose down positive; see `_pitch_rate`.
        accel_variance, yaw_rate_variance: Shape (n,), NaN where the message does not say.
        n_interpolated: Samples left out because they were interpolated before the log was made.
        mounting: What it was levelled by; None: the axes as they are.
    """

    time_s: FloatArray
    accel_mps2: FloatArray
    yaw_rate_radps: FloatArray
    pitch_rate_radps: FloatArray
    accel_variance: FloatArray
    yaw_rate_variance: FloatArray
    n_interpolated: int
    mounting: ImuMounting | None


def level_imu(
    time_s: FloatArray, values: FloatArray, variance: FloatArray | None, mounting: ImuMounting | None = None
) -> LevelledImu:
    """Level an IMU by the mean direction of gravity and leave out invented samples.

    The yaw rate is the gyroscope's component along the mean specific force: without what goes with the yaw rate the
    accelerations of a drive average out over minutes and gravity remains, so a mount that is pitched or rolled needs no
    calibration.

    Args:
        time_s: Shape (n,), sorted.
        values: Shape (n, 6): accelerometer, gyroscope (forward, left, up).
        variance: Shape (n, 6) or None.
        mounting: Known from other drives; None: found here.
    """
    invented = interpolated_samples(time_s, values)
    known, mounting = mounting, mounting or ImuMounting.of(values[:, :3], values[:, 3:])
    # An IMU whose gravity was taken out already, or no accelerometer: trust the mounting.
    up = np.array([0.0, 0.0, 1.0]) if mounting is None else mounting.up
    keep = ~invented
    yaw_rate = values[keep, 3:] @ up
    if variance is None:
        variance = np.full(values.shape, np.nan)
    return LevelledImu(
        time_s[keep],
        values[keep, 0],
        yaw_rate,
        _pitch_rate(values[keep, 4], yaw_rate) if known is None else values[keep, 3:] @ known.left,
        variance[keep, 0],
        variance[keep, 5],
        int(invented.sum()),
        mounting,
    )


def _without_bends(force: FloatArray, gyro: FloatArray) -> FloatArray:
    """The specific force (n, 3) as it would be without turning: each axis less its slope over the yaw rate, times that.

    v w to the left has about the mean speed of the bends as its slope over w.
    """
    mean = force.mean(axis=0) if len(force) else np.zeros(3)
    yaw_rate = gyro @ mean / max(float(np.linalg.norm(mean)), 1e-9)
    turning = yaw_rate - np.mean(yaw_rate) if len(yaw_rate) else yaw_rate
    power = float(np.einsum("i,i", turning, turning))
    if not power > 0.0:
        return force
    slope = np.einsum("i,ij->j", turning, force) / power
    return np.asarray(force - yaw_rate[:, None] * slope)


def _pitch_rate(left: FloatArray, yaw_rate: FloatArray) -> FloatArray:
    """The left axis' turn rate without its bias and without what it has of the yaw rate.

    A road's and a body's pitching come and go whatever the car's turning, so what goes with the yaw rate is a mount
    that is rolled: least squares find it without the accelerometer, whose left axis has the bends' accelerations.

    Args:
        left, yaw_rate: Shape (n,), rad/s.
    """
    turning = yaw_rate - np.mean(yaw_rate) if len(yaw_rate) else yaw_rate
    power = float(np.einsum("i,i", turning, turning))
    share = float(np.einsum("i,i", left, turning)) / power if power > 0.0 else 0.0
    rest = left - share * yaw_rate
    return rest - np.median(rest) if len(rest) else rest


def interpolated_samples(time_s: FloatArray, values: FloatArray) -> npt.NDArray[np.bool_]:
    """Find runs of samples that lie on a straight line in every axis at once.

    Recorders and data sets fill gaps of an IMU by linear interpolation. Such samples carry no measurement; believed,
    they bend the track. A real sensor's noise never lets six axes be straight over many samples. A signal whose
    curvature is mostly zero (a noise-free simulation) is left alone.

    Args:
        time_s: Shape (n,), sorted.
        values: Shape (n, k).

    Returns:
        Shape (n,), True where a sample is interpolated.
    """
    n = len(time_s)
    none = np.zeros(n, bool)
    if n < 4 * INTERPOLATED_RUN:
        return none
    step = np.diff(time_s)
    slope = np.diff(values, axis=0) / np.maximum(step, 1e-9)[:, None]
    curvature = np.abs(np.diff(slope, axis=0))
    usual = np.median(curvature, axis=0)
    axes = usual > 0.0
    if not axes.any():
        return none
    straight = none.copy()
    straight[1:-1] = (curvature[:, axes] < INTERPOLATED_PART * usual[axes]).all(axis=1)
    if straight.mean() > 0.5:
        return none
    near = np.convolve(straight, np.ones(INTERPOLATED_RUN), mode="same")
    return near > INTERPOLATED_RUN // 2
