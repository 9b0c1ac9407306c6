"""Logs whose summaries do not tell what is in them."""

from __future__ import annotations

from collections.abc import Callable

from cwcli.logs.format import record_bytes
from cwcli.logs.format.records import (
    MCAP_MAGIC,
    Channel,
    ChunkIndex,
    Footer,
    Opcode,
    Statistics,
    read_opcode_and_content_range,
    read_record,
)


def with_summary(data: bytes, summary: bytes) -> bytes:
    """A file of these records and this summary."""
    start = len(data) + len(record_bytes.encode_data_end())
    return data + record_bytes.encode_data_end() + summary + record_bytes.encode_footer(start, 0, summary) + MCAP_MAGIC


def retold(
    data: bytes,
    *,
    chunk: Callable[[ChunkIndex, dict[str, int]], ChunkIndex] = lambda index, ids: index,
    counted: Callable[[Statistics, dict[str, int]], Statistics] = lambda statistics, ids: statistics,
) -> bytes:
    """A log with other chunk indexes and statistics in its summary; the functions get the channels' ids by topic."""
    view = memoryview(data)
    footer_at = len(data) - len(MCAP_MAGIC) - len(record_bytes.encode_footer(0, 0, b""))
    _, start, end = read_opcode_and_content_range(view, footer_at, len(data))
    summary_at = read_record(Footer, view, start, end).summary_start
    records, at = [], summary_at
    while at < footer_at:
        opcode, start, end = read_opcode_and_content_range(view, at, footer_at)
        records.append((opcode, start, end, bytes(view[at:end])))
        at = end
    channels = [read_record(Channel, view, start, end) for opcode, start, end, _ in records if opcode == Opcode.CHANNEL]
    ids = {channel.topic: channel.id for channel in channels}
    summary = b""
    for opcode, start, end, record in records:
        if opcode == Opcode.CHUNK_INDEX:
            summary += record_bytes.encode_record(chunk(read_record(ChunkIndex, view, start, end), ids))
        elif opcode == Opcode.STATISTICS:
            summary += record_bytes.encode_record(counted(read_record(Statistics, view, start, end), ids))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX):
            summary += record
    return with_summary(data[: summary_at - len(record_bytes.encode_data_end())], summary)


def hiding(data: bytes, topic: str, *, n: int = 2) -> bytes:
    """A log whose index of the n-th chunk with a topic does not tell of it."""
    seen = 0

    def without(index: ChunkIndex, ids: dict[str, int]) -> ChunkIndex:
        nonlocal seen
        if ids[topic] not in index.index_offsets:
            return index
        seen += 1
        if seen != n:
            return index
        kept = {each: offset for each, offset in index.index_offsets.items() if each != ids[topic]}
        return index._replace(index_offsets=kept)

    made = retold(data, chunk=without)
    assert seen >= n
    return made


def counting_one_more(data: bytes, topic: str) -> bytes:
    """A log whose statistics count one message of a topic too many."""

    def more(statistics: Statistics, ids: dict[str, int]) -> Statistics:
        counts = {each: n + (each == ids[topic]) for each, n in statistics.channel_counts.items()}
        return statistics._replace(n_messages=statistics.n_messages + 1, channel_counts=counts)

    return retold(data, counted=more)
