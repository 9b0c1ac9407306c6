"""Reads the records of an MCAP file as plain tuples, with `struct`.

The import of the official classes takes longer than all of `cwcli info` may take. Every function raises `RecordError`
for bytes that can't be such a record, and allocates no more than the record's own size.

Format: https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Collection, Mapping
from typing import Any, NamedTuple, Protocol, TypeVar

ByteRange = tuple[int, int]
"""Offset of the first byte, and that behind the last one."""

MCAP_MAGIC = b"\x89MCAP0\r\n"
"""The bytes at the beginning and at the end of every MCAP file (MCAP specification)."""
RECORD_PREFIX = struct.Struct("<BQ")
"""The layout in front of every record: opcode and length of the content in bytes (MCAP specification)."""

FOOTER_BYTES = RECORD_PREFIX.size + 20
"""Size in bytes of a footer record with its prefix (MCAP specification)."""
MESSAGE_HEADER_BYTES = 22
"""Size in bytes of a message's channel id, sequence, log time and publish time, before the payload (MCAP
specification)."""
MESSAGE_INDEX_ENTRY_BYTES = 16
"""Size in bytes of an entry of a message index: log time and offset (MCAP specification)."""
CRC_BLOCK_BYTES = 1 << 20
"""Bytes that are read at a time to compute a CRC. Chosen by hand."""


class Opcode:
    """The opcodes of the records (MCAP specification)."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    ATTACHMENT = 0x09
    ATTACHMENT_INDEX = 0x0A
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    SUMMARY_OFFSET = 0x0E
    DATA_END = 0x0F


class ByteSource(Protocol):
    """Bytes that can be sliced: those of a file or of a chunk."""

    def __len__(self) -> int: ...

    def __getitem__(self, place: slice, /) -> memoryview: ...


class RecordError(ValueError):
    """Bytes that are not a valid record of the expected kind."""


class Schema(NamedTuple):
    """A schema record."""

    id: int
    name: str
    encoding: str
    data: bytes


class Channel(NamedTuple):
    """A channel record."""

    id: int
    schema_id: int
    topic: str
    message_encoding: str
    metadata: dict[str, str]


class Chunk(NamedTuple):
    """The place and the header of a chunk.

    Attributes:
        start, length: Of the whole record, prefix included, in bytes.
        start_ns, end_ns: First and last log time, from the header.
        uncompressed_size, crc: Of the records inside; crc 0 means that there is none.
        compression: "", "zstd", "lz4" or an unknown name.
        data_start, data_length: Place of the stored records inside, in bytes.
    """

    start: int
    length: int
    start_ns: int
    end_ns: int
    uncompressed_size: int
    crc: int
    compression: str
    data_start: int
    data_length: int


class ChunkIndex(NamedTuple):
    """A chunk index record, with message counts.

    Attributes: as in the format, and
        index_offsets: Channel id -> offset of its message index record.
        counts: Channel id -> messages; None if they are not counted yet.
    """

    start_ns: int
    end_ns: int
    chunk_start: int
    chunk_length: int
    index_offsets: dict[int, int]
    index_length: int
    compression: str
    compressed_size: int
    uncompressed_size: int
    counts: Mapping[int, int] | None = None

    @property
    def channel_ids(self) -> Collection[int]:
        """Return the ids of the channels in the chunk; empty if the chunk must be opened to know them."""
        return self.index_offsets if self.counts is None else self.counts

    @property
    def end_offset(self) -> int:
        """Return the offset at which the chunk's message indexes end."""
        return self.chunk_start + self.chunk_length + self.index_length


class AttachmentIndex(NamedTuple):
    """The place, the times, the size and the type of an attachment."""

    offset: int
    length: int
    log_time_ns: int
    create_time_ns: int
    size: int
    name: str
    media_type: str


class MetadataIndex(NamedTuple):
    """The place and the name of a metadata record."""

    offset: int
    length: int
    name: str


class Statistics(NamedTuple):
    """The counts of a file and its first and last log time in ns."""

    n_messages: int
    n_schemas: int
    n_channels: int
    n_attachments: int
    n_metadata: int
    n_chunks: int
    start_ns: int
    end_ns: int
    channel_counts: dict[int, int]


class Footer(NamedTuple):
    """The places of the summary and of its offsets, and the summary's CRC."""

    summary_start: int
    summary_offset_start: int
    summary_crc: int


class FieldReader:
    """Reads the fields of a record one after the other.

    Args:
        data: The file, or a chunk.
        start, end: The record's content, without the prefix.
    """

    def __init__(self, data: ByteSource, start: int, end: int) -> None:
        self._data = data
        self.at = start
        self.end = end

    def read_numbers(self, layout: struct.Struct) -> tuple[int, ...]:
        """Read fields of fixed size.

        Raises:
            RecordError: The record ends before them.
        """
        after = self.at + layout.size
        if after > self.end:
            raise RecordError("a record ends before its fields do")
        values = layout.unpack(self._data[self.at : after])
        self.at = after
        return values

    def read_byte_string(self) -> bytes:
        """Read bytes after their 32-bit length."""
        (length,) = self.read_numbers(_U32)
        after = self.at + length
        if after > self.end:
            raise RecordError("a record ends before its fields do")
        value = bytes(self._data[self.at : after])
        self.at = after
        return value

    def read_string(self) -> str:
        """Read a UTF-8 string after its 32-bit length."""
        try:
            return self.read_byte_string().decode()
        except UnicodeDecodeError as error:
            raise RecordError("a name is not UTF-8") from error

    def read_text_map(self) -> dict[str, str]:
        """Read a map of strings to strings."""
        inner = self._nested_reader()
        found: dict[str, str] = {}
        while inner.at < inner.end:
            key = inner.read_string()
            found[key] = inner.read_string()
        return found

    def read_count_map(self) -> dict[int, int]:
        """Read a map of channel ids to 64-bit numbers."""
        inner = self._nested_reader()
        if (inner.end - inner.at) % _U16_U64.size:
            raise RecordError("a map's length is not a multiple of its entries'")
        found = {}
        while inner.at < inner.end:
            key, value = inner.read_numbers(_U16_U64)
            found[key] = value
        return found

    def _nested_reader(self) -> FieldReader:
        (length,) = self.read_numbers(_U32)
        if self.at + length > self.end:
            raise RecordError("a record ends before its fields do")
        inner = FieldReader(self._data, self.at, self.at + length)
        self.at += length
        return inner


_U16 = struct.Struct("<H")
"""The layout of one little-endian 16-bit number."""
_U32 = struct.Struct("<I")
"""The layout of one little-endian 32-bit number."""
_U64 = struct.Struct("<Q")
"""The layout of one little-endian 64-bit number."""
_U16_U64 = struct.Struct("<HQ")
"""The layout of a map entry: channel id and 64-bit number."""
_U64_U64 = struct.Struct("<QQ")
"""The layout of two 64-bit numbers."""
_CHUNK_HEAD_FIELDS = struct.Struct("<QQQI")
"""The first fields of a chunk: first and last log time, uncompressed size, CRC."""

MAX_CHANNEL_RECORD_BYTES = 8_000_000
"""The greatest size of a channel with its metadata. Chosen by hand: recorders write a few thousand bytes."""

FieldLayout = struct.Struct | Callable[[FieldReader], Any]
"""The layout of some fields of a record: numbers of fixed size, or the reader of one field of varying size."""
_LENGTH_PREFIXED_TEXT_LAYOUT, _LENGTH_PREFIXED_BYTES_LAYOUT = FieldReader.read_string, FieldReader.read_byte_string
"""The layouts of a text and of bytes, each after its length."""
_READ_COUNTS_BY_CHANNEL_ID = FieldReader.read_count_map
"""The layout of a map of channel ids to numbers."""
RECORD_LAYOUTS: dict[type[tuple[Any, ...]], tuple[int, tuple[FieldLayout, ...]]] = {
    Schema: (
        Opcode.SCHEMA,
        (_U16, _LENGTH_PREFIXED_TEXT_LAYOUT, _LENGTH_PREFIXED_TEXT_LAYOUT, _LENGTH_PREFIXED_BYTES_LAYOUT),
    ),
    Channel: (
        Opcode.CHANNEL,
        (struct.Struct("<HH"), _LENGTH_PREFIXED_TEXT_LAYOUT, _LENGTH_PREFIXED_TEXT_LAYOUT, FieldReader.read_text_map),
    ),
    ChunkIndex: (
        Opcode.CHUNK_INDEX,
        (struct.Struct("<QQQQ"), _READ_COUNTS_BY_CHANNEL_ID, _U64, _LENGTH_PREFIXED_TEXT_LAYOUT, _U64_U64),
    ),
    AttachmentIndex: (
        Opcode.ATTACHMENT_INDEX,
        (struct.Struct("<QQQQQ"), _LENGTH_PREFIXED_TEXT_LAYOUT, _LENGTH_PREFIXED_TEXT_LAYOUT),
    ),
    MetadataIndex: (Opcode.METADATA_INDEX, (_U64_U64, _LENGTH_PREFIXED_TEXT_LAYOUT)),
    Statistics: (Opcode.STATISTICS, (struct.Struct("<QHIIIIQQ"), _READ_COUNTS_BY_CHANNEL_ID)),
    Footer: (Opcode.FOOTER, (struct.Struct("<QQI"),)),
}
"""Class of a record -> its opcode, and the layout of its fields in their order (MCAP specification)."""
AnyRecord = TypeVar("AnyRecord", bound=tuple[Any, ...])


def read_opcode_and_content_range(data: ByteSource, offset: int, end: int) -> tuple[int, int, int]:
    """Return opcode, content start and content end of the record at an offset.

    Raises:
        RecordError: It does not end before `end`.
    """
    if offset + RECORD_PREFIX.size > end:
        raise RecordError("a record is cut short")
    start = offset + RECORD_PREFIX.size
    opcode, length = RECORD_PREFIX.unpack(data[offset:start])
    if opcode == 0:
        raise RecordError("a record has the opcode 0")
    if length > end - start:
        raise RecordError(f"a record declares {length} bytes, {end - start} are left")
    return opcode, start, start + length


def crc32_of_range(data: ByteSource, start: int, end: int) -> int:
    """Return the CRC-32 of bytes `start` to `end`, however many."""
    crc = 0
    for at in range(start, end, CRC_BLOCK_BYTES):
        crc = zlib.crc32(data[at : min(at + CRC_BLOCK_BYTES, end)], crc)
    return crc


def read_profile_and_library(data: ByteSource, start: int, end: int) -> tuple[str, str]:
    fields = FieldReader(data, start, end)
    return fields.read_string(), fields.read_string()


def read_record(kind: type[AnyRecord], data: ByteSource, start: int, end: int) -> AnyRecord:
    """Read a record of a class of `RECORD_LAYOUTS`, of which `start` to `end` is the content."""
    fields = FieldReader(data, start, end)
    values: list[Any] = []
    for layout in RECORD_LAYOUTS[kind][1]:
        if isinstance(layout, struct.Struct):
            values += fields.read_numbers(layout)
        else:
            values.append(layout(fields))
    return kind(*values)


def read_channel(data: ByteSource, start: int, end: int) -> Channel:
    """Read a channel, unless its metadata may take many times its bytes."""
    if end - start > MAX_CHANNEL_RECORD_BYTES:
        raise RecordError(f"a channel has {end - start:,} bytes")
    return read_record(Channel, data, start, end)


def read_chunk(data: ByteSource, start: int, end: int) -> Chunk:
    chunk = read_chunk_head(data, start, end)
    if chunk.data_length > end - chunk.data_start:
        raise RecordError("a chunk's records are longer than the chunk")
    return chunk


def read_chunk_head(data: ByteSource, start: int, end: int) -> Chunk:
    """Read the header of a chunk that may be cut: its declared records may end after `end`."""
    fields = FieldReader(data, start, end)
    start_ns, end_ns, size, crc = fields.read_numbers(_CHUNK_HEAD_FIELDS)
    compression = fields.read_string()
    (stored,) = fields.read_numbers(_U64)
    head = start - RECORD_PREFIX.size
    return Chunk(head, end - head, start_ns, end_ns, size, crc, compression, fields.at, stored)


def read_attachment(data: ByteSource, start: int, end: int) -> AttachmentIndex:
    """Read an attachment as its index record would list it, without its data."""
    fields = FieldReader(data, start, end)
    log_time_ns, create_time_ns = fields.read_numbers(_U64_U64)
    name, media_type = fields.read_string(), fields.read_string()
    (size,) = fields.read_numbers(_U64)
    if size + 4 > end - fields.at:
        raise RecordError("an attachment's data is longer than the attachment")
    head = start - RECORD_PREFIX.size
    return AttachmentIndex(head, end - head, log_time_ns, create_time_ns, size, name, media_type)


def attachment_crc_offset(index: AttachmentIndex) -> int:
    """Return the offset of an attachment's CRC, which follows its data; the record may end later."""
    texts = len(index.name.encode()) + len(index.media_type.encode())
    return index.offset + RECORD_PREFIX.size + 2 * _U64.size + 2 * _U32.size + texts + _U64.size + index.size


def read_metadata_name_and_entries(data: ByteSource, start: int, end: int) -> tuple[str, dict[str, str]]:
    fields = FieldReader(data, start, end)
    return fields.read_string(), fields.read_text_map()


def channel_id_and_range_of_message_index_entries(data: ByteSource, start: int, end: int) -> tuple[int, int, int]:
    """Return the channel id, and start and end of its (u64 log time, u64 offset) pairs; later fields are ignored."""
    fields = FieldReader(data, start, end)
    (channel_id,) = fields.read_numbers(_U16)
    (length,) = fields.read_numbers(_U32)
    if length > end - fields.at or length % MESSAGE_INDEX_ENTRY_BYTES:
        raise RecordError("a message index has a wrong length")
    return channel_id, fields.at, fields.at + length
