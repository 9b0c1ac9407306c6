"""Stage `warn-lane`: the observer's paths against the boundaries of `cwcli lanes` in, lane departures out."""

from __future__ import annotations

from dataclasses import field

import numpy as np

from cwcli.channels.binding import bind_roles
from cwcli.channels.lanes import FIELDS_FOR_ROAD_BOUNDARIES, LaneRows, read_lanes
from cwcli.channels.predicted_path import read_predicted_paths
from cwcli.channels.published import LANES, OBSERVER_PATH
from cwcli.dynamics.vehicle import Vehicle
from cwcli.errors import MissingSignalError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import Selection
from cwcli.pipeline.records import vehicle_and_notes_from_log
from cwcli.pipeline.result import Cell, InputMessageCount, StageResult, SummaryTable
from cwcli.prediction.lateral import transform_paths_to_body
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.row_order import rows_by_stamp_without_repeats
from cwcli.signals.units import NS_PER_S
from cwcli.stages.summaries.warn import WARNING_NUMBER_HEADING, RuleOutcome, build_warnings_result
from cwcli.vision.method import LaneState
from cwcli.warning.lane_departure import (
    LANE_DEPARTURE_RULE_NAME,
    FrontAxle,
    LaneBoundaries,
    LaneDepartureConfig,
    LaneDepartureResult,
    evaluate_lane_departure,
)

EXAMPLES = (
    "cwcli warn-lane predicted.mcap -o warned.mcap",
    "cwcli warn-lane predicted.mcap --line-crossing 1.0 --json",
)
"""Command lines that the help of `cwcli warn-lane` shows."""
REQUIRED_ROLES = (OBSERVER_PATH.role, LANES.role)
"""Roles of the channels that the stage needs: the predicted paths, then the lanes."""
MIN_PLACEHOLDER_PATH_DURATION_S = 0.05
"""Shortest span [s] of the placeholder paths where the log holds none: one step of `cwcli predict-lane`."""


@dataclass(frozen=True)
class WarnLaneConfig(Selection):
    """Settings of the stage.

    Attributes:
        rule: Options of the rule.
    """

    rule: LaneDepartureConfig = field(default_factory=LaneDepartureConfig)


def warn_lane(log: Log, config: WarnLaneConfig) -> StageResult:
    """Warn the ego vehicle of leaving its lane.

    Needs the channels of `cwcli lanes` and `cwcli predict-lane`. A warning is raised when the predicted path takes a
    front tyre over a lane boundary within the time to line crossing; one departure is one warning.

    Raises:
        MissingSignalError: The log lacks a channel, or there is no frame.
        UsageError: The paths are shorter than the rule looks ahead.
        DataError: A channel is of another version.
    """
    bound = bind_roles(log.channels, config.topics, required=REQUIRED_ROLES, where=log.name, command="warn-lane")
    path_topic, lanes_topic = (bound.by_role[role][0].topic for role in REQUIRED_ROLES)
    loaded = log.load_topics({path_topic: None, lanes_topic: FIELDS_FOR_ROAD_BOUNDARIES})
    path_columns, lanes = (
        loaded[topic].slice_by_log_time(config.start_ns, config.end_ns) for topic in (path_topic, lanes_topic)
    )
    if not len(lanes):
        place = f"{log.name}: {lanes_topic}"
        raise MissingSignalError("no frame is in the log, or none between --start and --end", where=place)
    vehicle, notes = vehicle_and_notes_from_log(log)
    predicted = read_predicted_paths(path_columns)
    stamp_ns, log_time_ns, boundaries = _stamps_and_boundaries_of_first_frames(read_lanes(lanes), vehicle)
    paths = transform_paths_to_body(predicted.paths)
    _, mine, theirs = np.intersect1d(stamp_ns, predicted.stamp_ns, return_indices=True)
    matched = _spread_paths_over_frames(paths, mine, theirs, len(stamp_ns), config.rule.warn_s)
    result = evaluate_lane_departure(
        stamp_ns,
        log_time_ns,
        matched,
        boundaries,
        matched.speed_mps[:, 0],
        config.rule,
        host=FrontAxle(vehicle.width_m, vehicle.front_axle_m),
    )
    without = len(stamp_ns) - len(mine)
    set_aside = {"no path from the observer": without} if without else {}
    inputs = (
        InputMessageCount(path_topic, OBSERVER_PATH.role, len(predicted), len(theirs)),
        InputMessageCount(lanes_topic, LANES.role, len(lanes), len(mine), set_aside=set_aside),
    )
    tables = (result.events, result.series)
    outcome = RuleOutcome(
        LANE_DEPARTURE_RULE_NAME, result.rows, tables, _lane_departure_and_frame_tables(result, log.start_ns)
    )
    return build_warnings_result("warn-lane", log, config, [outcome], inputs, (*bound.notes, *notes))[0]


def _stamps_and_boundaries_of_first_frames(
    lanes: LaneRows, vehicle: Vehicle
) -> tuple[Int64Array, Int64Array, LaneBoundaries]:
    """Return stamps, log times and boundaries of the first frame of each stamp, in the order of the stamps."""
    rows = rows_by_stamp_without_repeats(lanes.stamp_ns)
    left, right = np.moveaxis(lanes.plausible_offset_slope_curvature_of_boundaries()[rows], 1, 0)
    log_time_ns = np.maximum.accumulate(lanes.log_time_ns[rows])
    is_seen = lanes.state[rows] != LaneState.HELD
    change_1pm2 = -lanes.curvature_change_1pm2[rows]
    boundaries = LaneBoundaries(left, right, vehicle.camera_forward_m, is_seen, lanes.steady_s[rows], change_1pm2)
    return lanes.stamp_ns[rows], log_time_ns, boundaries


def _spread_paths_over_frames(
    paths: Paths,
    rows: np.ndarray[tuple[int, ...], np.dtype[np.intp]],
    path_indices: np.ndarray[tuple[int, ...], np.dtype[np.intp]],
    n: int,
    horizon_s: float,
) -> Paths:
    """Return paths for n frames: those of index `path_indices` at the frames `rows`, NaN at the others."""
    time_s = paths.time_s if len(paths) else np.array([0.0, max(horizon_s, MIN_PLACEHOLDER_PATH_DURATION_S)])
    k = len(time_s)

    def fill_rows_with_paths(values: FloatArray) -> FloatArray:
        whole = np.full((n, k, *values.shape[2:]), np.nan)
        if len(path_indices):
            whole[rows] = values[path_indices]
        return whole

    parts = (paths.x_m, paths.y_m, paths.heading_rad, paths.speed_mps, paths.position_covariance_m2)
    return Paths(time_s, *(fill_rows_with_paths(part) for part in parts))


def _lane_departure_and_frame_tables(result: LaneDepartureResult, start_ns: int) -> tuple[SummaryTable, ...]:
    """Return the tables of the lane departures and of what became of the frames."""
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            event["event_id"],
            event["side"],
            (event["raised_ns"] - start_ns) / NS_PER_S,
            event["time_to_line_crossing_s"],
            event["gap_m"],
            event["departure_rate_mps"],
            event["duration_s"],
        )
        for event in result.events.rows_as_dicts()
    )
    columns = (
        WARNING_NUMBER_HEADING,
        "side of the lane",
        "raised at [s]",
        "time to line crossing [s]",
        "distance of tyre to line [m]",
        "speed towards the line [m/s]",
        "duration of the warning [s]",
    )
    names = ("event", "side", "at [s]", "crossing in [s]", "to the line [m]", "rate [m/s]", "for [s]")
    counts = tuple((name.replace("_", " "), count) for name, count in result.counts.items())
    return (
        SummaryTable("lane_departures", "Lane departures (times from the log's start)", columns, rows, names=names),
        SummaryTable(
            "lane_frames",
            "Camera frames with lanes, by result of the check for a departure",
            ("result of the check", "number of frames"),
            counts,
            names=("result", "count"),
        ),
    )
