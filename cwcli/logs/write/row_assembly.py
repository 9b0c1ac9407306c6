"""Assembles rows of bytes from pieces, column by column.

A piece is one part of every row: a number or a constant of fixed width, or bytes whose length differs from row to row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.logs.write.byte_rows import ByteArray, ByteRows, copy_rows, offsets_of, varint, varints, windows
from cwcli.signals.columns import Int64Array, NumericArray

MAX_BLOCK_PIECE_BYTES = 64
"""Width in bytes up to which neighbouring pieces are joined before they are copied; a wider piece is copied directly.
Chosen by hand."""


@dataclass(frozen=True)
class Fixed:
    """A piece with the same number of bytes in every row: `values` is (n,) or (n, k); a constant is (1, k) bytes."""

    values: NumericArray

    @property
    def size(self) -> int:
        return self.values.itemsize * (self.values.shape[1] if self.values.ndim == 2 else 1)


@dataclass(frozen=True)
class Varying:
    """A piece whose size differs from row to row: row i has `sizes[i]` bytes of `data` from `starts[i]`."""

    data: ByteArray
    starts: Int64Array
    sizes: Int64Array


Piece = Fixed | Varying


def constant(data: bytes) -> Fixed:
    """Return a piece with the same bytes in every row."""
    return Fixed(np.frombuffer(data, np.uint8)[None])


def varint_piece(values: npt.NDArray[np.uint64]) -> Piece:
    """Encode numbers (n,) as varints: a constant or a piece of fixed width if they are equal or equally long."""
    n = len(values)
    if n and (values == values[0]).all():
        return constant(varint(int(values[0])))
    rows = varints(values)
    sizes = rows.sizes
    if n and (sizes == sizes[0]).all():
        return Fixed(rows.data.reshape(n, int(sizes[0])))
    return Varying(rows.data, rows.offsets[:-1], sizes)


def length_pieces(pieces: Sequence[Piece], n: int) -> list[Piece]:
    """Return the varint with the total size of the pieces in each row."""
    fixed_size = sum(piece.size for piece in pieces if isinstance(piece, Fixed))
    varying = [piece.sizes for piece in pieces if isinstance(piece, Varying)]
    if not varying:
        return [constant(varint(fixed_size))]
    sizes = np.full(n, fixed_size, np.int64)
    for each in varying:
        sizes += each
    return [varint_piece(sizes.astype(np.uint64))]


def assemble(pieces: Sequence[Piece], n: int) -> ByteRows:
    """Concatenate the pieces of each of n rows."""
    segments: list[Fixed | Varying] = []
    for fixed, run in _runs(pieces):
        segments += [Fixed(_block(run, n))] if fixed and len(run) > 1 else run
    if not segments or n == 0:
        return ByteRows(np.zeros(0, np.uint8), np.zeros(n + 1, np.int64))
    if len(segments) == 1 and isinstance(segments[0], Fixed) and len(segments[0].values) == n:
        block = segments[0].values.reshape(n, -1).view(np.uint8)
        return ByteRows(block.reshape(-1), np.arange(n + 1, dtype=np.int64) * block.shape[1])
    sizes = np.zeros(n, np.int64)
    for segment in segments:
        sizes += segment.size if isinstance(segment, Fixed) else segment.sizes
    offsets = offsets_of(sizes)
    data = np.empty(int(offsets[-1]), np.uint8)
    cursor = offsets[:-1].copy()
    for segment in segments:
        if isinstance(segment, Fixed):
            if segment.size:
                windows(data, segment.size)[cursor] = _void_rows(segment)
            cursor += segment.size
        else:
            copy_rows(data, cursor, segment.data, segment.starts, segment.sizes)
            cursor += segment.sizes
    return ByteRows(data, offsets)


def _void_rows(piece: Fixed) -> npt.NDArray[np.void]:
    """Return each row of bytes as one element, shape (n,) or (1,)."""
    return piece.values.view(np.dtype((np.void, piece.size))).reshape(-1)


def _runs(pieces: Sequence[Piece]) -> list[tuple[bool, list[Piece]]]:
    """Group neighbouring pieces: True for pieces of small fixed size."""
    runs: list[tuple[bool, list[Piece]]] = []
    for piece in pieces:
        fixed = isinstance(piece, Fixed) and piece.size <= MAX_BLOCK_PIECE_BYTES
        if runs and runs[-1][0] == fixed:
            runs[-1][1].append(piece)
        else:
            runs.append((fixed, [piece]))
    return runs


def _block(run: Sequence[Piece], n: int) -> ByteArray:
    """Join pieces of fixed size side by side, shape (n, total size)."""
    pieces = [piece for piece in run if isinstance(piece, Fixed)]
    size = sum(piece.size for piece in pieces)
    block = np.empty((n, size), np.uint8)
    at = 0
    for piece in pieces:
        if piece.size and n:
            rows = piece.values if piece.values.ndim == 1 else _void_rows(piece)
            np.ndarray((n,), rows.dtype, block, at, (size,))[...] = rows
        at += piece.size
    return block
