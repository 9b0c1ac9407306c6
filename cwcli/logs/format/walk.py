"""Indexes the data section record by record: for files without a usable summary, for damaged ones, and for a copy."""

from __future__ import annotations

import struct

from cwcli.input import InputFile
from cwcli.logs.format.chunks import (
    DECOMPRESSORS,
    ChunkError,
    check_message_count_against_file_size,
    check_unchunked_message_count,
    decompress_chunk,
    decompress_cut_chunk_up_to_error,
    set_first_refused_chunk,
)
from cwcli.logs.format.faults import Faults, check_non_message_record_count, damaged_file_error
from cwcli.logs.format.index import LogIndex, UnchunkedRange, UnchunkedRecord
from cwcli.logs.format.metadata_table import MIN_RECORDS_FOR_KERNEL, MetadataRun, check_metadata_count
from cwcli.logs.format.records import (
    MCAP_MAGIC,
    MESSAGE_HEADER_BYTES,
    MESSAGE_INDEX_ENTRY_BYTES,
    RECORD_PREFIX,
    AttachmentIndex,
    ByteSource,
    Channel,
    ChunkIndex,
    Opcode,
    RecordError,
    Schema,
    Statistics,
    channel_id_and_range_of_message_index_entries,
    read_attachment,
    read_channel,
    read_chunk,
    read_chunk_head,
    read_metadata_name_and_entries,
    read_opcode_and_content_range,
    read_record,
)

DATA_SECTION_OPCODES = frozenset(
    {Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT, Opcode.METADATA}
)
"""The opcodes of the records that occur in the data section only (MCAP specification)."""
RECORDS_BETWEEN_MESSAGE_COUNT_CHECKS = 1 << 12
"""The number of records in chunks after which the number of messages is checked again. Chosen by hand."""
_CHANNEL_SEQUENCE_TIME_STRUCT = struct.Struct("<HIQ")
"""The first fields of a message: channel id, sequence, log time (MCAP specification)."""


def index_data_section(
    file: InputFile, start: int, faults: Faults, known: LogIndex | None, *, recover: bool, define_all: bool = False
) -> LogIndex:
    """Index every record of the data section, and open the chunks whose channels are not known otherwise.

    Args:
        start: Offset of the data section.
        known: The index from the summary, if there is one; its schemas and channels are taken over.
        recover: Continue after damage.
        define_all: Find all schemas and channels, including those without messages; a chunk with an unknown
            compression is then an error.

    Raises:
        InputError: The file is damaged and `recover` is off.
    """
    return _DataSectionIndexer(file, faults, known or LogIndex(), recover=recover).index_records(
        start, define_all=define_all
    )


class _DataSectionIndexer:
    """Builds the index of one file's data section; arguments as for `walk`."""

    def __init__(self, file: InputFile, faults: Faults, known: LogIndex, *, recover: bool) -> None:
        self._file = file
        self._faults = faults
        self._recover = recover
        self._index = LogIndex(
            schemas=dict(known.schemas),
            channels=dict(known.channels),
            n_definition_bytes=known.n_definition_bytes,
        )
        self._n_channels = known.statistics.n_channels if known.statistics else None
        self._counts: dict[int, int] = {}
        self._first_ns: int | None = None
        self._last_ns = 0
        self._n_records = 0
        self._n_opened = 0
        self._n_unchunked = 0
        self._n_taken_at_once = 0

    def index_records(self, at: int, *, define_all: bool) -> LogIndex:
        """Index the records from an offset on."""
        file, index = self._file, self._index
        while at < len(file):
            try:
                opcode, start, end = read_opcode_and_content_range(file, at, len(file))
                if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                    self._check_nothing_follows_end(opcode, end)
                    index.data_end = at if opcode == Opcode.DATA_END else None
                    index.has_end = True
                    break
                at = self._add_record_and_get_next_offset(opcode, at, start, end)
            except RecordError as error:
                at = self._count_lost_bytes_and_find_resume_offset(at, error)
        self._complete_definitions_and_counts(define_all=define_all)
        index.statistics = Statistics(
            sum(self._counts.values()),
            len(index.schemas),
            len(index.channels),
            len(index.items_of_type(AttachmentIndex)),
            len(index.metadata),
            len(index.items_of_type(ChunkIndex)),
            self._first_ns or 0,
            self._last_ns,
            self._counts,
        )
        return index

    def _check_nothing_follows_end(self, opcode: int, end: int) -> None:
        """Check that no records of the data section follow its end record or the footer.

        Raises:
            RecordError: Some follow.
        """
        file = self._file
        if opcode == Opcode.FOOTER:
            if end + len(MCAP_MAGIC) < len(file):
                raise RecordError("a footer stands before the end of the file")
        elif end < len(file) and file[end : end + 1][0] in DATA_SECTION_OPCODES:
            raise RecordError("the end of the data section stands before other records of it")

    def _add_record_and_get_next_offset(self, opcode: int, at: int, start: int, end: int) -> int:
        """Add one record, with the message indexes after a chunk; return the offset of the next one."""
        items, file = self._index.items, self._file
        if opcode == Opcode.MESSAGE:
            self._count_message_and_get_channel_id(file, start, end)
            self._n_unchunked += 1
            if not self._n_unchunked % RECORDS_BETWEEN_MESSAGE_COUNT_CHECKS:
                check_unchunked_message_count(file, self._n_unchunked)
            before = items[-1] if items else None
            if isinstance(before, UnchunkedRange) and before.end == at:
                items[-1] = UnchunkedRange(before.start, end)
            else:
                items.append(UnchunkedRange(at, end))
            return end
        if opcode == Opcode.CHUNK:
            return self._add_chunk_and_get_next_offset(at, start, end)
        if opcode == Opcode.METADATA:
            return self._add_metadata_records_and_get_next_offset(at, start, end)
        self._n_records += opcode != Opcode.MESSAGE_INDEX
        check_non_message_record_count(file.name, self._n_records)
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            items.append(
                UnchunkedRecord(at, end - at, opcode, self._add_definition_and_get_id(opcode, file, start, end))
            )
        elif opcode == Opcode.ATTACHMENT:
            items.append(read_attachment(file, start, end))
        elif opcode != Opcode.MESSAGE_INDEX:  # without its chunk it serves nobody
            items.append(UnchunkedRecord(at, end - at, opcode, -1))
        return end

    def _add_metadata_records_and_get_next_offset(self, at: int, start: int, end: int) -> int:
        """Add a metadata record, after many of them also those that follow; return the offset of the next record."""
        file, items, table = self._file, self._index.items, self._index.metadata
        table.append(at, end - at, read_metadata_name_and_entries(file, start, end)[0])
        check_metadata_count(file.name, len(table))
        before = items[-1] if items else None
        if isinstance(before, MetadataRun) and before.end == at:
            if len(table) - max(before.first, self._n_taken_at_once) > MIN_RECORDS_FOR_KERNEL:
                end = table.append_consecutive_records_and_get_end(file, end, len(file), Opcode.METADATA, file.name)
                self._n_taken_at_once = len(table)
            items[-1] = before._replace(end=end, stop=len(table))
        else:
            items.append(MetadataRun(at, end, len(table) - 1, len(table)))
            self._n_records += 1
            check_non_message_record_count(file.name, self._n_records)
        return end

    def _add_chunk_and_get_next_offset(self, at: int, start: int, end: int) -> int:
        """Add a chunk with its message indexes; return the offset of the next record."""
        file = self._file
        chunk = read_chunk(file, start, end)
        if chunk.data_start + chunk.data_length != end:
            raise RecordError("a chunk's sizes disagree")
        offsets: dict[int, int] = {}
        counts: dict[int, int] = {}
        cursor = end
        while cursor < len(file):
            try:
                opcode, index_start, index_end = read_opcode_and_content_range(file, cursor, len(file))
                if opcode != Opcode.MESSAGE_INDEX:
                    break
                channel_id, first, last = channel_id_and_range_of_message_index_entries(file, index_start, index_end)
            except RecordError:
                break  # the caller reads it again and reports it
            offsets[channel_id] = cursor
            counts[channel_id] = (last - first) // MESSAGE_INDEX_ENTRY_BYTES
            cursor = index_end
        self._index.items.append(
            ChunkIndex(
                chunk.start_ns,
                chunk.end_ns,
                at,
                end - at,
                offsets,
                cursor - end,
                chunk.compression,
                chunk.data_length,
                chunk.uncompressed_size,
                counts if any(counts.values()) else None,
            )
        )
        return cursor

    def _count_lost_bytes_and_find_resume_offset(self, at: int, error: RecordError) -> int:
        """Count the lost bytes; return the offset at which reading continues.

        Raises:
            InputError: `recover` is off.
        """
        if not self._recover:
            raise damaged_file_error(self._file, at, error) from error
        following = self._add_cut_chunk_and_get_end_offset(at)
        if following is None:
            from cwcli.logs.format.resync import find_next_record_offset_or_end, is_plausible_record

            following = self._find_record_end_offset(at)
            if following is None or not is_plausible_record(self._file, following, self._index.channels):
                following = find_next_record_offset_or_end(self._file, at + 1, self._index.channels)
            self._faults.bytes_lost += following - at
        return following

    def _find_record_end_offset(self, at: int) -> int | None:
        try:
            return read_opcode_and_content_range(self._file, at, len(self._file))[2]
        except RecordError:
            return None

    def _add_cut_chunk_and_get_end_offset(self, at: int) -> int | None:
        """Add a chunk that the file's end cuts off, or whose record and header disagree on its length.

        Returns:
            Offset of its end; None if there is no such chunk.
        """
        from cwcli.logs.format.resync import is_plausible_record

        file, size = self._file, len(self._file)
        start = at + RECORD_PREFIX.size
        if start > size:
            return None
        opcode, length = RECORD_PREFIX.unpack(file[at:start])
        try:
            chunk = read_chunk_head(file, start, size)
        except RecordError:
            return None
        if opcode != Opcode.CHUNK or chunk.compression not in DECOMPRESSORS:
            return None
        by_record, by_header = start + length, chunk.data_start + chunk.data_length
        if by_record == by_header:
            end: int | None = min(by_header, size)
        else:
            ends = [each for each in (by_record, by_header) if chunk.data_start <= each < size]
            end = next((each for each in ends if is_plausible_record(file, each, self._index.channels)), None)
        if end is not None:
            stored, declared = end - chunk.data_start, min(chunk.uncompressed_size, 1 << 62)
            self._index.items.append(
                ChunkIndex(chunk.start_ns, chunk.end_ns, at, end - at, {}, 0, chunk.compression, stored, declared)
            )
            self._index.cut_chunks.add(at)
        return end

    def _complete_definitions_and_counts(self, *, define_all: bool) -> None:
        """Count the indexed messages, and open the chunks that have no index, or whose channels are unknown."""
        index = self._index
        set_first_refused_chunk(self._file, index.items_of_type(ChunkIndex), index.cut_chunks)
        for k, item in enumerate(index.items):
            if not isinstance(item, ChunkIndex):
                continue
            if item.counts is not None:
                for channel_id, n in item.counts.items():
                    self._counts[channel_id] = self._counts.get(channel_id, 0) + n
                self._extend_log_time_range(item.start_ns, item.end_ns)
            if item.counts is None or any(map(index.lacks_channel_or_schema, item.counts)):
                index.items[k] = self._add_definitions_and_count_messages_of_chunk(item, must_open=define_all)
        used = {*self._counts, *index.channels}
        if define_all and (self._n_channels != len(index.channels) or any(map(index.lacks_channel_or_schema, used))):
            self._n_opened = 0
            for chunk in index.items_of_type(ChunkIndex):
                self._add_definitions_and_count_messages_of_chunk(chunk, must_open=True)

    def _add_definitions_and_count_messages_of_chunk(self, chunk: ChunkIndex, *, must_open: bool) -> ChunkIndex:
        """Read a chunk's schemas and channels; return the chunk with message counts, if no index gave them before."""
        try:
            if chunk.chunk_start in self._index.cut_chunks:
                payload = decompress_cut_chunk_up_to_error(self._file, chunk)
            else:
                payload = decompress_chunk(self._file, chunk, verify=True)
        except ChunkError as error:
            if self._recover or (error.has_unknown_compression and not must_open):
                return chunk  # it is counted when it is read
            raise damaged_file_error(self._file, chunk.chunk_start, error) from error
        counts: dict[int, int] = {}
        at = 0
        while at < len(payload):
            try:
                opcode, start, end = read_opcode_and_content_range(payload, at, len(payload))
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._add_definition_and_get_id(opcode, payload, start, end)
                elif opcode == Opcode.MESSAGE and chunk.counts is None:
                    channel_id = self._count_message_and_get_channel_id(payload, start, end)
                    counts[channel_id] = counts.get(channel_id, 0) + 1
                self._n_opened += 1
                if not self._n_opened % RECORDS_BETWEEN_MESSAGE_COUNT_CHECKS:
                    check_message_count_against_file_size(self._file, self._n_opened)
            except (RecordError, ChunkError) as error:
                if self._recover:
                    break
                why = error if isinstance(error, ChunkError) else f"inside a chunk: {error}"
                raise damaged_file_error(self._file, chunk.chunk_start, why) from error
            at = end
        return chunk._replace(counts=counts or chunk.counts)

    def _add_definition_and_get_id(self, opcode: int, data: ByteSource, start: int, end: int) -> int:
        """Add a schema or a channel, unless one with its id is known; return the id."""
        definition: Schema | Channel
        if opcode == Opcode.SCHEMA:
            definition = read_record(Schema, data, start, end)
            is_new = self._index.schemas.setdefault(definition.id, definition) is definition
        else:
            definition = read_channel(data, start, end)
            is_new = self._index.channels.setdefault(definition.id, definition) is definition
        if is_new:
            self._index.count_definition(definition, self._file)
        return definition.id

    def _count_message_and_get_channel_id(self, data: ByteSource, start: int, end: int) -> int:
        if end - start < MESSAGE_HEADER_BYTES:
            raise RecordError("a message is shorter than its header")
        channel_id: int
        channel_id, _, log_time_ns = _CHANNEL_SEQUENCE_TIME_STRUCT.unpack(
            data[start : start + _CHANNEL_SEQUENCE_TIME_STRUCT.size]
        )
        self._counts[channel_id] = self._counts.get(channel_id, 0) + 1
        self._extend_log_time_range(log_time_ns, log_time_ns)
        return channel_id

    def _extend_log_time_range(self, start_ns: int, end_ns: int) -> None:
        self._first_ns = start_ns if self._first_ns is None else min(self._first_ns, start_ns)
        self._last_ns = max(self._last_ns, end_ns)
