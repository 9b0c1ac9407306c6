"""Writes schemas, channels and messages as a log, in the order in which they come.

Chunks are those of the official library's writer byte for byte. What is not hot in it is not written here: attachments
and metadata.

Format: https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from typing import Protocol

from cwcli.logs.format import record_bytes
from cwcli.logs.format.records import (
    MCAP_MAGIC,
    Channel,
    ChunkIndex,
    Opcode,
    Schema,
    Statistics,
)

MIN_BYTES_OF_FULL_CHUNK = 1 << 20
"""The size in bytes beyond which a chunk is written, as in the official library."""
MAX_MESSAGE_SEQUENCE_NUMBER = 0xFFFFFFFF
"""The greatest sequence number of a message: the format has 32 bits for it (MCAP specification)."""
_MESSAGE_PREFIX_STRUCT = struct.Struct("<BQHIQQ")
"""A message record before its payload: opcode, length, channel, sequence, log and publish time (MCAP specification)."""
_MESSAGE_FIELDS_BYTES = 22
"""The size of the fields behind the length."""


class Output(Protocol):
    """What a log is written to."""

    @property
    def position(self) -> int:
        """Bytes written so far."""

    def write(self, data: bytes | bytearray | memoryview) -> object:
        """Write bytes."""


class MessageLog:
    """A log that is written; `finish` ends it.

    Args:
        output: Where it is written to.
        profile: Profile of the log.
        library: What wrote it.
    """

    def __init__(self, output: Output, profile: str, library: str) -> None:
        import lz4.frame

        self._compress = lz4.frame.compress
        self._output = output
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._counts: dict[int, int] = {}
        self._pieces: list[bytes | memoryview] = []
        self._n_bytes = 0
        # by channel: log time in ns and offset in the chunk of each message, in turn, as in a message index
        self._entries: dict[int, list[int]] = {}
        output.write(MCAP_MAGIC + record_bytes.encode_header(profile, library))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema; returns its id."""
        schema = Schema(len(self._schemas) + 1, name, encoding, data)
        self._schemas.append(schema)
        self._add_piece(record_bytes.encode_record(schema))
        return schema.id

    def add_channel(self, channel: Channel) -> int:
        """Add a channel, whose own id does not count; returns its id."""
        channel = channel._replace(id=len(self._channels) + 1)
        self._channels.append(channel)
        self._add_piece(record_bytes.encode_record(channel))
        return channel.id

    def add_message(self, channel_id: int, log_time_ns: int, payload: bytes | memoryview) -> None:
        """Add a message; its publish time is its log time."""
        sequence = self._counts.get(channel_id, 0)
        self._counts[channel_id] = sequence + 1
        entries = self._entries.get(channel_id)
        if entries is None:
            entries = self._entries[channel_id] = []
        entries += log_time_ns, self._n_bytes
        n = _MESSAGE_FIELDS_BYTES + len(payload)
        sequence &= MAX_MESSAGE_SEQUENCE_NUMBER
        self._pieces.append(
            _MESSAGE_PREFIX_STRUCT.pack(Opcode.MESSAGE, n, channel_id, sequence, log_time_ns, log_time_ns)
        )
        self._pieces.append(payload)
        self._n_bytes += n + 9
        if self._n_bytes > MIN_BYTES_OF_FULL_CHUNK:
            self._write_chunk()

    def finish(self) -> None:
        """Write what is left, and the summary."""
        self._write_chunk()
        self._output.write(record_bytes.encode_data_end())
        start = self._output.position
        summary, offsets = bytearray(), bytearray()
        groups = {
            Opcode.SCHEMA: [record_bytes.encode_record(each) for each in self._schemas],
            Opcode.CHANNEL: [record_bytes.encode_record(each) for each in self._channels],
            Opcode.STATISTICS: [record_bytes.encode_record(self._statistics())],
            Opcode.CHUNK_INDEX: [record_bytes.encode_record(each) for each in self._chunks],
        }
        for opcode, records in groups.items():
            group = b"".join(records)
            if group:
                offsets += record_bytes.encode_summary_offset(opcode, start + len(summary), len(group))
                summary += group
        offsets_start = start + len(summary)
        summary += offsets
        self._output.write(summary + record_bytes.encode_footer(start, offsets_start, summary) + MCAP_MAGIC)

    def _statistics(self) -> Statistics:
        spans = [(each.start_ns, each.end_ns) for each in self._chunks]
        return Statistics(
            n_messages=sum(self._counts.values()),
            n_schemas=len(self._schemas),
            n_channels=len(self._channels),
            n_attachments=0,
            n_metadata=0,
            n_chunks=len(self._chunks),
            start_ns=min((start_ns for start_ns, _ in spans), default=0),
            end_ns=max((end_ns for _, end_ns in spans), default=0),
            channel_counts=self._counts,
        )

    def _add_piece(self, data: bytes) -> None:
        self._pieces.append(data)
        self._n_bytes += len(data)
        if self._n_bytes > MIN_BYTES_OF_FULL_CHUNK:
            self._write_chunk()

    def _write_chunk(self) -> None:
        """Write the chunk in progress, if it has messages."""
        if not self._entries:
            return
        data = b"".join(self._pieces)
        self._pieces = []
        stored = self._compress(data)
        times_ns = [entries[::2] for entries in self._entries.values()]
        start_ns, end_ns = min(map(min, times_ns)), max(map(max, times_ns))
        start = self._output.position
        crc = zlib.crc32(data)
        self._output.write(record_bytes.encode_chunk_head(start_ns, end_ns, len(data), crc, "lz4", len(stored)))
        self._output.write(stored)
        end = self._output.position
        offsets: dict[int, int] = {}
        for channel_id, entries in self._entries.items():
            offsets[channel_id] = self._output.position
            self._output.write(
                record_bytes.encode_message_index(channel_id, struct.pack(f"<{len(entries)}Q", *entries))
            )
        index_bytes = self._output.position - end
        self._chunks.append(
            ChunkIndex(start_ns, end_ns, start, end - start, offsets, index_bytes, "lz4", len(stored), len(data))
        )
        self._n_bytes = 0
        self._entries = {}
