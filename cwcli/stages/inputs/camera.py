"""Which camera a log was recorded with: its calibration, if there is one, and how it stands on the car.

The mounting is what the user says, else that of the log's transforms, else the stated default.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields

import numpy as np

from cwcli.channels.binding import bind_roles, is_truth_topic
from cwcli.channels.published import LANES, OWN_TOPIC_PREFIX
from cwcli.channels.transforms import add_transforms_of_topic_to_tree
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.logs.read.frames import Frame
from cwcli.logs.read.reader import Log
from cwcli.pipeline.assumed_camera import ASSUMED_LENS_NOTE_BEGINNING, ASSUMED_MOUNTING_NOTE_BEGINNING
from cwcli.pipeline.call import Selection
from cwcli.pipeline.records import read_configuration, read_finite_number_or_nan, read_input_counts, read_run_records
from cwcli.pipeline.result import InputMessageCount
from cwcli.signals.canonical import CameraInfoSignal
from cwcli.signals.clocks import (
    INVALID_LOG_TIME_REASON,
    MAX_STAMP_NS,
    STRAY_LOG_TIME_REASON,
    first_and_last_log_time_without_strays,
)
from cwcli.signals.inputs import find_input_for_role
from cwcli.signals.resample import Series
from cwcli.signals.role import Role
from cwcli.signals.transforms import (
    BODY_FRAME_NAMES,
    CameraPose,
    Transform,
    camera_pose_from_matrix,
    find_body_frame_and_transform,
)
from cwcli.stages.inputs.sources import read_sensor_signals
from cwcli.vision.camera import KNOWN_DISTORTION_MODEL_NAMES, Camera, Mounting, camera_from_calibration, default_camera
from cwcli.vision.mounting import (
    CAMERA_HEIGHT_RANGE_M,
    MAX_CAMERA_ANGLE_RAD,
    MAX_CAMERA_OFFSET_M,
    MOUNTING_OPTION_NAMES,
    MountingChoice,
)
from cwcli.vision.rectify import needs_rectifying
from cwcli.vision.video import CODEC_OF_VIDEO_FORMAT

KEYS_OF_CAMERA_CHOICE_IN_RECORDED_LANES_CONFIGURATION = ("mounting", "topics")
"""Keys of the recorded configuration of `cwcli lanes` that say how its camera was found."""
MAX_TIME_OF_SAME_PICTURE_IN_MOTION_NS, MIN_SPEED_OF_CHANGING_PICTURE_MPS = 1_000_000_000, 3.0
"""Longest time for which a camera gives the same bytes before it counts as frozen [ns], in a car that is at least this
fast [m/s]. Chosen by hand."""
MAX_TIME_OF_SAME_PICTURE_AT_UNKNOWN_SPEED_NS, MIN_REPETITIONS_AT_UNKNOWN_SPEED = 2_000_000_000, 10
"""The same time where the speed is not known [ns], and the least number of repetitions. Chosen by hand: noise makes
each picture of a sensor another one, but not that of a simulated camera in a car that stands."""
FROZEN_CAMERA_REASON = "the same picture for more than 1 s in a moving car: the camera is frozen"
"""The reason for rejecting the frames of a frozen camera."""
SAME_PICTURE_REASON = "the same picture for more than 2 s: a frozen camera, or a simulated one at standstill"
"""The reason for rejecting frames that repeat a picture where the speed is not known."""


@dataclass(frozen=True)
class CameraSource:
    """The calibration and the mounting of a camera, which give the camera model for an image size.

    Attributes:
        info: The log's calibration, or None.
        mounting: The camera's pose on the car.
        field_of_view_rad: Horizontal field of view, for a log without calibration.
        is_rectified: The topic's name says that the images are rectified.
        counts: Counts of the calibration messages.
        notes: Notes for the user.
    """

    info: CameraInfoSignal | None
    mounting: Mounting
    field_of_view_rad: float
    is_rectified: bool
    counts: tuple[InputMessageCount, ...] = ()
    notes: tuple[str, ...] = ()

    def camera_for_size(self, width_px: int, height_px: int) -> Camera:
        """Return the camera for images of a size; a calibration for another size is scaled."""
        if self.info is None:
            return default_camera(width_px, height_px, self.mounting, field_of_view_rad=self.field_of_view_rad)
        return camera_from_calibration(self.info, self.mounting, is_rectified=self.is_rectified).with_image_size(
            width_px, height_px
        )

    def needs_rectifying(self) -> bool:
        """Return whether the lens distorts the frames."""
        return needs_rectifying(self.camera_for_size(1000, 1000))

    def shape_mismatch_note(self, width_px: int, height_px: int) -> str:
        """Return a note if the calibration is for images of another shape, else ""."""
        if self.info is None or self.info.width_px * height_px == self.info.height_px * width_px:
            return ""
        name, size = self.info.source, f"{self.info.width_px} x {self.info.height_px}"
        return f"{name} is for images of {size}, the frames are {width_px} x {height_px}: scaled in each axis"


def find_camera_source(
    log: Log, camera_topic: str, topics: Mapping[str, str], mounting: Mounting, field_of_view_rad: float | None
) -> CameraSource:
    """Find the calibration of a camera topic.

    The one that the user names, else the one beside the images (`/camera/image`, `/camera/camera_info`), else the only
    one. If its distortion model is unknown, nothing of it is used: other models (`double_sphere`) have focal lengths of
    another meaning. The model does not matter where the images are rectified or there are no coefficients.

    Args:
        field_of_view_rad: The user's, or None. It counts only if the log holds no calibration.
    """
    chosen = dict(topics)
    if Role.CAMERA_INFO.value not in chosen:
        camera_info_topics = [
            name for name in _camera_info_topics(log) if _topic_namespace(name) == _topic_namespace(camera_topic)
        ]
        if len(camera_info_topics) == 1:
            chosen[Role.CAMERA_INFO.value] = camera_info_topics[0]
    sources = read_sensor_signals(log, Selection(topics=chosen), command="lanes", optional=(Role.CAMERA_INFO,))
    found = sources.by_role.get(Role.CAMERA_INFO, ())
    info = found[0] if found and isinstance(found[0], CameraInfoSignal) else None
    is_rectified = bool(re.search(r"(^|[/_])rect(ified)?([/_]|$)", camera_topic))
    notes, counts = list(sources.notes), sources.input_message_counts()
    if info is not None and info.distortion_model.lower() not in KNOWN_DISTORTION_MODEL_NAMES:
        if is_rectified or not info.distortion.any():
            info = replace(info, distortion_model="")
        else:
            known = ", ".join(name for name in KNOWN_DISTORTION_MODEL_NAMES if name)
            model = f"its distortion model {info.distortion_model!r} is unknown"
            notes.append(f"{info.source} is not used: {model} (known: {known})")
            info, counts = None, tuple(map(_reject_used_messages, counts))
    default = default_camera(1000, 1000, mounting)
    fov_rad = 2.0 * math.atan(500.0 / default.fx) if field_of_view_rad is None else field_of_view_rad
    if info is None:
        notes.append(
            f"{ASSUMED_LENS_NOTE_BEGINNING} {camera_topic}: a horizontal field of view of {math.degrees(fov_rad):.0f} "
            "degrees, no distortion and the axis at the image's centre are assumed (--camera-fov)"
        )
    elif field_of_view_rad is not None:
        notes.append(f"--camera-fov is not used: {info.source} holds the calibration")
    return CameraSource(info, mounting, fov_rad, is_rectified, counts, tuple(notes))


def topic_and_camera_used_by_lanes(log: Log, topics: Mapping[str, str], *, is_needed: bool) -> tuple[str, CameraSource]:
    """Return the topic of the camera in whose frames `cwcli lanes` found the lanes, and the camera.

    The settings come from the record of `cwcli lanes`; the defaults stand in for those that it lacks.

    Args:
        log: A log with the channel of the lanes.
        topics: Role -> topic, the user's choices; they count before the record's.
        is_needed: Whether the frames themselves are needed.

    Raises:
        MissingSignalError: Frames are needed, and the log holds none.
    """
    record = read_run_records(log).get(LANES.stage, {})
    configuration = read_configuration(record)
    recorded_choice, recorded = (
        found if isinstance(found, dict) else {}
        for found in map(configuration.get, KEYS_OF_CAMERA_CHOICE_IN_RECORDED_LANES_CONFIGURATION)
    )
    chosen = {**{str(role): str(topic) for role, topic in recorded.items()}, **topics}
    mounting = {entry.name: read_finite_number_or_nan(recorded_choice, entry.name) for entry in fields(Mounting)}
    angle_rad = read_finite_number_or_nan(configuration, "field_of_view_rad")
    cameras = (str(entry.get("topic")) for entry in read_input_counts(record) if entry.get("role") == Role.CAMERA.value)
    topic = next(cameras, "")
    if Role.CAMERA.value in chosen or topic not in {channel.topic for channel in log.channels}:
        required, optional = ((Role.CAMERA,), ()) if is_needed else ((), (Role.CAMERA,))
        bound = bind_roles(
            log.channels, chosen, required=required, optional=optional, where=log.name, command="predict"
        )
        topic = bound.first_topic_of_role(Role.CAMERA) or topic
    return topic, find_camera_source(
        log,
        topic,
        chosen,
        Mounting(**{name: value for name, value in mounting.items() if math.isfinite(value)}),
        angle_rad if 0.0 < angle_rad < math.pi else None,
    )


def _reject_used_messages(count: InputMessageCount) -> InputMessageCount:
    """Count the used messages as rejected: they can't be applied, because the distortion model is unknown."""
    return replace(
        count, used=0, rejected={**count.rejected, "calibration with an unknown distortion model": count.used}
    )


def _camera_info_topics(log: Log) -> list[str]:
    """Return the topics of the log that hold camera calibrations."""
    return [channel.topic for channel in log.channels if find_input_for_role(Role.CAMERA_INFO, channel.schema_name)]


def _topic_namespace(topic: str) -> str:
    """Return the topic without its last part: `/camera` for `/camera/image`."""
    return topic.rpartition("/")[0]


@dataclass(frozen=True)
class MountingSource:
    """The mounting and where it comes from.

    Attributes:
        mounting: The mounting.
        is_pitch_known: The pitch is given by the user or by the log.
        counts: Counts of the messages with transforms.
        notes: Notes for the user.
    """

    mounting: Mounting
    is_pitch_known: bool
    counts: tuple[InputMessageCount, ...] = ()
    notes: tuple[str, ...] = ()


def find_camera_mounting(log: Log, frame_id: str, choice: MountingChoice | Mounting) -> MountingSource:
    """Find out how a camera is mounted.

    Each value that the user gives counts before that of the transforms, and that before the default. The transforms are
    those of the log's own channels (`/tf_static`, `/tf`); the first of each frame of reference is taken.

    Args:
        choice: The user's choice; a whole `Mounting` is used as it is.
    """
    if isinstance(choice, Mounting):
        return MountingSource(choice, is_pitch_known=choice.pitch_rad != 0.0)
    given_values = choice.given_values_by_option()
    if len(given_values) == len(MOUNTING_OPTION_NAMES):
        return MountingSource(Mounting(**given_values), is_pitch_known=True)
    pose, counts, notes = _camera_pose_from_transforms(log, frame_id.lstrip("/"))
    if pose is None:
        mounting = Mounting(**given_values)
        note = (
            f"{ASSUMED_MOUNTING_NOTE_BEGINNING}: {mounting.height_m:g} m above the road, level, straight ahead and in "
            f"the middle of the car are assumed ({', '.join(MOUNTING_OPTION_NAMES.values())})"
        )
        notes = notes if given_values else (*notes, note)
        return MountingSource(mounting, "pitch_rad" in given_values, counts, notes)
    mounting = Mounting(pose.height_m, pose.pitch_rad, pose.yaw_rad, pose.roll_rad, pose.lateral_m)
    if given_values:
        notes = (
            *notes,
            f"{', '.join(MOUNTING_OPTION_NAMES[name] for name in given_values)} counts before the transform",
        )
    return MountingSource(replace(mounting, **given_values), True, counts, notes)


def _camera_pose_from_transforms(
    log: Log, frame_id: str
) -> tuple[CameraPose | None, tuple[InputMessageCount, ...], tuple[str, ...]]:
    """Return the camera's pose on the car from the log's transforms or None, message counts, and notes."""
    topics = sorted(
        {channel.topic for channel in log.transform_channels() if not _is_unused_transform_topic(channel.topic)},
        key=lambda topic: ("static" not in topic, topic),
    )
    if not topics or not frame_id:
        return None, (), ()
    tree: dict[str, Transform] = {}
    counts = []
    for topic in topics:
        counts.append(InputMessageCount.from_transforms(*add_transforms_of_topic_to_tree(log, topic, tree, frame_id)))
        if find_body_frame_and_transform(tree, frame_id) is not None:
            break
    found = find_body_frame_and_transform(tree, frame_id)
    if found is None:
        note = f"no transform leads from {frame_id} to {' or '.join(BODY_FRAME_NAMES)}: {', '.join(topics)} not used"
        return None, tuple(counts), (note,)
    body, matrix = found
    pose = camera_pose_from_matrix(matrix)
    fault = _implausible_pose_text(pose, frame_id, body)
    if pose is None or fault:
        return None, tuple(counts), (f"{fault}: the transforms are not used",)
    degrees = [math.degrees(angle) for angle in (pose.pitch_rad, pose.yaw_rad, pose.roll_rad)]
    note = (
        f"the camera's mounting comes from the transform of {frame_id} in {body}: height {pose.height_m:.2f} m, offset "
        f"{pose.lateral_m:.2f} m, pitch {degrees[0]:.2f}, yaw {degrees[1]:.2f}, roll {degrees[2]:.2f} degrees"
    )
    if body != BODY_FRAME_NAMES[0]:
        note += f" ({body} is assumed to be on the road)"
    return pose, tuple(counts), (note,)


def _implausible_pose_text(pose: CameraPose | None, frame_id: str, body: str) -> str:
    """Return why a pose is not that of a camera that looks ahead from a car; else ""."""
    if pose is None:
        return f"{frame_id} does not look ahead from {body}"
    if not CAMERA_HEIGHT_RANGE_M[0] <= pose.height_m <= CAMERA_HEIGHT_RANGE_M[1]:
        return f"{frame_id} is {pose.height_m:.3g} m above {body}, no height above the road"
    if abs(pose.lateral_m) > MAX_CAMERA_OFFSET_M:
        return f"{frame_id} is {pose.lateral_m:.3g} m beside {body}, not on the car"
    if abs(pose.roll_rad) > MAX_CAMERA_ANGLE_RAD:
        return f"{frame_id} is rolled by {math.degrees(pose.roll_rad):.0f} degrees in {body}, not upright"
    return ""


def _is_unused_transform_topic(topic: str) -> bool:
    """Return whether the transforms of a topic are not used: cwcli wrote them, or they are a truth."""
    return topic.startswith(OWN_TOPIC_PREFIX) or is_truth_topic(topic)


def span_without_stray_frames(log: Log, topic: str, span: Selection) -> Selection:
    """Return the span without the log times of frames that are far in time from all others."""
    logged = log.log_times_ns(topic).view(np.int64)
    first_ns, last_ns = first_and_last_log_time_without_strays(
        [logged[[span.includes_log_time(each) for each in logged.tolist()]]]
    )
    return Selection(start_ns=first_ns, end_ns=last_ns + 1)


class _PictureRepetition:
    """Tells which frames repeat a picture for so long that the camera is frozen.

    Args:
        speed_mps: The ego's speed.
    """

    def __init__(self, speed_mps: Series) -> None:
        self._speed_mps = speed_mps
        self._last_data: bytes | memoryview = b""
        self._since_ns = 0
        self._n_repetitions = 0

    def rejection_reason_or_empty(self, frame: Frame) -> str:
        """Return why the next frame is not to be used; else ""."""
        speed_mps = math.nan
        is_new = frame.data != self._last_data
        if not is_new:
            at_ns = frame.log_time_ns if frame.stamp_ns is None else frame.stamp_ns
            speed_mps = abs(self._speed_mps.linear_value_at_time_or_nan(at_ns))
        if is_new or speed_mps < MIN_SPEED_OF_CHANGING_PICTURE_MPS:
            self._last_data, self._since_ns, self._n_repetitions = frame.data, frame.log_time_ns, 0
            return ""
        self._n_repetitions += 1
        same_for_ns = frame.log_time_ns - self._since_ns
        if not math.isnan(speed_mps):
            return FROZEN_CAMERA_REASON if same_for_ns > MAX_TIME_OF_SAME_PICTURE_IN_MOTION_NS else ""
        is_long = same_for_ns > MAX_TIME_OF_SAME_PICTURE_AT_UNKNOWN_SPEED_NS
        return SAME_PICTURE_REASON if is_long and self._n_repetitions >= MIN_REPETITIONS_AT_UNKNOWN_SPEED else ""


def iter_camera_frames(
    log: Log,
    topic: str,
    span: Selection,
    usual: Selection,
    speed_mps: Series,
    reject: Callable[[str], None] = lambda reason: None,
) -> Iterator[Frame]:
    """The frames of the span; video from its beginning, because later pictures are made from earlier ones.

    One whose log time is far from all others' came at no time that is known, and is rejected, with a reason. In video
    it comes nevertheless: its picture is not to be used, but those after it are made from it. Frames (not of video)
    that repeat the same bytes for long, in a car that is not known to stand, are rejected, too.

    Args:
        log, topic, span: Where the frames are, and which are wanted.
        usual: `span_without_stray_frames` of the same.
        speed_mps: The ego's speed; empty if it is not known.
        reject: Called with the reason of each that is rejected.
    """
    repetition = _PictureRepetition(speed_mps)
    for frame in log.frames(topic):
        is_video = frame.format.lower() in CODEC_OF_VIDEO_FORMAT
        is_wanted = span.includes_log_time(frame.log_time_ns)
        if not is_wanted and span.end_ns is not None and frame.log_time_ns >= span.end_ns:
            return
        is_stray = is_wanted and not usual.includes_log_time(frame.log_time_ns)
        if is_stray:
            reject(STRAY_LOG_TIME_REASON if 0 <= frame.log_time_ns <= MAX_STAMP_NS else INVALID_LOG_TIME_REASON)
        if is_wanted and not is_stray and not is_video and (reason := repetition.rejection_reason_or_empty(frame)):
            reject(reason)
            continue
        if is_video or (is_wanted and not is_stray):
            yield frame
