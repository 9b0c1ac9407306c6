"""Camera frames of a topic, one at a time, in log-time order. The images stay encoded."""

from __future__ import annotations

import base64
import binascii
import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from cwcli.errors import InputError
from cwcli.logs.codecs.decoder import Decoder
from cwcli.logs.codecs.ros2msg import short_name
from cwcli.logs.codecs.unpacked import is_packed
from cwcli.logs.format.faults import Faults
from cwcli.logs.read.columns import decoder_for, single_schema
from cwcli.logs.read.message_reader import Batch, MessageReader
from cwcli.signals.columns import Field, Strings
from cwcli.signals.units import NS_PER_S

if TYPE_CHECKING:
    from cwcli.logs.read.channels import ChannelInfo

DATA = "data"
FIELDS = ("format", "encoding", "width", "height", "step")
STAMPS = (
    ("header.stamp.sec", "header.stamp.nanosec"),
    ("header.stamp.secs", "header.stamp.nsecs"),
    ("timestamp.sec", "timestamp.nanosec"),
    ("timestamp.sec", "timestamp.nsec"),
    ("timestamp.seconds", "timestamp.nanos"),
)
FRAME_IDS = ("header.frame_id", "frame_id")
SCHEMAS = frozenset(
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
BAD_BASE64 = "the image is not valid base64"
MAX_FRAMES_AT_ONCE = 64


@dataclass(frozen=True)
class Frame:
    """One camera image, still encoded.

    Attributes:
        log_time_ns, publish_time_ns: As recorded.
        stamp_ns: The message's own time, or None where it has none.
        format: Of a compressed image or video (`jpeg`, `png`, `h264`, as the message says), else "".
        data: The image's bytes. They keep a chunk of the file in memory as long as they are kept.
        width, height, encoding, step: Of a raw image, else 0 and "".
        frame_id: As the message says.
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


def is_camera(channel: ChannelInfo) -> bool:
    """Whether a channel holds frames."""
    return (short_name(channel.schema_name) if "/" in channel.schema_name else channel.schema_name) in SCHEMAS


def stream_frames(reader: MessageReader, channels: Sequence[ChannelInfo], faults: Faults, name: str) -> Iterator[Frame]:
    """The frames of one topic.

    One chunk is in memory at a time, a few where chunks overlap in time, and up to three more that are decompressed
    ahead.

    Args:
        reader: Of the file.
        channels: The topic's channels, one at least.
        faults: Counts what can't be decoded.
        name: Of the file, for messages.

    Raises:
        InputError: The topic holds no frames, or the file is damaged and `recover` is off.
        DataError: The topic has several schemas.
    """
    single_schema(channels, name)
    if not is_camera(channels[0]):
        what = f"the channel {channels[0].topic} ({channels[0].schema_name or 'no schema'}) holds no camera frames"
        raise InputError(what, where=name, found=tuple(sorted(SCHEMAS)), hint="these schemas can be read")
    fields = {*FIELDS, *FRAME_IDS, *chain.from_iterable(STAMPS)}
    decoder = decoder_for(channels[0], fields, name, blobs=(DATA,))
    return _ordered(reader, channels, _Decoding(decoder, channels[0], faults))


class _Decoding:
    """Frames of one batch after the other."""

    def __init__(self, decoder: Decoder, channel: ChannelInfo, faults: Faults) -> None:
        self._decoder = decoder
        self._is_base64 = channel.message_encoding == "json"
        self._is_video = channel.schema_name.endswith("CompressedVideo")
        self._reasons: dict[str, int] = {}
        self._faults = faults
        self._topic = channel.topic

    def frames(self, batch: Batch) -> Iterator[tuple[int, int, Frame]]:
        """Log time, place in the chunk, frame."""
        for start in range(0, len(batch), MAX_FRAMES_AT_ONCE):
            yield from self._frames(batch.take(np.arange(start, min(start + MAX_FRAMES_AT_ONCE, len(batch)))))

    def _frames(self, batch: Batch) -> Iterator[tuple[int, int, Frame]]:
        self._decoder.restart(len(batch))
        self._decoder.add(batch.payloads)
        outcome = self._decoder.outcome()
        for reason, count in outcome.reasons.items():
            self._count(reason, count)
        rows = np.flatnonzero(outcome.is_ok)
        fields = self._decoder.finish(rows)
        blobs = self._decoder.blobs(DATA)
        stamps = _stamps(fields, len(rows))
        for k, row in enumerate(rows.tolist()):
            data = blobs[row]
            if self._is_base64:
                try:
                    data = base64.b64decode(data, validate=True)
                except (binascii.Error, ValueError):
                    self._count(BAD_BASE64, 1)
                    continue
            log_time_ns = int(batch.log_time_ns[row])
            frame = Frame(
                log_time_ns=log_time_ns,
                publish_time_ns=int(batch.publish_time_ns[row]),
                stamp_ns=stamps[k],
                format=_text(fields, k, "format"),
                data=data,
                width=_number(fields, k, "width"),
                height=_number(fields, k, "height"),
                encoding=_text(fields, k, "encoding"),
                step=_number(fields, k, "step"),
                frame_id=_text(fields, k, *FRAME_IDS),
                is_video=self._is_video,
            )
            yield log_time_ns, int(batch.payloads.starts[row]), frame

    def _count(self, reason: str, count: int) -> None:
        self._reasons[reason] = self._reasons.get(reason, 0) + count
        self._faults.note_undecodable(self._topic, reason, self._reasons[reason])


def _ordered(reader: MessageReader, channels: Sequence[ChannelInfo], decoding: _Decoding) -> Iterator[Frame]:
    """Frames wait until no later chunk can hold an earlier one."""
    ids = [channel.id for channel in channels]
    reader.check_indexes(ids)
    tally = reader.counts.tally(ids)
    waiting: list[tuple[int, int, int, int, Frame | Batch]] = []

    def first() -> Iterator[Frame]:
        found = heapq.heappop(waiting)[-1]
        if isinstance(found, Frame):
            yield found
        else:
            yield from (frame for _, _, frame in decoding.frames(found))

    for start_ns, part, batches in reader.in_time_order(ids):
        while waiting and waiting[0][0] < start_ns:
            yield from first()
        for batch in batches:
            tally.add(batch.channel_id)
            packed = is_packed(batch.payloads)
            for row in np.flatnonzero(packed):  # unpacked when its turn comes: a chunk of them may be any size
                place = int(batch.payloads.starts[row])
                one = batch.take(np.array([row]))
                heapq.heappush(waiting, (int(batch.log_time_ns[row]), part, place, len(waiting), one))
            for log_time_ns, place, frame in decoding.frames(batch.take(np.flatnonzero(~packed))):
                heapq.heappush(waiting, (log_time_ns, part, place, len(waiting), frame))
    tally.end()
    while waiting:
        yield from first()


def _stamps(fields: dict[str, Field], n: int) -> list[int | None]:
    for seconds_path, nanoseconds_path in STAMPS:
        seconds, nanoseconds = fields.get(seconds_path), fields.get(nanoseconds_path)
        if isinstance(seconds, np.ndarray) and isinstance(nanoseconds, np.ndarray):
            is_there = np.isfinite(seconds.astype(np.float64)) & np.isfinite(nanoseconds.astype(np.float64))
            return [int(seconds[k]) * NS_PER_S + int(nanoseconds[k]) if is_there[k] else None for k in range(n)]
    return [None] * n


def _text(fields: dict[str, Field], row: int, *paths: str) -> str:
    for path in paths:
        column = fields.get(path)
        if isinstance(column, Strings):
            code = int(column.codes[row])
            return column.values[code] if code >= 0 else ""
    return ""


def _number(fields: dict[str, Field], row: int, path: str) -> int:
    column = fields.get(path)
    if not isinstance(column, np.ndarray) or column.ndim != 1 or not np.isfinite(float(column[row])):
        return 0
    return int(column[row])
