"""Assembles rows of bytes from pieces, column by column.

A piece is one part of every row: a number or a constant of fixed width, or bytes whose length differs from row to row.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.logs.encoders.byte_rows import (
    ByteArray,
    ByteRows,
    copy_rows,
    encode_varint,
    encode_varints,
    offsets_from_sizes,
    sliding_byte_windows,
)
from cwcli.signals.columns import Int64Array, NumericArray

MAX_WIDTH_OF_PIECES_JOINED_BEFORE_COPY_BYTES = 64
"""Width in bytes up to which neighbouring pieces are joined before they are copied; a wider piece is copied directly.
Chosen by hand."""


@dataclass(frozen=True)
class FixedPiece:
    """A piece with the same number of bytes in every row: `values` is (n,) or (n, k); a constant is (1, k) bytes."""

    values: NumericArray

    @property
    def bytes_per_row(self) -> int:
        return self.values.itemsize * (self.values.shape[1] if self.values.ndim == 2 else 1)


@dataclass(frozen=True)
class VaryingPiece:
    """A piece whose size differs from row to row: row i has `sizes[i]` bytes of `data` from `starts[i]`."""

    data: ByteArray
    starts: Int64Array
    sizes: Int64Array


Piece = FixedPiece | VaryingPiece


def piece_of_same_bytes_in_every_row(data: bytes) -> FixedPiece:
    """Return a piece with the same bytes in every row."""
    return FixedPiece(np.frombuffer(data, np.uint8)[None])


def encode_varint_piece(values: npt.NDArray[np.uint64]) -> Piece:
    """Encode numbers (n,) as varints: a constant or a piece of fixed width if they are equal or equally long."""
    n = len(values)
    if n and (values == values[0]).all():
        return piece_of_same_bytes_in_every_row(encode_varint(int(values[0])))
    rows = encode_varints(values)
    sizes = rows.sizes
    if n and (sizes == sizes[0]).all():
        return FixedPiece(rows.data.reshape(n, int(sizes[0])))
    return VaryingPiece(rows.data, rows.offsets[:-1], sizes)


def encode_total_size_of_pieces(pieces: Sequence[Piece], n: int) -> list[Piece]:
    """Return the varint with the total size of the pieces in each row."""
    fixed_size = sum(piece.bytes_per_row for piece in pieces if isinstance(piece, FixedPiece))
    varying = [piece.sizes for piece in pieces if isinstance(piece, VaryingPiece)]
    if not varying:
        return [piece_of_same_bytes_in_every_row(encode_varint(fixed_size))]
    sizes = np.full(n, fixed_size, np.int64)
    for each in varying:
        sizes += each
    return [encode_varint_piece(sizes.astype(np.uint64))]


def assemble_rows(pieces: Sequence[Piece], n: int) -> ByteRows:
    """Concatenate the pieces of each of n rows."""
    segments: list[FixedPiece | VaryingPiece] = []
    for fixed, run in _group_pieces_by_whether_small_and_fixed(pieces):
        segments += [FixedPiece(_join_fixed_pieces(run, n))] if fixed and len(run) > 1 else run
    if not segments or n == 0:
        return ByteRows(np.zeros(0, np.uint8), np.zeros(n + 1, np.int64))
    if len(segments) == 1 and isinstance(segments[0], FixedPiece) and len(segments[0].values) == n:
        block = segments[0].values.reshape(n, -1).view(np.uint8)
        return ByteRows(block.reshape(-1), np.arange(n + 1, dtype=np.int64) * block.shape[1])
    sizes = np.zeros(n, np.int64)
    for segment in segments:
        sizes += segment.bytes_per_row if isinstance(segment, FixedPiece) else segment.sizes
    offsets = offsets_from_sizes(sizes)
    data = np.empty(int(offsets[-1]), np.uint8)
    cursor = offsets[:-1].copy()
    for segment in segments:
        if isinstance(segment, FixedPiece):
            if segment.bytes_per_row:
                sliding_byte_windows(data, segment.bytes_per_row)[cursor] = _rows_as_void(segment)
            cursor += segment.bytes_per_row
        else:
            copy_rows(data, cursor, segment.data, segment.starts, segment.sizes)
            cursor += segment.sizes
    return ByteRows(data, offsets)


def _rows_as_void(piece: FixedPiece) -> npt.NDArray[np.void]:
    """Return each row of bytes as one element, shape (n,) or (1,)."""
    return piece.values.view(np.dtype((np.void, piece.bytes_per_row))).reshape(-1)


def _group_pieces_by_whether_small_and_fixed(pieces: Sequence[Piece]) -> list[tuple[bool, list[Piece]]]:
    """Group neighbouring pieces: True for pieces of small fixed size."""
    runs: list[tuple[bool, list[Piece]]] = []
    for piece in pieces:
        fixed = isinstance(piece, FixedPiece) and piece.bytes_per_row <= MAX_WIDTH_OF_PIECES_JOINED_BEFORE_COPY_BYTES
        if runs and runs[-1][0] == fixed:
            runs[-1][1].append(piece)
        else:
            runs.append((fixed, [piece]))
    return runs


def _join_fixed_pieces(run: Sequence[Piece], n: int) -> ByteArray:
    """Join pieces of fixed size side by side, shape (n, total size)."""
    pieces = [piece for piece in run if isinstance(piece, FixedPiece)]
    size = sum(piece.bytes_per_row for piece in pieces)
    block = np.empty((n, size), np.uint8)
    at = 0
    for piece in pieces:
        if piece.bytes_per_row and n:
            rows = piece.values if piece.values.ndim == 1 else _rows_as_void(piece)
            np.ndarray((n,), rows.dtype, block, at, (size,))[...] = rows
        at += piece.bytes_per_row
    return block
