"""Interpolation of the speed at the times of frames and sensors."""

from __future__ import annotations

import numpy as np

from cwcli.dynamics.samples import ScalarSamples
from cwcli.errors import MissingSignalError
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.resample import resample


def speed_at_times_mps(speed: ScalarSamples, at_ns: Int64Array, max_gap_s: float) -> FloatArray:
    """Speed at the given times, shape (m,), m/s.

    It is linear between samples and that of the nearest one outside of them; NaN where they are farther than
    `max_gap_s`.

    Raises:
        MissingSignalError: There is no finite sample at all.
    """
    if not np.isfinite(speed.values).any():
        raise MissingSignalError(
            "no speed: the observer's model needs it", hint="bind a speed channel with `--topic ego_speed=/name`"
        )
    between = resample(speed.stamp_ns, speed.values, at_ns, max_gap_s=max_gap_s)
    kept = resample(speed.stamp_ns, speed.values, at_ns, max_gap_s=max_gap_s, method="nearest")
    return np.where(np.isfinite(between), between, kept)
