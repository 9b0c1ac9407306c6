"""The records of an MCAP file, written one behind the other, with the summary that belongs to them.

Format: https://mcap.dev/spec. Small records are serialised by the official library.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from cwcli.logs.format.records import MAGIC
from cwcli.logs.write.message_merge import ChunkPayload
from cwcli.output_stream import Output

if TYPE_CHECKING:
    import zstandard

ZSTD_LEVEL = 1


@dataclass(frozen=True)
class CopiedChunk:
    """A chunk record with the message indexes behind it, to be copied as it is.

    Attributes:
        start: Offset of the chunk record in the source.
        length: Bytes of the chunk record and the index records.
        index: As in the source's summary; its offsets count from the source's beginning.
        message_counts: Channel id -> messages.
        reindex: Its header or its indexes are wrong; only its records can be used.
    """

    start: int
    length: int
    index: ChunkIndex
    message_counts: Mapping[int, int]
    reindex: bool = False


class RecordWriter:
    """Writes records in the order of the calls; `finish` writes the summary.

    The data section's own CRC is left at 0 (not available), as the official Python writer does: each chunk, each
    attachment and the summary carry their CRC, and another one over all bytes would double the time of a copy.
    """

    def __init__(self, output: Output) -> None:
        self._output = output
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._first_ns: int | None = None
        self._last_ns = 0
        self._compressor: zstandard.ZstdCompressor | None = None

    def header(self, profile: str, library: str) -> None:
        """Magic bytes and header; the first thing in the file."""
        self._output.write(MAGIC + record_bytes(Header(profile, library)))

    def copy_header(self, source: int, length: int) -> None:
        """Magic bytes and header of another file: its first `length` bytes."""
        self._output.copy(source, 0, length)

    def schema(self, schema: Schema, *, listed_only: bool = False) -> None:
        """A schema, in the data section and the summary; with `listed_only` in the summary alone."""
        self._schemas[schema.id] = schema
        if not listed_only:
            self._output.write(record_bytes(schema))

    def channel(self, channel: Channel, *, listed_only: bool = False) -> None:
        """A channel, as `schema`."""
        self._channels[channel.id] = channel
        self._counts.setdefault(channel.id, 0)
        if not listed_only:
            self._output.write(record_bytes(channel))

    def chunk(self, payload: ChunkPayload) -> None:
        """New messages: a compressed chunk, and a message index for each of its channels."""
        if self._compressor is None:
            import zstandard

            self._compressor = zstandard.ZstdCompressor(ZSTD_LEVEL)
        compressed = self._compressor.compress(payload.data.data)
        self.raw_chunk(payload, "zstd", compressed)

    def raw_chunk(self, payload: ChunkPayload, compression: str, stored: bytes | memoryview) -> None:
        """As `chunk`, with the payload's bytes as they are to be stored."""
        start = self._output.position
        size = len(payload.data)
        fields = struct.pack("<QQQI", payload.start_ns, payload.end_ns, size, zlib.crc32(payload.data.data))
        name = compression.encode()
        fields += struct.pack("<I", len(name)) + name + struct.pack("<Q", len(stored))
        self._output.write(struct.pack("<BQ", Opcode.CHUNK, len(fields) + len(stored)) + fields)
        self._output.write(stored)
        chunk_length = self._output.position - start
        index_offsets: dict[int, int] = {}
        for channel_id, entries in payload.entries.items():
            index_offsets[channel_id] = self._output.position
            data = entries.tobytes()
            self._output.write(struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(data), channel_id, len(data)) + data)
        index = ChunkIndex(
            chunk_length=chunk_length,
            chunk_start_offset=start,
            compression=compression,
            compressed_size=len(stored),
            message_end_time=payload.end_ns,
            message_index_length=self._output.position - start - chunk_length,
            message_index_offsets=index_offsets,
            message_start_time=payload.start_ns,
            uncompressed_size=size,
        )
        self._list_chunk(index, {channel_id: len(entries) for channel_id, entries in payload.entries.items()})

    def copy_chunk(self, source: int, chunk: CopiedChunk) -> None:
        """A chunk with its message indexes, byte for byte."""
        shift = self._output.position - chunk.start
        self._output.copy(source, chunk.start, chunk.length)
        offsets = {channel_id: offset + shift for channel_id, offset in chunk.index.message_index_offsets.items()}
        index = replace(
            chunk.index, chunk_start_offset=chunk.index.chunk_start_offset + shift, message_index_offsets=offsets
        )
        self._list_chunk(index, chunk.message_counts)

    def attachment(self, attachment: Attachment) -> None:
        """A new attachment."""
        data = record_bytes(attachment)
        self._attachments.append(_attachment_index(attachment, self._output.position, len(data)))
        self._output.write(data)

    def copy_attachment(self, source: int, index: AttachmentIndex) -> None:
        """An attachment record byte for byte; `index` tells where it is in the source."""
        self._attachments.append(replace(index, offset=self._output.position))
        self._output.copy(source, index.offset, index.length)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """A new metadata record."""
        data = record_bytes(Metadata(name, dict(values)))
        self._metadata.append(MetadataIndex(self._output.position, len(data), name))
        self._output.write(data)

    def copy_metadata(self, source: int, index: MetadataIndex) -> None:
        """A metadata record byte for byte; `index` tells where it is in the source."""
        self._metadata.append(replace(index, offset=self._output.position))
        self._output.copy(source, index.offset, index.length)

    def record(self, data: bytes | memoryview) -> None:
        """A record that the summary does not list, as it stands."""
        self._output.write(data)

    def copy_record(self, source: int, start: int, length: int) -> None:
        """As `record`, from another file."""
        self._output.copy(source, start, length)

    def finish(self) -> None:
        """The end of the data section, the summary with its offsets, and the footer with the summary's CRC."""
        self._output.write(record_bytes(DataEnd(0)))
        summary_start = self._output.position
        summary = bytearray()
        offsets = bytearray()
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self._channels.values())),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, list(self._chunks)),
            (Opcode.ATTACHMENT_INDEX, list(self._attachments)),
            (Opcode.METADATA_INDEX, list(self._metadata)),
        ]
        for opcode, records in groups:
            group_start = len(summary)
            for record in records:
                summary += record_bytes(record)
            if records:
                length = len(summary) - group_start
                offsets += record_bytes(SummaryOffset(opcode, summary_start + group_start, length))
        offsets_start = summary_start + len(summary)
        footer = record_bytes(Footer(summary_start, offsets_start, 0))[:-4]
        checked = bytes(summary + offsets) + footer
        self._output.write(checked + struct.pack("<I", zlib.crc32(checked)) + MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=self._last_ns,
            message_start_time=self._first_ns or 0,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _list_chunk(self, index: ChunkIndex, message_counts: Mapping[int, int]) -> None:
        self._chunks.append(index)
        for channel_id, count in message_counts.items():
            self._counts[channel_id] = self._counts.get(channel_id, 0) + count
        if any(message_counts.values()):
            start, end = index.message_start_time, index.message_end_time
            self._first_ns = start if self._first_ns is None else min(self._first_ns, start)
            self._last_ns = max(self._last_ns, end)


def record_bytes(record: McapRecord) -> bytes:
    """A record as it stands in a file."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def _attachment_index(attachment: Attachment, offset: int, length: int) -> AttachmentIndex:
    return AttachmentIndex(
        offset=offset,
        length=length,
        log_time=attachment.log_time,
        create_time=attachment.create_time,
        data_size=len(attachment.data),
        name=attachment.name,
        media_type=attachment.media_type,
    )
