"""Errors of predicted points against the actual positions at each horizon."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.kernels.paths import on_track
from cwcli.lazy_dataclass import dataclass
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import (
    BoolArray,
    EastNorthRows,
    FloatArray,
    Int64Array,
    select_table_rows,
    sort_distinct_values,
)
from cwcli.signals.units import NS_PER_S

ELLIPSE_50_SQUARED_RADIUS = 2.0 * np.log(2.0)
"""Squared Mahalanobis distance at the border of the 50 % ellipse: the chi-square quantile, -2 ln(1 - 0.5)."""
ELLIPSE_90_SQUARED_RADIUS = 2.0 * np.log(10.0)
"""Squared Mahalanobis distance at the border of the 90 % ellipse: the chi-square quantile, -2 ln(1 - 0.9)."""

ActualPositions = tuple[FloatArray, BoolArray]
"""Actual positions of n starts at h horizons, (n, h, 2), NaN where unknown; and where they are known, (n, h)."""


@dataclass(frozen=True)
class HorizonErrors:
    """Errors of n starts at h horizons: actual minus predicted.

    Attributes:
        horizon_s: Shape (h,).
        is_known: Shape (n, h): the track holds the moment, and not inside a gap. The rest is NaN elsewhere.
        distance_m: Shape (n, h).
        along_m, cross_m: Shape (n, h): along the predicted heading (positive: the car got farther) and to its left.
        mahalanobis2: Shape (n, h): squared, under the predicted position covariance: for the 90 % ellipse.
        core_mahalanobis2: Shape (n, h): the same with the paths' `core_factor`: for the 50 % ellipse.
    """

    horizon_s: FloatArray
    is_known: BoolArray
    distance_m: FloatArray
    along_m: FloatArray
    cross_m: FloatArray
    mahalanobis2: FloatArray
    core_mahalanobis2: FloatArray

    def select_starts(self, rows: slice) -> HorizonErrors:
        """The errors of some starts."""
        return select_table_rows(self, rows, shared=("horizon_s",))


def horizon_errors(
    paths: Paths,
    start_stamp_ns: Int64Array,
    track_stamp_ns: Int64Array,
    track_xy: EastNorthRows,
    horizons_s: Sequence[float],
    max_gap_s: float = 0.5,
    actual: ActualPositions | None = None,
) -> HorizonErrors:
    """Compare predicted points with a track.

    Args:
        track_stamp_ns: Shape (m,), strictly increasing.
        track_xy: Shape (m, 2), metres, the same map.
        horizons_s: Times from the start; each within the paths.
        max_gap_s: Between track points farther apart than this nothing is interpolated.
        actual: `actual_positions` of the same starts, track and horizons; None: they are looked up.

    Raises:
        ValueError: A horizon outside the paths, or shapes that don't fit.
    """
    if len(start_stamp_ns) != len(paths) or track_xy.shape != (len(track_stamp_ns), 2):
        raise ValueError("starts and paths, or track stamps and positions, differ in length")
    horizon = np.asarray(horizons_s, dtype=np.float64)
    if len(horizon) and (horizon.min() < 0.0 or horizon.max() > paths.time_s[-1] + 1e-9):
        raise ValueError(f"a horizon is outside the paths' 0 to {paths.time_s[-1]:g} s")
    if actual is None:
        actual = actual_positions(start_stamp_ns, track_stamp_ns, track_xy, horizons_s, max_gap_s)
    found, is_known = actual
    predicted = _interpolate_at_horizons(paths, horizon)
    error_x, error_y = found[..., 0] - predicted["x"], found[..., 1] - predicted["y"]
    cosine, sine = np.cos(predicted["heading"]), np.sin(predicted["heading"])
    xx, xy, yy = (predicted[name] for name in ("xx", "xy", "yy"))
    squared = core_squared = _squared_mahalanobis(error_x, error_y, xx, xy, yy)
    if paths.core_factor is not None:
        factor = predicted["core"]
        remaining_share = np.maximum(1.0 - factor, 0.0)
        start = np.moveaxis(paths.position_covariance_m2[:, :1], -1, 0)
        core = (factor * now + remaining_share * then for now, then in zip((xx, xy, yy), start, strict=True))
        core_squared = _squared_mahalanobis(error_x, error_y, *core)
    return HorizonErrors(
        horizon_s=horizon,
        is_known=is_known & np.isfinite(error_x),
        distance_m=np.hypot(error_x, error_y),
        along_m=error_x * cosine + error_y * sine,
        cross_m=-error_x * sine + error_y * cosine,
        mahalanobis2=squared,
        core_mahalanobis2=core_squared,
    )


def _squared_mahalanobis(
    error_x: FloatArray,
    error_y: FloatArray,
    covariance_xx: FloatArray,
    covariance_xy: FloatArray,
    covariance_yy: FloatArray,
) -> FloatArray:
    """Squared Mahalanobis distances of errors (x, y) under the covariance xx, xy, yy, elementwise."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(
            (covariance_yy * error_x**2 - 2.0 * covariance_xy * error_x * error_y + covariance_xx * error_y**2)
            / (covariance_xx * covariance_yy - covariance_xy**2)
        )


def actual_positions(
    start_stamp_ns: Int64Array,
    track_stamp_ns: Int64Array,
    track_xy: EastNorthRows,
    horizons_s: Sequence[float],
    max_gap_s: float = 0.5,
) -> ActualPositions:
    """Look up where the track is at each horizon of each start; the arguments are those of `horizon_errors`.

    Returns:
        Positions of shape (n, h, 2), NaN where unknown; and where they are known, (n, h).
    """
    horizon = np.asarray(horizons_s, dtype=np.float64)
    at_ns = start_stamp_ns[:, None] + np.rint(horizon * NS_PER_S).astype(np.int64)[None, :]
    return _track_xy_and_is_known_at(at_ns, track_stamp_ns, track_xy, max_gap_s)


def repeat_actual_positions_for_path_sets(actual: ActualPositions, sets: int) -> ActualPositions:
    """Repeat actual positions (n, h, 2) for several sets of paths from the same starts, one below the other."""
    found, is_known = actual
    return np.tile(found, (sets, 1, 1)), np.tile(is_known, (sets, 1))


def _track_xy_and_is_known_at(
    at_ns: Int64Array, stamp_ns: Int64Array, track_xy_m: EastNorthRows, max_gap_s: float
) -> tuple[FloatArray, BoolArray]:
    """Track position at the given times (n, h), shape (n, h, 2), NaN where unknown; and where it is known."""
    if len(stamp_ns) < 2:
        return np.full((*at_ns.shape, 2), np.nan), np.zeros(at_ns.shape, dtype=bool)
    return on_track(at_ns, stamp_ns, track_xy_m, max_gap_s * NS_PER_S)


def indices_of_needed_points(time_s: FloatArray, horizons_s: Sequence[float]) -> npt.NDArray[np.intp]:
    """Increasing indices of the points that errors at the horizons depend on, and of the first and last point."""
    after = _index_of_first_point_at_or_after_each_horizon(time_s, np.asarray(horizons_s, dtype=np.float64))
    return sort_distinct_values(np.concatenate([[0], after - 1, after, [len(time_s) - 1]]))


def _index_of_first_point_at_or_after_each_horizon(time_s: FloatArray, horizon_s: FloatArray) -> npt.NDArray[np.intp]:
    """Index of the first point at or after each horizon, from 1 to the last point, (h,)."""
    return np.clip(np.searchsorted(time_s, horizon_s - 1e-9), 1, len(time_s) - 1)


def _interpolate_at_horizons(paths: Paths, horizon_s: FloatArray) -> dict[str, FloatArray]:
    """Point, heading and covariance of each path at the horizons, linear between points, (n, h) each."""
    after = _index_of_first_point_at_or_after_each_horizon(paths.time_s, horizon_s)
    share = (horizon_s - paths.time_s[after - 1]) / (paths.time_s[after] - paths.time_s[after - 1])

    def interpolate_paths(values: FloatArray) -> FloatArray:
        return np.asarray(values[:, after - 1] + share * (values[:, after] - values[:, after - 1]))

    covariance = paths.position_covariance_m2
    core = {} if paths.core_factor is None else {"core": interpolate_paths(paths.core_factor)}
    return core | {
        "x": interpolate_paths(paths.x_m),
        "y": interpolate_paths(paths.y_m),
        "heading": interpolate_paths(paths.heading_rad),
        "xx": interpolate_paths(covariance[..., 0]),
        "xy": interpolate_paths(covariance[..., 1]),
        "yy": interpolate_paths(covariance[..., 2]),
    }
