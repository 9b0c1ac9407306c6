"""Writes schemas, channels and messages as a log, in the order in which they come.

Chunks are those of the official library's writer byte for byte; those that would not shrink are not compressed. What is
not hot in it is not written here: attachments and metadata.

Format: https://mcap.dev/spec
"""

from __future__ import annotations

import zlib
from typing import Protocol

from cwcli.kernels.record_write import write_records
from cwcli.logs.format import record_bytes
from cwcli.logs.format.records import (
    MCAP_MAGIC,
    MESSAGE_HEADER_BYTES,
    RECORD_PREFIX,
    Channel,
    ChunkIndex,
    Opcode,
    Schema,
    Statistics,
)

MIN_BYTES_OF_FULL_CHUNK = 1 << 20
"""The size in bytes beyond which a chunk is written, as in the official library."""
N_COMPRESSION_SAMPLES, BYTES_OF_COMPRESSION_SAMPLE, MIN_BYTES_TO_SAMPLE = 16, 2048, 1 << 18
"""Number and size in bytes of the samples that tell whether a chunk shrinks, and the size in bytes from which samples
are taken. Chosen by hand: they cost a thirtieth of the whole."""
MAX_COMPRESSED_SHARE = 0.8
"""The share of their size up to which samples must shrink for a chunk to be compressed. Chosen by hand: below it, the
time to compress and to unpack is worth more than the room."""
_MESSAGE_RECORD_BYTES_WITHOUT_PAYLOAD = RECORD_PREFIX.size + MESSAGE_HEADER_BYTES
"""The size in bytes of a message record without its payload (MCAP specification)."""


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
        self._schema_records: list[bytes] = []
        self._channel_records: list[bytes] = []
        self._chunks: list[ChunkIndex] = []
        self._counts: dict[int, int] = {}
        self._pieces: list[bytes | tuple[int, int, bytes]] = []
        self._n_bytes = 0
        self._n_messages_in_chunk = 0
        output.write(MCAP_MAGIC + record_bytes.encode_header(profile, library))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema; returns its id."""
        schema_id = len(self._schema_records) + 1
        self._schema_records.append(record_bytes.encode_record(Schema(schema_id, name, encoding, data)))
        self._add_piece(self._schema_records[-1])
        return schema_id

    def add_channel(self, channel: Channel) -> int:
        """Add a channel, whose own id does not count; returns its id."""
        channel_id = len(self._channel_records) + 1
        self._channel_records.append(record_bytes.encode_record(channel._replace(id=channel_id)))
        self._add_piece(self._channel_records[-1])
        return channel_id

    def add_message(self, channel_id: int, log_time_ns: int, payload: bytes) -> None:
        """Add a message; its publish time is its log time."""
        self._pieces.append((channel_id, log_time_ns, payload))
        self._n_messages_in_chunk += 1
        self._n_bytes += _MESSAGE_RECORD_BYTES_WITHOUT_PAYLOAD + len(payload)
        if self._n_bytes > MIN_BYTES_OF_FULL_CHUNK:
            self._write_chunk()

    def finish(self) -> None:
        """Write what is left, and the summary."""
        self._write_chunk()
        self._output.write(record_bytes.encode_data_end())
        start = self._output.position
        summary, offsets = bytearray(), bytearray()
        groups = {
            Opcode.SCHEMA: self._schema_records,
            Opcode.CHANNEL: self._channel_records,
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
            n_schemas=len(self._schema_records),
            n_channels=len(self._channel_records),
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
        if not self._n_messages_in_chunk:
            return
        data, entries = bytearray(self._n_bytes), dict[int, bytearray]()
        start_ns, end_ns = write_records(self._pieces, self._counts, entries, data)
        compression = "lz4" if self._shrinks_enough(data) else ""
        stored = self._compress(data) if compression else data
        start = self._output.position
        crc = zlib.crc32(data)
        self._output.write(record_bytes.encode_chunk_head(start_ns, end_ns, len(data), crc, compression, len(stored)))
        self._output.write(stored)
        end = self._output.position
        offsets: dict[int, int] = {}
        for channel_id, own in entries.items():
            offsets[channel_id] = self._output.position
            self._output.write(record_bytes.encode_message_index(channel_id, bytes(own)))
        index_bytes = self._output.position - end
        self._chunks.append(
            ChunkIndex(start_ns, end_ns, start, end - start, offsets, index_bytes, compression, len(stored), len(data))
        )
        self._pieces, self._n_bytes, self._n_messages_in_chunk = [], 0, 0

    def _shrinks_enough(self, data: bytearray) -> bool:
        """Tell from samples whether it pays to compress a chunk: pictures do not shrink, and to try takes long."""
        if len(data) < MIN_BYTES_TO_SAMPLE:
            return True
        step = len(data) // N_COMPRESSION_SAMPLES
        samples = b"".join(data[at : at + BYTES_OF_COMPRESSION_SAMPLE] for at in range(0, len(data), step))
        return len(self._compress(samples)) < MAX_COMPRESSED_SHARE * len(samples)
