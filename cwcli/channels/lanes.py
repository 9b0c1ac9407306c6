"""`cwcli.v1.Lanes`: the lane boundaries of each frame; drawn for viewers, and burnt into the frames."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from functools import lru_cache, partial

import numpy as np
import numpy.typing as npt

from cwcli.channels.image_lines import (
    LINE_STRIP,
    ImageLabel,
    ImageShape,
    line_thickness_px,
    make_image_annotation_channel,
)
from cwcli.channels.lens import Lenses, lens_message_fields
from cwcli.channels.output import make_output_channel
from cwcli.channels.painted_frames import StartImages, painted_frames_channel
from cwcli.channels.published import LANE_LINES, LANES
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import Columns, Field, FloatArray, Int64Array, OutputChannel, StreamedChannel
from cwcli.signals.leaf_fields import read_integers, read_numbers
from cwcli.vision.boundary_lines import BoundaryLines
from cwcli.vision.camera import Camera
from cwcli.vision.encoded import Image
from cwcli.vision.fit_columns import FitColumns
from cwcli.vision.ground import MAX_SAMPLE_HEIGHT_SHARE, MIN_DEPTH_BELOW_HORIZON_SHARE, GeometrySigmas, LaneGeometry
from cwcli.vision.method import LaneState
from cwcli.vision.overlay import (
    LEFT_BOUNDARY_RGB,
    N_LINE_POINTS,
    RIGHT_BOUNDARY_RGB,
    boundary_labels,
    boundary_points_in_image,
    draw_boundaries,
    label_letter_height_px,
    label_position_px,
)

BOUNDARY_SIDES = ("left", "right")
"""Names of the two boundaries, in the order of all arrays."""
IMAGE_PARABOLA_FIELDS_OF_BOUNDARY = ("a", "b", "c")
"""Fields of a boundary as a parabola in the searched image."""
ROAD_LINE_FIELDS = ("lateral_m", "slope", "ground_curvature_1pm")
"""Fields of a boundary on the road, x ahead and y to the left in m: y = lateral + slope x + curvature x^2 / 2."""
MAX_OFFSET_M_SLOPE_AND_CURVATURE_1PM = np.array([1e3, 10.0, 1.0])
"""Largest plausible distance (m), slope (1) and curvature (1/m) of a boundary on the road; chosen by hand."""
MAX_CURVATURE_CHANGE_1PM2 = 1.0
"""Largest plausible change of curvature along the lane, 1/m^2; chosen by hand."""
IMAGE_CURVE_FIELDS_OF_BOUNDARY = ("far_px", "near", "bend_px2", "spiral_px3")
"""Fields of a boundary in the image, h rows below the horizon: x = far + near h + bend / h + spiral / h^2 (px)."""
PINHOLE_FIELDS = ("road_centre_px", "road_focal_px")
"""Fields of the pinhole camera that projects the road: image column of its axis and focal length, both px."""
PREVIEW_POINT_FIELDS = ("lateral_deviation_m", "heading_deviation_rad", "curvature_1pm")
"""Fields of the lane at the preview point."""
PREVIEW_SIGMA_FIELDS = ("lateral_deviation_sigma_m", "heading_deviation_sigma_rad", "curvature_sigma_1pm")
"""Fields of the standard errors of the lane at the preview point."""
FIELDS_FOR_ROAD_BOUNDARIES = (
    *("stamp_ns", "state", "steady_s", "curvature_change_1pm2"),
    *(f"{side}.{name}" for side in BOUNDARY_SIDES for name in ("found", *ROAD_LINE_FIELDS)),
)
"""Fields from which the boundaries on the road are computed."""
FIELDS_FOR_OBSERVER = (
    *("stamp_ns", "state", *PREVIEW_POINT_FIELDS, *PREVIEW_SIGMA_FIELDS, "preview_distance_m", "camera_yaw_sigma_rad"),
    *("curvature_change_1pm2", *PINHOLE_FIELDS),
    *(
        f"{side}.{name}"
        for side in BOUNDARY_SIDES
        for name in ("found", *ROAD_LINE_FIELDS, *IMAGE_CURVE_FIELDS_OF_BOUNDARY)
    ),
)
"""Fields that the observer reads: those of the preview point and of the boundaries' shape."""


@dataclass(frozen=True)
class LaneFrames:
    """The used frames of a camera, n rows.

    Attributes:
        index: Shape (n,): number of the frame in its channel.
        log_time_ns, stamp_ns: Shape (n,).
        image_size: Shape (n, 2): width and height of the camera's image, pixels.
        search_size: Shape (n, 2): width and height of the searched image, pixels.
        horizon_px: Shape (n,): row in the search image, NaN where not known.
        camera_pitch_rad, camera_yaw_rad: Shape (n,): as used; nose down and counter-clockwise positive.
        roads: Shape (n, 2, 4): the boundaries as roads (`ground.image_hyperbolas_of_flat_road`).
        top_px: Shape (n,): row in the search image at which boundaries end.
        pinhole: Shape (n, 2): `BoundaryLines.pinhole`.
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
    roads: FloatArray
    top_px: FloatArray
    pinhole: FloatArray
    geometry: LaneGeometry
    preview_m: float
    rectified_from: Callable[[int, int], Camera] | None = None

    def __len__(self) -> int:
        return len(self.index)


def make_lanes_channel(frames: LaneFrames) -> OutputChannel:
    """Make the channel of `cwcli.v1.Lanes`, one message a frame."""
    geometry, fits, n = frames.geometry, frames.fits, len(frames)
    fields: dict[str, Field] = {"stamp_ns": frames.stamp_ns}
    for k, (side, road) in enumerate(zip(BOUNDARY_SIDES, (geometry.left_body, geometry.right_body), strict=True)):
        fields |= {
            f"{side}.{name}": fits.parabolas[:, k, i] for i, name in enumerate(IMAGE_PARABOLA_FIELDS_OF_BOUNDARY)
        }
        fields |= {f"{side}.{name}": road[:, i] for i, name in enumerate(ROAD_LINE_FIELDS)}
        fields |= {f"{side}.{name}": frames.roads[:, k, i] for i, name in enumerate(IMAGE_CURVE_FIELDS_OF_BOUNDARY)}
        fields |= {
            f"{side}.score": fits.score[:, k],
            f"{side}.probability": fits.probability[:, k],
            f"{side}.found": fits.found[:, k],
            f"{side}.kind": fits.kind[:, k].astype(np.int32),
            f"{side}.colour": fits.colour[:, k].astype(np.int32),
        }
    fields |= {
        "lateral_deviation_m": geometry.lateral_deviation_m,
        "heading_deviation_rad": geometry.heading_deviation_rad,
        "curvature_1pm": geometry.curvature_1pm,
        "curvature_change_1pm2": geometry.curvature_change_1pm2,
        "lateral_deviation_sigma_m": geometry.lateral_deviation_sigma_m,
        "heading_deviation_sigma_rad": geometry.heading_deviation_sigma_rad,
        "curvature_sigma_1pm": geometry.curvature_sigma_1pm,
        "preview_distance_m": np.full(n, frames.preview_m),
        "search_width_px": frames.search_size[:, 0],
        "search_height_px": frames.search_size[:, 1],
        "lane_width_m": geometry.lane_width_m,
        "camera_pitch_rad": frames.camera_pitch_rad,
        "camera_yaw_rad": frames.camera_yaw_rad,
        "image_width_px": frames.image_size[:, 0],
        "image_height_px": frames.image_size[:, 1],
        "camera_yaw_sigma_rad": np.full(n, GeometrySigmas().yaw_rad),
        "horizon_px": frames.horizon_px,
        "top_px": frames.top_px,
        **{name: frames.pinhole[:, k] for k, name in enumerate(PINHOLE_FIELDS)},
        "state": fits.state.astype(np.int32),
        "steady_s": fits.steady_s,
        "lane_change": fits.lane_change.astype(np.int32),
    }
    if frames.rectified_from is not None:
        fields |= lens_message_fields(frames.rectified_from, frames.image_size)
    return make_output_channel(LANES, frames.log_time_ns, fields)


@dataclass(frozen=True)
class LaneRows:
    """Frames of a channel of lanes, n rows in log-time order; unknown values are NaN, or 0 for integers.

    Attributes:
        log_time_ns, stamp_ns: Shape (n,).
        found: Shape (n, 2): left, right.
        image_boundaries: Where the boundaries are drawn in the searched image.
        road: Shape (n, 2, 3): `ROAD_LINE_FIELDS`.
        curvature_change_1pm2: Shape (n,): right positive; 0 where unknown.
        preview, preview_sigma: Shape (n, 3): `PREVIEW` and its sigmas.
        preview_m, lane_width_m, camera_pitch_rad, camera_yaw_rad, camera_yaw_sigma_rad: Shape (n,).
        image_size, search_size: Shape (n, 2): width and height of the camera's image and of the searched one, pixels.
        lenses: The cameras of frames that were rectified before the search.
        state: Shape (n,): values of `vision.method.LaneState`.
        lane_change: Shape (n,): 1 where the camera has entered the next lane to the left, -1 to the right.
        steady_s: Shape (n,): time since the lane estimate last jumped.
    """

    log_time_ns: Int64Array
    stamp_ns: Int64Array
    found: npt.NDArray[np.bool_]
    image_boundaries: BoundaryLines
    road: FloatArray
    curvature_change_1pm2: FloatArray
    preview: FloatArray
    preview_sigma: FloatArray
    preview_m: FloatArray
    lane_width_m: FloatArray
    camera_pitch_rad: FloatArray
    camera_yaw_rad: FloatArray
    camera_yaw_sigma_rad: FloatArray
    image_size: Int64Array
    search_size: Int64Array
    lenses: Lenses
    state: Int64Array
    steady_s: FloatArray
    lane_change: Int64Array

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def least_camera_yaw_sigma_rad_or_zero(self) -> float:
        """Share of the camera's yaw error in the heading sigmas: the least value of all frames, 0 if unknown."""
        told_rad = self.camera_yaw_sigma_rad
        known = told_rad[np.isfinite(told_rad) & (told_rad >= 0.0)]
        return float(known.min(initial=math.pi)) if len(known) else 0.0

    def plausible_offset_slope_curvature_of_boundaries(self) -> FloatArray:
        """Lateral offset, slope and curvature of the boundaries found, shape (n, 2, 3); NaN where implausible."""
        with np.errstate(invalid="ignore"):
            is_line = self.found & (np.abs(self.road) <= MAX_OFFSET_M_SLOPE_AND_CURVATURE_1PM).all(axis=2)
            is_line &= np.abs(self.curvature_change_1pm2[:, None]) <= MAX_CURVATURE_CHANGE_1PM2
        return np.where(is_line[..., None], self.road, np.nan)

    def curved_offset_slope_curvature_of_boundaries(self) -> FloatArray:
        """The plausible road lines that are circles or clothoids, shape (n, 2, 3); NaN where no curve was fitted."""
        assert self.image_boundaries.pinhole is not None, "as they are read"
        is_curve = np.isfinite(self.image_boundaries.roads).all(axis=2) & np.isfinite(
            self.image_boundaries.pinhole[:, :1]
        )
        return np.where(is_curve[..., None], self.plausible_offset_slope_curvature_of_boundaries(), np.nan)

    def boundaries_in_pixels(self, row: int, image_size: tuple[int, int]) -> list[FloatArray]:
        """The left and the right boundary of a frame in the pixels of an image of it, shape (k, 2) each.

        Args:
            row: Row of the frame; its search size is known.
            image_size: Width and height of the image.
        """
        camera = self.lenses.camera_before_rectification(row)
        if camera is not None and (camera.width_px, camera.height_px) != image_size:
            camera = camera.with_image_size(*image_size)
        width_px, height_px = self.search_size[row].tolist()
        points, is_in = boundary_points_in_image(
            self.image_boundaries[slice(row, row + 1)], (width_px, height_px), image_size, camera
        )
        return [points[0, side][is_in[0, side]] for side in range(2)]


def read_lanes(columns: Columns, *, required: Collection[str] = ()) -> LaneRows:
    """Read the frames of a channel of lanes or of lane truth; impossible numbers stay, as callers count such frames.

    Raises:
        DataError: A required field is missing.
    """

    def stack_fields(*names: str) -> FloatArray:
        values = [
            read_numbers(columns, name, required=name in required, takes_impossible_numbers=True) for name in names
        ]
        return np.stack(values, axis=-1)

    def read_size_px(what: str) -> Int64Array:
        return np.stack([read_integers(columns, f"{what}_{side}_px")[0] for side in ("width", "height")], axis=-1)

    def stack_fields_of_sides(names: Sequence[str]) -> FloatArray:
        return np.stack([stack_fields(*(f"{side}.{name}" for name in names)) for side in BOUNDARY_SIDES], axis=1)

    found = stack_fields_of_sides(["found"])[..., 0] > 0.0
    state = read_integers(columns, "state")[0]
    return LaneRows(
        log_time_ns=columns.log_time_ns,
        stamp_ns=read_integers(columns, "stamp_ns", required="stamp_ns" in required)[0],
        found=found,
        image_boundaries=_read_image_boundaries(
            columns,
            *(
                np.where(found[..., None], stack_fields_of_sides(names), np.nan)
                for names in (IMAGE_PARABOLA_FIELDS_OF_BOUNDARY, IMAGE_CURVE_FIELDS_OF_BOUNDARY)
            ),
        ),
        road=stack_fields_of_sides(ROAD_LINE_FIELDS),
        curvature_change_1pm2=_replace_nan_and_infinity_by_zero(read_numbers(columns, "curvature_change_1pm2")),
        preview=stack_fields(*PREVIEW_POINT_FIELDS),
        preview_sigma=stack_fields(*PREVIEW_SIGMA_FIELDS),
        preview_m=stack_fields("preview_distance_m")[:, 0],
        lane_width_m=read_numbers(columns, "lane_width_m"),
        camera_pitch_rad=read_numbers(columns, "camera_pitch_rad"),
        camera_yaw_rad=read_numbers(columns, "camera_yaw_rad"),
        camera_yaw_sigma_rad=read_numbers(columns, "camera_yaw_sigma_rad"),
        image_size=read_size_px("image"),
        search_size=read_size_px("search"),
        lenses=Lenses(columns),
        state=state,
        steady_s=np.where(state == LaneState.UNTOLD, np.nan, read_numbers(columns, "steady_s")),
        lane_change=read_integers(columns, "lane_change")[0],
    )


def _replace_nan_and_infinity_by_zero(values: FloatArray) -> FloatArray:
    """The values, with 0 for those that are not finite."""
    return np.where(np.isfinite(values), values, 0.0)


def _read_image_boundaries(columns: Columns, parabolas: FloatArray, roads: FloatArray) -> BoundaryLines:
    """The boundaries in the image; fields that older versions did not write are NaN or replaced."""
    horizon_px, height_px = read_numbers(columns, "horizon_px"), read_numbers(columns, "search_height_px")
    older_px = np.fmax(
        (1.0 - MAX_SAMPLE_HEIGHT_SHARE) * height_px, horizon_px + MIN_DEPTH_BELOW_HORIZON_SHARE * height_px
    )
    top_px = read_numbers(columns, "top_px")
    pinhole = np.stack([read_numbers(columns, name) for name in PINHOLE_FIELDS], axis=-1)
    pinhole = np.where(pinhole[:, 1:] > 0.0, pinhole, np.nan)
    roads[..., 3] = np.where(np.isnan(roads[..., 2]), np.nan, _replace_nan_and_infinity_by_zero(roads[..., 3]))
    return BoundaryLines(parabolas, roads, horizon_px, np.where(np.isnan(top_px), older_px, top_px), pinhole)


def make_lane_annotation_channel(frames: LaneFrames) -> StreamedChannel:
    """Make the channel of the boundaries found, as annotations in the pixels of the camera's image."""
    lines = lru_cache(maxsize=1)(
        partial(_visible_boundary_points_px, frames)
    )  # shapes and labels are made of the same rows in turn

    def image_shapes_of_frames(start: int, stop: int) -> list[list[ImageShape]]:
        return [
            [
                ImageShape(LINE_STRIP, line, (*colour, 1.0), None, line_thickness_px(width_px))
                for line, colour in zip(pair, (LEFT_BOUNDARY_RGB, RIGHT_BOUNDARY_RGB), strict=True)
                if len(line) > 1
            ]
            for pair, width_px in zip(lines(start, stop), frames.image_size[start:stop, 0].tolist(), strict=True)
        ]

    def image_labels_of_frames(start: int, stop: int) -> list[list[ImageLabel]]:
        texts = boundary_labels(frames.fits[slice(start, stop)])
        if not any(any(pair) for pair in texts):
            return [[] for _ in texts]
        return [
            [
                ImageLabel(text, label_position_px(line, width_px), (*colour, 1.0), label_letter_height_px(width_px))
                for text, line, colour in zip(names, pair, (LEFT_BOUNDARY_RGB, RIGHT_BOUNDARY_RGB), strict=True)
                if text and len(line) > 1
            ]
            for names, pair, width_px in zip(
                texts, lines(start, stop), frames.image_size[start:stop, 0].tolist(), strict=True
            )
        ]

    return make_image_annotation_channel(
        LANE_LINES,
        stamp_ns=frames.stamp_ns,
        log_time_ns=frames.log_time_ns,
        shapes=image_shapes_of_frames,
        labels=image_labels_of_frames,
    )


def make_channel_of_frames_with_lanes(
    frames: LaneFrames, topic: str, *, frame_id: str, images: StartImages
) -> StreamedChannel:
    """The camera's frames with the lines burnt in, as JPEG `foxglove.CompressedImage`, made while they are written.

    Args:
        images: Restarts the camera's frames in colour and calls its argument with each frame, in the decoder's thread.
    """
    row_of = {index: row for row, index in enumerate(frames.index.tolist())}

    def draw_boundaries_of_frame(row: int, image: Image) -> Image:
        points, is_in = _boundary_points_px_and_visibility(frames, slice(row, row + 1))
        lines = [points[0, side][is_in[0, side]] for side in range(2)]
        return draw_boundaries(image, lines, boundary_labels(frames.fits[slice(row, row + 1)])[0])

    return painted_frames_channel(
        topic,
        stamp_ns=frames.stamp_ns,
        log_time_ns=frames.log_time_ns,
        frame_id=frame_id,
        images=images,
        row_of=lambda decoded: row_of.get(decoded.index, -1),
        paint=draw_boundaries_of_frame,
    )


def _visible_boundary_points_px(frames: LaneFrames, start: int, stop: int) -> list[tuple[FloatArray, FloatArray]]:
    """The visible points of the left and right boundary of each row, shape (k, 2) each: u, v in pixels."""
    points, is_in = _boundary_points_px_and_visibility(frames, slice(start, stop))
    flat = points[is_in]
    ends: list[int] = np.cumsum(np.count_nonzero(is_in, axis=2)).tolist()
    lines = [flat[first:last] for first, last in zip([0, *ends], ends, strict=False)]
    return list(zip(lines[::2], lines[1::2], strict=True))


def _boundary_points_px_and_visibility(frames: LaneFrames, at: slice) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Points (m, 2, N_POINTS, 2) in pixels and their visibility (m, 2, N_POINTS), for rows of any image sizes."""
    sizes = np.column_stack([frames.search_size[at], frames.image_size[at]])
    points, is_in = np.zeros((len(sizes), 2, N_LINE_POINTS, 2)), np.zeros((len(sizes), 2, N_LINE_POINTS), np.bool_)
    drawn = BoundaryLines(frames.fits.parabolas, frames.roads, frames.horizon_px, frames.top_px, frames.pinhole)[at]
    for search_w, search_h, image_w, image_h in sorted(set(map(tuple, sizes.tolist()))):
        rows = np.flatnonzero((sizes == (search_w, search_h, image_w, image_h)).all(axis=1))
        camera = None if frames.rectified_from is None else frames.rectified_from(image_w, image_h)
        points_in_image = boundary_points_in_image(drawn[rows], (search_w, search_h), (image_w, image_h), camera)
        points[rows], is_in[rows] = points_in_image
    return points, is_in
