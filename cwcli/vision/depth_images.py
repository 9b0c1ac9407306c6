"""Depth as a picture: `32FC1`, and `compressedDepth` of ROS's image transport. Near is dark, no measurement is black.

A compressed depth image is a PNG of 16 bits behind twelve bytes: the kind of compression, and two numbers a and b.
Where the format is `16UC1; compressedDepth` its values are the depth as it was; where it is `32FC1; ...` the depth is
a / (value - b), and a value of 0 is not measured (image_transport_plugins, compressed_depth_image_transport).
"""

from __future__ import annotations

import struct

import numpy as np
import numpy.typing as npt

from cwcli.vision.encoded import Image

COMPRESSED_DEPTH_HEADER = struct.Struct("<iff")
"""Header of a compressed depth image: the kind of compression, and the numbers a and b (image_transport_plugins)."""
MAX_GREY_LEVEL_OF_8_BITS = 255
"""Greatest grey level of an 8-bit image; 0 is left for pixels without a measurement."""


class DepthImageError(ValueError):
    """The depth image can't be read; the text is the reason by which it is counted."""


def is_compressed_depth(format_name: str) -> bool:
    """Whether a format says that the data are a compressed depth image."""
    return "compresseddepth" in format_name.lower()


def decode_compressed_depth_as_grey(format_name: str, data: bytes | memoryview) -> Image:
    """A compressed depth image as grey, shape (height, width), uint8.

    Args:
        format_name: Its format, e.g. `32FC1; compressedDepth png`.

    Raises:
        DepthImageError: It is of another compression, or damaged.
    """
    import cv2

    if "rvl" in format_name.lower():
        raise DepthImageError("depth compressed as RVL is not supported")
    _, a, b = COMPRESSED_DEPTH_HEADER.unpack_from(data)
    try:
        values = cv2.imdecode(np.frombuffer(data, np.uint8, offset=COMPRESSED_DEPTH_HEADER.size), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DepthImageError("damaged") from error
    if values is None or values.dtype != np.uint16 or values.ndim != 2:
        raise DepthImageError("damaged")
    if "32fc1" not in format_name.lower():
        return np.asarray(values.view(np.uint8).reshape(*values.shape, 2)[:, :, 1])  # the upper byte
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth = np.where(values > 0, a / (values.astype(np.float64) - b), np.nan)
    return scale_to_grey(depth)


def scale_to_grey(values: npt.NDArray[np.floating]) -> Image:
    """Numbers scaled to grey: the least of an image is 1, the greatest 255, and what is not finite 0."""
    is_number = np.isfinite(values)
    if not is_number.any():
        return np.zeros(values.shape, np.uint8)
    low, high = float(values[is_number].min()), float(values[is_number].max())
    step = (high - low) / (MAX_GREY_LEVEL_OF_8_BITS - 1) or 1.0
    with np.errstate(invalid="ignore", over="ignore"):
        grey = 1.0 + np.where(is_number, values - low, 0.0) / step
    return np.where(is_number, np.clip(np.rint(grey), 1, MAX_GREY_LEVEL_OF_8_BITS), 0).astype(np.uint8)
