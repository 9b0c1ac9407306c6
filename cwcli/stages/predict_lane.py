"""Stage `predict-lane`: the ego's path from its observed lateral motion and the road's curvature.

The paths are published in the map if the log holds the ego's states; else in `odom`, a frame of the log's own in which
the observed motion is added up from where the car was, and pointed, at its first state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt

from cwcli.channels.binding import bind
from cwcli.channels.lateral_state import Observed, read_observed
from cwcli.channels.predicted_path import PredictedPaths, write_paths
from cwcli.channels.published import EGO_STATE, OBSERVER, OBSERVER_PATH
from cwcli.channels.vehicle_state import read_states
from cwcli.errors import MissingSignalError, UsageError
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.records import vehicle_of
from cwcli.pipeline.result import InputCount, StageResult, Summary
from cwcli.pipeline.run_record import run_record
from cwcli.prediction.lateral import LateralPathConfig, dead_reckon, map_paths
from cwcli.signals.canonical import Signal
from cwcli.signals.codec import Role
from cwcli.signals.columns import Columns, FloatArray, Int64Array, OutputChannel, constant_strings
from cwcli.signals.resample import resample
from cwcli.signals.vehicle_state import EGO_ID, MAP_FRAME
from cwcli.stages.inputs.sources import SourceConfig, read_sources
from cwcli.stages.observer_paths import MODEL_NAMES, BodyPaths, predict_body
from cwcli.stages.path_overlay import Overlay, has_lanes, path_overlay

EXAMPLES = (
    "cwcli predict-lane observed.mcap -o predicted.mcap --horizon 2",
    "cwcli predict-lane observed.mcap -o predicted.mcap --render /camera/drawn",
)
ODOM_FRAME = "odom"
MAX_GAP_S = 0.5
NO_STATE = "no state"
NO_POSE = "no ego state near it"
MIN_SLIP_SPEED_MPS = 1.0

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class PredictLaneConfig:
    """Settings of the stage.

    Attributes:
        model: A name of `observer_paths.MODEL_NAMES`.
        horizon_s, step_s: Of the published paths.
        calibrate: Scale the uncertainty by the record itself.
        render: Topic for the camera's frames with the path burnt in, or None.
        topics: Role -> topic, the user's choices.
        start_ns, end_ns: Only frames logged in this span are used.
    """

    model: Annotated[
        Literal["lateral", "lateral-zhang2011"],
        Option(
            "--model",
            "lateral: the yaw rate goes over to the road's; lateral-zhang2011: speed, lateral speed and yaw rate stay.",
        ),
    ] = "lateral"
    horizon_s: Annotated[float, Option("--horizon", "How far ahead.", metavar="SECONDS")] = 2.5
    step_s: Annotated[float, Option("--step", "Between the points of a path.", metavar="SECONDS")] = 0.05
    calibrate: Annotated[
        bool,
        Option(
            "--calibrate/--no-calibrate",
            "Scale the uncertainty by how far this record's car went from its paths; looks at the whole record.",
        ),
    ] = True
    render: Annotated[
        str | None,
        Option(
            "--render",
            "Publish the camera's frames with the path and the lane drawn on them here, as JPEG.",
            metavar="/TOPIC",
        ),
    ] = None
    topics: Mapping[str, str] = field(default_factory=dict)
    start_ns: int | None = None
    end_ns: int | None = None

    def __post_init__(self) -> None:
        """Check what can be checked without a log.

        Raises:
            UsageError: No model that starts from the observer, or times that do not fit.
        """
        if self.model not in MODEL_NAMES.values():
            raise UsageError(
                f"--model {self.model} does not start from the observer",
                hint=f"one of: {', '.join(MODEL_NAMES.values())}",
            )
        assert self.path

    @property
    def path(self) -> LateralPathConfig:
        """The settings of the path model."""
        model = next(model for model, name in MODEL_NAMES.items() if name == self.model)
        return LateralPathConfig(model=model, horizon_s=self.horizon_s, step_s=self.step_s)


@dataclass(frozen=True)
class Poses:
    """Where the car was and where its axis pointed.

    Attributes:
        source: What tells it, for people.
        frame_id: Its frame.
        stamp_ns, xy_m: Shape (m,) and (m, 2): the track.
        at_xy_m, at_yaw_rad: Shape (n, 2) and (n,): at the observed frames; NaN where not known.
    """

    source: str
    frame_id: str
    stamp_ns: Int64Array
    xy_m: FloatArray
    at_xy_m: FloatArray
    at_yaw_rad: FloatArray


@dataclass(frozen=True)
class Made:
    """What is compared with what then happened.

    Attributes:
        body: The paths, in the car's own axes.
        poses: Where they are placed.
        truths: Signals of the ego's truth, () without one.
        lateral: Columns of the truth of the lateral motion, None without one.
    """

    body: BodyPaths
    poses: Poses
    truths: tuple[Signal, ...]
    lateral: Columns | None


def predict_lane(log: Log, config: PredictLaneConfig) -> StageResult:
    """Predict the ego's path from its observed lateral motion.

    Needs the channel of `cwcli observe`, and no position. Adds one path per frame, with its covariance, from the
    lateral motion and the road's curvature, and compares it with what then happened.

    Raises:
        MissingSignalError: The log has no observer channel, or no frame of it has a state.
        DataError: The channel is of another version.
    """
    own = bind(
        log.channels,
        config.topics,
        required=(OBSERVER.role,),
        optional=(EGO_STATE.role, Role.LATERAL_TRUTH),
        where=log.name,
        command="predict-lane",
    )
    sources = read_sources(
        log,
        SourceConfig(topics=config.topics, start_ns=config.start_ns, end_ns=config.end_ns),
        command="predict-lane",
        required=(),
        optional=(Role.TRUTH,),
        also={bindings[0].topic: None for bindings in own.by_role.values()},
    )
    topic = own.by_role[OBSERVER.role][0].topic
    observed = read_observed(sources.columns[topic])
    has_state = np.isfinite(observed.track.state[:, 0])
    if not has_state.any():
        raise MissingSignalError("no frame of the observer has a state", where=f"{log.name}: {topic}")
    vehicle, notes = vehicle_of(log)
    body = predict_body(observed, vehicle, config.path, calibrate=config.calibrate)
    state_topic = own.topic(EGO_STATE.role)
    states = None if state_topic is None else sources.columns[state_topic]
    own_motion = _own_motion(observed)
    in_map = None if states is None or not len(states) else _ego_state_poses(states, observed)
    placed, count = _place(body, in_map or own_motion, has_state, topic)
    overlay = _overlay(log, body, config)
    summary = Summary(
        title="predict-lane",
        inputs=(count,),
        notes=(
            *own.notes,
            *notes,
            *overlay.notes,
            *(() if in_map else ("no ego state in the log: paths are in a frame of their own, `odom`",)),
        ),
    )
    record = run_record("predict-lane", log, config, summary)
    lateral_topic = own.topic(Role.LATERAL_TRUTH)
    lateral = None if lateral_topic is None else sources.columns[lateral_topic]
    made = Made(body, in_map or own_motion, sources.by_role.get(Role.TRUTH, ()), lateral)
    return StageResult("predict-lane", (placed, *overlay.channels), {}, summary, record, made=made)


def _overlay(log: Log, body: BodyPaths, config: PredictLaneConfig) -> Overlay:
    """The paths on the camera's image; nothing for a log without the lanes' channel, unless it is asked for."""
    if config.render is None and not has_lanes(log):
        return Overlay(())
    return path_overlay(
        log,
        body.paths,
        stamp_ns=body.stamp_ns,
        log_time_ns=body.observed.log_time_ns,
        width_m=body.vehicle.width_m,
        camera_forward_m=body.vehicle.camera_forward_m,
        render=config.render,
        topics=config.topics,
    )


def _place(body: BodyPaths, poses: Poses, has_state: BoolArray, topic: str) -> tuple[OutputChannel, InputCount]:
    """The channel: the paths that start from a known pose, and why the others are left out."""
    has_pose = np.isfinite(poses.at_xy_m[:, 0]) & np.isfinite(poses.at_yaw_rad)
    rows = np.flatnonzero(has_state & has_pose)
    x_m, y_m = poses.at_xy_m[rows].T
    left_out = {NO_STATE: int(np.count_nonzero(~has_state)), NO_POSE: int(np.count_nonzero(has_state & ~has_pose))}
    predicted = PredictedPaths(
        constant_strings(EGO_ID, len(rows)),
        body.stamp_ns[rows],
        body.observed.log_time_ns[rows],
        body.model,
        map_paths(body.paths.take(rows), x_m, y_m, poses.at_yaw_rad[rows]),
    )
    channel = write_paths(OBSERVER_PATH, predicted, frame_id=poses.frame_id)
    set_aside = {reason: n for reason, n in left_out.items() if n}
    return channel, InputCount(topic, OBSERVER.role, len(has_state), len(rows), set_aside=set_aside)


def _own_motion(observed: Observed) -> Poses:
    """The observed motion added up; it has no pose where there is no state."""
    x_m, y_m, yaw_rad = dead_reckon(observed.track)
    has_state = np.isfinite(observed.track.state[:, 0])
    first = int(np.argmax(has_state))
    dx, dy = x_m - x_m[first], y_m - y_m[first]
    cos, sin = np.cos(yaw_rad[first]), np.sin(yaw_rad[first])
    xy_m = np.where(has_state[:, None], np.column_stack([cos * dx + sin * dy, -sin * dx + cos * dy]), np.nan)
    stamp_ns = observed.track.stamp_ns
    return Poses("the observed motion", ODOM_FRAME, stamp_ns, xy_m, xy_m, yaw_rad - yaw_rad[first])


def _ego_state_poses(columns: Columns, observed: Observed) -> Poses:
    """The estimated track, and the pose at each frame; its heading is where the car goes, not where its axis points."""
    states = read_states(columns).by_stamp()
    stamp_ns, state = states.stamp_ns, states.state
    x_m, y_m, course_rad = resample(stamp_ns, state[:, [0, 1, 3]], observed.track.stamp_ns, max_gap_s=MAX_GAP_S).T
    yaw_rad = course_rad - slip_rad(observed.track.state[:, 0], observed.track.speed_mps)
    return Poses("the ego state", MAP_FRAME, stamp_ns, state[:, :2], np.column_stack([x_m, y_m]), yaw_rad)


def slip_rad(lateral_mps: FloatArray, speed_mps: FloatArray) -> FloatArray:
    """Angle from the car's axis to its direction of motion; 0 at walking pace."""
    moves = np.abs(speed_mps) >= MIN_SLIP_SPEED_MPS
    return np.where(moves, np.arctan2(lateral_mps, np.where(moves, speed_mps, 1.0)), 0.0)
