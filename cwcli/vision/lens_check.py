"""Whether a lens fits what a drive shows: how far the vanishing point moves as the car turns, and how bends look.

While the car turns by d_psi and drives ds beside a lane of curvature K (right positive), the point in which the lane
vanishes moves by du = fx (d_psi + K ds), and the lane is seen with a bend of k = K fx fy H / 2 (`lane_model`). If the
true focal lengths are s times the assumed ones, du = s fx d_psi + 2 k ds / (s fy H) fits best at that s. H is the
mounting's height, or follows from the lane's width where the mounting is not known.
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.resample import Series
from cwcli.signals.units import NS_PER_S
from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.fit_columns import FitColumns
from cwcli.vision.lane_model import LANE_WIDTH_MEAN_AND_SIGMA_M
from cwcli.vision.method import LaneState

WINDOW_S, MAX_GAP_IN_WINDOW_S = 1.0, 0.25
"""Length of the windows of a drive that are compared, and the longest gap between two frames in one, in seconds. Chosen
by hand; not fitted."""
MIN_TIME_OF_LANE_IN_SIGHT_S = 20.0
"""Least time with a lane in sight from which the lens is judged, in seconds: a few bends or lane changes."""
MAX_WINDOWS = 2000
"""Greatest number of windows that are compared. Chosen by hand: it bounds the time."""
FOCAL_LENGTH_SCALES = np.exp(np.linspace(-0.9, 0.9, 91))
"""Ratios of the true to the assumed focal length that are tried, in steps of 2 %; at either end nothing is found."""
SHARE_OF_WINDOWS_THAT_COUNT = 0.9
"""Share of the windows that counts, those with the least residuals: in the others the lane was another one."""
MIN_LOG_OF_SCALE, MIN_RESIDUAL_RATIO = 0.2, 1.35
"""A lens is contradicted if another one differs by at least this logarithm of the focal length (22 %), and leaves
residuals that are smaller by this factor. Chosen on 6 rendered drives with another lens than the assumed one and on 8
with the same."""


def field_of_view_that_contradicts_camera_rad(
    fits: FitColumns, stamp_ns: Int64Array, speed_mps: Series, yaw_rate_radps: Series, camera: Camera
) -> float:
    """The horizontal field of view that fits a drive, where it contradicts the camera's; else NaN.

    Args:
        fits: Of n frames of one size.
        stamp_ns: Shape (n,).
        speed_mps, yaw_rate_radps: The ego's motion.
        camera: In the pixels of the searched image.
    """
    known_ns = np.array([speed_mps.stamp_ns[[0, -1]], yaw_rate_radps.stamp_ns[[0, -1]]])
    is_seen = fits.found.all(axis=1) & (fits.state == LaneState.FOUND) & np.isfinite(fits.roads).all(axis=(1, 2))
    rows = np.flatnonzero(is_seen & (stamp_ns >= known_ns[:, 0].max()) & (stamp_ns <= known_ns[:, 1].min()))
    time_s = (stamp_ns[rows] - stamp_ns[0]) / NS_PER_S
    gaps_s = np.diff(time_s)
    is_gap = gaps_s >= MAX_GAP_IN_WINDOW_S
    if (gaps_s <= 0.0).any() or float(gaps_s[~is_gap].sum()) < MIN_TIME_OF_LANE_IN_SIGHT_S:
        return math.nan
    roads = fits.roads[rows]
    height_m = camera.mounting.height_m
    if camera.mounting == Mounting():
        height_m = LANE_WIDTH_MEAN_AND_SIGMA_M[0] / float(np.median(roads[:, 1, 1] - roads[:, 0, 1]))
        height_m *= camera.fx / camera.fy
    at_mps = np.interp(stamp_ns[rows], speed_mps.stamp_ns, speed_mps.values)
    yaw_s = (yaw_rate_radps.stamp_ns - stamp_ns[0]) / NS_PER_S
    turned_px = camera.fx * np.interp(time_s, yaw_s, _integral_over_time(yaw_rate_radps.values, yaw_s))
    bent_px = _integral_over_time(2.0 * roads[:, :, 2].mean(axis=1) * at_mps / (camera.fy * height_m), time_s)
    n_gaps = np.concatenate([[0], np.cumsum(is_gap)])
    end = np.searchsorted(time_s, time_s + WINDOW_S)
    start = np.flatnonzero((end < len(rows)) & (n_gaps[np.minimum(end, len(rows) - 1)] == n_gaps))
    if not len(start):
        return math.nan
    start = start[:: len(start) // MAX_WINDOWS + 1]
    moved, by_turn, by_bend = (
        each[end[start]] - each[start] for each in (roads[:, :, 0].mean(axis=1), turned_px, bent_px)
    )
    residuals = np.array([_residual_px(moved - by_turn * s - by_bend / s) for s in FOCAL_LENGTH_SCALES])
    best = int(residuals.argmin())
    is_inside = 0 < best < len(FOCAL_LENGTH_SCALES) - 1
    is_another = abs(math.log(FOCAL_LENGTH_SCALES[best])) >= MIN_LOG_OF_SCALE
    if not (
        is_inside and is_another and _residual_px(moved - by_turn - by_bend) > MIN_RESIDUAL_RATIO * residuals[best]
    ):
        return math.nan
    return 2.0 * math.atan(0.5 * camera.width_px / (camera.fx * float(FOCAL_LENGTH_SCALES[best])))


def _integral_over_time(values: FloatArray, time_s: FloatArray) -> FloatArray:
    """Integral of values (n,) from the first time on, by trapezoids, shape (n,)."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time_s))])


def _residual_px(differences_px: FloatArray) -> float:
    """Root mean square of the smaller differences from their median, which a biased gyroscope moves."""
    distance_px = np.sort(np.abs(differences_px - np.median(differences_px)))
    return float(np.sqrt(np.mean(distance_px[: max(1, int(SHARE_OF_WINDOWS_THAT_COUNT * len(distance_px)))] ** 2)))
