"""The predicted path on the camera's image: annotations for viewers, and frames with the path burnt in.

The camera is that of `cwcli lanes`, whose record in the log tells the mounting; pitch and yaw are those of each frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from cwcli.channels.binding import bind
from cwcli.channels.lanes import LINE_STRIP, PIXELS_PER_THICKNESS
from cwcli.channels.lens import Lenses
from cwcli.channels.painted_frames import painted_channel
from cwcli.channels.published import LANES, OBSERVER_PATH_LINES
from cwcli.channels.render_topic import check_render_topic
from cwcli.errors import MissingSignalError
from cwcli.logs.log import Log
from cwcli.prediction.paths import Paths
from cwcli.signals.codec import Role
from cwcli.signals.columns import Columns, FloatArray, Int64Array, OutputField, Repeated, StreamedChannel
from cwcli.stages.inputs.camera import CameraSource, camera_source
from cwcli.stages.records import configuration_of, inputs_of, number, run_records
from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.fit_columns import FitColumns
from cwcli.vision.frames import DecodedFrame, decode_frames
from cwcli.vision.overlay import burn_in, line_points
from cwcli.vision.path_overlay import FILL_ALPHA, NOTHING, PATH_RGB, BodyPath, PathLines, paint_path, path_lines
from cwcli.vision.raw_images import Image

LANES_STAGE = "lanes"
LINE_LOOP = 2  # foxglove.PointsAnnotation.Type
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
    pitch_rad: FloatArray
    yaw_rad: FloatArray
    image_size: Int64Array
    search_size: Int64Array
    parabolas: FloatArray
    lenses: Sequence[Camera | None]

    def camera(self, row: int) -> Camera:
        """The camera of a frame."""
        camera = self.source.camera(*self.image_size[row].tolist())
        return camera.turned(pitch_rad=float(self.pitch_rad[row]), yaw_rad=float(self.yaw_rad[row]))

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
        nan = np.full((1, 2), np.nan)
        fits = FitColumns(
            self.parabolas[row : row + 1],
            nan,
            nan,
            np.isfinite(self.parabolas[row : row + 1, :, 0]),
            np.full((1, 2, 3, 3), np.nan),
            self.pitch_rad[row : row + 1],
            self.yaw_rad[row : row + 1],
        )
        width_px, height_px = self.search_size[row].tolist()
        horizon_px = self.camera(row).resized(width_px, height_px).horizon_v_px()
        image_w, image_h = self.image_size[row].tolist()
        points, is_in = line_points(fits, (width_px, height_px), (image_w, image_h), horizon_px, self.lenses[row])
        return [points[0, side][is_in[0, side]] for side in range(2)]


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
    columns = log.columns(LANES.topic)
    camera_topic = _camera_topic(log, chosen, record.camera_topic, is_needed=render is not None)
    check_render_topic(log, render, camera_topic)
    source = camera_source(log, camera_topic, chosen, record.mounting, record.field_of_view_rad)
    scene = _scene(columns, paths, stamp_ns, log_time_ns, width_m, camera_forward_m, source)
    notes = []
    if len(scene.stamp_ns) < len(stamp_ns):
        notes.append(
            f"{len(stamp_ns) - len(scene.stamp_ns)} of {len(stamp_ns)} paths are not drawn: no frame of a known size "
            "has their stamp"
        )
    channels = [_annotations(scene)]
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
    columns: Columns,
    paths: Paths,
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    width_m: float,
    camera_forward_m: float,
    source: CameraSource,
) -> _Scene:
    """Each path with the frame of its stamp, in the order of time; a stamp counts once."""

    def numbers(name: str) -> FloatArray:
        return np.asarray(columns.fields[name], np.float64)

    lane_stamp_ns, lane_row = np.unique(np.asarray(columns.fields["stamp_ns"], np.int64), return_index=True)
    _, first = np.unique(stamp_ns, return_index=True)
    rows = np.sort(first)
    at = np.minimum(np.searchsorted(lane_stamp_ns, stamp_ns[rows]), max(len(lane_stamp_ns) - 1, 0))
    has_frame = lane_stamp_ns[at] == stamp_ns[rows] if len(lane_stamp_ns) else np.zeros(len(rows), np.bool_)
    rows, lanes = rows[has_frame], lane_row[at[has_frame]] if len(lane_stamp_ns) else rows[:0]
    image_size, search_size = _sizes(columns, "image", lanes), _sizes(columns, "search", lanes)
    has_size = (image_size > 0).all(axis=1) & (search_size > 0).all(axis=1)
    rows, lanes, image_size, search_size = (each[has_size] for each in (rows, lanes, image_size, search_size))
    found = np.stack([np.stack([numbers(f"{side}.{k}") for k in "abc"], axis=-1) for side in ("left", "right")], axis=1)
    lenses = Lenses(columns)
    return _Scene(
        stamp_ns=stamp_ns[rows],
        log_time_ns=log_time_ns[rows],
        paths=paths.take(rows),
        width_m=width_m,
        camera_forward_m=camera_forward_m,
        source=source,
        pitch_rad=numbers("camera_pitch_rad")[lanes],
        yaw_rad=numbers("camera_yaw_rad")[lanes],
        image_size=image_size,
        search_size=search_size,
        parabolas=found[lanes],
        lenses=[lenses.camera(row) for row in lanes.tolist()],
    )


def _sizes(columns: Columns, what: str, rows: npt.NDArray[np.intp]) -> Int64Array:
    """Shape (n, 2): width and height."""
    return np.stack(
        [np.asarray(columns.fields[f"{what}_{side}_px"], np.int64)[rows] for side in ("width", "height")], 1
    )


def _annotations(scene: _Scene) -> StreamedChannel:
    """`foxglove.ImageAnnotations`, one message a frame: the 90 % band, the car's width, the middle."""

    def rows(start: int, stop: int) -> Mapping[str, OutputField]:
        shapes = [_shapes(scene, row) for row in range(start, stop)]
        flat = [(scene.stamp_ns[start + k], *shape) for k, each in enumerate(shapes) for shape in each]
        counts = np.cumsum([0, *(len(each) for each in shapes)]).astype(np.int64)
        points = np.concatenate([np.zeros((0, 2)), *(entry[2] for entry in flat)])
        lengths = np.cumsum([0, *(len(entry[2]) for entry in flat)]).astype(np.int64)
        outline = np.array([entry[3] for entry in flat]).reshape(-1, 4)
        fill = np.array([entry[4] for entry in flat]).reshape(-1, 4)
        lines: dict[str, OutputField] = {
            "timestamp": np.array([entry[0] for entry in flat], np.int64),
            "type": np.array([entry[1] for entry in flat], np.int64),
            "points": Repeated(lengths, {"x": points[:, 0], "y": points[:, 1]}),
            **{f"outline_color.{part}": outline[:, k] for k, part in enumerate("rgba")},
            **{f"fill_color.{part}": fill[:, k] for k, part in enumerate("rgba")},
            "thickness": np.array([entry[5] for entry in flat], np.float64),
        }
        return {"points": Repeated(counts, lines)}

    return StreamedChannel(OBSERVER_PATH_LINES.topic, "foxglove.ImageAnnotations", scene.log_time_ns, rows=rows)


_Shape = tuple[int, FloatArray, Sequence[float], Sequence[float], float]


def _shapes(scene: _Scene, row: int) -> list[_Shape]:
    """Type, points, colour of the line and of the area, and thickness of what is drawn in a frame."""
    lines = scene.lines(row)
    thin = max(float(scene.image_size[row, 0]) / PIXELS_PER_THICKNESS, 2.0)
    band = lines.band()
    shapes: list[_Shape] = []
    if len(band) > 2:
        shapes.append((LINE_LOOP, band, (*PATH_RGB, 0.0), (*PATH_RGB, FILL_ALPHA), 1.0))
    for name, alpha in LINE_ALPHA.items():
        points = lines.line(name)
        if len(points) > 1:
            shapes.append((LINE_STRIP, points, (*PATH_RGB, alpha), NO_COLOUR, thin if name == "centre" else thin / 2))
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
