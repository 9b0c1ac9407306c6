"""Compressed video (H.264, H.265, VP9) through the FFmpeg inside OpenCV, which is under the LGPL.

FFmpeg pulls the messages through a Matroska stream that is made on the way, and each picture comes back with the number
of its message. So a picture is never taken for another message's, however many are lost, damaged or held back. A stream
begins at a message with parameters, and a new one where they change: OpenCV would scale the pictures to the first size.
"""

from __future__ import annotations

import io
import os
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from itertools import groupby
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from cwcli.errors import InputError
from cwcli.vision.camera import WidthHeightPx
from cwcli.vision.encoded import Image
from cwcli.vision.matroska import BLOCK_INTERVAL_MS, encode_matroska_block, encode_matroska_start
from cwcli.vision.video_start import parameters_if_decodable_start

CODEC_OF_VIDEO_FORMAT = {"h264": "h264", "h265": "h265", "hevc": "h265", "vp9": "vp9", "av1": "av1"}
"""Codec for each format that a message may name."""
UNSUPPORTED_CODECS = frozenset({"av1"})
"""Codecs that OpenCV's FFmpeg decodes on special hardware only."""
N_DECODER_THREADS = 1
"""Number of FFmpeg's threads: with more, its repair of damaged parts differs from run to run."""
MAX_EXTRA_DECODER_FAILURES = 2
"""Failures of the decoder, beyond one for each waiting message, after which it is started anew. Chosen by hand; not
fitted."""
BLOCK_NUMBER_ABOVE_ALL_MESSAGES = 1 << 40
"""A block number above that of any message."""


class EncodedMessage(Protocol):
    """A message with an encoded picture."""

    @property
    def data(self) -> bytes | memoryview: ...


Message = TypeVar("Message", bound=EncodedMessage)


def decode_video(
    messages: Iterable[Message], video_format: str, *, max_pixels: int, where: str = ""
) -> Iterator[tuple[Message, Image | None, WidthHeightPx]]:
    """Decode the messages of one stream, in order; about 50 are read ahead.

    Args:
        video_format: The format that the messages name.
        max_pixels: A stream with larger pictures is decoded up to its first one.
        where: File and topic, for messages.

    Yields:
        For every message: itself; its picture in blue, green, red, shape (height, width, 3), or None (nothing but
        parameters, damaged, or nothing to build on); the picture's (width, height), (0, 0) where there is none.

    Raises:
        InputError: There is no decoder for the format.
    """
    codec = _require_decodable_codec(video_format, where)
    for number, stream in groupby(messages, key=_make_stream_counter(codec)):
        feed: _MatroskaFeed[Message] | None = None
        too_large = (0, 0)
        while number and not (feed and feed.is_done) and not any(too_large):
            feed = _MatroskaFeed(stream, codec)  # noqa: B031 - goes on where the last one stopped
            too_large = yield from _decode_until_stuck(feed, max_pixels)
            if feed.error is not None:
                raise feed.error
        for message in stream:  # noqa: B031 - what is left of the group: too large, or nothing to build on yet
            yield message, None, too_large


def _make_stream_counter(codec: str) -> Callable[[EncodedMessage], int]:
    """A function that numbers the streams: called with each message in turn, 0 before the first stream, then 1, 2,
    ..."""
    number, head = 0, b""

    def number_of(message: EncodedMessage) -> int:
        nonlocal number, head
        own = parameters_if_decodable_start(codec, message.data)
        if own is not None and own != head:
            number, head = number + 1, own
        return number

    return number_of


def _require_decodable_codec(video_format: str, where: str) -> str:
    """The codec of a format; raises InputError where OpenCV can't decode it."""
    import cv2

    codec = CODEC_OF_VIDEO_FORMAT[video_format]
    name = video_format.upper()
    if codec in UNSUPPORTED_CODECS:
        raise InputError(
            f"the frames are compressed video ({name}), which OpenCV can't decode",
            where=where,
            hint="record or convert them as H.264, H.265, VP9 or JPEG",
        )
    if cv2.CAP_FFMPEG not in cv2.videoio_registry.getStreamBufferedBackends():
        raise InputError(
            f"the frames are compressed video ({name}), and this OpenCV is built without FFmpeg",
            where=where,
            hint="pip install opencv-python-headless",
        )
    return codec


def _decode_until_stuck(
    feed: _MatroskaFeed[Message], max_pixels: int
) -> Generator[tuple[Message, Image | None, WidthHeightPx], None, WidthHeightPx]:
    """Decode until the messages end, or until the decoder no longer makes pictures; then the caller starts a new one.

    At a picture that is too large it ends and returns the size, else (0, 0): the rest of the stream has the same one.
    """
    import cv2

    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # damaged pictures are counted, not reported one by one
    source: Any = feed
    capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, N_DECODER_THREADS])
    try:
        failures = 0
        while capture.isOpened() and failures <= len(feed.waiting) + MAX_EXTRA_DECODER_FAILURES:
            if not capture.grab():  # at a damaged block, or at the end
                failures += 1
                continue
            failures = 0
            size = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
            if size[0] * size[1] > max_pixels:
                for message in feed.pop_waiting_messages_before(BLOCK_NUMBER_ABOVE_ALL_MESSAGES):
                    yield message, None, size
                return size
            number = round(capture.get(cv2.CAP_PROP_POS_MSEC) / BLOCK_INTERVAL_MS)
            for message in feed.pop_waiting_messages_before(number):
                yield message, None, (0, 0)
            own = feed.pop_oldest_waiting_message_if_numbered(number)
            if own is not None:
                yield own, *_retrieve_picture_or_none_and_its_size(capture)
        for message in feed.pop_waiting_messages_before(BLOCK_NUMBER_ABOVE_ALL_MESSAGES):
            yield message, None, (0, 0)
        return 0, 0
    finally:
        capture.release()


def _retrieve_picture_or_none_and_its_size(capture: Any) -> tuple[Image | None, WidthHeightPx]:
    """The grabbed picture and its size."""
    is_good, image = capture.retrieve()
    if not is_good or image is None:
        return None, (0, 0)
    return np.asarray(image, np.uint8), (image.shape[1], image.shape[0])


class _MatroskaFeed(io.BufferedIOBase, Generic[Message]):
    """The file that FFmpeg reads: each message becomes a block when it is asked for.

    Attributes:
        waiting: Number and message of those whose picture has not come.
        is_done: There are no more messages.
        error: The error that the messages' iterator raised, if any.
    """

    def __init__(self, messages: Iterator[Message], codec: str) -> None:
        super().__init__()
        self._messages = messages
        self._bytes = bytearray(encode_matroska_start(codec))
        self._n = 0
        self.waiting: deque[tuple[int, Message]] = deque()
        self.is_done = False
        self.error: BaseException | None = None

    def read(self, size: int | None = -1, /) -> bytes:
        """Up to `size` bytes, b"" at the end. Never raises: it is called from within FFmpeg."""
        while not self._bytes and not self.is_done:
            try:
                self._append_next_message()
            except BaseException as error:  # handed on by `decode_video`
                self.error, self.is_done = error, True
        n = len(self._bytes) if size is None or size < 0 else size
        out = bytes(self._bytes[:n])
        del self._bytes[:n]
        return out

    def seek(self, offset: int, whence: int = 0, /) -> int:
        """Not possible; -1 says so to FFmpeg."""
        return -1

    def _append_next_message(self) -> None:
        """Append the block of the next message."""
        message = next(self._messages, None)
        if message is None:
            self.is_done = True
            return
        self.waiting.append((self._n, message))
        if len(message.data):
            self._bytes += encode_matroska_block(self._n, message.data)
        self._n += 1

    def pop_waiting_messages_before(self, number: int) -> Iterator[Message]:
        """Take out the messages before this one: their pictures will not come."""
        while self.waiting and self.waiting[0][0] < number:
            yield self.waiting.popleft()[1]

    def pop_oldest_waiting_message_if_numbered(self, number: int) -> Message | None:
        """Take out this message; None if it is out already."""
        return self.waiting.popleft()[1] if self.waiting and self.waiting[0][0] == number else None
