"""The predicted path on the camera's image: annotations for viewers, and frames with the path burnt in.

The camera is that of `cwcli lanes`, whose record in the log tells the mounting; pitch and yaw are those of each frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields

import numpy as np

from cwcli.channels.binding import bind
from cwcli.channels.image_lines import LINE_LOOP, LINE_STRIP, Shape, line_thickness_px, write_image_lines
from cwcli.channels.lanes import LaneRows, read_lanes
from cwcli.channels.painted_frames import painted_channel
from cwcli.channels.published import LANES, OBSERVER_PATH_LINES
from cwcli.channels.render_topic import check_render_topic
from cwcli.errors import MissingSignalError
from cwcli.logs.read.reader import Log
from cwcli.pipeline.records import configuration_of, inputs_of, number, run_records
from cwcli.prediction.paths import Paths
from cwcli.signals.codec import Role
from cwcli.signals.columns import FloatArray, Int64Array, StreamedChannel
from cwcli.signals.rows import Rows, rows_by_stamp
from cwcli.stages.inputs.camera import CameraSource, camera_source
from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.encoded import Image
from cwcli.vision.frames import DecodedFrame, decode_frames
from cwcli.vision.overlay import burn_in
from cwcli.vision.path_overlay import FILL_ALPHA, NOTHING, PATH_RGB, BodyPath, PathLines, paint_path, path_lines

LANES_STAGE = "lanes"
LINE_ALPHA = {"centre": 1.0, "left": 0.6, "right": 0.6}
NO_COLOUR = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Overlay:
    """What is drawn, and what the user should know of it.

    Attributes:
        channels: The annotations, and the rendered frames if they were asked for.
        notes: One line each.
    """

    channels: tuple[StreamedChannel, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Scene:
    """The paths with a frame each, n rows, and the camera that saw the frames."""

    stamp_ns: Int64Array
    log_time_ns: Int64Array
    paths: Paths
    width_m: float
    camera_forward_m: float
    source: CameraSource
    lanes: LaneRows
    lane_rows: Rows

    def image_size(self, row: int) -> tuple[int, int]:
        """Width and height of a frame."""
        width_px, height_px = self.lanes.image_size[self.lane_rows[row]].tolist()
        return width_px, height_px

    def camera(self, row: int) -> Camera:
        """The camera of a frame."""
        camera = self.source.camera(*self.image_size(row))
        at = self.lane_rows[row]
        return camera.turned(
            pitch_rad=float(self.lanes.camera_pitch_rad[at]), yaw_rad=float(self.lanes.camera_yaw_rad[at])
        )

    def lines(self, row: int) -> PathLines:
        """The path of a frame in its pixels; nothing where there is no path."""
        paths = self.paths
        if not np.isfinite(paths.x_m[row]).all():
            return NOTHING
        path = BodyPath(
            paths.x_m[row], paths.y_m[row], paths.heading_rad[row], np.nan_to_num(paths.position_covariance_m2[row])
        )
        return path_lines(path, self.camera(row), width_m=self.width_m, camera_forward_m=self.camera_forward_m)

    def boundaries(self, row: int) -> list[FloatArray]:
        """The lane boundaries that `cwcli lanes` found, left and right, in the frame's pixels."""
        return self.lanes.lines(int(self.lane_rows[row]), self.image_size(row))


def has_lanes(log: Log) -> bool:
    """Whether the log holds the channel of `cwcli lanes`."""
    return LANES.topic in {channel.topic for channel in log.channels}


def path_overlay(
    log: Log,
    paths: Paths,
    *,
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    width_m: float,
    camera_forward_m: float = 0.0,
    render: str | None = None,
    topics: Mapping[str, str] | None = None,
) -> Overlay:
    """Draw each path into the frame with its stamp.

    Args:
        log: With the channel and the record of `cwcli lanes`.
        paths: n paths in the body frame of their start, from the centre of gravity.
        stamp_ns, log_time_ns: Shape (n,): of the frames that the paths start from. Paths without a frame are left out.
        width_m: Of the car.
        camera_forward_m: Of the camera ahead of the centre of gravity.
        render: Topic for the frames with boundaries and path burnt in, or None.
        topics: Role -> topic, the user's choices.

    Raises:
        MissingSignalError: The log has no lanes, or no camera where `render` needs one.
        UsageError: `render` is no topic for frames.
    """
    record = _lanes_record(log)
    chosen = {**record.topics, **(topics or {})}
    if not has_lanes(log):
        raise MissingSignalError(
            f"no channel {LANES.topic} (needed to draw paths on the image)",
            where=log.name,
            hint="run `cwcli lanes` first",
        )
    lanes = read_lanes(log.columns(LANES.topic))
    camera_topic = _camera_topic(log, chosen, record.camera_topic, is_needed=render is not None)
    check_render_topic(log, render, camera_topic)
    source = camera_source(log, camera_topic, chosen, record.mounting, record.field_of_view_rad)
    scene = _scene(lanes, paths, stamp_ns, log_time_ns, width_m, camera_forward_m, source)
    notes = []
    if len(scene.stamp_ns) < len(stamp_ns):
        notes.append(
            f"{len(stamp_ns) - len(scene.stamp_ns)} of {len(stamp_ns)} paths are not drawn: no frame of a known size "
            "has their stamp"
        )
    lines = write_image_lines(
        OBSERVER_PATH_LINES,
        stamp_ns=scene.stamp_ns,
        log_time_ns=scene.log_time_ns,
        shapes=lambda start, stop: [_shapes(scene, row) for row in range(start, stop)],
    )
    channels = [lines]
    if render is not None:
        channels.append(_rendered(log, scene, camera_topic, render))
    return Overlay(tuple(channels), tuple(notes))


@dataclass(frozen=True)
class _LanesRecord:
    mounting: Mounting
    field_of_view_rad: float | None
    topics: Mapping[str, str]
    camera_topic: str


def _lanes_record(log: Log) -> _LanesRecord:
    """How `cwcli lanes` was run on this log; its defaults where the log does not tell."""
    record = run_records(log).get(LANES_STAGE, {})
    configuration = configuration_of(record)
    mounting, topics = (configuration.get(name) for name in ("mounting", "topics"))
    given = mounting if isinstance(mounting, dict) else {}
    names = [entry.name for entry in fields(Mounting) if math.isfinite(number(given, entry.name))]
    angle = number(configuration, "field_of_view_rad")
    cameras = [str(entry.get("topic")) for entry in inputs_of(record) if entry.get("role") == Role.CAMERA.value]
    return _LanesRecord(
        mounting=Mounting(**{name: number(given, name) for name in names}),
        field_of_view_rad=angle if 0.0 < angle < math.pi else None,
        topics={str(role): str(topic) for role, topic in topics.items()} if isinstance(topics, dict) else {},
        camera_topic=cameras[0] if cameras else "",
    )


def _camera_topic(log: Log, topics: Mapping[str, str], recorded: str, *, is_needed: bool) -> str:
    """The frames' topic: the user's, else that of the lanes, else the only camera of the log."""
    if Role.CAMERA.value not in topics and recorded in {channel.topic for channel in log.channels}:
        return recorded
    required, optional = ((Role.CAMERA,), ()) if is_needed else ((), (Role.CAMERA,))
    bound = bind(log.channels, topics, required=required, optional=optional, where=log.name, command="predict")
    return bound.topic(Role.CAMERA) or recorded


def _scene(
    lanes: LaneRows,
    paths: Paths,
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    width_m: float,
    camera_forward_m: float,
    source: CameraSource,
) -> _Scene:
    """Each path with the frame of its stamp, in the order of time; a stamp counts once."""
    frames = rows_by_stamp(lanes.stamp_ns)
    frames = frames[(lanes.image_size[frames] > 0).all(axis=1) & (lanes.search_size[frames] > 0).all(axis=1)]
    starts = np.sort(rows_by_stamp(stamp_ns))
    _, mine, theirs = np.intersect1d(stamp_ns[starts], lanes.stamp_ns[frames], return_indices=True)
    order = np.argsort(mine)
    rows, lane_rows = starts[mine[order]], frames[theirs[order]]
    return _Scene(
        stamp_ns[rows], log_time_ns[rows], paths.take(rows), width_m, camera_forward_m, source, lanes, lane_rows
    )


def _shapes(scene: _Scene, row: int) -> list[Shape]:
    """What is drawn on a frame: the 90 % band, the car's width, the middle."""
    lines = scene.lines(row)
    thin = line_thickness_px(scene.image_size(row)[0])
    band = lines.band()
    shapes: list[Shape] = []
    if len(band) > 2:
        shapes.append(Shape(LINE_LOOP, band, (*PATH_RGB, 0.0), (*PATH_RGB, FILL_ALPHA), 1.0))
    for name, alpha in LINE_ALPHA.items():
        points = lines.line(name)
        if len(points) > 1:
            thickness = thin if name == "centre" else thin / 2
            shapes.append(Shape(LINE_STRIP, points, (*PATH_RGB, alpha), NO_COLOUR, thickness))
    return shapes


def _rendered(log: Log, scene: _Scene, camera_topic: str, target: str) -> StreamedChannel:
    row_of = {stamp: row for row, stamp in enumerate(scene.stamp_ns.tolist())}
    where = f"{log.name}: {camera_topic}"

    def images(prepare: Callable[[DecodedFrame], object]) -> Iterator[DecodedFrame]:
        return decode_frames(log.frames(camera_topic), size_of=None, prepare=prepare, where=where)

    def paint(row: int, image: Image) -> Image:
        return paint_path(burn_in(image, scene.boundaries(row)), scene.lines(row))

    frame_id = next((frame.frame_id for frame in log.frames(camera_topic)), "")
    return painted_channel(
        target,
        stamp_ns=scene.stamp_ns,
        log_time_ns=scene.log_time_ns,
        frame_id=frame_id,
        images=images,
        row_of=lambda decoded: row_of.get(decoded.stamp_ns, -1),
        paint=paint,
    )
