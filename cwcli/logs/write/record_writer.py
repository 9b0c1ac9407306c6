"""Writes the records of an MCAP file one after the other, and the summary of them.

Format: https://mcap.dev/spec
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

from cwcli.input import InputFile
from cwcli.logs.format import record_bytes
from cwcli.logs.format.metadata_table import MetadataRun, MetadataTable
from cwcli.logs.format.records import (
    MCAP_MAGIC,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Opcode,
    Schema,
    Statistics,
)
from cwcli.logs.write.message_merge import ChunkPayload
from cwcli.output_stream import OutputStream

if TYPE_CHECKING:
    import zstandard

ZSTD_LEVEL = 1
"""The zstd compression level of new chunks. Chosen: the fastest regular level."""


class RecordWriter:
    """Writes records in the order of the calls; `finish` writes the summary.

    The data section's own CRC is left at 0 (not available), as the official Python writer does: each chunk, each
    attachment and the summary carry their CRC, and another one over all bytes would double the time of a copy.
    """

    def __init__(self, output: OutputStream) -> None:
        self._output = output
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata = MetadataTable()
        self._counts: dict[int, int] = {}
        self._first_ns: int | None = None
        self._last_ns = 0
        self._compressor: zstandard.ZstdCompressor | None = None

    def write_header(self, profile: str, library: str) -> None:
        """Write magic bytes and header, the first bytes of the file."""
        self._output.write(MCAP_MAGIC + record_bytes.encode_header(profile, library))

    def write_schema(self, schema: Schema, *, listed_only: bool = False) -> None:
        """Write a schema to the data section and the summary; with `listed_only` to the summary alone."""
        self._schemas[schema.id] = schema
        if not listed_only:
            self._output.write(record_bytes.encode_record(schema))

    def write_channel(self, channel: Channel, *, listed_only: bool = False) -> None:
        """Write a channel to the data section and the summary; with `listed_only` to the summary alone."""
        self._channels[channel.id] = channel
        self._counts.setdefault(channel.id, 0)
        if not listed_only:
            self._output.write(record_bytes.encode_record(channel))

    def write_chunk(self, payload: ChunkPayload) -> None:
        """Write new messages: a compressed chunk, and a message index for each of its channels."""
        if self._compressor is None:
            import zstandard

            self._compressor = zstandard.ZstdCompressor(ZSTD_LEVEL)
        self.write_stored_chunk(payload, "zstd", self._compressor.compress(payload.data.data))

    def write_stored_chunk(
        self, payload: ChunkPayload, compression: str, stored: bytes | memoryview, *, is_indexed: bool = True
    ) -> None:
        """Write a chunk whose bytes are compressed already (`stored`), with or without message indexes."""
        start, size = self._output.position, len(payload.data)
        crc = zlib.crc32(payload.data.data)
        self._output.write(
            record_bytes.encode_chunk_head(payload.start_ns, payload.end_ns, size, crc, compression, len(stored))
        )
        self._output.write(stored)
        end = self._output.position
        offsets: dict[int, int] = {}
        for channel_id, entries in payload.entries.items() if is_indexed else ():
            offsets[channel_id] = self._output.position
            self._output.write(record_bytes.encode_message_index(channel_id, entries.tobytes()))
        counts = {channel_id: len(entries) for channel_id, entries in payload.entries.items()}
        span, index_length = (payload.start_ns, payload.end_ns), self._output.position - end
        self._add_chunk_to_summary(
            ChunkIndex(*span, start, end - start, offsets, index_length, compression, len(stored), size, counts)
        )

    def copy_chunk(self, source: InputFile, chunk: ChunkIndex) -> None:
        """Copy a chunk of another file with its message indexes, byte for byte; `chunk.counts` must be set."""
        shift = self._output.position - chunk.chunk_start
        offsets = {channel_id: offset + shift for channel_id, offset in chunk.index_offsets.items()}
        self.copy_bytes(source, chunk.chunk_start, chunk.chunk_length + chunk.index_length)
        self._add_chunk_to_summary(chunk._replace(chunk_start=chunk.chunk_start + shift, index_offsets=offsets))

    def copy_attachment(self, source: InputFile, index: AttachmentIndex) -> None:
        """Copy an attachment record byte for byte; `index` gives its place in the source."""
        self._attachments.append(index._replace(offset=self._output.position))
        self.copy_bytes(source, index.offset, index.length)

    def write_metadata(self, name: str, values: Mapping[str, str]) -> None:
        data = record_bytes.encode_metadata(name, values)
        self._metadata.append(self._output.position, len(data), name)
        self._output.write(data)

    def copy_metadata(self, source: InputFile, run: MetadataRun, table: MetadataTable) -> None:
        """Copy metadata records byte for byte; run and table give their places in the source."""
        shift = self._output.position - run.start
        for row in range(run.first, run.stop):
            offset, length, name = table[row]
            self._metadata.append(offset + shift, length, name)
        self.copy_bytes(source, run.start, run.end - run.start)

    def write_raw_record(self, data: bytes | memoryview) -> None:
        """Write the bytes of a record that the summary does not list."""
        self._output.write(data)

    def copy_bytes(self, source: InputFile, start: int, length: int) -> None:
        """Copy bytes of another file that the summary does not list."""
        file, start = source.part_and_offset(start)
        self._output.copy_from_file(file.descriptor, start, length)

    def write_summary_and_footer(
        self, kinds: Collection[int] | None = None, *, has_offsets: bool = True, data_crc: int = 0
    ) -> None:
        """Write the data end record, the summary with its offsets, and the footer with the summary's CRC.

        Args:
            kinds: Opcodes of the records that the summary holds; None for all.
            has_offsets: Write summary offset records.
            data_crc: CRC of the data section; 0 if it is not known.
        """
        self._output.write(record_bytes.encode_data_end(data_crc))
        start = self._output.position
        summary, offsets = bytearray(), bytearray()
        groups = {
            Opcode.SCHEMA: [record_bytes.encode_record(each) for each in self._schemas.values()],
            Opcode.CHANNEL: [record_bytes.encode_record(each) for each in self._channels.values()],
            Opcode.STATISTICS: [record_bytes.encode_record(self._build_statistics())],
            Opcode.CHUNK_INDEX: [record_bytes.encode_record(each) for each in self._chunks],
            Opcode.ATTACHMENT_INDEX: [record_bytes.encode_record(each) for each in self._attachments],
            Opcode.METADATA_INDEX: [record_bytes.encode_record(each) for each in self._metadata],
        }
        for opcode, records in groups.items():
            group = b"".join(records)
            if group and (kinds is None or opcode in kinds):
                offsets += record_bytes.encode_summary_offset(opcode, start + len(summary), len(group))
                summary += group
        offsets_start = start + len(summary) if has_offsets else 0
        summary += offsets if has_offsets else b""
        footer = record_bytes.encode_footer(start if summary else 0, offsets_start, summary)
        self._output.write(summary + footer + MCAP_MAGIC)

    def _build_statistics(self) -> Statistics:
        return Statistics(
            n_messages=sum(self._counts.values()),
            n_schemas=len(self._schemas),
            n_channels=len(self._channels),
            n_attachments=len(self._attachments),
            n_metadata=len(self._metadata),
            n_chunks=len(self._chunks),
            start_ns=self._first_ns or 0,
            end_ns=self._last_ns,
            channel_counts=self._counts,
        )

    def _add_chunk_to_summary(self, chunk: ChunkIndex) -> None:
        self._chunks.append(chunk)
        counts = chunk.counts or {}
        for channel_id, count in counts.items():
            self._counts[channel_id] = self._counts.get(channel_id, 0) + count
        if any(counts.values()):
            self._first_ns = chunk.start_ns if self._first_ns is None else min(self._first_ns, chunk.start_ns)
            self._last_ns = max(self._last_ns, chunk.end_ns)
