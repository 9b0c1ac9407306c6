"""Records as the bytes that stand in a file.

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
    return _record(HEADER, _text(profile), _text(library))


def schema(record: Schema) -> bytes:
    return _record(SCHEMA, _u("H", record.id), _text(record.name), _text(record.encoding), _sized(record.data))


def channel(record: Channel) -> bytes:
    ids = _u("HH", record.id, record.schema_id)
    return _record(CHANNEL, ids, _text(record.topic), _text(record.message_encoding), _texts(record.metadata))


def chunk_head(start_ns: int, end_ns: int, size: int, crc: int, compression: str, stored_size: int) -> bytes:
    """A chunk up to its records, which follow."""
    fields = _u("QQQI", start_ns, end_ns, size, crc) + _text(compression) + _u("Q", stored_size)
    return PREFIX.pack(CHUNK, len(fields) + stored_size) + fields


def message_index(channel_id: int, entries: bytes) -> bytes:
    """`entries`: (u64 log time, u64 offset) pairs."""
    return _record(MESSAGE_INDEX, _u("H", channel_id), _sized(entries))


def attachment(log_time_ns: int, create_time_ns: int, name: str, media_type: str, data: bytes) -> bytes:
    """With its CRC."""
    fields = _u("QQ", log_time_ns, create_time_ns) + _text(name) + _text(media_type) + _u("Q", len(data)) + data
    return _record(ATTACHMENT, fields, _u("I", zlib.crc32(fields)))


def metadata(name: str, values: Mapping[str, str]) -> bytes:
    return _record(METADATA, _text(name), _texts(values))


def data_end(crc: int = 0) -> bytes:
    """With the CRC of the data section; 0: not available."""
    return _record(DATA_END, _u("I", crc))


def chunk_index(record: ChunkIndex) -> bytes:
    return _record(
        CHUNK_INDEX,
        _u("QQQQ", record.start_ns, record.end_ns, record.chunk_start, record.chunk_length),
        _counts(record.index_offsets),
        _u("Q", record.index_length),
        _text(record.compression),
        _u("QQ", record.compressed_size, record.uncompressed_size),
    )


def attachment_index(record: AttachmentIndex) -> bytes:
    *numbers, name, media_type = record
    return _record(ATTACHMENT_INDEX, _u("QQQQQ", *numbers), _text(name), _text(media_type))


def metadata_index(record: MetadataIndex) -> bytes:
    return _record(METADATA_INDEX, _u("QQ", record.offset, record.length), _text(record.name))


def statistics(record: Statistics) -> bytes:
    *numbers, counts = record
    return _record(STATISTICS, _u("QHIIIIQQ", *numbers), _counts(counts))


def summary_offset(opcode: int, start: int, length: int) -> bytes:
    """Where the summary's records of one kind are."""
    return _record(SUMMARY_OFFSET, _u("BQQ", opcode, start, length))


def footer(summary_start: int, summary_offset_start: int, summary: bytes | bytearray) -> bytes:
    """With the CRC of the summary, which ends with the footer's own beginning."""
    fields = _u("QQ", summary_start, summary_offset_start)
    head = PREFIX.pack(FOOTER, len(fields) + 4) + fields
    return head + _u("I", zlib.crc32(head, zlib.crc32(summary)))


def _record(opcode: int, *fields: bytes) -> bytes:
    content = b"".join(fields)
    return PREFIX.pack(opcode, len(content)) + content


def _u(layout: str, *numbers: object) -> bytes:
    return struct.pack(f"<{layout}", *numbers)


def _sized(data: bytes) -> bytes:
    return _u("I", len(data)) + data


def _text(text: str) -> bytes:
    return _sized(text.encode())


def _texts(texts: Mapping[str, str]) -> bytes:
    return _sized(b"".join(_text(key) + _text(value) for key, value in texts.items()))


def _counts(counts: Mapping[int, int]) -> bytes:
    return _sized(b"".join(_u("HQ", key, value) for key, value in counts.items()))
