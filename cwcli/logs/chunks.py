"""The inside of an MCAP chunk."""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO

import numpy as np
import numpy.typing as npt
from mcap.opcode import Opcode
from mcap.records import ChunkIndex

from cwcli.logs.message_merge import INDEX_ENTRY

RECORD_PREFIX = struct.Struct("<BQ")
READ_BYTES = 1 << 16
MESSAGE_FIELDS = struct.Struct("<BQHIQQ")
CRC_AT = 9 + 24  # opcode and length, start time, end time, uncompressed size


class ChunkDamageError(Exception):
    """A chunk, or a record in it, can't be what was written."""


def open_chunk(data: mmap.mmap, index: ChunkIndex) -> memoryview:
    """The uncompressed records of a chunk.

    Args:
        data: The whole file.
        index: Where the chunk is.

    Raises:
        ChunkDamageError: It can't be decompressed, has another size than it says, or its CRC does not fit.
    """
    try:
        records = _decompressed(stored_bytes(data, index), index.compression, index.uncompressed_size)
    except (RuntimeError, ValueError, OverflowError, MemoryError, EOFError) as error:
        raise ChunkDamageError(f"it can't be decompressed ({error})") from error
    if len(records) != index.uncompressed_size:
        raise ChunkDamageError("its size is not the one that it names")
    (crc,) = struct.unpack_from("<I", data, index.chunk_start_offset + CRC_AT)
    if crc and crc != zlib.crc32(records):
        raise ChunkDamageError("its CRC does not fit")
    return records


def open_cut_chunk(data: mmap.mmap, start: int) -> memoryview:
    """The whole records of a chunk that is cut or whose length is wrong: as many as can be decompressed.

    Args:
        data: The whole file.
        start: Offset of the chunk record.
    """
    at = start + CRC_AT + 4
    try:
        (name_length,) = struct.unpack_from("<I", data, at)
        compression = data[at + 4 : at + 4 + name_length].decode()
        at += 4 + name_length
        (stored,) = struct.unpack_from("<Q", data, at)
        records = memoryview(_decompressed_start(memoryview(data)[at + 8 : at + 8 + stored], compression))
    except (struct.error, RuntimeError, ValueError, EOFError):
        return memoryview(b"")
    whole = 0
    with suppress(ChunkDamageError):
        for _, _, end, _ in chunk_records(records):
            whole = end
    return records[:whole]


def stored_bytes(data: mmap.mmap, index: ChunkIndex) -> memoryview:
    """The records of a chunk as they are stored, compressed or not."""
    end = index.chunk_start_offset + index.chunk_length
    return memoryview(data)[end - index.compressed_size : end]


def chunk_records(records: memoryview) -> Iterator[tuple[int, int, int, memoryview]]:
    """Opcode, start and end (within the chunk) of each record, and the chunk's bytes.

    Raises:
        ChunkDamageError: A record reaches beyond the chunk.
    """
    at = 0
    while at < len(records):
        if at + RECORD_PREFIX.size > len(records):
            raise ChunkDamageError("a record is cut short")
        opcode, length = RECORD_PREFIX.unpack_from(records, at)
        end = at + RECORD_PREFIX.size + length
        if end > len(records):
            raise ChunkDamageError("a record is cut short")
        yield opcode, at, end, records
        at = end


def index_entries(records: memoryview) -> dict[int, npt.NDArray[np.void]]:
    """Channel id -> (log time, offset) of its messages in file order, dtype `INDEX_ENTRY`.

    Raises:
        ChunkDamageError: A record reaches beyond the given bytes.
    """
    found: dict[int, list[tuple[int, int]]] = {}
    for opcode, start, end, _ in chunk_records(records):
        if opcode == Opcode.MESSAGE:
            if end - start < MESSAGE_FIELDS.size:
                raise ChunkDamageError("a message is shorter than its header")
            _, _, channel_id, _, log_time, _ = MESSAGE_FIELDS.unpack_from(records, start)
            found.setdefault(channel_id, []).append((log_time, start))
    return {channel_id: np.array(entries, INDEX_ENTRY) for channel_id, entries in found.items()}


def without_channels(records: memoryview, channel_ids: frozenset[int]) -> memoryview:
    """The records without the messages and the definitions of some channels.

    Raises:
        ChunkDamageError: A record reaches beyond the given bytes.
    """
    kept = bytearray()
    for opcode, start, end, _ in chunk_records(records):
        if opcode in (Opcode.MESSAGE, Opcode.CHANNEL):
            (channel_id,) = struct.unpack_from("<H", records, start + RECORD_PREFIX.size)
            if channel_id in channel_ids:
                continue
        kept += records[start:end]
    return memoryview(kept)


def _decompressed_start(stored: memoryview, compression: str) -> bytes | memoryview:
    """What the first part of the stored bytes holds."""
    if compression == "zstd":
        import zstandard

        reader = zstandard.ZstdDecompressor().stream_reader(stored)
    elif compression == "lz4":
        import lz4.frame

        reader = lz4.frame.LZ4FrameFile(BytesIO(stored))
    else:
        return stored if compression == "" else b""
    found = bytearray()
    with suppress(RuntimeError, EOFError, ValueError, OSError, _zstd_error()):
        while block := reader.read(READ_BYTES):
            found += block
    return bytes(found)


def _zstd_error() -> type[Exception]:
    import zstandard

    return zstandard.ZstdError


def _decompressed(stored: memoryview, compression: str, size: int) -> memoryview:
    if compression == "":
        return stored
    if compression == "zstd":
        import zstandard

        try:
            return memoryview(zstandard.ZstdDecompressor().decompress(stored, size))
        except zstandard.ZstdError as error:
            raise ValueError(error) from error
    if compression == "lz4":
        import lz4.frame

        return memoryview(lz4.frame.decompress(stored))
    raise ChunkDamageError(f"its compression {compression!r} is unknown")
