"""The channels of `lanes`: numbers, annotations for viewers, and frames with the lines burnt in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.channels.lens import lens_fields
from cwcli.channels.painted_frames import StartImages, painted_channel
from cwcli.channels.published import LANE_LINES, LANES
from cwcli.signals.columns import (
    FloatArray,
    Int64Array,
    OutputChannel,
    OutputField,
    Repeated,
    StreamedChannel,
)
from cwcli.vision.camera import Camera
from cwcli.vision.fit_columns import FitColumns
from cwcli.vision.ground import GeometrySigmas, LaneGeometry
from cwcli.vision.overlay import LEFT_RGB, N_POINTS, RIGHT_RGB, burn_in, line_points
from cwcli.vision.raw_images import Image

LINE_STRIP = 3  # foxglove.PointsAnnotation.Type
PIXELS_PER_THICKNESS = 320.0


@dataclass(frozen=True)
class LaneFrames:
    """The used frames of a camera, n rows.

    Attributes:
        index: Shape (n,): number of the frame in its channel.
        log_time_ns, stamp_ns: Shape (n,).
        image_size: Shape (n, 2): width and height of the camera's image, pixels.
        search_size: Shape (n, 2): of the image that was searched.
        horizon_px: Shape (n,): row in the search image, NaN where not known.
        camera_pitch_rad, camera_yaw_rad: Shape (n,): as used; nose down and counter-clockwise positive.
        fits: n rows.
        geometry: n rows.
        preview_m: Distance of the preview point.
        rectified_from: Width and height of an image -> the camera whose frames were rectified before the search; None:
            they were searched as they are.
    """

    index: Int64Array
    log_time_ns: Int64Array
    stamp_ns: Int64Array
    image_size: Int64Array
    search_size: Int64Array
    horizon_px: FloatArray
    camera_pitch_rad: FloatArray
    camera_yaw_rad: FloatArray
    fits: FitColumns
    geometry: LaneGeometry
    preview_m: float
    rectified_from: Callable[[int, int], Camera] | None = None

    def __len__(self) -> int:
        return len(self.index)


def lanes_channel(frames: LaneFrames) -> OutputChannel:
    """`cwcli.v1.Lanes`, one message a frame."""
    geometry = frames.geometry
    fields: dict[str, OutputField] = {"stamp_ns": frames.stamp_ns}
    for side, (name, body) in enumerate((("left", geometry.left_body), ("right", geometry.right_body))):
        for k, parameter in enumerate("abc"):
            fields[f"{name}.{parameter}"] = frames.fits.parabolas[:, side, k]
        fields[f"{name}.score"] = frames.fits.score[:, side]
        fields[f"{name}.probability"] = frames.fits.probability[:, side]
        fields[f"{name}.found"] = frames.fits.found[:, side]
        for k, parameter in enumerate(("lateral_m", "slope", "ground_curvature_1pm")):
            fields[f"{name}.{parameter}"] = body[:, k]
    fields |= {
        "lateral_deviation_m": geometry.lateral_deviation_m,
        "heading_deviation_rad": geometry.heading_deviation_rad,
        "curvature_1pm": geometry.curvature_1pm,
        "lateral_deviation_sigma_m": geometry.lateral_deviation_sigma_m,
        "heading_deviation_sigma_rad": geometry.heading_deviation_sigma_rad,
        "curvature_sigma_1pm": geometry.curvature_sigma_1pm,
        "preview_distance_m": np.full(len(frames), frames.preview_m),
        "search_width_px": frames.search_size[:, 0],
        "search_height_px": frames.search_size[:, 1],
        "lane_width_m": geometry.lane_width_m,
        "camera_pitch_rad": frames.camera_pitch_rad,
        "camera_yaw_rad": frames.camera_yaw_rad,
        "image_width_px": frames.image_size[:, 0],
        "image_height_px": frames.image_size[:, 1],
        "camera_yaw_sigma_rad": np.full(len(frames), GeometrySigmas().yaw_rad),
        "horizon_px": frames.horizon_px,
    }
    if frames.rectified_from is not None:
        fields |= lens_fields(frames.rectified_from, frames.image_size)
    return OutputChannel(LANES.topic, "cwcli.v1.Lanes", frames.log_time_ns, fields)


def annotations_channel(frames: LaneFrames) -> StreamedChannel:
    """`foxglove.ImageAnnotations` in the pixels of the camera's image: one line a boundary that was found.

    The time is that of the frame, by which viewers put both together.
    """

    def rows(start: int, stop: int) -> Mapping[str, OutputField]:
        at = slice(start, stop)
        points, is_in = _points(frames, at)
        has_line = is_in.sum(axis=2) > 1
        lines_of = np.concatenate([[0], np.cumsum(has_line.sum(axis=1))])
        frame_of, side_of = np.nonzero(has_line)
        used = is_in & has_line[..., None]
        points_of = np.concatenate([[0], np.cumsum(used.sum(axis=2)[frame_of, side_of])])
        colours = np.array([LEFT_RGB, RIGHT_RGB])[side_of]
        lines: dict[str, OutputField] = {
            "timestamp": frames.stamp_ns[at][frame_of],
            "type": np.full(len(frame_of), LINE_STRIP),
            "points": Repeated(points_of.astype(np.int64), {"x": points[used][:, 0], "y": points[used][:, 1]}),
            "outline_color.r": colours[:, 0],
            "outline_color.g": colours[:, 1],
            "outline_color.b": colours[:, 2],
            "outline_color.a": np.ones(len(frame_of)),
            "thickness": np.maximum(frames.image_size[at][frame_of, 0] / PIXELS_PER_THICKNESS, 2.0),
        }
        return {"points": Repeated(lines_of.astype(np.int64), lines)}

    return StreamedChannel(LANE_LINES.topic, "foxglove.ImageAnnotations", frames.log_time_ns, rows=rows)


def rendered_channel(frames: LaneFrames, topic: str, *, frame_id: str, images: StartImages) -> StreamedChannel:
    """The camera's frames with the lines burnt in, as JPEG `foxglove.CompressedImage`, made while they are written.

    Args:
        frames: The used frames.
        topic: Where to publish.
        frame_id: Of the camera.
        images: Starts the camera's frames anew, in colour; calls what it is given with each of them, in its thread.
    """
    row_of = {index: row for row, index in enumerate(frames.index.tolist())}

    def paint(row: int, image: Image) -> Image:
        points, is_in = _points(frames, slice(row, row + 1))
        return burn_in(image, [points[0, side][is_in[0, side]] for side in range(2)])

    return painted_channel(
        topic,
        stamp_ns=frames.stamp_ns,
        log_time_ns=frames.log_time_ns,
        frame_id=frame_id,
        images=images,
        row_of=lambda decoded: row_of.get(decoded.index, -1),
        paint=paint,
    )


def _points(frames: LaneFrames, at: slice) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """`line_points` of some rows, whatever their image sizes."""
    sizes = np.column_stack([frames.search_size[at], frames.image_size[at]])
    points, is_in = np.zeros((len(sizes), 2, N_POINTS, 2)), np.zeros((len(sizes), 2, N_POINTS), np.bool_)
    fits, horizon_px = frames.fits[at], frames.horizon_px[at]
    for size in np.unique(sizes, axis=0):
        rows = np.flatnonzero((sizes == size).all(axis=1))
        search_w, search_h, image_w, image_h = size.tolist()
        camera = None if frames.rectified_from is None else frames.rectified_from(image_w, image_h)
        made = line_points(fits[rows], (search_w, search_h), (image_w, image_h), horizon_px[rows], camera)
        points[rows], is_in[rows] = made
    return points, is_in
