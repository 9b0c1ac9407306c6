"""Indexes the data section record by record: for files without a usable summary, for damaged ones, and for a copy."""

from __future__ import annotations

import struct

from cwcli.input import InputFile
from cwcli.logs.format.chunks import (
    DECOMPRESSORS,
    ChunkError,
    bound_chunks,
    check_messages,
    chunk_payload,
    partial_payload,
)
from cwcli.logs.format.faults import Faults, check_record_count, damaged
from cwcli.logs.format.index import Index, LooseRecord, Span
from cwcli.logs.format.metadata_table import MANY, Run, check_metadata_count
from cwcli.logs.format.records import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    DATA_END,
    FOOTER,
    INDEX_ENTRY_BYTES,
    MAGIC,
    MESSAGE,
    MESSAGE_HEADER_BYTES,
    MESSAGE_INDEX,
    METADATA,
    PREFIX,
    SCHEMA,
    AttachmentIndex,
    ChunkIndex,
    Data,
    RecordError,
    Statistics,
    read_attachment,
    read_channel,
    read_chunk,
    read_chunk_head,
    read_message_index,
    read_metadata,
    read_prefix,
    read_schema,
)

OF_DATA = frozenset({MESSAGE, CHUNK, MESSAGE_INDEX, ATTACHMENT, METADATA})
"""The opcodes of the records that occur in the data section only (MCAP specification)."""
RECORDS_BETWEEN_CHECKS = 1 << 12
"""The number of records in chunks after which the number of messages is checked again. Chosen by hand."""
_MESSAGE = struct.Struct("<HIQ")
"""The first fields of a message: channel id, sequence, log time (MCAP specification)."""


def walk(
    file: InputFile, start: int, faults: Faults, known: Index | None, *, recover: bool, define_all: bool = False
) -> Index:
    """Index every record of the data section, and open the chunks whose channels are not known otherwise.

    Args:
        file: The log.
        start: Offset of the data section.
        faults: Counts what is lost.
        known: The index from the summary, if there is one; its schemas and channels are taken over.
        recover: Continue after damage.
        define_all: Find all schemas and channels, including those without messages; a chunk with an unknown
            compression is then an error.

    Raises:
        InputError: The file is damaged and `recover` is off.
    """
    return _Walk(file, faults, known or Index(), recover=recover).run(start, define_all=define_all)


class _Walk:
    """Builds the index of one file's data section; arguments as for `walk`."""

    def __init__(self, file: InputFile, faults: Faults, known: Index, *, recover: bool) -> None:
        self._file = file
        self._faults = faults
        self._recover = recover
        self._index = Index(schemas=dict(known.schemas), channels=dict(known.channels))
        self._n_channels = known.statistics.n_channels if known.statistics else None
        self._counts: dict[int, int] = {}
        self._first_ns: int | None = None
        self._last_ns = 0
        self._n_records = 0
        self._n_opened = 0
        self._n_taken_at_once = 0

    def run(self, at: int, *, define_all: bool) -> Index:
        """Index the records from an offset on."""
        file, index = self._file, self._index
        while at < len(file):
            try:
                opcode, start, end = read_prefix(file, at, len(file))
                if opcode in (DATA_END, FOOTER):
                    self._check_end(opcode, end)
                    index.data_end = at if opcode == DATA_END else None
                    index.has_end = True
                    break
                at = self._take(opcode, at, start, end)
            except RecordError as error:
                at = self._behind_damage(at, error)
        self._define(define_all=define_all)
        index.statistics = Statistics(
            sum(self._counts.values()),
            len(index.schemas),
            len(index.channels),
            len(index.items_of(AttachmentIndex)),
            len(index.metadata),
            len(index.items_of(ChunkIndex)),
            self._first_ns or 0,
            self._last_ns,
            self._counts,
        )
        return index

    def _check_end(self, opcode: int, end: int) -> None:
        """Check that no records of the data section follow its end record or the footer.

        Raises:
            RecordError: Some follow.
        """
        file = self._file
        if opcode == FOOTER:
            if end + len(MAGIC) < len(file):
                raise RecordError("a footer stands before the end of the file")
        elif end < len(file) and file[end : end + 1][0] in OF_DATA:
            raise RecordError("the end of the data section stands before other records of it")

    def _take(self, opcode: int, at: int, start: int, end: int) -> int:
        """Add one record, with the message indexes after a chunk; return the offset of the next one."""
        items, file = self._index.items, self._file
        if opcode == MESSAGE:
            self._count_message(file, start, end)
            before = items[-1] if items else None
            if isinstance(before, Span) and before.end == at:
                items[-1] = Span(before.start, end)
            else:
                items.append(Span(at, end))
            return end
        if opcode == CHUNK:
            return self._take_chunk(at, start, end)
        if opcode == METADATA:
            return self._take_metadata(at, start, end)
        self._n_records += opcode != MESSAGE_INDEX
        check_record_count(file.name, self._n_records)
        if opcode in (SCHEMA, CHANNEL):
            items.append(LooseRecord(at, end - at, opcode, self._note_definition(opcode, file, start, end)))
        elif opcode == ATTACHMENT:
            items.append(read_attachment(file, start, end))
        elif opcode != MESSAGE_INDEX:  # without its chunk it serves nobody
            items.append(LooseRecord(at, end - at, opcode, -1))
        return end

    def _take_metadata(self, at: int, start: int, end: int) -> int:
        """Add a metadata record, after many of them also those that follow; return the offset of the next record."""
        file, items, table = self._file, self._index.items, self._index.metadata
        table.append(at, end - at, read_metadata(file, start, end)[0])
        check_metadata_count(file.name, len(table))
        before = items[-1] if items else None
        if isinstance(before, Run) and before.end == at:
            if len(table) - max(before.first, self._n_taken_at_once) > MANY:
                end = table.extend(file, end, len(file), METADATA, file.name)
                self._n_taken_at_once = len(table)
            items[-1] = before._replace(end=end, stop=len(table))
        else:
            items.append(Run(at, end, len(table) - 1, len(table)))
            self._n_records += 1
            check_record_count(file.name, self._n_records)
        return end

    def _take_chunk(self, at: int, start: int, end: int) -> int:
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
                opcode, index_start, index_end = read_prefix(file, cursor, len(file))
                if opcode != MESSAGE_INDEX:
                    break
                channel_id, first, last = read_message_index(file, index_start, index_end)
            except RecordError:
                break  # the caller reads it again and reports it
            offsets[channel_id] = cursor
            counts[channel_id] = (last - first) // INDEX_ENTRY_BYTES
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

    def _behind_damage(self, at: int, error: RecordError) -> int:
        """Count the lost bytes; return the offset at which reading continues.

        Raises:
            InputError: `recover` is off.
        """
        if not self._recover:
            raise damaged(self._file, at, error) from error
        following = self._take_cut_chunk(at)
        if following is None:
            from cwcli.logs.format.resync import is_record, next_record

            following = self._end_of_record(at)
            if following is None or not is_record(self._file, following, self._index.channels):
                following = next_record(self._file, at + 1, self._index.channels)
            self._faults.bytes_lost += following - at
        return following

    def _end_of_record(self, at: int) -> int | None:
        try:
            return read_prefix(self._file, at, len(self._file))[2]
        except RecordError:
            return None

    def _take_cut_chunk(self, at: int) -> int | None:
        """Add a chunk that the file's end cuts off, or whose record and header disagree on its length.

        Returns:
            Offset of its end; None if there is no such chunk.
        """
        from cwcli.logs.format.resync import is_record

        file, size = self._file, len(self._file)
        start = at + PREFIX.size
        if start > size:
            return None
        opcode, length = PREFIX.unpack(file[at:start])
        try:
            chunk = read_chunk_head(file, start, size)
        except RecordError:
            return None
        if opcode != CHUNK or chunk.compression not in DECOMPRESSORS:
            return None
        by_record, by_header = start + length, chunk.data_start + chunk.data_length
        if by_record == by_header:
            end: int | None = min(by_header, size)
        else:
            ends = [each for each in (by_record, by_header) if chunk.data_start <= each < size]
            end = next((each for each in ends if is_record(file, each, self._index.channels)), None)
        if end is not None:
            stored, declared = end - chunk.data_start, min(chunk.uncompressed_size, 1 << 62)
            self._index.items.append(
                ChunkIndex(chunk.start_ns, chunk.end_ns, at, end - at, {}, 0, chunk.compression, stored, declared)
            )
            self._index.cut_chunks.add(at)
        return end

    def _define(self, *, define_all: bool) -> None:
        """Count the indexed messages, and open the chunks that have no index, or whose channels are unknown."""
        index = self._index
        bound_chunks(self._file, index.items_of(ChunkIndex), index.cut_chunks)
        for k, item in enumerate(index.items):
            if not isinstance(item, ChunkIndex):
                continue
            if item.counts is not None:
                for channel_id, n in item.counts.items():
                    self._counts[channel_id] = self._counts.get(channel_id, 0) + n
                self._count_span(item.start_ns, item.end_ns)
            if item.counts is None or any(map(index.lacks_schema, item.counts)):
                index.items[k] = self._opened(item, must_open=define_all)
        used = {*self._counts, *index.channels}
        if define_all and (self._n_channels != len(index.channels) or any(map(index.lacks_schema, used))):
            self._n_opened = 0
            for chunk in index.items_of(ChunkIndex):
                self._opened(chunk, must_open=True)

    def _opened(self, chunk: ChunkIndex, *, must_open: bool) -> ChunkIndex:
        """Read a chunk's schemas and channels; return the chunk with message counts, if no index gave them before."""
        try:
            if chunk.chunk_start in self._index.cut_chunks:
                payload = partial_payload(self._file, chunk)
            else:
                payload = chunk_payload(self._file, chunk, verify=True)
        except ChunkError as error:
            if self._recover or (error.is_foreign and not must_open):
                return chunk  # it is counted when it is read
            raise damaged(self._file, chunk.chunk_start, error) from error
        counts: dict[int, int] = {}
        at = 0
        while at < len(payload):
            try:
                opcode, start, end = read_prefix(payload, at, len(payload))
                if opcode in (SCHEMA, CHANNEL):
                    self._note_definition(opcode, payload, start, end)
                elif opcode == MESSAGE and chunk.counts is None:
                    channel_id = self._count_message(payload, start, end)
                    counts[channel_id] = counts.get(channel_id, 0) + 1
                self._n_opened += 1
                if not self._n_opened % RECORDS_BETWEEN_CHECKS:
                    check_messages(self._file, self._n_opened)
            except (RecordError, ChunkError) as error:
                if self._recover:
                    break
                why = error if isinstance(error, ChunkError) else f"inside a chunk: {error}"
                raise damaged(self._file, chunk.chunk_start, why) from error
            at = end
        return chunk._replace(counts=counts or chunk.counts)

    def _note_definition(self, opcode: int, data: Data, start: int, end: int) -> int:
        """Add a schema or a channel, unless one with its id is known; return the id."""
        if opcode == SCHEMA:
            schema = read_schema(data, start, end)
            return self._index.schemas.setdefault(schema.id, schema).id
        channel = read_channel(data, start, end)
        return self._index.channels.setdefault(channel.id, channel).id

    def _count_message(self, data: Data, start: int, end: int) -> int:
        """Count a message and return its channel id."""
        if end - start < MESSAGE_HEADER_BYTES:
            raise RecordError("a message is shorter than its header")
        channel_id: int
        channel_id, _, log_time_ns = _MESSAGE.unpack(data[start : start + _MESSAGE.size])
        self._counts[channel_id] = self._counts.get(channel_id, 0) + 1
        self._count_span(log_time_ns, log_time_ns)
        return channel_id

    def _count_span(self, start_ns: int, end_ns: int) -> None:
        """Extend the range of log times by these."""
        self._first_ns = start_ns if self._first_ns is None else min(self._first_ns, start_ns)
        self._last_ns = max(self._last_ns, end_ns)
