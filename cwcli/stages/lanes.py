"""Stage `lanes`: camera frames in, lane boundaries and what they say of the car's place in its lane out."""

from __future__ import annotations

import math
import time
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from typing import Annotated

import numpy as np
import numpy.typing as npt

from cwcli.channels.binding import bind_roles
from cwcli.channels.lanes import (
    LaneFrames,
    make_channel_of_frames_with_lanes,
    make_lane_annotation_channel,
    make_lanes_channel,
)
from cwcli.channels.painted_frames import check_render_topic_is_free, check_topic_name_if_given
from cwcli.errors import DataError, UsageError
from cwcli.estimation.calibration import UNKNOWN_CONSTANT, Calibration, run_record_entry_of_calibration_file
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.logs.read.reader import Log
from cwcli.metrics.table import Table
from cwcli.option import Option
from cwcli.pipeline.assumed_camera import CONTRADICTED_LENS_NOTE_BEGINNING
from cwcli.pipeline.call import Selection
from cwcli.pipeline.result import InputMessageCount, StageResult, StageSummary
from cwcli.pipeline.run_record import build_run_record
from cwcli.signals.clocks import NO_STAMP_REASON
from cwcli.signals.columns import FloatArray, OutputChannel
from cwcli.signals.role import Role
from cwcli.stages.inputs.camera import (
    CameraSource,
    find_camera_mounting,
    find_camera_source,
    iter_camera_frames,
    span_without_stray_frames,
)
from cwcli.stages.inputs.frame_motion import MotionSeries, read_ego_motion
from cwcli.stages.summaries.lanes import lanes_summary_table, lanes_table
from cwcli.vision.camera import DEFAULT_FIELD_OF_VIEW_RAD, Camera, Mounting
from cwcli.vision.fit_columns import FitCollector
from cwcli.vision.frames import DecodedFrame, decode_frames
from cwcli.vision.ground import (
    LaneGeometry,
    boundary_top_rows_px,
    compute_lane_geometry,
    image_hyperbolas_of_flat_road,
    repeat_pinhole_per_frame,
)
from cwcli.vision.method import GreyImage, LaneFit, LaneFrame, LaneSearch, Method, PreparedFrame, make_frame_preparer
from cwcli.vision.methods import DEFAULT_METHOD, check_method_and_model, load_method
from cwcli.vision.mounting import MountingChoice, check_mounting_ranges
from cwcli.vision.rectify import Rectifier, rectified_camera
from cwcli.vision.search_clock import SearchClock
from cwcli.work_share import part_of_work, report_work

EXAMPLES = (
    "cwcli lanes drive.mcap -o lanes.mcap --metrics lanes.parquet",
    "cwcli lanes drive.mcap -o lanes.mcap --render /camera/annotated",
    "cwcli lanes drive.mcap --method zhang2011 --seed 1 --camera-height 1.4",
)
"""Command lines that the help of `cwcli lanes` shows."""
DEFAULT_PREVIEW_DISTANCE_M = 33.5
"""Default distance of the preview point ahead of the camera [m], that of zhang2011."""
MAX_PREVIEW_DISTANCE_M = 1000.0
"""Greatest distance of the preview point that is accepted [m]; chosen by hand."""
FIELD_OF_VIEW_RANGE_RAD = (np.radians(1.0), np.radians(175.0))
"""Least and greatest horizontal field of view that is accepted [rad]; chosen by hand."""
COLOUR_DECODING_INTERVAL_NS = 1_000_000_000
"""Interval at which a frame is also decoded in colour [ns], which costs twice as much as grey; chosen by hand."""
MAX_FRAME_GAP_OF_SEARCH_NS = 500_000_000
"""Longest gap between two frames [ns] over which a search goes on; chosen by hand."""
NUMBERS_PER_FRAME_ENTRY = 8
"""Length of a frame's entry in `_numbers`: index, log time, stamp, number, two image sizes [px]."""

Rows = npt.NDArray[np.intp]


@dataclass(frozen=True)
class LanesConfig(Selection):
    """Settings of the stage.

    Attributes:
        method: A key of `vision.methods.METHODS`.
        model: Of a method that takes one (`Method.with_model`): the file, else None.
        seed: Seed of random searches.
        preview_m: Distance of the preview point ahead of the camera.
        mounting: Of the camera; what it leaves open is taken from the log's transforms, else the stated default.
        field_of_view_rad: Horizontal, for a log without calibration; None: the stated default.
        render: Topic for the frames with the lines burnt in, or None.
        every_frame: Search every frame; else a method that can carries its lane over the frames between two searches.
        calibration: Constants of the camera, the speed and the gyroscope from other drives, or None.
    """

    method: Annotated[str, Option("--method", "{choices}", metavar="NAME", choices="cwcli.vision.methods:METHODS")] = (
        DEFAULT_METHOD
    )
    model: Annotated[
        str | None,
        Option(
            "--model",
            "Your net (ONNX) for --method onnx; a TOML file of the same name describes its input and output.",
            metavar="FILE",
        ),
    ] = None
    seed: Annotated[
        int, Option("--seed", "Seed of the random numbers of the genetic search (zhang2011).", metavar="N")
    ] = 0
    preview_m: Annotated[
        float, Option("--preview", "Distance of the preview point ahead of the camera.", metavar="METRES")
    ] = DEFAULT_PREVIEW_DISTANCE_M
    render: Annotated[
        str | None,
        Option(
            "--render",
            "Topic to which the frames with the boundaries drawn on them are written, as JPEG.",
            metavar="/TOPIC",
        ),
    ] = None
    every_frame: Annotated[
        bool,
        Option("--every-frame", "Search every frame, even if the camera is faster than 25 Hz."),
    ] = False
    mounting: Mounting | MountingChoice = field(default_factory=MountingChoice)
    field_of_view_rad: Annotated[
        float | None,
        Option(
            "--camera-fov",
            "Horizontal field of view, for a log without calibration.",
            metavar="DEGREES",
            default=f"{math.degrees(DEFAULT_FIELD_OF_VIEW_RAD):.0f}",
            parse=math.radians,
        ),
    ] = None
    calibration: Calibration | None = None

    def __post_init__(self) -> None:
        """Check what can be checked without a log.

        Raises:
            UsageError: An unknown method, a setting out of range, or a render topic that is not the name of a topic.
        """
        check_method_and_model(self.method, self.model)
        if not 0.0 < self.preview_m <= MAX_PREVIEW_DISTANCE_M:
            raise UsageError(f"--preview {self.preview_m:g} must be positive, and at most {MAX_PREVIEW_DISTANCE_M:g} m")
        check_mounting_ranges(self.mounting)
        low_rad, high_rad = FIELD_OF_VIEW_RANGE_RAD
        if self.field_of_view_rad is not None and not low_rad <= self.field_of_view_rad <= high_rad:
            degrees = f"{np.degrees(low_rad):.0f} and {np.degrees(high_rad):.0f} degrees"
            raise UsageError(f"--camera-fov must lie between {degrees}")
        if not 0 <= self.seed < 2**64:
            raise UsageError(f"--seed {self.seed} must lie between 0 and 2^64 - 1")
        check_topic_name_if_given(self.render)


def lanes(log: Log, config: LanesConfig) -> StageResult:
    """Find the lane boundaries in camera frames.

    Needs a camera channel (JPEG, PNG, raw images or video). Adds the boundaries, the car's place in its lane at the
    preview point, and annotations that Foxglove draws on the image. The calibration is taken from the log where it
    holds one.

    Raises:
        MissingSignalError: The log has no camera channel, or more than one.
        UsageError: An unknown method, or settings that make no sense.
        DataError: No frame could be used.
        InputError: The frames are compressed video, and there is no decoder for it.
    """
    method = load_method(config.method, config.model)
    bound = bind_roles(log.channels, config.topics, required=(Role.CAMERA,), where=log.name, command="lanes")
    topic = bound.by_role[Role.CAMERA][0].topic
    check_render_topic_is_free(log, config.render, topic)
    choice, calibrated = _mounting_with_calibrated_pitch(config, topic)
    mount = find_camera_mounting(log, _camera_frame_id(log, topic), choice)
    config = replace(config, mounting=mount.mounting)
    source = find_camera_source(log, topic, config.topics, mount.mounting, config.field_of_view_rad)
    motion = read_ego_motion(log, config.topics, config.calibration) if method.uses_motion else MotionSeries()
    is_rectified = method.is_rectified and source.needs_rectifying()
    run = _LaneSearchRun(method, config.seed, source, motion, is_rectified=is_rectified)
    usual = span_without_stray_frames(log, topic, config)
    images = decode_frames(
        iter_camera_frames(log, topic, config, usual, motion.speed_mps, run.count_rejected_frame),
        wanted_size_of=method.search_size,
        prepare=make_frame_preparer(method, Rectifier(source.camera_for_size) if is_rectified else None),
        colour_every_ns=COLOUR_DECODING_INTERVAL_NS if method.uses_colour else None,
        search_clock=None if method.carry is None or config.every_frame else SearchClock(),
        where=f"{log.name}: {topic}",
    )
    n_frames = sum(channel.message_count or 0 for channel in log.channels if channel.topic == topic)
    with part_of_work(0.0, 1.0 if config.render is None else 0.6, "frames"):
        for n_read, decoded in enumerate(images):
            report_work("frames", n_read, n_frames)
            if usual.includes_log_time(decoded.log_time_ns):
                run.search_frame(decoded)
    if not run.n_used:
        raise _no_usable_frame_error(f"{log.name}: {topic}", {**run.rejected, **log.faults.undecodable.get(topic, {})})
    log.begin_sha256()  # for the record of the run
    frames = run.build_lane_frames(config, is_pitch_known=mount.is_pitch_known)
    channels: list[OutputChannel] = [make_lanes_channel(frames), make_lane_annotation_channel(frames)]
    if config.render is not None:

        def in_colour(prepare: Callable[[DecodedFrame], object]) -> Iterator[DecodedFrame]:
            frames_of_topic = iter_camera_frames(log, topic, config, usual, motion.speed_mps)
            return decode_frames(frames_of_topic, wanted_size_of=None, prepare=prepare, where=f"{log.name}: {topic}")

        channels.append(
            make_channel_of_frames_with_lanes(
                frames, config.render, frame_id=_camera_frame_id(log, topic), images=in_colour
            )
        )
    repaired = {NO_STAMP_REASON: run.n_without_stamp} if run.n_without_stamp else {}
    count = InputMessageCount(topic, Role.CAMERA.value, run.n_read, run.n_used, dict(run.rejected), repaired)
    summary = StageSummary(
        title=f"lanes ({config.method})",
        sections=(
            lanes_summary_table(frames, n_searches=run.n_searches, n_searched=run.n_searched, search_s=run.search_s),
        ),
        inputs=(count, *source.counts, *mount.counts, *motion.counts),
        notes=(
            *bound.notes,
            *source.notes,
            *calibrated,
            *mount.notes,
            *motion.notes,
            *_note_on_rectification(source, is_rectified),
            *run.notes,
            *run.notes_on_contradicted_lens(frames),
        ),
    )
    table: Table = lanes_table(frames)
    known = run_record_entry_of_calibration_file(config.calibration)
    record = build_run_record("lanes", log, replace(config, calibration=None), summary, **known)
    return StageResult("lanes", tuple(channels), {"lanes": table}, summary, record)


def _mounting_with_calibrated_pitch(
    config: LanesConfig, topic: str
) -> tuple[MountingChoice | Mounting, tuple[str, ...]]:
    """Return the user's choice, completed with the calibration's pitch where it has none, and a note on it."""
    known = (
        UNKNOWN_CONSTANT
        if config.calibration is None
        else config.calibration.find_constant_or_unknown(topic, "camera", "pitch_rad")
    )
    choice = config.mounting
    if isinstance(choice, Mounting) or choice.pitch_rad is not None or not known.has_value:
        return choice, ()
    assert config.calibration is not None
    note = f"the camera's pitch is {np.degrees(known.value):.2f} degrees, by the calibration {config.calibration.name}"
    return replace(choice, pitch_rad=known.value), (note,)


def _note_on_rectification(source: CameraSource, is_rectified: bool) -> tuple[str, ...]:
    """Return a note on the distortion and roll that were removed from the frames, if any."""
    if not is_rectified:
        return ()
    camera = source.camera_for_size(1000, 1000)
    what = [f"{camera.distortion_model or 'polynomial'} distortion"] if camera.differs_from_pinhole() else []
    if camera.mounting.roll_rad:
        what.append(f"{np.degrees(camera.mounting.roll_rad):.1f} degrees of roll")
    return (f"removed from the frames before the search: {' and '.join(what)}",)


def _camera_frame_id(log: Log, topic: str) -> str:
    """Return the frame of reference of the camera's images; "" without images."""
    first = next(iter(log.frames(topic)), None)
    return "" if first is None else first.frame_id


def _no_usable_frame_error(where: str, rejected: Mapping[str, int]) -> DataError:
    """Return the error for a camera without a usable frame, with the reasons and their counts."""
    if not rejected:
        return DataError("there is no frame in the chosen span", where=where)
    found = tuple(f"{count} frames: {reason}" for reason, count in rejected.items())
    return DataError("no frame can be used", where=where, found=found)


class _LaneSearchRun:
    """One pass over the frames: the search, and a few numbers for each frame."""

    def __init__(
        self, method: Method, seed: int, source: CameraSource, motion: MotionSeries, *, is_rectified: bool
    ) -> None:
        self._method = method
        self._is_rectified = is_rectified
        self._seed = seed
        self._source = source
        self._motion = motion
        self._search: LaneSearch | None = None
        self._camera: Camera | None = None
        self._size = (0, 0)
        self._search_size = (0, 0)
        self._last_ns = 0
        self._recorder = FitCollector()
        self._numbers = array("q")
        self.n_read = 0
        self.n_used = 0
        self.n_without_stamp = 0
        self.n_searches = 0
        self.n_searched = 0
        self.search_s = 0.0
        self.rejected: Counter[str] = Counter()
        self.notes: list[str] = []

    def count_rejected_frame(self, reason: str) -> None:
        """Count a frame that can't be used."""
        self.n_read += 1
        self.rejected[reason] += 1

    def search_frame(self, decoded: DecodedFrame) -> None:
        """Search the next frame, or count why it can't be used."""
        if decoded.is_skipped:
            self._carry_lane(decoded)
            return
        if decoded.image is None:
            self.count_rejected_frame(decoded.rejection_reason)
            return
        self.n_read += 1
        size = (decoded.width_px, decoded.height_px)
        gap_ns = decoded.stamp_ns - self._last_ns
        if self._search is None or size != self._size or not 0 <= gap_ns <= MAX_FRAME_GAP_OF_SEARCH_NS:
            self._start_search(size, decoded.image)
        assert self._search is not None
        assert self._camera is not None
        self._last_ns = decoded.stamp_ns
        prepared = decoded.prepared
        if not isinstance(prepared, PreparedFrame):
            prepared = PreparedFrame(decoded.image, colour=decoded.colour)
        frame = LaneFrame(
            grey=prepared.grey,
            camera=self._camera,
            stamp_ns=decoded.stamp_ns,
            number=self.n_used,
            speed_mps=self._motion.speed_mps.linear_value_at_time_or_nan(decoded.stamp_ns),
            yaw_rate_radps=self._motion.yaw_rate_radps.linear_value_at_time_or_nan(decoded.stamp_ns),
            prepared=prepared.method_result,
            colour=prepared.colour,
        )
        begin = time.perf_counter()
        fit = self._search.step(frame)
        self.search_s += time.perf_counter() - begin
        self._search_size = decoded.image.shape[1], decoded.image.shape[0]
        self.n_searched += 1
        self._record_fit(decoded, fit)

    def _carry_lane(self, decoded: DecodedFrame) -> None:
        """Carry the lane of the last searched frame to a frame that is not searched."""
        self.n_read += 1
        if self._search is None:  # the frames before it can't be used
            self.n_read -= 1
            self.count_rejected_frame("not searched, and no frame before it could be")
            return
        assert self._method.carry is not None
        begin = time.perf_counter()
        fit = self._method.carry(
            self._search,
            decoded.stamp_ns,
            self._motion.speed_mps.linear_value_at_time_or_nan(decoded.stamp_ns),
            self._motion.yaw_rate_radps.linear_value_at_time_or_nan(decoded.stamp_ns),
        )
        self.search_s += time.perf_counter() - begin
        self._record_fit(decoded, fit)

    def _record_fit(self, decoded: DecodedFrame, fit: LaneFit) -> None:
        """Record the fit of a frame, and the frame's numbers."""
        self._recorder.append_fit(fit)
        self._numbers.extend(
            (decoded.index, decoded.log_time_ns, decoded.stamp_ns, self.n_used, *self._size, *self._search_size)
        )
        self.n_used += 1
        self.n_without_stamp += not decoded.has_stamp

    def _start_search(self, size: tuple[int, int], image: GreyImage) -> None:
        """Begin a new search, for images of another size with a new camera."""
        self._search = self._method.make(self._seed)
        self.n_searches += 1
        if size == self._size:
            return
        if self._size != (0, 0):
            self.notes.append(
                f"the image size changes from {self._size[0]} x {self._size[1]} to {size[0]} x {size[1]} at frame "
                f"{self.n_read - 1}: the search starts again"
            )
        note = self._source.shape_mismatch_note(*size)
        if note and note not in self.notes:
            self.notes.append(note)
        self._size = size
        self._camera = self._camera_of_searched_image(size, (image.shape[1], image.shape[0]))

    def _camera_of_searched_image(self, image_size: tuple[int, int], search_size: tuple[int, int]) -> Camera:
        """Return the camera in pixels of the image that is searched."""
        camera = self._source.camera_for_size(*image_size).with_image_size(*search_size)
        return rectified_camera(camera) if self._is_rectified else camera

    def notes_on_contradicted_lens(self, frames: LaneFrames) -> tuple[str, ...]:
        """Return a note if what the drive shows contradicts the lens; only for frames of one size, with motion."""
        motion, camera, sizes = self._motion, self._camera, frames.search_size
        if camera is None or not (len(motion.speed_mps.values) and len(motion.yaw_rate_radps.values)):
            return ()
        if (sizes != sizes[0]).any():
            return ()
        from cwcli.vision.lens_check import field_of_view_that_contradicts_camera_rad

        seen_rad = field_of_view_that_contradicts_camera_rad(
            frames.fits, frames.stamp_ns, motion.speed_mps, motion.yaw_rate_radps, camera
        )
        if math.isnan(seen_rad):
            return ()
        own_rad, own_source = 2.0 * math.atan(0.5 * camera.width_px / camera.fx), self._source.info
        return (
            f"{CONTRADICTED_LENS_NOTE_BEGINNING} a horizontal field of view of about "
            f"{math.degrees(seen_rad):.0f} degrees, not the {math.degrees(own_rad):.0f} that "
            f"{'are assumed: try --camera-fov' if own_source is None else own_source.source + ' states'}",
        )

    def build_lane_frames(self, config: LanesConfig, *, is_pitch_known: bool) -> LaneFrames:
        """Return all used frames with their boundaries in the image and on the road."""
        numbers = np.array(self._numbers, np.int64).reshape(-1, NUMBERS_PER_FRAME_ENTRY)
        fits = self._recorder.to_columns()
        image_size, search_size = numbers[:, 4:6], numbers[:, 6:8]
        horizon_px = np.full(len(fits), np.nan)
        turned_rad = np.full((len(fits), 2), np.nan)
        roads, top_px = np.full((len(fits), 2, 4), np.nan), np.full(len(fits), np.nan)
        pinhole = np.full((len(fits), 2), np.nan)
        parts: list[tuple[Rows, LaneGeometry]] = []
        sizes = numbers[:, 4:8]
        for image_w, image_h, search_w, search_h in sorted(set(map(tuple, sizes.tolist()))):
            rows = np.flatnonzero((sizes == (image_w, image_h, search_w, search_h)).all(axis=1))
            camera = self._camera_of_searched_image((image_w, image_h), (search_w, search_h))
            parts.append((rows, compute_lane_geometry(fits[rows], camera, preview_m=config.preview_m)))
            roads[rows] = image_hyperbolas_of_flat_road(fits[rows], camera)
            pinhole[rows] = repeat_pinhole_per_frame(camera, len(rows))
            is_known = not camera.is_default or is_pitch_known
            pitch_rad = fits.pitch_rad[rows]
            if is_known:
                pitch_rad = np.where(np.isnan(pitch_rad), camera.mounting.pitch_rad, pitch_rad)
            horizon_px[rows] = camera.horizon_row_px(pitch_rad)
            top_px[rows] = boundary_top_rows_px(fits[rows], camera, horizon_px[rows])
            for k, own_rad in enumerate((fits.pitch_rad, fits.yaw_rad)):
                assumed_rad = (camera.mounting.pitch_rad, camera.mounting.yaw_rad)[k]
                turned_rad[rows, k] = np.where(np.isnan(own_rad[rows]), assumed_rad, own_rad[rows])
        geometry = parts[0][1] if len(parts) == 1 else _merge_geometry(parts, len(fits))
        return LaneFrames(
            index=numbers[:, 0],
            log_time_ns=numbers[:, 1],
            stamp_ns=numbers[:, 2],
            image_size=image_size,
            search_size=search_size,
            horizon_px=horizon_px,
            camera_pitch_rad=turned_rad[:, 0],
            camera_yaw_rad=turned_rad[:, 1],
            fits=fits,
            roads=roads,
            top_px=top_px,
            pinhole=pinhole,
            geometry=geometry,
            preview_m=config.preview_m,
            rectified_from=self._source.camera_for_size if self._is_rectified else None,
        )


def _merge_geometry(parts: list[tuple[Rows, LaneGeometry]], n: int) -> LaneGeometry:
    """Merge the geometry of n frames of several sizes, in the order of the frames."""
    whole: dict[str, FloatArray] = {}
    for rows, part in parts:
        for name, values in vars(part).items():
            whole.setdefault(name, np.full((n, *values.shape[1:]), np.nan))[rows] = values
    return replace(parts[0][1], **whole)
