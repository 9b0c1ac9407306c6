"""The boundaries of a lane along a path, and the time at which a tyre reaches one of them."""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.signals.lane_geometry import y_direction_curvature_of_arcs_at_distance


def boundary_y_and_direction_at_distances(
    line: FloatArray, ahead_m: FloatArray, change_1pm2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """y (m) and direction (rad) of each boundary at distances from the camera, shape (n, k); NaN where it has ended.

    Args:
        line: Shape (n, 3).
        ahead_m: Shape (n, k).
        change_1pm2: Shape (n,).
    """
    curves = y_direction_curvature_of_arcs_at_distance(line[:, None], ahead_m, change_1pm2[:, None])
    y0, slope, curvature = (line[:, k, None] for k in range(3))
    is_behind = ahead_m <= 0.0  # a tyre beside the camera, or a little behind it
    y = np.where(is_behind, y0 + (slope + 0.5 * curvature * ahead_m) * ahead_m, curves[..., 0])
    return y, np.where(is_behind, np.arctan(slope + curvature * ahead_m), curves[..., 1])


def last_known_gap_m(gap_m: FloatArray) -> FloatArray:
    """The last finite gap of each path, m, (n,): boundaries of tight bends end before long paths do."""
    last = gap_m.shape[1] - 1 - np.argmax(np.isfinite(gap_m[:, ::-1]), axis=1)
    return np.asarray(gap_m[np.arange(len(gap_m)), last])


def first_crossing_time_s(t: FloatArray, gap_m: FloatArray) -> FloatArray:
    """Time (s) at which the gap first becomes zero, (n,), linear between points; inf: never, NaN: not known.

    Where the gap at the point before is not known, it is the time of the point itself.
    """
    over = gap_m <= 0.0
    at = np.argmax(over, axis=1)
    rows = np.arange(len(gap_m))
    before = np.maximum(at - 1, 0)
    drop = gap_m[rows, before] - gap_m[rows, at]
    share = gap_m[rows, before] / np.where(drop > 0.0, drop, 1.0)
    crossing = t[before] + share * (t[at] - t[before])
    crossing = np.where(np.isnan(gap_m[rows, before]), t[at], crossing)
    crossing = np.where(at == 0, 0.0, crossing)
    crossing = np.where(over.any(axis=1), crossing, np.inf)
    return np.where(np.isfinite(gap_m[:, 0]), crossing, np.nan)
