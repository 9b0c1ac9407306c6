"""Whether a sensor counts turns the other way than the lane that the camera sees: a reversed sign or mounting."""

from __future__ import annotations

import numpy as np

from cwcli.dynamics.samples import LaneSamples, Samples
from cwcli.dynamics.steering import robust_rate
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.resample import resample

OPPOSITE = -0.5
MIN_FRAMES = 50
MIN_TURNING_RADPS = 0.01


def against_note(name: str) -> str:
    """The note for the user."""
    return f"the {name} turns the other way than the lane: not used; check its sign or mounting"


def yaw_rate_from_vision(lanes: LaneSamples, v: FloatArray) -> FloatArray:
    """gamma = de_L/dt - v K_L (eq. 20 in body signs), coarse; shape (n,)."""
    change = robust_rate(np.asarray(lanes.stamp_ns, np.int64), np.asarray(lanes.heading_deviation_rad, np.float64))
    return change - v * np.asarray(lanes.curvature_1pm, np.float64)


def runs_against(samples: Samples, stamp_ns: Int64Array, vision: FloatArray) -> bool:
    """Whether a sensor turns the other way than the camera sees, in what is clearly a turn."""
    sensor = resample(samples.stamp_ns, samples.values, stamp_ns, max_gap_s=0.5)
    both = np.isfinite(sensor) & np.isfinite(vision)
    if np.count_nonzero(both) < MIN_FRAMES or np.std(vision[both]) < MIN_TURNING_RADPS:
        return False
    a, b = sensor[both], vision[both]
    scale = float(np.sqrt(np.mean(a**2) * np.mean(b**2)))
    return scale > 0.0 and float(np.mean(a * b)) / scale < OPPOSITE
