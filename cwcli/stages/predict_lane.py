"""Stage `predict-lane`: the ego's path from its observed lateral motion and the road's curvature.

The paths are published in the map if the log holds the ego's states; else in `odom`, a frame of the log's own in which
the observed motion is added up from where the car was, and pointed, at its first state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Annotated, Literal

import numpy as np

from cwcli.channels.lanes import read_lanes
from cwcli.channels.lateral_state import ObservedDrive, read_observed_drive
from cwcli.channels.painted_frames import check_render_topic_is_free
from cwcli.channels.path_image import (
    PathFrames,
    Viewpoint,
    make_channel_of_frames_with_paths,
    make_path_annotation_channel,
)
from cwcli.channels.predicted_path import PredictedPaths, make_predicted_path_channel
from cwcli.channels.published import EGO_STATE, LANES, OBSERVER, OBSERVER_PATH
from cwcli.channels.vehicle_state import read_vehicle_states
from cwcli.dynamics.vehicle import Vehicle
from cwcli.errors import MissingSignalError, UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.records import vehicle_and_notes_from_log
from cwcli.pipeline.result import InputMessageCount, StageResult, StageSummary
from cwcli.pipeline.run_record import build_run_record
from cwcli.pipeline.states import StatesSelection, bind_state_channels
from cwcli.prediction.lateral import LateralPathConfig, predict_paths_from_observer, transform_paths_to_map
from cwcli.prediction.lateral_calibrate import scale_covariance_across_path
from cwcli.prediction.paths import Paths
from cwcli.prediction.poses import VehiclePoses, body_poses_from_states, dead_reckoned_poses
from cwcli.signals.canonical import Signal
from cwcli.signals.columns import BoolArray, Columns, Int64Array, OutputChannel, StreamedChannel, repeat_string
from cwcli.signals.role import Role
from cwcli.signals.vehicle_state import EGO_ID
from cwcli.stages.inputs.camera import topic_and_camera_used_by_lanes
from cwcli.stages.inputs.sources import read_sensor_signals
from cwcli.vision.frames import DecodedFrame, decode_frames

EXAMPLES = (
    "cwcli predict-lane observed.mcap -o predicted.mcap --horizon 2",
    "cwcli predict-lane observed.mcap -o predicted.mcap --render /camera/drawn",
)
"""Command lines that the help of `cwcli predict-lane` shows."""
PUBLISHED_MODEL_NAME_BY_LATERAL_MODEL = {"cwcli": "lateral", "zhang2011": "lateral-zhang2011"}
"""Path model of `prediction.lateral` -> its name in `cwcli.v1.PredictedPath`."""


@dataclass(frozen=True)
class PredictLaneConfig(StatesSelection):
    """Settings of the stage.

    Attributes:
        model: A name of `PUBLISHED_MODEL_NAME_BY_LATERAL_MODEL`.
        horizon_s, step_s: Of the published paths.
        calibrate: Scale the uncertainty by the record itself.
        render: Topic for the camera's frames with the path burnt in, or None.
    """

    model: Annotated[
        Literal["lateral", "lateral-zhang2011"],
        Option(
            "--model",
            "lateral: the yaw rate approaches that of the road; lateral-zhang2011: speed, lateral speed and yaw "
            "rate stay constant.",
        ),
    ] = "lateral"
    horizon_s: Annotated[float, Option("--horizon", "How far ahead to predict.", metavar="SECONDS")] = 2.5
    step_s: Annotated[float, Option("--step", "Time between the points of a path.", metavar="SECONDS")] = 0.05
    calibrate: Annotated[
        bool,
        Option(
            "--calibrate/--no-calibrate",
            "Scale the uncertainty by the errors of the paths over the whole log.",
        ),
    ] = True
    render: Annotated[
        str | None,
        Option(
            "--render",
            "Topic to which the camera's frames with the path and the lane drawn on them are written, as JPEG.",
            metavar="/TOPIC",
        ),
    ] = None

    def __post_init__(self) -> None:
        """Check what can be checked without a log.

        Raises:
            UsageError: No model that starts from the observer, or times that do not fit.
        """
        if self.model not in PUBLISHED_MODEL_NAME_BY_LATERAL_MODEL.values():
            raise UsageError(
                f"--model {self.model} does not start from the observer",
                hint=f"one of: {', '.join(PUBLISHED_MODEL_NAME_BY_LATERAL_MODEL.values())}",
            )
        assert self.path_config

    @property
    def path_config(self) -> LateralPathConfig:
        """The settings of the path model."""
        model = next(model for model, name in PUBLISHED_MODEL_NAME_BY_LATERAL_MODEL.items() if name == self.model)
        return LateralPathConfig(model=model, horizon_s=self.horizon_s, step_s=self.step_s)


@dataclass(frozen=True)
class BodyPaths:
    """The path from each observed frame, in the body frame of that frame.

    Attributes:
        observed: n frames, in the order of their stamps; `observed.track` holds speed, state and status.
        paths: n paths of the centre of gravity: x forward, y left, from (0, 0, 0); NaN where there is no state.
            `position_covariance_m2` is that of the way since the frame, so it is zero at the start.
        vehicle: The car that was observed.
        model: Name of the path model, as in `cwcli.v1.PredictedPath`.
    """

    observed: ObservedDrive
    paths: Paths
    vehicle: Vehicle
    model: str

    @classmethod
    def predict_from_frames(
        cls, observed: ObservedDrive, vehicle: Vehicle, config: LateralPathConfig, *, calibrate: bool
    ) -> BodyPaths:
        """Predict a path from each frame.

        Args:
            calibrate: Scale the uncertainty across the path by how far this record's car went from its paths; looks
                at the whole record.
        """
        paths = predict_paths_from_observer(observed.track, vehicle, config)
        if calibrate:
            paths = scale_covariance_across_path(paths, observed.track)
        return cls(observed, paths, vehicle, PUBLISHED_MODEL_NAME_BY_LATERAL_MODEL[config.model])


@dataclass(frozen=True)
class LanePathEvidence:
    """Values that the evaluation of the stage needs.

    Attributes:
        body: The paths in the body frame.
        poses: The poses at which the paths start.
        truths: Signals of the ego's truth, () without one.
        lateral: Columns of the truth of the lateral motion, None without one.
    """

    body: BodyPaths
    poses: VehiclePoses
    truths: tuple[Signal, ...]
    lateral: Columns | None


def predict_ego_path_from_lateral_motion(log: Log, config: PredictLaneConfig) -> StageResult:
    """Predict the ego's path from its observed lateral motion.

    Needs the channel of `cwcli observe`, and no position. Adds one path per frame, with its covariance, from the
    lateral motion and the road's curvature, and compares it with the later motion.

    Raises:
        MissingSignalError: The log has no observer channel, or no frame of it has a state.
        DataError: The channel is of another version.
    """
    own = bind_state_channels(
        log.channels,
        config,
        required=(OBSERVER.role,),
        optional=(EGO_STATE.role, Role.LATERAL_TRUTH),
        where=log.name,
        command="predict-lane",
    )
    sources = read_sensor_signals(log, config, command="predict-lane", optional=(Role.TRUTH,), also=own)
    topic = sources.columns[OBSERVER.role].topic
    observed = read_observed_drive(sources.columns[OBSERVER.role])
    has_state = np.isfinite(observed.track.state[:, 0])
    if not has_state.any():
        raise MissingSignalError("no frame of the observer has a state", where=f"{log.name}: {topic}")
    vehicle, notes = vehicle_and_notes_from_log(log)
    body = BodyPaths.predict_from_frames(observed, vehicle, config.path_config, calibrate=config.calibrate)
    columns = sources.columns.get(EGO_STATE.role)
    in_map = None
    if columns is not None and len(columns):
        states = read_vehicle_states(columns).sort_by_stamp_without_repeats()
        in_map = body_poses_from_states(states.stamp_ns, states.state, observed.track)
    poses = in_map or dead_reckoned_poses(observed.track)
    map_paths, count = _place_paths_in_map_and_count(body, poses, has_state, topic)
    drawn: tuple[StreamedChannel, ...] = ()
    notes_of_drawing: tuple[str, ...] = ()
    if config.render is not None or has_output_of_lanes_stage(log):
        drawn, notes_of_drawing = draw_paths_into_images(
            log,
            body.paths,
            stamp_ns=observed.track.stamp_ns,
            log_time_ns=observed.log_time_ns,
            width_m=vehicle.width_m,
            camera_forward_m=vehicle.camera_forward_m,
            config=config,
        )
    summary = StageSummary(
        title="predict-lane",
        inputs=(count,),
        notes=(
            *own.notes,
            *notes,
            *notes_of_drawing,
            *(() if in_map else ("no ego state in the log: paths are in a frame of their own, `odom`",)),
        ),
    )
    record = build_run_record("predict-lane", log, config, summary)
    evidence = LanePathEvidence(
        body, poses, sources.by_role.get(Role.TRUTH, ()), sources.columns.get(Role.LATERAL_TRUTH)
    )
    return StageResult("predict-lane", (map_paths, *drawn), {}, summary, record, evaluation_inputs=evidence)


predict_lane = predict_ego_path_from_lateral_motion
"""The function of the stage, under the name of the stage."""


def has_output_of_lanes_stage(log: Log) -> bool:
    """Return whether the log holds the channel of `cwcli lanes`."""
    return LANES.topic in {channel.topic for channel in log.channels}


def draw_paths_into_images(
    log: Log,
    paths: Paths,
    *,
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    width_m: float,
    camera_forward_m: float = 0.0,
    config: PredictLaneConfig | None = None,
) -> tuple[tuple[StreamedChannel, ...], tuple[str, ...]]:
    """Draw each path into the frame with its stamp.

    The camera is that of `cwcli lanes`, whose record in the log tells the mounting; pitch and yaw are those of each
    frame.

    Args:
        log: With the channel and the record of `cwcli lanes`.
        paths: n paths in the body frame of their start, from the centre of gravity.
        stamp_ns, log_time_ns: Shape (n,): of the frames that the paths start from. Paths without a frame are left out.
        camera_forward_m: Of the camera ahead of the centre of gravity.
        config: Names the topic for the frames with boundaries and path burnt in, and the user's choices of topics;
            None: no such frames and no choices.

    Returns:
        The annotations, and the rendered frames if they were asked for; and notes for the user.

    Raises:
        MissingSignalError: The log has no lanes, or no camera where `render` needs one.
        UsageError: `render` is no topic for frames.
    """
    if not has_output_of_lanes_stage(log):
        raise MissingSignalError(
            f"no channel {LANES.topic} (needed to draw paths on the image)",
            where=log.name,
            hint="run `cwcli lanes` first",
        )
    render, topics = (None, {}) if config is None else (config.render, config.topics)
    camera_topic, source = topic_and_camera_used_by_lanes(log, topics, is_needed=render is not None)
    check_render_topic_is_free(log, render, camera_topic)
    seen_from = Viewpoint(source.camera_for_size, width_m, camera_forward_m)
    frames = PathFrames.pair_paths_with_frames_of_same_stamp(
        paths, stamp_ns, log_time_ns, read_lanes(log.columns(LANES.topic)), seen_from
    )
    left_out = len(stamp_ns) - len(frames)
    note = f"{left_out} of {len(stamp_ns)} paths are not drawn: no frame of a known size has their stamp"
    channels = [make_path_annotation_channel(frames)]
    if render is not None:

        def in_colour(prepare: Callable[[DecodedFrame], object]) -> Iterator[DecodedFrame]:
            where = f"{log.name}: {camera_topic}"
            return decode_frames(log.frames(camera_topic), wanted_size_of=None, prepare=prepare, where=where)

        frame_id = next((frame.frame_id for frame in log.frames(camera_topic)), "")
        channels.append(make_channel_of_frames_with_paths(frames, render, frame_id=frame_id, images=in_colour))
    return tuple(channels), (note,) if left_out else ()


def _place_paths_in_map_and_count(
    body: BodyPaths, poses: VehiclePoses, has_state: BoolArray, topic: str
) -> tuple[OutputChannel, InputMessageCount]:
    """Return the channel of the paths that start from a known pose, and the counts of the others by reason."""
    has_pose = np.isfinite(poses.at_xy_m[:, 0]) & np.isfinite(poses.at_yaw_rad)
    rows = np.flatnonzero(has_state & has_pose)
    x_m, y_m = poses.at_xy_m[rows].T
    left_out = {
        "no state": int(np.count_nonzero(~has_state)),
        "no ego state near it": int(np.count_nonzero(has_state & ~has_pose)),
    }
    predicted = PredictedPaths(
        repeat_string(EGO_ID, len(rows)),
        body.observed.track.stamp_ns[rows],
        body.observed.log_time_ns[rows],
        body.model,
        transform_paths_to_map(body.paths.paths_of_rows(rows), x_m, y_m, poses.at_yaw_rad[rows]),
    )
    channel = make_predicted_path_channel(OBSERVER_PATH, predicted, frame_id=poses.frame_id)
    set_aside = {reason: n for reason, n in left_out.items() if n}
    return channel, InputMessageCount(topic, OBSERVER.role, len(has_state), len(rows), set_aside=set_aside)
