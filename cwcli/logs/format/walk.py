"""The data section record by record: for files without a usable summary, and for what is left of damaged ones."""

from __future__ import annotations

import struct

from cwcli.input import InputFile
from cwcli.logs.format.chunks import DECOMPRESSORS, ChunkError, chunk_payload, partial_payload
from cwcli.logs.format.faults import Faults
from cwcli.logs.format.index import Structure
from cwcli.logs.format.records import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    DATA_END,
    FOOTER,
    INDEX_ENTRY_BYTES,
    MESSAGE,
    MESSAGE_HEADER_BYTES,
    MESSAGE_INDEX,
    METADATA,
    PREFIX,
    SCHEMA,
    ChunkIndex,
    Data,
    MetadataIndex,
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

_MESSAGE = struct.Struct("<HIQ")


class DamageError(Exception):
    """The file is damaged at an offset."""

    def __init__(self, what: str, at: int) -> None:
        super().__init__(what)
        self.at = at


def scan(data: InputFile, data_start: int, faults: Faults, *, recover: bool) -> Structure:
    """Walk the data section, and open the chunks whose channels are not known otherwise.

    Args:
        data: The file.
        data_start: Where the data section begins.
        faults: Counts what is lost.
        recover: Go on behind damage.

    Raises:
        DamageError: The file is damaged and `recover` is off.
    """
    return _Scan(data, faults, recover).run(data_start)


class _Scan:
    def __init__(self, data: InputFile, faults: Faults, recover: bool) -> None:
        self._data = data
        self._faults = faults
        self._recover = recover
        self._structure = Structure(is_scanned=True)
        self._counts: dict[int, int] = {}
        self._first_ns: int | None = None
        self._last_ns = 0

    def run(self, data_start: int) -> Structure:
        data, structure = self._data, self._structure
        at = data_start
        while at < len(data):
            try:
                opcode, start, end = read_prefix(data, at, len(data))
                if opcode in (DATA_END, FOOTER):
                    structure.data_end = at if opcode == DATA_END else None
                    break
                at = self._take(opcode, start, end)
            except RecordError as error:
                at = self._behind_damage(at, str(error))
        self._define()
        structure.statistics = Statistics(
            sum(self._counts.values()),
            len(structure.schemas),
            len(structure.channels),
            len(structure.attachments),
            len(structure.metadata),
            len(structure.chunks),
            self._first_ns or 0,
            self._last_ns,
            self._counts,
        )
        return structure

    def _take(self, opcode: int, start: int, end: int) -> int:
        """Note one record, with the indexes behind a chunk; returns where the next one begins."""
        structure, data = self._structure, self._data
        if opcode == MESSAGE:
            self._count_message(start, end)
            head = start - PREFIX.size
            if structure.loose and structure.loose[-1][1] == head:
                head = structure.loose.pop()[0]
            structure.loose.append((head, end))
        elif opcode == CHUNK:
            return self._take_chunk(start, end)
        elif opcode == SCHEMA:
            schema = read_schema(data, start, end)
            structure.schemas.setdefault(schema.id, schema)
        elif opcode == CHANNEL:
            channel = read_channel(data, start, end)
            structure.channels.setdefault(channel.id, channel)
        elif opcode == ATTACHMENT:
            structure.attachments.append(read_attachment(data, start, end))
        elif opcode == METADATA:
            head = start - PREFIX.size
            structure.metadata.append(MetadataIndex(head, end - head, read_metadata(data, start, end)[0]))
        return end

    def _take_chunk(self, start: int, end: int) -> int:
        data = self._data
        chunk = read_chunk(data, start, end)
        if chunk.data_start + chunk.data_length != end:
            raise RecordError("a chunk's sizes disagree")
        offsets: dict[int, int] = {}
        at = end
        while at < len(data):
            try:
                opcode, index_start, index_end = read_prefix(data, at, len(data))
                if opcode != MESSAGE_INDEX:
                    break
                channel_id, first, last = read_message_index(data, index_start, index_end)
            except RecordError:
                break  # the walk comes upon it again
            n = (last - first) // INDEX_ENTRY_BYTES
            if n:
                offsets[channel_id] = at
                self._counts[channel_id] = self._counts.get(channel_id, 0) + n
            at = index_end
        if offsets:
            self._count_span(chunk.start_ns, chunk.end_ns)
        self._structure.chunks.append(
            ChunkIndex(
                chunk.start_ns,
                chunk.end_ns,
                chunk.start,
                chunk.length,
                offsets,
                at - end,
                chunk.compression,
                chunk.data_length,
                chunk.uncompressed_size,
            )
        )
        return at

    def _behind_damage(self, at: int, why: str) -> int:
        """Count what is lost; returns where reading goes on."""
        if not self._recover:
            raise DamageError(why, at)
        if self._take_partial_chunk(at):
            return len(self._data)
        from cwcli.logs.format.resync import next_record

        following = next_record(self._data, at + 1, self._structure.channels)
        self._faults.bytes_lost += following - at
        return following

    def _take_partial_chunk(self, at: int) -> bool:
        """Whether a chunk begins here whose end is cut off with the file's."""
        data = self._data
        if at + PREFIX.size > len(data):
            return False
        start = at + PREFIX.size
        opcode, length = PREFIX.unpack(data[at:start])
        if opcode != CHUNK or length <= len(data) - start:
            return False
        try:
            chunk = read_chunk_head(data, start, len(data))
        except RecordError:
            return False
        if chunk.compression not in DECOMPRESSORS or chunk.data_start - start + chunk.data_length != length:
            return False
        self._structure.chunks.append(
            ChunkIndex(
                chunk.start_ns,
                chunk.end_ns,
                at,
                chunk.length,
                {},
                0,
                chunk.compression,
                len(data) - chunk.data_start,
                min(chunk.uncompressed_size, 1 << 62),
            )
        )
        self._structure.partial_chunk = at
        return True

    def _define(self) -> None:
        """Open the chunks that have no index, or whose channels are unknown."""
        structure = self._structure
        for k, chunk in enumerate(structure.chunks):
            is_indexed = bool(chunk.index_offsets)
            known = is_indexed and chunk.index_offsets.keys() <= structure.channels.keys()
            if known and all(
                structure.channels[each].schema_id in (0, *structure.schemas) for each in chunk.index_offsets
            ):
                continue
            found = self._opened(chunk)
            if not is_indexed and found:
                structure.chunks[k] = chunk._replace(index_offsets=dict.fromkeys(found, 0))

    def _opened(self, chunk: ChunkIndex) -> set[int]:
        """Read a chunk's definitions; returns the channels of its messages, which are counted where no index does."""
        data = self._data
        is_partial = chunk.chunk_start == self._structure.partial_chunk
        try:
            payload = partial_payload(data, chunk) if is_partial else chunk_payload(data, chunk, verify=True)
        except ChunkError as error:
            if self._recover or error.is_foreign:
                return set()  # it is counted when it is read
            raise DamageError(str(error), chunk.chunk_start) from error
        found: set[int] = set()
        at = 0
        while at < len(payload):
            try:
                opcode, start, end = read_prefix(payload, at, len(payload))
                if opcode == SCHEMA:
                    schema = read_schema(payload, start, end)
                    self._structure.schemas.setdefault(schema.id, schema)
                elif opcode == CHANNEL:
                    channel = read_channel(payload, start, end)
                    self._structure.channels.setdefault(channel.id, channel)
                elif opcode == MESSAGE:
                    found.add(self._message(payload, start, end, is_counted=not chunk.index_offsets))
            except RecordError as error:
                if self._recover:
                    break
                raise DamageError(f"inside a chunk: {error}", chunk.chunk_start) from error
            at = end
        return found

    def _count_message(self, start: int, end: int) -> None:
        self._message(self._data, start, end, is_counted=True)

    def _message(self, data: Data, start: int, end: int, *, is_counted: bool) -> int:
        if end - start < MESSAGE_HEADER_BYTES:
            raise RecordError("a message is shorter than its header")
        channel_id: int
        channel_id, _, log_time_ns = _MESSAGE.unpack(data[start : start + _MESSAGE.size])
        if is_counted:
            self._counts[channel_id] = self._counts.get(channel_id, 0) + 1
            self._count_span(log_time_ns, log_time_ns)
        return channel_id

    def _count_span(self, start_ns: int, end_ns: int) -> None:
        self._first_ns = start_ns if self._first_ns is None else min(self._first_ns, start_ns)
        self._last_ns = max(self._last_ns, end_ns)
