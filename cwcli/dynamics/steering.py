"""The steering angle from vision: kinematic (zhang2011, eq. 10) and corrected for the tyres (eq. 13)."""

from __future__ import annotations

import numpy as np

from cwcli.dynamics.single_track import understeer_gradient_rad_per_mps2
from cwcli.dynamics.vehicle import Vehicle
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

MIN_VISION_STEERING_SPEED_MPS = 1.0
"""Lowest speed with a steering angle from vision, m/s: eq. 10 divides by the speed. Chosen by hand; not fitted."""
MEDIAN_SLOPE_WINDOW_FRAMES = 5
"""Number of frames of the median slope: one wrong frame of five does not change it. Chosen by hand; not fitted."""


def dynamic_to_kinematic_steering_ratio(vehicle: Vehicle, speed_mps: FloatArray | float) -> FloatArray:
    """The factor f(v) = (L + K_mu v^2) / L from kinematic to dynamic steering angle, eq. 13 (corrected).

    It takes the car's `correction_mass_kg`.
    """
    gradient = understeer_gradient_rad_per_mps2(vehicle, vehicle.correction_mass_kg)
    return 1.0 + gradient / vehicle.wheelbase_m * np.asarray(speed_mps, dtype=np.float64) ** 2


def rate_per_s_from_last_two_frames(stamp_ns: Int64Array, values: FloatArray, *, max_gap_s: float = 0.5) -> FloatArray:
    """The difference to the previous frame over the time between them, per second, shape (n,), as in the paper.

    NaN at the first frame, next to a missing value, and after a gap or a stamp that does not increase.
    """
    rate = np.full(len(values), np.nan)
    dt_s = np.diff(stamp_ns) / NS_PER_S
    ok = (dt_s > 0.0) & (dt_s <= max_gap_s)
    rate[1:][ok] = np.diff(values)[ok] / dt_s[ok]
    return rate


def rate_per_s_by_median_slope(
    stamp_ns: Int64Array, values: FloatArray, *, window: int = MEDIAN_SLOPE_WINDOW_FRAMES, max_gap_s: float = 0.5
) -> FloatArray:
    """The median of the slopes of all pairs among the last `window` frames (Theil-Sen); per second, shape (n,).

    One wrong frame of five does not change it, and its noise is about a quarter of the raw difference's. It lags by
    half the window: 0.2 s at 10 Hz. Pairs with a missing value, or with a time between them that is not in (0, window
    max_gap_s], are left out; NaN where fewer than two frames remain.
    """
    n = len(values)
    if not n:
        return np.zeros(0)
    before = np.full(window - 1, np.nan)
    rows = np.lib.stride_tricks.sliding_window_view(np.concatenate([before, values]), window)
    time_s = (stamp_ns - stamp_ns[0]) / NS_PER_S
    times = np.lib.stride_tricks.sliding_window_view(np.concatenate([before, time_s]), window)
    first, second = np.triu_indices(window, 1)
    dt = times[:, second] - times[:, first]
    ok = np.isfinite(dt) & (dt > 0.0) & (dt <= max_gap_s * (second - first))
    slopes = np.where(ok, (rows[:, second] - rows[:, first]) / np.where(ok, dt, 1.0), np.nan)
    known = np.sort(slopes, axis=1)  # NaN last
    count = np.isfinite(slopes).sum(axis=1)
    low, high = np.maximum(count - 1, 0) // 2, count // 2
    at = np.arange(n)
    middle = 0.5 * (known[at, low] + known[at, np.minimum(high, len(first) - 1)])
    return np.where((count > 0) & np.isfinite(values), middle, np.nan)


HEADING_RATE_METHODS = {"raw": rate_per_s_from_last_two_frames, "robust": rate_per_s_by_median_slope}
"""The methods for the rate of the heading deviation by the name that `--steer-rate` takes."""


def steering_angle_from_vision_rad(
    vehicle: Vehicle,
    stamp_ns: Int64Array,
    heading_deviation_rad: FloatArray,
    curvature_1pm: FloatArray,
    speed_mps: FloatArray,
    *,
    rate: str = "raw",
) -> FloatArray:
    """The kinematic steering angle delta_k of eq. 10, left positive: -(L K_L - (de_L/dt) L / v).

    Args:
        stamp_ns: Shape (n,), increasing.
        heading_deviation_rad, curvature_1pm: Shape (n,): e_L and K_L in the paper's signs, NaN where not found.
        speed_mps: Shape (n,).
        rate: A key of `HEADING_RATE_METHODS`: "raw" is the paper's difference.

    Returns:
        Shape (n,), rad; NaN where something is missing or the car is slower than 1 m/s. Multiply by
        `correction` for the dynamic angle delta_D.
    """
    change = HEADING_RATE_METHODS[rate](stamp_ns, heading_deviation_rad)
    moving = speed_mps >= MIN_VISION_STEERING_SPEED_MPS
    over_v = np.where(moving, 1.0 / np.where(moving, speed_mps, 1.0), np.nan)
    return -vehicle.wheelbase_m * (curvature_1pm - change * over_v)
