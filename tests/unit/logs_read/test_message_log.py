"""The log that a bag becomes: chunks as the official library writes them, and a summary that it reads."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

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


def messages(n: int, n_bytes: int) -> list[tuple[int, int, bytes]]:
    """Channel, log time, not in order, and payload of messages."""
    rng = np.random.default_rng(3)
    return [
        (int(rng.integers(N_CHANNELS)) + 1, int(rng.integers(1, 10**15)), rng.bytes(int(rng.integers(n_bytes))))
        for _ in range(n)
    ]


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


@pytest.mark.parametrize(("n", "n_bytes"), [(0, 1), (1, 10), (2000, 4000), (5, 3_000_000)])
def test_chunks_are_those_of_the_official_writer(n: int, n_bytes: int) -> None:
    sent = messages(n, n_bytes)
    official, own = io.BytesIO(), Target()
    writer = Writer(official, compression=CompressionType.LZ4)
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
