"""Compressed video (H.264, H.265, AV1) through PyAV, an extra: `pip install 'cwcli[video]'`."""

from __future__ import annotations

from typing import Any

import numpy as np

from cwcli.errors import InputError
from cwcli.vision.raw_images import Image

VIDEO_FORMATS = {"h264": "h264", "h265": "hevc", "hevc": "hevc", "av1": "av1", "vp9": "vp9"}
"""Format as the message says -> name of the codec."""


class VideoDecoder:
    """Decodes one message after the other; each must be given, because later pictures are made from earlier ones.

    Args:
        video_format: As the message says.
        where: File and topic, for messages.

    Raises:
        InputError: PyAV is not installed.
    """

    def __init__(self, video_format: str, where: str = "") -> None:
        try:
            import av
        except ModuleNotFoundError as error:
            raise InputError(
                f"the frames are compressed video ({video_format}), which needs PyAV",
                where=where,
                hint="pip install 'cwcli[video]'",
            ) from error
        self._av = av
        self._codec: Any = av.CodecContext.create(VIDEO_FORMATS[video_format], "r")
        self._codec.thread_type = "NONE"  # a picture comes out for the message that holds it

    def decode(self, data: bytes | memoryview) -> Any:
        """The picture that the message holds; None while there is none (parameters only, or nothing to build on)."""
        try:
            pictures = self._codec.decode(self._av.Packet(bytes(data)))
        except self._av.FFmpegError:
            return None
        return pictures[-1] if pictures else None


def picture_grey(picture: Any) -> Image:
    """A decoded picture as grey, shape (height, width)."""
    return np.asarray(picture.to_ndarray(format="gray"), np.uint8)


def picture_colour(picture: Any) -> Image:
    """A decoded picture as blue, green, red, shape (height, width, 3)."""
    return np.asarray(picture.to_ndarray(format="bgr24"), np.uint8)
