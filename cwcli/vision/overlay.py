"""Boundaries in the camera's image: their points in its pixels, their labels, and frames with both drawn on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.vision.boundary import LineColour, LineKind
from cwcli.vision.boundary_lines import BoundaryLines
from cwcli.vision.camera import Camera, WidthHeightPx
from cwcli.vision.encoded import Image
from cwcli.vision.fit_columns import FitColumns
from cwcli.vision.rectify import in_image_mask, lowest_visible_row_px, map_rectified_to_camera_px

N_LINE_POINTS = 32
"""Number of points of a drawn boundary. Chosen by hand; not fitted."""
POINT_SPACING_EXPONENT = 1.5
"""Exponent of the points' spacing: above 1 they lie closer towards the top, where the image of a bend is bent most.
Chosen by hand; not fitted."""

LEFT_BOUNDARY_RGB = (0.1, 0.9, 0.2)
"""Colour of the left boundary: red, green, blue, 0 to 1. Chosen by hand."""
RIGHT_BOUNDARY_RGB = (1.0, 0.55, 0.0)
"""Colour of the right boundary: red, green, blue, 0 to 1. Chosen by hand."""
OVERLAY_JPEG_QUALITY_PERCENT = 85
"""Quality of written JPEG images, 0 to 100. Chosen by hand."""
LABEL_POINT_INDEX = 4
"""Index, from the bottom, of the point of a line beside which its label stands. Chosen by hand."""
LABEL_WIDTH_IN_LETTER_HEIGHTS = 7.5
"""Width that is left for the longest label, in heights of a letter. Chosen by hand."""
FONT_LETTER_HEIGHT_PX = 22.0
"""Height of a letter of OpenCV's font at scale 1, in pixels."""
_LINE_LABELS = {
    (kind, colour): " ".join(each.name.lower() for each in (kind, colour) if each)
    for kind in LineKind
    for colour in LineColour
}
"""Label for each kind and colour, such as `solid white`; empty where both are unknown."""


def boundary_points_in_image(
    lines: BoundaryLines, search_size: WidthHeightPx, image_size: WidthHeightPx, camera: Camera | None = None
) -> tuple[FloatArray, BoolArray]:
    """Points of the boundaries of n frames in the camera's images, and a mask of those to draw.

    Args:
        lines: The boundaries in the pixels of the search image.
        search_size, image_size: (width, height) in pixels.
        camera: Of images of `image_size`, if the search image is the rectified one. The lines are then followed into
            the corners that the camera sees and the search image does not.

    Returns:
        Points of shape (n, 2, points, 2): u and v from the bottom up, (0, 0) being the centre of the top left
        pixel; and which of them belong to the line, shape (n, 2, points): found, in the image, and not ended.
    """
    width_px, height_px = search_size
    scale = np.array([image_size[0] / width_px, image_size[1] / height_px])
    foot_px = 1.0
    if camera is not None:
        foot_px = height_px + 0.5 - (lowest_visible_row_px(camera) + 0.5) / scale[1]
    share = 1.0 - np.linspace(1.0, 0.0, N_LINE_POINTS) ** POINT_SPACING_EXPONENT
    y_px = foot_px + share * (height_px - lines.top_px - foot_px)[:, None]
    x_px = lines.columns_at_heights_px(y_px, height_px)
    v_px = np.broadcast_to((height_px - y_px)[:, None], x_px.shape)
    points = (np.stack([x_px - 1.0, v_px], axis=-1) + 0.5) * scale - 0.5
    if camera is None:
        with np.errstate(invalid="ignore"):
            return points, (x_px >= 1.0) & (x_px <= width_px)
    points = map_rectified_to_camera_px(points, camera)
    return points, in_image_mask(points, camera)


def boundary_labels(fits: FitColumns) -> list[tuple[str, str]]:
    """Labels of the left and the right boundary of each frame, such as `dashed white`; empty where nothing is known."""
    sides = []
    for kinds, colours in zip(fits.kind.T.tolist(), fits.colour.T.tolist(), strict=True):
        sides.append([_LINE_LABELS[kind, colour] for kind, colour in zip(kinds, colours, strict=True)])
    return list(zip(*sides, strict=True))


def label_letter_height_px(image_width_px: float) -> float:
    """Height of a label's letters in pixels."""
    return max(image_width_px / 45.0, 9.0)


def label_position_px(line_uv_px: FloatArray, image_width_px: float) -> tuple[float, float]:
    """Column and row where a boundary's label begins: towards the image's middle, above the foot of its line (k, 2)."""
    u, v = line_uv_px[min(LABEL_POINT_INDEX, len(line_uv_px) - 1)].tolist()
    size_px = label_letter_height_px(image_width_px)
    is_left = u < 0.5 * image_width_px
    return (u + size_px if is_left else u - LABEL_WIDTH_IN_LETTER_HEIGHTS * size_px), v


def draw_boundaries(image: Image, lines: Sequence[FloatArray], names: Sequence[str] = ("", "")) -> Image:
    """The image with boundaries and their labels drawn on it.

    Args:
        image: Shape (height, width, 3), blue, green, red.
        lines: The left and the right one, shape (k, 2) each: u, v.
    """
    import cv2

    drawn = image.copy()
    thickness = max(2, round(image.shape[1] / 320))
    for points, colour, name in zip(lines, (LEFT_BOUNDARY_RGB, RIGHT_BOUNDARY_RGB), names, strict=True):
        if len(points) > 1:
            fixed = np.round(points * 16).astype(np.int32).reshape(-1, 1, 2)
            blue_green_red = tuple(round(255 * part) for part in reversed(colour))
            cv2.polylines(drawn, [fixed], False, blue_green_red, thickness, cv2.LINE_AA, 4)
            if name:
                u, v = label_position_px(points, image.shape[1])
                scale = label_letter_height_px(image.shape[1]) / FONT_LETTER_HEIGHT_PX
                corner = (round(u), round(v))
                weight = max(1, thickness // 2)
                cv2.putText(drawn, name, corner, cv2.FONT_HERSHEY_SIMPLEX, scale, blue_green_red, weight, cv2.LINE_AA)
    return drawn


def encode_jpeg(image: Image) -> Image:
    """The image as a JPEG file, shape (bytes,), uint8."""
    import cv2

    is_encoded, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, OVERLAY_JPEG_QUALITY_PERCENT])
    if not is_encoded:
        raise RuntimeError("OpenCV could not encode a JPEG")
    return np.asarray(data, np.uint8).reshape(-1)
