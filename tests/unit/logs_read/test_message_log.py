"""The log that a bag becomes: chunks as the official library writes them, and a summary that it reads."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from cwcli.kernels.record_write import write_records
from cwcli.logs.format.message_log import MessageLog
from cwcli.logs.format.records import Channel

N_CHANNELS = 3
LATER = 700
"""The message in front of which another channel comes, in the second chunk."""


class Target(io.BytesIO):
    """A log in memory."""

    @property
    def position(self) -> int:
        return self.tell()


def messages(n: int, n_bytes: int, share_of_zeros: float) -> list[tuple[int, int, bytes]]:
    """Channel, log time, not in order, and payload of messages: random octets, and zeros behind them."""
    rng = np.random.default_rng(3)
    sizes = rng.integers(n_bytes, size=n).tolist()
    payloads = [rng.bytes(round(size * (1.0 - share_of_zeros))).ljust(size, b"\0") for size in sizes]
    return [(int(rng.integers(N_CHANNELS)) + 1, int(rng.integers(1, 10**15)), payload) for payload in payloads]


def fill(add_schema: Any, add_channel: Any, add_message: Any, sent: list[tuple[int, int, bytes]]) -> None:
    """Three channels, one without a schema, their messages, and a channel that comes later."""
    first = add_schema("a/msg/A", "ros2msg", b"float64 x\n")
    for k in range(N_CHANNELS):
        add_channel(f"/{k}", first if k else 0)
    counts: dict[int, int] = {}
    for k, (channel, log_time_ns, payload) in enumerate(sent):
        if k == LATER:
            add_channel("/later", add_schema("b/msg/B", "ros2msg", b"int8 y\n"))
        add_message(channel, log_time_ns, payload, counts.get(channel, 0))
        counts[channel] = counts.get(channel, 0) + 1


@pytest.mark.parametrize(
    ("n", "n_bytes", "share_of_zeros", "compression"),
    [
        (0, 1, 0.0, CompressionType.LZ4),
        (1, 10, 0.0, CompressionType.LZ4),
        (2000, 4000, 0.5, CompressionType.LZ4),
        (5, 3_000_000, 0.5, CompressionType.LZ4),
        (2000, 4000, 0.0, CompressionType.NONE),  # what does not shrink is not compressed
        (2000, 4000, 0.1, CompressionType.NONE),
        (5, 3_000_000, 0.0, CompressionType.NONE),
    ],
)
def test_chunks_are_those_of_the_official_writer(
    n: int, n_bytes: int, share_of_zeros: float, compression: CompressionType
) -> None:
    sent = messages(n, n_bytes, share_of_zeros)
    official, own = io.BytesIO(), Target()
    writer = Writer(official, compression=compression)
    writer.start("ros2", "cwcli")
    fill(
        writer.register_schema,
        lambda topic, schema: writer.register_channel(topic, "cdr", schema),
        lambda channel, t, data, k: writer.add_message(channel, t, data, t, k),
        sent,
    )
    writer.finish()
    log = MessageLog(own, "ros2", "cwcli")
    fill(
        log.add_schema,
        lambda topic, schema: log.add_channel(Channel(0, schema, topic, "cdr", {})),
        lambda channel, t, data, _: log.add_message(channel, t, data),
        sent,
    )
    log.finish()
    read = [make_reader(io.BytesIO(each.getvalue())) for each in (official, own)]
    summaries = [each.get_summary() for each in read]
    assert summaries[0] is not None and summaries[1] is not None
    assert summaries[0].statistics == summaries[1].statistics
    assert (summaries[0].chunk_indexes, summaries[0].channels) == (summaries[1].chunk_indexes, summaries[1].channels)
    end = max((each.chunk_start_offset + each.chunk_length for each in summaries[0].chunk_indexes), default=8)
    assert official.getvalue()[:end] == own.getvalue()[:end]
    assert list(read[0].iter_messages()) == list(read[1].iter_messages())


@pytest.mark.parametrize("room", [-1, 1])
def test_records_that_need_other_room_are_refused(room: int) -> None:
    with pytest.raises(ValueError, match="the records need"):
        write_records([b"record", (1, 5, b"payload")], {}, {}, bytearray(6 + 31 + 7 + room))


@pytest.mark.parametrize(("channel_id", "log_time_ns"), [(1 << 16, 5), (-1, 5), (1, -1), (1, 1 << 64)])
def test_numbers_that_do_not_fit_into_a_message_record_are_refused(channel_id: int, log_time_ns: int) -> None:
    with pytest.raises(OverflowError):
        write_records([(channel_id, log_time_ns, b"")], {}, {}, bytearray(31))


def test_sequence_numbers_begin_again_where_32_bits_end() -> None:
    out = bytearray(62)
    counts = {1: (1 << 32) - 1}
    assert write_records([(1, 7, b""), (1, 5, b"")], counts, {}, out) == (5, 7)
    assert [out[k + 11 : k + 15] for k in (0, 31)] == [b"\xff\xff\xff\xff", b"\0\0\0\0"]
    assert counts == {1: (1 << 32) + 1}
