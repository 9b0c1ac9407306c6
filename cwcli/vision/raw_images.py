"""Decoding of raw images, in the encodings of ROS and Foxglove, to grey or colour.

To add an encoding: one row in the table that fits it.
"""

from __future__ import annotations

import numpy as np

from cwcli.vision.depth_images import scale_to_grey
from cwcli.vision.encoded import FrameLike, Image

PACKED_ENCODINGS = {
    "mono8": (1, ""),
    "8uc1": (1, ""),
    "rgb8": (3, "RGB"),
    "bgr8": (3, "BGR"),
    "8uc3": (3, "BGR"),
    "rgba8": (4, "RGBA"),
    "bgra8": (4, "BGRA"),
    "8uc4": (4, "BGRA"),
}
"""Bytes for each pixel, and order of the channels, of encodings with whole pixels side by side."""
BAYER_ENCODINGS = {"bayer_rggb8": "BG", "bayer_bggr8": "RG", "bayer_gbrg8": "GR", "bayer_grbg8": "GB"}
"""OpenCV's name for each Bayer encoding: that of the second row's second and third pixel."""
YUV422_LUMINANCE_BYTES = {"yuyv": 0, "yuv422_yuy2": 0, "yuy2": 0, "uyvy": 1, "yuv422": 1}
"""Place of the luminance in each pair of bytes of encodings with a colour for two pixels."""
MONO16_ENCODINGS = ("mono16", "16uc1")
"""Encodings of grey images with 16 bits for each pixel."""
NV_ENCODINGS = {"nv12": "NV12", "nv21": "NV21"}
"""OpenCV's name for encodings that hold the luminance of all pixels, then a colour for each two by two of them."""
FLOAT32_ENCODING = "32fc1"
"""Encoding of depth images with a 32-bit float for each pixel."""

GREY_ENCODINGS = ("mono8", "8uc1", *MONO16_ENCODINGS, FLOAT32_ENCODING)
"""Encodings of images without any colour."""


class RawImageError(ValueError):
    """The raw image can't be read; the text is the reason by which it is counted."""


def decode_raw_as_grey(frame: FrameLike) -> Image:
    """Decode a raw image to grey, shape (height, width), uint8.

    Raises:
        RawImageError: Unknown encoding, or fewer bytes than its size needs.
    """
    encoding = frame.encoding.lower()
    if encoding in YUV422_LUMINANCE_BYTES:
        return _view_pixel_bytes(frame, 2)[:, :, YUV422_LUMINANCE_BYTES[encoding]]
    if encoding in MONO16_ENCODINGS:
        return _view_pixel_bytes(frame, 2)[:, :, 1]  # the upper byte of little-endian values
    if encoding in NV_ENCODINGS:
        return _view_pixel_bytes(frame, 1)[:, :, 0]
    if encoding == FLOAT32_ENCODING:
        return scale_to_grey(np.ascontiguousarray(_view_pixel_bytes(frame, 4)).view("<f4")[:, :, 0])
    import cv2

    if encoding in BAYER_ENCODINGS:
        code: int = getattr(cv2, f"COLOR_BAYER_{BAYER_ENCODINGS[encoding]}2GRAY")
        return _convert_colour(_view_pixel_bytes(frame, 1)[:, :, 0], code)
    n_bytes, order = _bytes_per_pixel_and_channel_order(encoding)
    pixels = _view_pixel_bytes(frame, n_bytes)
    return _convert_colour(pixels, getattr(cv2, f"COLOR_{order}2GRAY")) if order else pixels[:, :, 0]


def decode_raw_as_colour(frame: FrameLike) -> Image:
    """Decode a raw image to blue, green, red, shape (height, width, 3), uint8.

    Raises:
        RawImageError: Unknown encoding, or fewer bytes than its size needs.
    """
    import cv2

    encoding = frame.encoding.lower()
    if encoding in YUV422_LUMINANCE_BYTES:
        name = "YUV2BGR_YUY2" if YUV422_LUMINANCE_BYTES[encoding] == 0 else "YUV2BGR_UYVY"
        image = _convert_colour(_with_even_column_count(_view_pixel_bytes(frame, 2)), getattr(cv2, f"COLOR_{name}"))
        return np.ascontiguousarray(image[:, : frame.width])
    if encoding in BAYER_ENCODINGS:
        return _convert_colour(
            _view_pixel_bytes(frame, 1)[:, :, 0], getattr(cv2, f"COLOR_BAYER_{BAYER_ENCODINGS[encoding]}2BGR")
        )
    if encoding in NV_ENCODINGS:
        return _decode_nv_as_colour(frame, NV_ENCODINGS[encoding])
    if encoding in MONO16_ENCODINGS or encoding == FLOAT32_ENCODING or PACKED_ENCODINGS.get(encoding, (0, ""))[1] == "":
        return _convert_colour(decode_raw_as_grey(frame), cv2.COLOR_GRAY2BGR)
    n_bytes, order = _bytes_per_pixel_and_channel_order(encoding)
    pixels = _view_pixel_bytes(frame, n_bytes)
    return pixels.copy() if order == "BGR" else _convert_colour(pixels, getattr(cv2, f"COLOR_{order}2BGR"))


def _decode_nv_as_colour(frame: FrameLike, name: str) -> Image:
    """Decode an NV12 or NV21 image to blue, green, red."""
    import cv2

    if frame.width % 2 or frame.height % 2:
        raise RawImageError("an odd number of rows or columns with one colour for four pixels")
    return _convert_colour(
        _view_pixel_bytes(frame, 1, rows=frame.height * 3 // 2)[:, :, 0], getattr(cv2, f"COLOR_YUV2BGR_{name}")
    )


def _with_even_column_count(pixels: Image) -> Image:
    """Two-byte pixels with an even number of columns, the last one doubled if needed: two columns share a colour."""
    return pixels if pixels.shape[1] % 2 == 0 else np.concatenate([pixels, pixels[:, -2:-1]], axis=1)


def _bytes_per_pixel_and_channel_order(encoding: str) -> tuple[int, str]:
    """Bytes for each pixel, and order of the channels; raises RawImageError where the encoding is unknown."""
    if encoding not in PACKED_ENCODINGS:
        raise RawImageError(f"the encoding {encoding or '(none)'} is not supported")
    return PACKED_ENCODINGS[encoding]


def _view_pixel_bytes(frame: FrameLike, n_bytes: int, rows: int | None = None) -> Image:
    """A view of the message's bytes, shape (height, width, n_bytes), or with another number of rows."""
    height = frame.height if rows is None else rows
    row_bytes = frame.width * n_bytes
    step = frame.step or row_bytes
    if step < row_bytes or len(frame.data) < step * (height - 1) + row_bytes:
        raise RawImageError("fewer bytes than width, height and encoding need")
    values = np.frombuffer(frame.data, np.uint8, count=step * (height - 1) + row_bytes)
    return np.lib.stride_tricks.as_strided(values, (height, frame.width, n_bytes), (step, n_bytes, 1), writeable=False)


def _convert_colour(pixels: Image, code: int) -> Image:
    """Pixels converted by one of OpenCV's colour codes."""
    import cv2

    return np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels), code), np.uint8)
