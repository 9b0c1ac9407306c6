"""From a mounted IMU to a forward acceleration and a yaw rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import FloatArray

INTERPOLATED_RUN = 15  # samples that are looked at together
INTERPOLATED_PART = 0.02  # of the usual curvature of the signal


@dataclass(frozen=True)
class LevelledImu:
    """What the filter takes from an IMU.

    Attributes:
        time_s: Shape (n,).
        accel_mps2: Shape (n,): along the body's forward axis, gravity through a pitched mount still in it (it is
            the bias that the filter finds).
        yaw_rate_radps: Shape (n,): about the vertical.
        accel_variance, yaw_rate_variance: Shape (n,), NaN where the message does not say.
        n_interpolated: Samples left out because they were interpolated before the log was made.
    """

    time_s: FloatArray
    accel_mps2: FloatArray
    yaw_rate_radps: FloatArray
    accel_variance: FloatArray
    yaw_rate_variance: FloatArray
    n_interpolated: int


def level_imu(time_s: FloatArray, values: FloatArray, variance: FloatArray | None) -> LevelledImu:
    """Level an IMU by the mean direction of gravity and leave out invented samples.

    The yaw rate is the gyroscope's component along the mean specific force: over minutes the accelerations of a drive
    average out and gravity remains, so a mount that is pitched or rolled needs no calibration.

    Args:
        time_s: Shape (n,), sorted.
        values: Shape (n, 6): accelerometer, gyroscope (forward, left, up).
        variance: Shape (n, 6) or None.
    """
    invented = interpolated_samples(time_s, values)
    up = values[:, :3].mean(axis=0) if len(values) else np.zeros(3)
    norm = float(np.linalg.norm(up))
    # An IMU whose gravity was taken out already, or no accelerometer: trust the mounting.
    up = up / norm if norm > 5.0 and up[2] > 0.5 * norm else np.array([0.0, 0.0, 1.0])
    keep = ~invented
    if variance is None:
        variance = np.full(values.shape, np.nan)
    return LevelledImu(
        time_s[keep],
        values[keep, 0],
        values[keep, 3:] @ up,
        variance[keep, 0],
        variance[keep, 5],
        int(invented.sum()),
    )


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
