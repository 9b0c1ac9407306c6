"""Encodes MCAP records as bytes.

Format: https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from typing import Any

from cwcli.logs.format.records import (
    RECORD_LAYOUTS,
    RECORD_PREFIX,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    FieldReader,
    MetadataIndex,
    Opcode,
    Schema,
    Statistics,
)
from cwcli.text import escape_surrogates


def encode_header(profile: str, library: str) -> bytes:
    return _join_record(Opcode.HEADER, _encode_text(profile), _encode_text(library))


def encode_record(record: Schema | Channel | ChunkIndex | AttachmentIndex | MetadataIndex | Statistics) -> bytes:
    """Encode a record of a class of `RECORD_LAYOUTS`."""
    opcode, layouts = RECORD_LAYOUTS[type(record)]
    values: Iterator[Any] = iter(record)
    fields = []
    for layout in layouts:
        if isinstance(layout, struct.Struct):
            fields.append(layout.pack(*islice(values, len(layout.format) - 1)))
        else:
            fields.append(_ENCODERS_OF_VARYING_FIELDS[layout](next(values)))
    return _join_record(opcode, *fields)


def encode_chunk_head(start_ns: int, end_ns: int, size: int, crc: int, compression: str, stored_size: int) -> bytes:
    """Encode the beginning of a chunk record, up to the stored records."""
    fields = (
        _pack_little_endian("QQQI", start_ns, end_ns, size, crc)
        + _encode_text(compression)
        + _pack_little_endian("Q", stored_size)
    )
    return RECORD_PREFIX.pack(Opcode.CHUNK, len(fields) + stored_size) + fields


def encode_message_index(channel_id: int, entries: bytes) -> bytes:
    """Encode a message index record; `entries` are (u64 log time, u64 offset) pairs."""
    return _join_record(Opcode.MESSAGE_INDEX, _pack_little_endian("H", channel_id), _with_length_prefix(entries))


def encode_metadata(name: str, values: Mapping[str, str]) -> bytes:
    return _join_record(Opcode.METADATA, _encode_text(name), _encode_text_map(values))


def encode_data_end(crc: int = 0) -> bytes:
    """Encode a data end record; a CRC of 0 means that it is not available."""
    return _join_record(Opcode.DATA_END, _pack_little_endian("I", crc))


def encode_summary_offset(opcode: int, start: int, length: int) -> bytes:
    """Encode a summary offset record: the place of the summary's records with one opcode."""
    return _join_record(Opcode.SUMMARY_OFFSET, _pack_little_endian("BQQ", opcode, start, length))


def encode_footer(summary_start: int, summary_offset_start: int, summary: bytes | bytearray) -> bytes:
    """Encode the footer record with the CRC over the summary and the footer's own beginning."""
    fields = _pack_little_endian("QQ", summary_start, summary_offset_start)
    head = RECORD_PREFIX.pack(Opcode.FOOTER, len(fields) + 4) + fields
    return head + _pack_little_endian("I", zlib.crc32(head, zlib.crc32(summary)))


def _join_record(opcode: int, *fields: bytes) -> bytes:
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


_ENCODERS_OF_VARYING_FIELDS: dict[Callable[[FieldReader], Any], Callable[[Any], bytes]] = {
    FieldReader.read_string: _encode_text,
    FieldReader.read_byte_string: _with_length_prefix,
    FieldReader.read_text_map: _encode_text_map,
    FieldReader.read_count_map: _encode_count_map,
}
"""Reader of a field of varying size -> its encoder."""
