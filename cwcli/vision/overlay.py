"""What is drawn on the camera's image: the boundaries as points in its pixels, and frames with them burnt in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import FloatArray
from cwcli.vision.boundary_lines import BoundaryLines
from cwcli.vision.camera import Camera
from cwcli.vision.encoded import Image
from cwcli.vision.rectify import camera_points, is_in_image, lowest_row_px

BoolArray = npt.NDArray[np.bool_]

N_POINTS = 32
DENSER = 1.5
"""Points lie nearer to each other towards the top, where the line of a bend is bent most."""

LEFT_RGB = (0.1, 0.9, 0.2)
RIGHT_RGB = (1.0, 0.55, 0.0)
JPEG_QUALITY = 85


def line_points(
    lines: BoundaryLines, search_size: tuple[int, int], image_size: tuple[int, int], camera: Camera | None = None
) -> tuple[FloatArray, BoolArray]:
    """The boundaries of n frames in the camera's images.

    Args:
        lines: In the pixels of the search image.
        search_size, image_size: (width, height) in pixels.
        camera: Of images of `image_size`, if the search image is the rectified one. The lines are then followed into
            the corners that the camera sees and the search image does not.

    Returns:
        Points of shape (n, 2, `N_POINTS`, 2): u and v from the bottom up, (0, 0) being the centre of the top left
        pixel; and which of them belong to the line, shape (n, 2, `N_POINTS`): found, in the image, and not ended.
    """
    width_px, height_px = search_size
    scale = np.array([image_size[0] / width_px, image_size[1] / height_px])
    foot_px = 1.0
    if camera is not None:
        foot_px = height_px + 0.5 - (lowest_row_px(camera) + 0.5) / scale[1]
    share = 1.0 - np.linspace(1.0, 0.0, N_POINTS) ** DENSER
    y_px = foot_px + share * (height_px - lines.top_px - foot_px)[:, None]
    x_px = lines.columns_px(y_px, height_px)
    v_px = np.broadcast_to((height_px - y_px)[:, None], x_px.shape)
    points = (np.stack([x_px - 1.0, v_px], axis=-1) + 0.5) * scale - 0.5
    if camera is None:
        with np.errstate(invalid="ignore"):
            return points, (x_px >= 1.0) & (x_px <= width_px)
    points = camera_points(points, camera)
    return points, is_in_image(points, camera)


def burn_in(image: Image, lines: Sequence[FloatArray]) -> Image:
    """The image with lines drawn on it.

    Args:
        image: Shape (height, width, 3), blue, green, red.
        lines: The left and the right one, shape (k, 2) each: u, v.
    """
    import cv2

    drawn = image.copy()
    thickness = max(2, round(image.shape[1] / 320))
    for points, colour in zip(lines, (LEFT_RGB, RIGHT_RGB), strict=True):
        if len(points) > 1:
            fixed = np.round(points * 16).astype(np.int32).reshape(-1, 1, 2)
            blue_green_red = tuple(round(255 * part) for part in reversed(colour))
            cv2.polylines(drawn, [fixed], False, blue_green_red, thickness, cv2.LINE_AA, 4)
    return drawn


def encode_jpeg(image: Image) -> Image:
    """The image as a JPEG file, shape (bytes,), uint8."""
    import cv2

    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not done:
        raise RuntimeError("OpenCV could not encode a JPEG")
    return np.asarray(data, np.uint8).reshape(-1)
