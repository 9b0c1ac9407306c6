"""Evaluation of `predict-lane`: errors of its paths and of the other models' against the later track."""

from __future__ import annotations

import math

import numpy as np

from cwcli.channels.lateral_state import ObservedDrive, read_lateral_truth_stamps_and_states
from cwcli.channels.published import EGO_STATE
from cwcli.evaluation.predict import MAX_INTERPOLATED_TRACK_GAP_S, error_horizons_s
from cwcli.lazy_dataclass import replace
from cwcli.logs.read.reader import Log
from cwcli.metrics.table import ColumnDoc, Table, TableColumn
from cwcli.pipeline.result import Cell, StageResult, SummaryTable
from cwcli.prediction.lateral import transform_paths_to_map
from cwcli.prediction.model_comparison import BASELINE_MODEL, horizon_error_table
from cwcli.prediction.outcome import HorizonErrors, horizon_errors
from cwcli.prediction.paths import Paths
from cwcli.prediction.poses import VehiclePoses, side_slip_rad
from cwcli.signals.canonical import PoseSignal, Signal
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.covariances import xx_xy_yy_covariance_in_turned_axes
from cwcli.signals.normal_distribution import SIGMAS_HOLDING_90_PERCENT
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.vehicle_state import EGO_ID
from cwcli.stages.predict_lane import (
    PUBLISHED_MODEL_NAME_BY_LATERAL_MODEL,
    BodyPaths,
    LanePathEvidence,
    PredictLaneConfig,
)

SCHEMA_OF_STATES_WITH_COURSE_AS_HEADING = EGO_STATE.schema
"""Schema of states whose heading is the course and not the yaw of the car."""


def add_scores_to_result(log: Log, config: PredictLaneConfig, result: StageResult) -> StageResult:
    """Add the errors of every path model to the result: against the truth, else against the track."""
    evidence: LanePathEvidence = result.evaluation_inputs
    reference = _truth_poses_at_frames(evidence.truths, log, evidence.lateral, evidence.body.observed) or evidence.poses
    table = _build_path_model_error_table(evidence.body, reference, config)
    section = _build_prediction_section(table, config.horizon_s, reference.source)
    return result.with_evaluation(sections=(section,), tables={table.name: table})


def _truth_poses_at_frames(
    truths: tuple[Signal, ...], log: Log, lateral: Columns | None, observed: ObservedDrive
) -> VehiclePoses | None:
    """Return the true track and the true pose at each frame; None without a truth that has a yaw."""
    truth = next((each for each in truths if isinstance(each, PoseSignal)), None)
    if truth is None or not np.isfinite(truth.yaw_rad).any():
        return None
    at_ns = observed.track.stamp_ns
    xy_m = np.column_stack([truth.x_m, truth.y_m])
    at_xy = interpolate_signal_at_times(truth.stamp_ns, xy_m, at_ns, max_gap_s=MAX_INTERPOLATED_TRACK_GAP_S)
    left_rad = 0.0 if truth.mounting is None else truth.mounting.correction_rad
    yaw_rad = (
        interpolate_signal_at_times(
            truth.stamp_ns, np.unwrap(truth.yaw_rad), at_ns, max_gap_s=MAX_INTERPOLATED_TRACK_GAP_S
        )
        - left_rad
    )
    schema = next(channel.schema_name for channel in log.channels if channel.topic == truth.source)
    if schema == SCHEMA_OF_STATES_WITH_COURSE_AS_HEADING:
        lateral_mps = observed.track.state[:, 0]
        if lateral is not None and len(lateral):
            true_ns, true_state = read_lateral_truth_stamps_and_states(lateral)
            lateral_mps = interpolate_signal_at_times(
                true_ns, true_state[:, 0], at_ns, max_gap_s=MAX_INTERPOLATED_TRACK_GAP_S
            )
        yaw_rad = yaw_rad - side_slip_rad(lateral_mps, observed.track.speed_mps)
    return VehiclePoses(truth.source, "", truth.stamp_ns, xy_m, at_xy, yaw_rad)


def _build_path_model_error_table(body: BodyPaths, poses: VehiclePoses, config: PredictLaneConfig) -> Table:
    """Build the table with the errors of each path model and of constant velocity, from the same starts and poses."""
    track = body.observed.track
    horizons = error_horizons_s(config.horizon_s)
    paths_by_model = {BASELINE_MODEL: _constant_velocity_paths(body)}
    for model, name in PUBLISHED_MODEL_NAME_BY_LATERAL_MODEL.items():
        is_own = name == body.model
        own = replace(config.path_config, model=model)
        other = (
            body
            if is_own
            else BodyPaths.predict_from_frames(body.observed, body.vehicle, own, calibrate=config.calibrate)
        )
        paths_by_model[name] = other.paths
    compared: dict[str, HorizonErrors] = {}
    bands: list[FloatArray] = []
    x_m, y_m = poses.at_xy_m.T
    for name, paths in paths_by_model.items():
        map_paths = transform_paths_to_map(paths, x_m, y_m, poses.at_yaw_rad)
        compared[name] = horizon_errors(
            map_paths, track.stamp_ns, poses.stamp_ns, poses.xy_m, horizons, MAX_INTERPOLATED_TRACK_GAP_S
        )
        bands.append(_share_inside_90_percent_band(compared[name], map_paths))
    columns: dict[str, TableColumn] = {
        "vehicle": [EGO_ID] * (len(paths_by_model) * len(horizons)),
        **horizon_error_table(compared),
        "inside_band_90": np.concatenate(bands),
        "against": [poses.source] * (len(paths_by_model) * len(horizons)),
    }
    docs = {"inside_band_90": ColumnDoc(doc="share of the errors across the path within 1.645 of their sigma")}
    return Table("observer_prediction", columns, docs)


def _constant_velocity_paths(body: BodyPaths) -> Paths:
    """Return the paths of constant velocity: v ahead, v_y to the left, no covariance."""
    track, t = body.observed.track, body.paths.time_s
    v, lateral = track.speed_mps[:, None], track.state[:, :1]
    x_m, y_m = v * t, lateral * t
    side_slip = np.broadcast_to(side_slip_rad(lateral, v), x_m.shape)
    return Paths(t, x_m, y_m, side_slip, np.hypot(v, lateral) + 0.0 * t, np.full((*x_m.shape, 3), np.nan))


def _share_inside_90_percent_band(errors: HorizonErrors, placed: Paths) -> FloatArray:
    """Return the share of outcomes inside the 90 % band across the path at each horizon; NaN without a covariance."""
    shares = []
    for column, horizon_s in enumerate(errors.horizon_s):
        at = int(np.argmin(np.abs(placed.time_s - horizon_s)))
        across = xx_xy_yy_covariance_in_turned_axes(placed.position_covariance_m2[:, at], placed.heading_rad[:, at])[
            :, 2
        ]
        sigma = np.sqrt(np.maximum(across, 0.0))
        known = errors.is_known[:, column] & np.isfinite(sigma)
        inside = np.abs(errors.cross_m[known, column]) <= SIGMAS_HOLDING_90_PERCENT * sigma[known]
        shares.append(float(inside.mean()) if len(inside) else math.nan)
    return np.array(shares)


def _build_prediction_section(table: Table, horizon_s: float, source: str) -> SummaryTable:
    """Build the section with errors at the horizon, one row per model."""
    rows: list[tuple[Cell, ...]] = [
        (
            str(row["model"]),
            row["n"],
            row["mean_m"],
            row["median_m"],
            row["p95_m"],
            row["change_percent"],
            100.0 * row["inside_band_90"],
        )
        for row in table.rows_as_dicts()
        if abs(row["horizon_s"] - horizon_s) < 1e-9 and row["n"]
    ]
    title = (
        f"Errors of positions predicted {horizon_s:g} s ahead, against {source} (cv: the model of constant velocity)"
    )
    error_columns = (
        "mean error [m]",
        "median error [m]",
        "95 % of errors below [m]",
        "change of mean error from cv [%]",
        "later positions inside the 90 % band [%]",
    )
    columns = ("motion model", "predicted paths", *error_columns)
    names = ("model", "starts", "mean [m]", "median [m]", "p95 [m]", "vs cv [%]", "in 90 % band [%]")
    return SummaryTable("prediction", title, columns, tuple(rows), names=names)
