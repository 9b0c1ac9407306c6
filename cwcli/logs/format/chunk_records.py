"""The records inside an MCAP chunk, for a copy: where they are, and without those of some channels."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import suppress

import mcap.records
import numpy as np
import numpy.typing as npt

from cwcli.input import InputFile
from cwcli.logs.format.chunks import ChunkError, chunk_payload, partial_payload
from cwcli.logs.format.records import (
    CHANNEL,
    MESSAGE,
    MESSAGE_HEADER_BYTES,
    PREFIX,
    ChunkIndex,
    RecordError,
    read_chunk_head,
    read_prefix,
)
from cwcli.logs.write.message_merge import INDEX_ENTRY

_MESSAGE = struct.Struct("<HIQ")


def open_chunk(data: InputFile, index: mcap.records.ChunkIndex) -> memoryview:
    """The uncompressed records of a chunk.

    Args:
        data: The whole file.
        index: Where the chunk is.

    Raises:
        ChunkError: As `chunk_payload`.
    """
    place = ChunkIndex(
        index.message_start_time,
        index.message_end_time,
        index.chunk_start_offset,
        index.chunk_length,
        index.message_index_offsets,
        index.message_index_length,
        index.compression,
        index.compressed_size,
        index.uncompressed_size,
    )
    return chunk_payload(data, place, verify=True)


def open_cut_chunk(data: InputFile, start: int) -> memoryview:
    """The whole records of a chunk that is cut or whose length is wrong: as many as can be decompressed.

    Args:
        data: The whole file.
        start: Offset of the chunk record.
    """
    try:
        head = read_chunk_head(data, start + PREFIX.size, len(data))
        n_stored = min(head.data_length, len(data) - head.data_start)
        length = head.data_start + n_stored - start
        place = ChunkIndex(
            head.start_ns, head.end_ns, start, length, {}, 0, head.compression, n_stored, head.uncompressed_size
        )
        records = partial_payload(data, place)
    except (RecordError, ChunkError):
        return memoryview(b"")
    whole = 0
    with suppress(RecordError):
        for _, _, end in chunk_records(records):
            whole = end
    return records[:whole]


def stored_bytes(data: InputFile, index: mcap.records.ChunkIndex) -> memoryview:
    """The records of a chunk as they are stored, compressed or not."""
    end = index.chunk_start_offset + index.chunk_length
    return data[end - index.compressed_size : end]


def chunk_records(records: memoryview) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end (within the chunk) of each record, prefix included.

    Raises:
        RecordError: A record reaches beyond the chunk.
    """
    at = 0
    while at < len(records):
        opcode, _, end = read_prefix(records, at, len(records))
        yield opcode, at, end
        at = end


def index_entries(records: memoryview) -> dict[int, npt.NDArray[np.void]]:
    """Channel id -> (log time, offset) of its messages in file order, dtype `INDEX_ENTRY`.

    Raises:
        RecordError: A record reaches beyond the given bytes.
    """
    found: dict[int, list[tuple[int, int]]] = {}
    for opcode, start, end in chunk_records(records):
        if opcode == MESSAGE:
            if end - start < PREFIX.size + MESSAGE_HEADER_BYTES:
                raise RecordError("a message is shorter than its header")
            channel_id, _, log_time_ns = _MESSAGE.unpack_from(records, start + PREFIX.size)
            found.setdefault(channel_id, []).append((log_time_ns, start))
    return {channel_id: np.array(entries, INDEX_ENTRY) for channel_id, entries in found.items()}


def without_channels(records: memoryview, channel_ids: frozenset[int]) -> memoryview:
    """The records without the messages and the definitions of some channels.

    Raises:
        RecordError: A record reaches beyond the given bytes, or is too short for a channel id.
    """
    kept = bytearray()
    for opcode, start, end in chunk_records(records):
        if opcode in (MESSAGE, CHANNEL):
            if end - start < PREFIX.size + 2:
                raise RecordError("a record ends before its fields do")
            if int.from_bytes(records[start + PREFIX.size : start + PREFIX.size + 2], "little") in channel_ids:
                continue
        kept += records[start:end]
    return memoryview(kept)
