"""Encodes MCAP records as bytes.

Format: https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping

from cwcli.logs.format.records import (
    OPCODE_ATTACHMENT_INDEX,
    OPCODE_CHANNEL,
    OPCODE_CHUNK,
    OPCODE_CHUNK_INDEX,
    OPCODE_DATA_END,
    OPCODE_FOOTER,
    OPCODE_HEADER,
    OPCODE_MESSAGE_INDEX,
    OPCODE_METADATA,
    OPCODE_METADATA_INDEX,
    OPCODE_SCHEMA,
    OPCODE_STATISTICS,
    OPCODE_SUMMARY_OFFSET,
    RECORD_PREFIX,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    MetadataIndex,
    Schema,
    Statistics,
)
from cwcli.text import escape_surrogates


def encode_header(profile: str, library: str) -> bytes:
    """Encode a header record."""
    return _encode_record(OPCODE_HEADER, _encode_text(profile), _encode_text(library))


def encode_schema(record: Schema) -> bytes:
    """Encode a schema record."""
    return _encode_record(
        OPCODE_SCHEMA,
        _pack_little_endian("H", record.id),
        _encode_text(record.name),
        _encode_text(record.encoding),
        _with_length_prefix(record.data),
    )


def encode_channel(record: Channel) -> bytes:
    """Encode a channel record."""
    ids = _pack_little_endian("HH", record.id, record.schema_id)
    return _encode_record(
        OPCODE_CHANNEL,
        ids,
        _encode_text(record.topic),
        _encode_text(record.message_encoding),
        _encode_text_map(record.metadata),
    )


def encode_chunk_head(start_ns: int, end_ns: int, size: int, crc: int, compression: str, stored_size: int) -> bytes:
    """Encode the beginning of a chunk record, up to the stored records."""
    fields = (
        _pack_little_endian("QQQI", start_ns, end_ns, size, crc)
        + _encode_text(compression)
        + _pack_little_endian("Q", stored_size)
    )
    return RECORD_PREFIX.pack(OPCODE_CHUNK, len(fields) + stored_size) + fields


def encode_message_index(channel_id: int, entries: bytes) -> bytes:
    """Encode a message index record; `entries` are (u64 log time, u64 offset) pairs."""
    return _encode_record(OPCODE_MESSAGE_INDEX, _pack_little_endian("H", channel_id), _with_length_prefix(entries))


def encode_metadata(name: str, values: Mapping[str, str]) -> bytes:
    """Encode a metadata record."""
    return _encode_record(OPCODE_METADATA, _encode_text(name), _encode_text_map(values))


def encode_data_end(crc: int = 0) -> bytes:
    """Encode a data end record; a CRC of 0 means that it is not available."""
    return _encode_record(OPCODE_DATA_END, _pack_little_endian("I", crc))


def encode_chunk_index(record: ChunkIndex) -> bytes:
    """Encode a chunk index record."""
    return _encode_record(
        OPCODE_CHUNK_INDEX,
        _pack_little_endian("QQQQ", record.start_ns, record.end_ns, record.chunk_start, record.chunk_length),
        _encode_count_map(record.index_offsets),
        _pack_little_endian("Q", record.index_length),
        _encode_text(record.compression),
        _pack_little_endian("QQ", record.compressed_size, record.uncompressed_size),
    )


def encode_attachment_index(record: AttachmentIndex) -> bytes:
    """Encode an attachment index record."""
    *numbers, name, media_type = record
    return _encode_record(
        OPCODE_ATTACHMENT_INDEX, _pack_little_endian("QQQQQ", *numbers), _encode_text(name), _encode_text(media_type)
    )


def encode_metadata_index(record: MetadataIndex) -> bytes:
    """Encode a metadata index record."""
    return _encode_record(
        OPCODE_METADATA_INDEX, _pack_little_endian("QQ", record.offset, record.length), _encode_text(record.name)
    )


def encode_statistics(record: Statistics) -> bytes:
    """Encode a statistics record."""
    *numbers, counts = record
    return _encode_record(OPCODE_STATISTICS, _pack_little_endian("QHIIIIQQ", *numbers), _encode_count_map(counts))


def encode_summary_offset(opcode: int, start: int, length: int) -> bytes:
    """Encode a summary offset record: the place of the summary's records with one opcode."""
    return _encode_record(OPCODE_SUMMARY_OFFSET, _pack_little_endian("BQQ", opcode, start, length))


def encode_footer(summary_start: int, summary_offset_start: int, summary: bytes | bytearray) -> bytes:
    """Encode the footer record with the CRC over the summary and the footer's own beginning."""
    fields = _pack_little_endian("QQ", summary_start, summary_offset_start)
    head = RECORD_PREFIX.pack(OPCODE_FOOTER, len(fields) + 4) + fields
    return head + _pack_little_endian("I", zlib.crc32(head, zlib.crc32(summary)))


def _encode_record(opcode: int, *fields: bytes) -> bytes:
    content = b"".join(fields)
    return RECORD_PREFIX.pack(opcode, len(content)) + content


def _pack_little_endian(layout: str, *numbers: object) -> bytes:
    """Pack unsigned little-endian numbers; `layout` as in `struct`, without the byte order."""
    return struct.pack(f"<{layout}", *numbers)


def _with_length_prefix(data: bytes) -> bytes:
    """Put the 32-bit length of the bytes in front of them."""
    return _pack_little_endian("I", len(data)) + data


def _encode_text(text: str) -> bytes:
    return _with_length_prefix(escape_surrogates(text).encode())


def _encode_text_map(texts: Mapping[str, str]) -> bytes:
    return _with_length_prefix(b"".join(_encode_text(key) + _encode_text(value) for key, value in texts.items()))


def _encode_count_map(counts: Mapping[int, int]) -> bytes:
    return _with_length_prefix(b"".join(_pack_little_endian("HQ", key, value) for key, value in counts.items()))
