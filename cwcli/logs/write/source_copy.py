"""Copies the source's records into an annotated log."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cwcli.input import InputFile
from cwcli.kernels.message_scan import DAMAGED
from cwcli.logs.format.chunks import (
    ChunkError,
    decompress_chunk,
    decompress_cut_chunk_up_to_error,
    iter_opcodes_and_record_bounds,
    stored_chunk_bytes,
    trim_to_whole_records,
)
from cwcli.logs.format.faults import Faults, damaged_file_error
from cwcli.logs.format.index import Item, LogIndex, UnchunkedRange, UnchunkedRecord
from cwcli.logs.format.records import (
    RECORD_PREFIX,
    AttachmentIndex,
    ChunkIndex,
    Opcode,
    RecordError,
    attachment_crc_offset,
    crc32_of_range,
    read_opcode_and_content_range,
)
from cwcli.logs.read.message_reader import (
    MIN_MESSAGE_BYTES,
    find_message_index_entries,
    scan_messages_next_offset_and_status,
)
from cwcli.logs.write.message_merge import INDEX_ENTRY_DTYPE, ChunkPayload
from cwcli.logs.write.record_writer import RecordWriter

MAX_INT64_TIME_NS = (1 << 63) - 1
"""The greatest log time in ns that a signed 64-bit number represents."""
BYTES_OF_CHUNK_OF_UNCHUNKED_MESSAGES = 1 << 20
"""The size in bytes at which messages outside chunks are put into a further chunk. Chosen by hand."""
MASK_OF_ALL_CHANNEL_IDS = np.ones(1 << 16, np.uint8)
"""The mask of wanted channel ids (65536,) that selects all of them."""

IndexEntriesByChannelId = dict[int, npt.NDArray[np.void]]
"""Channel id -> (log time, offset) of its messages in file order, dtype `INDEX_ENTRY_DTYPE`."""


class SourceCopy:
    """Copies the records of a source, except replaced channels and metadata records.

    A chunk of a file without a complete summary, and every chunk with `recover`, is opened and its CRC checked; a wrong
    header or wrong indexes are rewritten. Other chunks are copied unchanged with their CRC, which readers check.

    Args:
        index: Lists every record of the source.
        recover: Leave out what is damaged.

    Attributes:
        items: The items to copy, in file order.
        n_messages, n_chunks: Copied so far.

    Raises:
        InputError: A chunk is damaged and `recover` is off.
    """

    def __init__(self, source: InputFile, index: LogIndex, faults: Faults, *, recover: bool) -> None:
        self._source = source
        self._index = index
        self._faults = faults
        self._recover = recover
        self._reindexed: set[int] = set()
        self._replaced_ids: frozenset[int] = frozenset()
        self._replaced_metadata: frozenset[str] = frozenset()
        self._written_schema_ids: frozenset[int] = frozenset()
        self.items: list[Item] = [intact for item in index.items for intact in self._iter_intact_items(item)]
        self.n_messages = 0
        self.n_chunks = 0

    def _iter_intact_items(self, item: Item) -> Iterator[Item]:
        """Yield the item if it is intact: a chunk with its true message counts, a range outside chunks in pieces."""
        if isinstance(item, ChunkIndex):
            if item.chunk_start in self._index.cut_chunks:
                self._faults.bytes_lost += item.chunk_length
                yield item
            elif self._recover or not item.index_offsets or not self._index.has_complete_summary:
                try:
                    yield self._count_messages_and_mark_wrong_indexes(item)
                except (ChunkError, RecordError) as error:
                    if not self._recover:
                        raise damaged_file_error(self._source, item.chunk_start, error) from error
                    self._faults.chunks_lost += 1
                    self._faults.bytes_lost += item.end_offset - item.chunk_start
            else:
                yield item
        elif isinstance(item, UnchunkedRange):
            yield from self._split_unchunked_range(item)
        elif isinstance(item, AttachmentIndex) and self._recover and not self._is_attachment_intact(item):
            self._faults.bytes_lost += item.length
        else:
            yield item

    def _count_messages_and_mark_wrong_indexes(self, chunk: ChunkIndex) -> ChunkIndex:
        """Return the chunk with its true message counts, and mark it for new indexes if header or indexes are wrong."""
        entries = message_index_entries_by_channel(self._decompress_with_log_ids(chunk))
        times = np.concatenate([np.zeros(0, "<u8"), *(each["log_time"] for each in entries.values())])
        fits = not len(times) or (int(times.min()), int(times.max())) == (chunk.start_ns, chunk.end_ns)
        if chunk.index_offsets:
            fits &= entries.keys() == chunk.index_offsets.keys()
            fits = fits and all(
                self._is_message_index_correct(chunk, channel_id, rows) for channel_id, rows in entries.items()
            )
        if not fits:
            self._reindexed.add(chunk.chunk_start)
        return chunk._replace(counts={channel_id: len(rows) for channel_id, rows in entries.items()})

    def _is_message_index_correct(self, chunk: ChunkIndex, channel_id: int, entries: npt.NDArray[np.void]) -> bool:
        """Tell whether a message index record holds these entries, in any order."""
        listed = find_message_index_entries(self._source, self._index, chunk, channel_id)
        return listed is not None and np.array_equal(
            np.sort(listed.view(INDEX_ENTRY_DTYPE)[:, 0], order="offset"), entries
        )

    def _split_unchunked_range(self, span: UnchunkedRange) -> Iterator[UnchunkedRange]:
        """Split a range outside chunks into ranges of about `BYTES_OF_CHUNK_OF_UNCHUNKED_MESSAGES`."""
        bounds = [span.start]
        at = span.start
        while at < span.end:
            if at - bounds[-1] >= BYTES_OF_CHUNK_OF_UNCHUNKED_MESSAGES:
                bounds.append(at)
            _, _, at = read_opcode_and_content_range(self._source, at, span.end)
        return (UnchunkedRange(*bounds) for bounds in pairwise([*bounds, span.end]))

    def _is_attachment_intact(self, item: AttachmentIndex) -> bool:
        """Tell whether the CRC of an attachment is right or absent."""
        at = attachment_crc_offset(item)
        (crc,) = struct.unpack("<I", self._source[at : at + 4])
        return not crc or crc == crc32_of_range(self._source, item.offset + RECORD_PREFIX.size, at)

    def write_header_and_definitions(
        self,
        writer: RecordWriter,
        profile: str,
        *,
        replaced_ids: frozenset[int],
        replaced_metadata: frozenset[str],
        written_schema_ids: frozenset[int],
    ) -> None:
        """Write the header, and list schemas and channels in the summary; write them too if their chunk may be lost.

        Args:
            replaced_ids: Ids of channels to leave out.
            replaced_metadata: Names of metadata records to leave out.
            written_schema_ids: Ids of schemas that the caller writes.
        """
        self._replaced_ids, self._replaced_metadata = replaced_ids, replaced_metadata
        self._written_schema_ids = written_schema_ids
        index = self._index
        if index.header_length and index.profile == profile:
            writer.copy_bytes(self._source, 0, index.header_length)
        else:
            writer.write_header(profile, index.library)
        remaining_channels = [each for each in index.channels.values() if each.id not in replaced_ids]
        orphans = {index.channels[each].schema_id for each in replaced_ids} - {
            each.schema_id for each in remaining_channels
        }
        listed_only = not self._faults.bytes_lost and not index.renumberings
        for schema in index.schemas.values():
            if schema.id not in orphans:
                writer.write_schema(schema, listed_only=listed_only)
        for channel in remaining_channels:
            writer.write_channel(channel, listed_only=listed_only)

    def check_source_unchanged(self) -> None:
        """Check that the source has not changed during the copy, before the end is written."""
        self._source.check_unchanged()

    def copy_item_and_get_last_log_time(self, writer: RecordWriter, item: Item) -> int | None:
        """Copy one item; return its last log time in ns, or None if it holds no message."""
        if isinstance(item, ChunkIndex):
            return self._copy_chunk_and_get_last_log_time(writer, item)
        if isinstance(item, UnchunkedRange):
            records = self._index.records_with_log_ids(item.start, self._source[item.start : item.end])
            return self._write_chunk_and_get_last_log_time(writer, records, compress=False)
        if isinstance(item, UnchunkedRecord):
            left_out = {Opcode.CHANNEL: self._replaced_ids, Opcode.SCHEMA: self._written_schema_ids}.get(
                item.opcode, ()
            )
            if item.id not in left_out:
                writer.copy_bytes(self._source, item.start, item.length)
        elif isinstance(item, AttachmentIndex):
            writer.copy_attachment(self._source, item)
        else:
            for run in self._index.metadata.split_run_around_names(item, self._replaced_metadata):
                writer.copy_metadata(self._source, run, self._index.metadata)
        return None

    def _copy_chunk_and_get_last_log_time(self, writer: RecordWriter, chunk: ChunkIndex) -> int | None:
        """Copy a chunk, rebuilt if needed; return its last log time in ns."""
        if chunk.chunk_start in self._index.cut_chunks:
            try:
                records = trim_to_whole_records(decompress_cut_chunk_up_to_error(self._source, chunk))
                records = self._index.records_with_log_ids(chunk.chunk_start, records)
            except ChunkError:
                self._faults.chunks_lost += 1
                return None
            return self._write_chunk_and_get_last_log_time(writer, records, compress=True)
        counts = chunk.counts or {}
        is_filtered = not self._replaced_ids.isdisjoint(counts)
        is_renumbered = self._index.channel_renumbering_at_offset(chunk.chunk_start) is not None
        if is_filtered or is_renumbered or chunk.chunk_start in self._reindexed:
            return self._rebuild_chunk_and_get_last_log_time(writer, chunk, is_changed=is_filtered or is_renumbered)
        writer.copy_chunk(self._source, chunk)
        self.n_chunks += 1
        self.n_messages += sum(counts.values())
        return min(chunk.end_ns, MAX_INT64_TIME_NS) if any(counts.values()) else None

    def _decompress_with_log_ids(self, chunk: ChunkIndex) -> memoryview:
        payload = decompress_chunk(self._source, chunk, verify=True)
        return self._index.records_with_log_ids(chunk.chunk_start, payload)

    def _rebuild_chunk_and_get_last_log_time(
        self, writer: RecordWriter, chunk: ChunkIndex, *, is_changed: bool
    ) -> int | None:
        try:
            records = self._decompress_with_log_ids(chunk)
            if is_changed:
                is_renumbered = self._index.channel_renumbering_at_offset(chunk.chunk_start) is not None
                records = remove_channels_from_records(records, self._replaced_ids, definitions=not is_renumbered)
            entries = message_index_entries_by_channel(records)
        except (ChunkError, RecordError) as error:
            raise damaged_file_error(self._source, chunk.chunk_start, error) from error
        if not entries:
            for opcode, start, end in iter_opcodes_and_record_bounds(records):
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    writer.write_raw_record(records[start:end])
            return None
        stored = None if is_changed else stored_chunk_bytes(self._source, chunk)
        return self._write_indexed_chunk_and_get_last_log_time(writer, records, entries, chunk.compression, stored)

    def _write_chunk_and_get_last_log_time(
        self, writer: RecordWriter, records: memoryview, *, compress: bool
    ) -> int | None:
        """Write records that have no intact chunk as a new chunk; return the last log time in ns."""
        entries = message_index_entries_by_channel(records)
        if not self._replaced_ids.isdisjoint(entries) or (self._index.renumberings and entries):
            records = remove_channels_from_records(
                records, self._replaced_ids, definitions=not self._index.renumberings
            )
            entries = message_index_entries_by_channel(records)
        if not entries:
            return None
        return self._write_indexed_chunk_and_get_last_log_time(
            writer, records, entries, "", None if compress else records
        )

    def _write_indexed_chunk_and_get_last_log_time(
        self,
        writer: RecordWriter,
        records: memoryview,
        entries: IndexEntriesByChannelId,
        compression: str,
        stored: memoryview | None,
    ) -> int:
        """Write a chunk with its indexes; `stored`: its compressed bytes, if known. Return its last log time in ns."""
        times = np.concatenate([each["log_time"] for each in entries.values()])
        payload = ChunkPayload(np.frombuffer(records, np.uint8), int(times.min()), int(times.max()), entries)
        if stored is None:
            writer.write_chunk(payload)
        else:
            writer.write_stored_chunk(payload, compression, stored)
        self.n_chunks += 1
        self.n_messages += len(times)
        return min(payload.end_ns, MAX_INT64_TIME_NS)


def message_index_entries_by_channel(records: memoryview) -> IndexEntriesByChannelId:
    """Return the index entries of the messages among some records, by channel in order of first occurrence.

    Raises:
        RecordError: A record reaches beyond the given bytes, or a message is shorter than its header.
    """
    octets = np.frombuffer(records, np.uint8)
    parts: list[npt.NDArray[np.void]] = []
    ids: list[npt.NDArray[np.uint16]] = []
    at = 0
    while at < len(octets):
        batch, at, status = scan_messages_next_offset_and_status(octets, at, len(octets), MASK_OF_ALL_CHANNEL_IDS)
        if status == DAMAGED:
            raise RecordError(f"a record at {at} is damaged")
        part = np.empty(len(batch), INDEX_ENTRY_DTYPE)
        part["log_time"] = batch.log_time_ns.view(np.uint64)
        part["offset"] = batch.payloads.starts - MIN_MESSAGE_BYTES
        parts.append(part)
        ids.append(batch.channel_id)
    if not parts:
        return {}
    entries, channel_ids = np.concatenate(parts), np.concatenate(ids)
    found, first = np.unique(channel_ids, return_index=True)
    return {channel_id: entries[channel_ids == channel_id] for channel_id in found[np.argsort(first)].tolist()}


def remove_channels_from_records(
    records: memoryview, channel_ids: frozenset[int], *, definitions: bool = True
) -> memoryview:
    """Return the records without messages and definitions of some channels; `definitions` off removes all of them.

    Raises:
        RecordError: A record reaches beyond the given bytes, or is too short for a channel id.
    """
    remaining = bytearray()
    for opcode, start, end in iter_opcodes_and_record_bounds(records):
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL) and not definitions:
            continue
        if opcode in (Opcode.MESSAGE, Opcode.CHANNEL):
            if end - start < RECORD_PREFIX.size + 2:
                raise RecordError("a record ends before its fields do")
            if (
                int.from_bytes(records[start + RECORD_PREFIX.size : start + RECORD_PREFIX.size + 2], "little")
                in channel_ids
            ):
                continue
        remaining += records[start:end]
    return memoryview(remaining)
