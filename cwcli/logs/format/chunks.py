"""The records inside a chunk: decompressed, of the declared size, with the right CRC.

A declared size is never trusted with memory: the output grows with what really comes out of the decompressor where the
declared size is out of proportion.
"""

from __future__ import annotations

import struct
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from cwcli.input import InputFile
from cwcli.logs.format.records import PREFIX, ChunkIndex, RecordError, read_chunk, read_prefix

if TYPE_CHECKING:
    import zstandard

MAX_CHUNK_BYTES = 4 << 30
"""The official reader's limit for one record."""
MAX_TRUSTED_BYTES = 64 << 20
MAX_SCRATCH_BYTES = 4 << 20
MAX_LZ4_RATIO = 256
"""One byte of an lz4 block extends a match by at most 255 bytes."""
BLOCK_BYTES = 1 << 16  # what an error costs, and how far a bomb gets before it is seen
CRC_AT = PREFIX.size + 24
_U32 = struct.Struct("<I")


class ChunkError(Exception):
    """A chunk that can't be read.

    Attributes:
        is_crc: It was decompressed, but its CRC does not fit.
        is_foreign: Its compression is unknown: the file need not be damaged.
    """

    def __init__(self, what: str, *, is_crc: bool = False, is_foreign: bool = False) -> None:
        super().__init__(what)
        self.is_crc = is_crc
        self.is_foreign = is_foreign


class _Scratch(threading.local):
    """What a thread needs for one chunk after the other: fresh memory would take longer than reading into it."""

    def __init__(self) -> None:
        self._buffer = memoryview(b"")
        self._zstd: zstandard.ZstdDecompressor | None = None

    def read(self, file: InputFile, start: int, stop: int) -> memoryview:
        """Bytes of a file, until the next call."""
        if stop - start > MAX_SCRATCH_BYTES:
            return file[start:stop]
        if stop - start > len(self._buffer):
            self._buffer = memoryview(bytearray(stop - start))
        return file.read_into(self._buffer[: stop - start], start)

    def zstd(self) -> zstandard.ZstdDecompressor:
        """A decompressor."""
        if self._zstd is None:
            import zstandard

            self._zstd = zstandard.ZstdDecompressor()
        return self._zstd


_SCRATCH = _Scratch()


def chunk_payload(file: InputFile, chunk: ChunkIndex, *, verify: bool) -> memoryview:
    """The records inside a chunk.

    Args:
        file: The log.
        chunk: Where the chunk is.
        verify: Check the CRC, where the chunk has one.

    Raises:
        ChunkError: The chunk is not there, can't be decompressed, has another size than declared, or fails its CRC.
    """
    _check_header(file, chunk)
    if chunk.compression:
        end = chunk.chunk_start + chunk.chunk_length
        stored = _SCRATCH.read(file, end - chunk.compressed_size, end)
    else:
        stored = stored_records(file, chunk)
    if chunk.uncompressed_size > MAX_CHUNK_BYTES:
        raise ChunkError(f"a chunk declares {chunk.uncompressed_size} bytes")
    payload = _decompressor(chunk.compression)(stored, chunk.uncompressed_size)
    if len(payload) != chunk.uncompressed_size:
        raise ChunkError(f"a chunk holds {len(payload)} bytes instead of the declared {chunk.uncompressed_size}")
    if verify:
        _check_crc(file, chunk, payload)
    return payload


def _check_header(file: InputFile, chunk: ChunkIndex) -> None:
    """The chunk's own header against its index.

    Raises:
        ChunkError: They differ.
    """
    try:
        _, start, end = read_prefix(file, chunk.chunk_start, len(file))
        found = read_chunk(file, start, end)
    except RecordError as error:
        raise ChunkError(f"a chunk's header is damaged: {error}") from error
    declared = (chunk.chunk_length, chunk.compression, chunk.compressed_size, chunk.uncompressed_size)
    if declared != (found.length, found.compression, found.data_length, found.uncompressed_size):
        raise ChunkError("a chunk's header and its index differ")


def partial_payload(file: InputFile, chunk: ChunkIndex) -> memoryview:
    """What comes out of a chunk that is cut off, up to the first error.

    Raises:
        ChunkError: Its compression is unknown, or it is whole and fails its CRC.
    """
    payload = stored = stored_records(file, chunk)
    if chunk.compression:
        _decompressor(chunk.compression)
        start, errors = _streams()[chunk.compression]
        stream = start()
        found = bytearray()
        for at in range(0, len(stored), BLOCK_BYTES):
            try:
                found += stream.decompress(stored[at : at + BLOCK_BYTES])
            except errors:
                break
            if len(found) > MAX_CHUNK_BYTES:
                break
        payload = memoryview(found)
    if len(payload) == chunk.uncompressed_size:
        _check_crc(file, chunk, payload)
    return payload


def _check_crc(file: InputFile, chunk: ChunkIndex, payload: memoryview) -> None:
    at = chunk.chunk_start + CRC_AT
    (crc,) = _U32.unpack(file[at : at + _U32.size])
    if crc and crc != zlib.crc32(payload):
        raise ChunkError("a chunk's CRC does not fit", is_crc=True)


def whole_records(payload: memoryview) -> memoryview:
    """The records of a chunk before the first one that is damaged or cut off."""
    whole = 0
    with suppress(RecordError):
        for _, _, end in chunk_records(payload):
            whole = end
    return payload[:whole]


def chunk_records(payload: memoryview) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end (within the chunk) of each record, prefix included.

    Raises:
        RecordError: A record reaches beyond the chunk.
    """
    at = 0
    while at < len(payload):
        opcode, _, end = read_prefix(payload, at, len(payload))
        yield opcode, at, end
        at = end


def stored_records(file: InputFile, chunk: ChunkIndex) -> memoryview:
    """The records of a chunk as they are stored, compressed or not."""
    end = chunk.chunk_start + chunk.chunk_length
    return file[end - chunk.compressed_size : end]


def _decompressor(compression: str) -> Callable[[memoryview, int], memoryview]:
    try:
        return DECOMPRESSORS[compression]
    except KeyError:
        known = ", ".join(name for name in DECOMPRESSORS if name)
        raise ChunkError(f"its compression {compression[:40]!r} is unknown (known: {known})", is_foreign=True) from None


def _as_stored(stored: memoryview, size: int) -> memoryview:
    return stored


def _unzstd(stored: memoryview, size: int) -> memoryview:
    import zstandard

    try:
        declared = zstandard.frame_content_size(stored)
        if declared not in (-1, size):
            raise ChunkError(f"a chunk's zstd frame holds {declared} bytes instead of the declared {size}")
        if size <= MAX_TRUSTED_BYTES or size <= 100 * len(stored):
            return memoryview(_SCRATCH.zstd().decompress(stored, max_output_size=size))
        return _grown(zstandard.ZstdDecompressor().decompressobj(), stored, size)
    except (zstandard.ZstdError, MemoryError) as error:
        raise ChunkError(f"a chunk can't be decompressed: {_reason(error)}") from error


def _unlz4(stored: memoryview, size: int) -> memoryview:
    import lz4.frame

    if size > max(MAX_TRUSTED_BYTES, MAX_LZ4_RATIO * len(stored)):  # it would be allocated at once
        raise ChunkError(f"a chunk's lz4 frame can't hold the declared {size} bytes")
    try:
        stream = lz4.frame.LZ4FrameDecompressor()
        payload = stream.decompress(stored, max_length=size + 1)
        if not stream.eof:
            raise ChunkError("a chunk's lz4 frame does not end where it should")
        return memoryview(payload)
    except (RuntimeError, EOFError, MemoryError, ValueError) as error:
        raise ChunkError(f"a chunk can't be decompressed: {_reason(error)}") from error


def _grown(stream: Any, stored: memoryview, size: int) -> memoryview:
    found = bytearray()
    for at in range(0, len(stored), BLOCK_BYTES):
        found += stream.decompress(stored[at : at + BLOCK_BYTES])
        if len(found) > size:
            break
    return memoryview(found)


def _streams() -> dict[str, tuple[Callable[[], Any], tuple[type[Exception], ...]]]:
    """Compression -> streaming decompressor, and what it raises."""
    import lz4.frame
    import zstandard

    return {
        "zstd": (lambda: zstandard.ZstdDecompressor().decompressobj(write_size=1 << 16), (zstandard.ZstdError,)),
        "lz4": (lz4.frame.LZ4FrameDecompressor, (RuntimeError, EOFError)),
    }


def _reason(error: BaseException) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__


DECOMPRESSORS: dict[str, Callable[[memoryview, int], memoryview]] = {"": _as_stored, "zstd": _unzstd, "lz4": _unlz4}
