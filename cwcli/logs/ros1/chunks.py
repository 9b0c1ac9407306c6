"""Unpacks the chunks of a ROS 1 bag piece by piece, and never beyond the size that they declare."""

from __future__ import annotations

import bz2
from collections.abc import Iterator
from typing import Any

from cwcli.input import InputFile
from cwcli.logs.ros1.records import BagError, iter_file_pieces

BYTES_UNPACKED_AT_ONCE = 1 << 20
"""Bytes that are unpacked at a time, 1 MiB. Chosen by hand."""
BAG_CHUNK_COMPRESSIONS = ("none", "bz2", "lz4")
"""The compressions of chunks (http://wiki.ros.org/Bags/Format/2.0)."""


def iter_unpacked_pieces(file: InputFile, start: int, n_bytes: int, compression: str, size: int) -> Iterator[bytes]:
    """Yield the content of a chunk.

    Args:
        file: The bag.
        start: Place of the chunk's data.
        n_bytes: Size of the chunk's data, which may end behind the end of the file.
        compression: One of `BAG_CHUNK_COMPRESSIONS`.
        size: Size of the content as the chunk declares it.

    Raises:
        BagError: It can't be unpacked, or has another size.
    """
    stop = min(start + n_bytes, len(file))
    stored = iter_file_pieces(file, start, stop)
    if compression == "none":
        if size != n_bytes:
            raise BagError(f"a chunk declares {size:,} bytes and has {n_bytes:,}")
        yield from stored
        return
    n_left = size
    for piece in _iter_decompressed(stored, compression):
        n_left -= len(piece)
        if n_left < 0:
            raise BagError(f"a chunk unpacks to more than the {size:,} bytes that it declares")
        yield piece
    if n_left:
        raise BagError(f"a chunk unpacks to {size - n_left:,} of the {size:,} bytes that it declares")


def _iter_decompressed(stored: Iterator[bytes], compression: str) -> Iterator[bytes]:
    decompressor: Any
    faults: tuple[type[Exception], ...]
    if compression == "bz2":
        decompressor, faults = bz2.BZ2Decompressor(), (OSError, EOFError, ValueError)
    else:
        import lz4.frame

        decompressor, faults = lz4.frame.LZ4FrameDecompressor(), (RuntimeError, EOFError, ValueError)
    try:
        while not decompressor.eof:
            data = next(stored, b"") if decompressor.needs_input else b""
            if decompressor.needs_input and not data:
                return
            piece = decompressor.decompress(data, BYTES_UNPACKED_AT_ONCE)
            if piece:
                yield piece
    except faults as error:
        raise BagError(f"a chunk can't be unpacked: {error}") from error
