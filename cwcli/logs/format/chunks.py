"""Decompresses chunks and checks their declared size and CRC.

A few bytes can decompress to gigabytes. The declared size of a chunk is checked before it is decompressed
(`InputFile.max_chunk_bytes`), as is the declared size of all chunks (`InputFile.max_unpacked_bytes`), and no more than
that is decompressed.
"""

from __future__ import annotations

import struct
import threading
import zlib
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from cwcli.errors import InputError
from cwcli.input import BYTES_PER_MEGABYTE, InputFile
from cwcli.logs.format.faults import RECOVER_HINT
from cwcli.logs.format.records import RECORD_PREFIX, ChunkIndex, RecordError, read_chunk, read_opcode_and_content_range

if TYPE_CHECKING:
    import zstandard

MAX_REUSED_BUFFER_BYTES = 4 << 20
"""Size in bytes of the largest read that reuses a thread's buffer. Chosen by hand: common chunks are smaller."""
MAX_LZ4_RATIO = 256
"""Greatest ratio of decompressed to compressed bytes of lz4: one byte of a block extends a match by at most 255."""
BYTES_DECOMPRESSED_AT_ONCE_FROM_CUT_CHUNK = 1 << 16
"""Bytes that are decompressed at a time from a cut chunk, and lost at an error in it. Chosen by hand."""
BYTES_AS_COSTLY_AS_ONE_MESSAGE = 500
"""Bytes that take about as long to decompress as one message takes to scan, decode and check. Chosen by hand."""
BYTES_OF_ONE_MESSAGE_FOR_RATIO = 200
"""Bytes that each message counts as beside the ratio of a compressed file, at least. Chosen by hand: periodic messages
of one channel take 6 stored bytes or more (measured with zstd at level 19), which stand for 380 with the default ratio;
those of channels that share their stamps take half of that or less."""
CHUNK_CRC_OFFSET_BYTES = RECORD_PREFIX.size + 24
"""Bytes from the start of a chunk record to its CRC (MCAP specification: two times and a size stand before it)."""
_U32 = struct.Struct("<I")
"""The layout of one little-endian 32-bit number."""

MAX_RATIO_HINT = "if you trust the log, a larger --max-ratio reads it; --recover leaves such chunks out"
"""The advice to a user whose log decompresses to more than its size allows."""


class ChunkError(Exception):
    """A chunk that can't be read.

    Attributes:
        is_crc_mismatch: It was decompressed, but its CRC is wrong.
        has_unknown_compression: Its compression is unknown: the file need not be damaged.
    """

    def __init__(
        self,
        what: str,
        *,
        is_crc_mismatch: bool = False,
        has_unknown_compression: bool = False,
        hint: str = RECOVER_HINT,
    ) -> None:
        super().__init__(what)
        self.is_crc_mismatch = is_crc_mismatch
        self.has_unknown_compression = has_unknown_compression
        self.hint = "" if has_unknown_compression else hint


class _ThreadBuffers(threading.local):
    """A read buffer and a decompressor per thread, reused because fresh memory takes longer than reading into it."""

    def __init__(self) -> None:
        self._buffer = memoryview(b"")
        self._zstd: zstandard.ZstdDecompressor | None = None

    def read_byte_range(self, file: InputFile, start: int, stop: int) -> memoryview:
        """Read bytes `start` to `stop` of a file; the result is valid until the next call."""
        if stop - start > MAX_REUSED_BUFFER_BYTES:
            return file[start:stop]
        if stop - start > len(self._buffer):
            self._buffer = memoryview(bytearray(stop - start))
        return file.read_into(self._buffer[: stop - start], start)

    def zstd_decompressor(self) -> zstandard.ZstdDecompressor:
        """Return this thread's zstd decompressor, made at the first call."""
        if self._zstd is None:
            import zstandard

            self._zstd = zstandard.ZstdDecompressor()
        return self._zstd


_THREAD_BUFFERS = _ThreadBuffers()
"""The read buffer and the decompressor of the running thread."""


def set_first_refused_chunk(file: InputFile, chunks: Sequence[ChunkIndex], cut: Collection[int] = ()) -> None:
    """Set `InputFile.refused_from` to the first chunk at which all chunks together exceed the allowed size.

    Args:
        file: One file, not a log of several parts.
        chunks: In file order. Chunks that alone exceed the limit do not count, because they are not decompressed.
        cut: Start offsets of the chunks that are cut off.
    """
    file.refused_from = None
    unpacked = 0
    for chunk in chunks:
        size = _max_size_of_cut_chunk_bytes(file, chunk) if chunk.chunk_start in cut else chunk.uncompressed_size
        unpacked += size if size <= file.max_chunk_bytes else 0
        if unpacked > file.max_unpacked_bytes:
            file.refused_from = chunk.chunk_start
            return


def _max_size_of_cut_chunk_bytes(file: InputFile, chunk: ChunkIndex) -> int:
    """Return the most bytes that a cut chunk may decompress to; its declared size may be damaged."""
    return min(max(chunk.uncompressed_size, file.max_unpacked_bytes_of(chunk.compressed_size)), file.max_chunk_bytes)


def check_message_count_against_file_size(file: InputFile, n_messages: int) -> None:
    """Check that a file holds no more messages than its size allows: a few bytes can decompress to thousands.

    Raises:
        ChunkError: It holds more.
    """
    n_most = file.max_chunk_bytes // BYTES_AS_COSTLY_AS_ONE_MESSAGE
    n_most += file.max_unpacked_bytes_of(file.n_stored_bytes) // BYTES_OF_ONE_MESSAGE_FOR_RATIO
    if n_messages > n_most:
        raise ChunkError(
            f"{n_messages:,} messages and more are in a file of {file.n_stored_bytes:,} bytes", hint=MAX_RATIO_HINT
        )


def check_unchunked_message_count(file: InputFile, n_messages: int) -> None:
    """Check the same for messages outside chunks, of which only a compressed file holds too many.

    Raises:
        InputError: It holds more.
    """
    try:
        check_message_count_against_file_size(file, n_messages)
    except ChunkError as error:
        raise InputError(str(error), where=file.name, hint="--max-ratio reads more") from error


def _check_total_size_limit(file: InputFile, chunk: ChunkIndex) -> None:
    """Check that all chunks up to this one do not exceed the allowed size.

    Raises:
        ChunkError: They exceed it.
    """
    part, at = file.part_and_offset(chunk.chunk_start)
    if part.refused_from is not None and at >= part.refused_from:
        what = (
            f"the chunks up to here hold more than {part.max_unpacked_bytes / BYTES_PER_MEGABYTE:,.0f} MB: one of "
            f"{part.max_chunk_bytes / BYTES_PER_MEGABYTE:,.0f} MB, and {part.max_ratio:g} times the file"
        )
        raise ChunkError(what, hint=MAX_RATIO_HINT)


def decompress_chunk(file: InputFile, chunk: ChunkIndex, *, verify: bool) -> memoryview:
    """Return the records inside a chunk, decompressed.

    Args:
        verify: Check the CRC, if the chunk has one.

    Raises:
        ChunkError: The chunk is missing, is too large alone or with those before it, can't be decompressed, has
            another size than declared, or its CRC is wrong.
    """
    _check_header_matches_index(file, chunk)
    _check_total_size_limit(file, chunk)
    size = max(chunk.uncompressed_size, chunk.compressed_size if not chunk.compression else 0)
    if size > file.max_chunk_bytes:
        raise _chunk_too_large_error(size, file.max_chunk_bytes)
    if chunk.compression:
        end = chunk.chunk_start + chunk.chunk_length
        stored = _THREAD_BUFFERS.read_byte_range(file, end - chunk.compressed_size, end)
    else:
        stored = stored_chunk_bytes(file, chunk)
    payload = _find_decompressor(chunk.compression)(stored, chunk.uncompressed_size)
    if len(payload) != chunk.uncompressed_size:
        raise ChunkError(f"a chunk holds {len(payload)} bytes instead of the declared {chunk.uncompressed_size}")
    if verify:
        _check_chunk_crc(file, chunk, payload)
    return payload


def _check_header_matches_index(file: InputFile, chunk: ChunkIndex) -> None:
    """Check that the chunk's header agrees with its chunk index.

    Raises:
        ChunkError: They differ.
    """
    try:
        _, start, end = read_opcode_and_content_range(file, chunk.chunk_start, len(file))
        found = read_chunk(file, start, end)
    except RecordError as error:
        raise ChunkError(f"a chunk's header is damaged: {error}") from error
    declared = (chunk.chunk_length, chunk.compression, chunk.compressed_size, chunk.uncompressed_size)
    if declared != (found.length, found.compression, found.data_length, found.uncompressed_size):
        raise ChunkError("a chunk's header and its index differ")


def decompress_cut_chunk_up_to_error(file: InputFile, chunk: ChunkIndex) -> memoryview:
    """Decompress a cut chunk up to the first error.

    Raises:
        ChunkError: Its compression is unknown, more comes out of it than is allowed, or it is whole and fails its CRC.
    """
    _find_decompressor(chunk.compression)
    _check_total_size_limit(file, chunk)
    if chunk.compressed_size > file.max_chunk_bytes:
        raise _chunk_too_large_error(chunk.compressed_size, file.max_chunk_bytes)
    payload = stored = stored_chunk_bytes(file, chunk)
    if chunk.compression:
        found, most = bytearray(), _max_size_of_cut_chunk_bytes(file, chunk)
        for block in (_iter_zstd_blocks if chunk.compression == "zstd" else _iter_lz4_blocks)(stored):
            found += block
            if len(found) > most:
                raise _chunk_too_large_error(len(found), most)
        payload = memoryview(found)
    if len(payload) == chunk.uncompressed_size:
        _check_chunk_crc(file, chunk, payload)
    return payload


def _check_chunk_crc(file: InputFile, chunk: ChunkIndex, payload: memoryview) -> None:
    at = chunk.chunk_start + CHUNK_CRC_OFFSET_BYTES
    (crc,) = _U32.unpack(file[at : at + _U32.size])
    if crc and crc != zlib.crc32(payload):
        raise ChunkError("a chunk's CRC is wrong", is_crc_mismatch=True)


def trim_to_whole_records(payload: memoryview) -> memoryview:
    """Return the records of a chunk before the first one that is damaged or cut off."""
    whole = 0
    with suppress(RecordError):
        for _, _, end in iter_opcodes_and_record_bounds(payload):
            whole = end
    return payload[:whole]


def iter_opcodes_and_record_bounds(payload: memoryview) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end (byte offsets in the chunk) of each record, prefix included.

    Raises:
        RecordError: A record reaches beyond the chunk.
    """
    at = 0
    while at < len(payload):
        opcode, _, end = read_opcode_and_content_range(payload, at, len(payload))
        yield opcode, at, end
        at = end


def stored_chunk_bytes(file: InputFile, chunk: ChunkIndex) -> memoryview:
    """Return the bytes of a chunk's records as they are stored, compressed or not."""
    end = chunk.chunk_start + chunk.chunk_length
    return file[end - chunk.compressed_size : end]


def _find_decompressor(compression: str) -> Callable[[memoryview, int], memoryview]:
    try:
        return DECOMPRESSORS[compression]
    except KeyError:
        known = ", ".join(name for name in DECOMPRESSORS if name)
        raise ChunkError(
            f"its compression {compression[:40]!r} is unknown (known: {known})", has_unknown_compression=True
        ) from None


def _check_and_return_uncompressed(stored: memoryview, size: int) -> memoryview:
    return stored


def _decompress_zstd(stored: memoryview, size: int) -> memoryview:
    import zstandard

    try:
        declared = zstandard.frame_content_size(stored)
        if declared not in (-1, size):
            raise ChunkError(f"a chunk's zstd frame holds {declared} bytes instead of the declared {size}")
        return memoryview(_THREAD_BUFFERS.zstd_decompressor().decompress(stored, max_output_size=size))
    except (zstandard.ZstdError, MemoryError) as error:
        raise ChunkError(f"a chunk can't be decompressed: {_first_line_of_error(error)}") from error


def _decompress_lz4(stored: memoryview, size: int) -> memoryview:
    import lz4.frame

    if size > MAX_LZ4_RATIO * len(stored):  # it would be allocated at once
        raise ChunkError(f"a chunk's lz4 frame can't hold the declared {size} bytes")
    try:
        stream = lz4.frame.LZ4FrameDecompressor()
        payload = stream.decompress(stored, max_length=size + 1)
        if not stream.eof:
            raise ChunkError("a chunk's lz4 frame has no end")
        return memoryview(payload)
    except (RuntimeError, EOFError, MemoryError, ValueError) as error:
        raise ChunkError(f"a chunk can't be decompressed: {_first_line_of_error(error)}") from error


def _iter_zstd_blocks(stored: memoryview) -> Iterator[bytes]:
    """Yield the bytes of a zstd frame up to the first error, in small blocks: 4 bytes can decompress to 128 kB."""
    import zstandard

    with suppress(zstandard.ZstdError), zstandard.ZstdDecompressor().stream_reader(stored) as stream:
        while block := stream.read(BYTES_DECOMPRESSED_AT_ONCE_FROM_CUT_CHUNK):
            yield block


def _iter_lz4_blocks(stored: memoryview) -> Iterator[bytes]:
    """Yield the bytes of an lz4 frame up to the first error, in small blocks."""
    import lz4.frame

    stream = lz4.frame.LZ4FrameDecompressor()
    with suppress(RuntimeError, EOFError):
        for at in range(0, len(stored), BYTES_DECOMPRESSED_AT_ONCE_FROM_CUT_CHUNK):
            yield stream.decompress(
                stored[at : at + BYTES_DECOMPRESSED_AT_ONCE_FROM_CUT_CHUNK],
                max_length=BYTES_DECOMPRESSED_AT_ONCE_FROM_CUT_CHUNK,
            )
            while not stream.needs_input and not stream.eof:
                yield stream.decompress(b"", max_length=BYTES_DECOMPRESSED_AT_ONCE_FROM_CUT_CHUNK)


def _chunk_too_large_error(size: int, bound: int) -> ChunkError:
    return ChunkError(
        f"a chunk holds {size / BYTES_PER_MEGABYTE:,.0f} MB, more than the {bound / BYTES_PER_MEGABYTE:,.0f} MB that "
        "are allowed",
        hint=f"if you trust the log, --max-chunk {-(-size // BYTES_PER_MEGABYTE)} reads it; --recover leaves the "
        "chunk out",
    )


def _first_line_of_error(error: BaseException) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__


DECOMPRESSORS: dict[str, Callable[[memoryview, int], memoryview]] = {
    "": _check_and_return_uncompressed,
    "zstd": _decompress_zstd,
    "lz4": _decompress_lz4,
}
"""Compression of a chunk -> function of the stored bytes and the declared size (MCAP registry of compressions)."""
