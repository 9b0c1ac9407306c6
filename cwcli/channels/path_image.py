"""Predicted paths on the camera's image: annotations for viewers, and frames with the paths burnt in."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cwcli.channels.image_lines import (
    LINE_LOOP,
    LINE_STRIP,
    ImageShape,
    line_thickness_px,
    make_image_annotation_channel,
)
from cwcli.channels.lanes import LaneRows
from cwcli.channels.painted_frames import StartImages, painted_frames_channel
from cwcli.channels.published import OBSERVER_PATH_LINES
from cwcli.lazy_dataclass import dataclass
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import FloatArray, Int64Array, StreamedChannel
from cwcli.signals.row_order import Rows, rows_by_stamp_without_repeats
from cwcli.vision.camera import Camera
from cwcli.vision.encoded import Image
from cwcli.vision.overlay import draw_boundaries
from cwcli.vision.path_overlay import (
    BAND_OPACITY,
    EMPTY_PATH_LINES,
    PATH_RGB,
    BodyPath,
    PathLines,
    draw_path,
    project_path_into_image,
)

OPACITY_BY_PATH_LINE = {"centre": 1.0, "left": 0.6, "right": 0.6}
"""Line of the path -> its opacity, 0 to 1; chosen by eye."""
TRANSPARENT_RGBA = (0.0, 0.0, 0.0, 0.0)
"""A fully transparent colour: red, green, blue and alpha, 0 to 1 each."""


@dataclass(frozen=True)
class Viewpoint:
    """The car and its camera.

    Attributes:
        camera: Width and height of an image, px -> its camera.
        forward_m: Distance of the camera ahead of the centre of gravity.
    """

    camera: Callable[[int, int], Camera]
    width_m: float
    forward_m: float = 0.0


@dataclass(frozen=True)
class PathFrames:
    """Paths paired with the camera frames of the same time, n rows in time order, and the lanes of the frames.

    Attributes:
        stamp_ns, log_time_ns: Shape (n,).
        paths: In the body frame of their start, from the centre of gravity.
        lane_rows: Shape (n,): row of `lanes` that belongs to each path.
    """

    stamp_ns: Int64Array
    log_time_ns: Int64Array
    paths: Paths
    viewpoint: Viewpoint
    lanes: LaneRows
    lane_rows: Rows

    @classmethod
    def pair_paths_with_frames_of_same_stamp(
        cls, paths: Paths, stamp_ns: Int64Array, log_time_ns: Int64Array, lanes: LaneRows, viewpoint: Viewpoint
    ) -> PathFrames:
        """Pair paths with frames of the same stamp and of known size; repeated stamps are used once.

        Args:
            paths: m paths.
            stamp_ns, log_time_ns: Shape (m,): times of their starts.
        """
        frames = rows_by_stamp_without_repeats(lanes.stamp_ns)
        frames = frames[(lanes.image_size[frames] > 0).all(axis=1) & (lanes.search_size[frames] > 0).all(axis=1)]
        starts = np.sort(rows_by_stamp_without_repeats(stamp_ns))
        _, mine, theirs = np.intersect1d(stamp_ns[starts], lanes.stamp_ns[frames], return_indices=True)
        order = np.argsort(mine)
        rows, lane_rows = starts[mine[order]], frames[theirs[order]]
        return cls(stamp_ns[rows], log_time_ns[rows], paths.paths_of_rows(rows), viewpoint, lanes, lane_rows)

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def image_size_px(self, row: int) -> tuple[int, int]:
        """Width and height of a frame in pixels."""
        width_px, height_px = self.lanes.image_size[self.lane_rows[row]].tolist()
        return width_px, height_px

    def camera_of_frame(self, row: int) -> Camera:
        """The camera of a frame, with its pitch and yaw at that time."""
        at = self.lane_rows[row]
        return self.viewpoint.camera(*self.image_size_px(row)).with_pitch_and_yaw(
            pitch_rad=float(self.lanes.camera_pitch_rad[at]), yaw_rad=float(self.lanes.camera_yaw_rad[at])
        )

    def path_in_pixels(self, row: int) -> PathLines:
        """The path of a frame in pixels; empty where there is no path."""
        paths, viewpoint = self.paths, self.viewpoint
        if not np.isfinite(paths.x_m[row]).all():
            return EMPTY_PATH_LINES
        path = BodyPath(
            paths.x_m[row], paths.y_m[row], paths.heading_rad[row], np.nan_to_num(paths.position_covariance_m2[row])
        )
        return project_path_into_image(
            path, self.camera_of_frame(row), width_m=viewpoint.width_m, camera_forward_m=viewpoint.forward_m
        )

    def lane_boundaries_in_pixels(self, row: int) -> list[FloatArray]:
        """The lane boundaries, left and right, in the frame's pixels."""
        return self.lanes.boundaries_in_pixels(int(self.lane_rows[row]), self.image_size_px(row))


def make_path_annotation_channel(frames: PathFrames) -> StreamedChannel:
    """Make the channel of the paths, as annotations in the pixels of the camera's image."""
    return make_image_annotation_channel(
        OBSERVER_PATH_LINES,
        stamp_ns=frames.stamp_ns,
        log_time_ns=frames.log_time_ns,
        shapes=lambda start, stop: [_path_shapes(frames, row) for row in range(start, stop)],
    )


def make_channel_of_frames_with_paths(
    frames: PathFrames, topic: str, *, frame_id: str, images: StartImages
) -> StreamedChannel:
    """Make the channel of the camera's frames with lanes and path painted on them while the log is written.

    Args:
        images: Restarts the camera's frames in colour and calls its argument with each frame, in the decoder's thread.
    """
    row_of = {stamp: row for row, stamp in enumerate(frames.stamp_ns.tolist())}

    def draw_path_of_frame(row: int, image: Image) -> Image:
        return draw_path(draw_boundaries(image, frames.lane_boundaries_in_pixels(row)), frames.path_in_pixels(row))

    return painted_frames_channel(
        topic,
        stamp_ns=frames.stamp_ns,
        log_time_ns=frames.log_time_ns,
        frame_id=frame_id,
        images=images,
        row_of=lambda decoded: row_of.get(decoded.stamp_ns, -1),
        paint=draw_path_of_frame,
    )


def _path_shapes(frames: PathFrames, row: int) -> list[ImageShape]:
    """The shapes drawn on a frame: the 90 % band, both edges of the car's width, and the centre line."""
    lines = frames.path_in_pixels(row)
    thin = line_thickness_px(frames.image_size_px(row)[0])
    band = lines.band_90_percent_polygon_uv_px()
    shapes: list[ImageShape] = []
    if len(band) > 2:
        shapes.append(ImageShape(LINE_LOOP, band, (*PATH_RGB, 0.0), (*PATH_RGB, BAND_OPACITY), 1.0))
    for name, alpha in OPACITY_BY_PATH_LINE.items():
        points = lines.visible_points_of_line(name)
        if len(points) > 1:
            thickness = thin if name == "centre" else thin / 2
            shapes.append(ImageShape(LINE_STRIP, points, (*PATH_RGB, alpha), TRANSPARENT_RGBA, thickness))
    return shapes
