"""Encodes MCAP records as bytes.

Format: https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping

from cwcli.logs.format.records import (
    ATTACHMENT,
    ATTACHMENT_INDEX,
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    HEADER,
    MESSAGE_INDEX,
    METADATA,
    METADATA_INDEX,
    PREFIX,
    SCHEMA,
    STATISTICS,
    SUMMARY_OFFSET,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    MetadataIndex,
    Schema,
    Statistics,
)


def header(profile: str, library: str) -> bytes:
    """Encode a header record."""
    return _record(HEADER, _text(profile), _text(library))


def schema(record: Schema) -> bytes:
    """Encode a schema record."""
    return _record(SCHEMA, _u("H", record.id), _text(record.name), _text(record.encoding), _sized(record.data))


def channel(record: Channel) -> bytes:
    """Encode a channel record."""
    ids = _u("HH", record.id, record.schema_id)
    return _record(CHANNEL, ids, _text(record.topic), _text(record.message_encoding), _texts(record.metadata))


def chunk_head(start_ns: int, end_ns: int, size: int, crc: int, compression: str, stored_size: int) -> bytes:
    """Encode the beginning of a chunk record, up to the stored records."""
    fields = _u("QQQI", start_ns, end_ns, size, crc) + _text(compression) + _u("Q", stored_size)
    return PREFIX.pack(CHUNK, len(fields) + stored_size) + fields


def message_index(channel_id: int, entries: bytes) -> bytes:
    """Encode a message index record; `entries` are (u64 log time, u64 offset) pairs."""
    return _record(MESSAGE_INDEX, _u("H", channel_id), _sized(entries))


def attachment(log_time_ns: int, create_time_ns: int, name: str, media_type: str, data: bytes) -> bytes:
    """Encode an attachment record with its CRC; times in ns."""
    fields = _u("QQ", log_time_ns, create_time_ns) + _text(name) + _text(media_type) + _u("Q", len(data)) + data
    return _record(ATTACHMENT, fields, _u("I", zlib.crc32(fields)))


def metadata(name: str, values: Mapping[str, str]) -> bytes:
    """Encode a metadata record."""
    return _record(METADATA, _text(name), _texts(values))


def data_end(crc: int = 0) -> bytes:
    """Encode a data end record; a CRC of 0 means that it is not available."""
    return _record(DATA_END, _u("I", crc))


def chunk_index(record: ChunkIndex) -> bytes:
    """Encode a chunk index record."""
    return _record(
        CHUNK_INDEX,
        _u("QQQQ", record.start_ns, record.end_ns, record.chunk_start, record.chunk_length),
        _counts(record.index_offsets),
        _u("Q", record.index_length),
        _text(record.compression),
        _u("QQ", record.compressed_size, record.uncompressed_size),
    )


def attachment_index(record: AttachmentIndex) -> bytes:
    """Encode an attachment index record."""
    *numbers, name, media_type = record
    return _record(ATTACHMENT_INDEX, _u("QQQQQ", *numbers), _text(name), _text(media_type))


def metadata_index(record: MetadataIndex) -> bytes:
    """Encode a metadata index record."""
    return _record(METADATA_INDEX, _u("QQ", record.offset, record.length), _text(record.name))


def statistics(record: Statistics) -> bytes:
    """Encode a statistics record."""
    *numbers, counts = record
    return _record(STATISTICS, _u("QHIIIIQQ", *numbers), _counts(counts))


def summary_offset(opcode: int, start: int, length: int) -> bytes:
    """Encode a summary offset record: the place of the summary's records with one opcode."""
    return _record(SUMMARY_OFFSET, _u("BQQ", opcode, start, length))


def footer(summary_start: int, summary_offset_start: int, summary: bytes | bytearray) -> bytes:
    """Encode the footer record with the CRC over the summary and the footer's own beginning."""
    fields = _u("QQ", summary_start, summary_offset_start)
    head = PREFIX.pack(FOOTER, len(fields) + 4) + fields
    return head + _u("I", zlib.crc32(head, zlib.crc32(summary)))


def _record(opcode: int, *fields: bytes) -> bytes:
    content = b"".join(fields)
    return PREFIX.pack(opcode, len(content)) + content


def _u(layout: str, *numbers: object) -> bytes:
    """Pack unsigned little-endian numbers; `layout` as in `struct`, without the byte order."""
    return struct.pack(f"<{layout}", *numbers)


def _sized(data: bytes) -> bytes:
    """Put the 32-bit length of the bytes in front of them."""
    return _u("I", len(data)) + data


def _text(text: str) -> bytes:
    return _sized(text.encode())


def _texts(texts: Mapping[str, str]) -> bytes:
    return _sized(b"".join(_text(key) + _text(value) for key, value in texts.items()))


def _counts(counts: Mapping[int, int]) -> bytes:
    return _sized(b"".join(_u("HQ", key, value) for key, value in counts.items()))
