"""Scale the paths' uncertainty across the path by how far the car went from its earlier predicted paths.

Drivers differ far more than any fixed noise can say. The observed motion, integrated over the horizon from each frame,
is compared with the paths from that frame; at each point of the horizon the errors across the path, in the predicted
sigmas, give one factor, so that 90 % of them lie inside the 90 % band. The error of the observed motion is added.
"""

from __future__ import annotations

import numpy as np

from cwcli.dynamics.samples import LateralTrack
from cwcli.prediction.lateral import dead_reckon_x_y_m_and_heading_rad
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import FloatArray, median_of_values
from cwcli.signals.covariances import xx_xy_yy_covariance_in_turned_axes
from cwcli.signals.normal_distribution import SIGMAS_HOLDING_90_PERCENT
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.units import NS_PER_S

ASSUMED_SIGMA_WEIGHT_IN_HORIZONS = 1.0
"""The assumed sigmas count as much as observed motion of this many horizons. Chosen by hand; not fitted."""
MIN_SIGMA_FACTOR = 0.05
"""Smallest factor on a predicted sigma. Chosen by hand; not fitted."""
MAX_INTERPOLATED_GAP_S = 0.5
"""Longest gap in s across which the observed motion is interpolated. Chosen by hand; not fitted."""
OBSERVER_ERROR_CORRELATION_TIME_S = 0.1
"""The observer's errors are correlated over about this time, s; longer in bends, where the lanes' errors last."""


def scale_covariance_across_path(paths: Paths, track: LateralTrack) -> Paths:
    """Scale the covariance of paths in the body frame across the path, by one factor for each time ahead."""
    factor = sigma_factors_across_path_by_time(paths, track)
    cos, sin = np.cos(paths.heading_rad), np.sin(paths.heading_rad)
    along, _, across = np.moveaxis(
        xx_xy_yy_covariance_in_turned_axes(paths.position_covariance_m2, paths.heading_rad), -1, 0
    )
    across = across * factor**2 + _dead_reckoning_variance_across_path_m2(paths, track)
    covariance = np.stack(
        [cos**2 * along + sin**2 * across, cos * sin * (along - across), sin**2 * along + cos**2 * across], axis=-1
    )
    return Paths(paths.time_s, paths.x_m, paths.y_m, paths.heading_rad, paths.speed_mps, covariance)


def _dead_reckoning_variance_across_path_m2(paths: Paths, track: LateralTrack) -> FloatArray:
    """Variance across the path of the integrated observed motion, by the errors of v_y and gamma, m^2, shape (n, k)."""
    lateral, yaw_rate = (np.nan_to_num(track.covariance[:, k, k])[:, None] for k in (0, 1))
    t, v = paths.time_s, paths.speed_mps
    return np.asarray(2.0 * OBSERVER_ERROR_CORRELATION_TIME_S * (lateral * t + v**2 * yaw_rate * t**3 / 3.0))


def sigma_factors_across_path_by_time(paths: Paths, track: LateralTrack) -> FloatArray:
    """One factor on sigma for each point of the horizon, shape (k,); near 1 where the record is short."""
    x, y, heading = dead_reckon_x_y_m_and_heading_rad(track)
    known = np.asarray(np.isfinite(track.state[:, 0]))
    pose = np.where(known[:, None], np.column_stack([x, y]), np.nan)
    cos, sin = np.cos(heading), np.sin(heading)
    factors = np.ones(len(paths.time_s))
    horizon_s = float(paths.time_s[-1])
    period_s = median_of_values(np.diff(track.stamp_ns)) / NS_PER_S if len(track) > 1 else horizon_s
    for k, time_s in enumerate(paths.time_s.tolist()):
        if k == 0:
            continue
        later = interpolate_signal_at_times(
            track.stamp_ns, pose, track.stamp_ns + round(time_s * NS_PER_S), max_gap_s=MAX_INTERPOLATED_GAP_S
        )
        dx, dy = later[:, 0] - x, later[:, 1] - y
        ex, ey = cos * dx + sin * dy - paths.x_m[:, k], -sin * dx + cos * dy - paths.y_m[:, k]
        c, s = np.cos(paths.heading_rad[:, k]), np.sin(paths.heading_rad[:, k])
        across = xx_xy_yy_covariance_in_turned_axes(paths.position_covariance_m2[:, k], paths.heading_rad[:, k])[:, 2]
        sigma = np.sqrt(np.maximum(across, 1e-12))
        z = np.abs(-s * ex + c * ey) / sigma
        z = z[np.isfinite(z)]
        if not len(z):
            continue
        own = max(float(np.quantile(z, 0.9)) / SIGMAS_HOLDING_90_PERCENT, MIN_SIGMA_FACTOR)
        weight = len(z) * period_s / horizon_s
        factors[k] = (weight * own + ASSUMED_SIGMA_WEIGHT_IN_HORIZONS) / (weight + ASSUMED_SIGMA_WEIGHT_IN_HORIZONS)
    return factors
