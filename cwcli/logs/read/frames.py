"""Camera frames of a topic, one at a time, in log-time order. The images stay encoded."""

from __future__ import annotations

import base64
import binascii
import heapq
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np

from cwcli.errors import InputError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.codecs.compressed_messages import zstd_message_mask
from cwcli.logs.codecs.decoder import Decoder
from cwcli.logs.codecs.ros2msg import package_slash_message_name
from cwcli.logs.format.faults import Faults
from cwcli.logs.read.channels import ChannelInfo
from cwcli.logs.read.columns import check_single_schema, make_channel_decoder
from cwcli.logs.read.message_reader import MessageBatch, MessageReader
from cwcli.signals.columns import Field, Strings
from cwcli.signals.units import NS_PER_S

IMAGE_DATA_FIELD = "data"
"""The field with the bytes of an image, in all supported message types."""
IMAGE_FIELDS = ("format", "encoding", "width", "height", "step")
"""The fields that describe an image; a message type has some of them."""
STAMP_FIELD_PAIRS = (
    ("header.stamp.sec", "header.stamp.nanosec"),
    ("header.stamp.secs", "header.stamp.nsecs"),
    ("timestamp.sec", "timestamp.nanosec"),
    ("timestamp.sec", "timestamp.nsec"),
    ("timestamp.seconds", "timestamp.nanos"),
)
"""The fields of seconds and nanoseconds of the stamp, in ROS 2, ROS 1 and Foxglove messages; the first pair is used."""
FRAME_ID_FIELDS = ("header.frame_id", "frame_id")
"""The fields with the frame of reference of the camera; the first one that exists counts."""
IMAGE_SCHEMAS = frozenset(
    {
        "sensor_msgs/CompressedImage",
        "sensor_msgs/Image",
        "foxglove_msgs/CompressedImage",
        "foxglove_msgs/RawImage",
        "foxglove_msgs/CompressedVideo",
        "foxglove.CompressedImage",
        "foxglove.RawImage",
        "foxglove.CompressedVideo",
    }
)
"""The message types that hold camera frames."""
BAD_BASE64_REASON = "the image is not valid base64"
"""The reason shown to users for a frame in JSON that can't be decoded."""
MAX_FRAMES_PER_BATCH = 64
"""The number of frames that are decoded at a time. Chosen by hand."""


@dataclass(frozen=True)
class Frame:
    """One camera image, still encoded.

    Attributes:
        log_time_ns, publish_time_ns: As recorded.
        stamp_ns: Stamp in the message, or None if it has none.
        format: Format of a compressed image or video (`jpeg`, `png`, `h264`, as in the message), else "".
        data: The image's bytes. They keep a chunk of the file in memory as long as they exist.
        width, height, encoding, step: Layout of a raw image, else 0 and "".
        frame_id: Frame of reference of the camera, as in the message.
        is_video: The message is one of compressed video, whatever its `format`.
    """

    log_time_ns: int
    publish_time_ns: int
    stamp_ns: int | None
    format: str
    data: bytes | memoryview
    width: int
    height: int
    encoding: str
    step: int
    frame_id: str
    is_video: bool = False


def is_camera_channel(channel: ChannelInfo) -> bool:
    """Tell whether a channel holds camera frames."""
    return (
        package_slash_message_name(channel.schema_name) if "/" in channel.schema_name else channel.schema_name
    ) in IMAGE_SCHEMAS


def iter_camera_frames(
    reader: MessageReader,
    channels: Sequence[ChannelInfo],
    faults: Faults,
    name: str,
    spans_ns: Sequence[tuple[int, int]] | None = None,
) -> Iterator[Frame]:
    """Yield the camera frames of one topic in log-time order.

    One chunk is in memory at a time, a few if chunks overlap in time, and up to three more that are decompressed ahead.

    Args:
        name: The file's name, for messages.
        spans_ns: Chunks without messages logged in one of these times [start, end) are left out; None: none is.

    Raises:
        InputError: The topic holds no frames, or the file is damaged and `recover` is off.
        DataError: The topic has several schemas.
    """
    check_single_schema(channels, name)
    if not is_camera_channel(channels[0]):
        what = f"the channel {channels[0].topic} ({channels[0].schema_name or 'no schema'}) holds no camera frames"
        raise InputError(what, where=name, found=tuple(sorted(IMAGE_SCHEMAS)), hint="these schemas can be read")
    fields = {*IMAGE_FIELDS, *FRAME_ID_FIELDS, *chain.from_iterable(STAMP_FIELD_PAIRS)}
    decoder = make_channel_decoder(channels[0], fields, name, blobs=(IMAGE_DATA_FIELD,))
    return _iter_frames_in_time_order(reader, channels, _FrameDecoder(decoder, channels[0], faults), spans_ns)


class _FrameDecoder:
    """Decodes the frames of one batch after the other."""

    def __init__(self, decoder: Decoder, channel: ChannelInfo, faults: Faults) -> None:
        self._decoder = decoder
        self._is_base64 = channel.message_encoding == "json"
        self._is_video = channel.schema_name.endswith("CompressedVideo")
        self._reasons: dict[str, int] = {}
        self._faults = faults
        self._topic = channel.topic

    def iter_log_times_places_and_frames(self, batch: MessageBatch) -> Iterator[tuple[int, int, Frame]]:
        """Yield log time in ns, place in the chunk, and frame."""
        for start in range(0, len(batch), MAX_FRAMES_PER_BATCH):
            yield from self._decode_batch(
                batch.select_messages(np.arange(start, min(start + MAX_FRAMES_PER_BATCH, len(batch))))
            )

    def _decode_batch(self, batch: MessageBatch) -> Iterator[tuple[int, int, Frame]]:
        self._decoder.reset(len(batch))
        self._decoder.decode_batch(batch.payloads)
        outcome = self._decoder.outcome()
        for reason, count in outcome.reasons.items():
            self._count_undecodable(reason, count)
        rows = np.flatnonzero(outcome.is_ok)
        fields = self._decoder.build_columns(rows)
        blobs = self._decoder.blobs_of_last_batch(IMAGE_DATA_FIELD)
        stamps = _message_stamps_ns(fields, len(rows))
        for k, row in enumerate(rows.tolist()):
            data = blobs[row]
            if self._is_base64:
                try:
                    data = base64.b64decode(data, validate=True)
                except (binascii.Error, ValueError):
                    self._count_undecodable(BAD_BASE64_REASON, 1)
                    continue
            log_time_ns = int(batch.log_time_ns[row])
            frame = Frame(
                log_time_ns=log_time_ns,
                publish_time_ns=int(batch.publish_time_ns[row]),
                stamp_ns=stamps[k],
                format=_first_text_of_row_or_empty(fields, k, "format"),
                data=data,
                width=_integer_of_row_or_zero(fields, k, "width"),
                height=_integer_of_row_or_zero(fields, k, "height"),
                encoding=_first_text_of_row_or_empty(fields, k, "encoding"),
                step=_integer_of_row_or_zero(fields, k, "step"),
                frame_id=_first_text_of_row_or_empty(fields, k, *FRAME_ID_FIELDS),
                is_video=self._is_video,
            )
            yield log_time_ns, int(batch.payloads.starts[row]), frame

    def _count_undecodable(self, reason: str, count: int) -> None:
        self._reasons[reason] = self._reasons.get(reason, 0) + count
        self._faults.keep_largest_undecodable_count(self._topic, reason, self._reasons[reason])


def _iter_frames_in_time_order(
    reader: MessageReader,
    channels: Sequence[ChannelInfo],
    decoding: _FrameDecoder,
    spans_ns: Sequence[tuple[int, int]] | None,
) -> Iterator[Frame]:
    """Yield the frames in log-time order: a frame waits until no later chunk can hold an earlier one."""
    ids = [channel.id for channel in channels]
    reader.distrust_indexes_if_miscounted(ids)
    n_read = Counter(dict.fromkeys(ids, 0))
    waiting: list[tuple[int, int, int, int, Frame | MessageBatch]] = []

    def pop_earliest() -> Iterator[Frame]:
        found = heapq.heappop(waiting)[-1]
        if isinstance(found, Frame):
            yield found
        else:
            yield from (frame for _, _, frame in decoding.iter_log_times_places_and_frames(found))

    for start_ns, part, batches in reader.iter_log_times_offsets_and_batches_of_parts(ids, spans_ns):
        while waiting and waiting[0][0] < start_ns:
            yield from pop_earliest()
        for batch in batches:
            n_read.update(batch.channel_id.tolist())
            packed = zstd_message_mask(batch.payloads)
            for row in np.flatnonzero(packed):  # decompressed when needed: a chunk of them may have any size
                place = int(batch.payloads.starts[row])
                one = batch.select_messages(np.array([row]))
                heapq.heappush(waiting, (int(batch.log_time_ns[row]), part, place, len(waiting), one))
            for log_time_ns, place, frame in decoding.iter_log_times_places_and_frames(
                batch.select_messages(np.flatnonzero(~packed))
            ):
                heapq.heappush(waiting, (log_time_ns, part, place, len(waiting), frame))
    if spans_ns is None:
        reader.note_miscounted_channels(n_read)
    while waiting:
        yield from pop_earliest()


def _message_stamps_ns(fields: dict[str, Field], n: int) -> list[int | None]:
    """Return the stamp in ns of each of n messages, None where there is none."""
    for seconds_path, nanoseconds_path in STAMP_FIELD_PAIRS:
        seconds, nanoseconds = fields.get(seconds_path), fields.get(nanoseconds_path)
        if isinstance(seconds, np.ndarray) and isinstance(nanoseconds, np.ndarray):
            is_there = np.isfinite(seconds.astype(np.float64)) & np.isfinite(nanoseconds.astype(np.float64))
            return [int(seconds[k]) * NS_PER_S + int(nanoseconds[k]) if is_there[k] else None for k in range(n)]
    return [None] * n


def _first_text_of_row_or_empty(fields: dict[str, Field], row: int, *paths: str) -> str:
    """Return the text of a row in the first of these fields that exists, else ""."""
    for path in paths:
        column = fields.get(path)
        if isinstance(column, Strings):
            return column.text_of_row(row)
    return ""


def _integer_of_row_or_zero(fields: dict[str, Field], row: int, path: str) -> int:
    """Return the integer of a row in a field, 0 if it is absent."""
    column = fields.get(path)
    if not isinstance(column, np.ndarray) or column.ndim != 1 or not np.isfinite(float(column[row])):
        return 0
    return int(column[row])
