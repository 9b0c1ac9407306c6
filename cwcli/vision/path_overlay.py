"""A path on the road drawn into the camera's image: its middle, the car's width along it, and how uncertain it is.

Paths are in the body frame (x forward, y left of the car's centre line), from the centre of gravity. The road is taken
to be flat. A line is sampled so that its points are about evenly spaced in the image, from the image's lowest row on to
the end of the path; what lies outside the image is left out.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.signals.covariances import xx_xy_yy_covariance_in_turned_axes
from cwcli.signals.normal_distribution import SIGMAS_HOLDING_90_PERCENT
from cwcli.vision.camera import Camera
from cwcli.vision.encoded import Image

N_PATH_POINTS = 32
"""Number of points of a drawn line. Chosen by hand; not fitted."""
PATH_LINE_NAMES = ("centre", "left", "right", "band_left", "band_right")
"""Names of the lines of a drawn path."""
MIN_PATH_START_M = 1.0
"""Least distance ahead of the camera at which a drawn path begins, in metres. Chosen by hand; not fitted."""
DEFAULT_PATH_START_M = 3.0
"""Distance at which a drawn path begins where the image's lowest row looks above the horizon, in metres. Chosen by
hand; not fitted."""

PATH_RGB = (0.1, 0.75, 1.0)
"""Colour of the path: red, green, blue, 0 to 1. Chosen by hand."""
BAND_OPACITY = 0.35
"""Opacity of the 90 % band, 0 to 1. Chosen by hand."""
N_FRACTION_BITS = 4
"""Number of fraction bits in the coordinates that OpenCV draws."""
MAX_DRAWN_COORDINATE_PX = 20_000.0
"""Greatest coordinate that is drawn, in pixels: larger ones overflow OpenCV's fixed-point numbers."""
MIN_DRAWN_LENGTH_M = 1e-3
"""Least length of a path that is drawn, in metres. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class BodyPath:
    """One path in the body frame.

    Attributes:
        x_m, y_m, heading_rad: Shape (k,), from the centre of gravity; x forward, y left.
        position_covariance_m2: Shape (k, 3): xx, xy, yy.
    """

    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    position_covariance_m2: FloatArray


@dataclass(frozen=True)
class PathLines:
    """The path in the pixels of the camera's image: (0, 0) is the centre of the top left pixel.

    Attributes:
        points: Shape (5, points, 2): u and v of each of the five lines, from near to far; NaN behind the camera.
        in_image_mask: Shape (5, points): the point lies in the image.
    """

    points: FloatArray
    in_image_mask: BoolArray

    def visible_points_of_line(self, name: str) -> FloatArray:
        """The points of the line of this name that lie in the image, shape (m, 2)."""
        index = PATH_LINE_NAMES.index(name)
        points: FloatArray = self.points[index][self.in_image_mask[index]]
        return points

    def band_90_percent_polygon_uv_px(self) -> FloatArray:
        """The 90 % band as one polygon in the image, shape (m, 2): up its left side, down its right one."""
        left, right = PATH_LINE_NAMES.index("band_left"), PATH_LINE_NAMES.index("band_right")
        both = self.in_image_mask[left] & self.in_image_mask[right]
        return np.concatenate([self.points[left][both], self.points[right][both][::-1]])


EMPTY_PATH_LINES = PathLines(
    np.full((len(PATH_LINE_NAMES), N_PATH_POINTS, 2), np.nan), np.zeros((len(PATH_LINE_NAMES), N_PATH_POINTS), np.bool_)
)
"""The lines of a path that is too short to draw: all points are NaN."""


def project_path_into_image(
    path: BodyPath, camera: Camera, *, width_m: float, camera_forward_m: float = 0.0
) -> PathLines:
    """Project a path into the image.

    The corridor is the car's width along the path. The band holds the path's place across it with 90 %; it is empty
    where the covariance is not known.

    Args:
        camera: The camera in the pixels of the image, with the pitch and yaw of this frame.
        camera_forward_m: Distance of the camera ahead of the centre of gravity.
    """
    x_m, y_m, heading_rad, across_m = _sample_path_and_band_width(path, camera, camera_forward_m)
    if not len(x_m):
        return EMPTY_PATH_LINES
    offsets = np.stack(
        [np.zeros_like(x_m), *(np.full_like(x_m, sign * width_m / 2) for sign in (1, -1)), across_m, -across_m]
    )
    forward = x_m - offsets * np.sin(heading_rad) - camera_forward_m
    left = y_m + offsets * np.cos(heading_rad)
    u, v = camera.image_points_from_ground(forward.ravel(), left.ravel())
    points = np.stack([u, v], axis=-1).reshape(len(PATH_LINE_NAMES), N_PATH_POINTS, 2)
    with np.errstate(invalid="ignore"):
        size = np.array([camera.width_px, camera.height_px])
        is_in = np.asarray(((points >= -0.5) & (points <= size - 0.5)).all(axis=-1), np.bool_)
    return PathLines(points, is_in)


def nearest_visible_ground_m(camera: Camera) -> float:
    """Distance ahead of the camera at which the middle of the image's lowest row shows the road, in metres."""
    x_m, _ = camera.ground_points_from_image(np.array([(camera.width_px - 1) / 2]), np.array([camera.height_px - 0.5]))
    near_m = float(x_m[0])
    return max(near_m, MIN_PATH_START_M) if math.isfinite(near_m) else DEFAULT_PATH_START_M


def _sample_path_and_band_width(
    path: BodyPath, camera: Camera, camera_forward_m: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Sample a path evenly in the image: x, y, heading and 90 % half width of the band; empty if the path is too
    short."""
    nothing = np.zeros(0)
    is_known = bool(np.isfinite(path.x_m + path.y_m + path.heading_rad).all())
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(path.x_m), np.diff(path.y_m)))])
    near_m = nearest_visible_ground_m(camera)
    start, end = near_m + camera_forward_m, float(driven[-1])
    if not is_known or end <= start + MIN_DRAWN_LENGTH_M:
        return nothing, nothing, nothing, nothing
    # A step in 1 / distance is a step in image rows.
    distances_m = 1.0 / np.linspace(1.0 / near_m, 1.0 / (end - camera_forward_m), N_PATH_POINTS) + camera_forward_m
    moving = np.concatenate([[True], np.diff(driven) > 0.0])
    across = SIGMAS_HOLDING_90_PERCENT * np.sqrt(
        np.maximum(xx_xy_yy_covariance_in_turned_axes(path.position_covariance_m2, path.heading_rad)[:, 2], 0.0)
    )
    x_m, y_m, heading_rad, across_m = (
        np.interp(distances_m, driven[moving], values[moving])
        for values in (path.x_m, path.y_m, path.heading_rad, across)
    )
    return x_m, y_m, heading_rad, across_m


def draw_path(image: Image, lines: PathLines) -> Image:
    """The image with the path drawn on it: the car's corridor, the 90 % band and the middle.

    Args:
        image: Shape (height, width, 3), blue, green, red.
    """
    import cv2

    drawn = image.copy()
    colour = tuple(round(255 * part) for part in reversed(PATH_RGB))
    thin = max(1, round(image.shape[1] / 640))
    band = lines.band_90_percent_polygon_uv_px()
    if len(band) > 2:
        filled = drawn.copy()
        cv2.fillPoly(filled, [_image_points_as_fixed_point_numbers(band)], colour, cv2.LINE_AA, N_FRACTION_BITS)
        drawn = np.asarray(cv2.addWeighted(filled, BAND_OPACITY, drawn, 1.0 - BAND_OPACITY, 0.0), np.uint8)
    for name, width in (("left", thin), ("right", thin), ("centre", 2 * thin)):
        points = lines.points[PATH_LINE_NAMES.index(name)]
        finite_points = points[np.isfinite(points).all(axis=1)]
        if len(finite_points) > 1:
            cv2.polylines(
                drawn,
                [_image_points_as_fixed_point_numbers(finite_points)],
                False,
                colour,
                width,
                cv2.LINE_AA,
                N_FRACTION_BITS,
            )
    return drawn


def _image_points_as_fixed_point_numbers(uv_px: FloatArray) -> npt.NDArray[np.int32]:
    """Points as OpenCV's fixed-point coordinates."""
    near = np.clip(uv_px, -MAX_DRAWN_COORDINATE_PX, MAX_DRAWN_COORDINATE_PX)
    return np.round(near * (1 << N_FRACTION_BITS)).astype(np.int32).reshape(-1, 1, 2)
