"""Where the records of an MCAP file lie: what a copy needs to know of them, without decoding a message.

The data section is walked from record to record, which touches a few bytes of each. The summary is believed only where
it repeats the schemas and channels; where it does not, the chunks are opened.

Format: https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from io import BytesIO
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, ChunkIndex, Metadata, MetadataIndex, Schema, Statistics

from cwcli.errors import InputError
from cwcli.input import InputFile
from cwcli.logs.format.chunk_records import chunk_records, index_entries, open_chunk, open_cut_chunk
from cwcli.logs.format.chunks import ChunkError
from cwcli.logs.format.faults import RECOVER_HINT
from cwcli.logs.format.records import (
    INDEX_ENTRY_BYTES,
    MAGIC,
    PREFIX,
    Data,
    RecordError,
    crc32,
    read_attachment,
    read_chunk,
    read_header,
    read_message_index,
    read_prefix,
)
from cwcli.logs.write.message_merge import INDEX_ENTRY
from cwcli.logs.write.record_writer import CopiedChunk

FOOTER = struct.Struct("<BQQQI")
CHUNK_OPCODE = bytes([Opcode.CHUNK])
MAX_LOOSE_BYTES = 1 << 20

Record = TypeVar("Record")


@dataclass(frozen=True)
class LooseMessages:
    """Neighbouring message records outside any chunk.

    Attributes:
        start, length: Bytes in the source.
        entries: Channel id -> (log time, offset from `start`) of its messages, dtype `INDEX_ENTRY`.
    """

    start: int
    length: int
    entries: dict[int, npt.NDArray[np.void]]


@dataclass(frozen=True)
class SalvagedRecords:
    """The whole records of a chunk whose end is missing; `entries` as in `LooseMessages`."""

    records: memoryview
    entries: dict[int, npt.NDArray[np.void]]


@dataclass(frozen=True)
class LooseRecord:
    """A schema or channel record outside any chunk, or a record of a kind that the format leaves to its users."""

    start: int
    length: int
    channel_id: int | None = None
    schema_id: int | None = None


Item = CopiedChunk | LooseMessages | SalvagedRecords | LooseRecord | AttachmentIndex | MetadataIndex


@dataclass
class Layout:
    """What a file holds.

    Attributes:
        header_length: Bytes of magic and header.
        profile, library: From the header.
        items: The data section in file order.
        schemas, channels: By id.
        n_chunks_lost, n_bytes_lost: What `recover` left out.
    """

    header_length: int = 0
    profile: str = ""
    library: str = ""
    items: list[Item] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    n_chunks_lost: int = 0
    n_bytes_lost: int = 0

    def metadata_names(self) -> set[str]:
        """Names of the metadata records."""
        return {item.name for item in self.items if isinstance(item, MetadataIndex)}


def read_layout(data: InputFile, name: str, *, recover: bool = False) -> Layout:
    """Walk the data section.

    Args:
        data: The whole file.
        name: For messages.
        recover: Leave damaged records out and count them, instead of raising. Every chunk is then opened and its CRC
            checked.

    Raises:
        InputError: The file is damaged and `recover` is off.
    """
    return _Walk(data, name, recover).run()


class _Walk:
    def __init__(self, data: InputFile, name: str, recover: bool) -> None:
        self._data = data
        self._name = name
        self._recover = recover
        self._layout = Layout()
        self._counted_channels: int | None = None
        self._chunk_starts: list[int] = []

    def run(self) -> Layout:
        layout = self._layout
        if self._data[0 : len(MAGIC)] != MAGIC:
            raise InputError("it is not an MCAP file", where=self._name)
        self._read_summary()
        at = len(MAGIC)
        ended = False
        while not ended:
            record = self._record(at)
            if record is None:
                self._salvage(at)
                following = next((start for start in self._chunk_starts if start > at), len(self._data))
                self._lose(following - at, "a record is cut short or damaged", at)
                if following == len(self._data):
                    break
                at = following
                continue
            opcode, end = record
            ended = opcode == Opcode.DATA_END
            at = self._take(opcode, at, end) if not ended else end
        self._complete_channels()
        return layout

    def _salvage(self, at: int) -> None:
        """Note the whole records of a chunk that the file's end cuts."""
        if self._recover and at + PREFIX.size < len(self._data) and self._data[at : at + 1] == CHUNK_OPCODE:
            records = open_cut_chunk(self._data, at)
            entries = index_entries(records)
            if entries:
                self._layout.items.append(SalvagedRecords(records, entries))
            self._define(records)

    def _record(self, at: int) -> tuple[int, int] | None:
        """Kind and end of the record at an offset, or None if there is no whole one."""
        try:
            opcode, _, end = read_prefix(self._data, at, len(self._data))
        except RecordError:
            return None
        return opcode, end

    def _take(self, opcode: int, at: int, end: int) -> int:
        """Note the record, and those that belong to it; returns where the next one begins."""
        layout = self._layout
        try:
            if opcode == Opcode.HEADER:
                layout.profile, layout.library = read_header(self._data, at + PREFIX.size, end)
                layout.header_length = end
            elif opcode == Opcode.CHUNK:
                return self._take_chunk(at, end)
            elif opcode == Opcode.MESSAGE:
                return self._take_messages(at)
            elif opcode == Opcode.SCHEMA:
                schema = _parsed(self._data, at, end, Schema.read)
                layout.schemas.setdefault(schema.id, schema)
                layout.items.append(LooseRecord(at, end - at, schema_id=schema.id))
            elif opcode == Opcode.CHANNEL:
                channel = _parsed(self._data, at, end, Channel.read)
                layout.channels.setdefault(channel.id, channel)
                layout.items.append(LooseRecord(at, end - at, channel_id=channel.id))
            elif opcode == Opcode.ATTACHMENT:
                self._take_attachment(at, end)
            elif opcode == Opcode.METADATA:
                metadata = _parsed(self._data, at, end, Metadata.read)
                layout.items.append(MetadataIndex(at, end - at, metadata.name))
            elif opcode != Opcode.MESSAGE_INDEX:  # without its chunk it serves nobody
                layout.items.append(LooseRecord(at, end - at))
        except (
            ValueError,
            struct.error,
            EOFError,
        ) as error:  # what the official parsers raise; RecordError is a ValueError
            self._lose(end - at, str(error), at)
        return end

    def _take_chunk(self, at: int, end: int) -> int:
        found = read_chunk(self._data, at + PREFIX.size, end)
        if found.data_start + found.data_length != end:
            raise RecordError("a chunk's sizes disagree")
        index = ChunkIndex(
            chunk_length=end - at,
            chunk_start_offset=at,
            compression=found.compression,
            compressed_size=found.data_length,
            message_end_time=found.end_ns,
            message_index_length=0,
            message_index_offsets={},
            message_start_time=found.start_ns,
            uncompressed_size=found.uncompressed_size,
        )
        counts: dict[int, int] = {}
        cursor = end
        while (record := self._record(cursor)) and record[0] == Opcode.MESSAGE_INDEX:
            try:
                channel_id, first, last = read_message_index(self._data, cursor + PREFIX.size, record[1])
            except RecordError:
                break
            index.message_index_offsets[channel_id] = cursor
            counts[channel_id] = (last - first) // INDEX_ENTRY_BYTES
            cursor = record[1]
        index.message_index_length = cursor - end
        chunk = CopiedChunk(at, cursor - at, index, counts)
        if self._recover or not counts:
            try:
                chunk = self._inspected(chunk)
            except (ChunkError, RecordError) as error:
                self._layout.n_chunks_lost += 1
                self._lose(cursor - at, str(error), at)
                return cursor
        self._layout.items.append(chunk)
        return cursor

    def _inspected(self, chunk: CopiedChunk) -> CopiedChunk:
        """The chunk with what it really holds, to be indexed anew where its header or its indexes say otherwise."""
        entries = index_entries(open_chunk(self._data, chunk.index))
        times = np.concatenate([np.zeros(0, "<u8"), *(each["log_time"] for each in entries.values())])
        span = (int(times.min()), int(times.max())) if len(times) else (0, 0)
        stale = span != (chunk.index.message_start_time, chunk.index.message_end_time) and len(times) > 0
        if chunk.message_counts:
            stale |= set(entries) != set(chunk.index.message_index_offsets)
            for channel_id, offset in chunk.index.message_index_offsets.items():
                stale |= channel_id in entries and not self._index_fits(offset, entries[channel_id])
        return replace(chunk, message_counts={each: len(rows) for each, rows in entries.items()}, reindex=bool(stale))

    def _index_fits(self, offset: int, entries: npt.NDArray[np.void]) -> bool:
        """Whether a message index record holds these entries, in any order."""
        _, start, end = read_prefix(self._data, offset, len(self._data))
        _, first, last = read_message_index(self._data, start, end)
        listed = np.frombuffer(self._data[first:last], INDEX_ENTRY)
        return np.array_equal(np.sort(listed, order="offset"), entries)

    def _take_messages(self, at: int) -> int:
        """Loose messages up to the next record of another kind or a chunk's worth."""
        cursor = at
        while (record := self._record(cursor)) and record[0] == Opcode.MESSAGE and cursor - at < MAX_LOOSE_BYTES:
            cursor = record[1]
        entries = index_entries(self._data[at:cursor])
        self._layout.items.append(LooseMessages(at, cursor - at, entries))
        return cursor

    def _take_attachment(self, at: int, end: int) -> None:
        found = read_attachment(self._data, at + PREFIX.size, end)
        if self._recover:
            (crc,) = struct.unpack("<I", self._data[end - 4 : end])
            if crc and crc != crc32(self._data, at + PREFIX.size, end - 4):
                raise RecordError("the CRC of an attachment does not fit")
        self._layout.items.append(
            AttachmentIndex(
                offset=at,
                length=end - at,
                log_time=found.log_time_ns,
                create_time=found.create_time_ns,
                data_size=found.size,
                name=found.name,
                media_type=found.media_type,
            )
        )

    def _read_summary(self) -> None:
        """Schemas, channels and chunk offsets that the summary repeats, unless it is missing or damaged."""
        footer_at = len(self._data) - len(MAGIC) - FOOTER.size
        if footer_at < 0 or self._data[footer_at + FOOTER.size : len(self._data)] != MAGIC:
            return
        opcode, _, start, _, crc = FOOTER.unpack(self._data[footer_at : footer_at + FOOTER.size])
        if opcode != Opcode.FOOTER or not 0 < start <= footer_at:
            return
        if crc and zlib.crc32(self._data[start : footer_at + FOOTER.size - 4]) != crc:
            return
        at = start
        try:
            while at < footer_at and (record := self._record(at)):
                opcode, end = record
                if opcode == Opcode.SCHEMA:
                    schema = _parsed(self._data, at, end, Schema.read)
                    self._layout.schemas[schema.id] = schema
                elif opcode == Opcode.CHANNEL:
                    channel = _parsed(self._data, at, end, Channel.read)
                    self._layout.channels[channel.id] = channel
                elif opcode == Opcode.STATISTICS:
                    self._counted_channels = _parsed(self._data, at, end, Statistics.read).channel_count
                elif opcode == Opcode.CHUNK_INDEX:
                    self._chunk_starts.append(_parsed(self._data, at, end, ChunkIndex.read).chunk_start_offset)
                at = end
        except (ValueError, struct.error, EOFError):
            return

    def _complete_channels(self) -> None:
        """Open the chunks where the summary does not repeat all schemas and channels."""
        layout = self._layout
        used = {channel_id for item in layout.items for channel_id in _channel_ids(item)}
        known_schemas = {0, *layout.schemas}
        if (
            self._counted_channels == len(layout.channels)
            and used <= set(layout.channels)
            and all(channel.schema_id in known_schemas for channel in layout.channels.values())
        ):
            return
        for item in layout.items:
            if isinstance(item, CopiedChunk):
                try:
                    self._define(open_chunk(self._data, item.index))
                except (ChunkError, RecordError) as error:
                    raise InputError(damage_at(item.start, error), where=self._name, hint=RECOVER_HINT) from error

    def _define(self, records: memoryview) -> None:
        """Take over the schemas and channels that a chunk holds."""
        for opcode, start, end in chunk_records(records):
            if opcode == Opcode.SCHEMA:
                schema = _parsed(records, start, end, Schema.read)
                self._layout.schemas.setdefault(schema.id, schema)
            elif opcode == Opcode.CHANNEL:
                channel = _parsed(records, start, end, Channel.read)
                self._layout.channels.setdefault(channel.id, channel)

    def _lose(self, n_bytes: int, why: str, at: int) -> None:
        if not self._recover:
            raise InputError(damage_at(at, why), where=self._name, hint=RECOVER_HINT)
        self._layout.n_bytes_lost += n_bytes


def damage_at(at: int, why: object) -> str:
    """The message of an `InputError`."""
    return f"damaged at byte {at}: {why}"


def _channel_ids(item: Item) -> Iterator[int]:
    if isinstance(item, CopiedChunk):
        yield from item.message_counts
    elif isinstance(item, LooseMessages | SalvagedRecords):
        yield from item.entries


def _parsed(data: Data, start: int, end: int, read: Callable[[ReadDataStream], Record]) -> Record:
    return read(ReadDataStream(BytesIO(data[start + PREFIX.size : end])))
