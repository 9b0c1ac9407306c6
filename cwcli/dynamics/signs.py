"""The check that a yaw rate or steering angle has the sign that the lane in the camera image says."""

from __future__ import annotations

import numpy as np

from cwcli.dynamics.samples import LaneSamples, ScalarSamples
from cwcli.dynamics.steering import rate_per_s_by_median_slope
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.resample import interpolate_signal_at_times

MAX_CORRELATION_OF_REVERSED_SENSOR = -0.5
"""Correlation with the turning of the lane below which a sensor's sign is taken as reversed. Chosen by hand; not
fitted."""
MIN_FRAMES_TO_COMPARE_SIGNS = 50
"""Smallest number of frames with both values at which signs are compared. Chosen by hand; not fitted."""
MIN_YAW_RATE_SPREAD_TO_COMPARE_SIGNS_RADPS = 0.01
"""Smallest standard deviation of the yaw rate from vision at which signs are compared, rad/s: below it the car hardly
turns. Chosen by hand; not fitted."""


def opposite_sign_note(name: str) -> str:
    """The note for the user that a sensor with a reversed sign is not used."""
    return f"the {name} turns the other way than the lane: not used; check its sign or mounting"


def yaw_rate_from_vision_radps(lanes: LaneSamples, speed_mps: FloatArray) -> FloatArray:
    """A coarse yaw rate from the lane, shape (n,), rad/s: gamma = de_L/dt - v K_L (eq. 20 in body signs)."""
    change = rate_per_s_by_median_slope(
        np.asarray(lanes.stamp_ns, np.int64), np.asarray(lanes.heading_deviation_rad, np.float64)
    )
    return change - speed_mps * np.asarray(lanes.curvature_1pm, np.float64)


def is_sign_opposite(samples: ScalarSamples, stamp_ns: Int64Array, vision: FloatArray) -> bool:
    """Whether a sensor's sign is opposite to that of the turns in the camera image; False without clear turns."""
    sensor = interpolate_signal_at_times(samples.stamp_ns, samples.values, stamp_ns, max_gap_s=0.5)
    both = np.isfinite(sensor) & np.isfinite(vision)
    if (
        np.count_nonzero(both) < MIN_FRAMES_TO_COMPARE_SIGNS
        or np.std(vision[both]) < MIN_YAW_RATE_SPREAD_TO_COMPARE_SIGNS_RADPS
    ):
        return False
    a, b = sensor[both], vision[both]
    scale = float(np.sqrt(np.mean(a**2) * np.mean(b**2)))
    return scale > 0.0 and float(np.mean(a * b)) / scale < MAX_CORRELATION_OF_REVERSED_SENSOR
