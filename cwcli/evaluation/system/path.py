"""Errors of another system's paths of the ego against its later track.

A planner's path is a plan and no prediction of a human driver: its errors are meaningful only where the planner drove
the car.
"""

from __future__ import annotations

import numpy as np

from cwcli.errors import DataError
from cwcli.evaluation.evaluation_context import EvaluationContext
from cwcli.evaluation.knowledge import HINDSIGHT, OTHER_SYSTEM, TRUTH, comparison_label
from cwcli.evaluation.predict import (
    ERROR_HORIZONS_S,
    MAX_INTERPOLATED_TRACK_GAP_S,
    add_errors_at_horizons,
    path_errors_against_track,
)
from cwcli.evaluation.reference import EgoMotion, find_reference_motion
from cwcli.evaluation.system.placing import FramePlacement, fit_frame_placement
from cwcli.evaluation.system.reading import read_signal_of_other_system
from cwcli.prediction.paths import Paths
from cwcli.signals.builders.path import PathSignal
from cwcli.signals.columns import EastNorthRows, FloatArray
from cwcli.signals.role import Role

PATH_STEP_S = 0.1
"""Step of the resampled paths, s. Chosen by hand; not fitted."""
VEHICLE_FRAMES = frozenset({"base_link", "base_footprint", "ego_vehicle", "vehicle"})
"""Frames whose origin is the car and whose x axis points ahead."""
MIN_PATH_SPEED_MPS = 0.1
"""Least speed along a path, m/s, so that its duration stays finite; below it the car stands at the path's end. Chosen
by hand; not fitted."""


def add_planned_path_errors_at_horizons(
    context: EvaluationContext, topic: str, placed_frame: tuple[str, FramePlacement] | None
) -> None:
    """Add the errors of another system's paths at the horizons.

    Args:
        placed_frame: Name and placement of a frame of the same system; None: unknown.

    Raises:
        UsageError: Its messages are no paths.
        MissingSignalError: There is nothing to compare them with.
        DataError: None of them can be used, or their times are not those of the states.
    """
    reference = find_reference_motion(context)
    signal = read_signal_of_other_system(context, "ego_path", topic, (Role.PLANNED_PATH,))
    assert isinstance(signal, PathSignal)
    ego = reference.motion.interpolate_motion(reference.stamp_ns, signal.stamp_ns)
    rows = np.flatnonzero(np.isfinite(ego.xy_m).all(axis=1))
    placing = _find_frame_placement(context, signal, ego, placed_frame)
    if not len(rows) or (placing is None and signal.frame_id not in VEHICLE_FRAMES):
        raise DataError("its paths are of no time at which the ego is known", where=f"{context.log.name}: {topic}")
    n_timeless = sum(bool(np.isnan(signal.time_s[_path_point_slice(signal, k)]).any()) for k in rows.tolist())
    n_slow = 0
    time_s = np.arange(round(ERROR_HORIZONS_S[-1] / PATH_STEP_S) + 1, dtype=np.float64) * np.float64(PATH_STEP_S)
    xy_m: FloatArray = np.full((len(rows), len(time_s), 2), np.nan)
    for at, k in enumerate(rows.tolist()):
        points = _path_point_slice(signal, k)
        own = np.column_stack([signal.x_m[points], signal.y_m[points]])
        if placing is None:
            points_in_map_m = FramePlacement(float(ego.heading_rad[k]), np.zeros(2), ego.xy_m[k]).points_in_map_m(own)
        else:
            points_in_map_m = placing.points_in_map_m(own)
        speed_mps = signal.speed_mps[points]
        at_s = signal.time_s[points]
        if np.isnan(at_s).any():
            n_slow += bool(np.isnan(speed_mps).any())
            at_s = _times_along_path_s(
                points_in_map_m, np.where(np.isfinite(speed_mps), speed_mps, ego.speed_mps[k]), ego.xy_m[k]
            )
        xy_m[at] = _interpolate_path_points(
            time_s, at_s, points_in_map_m, is_standing=bool(speed_mps[-1] < MIN_PATH_SPEED_MPS)
        )
    if n_timeless:
        how = "the car's own speed" if n_slow else "the speeds they give"
        context.notes.append(f"{topic}: {n_timeless} of {len(rows)} paths have no times: computed from {how}")
    stamp_ns = signal.stamp_ns[rows]
    paths = _paths_without_covariance(time_s, xy_m)
    with context.headline.label_rows_with_states(comparison_label(OTHER_SYSTEM, HINDSIGHT)):
        states = context.ego.states
        assert states is not None  # or the reference is missing, or a truth that needs them
        errors = path_errors_against_track(
            paths, stamp_ns, states.stamp_ns, states.state[:, :2], MAX_INTERPOLATED_TRACK_GAP_S
        )
        add_errors_at_horizons(context.headline, "system.prediction.ego.", [errors])
    if context.ego.truth is not None:
        truth = context.ego.truth
        with context.headline.label_rows_with_states(comparison_label(OTHER_SYSTEM, TRUTH)):
            errors = path_errors_against_track(paths, stamp_ns, truth.stamp_ns, truth.xy, MAX_INTERPOLATED_TRACK_GAP_S)
            add_errors_at_horizons(context.headline, "system.prediction.ego.truth_", [errors])


def _path_point_slice(signal: PathSignal, k: int) -> slice:
    return slice(int(signal.offsets[k]), int(signal.offsets[k + 1]))


def _find_frame_placement(
    context: EvaluationContext, signal: PathSignal, ego: EgoMotion, placed_frame: tuple[str, FramePlacement] | None
) -> FramePlacement | None:
    """Return the placement of the paths' frame in the map; None for the car's own frame, or if it can't be found."""
    if signal.frame_id in VEHICLE_FRAMES:
        return None
    if placed_frame is not None and placed_frame[0] == signal.frame_id:
        return placed_frame[1]
    first = signal.offsets[:-1]
    found = fit_frame_placement(np.column_stack([signal.x_m[first], signal.y_m[first]]), ego.xy_m)
    if found is not None:
        context.notes.append(
            f"{found.placement_note(signal.source, signal.frame_id)} (by where its paths begin; an odometry in that "
            "frame, named "
            "with --topic ego_state=, places it better)"
        )
    return found


def _times_along_path_s(xy_m: EastNorthRows, speed_mps: FloatArray, ego_m: FloatArray) -> FloatArray:
    """Return the times (s) at which a car that follows a path reaches its points; 0 at the point nearest to the car."""
    step_m = np.hypot(*np.diff(xy_m, axis=0).T)
    mean_mps = np.maximum(0.5 * (speed_mps[1:] + speed_mps[:-1]), MIN_PATH_SPEED_MPS)
    at_s = np.concatenate([[0.0], np.cumsum(step_m / mean_mps)])
    begin, way = xy_m[:-1], np.diff(xy_m, axis=0)
    length2 = np.maximum((way**2).sum(axis=1), np.finfo(np.float64).tiny)
    share = np.clip(((ego_m - begin) * way).sum(axis=1) / length2, 0.0, 1.0)
    distance_to_ego_m = np.hypot(*(begin + share[:, None] * way - ego_m).T)
    nearest = int(distance_to_ego_m.argmin())
    return np.asarray(at_s - (at_s[nearest] + share[nearest] * (at_s[nearest + 1] - at_s[nearest])))


def _interpolate_path_points(
    time_s: FloatArray, at_s: FloatArray, xy_m: EastNorthRows, *, is_standing: bool
) -> FloatArray:
    """Interpolate a path at given times; NaN before and after it, or its end if the car stands there."""
    behind = None if is_standing else np.nan
    return np.column_stack([np.interp(time_s, at_s, values, left=np.nan, right=behind) for values in xy_m.T])


def _paths_without_covariance(time_s: FloatArray, xy_m: EastNorthRows) -> Paths:
    n, k = xy_m.shape[:2]
    nothing = np.full((n, k), np.nan)
    x_m, y_m = xy_m[..., 0], xy_m[..., 1]
    return Paths(time_s, x_m, y_m, nothing, nothing, np.full((n, k, 3), np.nan))
