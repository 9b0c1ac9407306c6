"""Compressed video (H.264, H.265, VP9) through the FFmpeg inside OpenCV, which is under the LGPL.

FFmpeg pulls the messages through a Matroska stream that is made on the way, and each picture comes back with the number
of its message. So a picture is never taken for another message's, however many are lost, damaged or held back. A stream
begins at a message with parameters, and a new one where they change: OpenCV would scale the pictures to the first size.

Of Matroska only what a single video track needs is written: each picture is a cluster with one block and its time, in a
file without an end, so that a demuxer hands the pictures on one by one. A time is all that ties a decoded picture to
the message that it came in, whatever was lost between.

Sources: RFC 9559 (Matroska), RFC 8794 (EBML); ITU-T H.264 and H.265, table 7-1 (types of NAL units) and annex B (start
codes); VP9 bitstream specification, version 0.7, section 6.2 (uncompressed header).
"""

from __future__ import annotations

import io
import os
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import field
from itertools import groupby
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from cwcli.errors import InputError
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.units import NS_PER_MS
from cwcli.vision.camera import WidthHeightPx
from cwcli.vision.encoded import Image

CODEC_OF_VIDEO_FORMAT = {"h264": "h264", "h265": "h265", "hevc": "h265", "vp9": "vp9", "av1": "av1"}
"""Codec for each format that a message may name."""
UNSUPPORTED_CODECS = frozenset({"av1"})
"""Codecs that OpenCV's FFmpeg decodes on special hardware only."""
N_DECODER_THREADS = 1
"""Number of FFmpeg's threads: with more, its repair of damaged parts differs from run to run."""
MAX_FAILURES_BEFORE_DECODER_RESTART = 2
"""Failures of the decoder, beyond one for each waiting message, after which it is started anew. Chosen by hand; not
fitted."""
BLOCK_NUMBER_ABOVE_ALL_MESSAGES = 1 << 40
"""A block number above that of any message."""
NAL_START_CODE = b"\x00\x00\x01"
"""Bytes before each NAL unit (annex B)."""
H264_SPS_TYPE, H264_SLICE_TYPES = 7, range(1, 6)
"""Types of H.264 NAL units: sequence parameter sets, and slices (table 7-1)."""
H265_SPS_TYPE, H265_SLICE_TYPES = 33, range(32)
"""Types of H.265 NAL units: sequence parameter sets, and slices (table 7-1)."""
VP9_FRAME_MARKER, VP9_SYNC_CODE, VP9_RGB_COLOUR_SPACE = 2, 0x498342, 7
"""Frame marker, synchronisation code and RGB colour space in the header of a VP9 frame (section 6.2)."""
BLOCK_INTERVAL_MS = 40
"""Time between two blocks in milliseconds. Demuxers take it for a frame rate; it says nothing of the camera's."""
MATROSKA_CODEC_IDS = {"h264": "V_MPEG4/ISO/AVC", "h265": "V_MPEGH/ISO/HEVC", "vp9": "V_VP9", "av1": "V_AV1"}
"""Name of each codec in Matroska. The pictures stay as they are (H.264 and H.265 with start codes, Annex B)."""
_EBML, _DOC_TYPE, _DOC_TYPE_VERSION, _DOC_TYPE_READ_VERSION = "1A45DFA3", "4282", "4287", "4285"
"""Identifiers of the elements of an EBML header (RFC 8794)."""
_SEGMENT, _INFO, _TIMESTAMP_SCALE, _MUXING_APP, _WRITING_APP = "18538067", "1549A966", "2AD7B1", "4D80", "5741"
"""Identifiers of the segment and of the elements that describe it (RFC 9559)."""
_TRACKS, _TRACK_ENTRY, _TRACK_NUMBER, _TRACK_UID, _TRACK_TYPE = "1654AE6B", "AE", "D7", "73C5", "83"
"""Identifiers of the elements of a track (RFC 9559)."""
_CODEC_ID, _VIDEO, _PIXEL_WIDTH, _PIXEL_HEIGHT = "86", "E0", "B0", "BA"
"""Identifiers of the elements of a video track (RFC 9559)."""
_CLUSTER, _TIMESTAMP, _SIMPLE_BLOCK = "1F43B675", "E7", "A3"
"""Identifiers of a cluster, of its time and of its picture (RFC 9559)."""
UNKNOWN_ELEMENT_SIZE = b"\x01" + b"\xff" * 7
"""Size of an element whose end is not known yet (RFC 8794, 6.2)."""
VIDEO_TRACK_TYPE = 1
"""Number for a video track in Matroska's track type (RFC 9559)."""
DECLARED_PICTURE_SIDE_PX = 16
"""Width and height that the track declares: the format wants them, but the pictures hold their own."""


@dataclass
class _BitReader:
    """Reads numbers of any length from a bit string, first bit first."""

    data: bytes
    at: int = field(default=0)

    def read_bits(self, n_bits: int) -> int:
        """The next n bits as a number; zeros behind the end."""
        value = 0
        for position in range(self.at, self.at + n_bits):
            byte = self.data[position >> 3] if position >> 3 < len(self.data) else 0
            value = value << 1 | byte >> (7 - position % 8) & 1
        self.at += n_bits
        return value


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
        while capture.isOpened() and failures <= len(feed.waiting) + MAX_FAILURES_BEFORE_DECODER_RESTART:
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


def parameters_if_decodable_start(codec: str, data: bytes | memoryview) -> bytes | None:
    """Parameters that identify a stream, if decoding may start at this message, else None.

    Args:
        codec: `h264`, `h265` or `vp9`.
        data: A message: NAL units with start codes, or a VP9 frame.

    Returns:
        The sequence parameter sets of the message; of a VP9 key frame its format and size.
    """
    if codec == "vp9":
        return _vp9_key_frame_format(bytes(data[:16]))
    parameters = b"".join(_iter_parameter_sets(codec, bytes(data)))
    return parameters or None


def _iter_parameter_sets(codec: str, data: bytes) -> Iterator[bytes]:
    """The sequence parameter sets before the first slice; they can't come later."""
    at = data.find(NAL_START_CODE)
    while 0 <= at < len(data) - len(NAL_START_CODE):
        begin = at + len(NAL_START_CODE)
        first = data[begin]
        kind = first & 0x1F if codec == "h264" else first >> 1 & 0x3F
        if kind in (H264_SLICE_TYPES if codec == "h264" else H265_SLICE_TYPES):
            return
        at = data.find(NAL_START_CODE, begin)
        if kind == (H264_SPS_TYPE if codec == "h264" else H265_SPS_TYPE):
            yield data[begin : at if at >= 0 else len(data)].rstrip(b"\x00")


def _vp9_key_frame_format(data: bytes) -> bytes | None:
    """Format and size of a VP9 key frame as text; None for other frames."""
    bits = _BitReader(data)
    if bits.read_bits(2) != VP9_FRAME_MARKER:
        return None
    profile = bits.read_bits(1) | bits.read_bits(1) << 1
    bits.read_bits(1 if profile == 3 else 0)
    is_repeated, is_inter = bits.read_bits(1), bits.read_bits(1)
    bits.read_bits(2)
    if is_repeated or is_inter or bits.read_bits(24) != VP9_SYNC_CODE:
        return None
    depth = bits.read_bits(1) if profile >= 2 else 0
    color_space = bits.read_bits(3)
    has_subsampling = profile in (1, 3)
    layout = bits.read_bits(
        (1 if has_subsampling else 0) if color_space == VP9_RGB_COLOUR_SPACE else (4 if has_subsampling else 1)
    )
    width, height = bits.read_bits(16) + 1, bits.read_bits(16) + 1
    if bits.at > 8 * len(data):
        return None
    return f"{profile} {depth} {color_space} {layout} {width} x {height}".encode()


def encode_matroska_start(codec: str) -> bytes:
    """The bytes of a Matroska file before its first block.

    Args:
        codec: `h264`, `h265`, `vp9` or `av1`.
    """
    video = _encode_element(_PIXEL_WIDTH, _encode_number(DECLARED_PICTURE_SIDE_PX)) + _encode_element(
        _PIXEL_HEIGHT, _encode_number(DECLARED_PICTURE_SIDE_PX)
    )
    track = (
        _encode_element(_TRACK_NUMBER, _encode_number(1))
        + _encode_element(_TRACK_UID, _encode_number(1))
        + _encode_element(_TRACK_TYPE, _encode_number(VIDEO_TRACK_TYPE))
        + _encode_element(_CODEC_ID, MATROSKA_CODEC_IDS[codec].encode())
        + _encode_element(_VIDEO, video)
    )
    info = (
        _encode_element(_TIMESTAMP_SCALE, _encode_number(NS_PER_MS))
        + _encode_element(_MUXING_APP, b"cwcli")
        + _encode_element(_WRITING_APP, b"cwcli")
    )
    head = (
        _encode_element(_DOC_TYPE, b"matroska")
        + _encode_element(_DOC_TYPE_VERSION, _encode_number(4))
        + _encode_element(_DOC_TYPE_READ_VERSION, _encode_number(2))
    )
    segment = bytes.fromhex(_SEGMENT) + UNKNOWN_ELEMENT_SIZE
    return (
        _encode_element(_EBML, head)
        + segment
        + _encode_element(_INFO, info)
        + _encode_element(_TRACKS, _encode_element(_TRACK_ENTRY, track))
    )


def encode_matroska_block(number: int, data: bytes | memoryview) -> bytes:
    """The bytes of one encoded picture; its time is `number * BLOCK_INTERVAL_MS`."""
    block = b"\x81\x00\x00\x80" + data  # track 1, at the cluster's time, a picture to start from
    return _encode_element(
        _CLUSTER,
        _encode_element(_TIMESTAMP, _encode_number(number * BLOCK_INTERVAL_MS)) + _encode_element(_SIMPLE_BLOCK, block),
    )


def _encode_element(identifier: str, content: bytes) -> bytes:
    """The bytes of an EBML element: identifier, size in eight bytes, content."""
    return bytes.fromhex(identifier) + (len(content) | 1 << 56).to_bytes(8, "big") + content


def _encode_number(value: int) -> bytes:
    """A whole number as the content of an EBML element, eight bytes."""
    return value.to_bytes(8, "big")
