"""The source's part of an annotated log."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mcap.records import AttachmentIndex, MetadataIndex

from cwcli.errors import InputError
from cwcli.input import InputFile
from cwcli.logs.format.chunk_records import chunk_records, index_entries, open_chunk, stored_bytes, without_channels
from cwcli.logs.format.chunks import ChunkError
from cwcli.logs.format.faults import RECOVER_HINT
from cwcli.logs.format.layout import Item, Layout, LooseMessages, LooseRecord, SalvagedRecords, damage_at
from cwcli.logs.format.records import CHANNEL, SCHEMA, RecordError
from cwcli.logs.write.message_merge import ChunkPayload
from cwcli.logs.write.record_writer import CopiedChunk, RecordWriter

MAX_TIME_NS = (1 << 63) - 1


class SourceCopy:
    """Copies the records of a source, all but those of replaced channels and metadata records.

    Args:
        layout: What the source holds.
        source: The open file.
        replaced_ids: Channels to leave out.
        replaced_metadata: Names of metadata records to leave out.
        written_schema_ids: Schemas that stand at the beginning already.
        profile: That of the copy.
        name: For messages.

    Attributes:
        n_messages, n_chunks: Copied so far.
    """

    def __init__(
        self,
        layout: Layout,
        source: InputFile,
        replaced_ids: frozenset[int],
        replaced_metadata: frozenset[str],
        written_schema_ids: frozenset[int],
        profile: str,
        name: str,
    ) -> None:
        self._layout = layout
        self._source = source
        self._replaced_ids = replaced_ids
        self._replaced_metadata = replaced_metadata
        self._written_schema_ids = written_schema_ids
        self._profile = profile
        self._name = name
        self.n_messages = 0
        self.n_chunks = 0

    def begin(self, writer: RecordWriter) -> None:
        """The header, and the definitions that the summary is to list; written too where their chunk may be lost."""
        layout = self._layout
        if layout.header_length and layout.profile == self._profile:
            writer.copy_header(self._source.descriptor, layout.header_length)
        else:
            writer.header(self._profile, layout.library)
        kept = [each for each in layout.channels.values() if each.id not in self._replaced_ids]
        orphans = {layout.channels[each].schema_id for each in self._replaced_ids} - {each.schema_id for each in kept}
        listed_only = not layout.n_bytes_lost
        for schema in layout.schemas.values():
            if schema.id not in orphans:
                writer.schema(schema, listed_only=listed_only)
        for channel in kept:
            writer.channel(channel, listed_only=listed_only)

    def check_source(self) -> None:
        """Check that what was copied so far is not a mixture: standard output gets no end then."""
        self._source.check_unchanged()

    def item(self, writer: RecordWriter, item: Item) -> int | None:
        """Copy one item; returns the last log time in it, or None if it holds no message."""
        if isinstance(item, CopiedChunk):
            return self._chunk(writer, item)
        if isinstance(item, LooseMessages):
            records = self._source[item.start : item.start + item.length]
            return self._unchunked(writer, records, item.entries, compressed=False)
        if isinstance(item, SalvagedRecords):
            return self._unchunked(writer, item.records, item.entries, compressed=True)
        if isinstance(item, LooseRecord):
            if item.channel_id not in self._replaced_ids and item.schema_id not in self._written_schema_ids:
                writer.copy_record(self._source.descriptor, item.start, item.length)
        elif isinstance(item, AttachmentIndex):
            writer.copy_attachment(self._source.descriptor, item)
        elif isinstance(item, MetadataIndex) and item.name not in self._replaced_metadata:
            writer.copy_metadata(self._source.descriptor, item)
        return None

    def _chunk(self, writer: RecordWriter, chunk: CopiedChunk) -> int | None:
        filtered = not self._replaced_ids.isdisjoint(chunk.message_counts)
        if filtered or chunk.reindex:
            return self._rebuilt_chunk(writer, chunk, filtered)
        writer.copy_chunk(self._source.descriptor, chunk)
        self.n_chunks += 1
        self.n_messages += sum(chunk.message_counts.values())
        return min(chunk.index.message_end_time, MAX_TIME_NS) if any(chunk.message_counts.values()) else None

    def _rebuilt_chunk(self, writer: RecordWriter, chunk: CopiedChunk, filtered: bool) -> int | None:
        try:
            records = open_chunk(self._source, chunk.index)
            if filtered:
                records = without_channels(records, self._replaced_ids)
            entries = index_entries(records)
        except (ChunkError, RecordError) as error:
            raise InputError(damage_at(chunk.start, error), where=self._name, hint=RECOVER_HINT) from error
        if not entries:
            for opcode, start, end in chunk_records(records):
                if opcode in (SCHEMA, CHANNEL):
                    writer.record(records[start:end])
            return None
        payload = _payload(records, entries)
        if filtered:
            writer.chunk(payload)
        else:
            writer.raw_chunk(payload, chunk.index.compression, stored_bytes(self._source, chunk.index))
        return self._count(payload)

    def _unchunked(
        self,
        writer: RecordWriter,
        records: memoryview,
        entries: dict[int, npt.NDArray[np.void]],
        *,
        compressed: bool,
    ) -> int | None:
        """Put records that have no chunk of their own into one."""
        if not self._replaced_ids.isdisjoint(entries):
            records = without_channels(records, self._replaced_ids)
            entries = index_entries(records)
        if not entries:
            return None
        payload = _payload(records, entries)
        if compressed:
            writer.chunk(payload)
        else:
            writer.raw_chunk(payload, "", records)
        return self._count(payload)

    def _count(self, payload: ChunkPayload) -> int:
        self.n_chunks += 1
        self.n_messages += sum(map(len, payload.entries.values()))
        return min(payload.end_ns, MAX_TIME_NS)


def _payload(records: memoryview, entries: dict[int, npt.NDArray[np.void]]) -> ChunkPayload:
    start_ns = min(int(each["log_time"].min()) for each in entries.values())
    end_ns = max(int(each["log_time"].max()) for each in entries.values())
    return ChunkPayload(np.frombuffer(records, np.uint8), start_ns, end_ns, entries)
