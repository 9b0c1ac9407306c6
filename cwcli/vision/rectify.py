"""Frames as a pinhole without roll sees them, which is what the model of a lane holds for; and the way back.

The rectified camera has the focal lengths, the principal point and the size of the camera itself. So the middle of the
image, where the far road is and a pixel is most metres, keeps its scale, and the rows keep their meaning for what is
known of the horizon. The price of a barrel distortion is its outermost corners, which fall out of view. They are not
missed: from the middle of a lane a pinhole's image of 4:3 or wider, with the horizon half way up, shows both markings
down to its bottom row, whatever its focal length; and a wider view would take pixels from the far road. Where nothing
was seen (corners of a rolled camera) the rectified image is black: the edge of a black area is bright on one side only,
which is no stripe. (With the outermost pixels drawn out instead, a roll of 3 degrees costs 1 cm at 10 m.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.vision.camera import Camera, Rotation3x3
from cwcli.vision.encoded import Image

COORDINATE_OF_UNSEEN_POINT_PX = -1000.0
"""Coordinate for points that the camera can't see, in pixels: far enough outside any image."""
MAX_LINE_EXTENSION_BELOW_IMAGE_OF_HEIGHT_SHARE = 0.5
"""Greatest distance below the image's bottom to which lines are followed into the camera's corners, over the image's
height. Chosen by hand; not fitted."""
N_POINTS_CHECKED_ON_LOWER_IMAGE_EDGE = 33
"""Number of points on the image's lower edge that are looked at. Chosen by hand; not fitted."""
MAX_CACHED_MAPS = 8
"""Greatest number of rectification maps in memory: a camera has one size of images, a malicious log may have thousands.
Chosen by hand; not fitted."""
MAP_ROWS_PER_BLOCK = 16
"""Number of rows for which a map is computed at a time: OpenCV's projection takes 400 bytes for each point. Chosen by
hand; not fitted."""

Size = tuple[int, int]


def needs_rectifying(camera: Camera) -> bool:
    """Whether the search does better on rectified frames.

    Not for a roll alone: lines stay straight, the ground geometry knows the roll, and the corners would be lost. At 8
    degrees of roll a pinhole's lanes are twice as exact without (docs/lanes.md).
    """
    return camera.differs_from_pinhole()


def rectified_camera(camera: Camera) -> Camera:
    """The pinhole camera without roll whose images the rectified frames are."""
    mounting = replace(camera.mounting, roll_rad=0.0)
    return replace(camera, distortion_model="", distortion=(), mounting=mounting)


def map_rectified_to_camera_px(points_px: FloatArray, camera: Camera) -> FloatArray:
    """Points of the rectified image in the pixels of the camera's own image.

    Args:
        points_px: Shape (..., 2): u, v; also outside the image.
        camera: As it is, in the pixels of both images.

    Returns:
        Same shape; NaN where the camera can't see the point.
    """
    flat = points_px.reshape(-1, 2)
    rays = (
        rectified_camera(camera).viewing_rays_from_image(flat[:, 0], flat[:, 1])
        @ _camera_from_rectified_rotation(camera).T
    )
    return np.stack(camera.image_points_from_rays(rays), axis=-1).reshape(points_px.shape)


def _camera_from_rectified_rotation(camera: Camera) -> Rotation3x3:
    """Rotation from the rectified to the camera's optical frame, shape (3, 3); they differ by the roll alone."""
    return np.asarray(camera.body_from_optical_rotation().T @ rectified_camera(camera).body_from_optical_rotation())


def lowest_visible_row_px(camera: Camera) -> float:
    """The lowest row of the rectified image, also below its bottom, that the camera's lower edge shows."""
    u_px = np.linspace(0.0, camera.width_px - 1.0, N_POINTS_CHECKED_ON_LOWER_IMAGE_EDGE)
    rays = camera.viewing_rays_from_image(
        u_px, np.full(N_POINTS_CHECKED_ON_LOWER_IMAGE_EDGE, camera.height_px - 1.0)
    ) @ _camera_from_rectified_rotation(camera)
    with np.errstate(divide="ignore", invalid="ignore"):
        v_px = camera.cy + camera.fy * rays[:, 1] / rays[:, 2]
    visible_rows_px = v_px[np.isfinite(v_px) & (rays[:, 2] > 0.0)]
    last = camera.height_px - 1.0
    return float(
        np.clip(
            visible_rows_px.max(initial=last),
            last,
            last + MAX_LINE_EXTENSION_BELOW_IMAGE_OF_HEIGHT_SHARE * camera.height_px,
        )
    )


def in_image_mask(points_px: FloatArray, camera: Camera) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Mask of the points, shape (..., 2), that lie in the camera's image; NaN does not."""
    u_px, v_px = points_px[..., 0], points_px[..., 1]
    with np.errstate(invalid="ignore"):
        return (u_px >= 0.0) & (u_px <= camera.width_px - 1.0) & (v_px >= 0.0) & (v_px <= camera.height_px - 1.0)


class Rectifier:
    """Rectifies search images; the map is made once for each size. Several threads may call it at once.

    Args:
        camera_of: (width_px, height_px) of the camera's images -> the camera in their pixels.
    """

    def __init__(self, camera_of: Callable[[int, int], Camera]) -> None:
        self._camera_of = camera_of
        self._maps: dict[tuple[Size, Size], tuple[Image, Image]] = {}

    def rectify_image(self, image: Image, image_size: Size) -> Image:
        """The rectified search image, grey or in colour, of a frame of `image_size` (width, height); the shape
        stays."""
        import cv2

        height_px, width_px = image.shape[:2]
        key = image_size, (width_px, height_px)
        maps = self._maps.get(key)
        if maps is None:  # two threads at once make the same map
            maps = rectification_pixel_maps(self._camera_of(*image_size).with_image_size(width_px, height_px))
            if len(self._maps) >= MAX_CACHED_MAPS:
                self._maps.clear()
            self._maps[key] = maps
        return np.asarray(cv2.remap(image, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT), np.uint8)


def rectification_pixel_maps(camera: Camera) -> tuple[Image, Image]:
    """OpenCV's fixed-point maps that rectify the camera's images: two or three times as fast as those of floats."""
    import cv2

    u_px = np.arange(float(camera.width_px))
    points_px = np.empty((camera.height_px, camera.width_px, 2), np.float32)
    for top in range(0, camera.height_px, MAP_ROWS_PER_BLOCK):
        rows = np.arange(float(top), min(top + MAP_ROWS_PER_BLOCK, camera.height_px))
        points = map_rectified_to_camera_px(np.stack(np.meshgrid(u_px, rows), axis=-1), camera)
        points_px[top : top + MAP_ROWS_PER_BLOCK] = np.clip(
            np.nan_to_num(points, nan=COORDINATE_OF_UNSEEN_POINT_PX),
            COORDINATE_OF_UNSEEN_POINT_PX,
            -2.0 * COORDINATE_OF_UNSEEN_POINT_PX,
        )
    first, second = cv2.convertMaps(points_px[..., 0], points_px[..., 1], cv2.CV_16SC2)
    return np.asarray(first), np.asarray(second)
