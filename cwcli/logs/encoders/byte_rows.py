"""Rows of bytes of varying length, copied without a Python object per row."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import Int64Array

ByteArray = npt.NDArray[np.uint8]

MIN_ROWS_OF_ONE_LENGTH_TO_VECTORISE = 8
"""The number of rows of one length from which a vectorised copy is cheaper than a copy per row. Chosen by hand."""


@dataclass(frozen=True)
class ByteRows:
    """Rows of bytes of varying length: row `i` is `data[offsets[i]:offsets[i + 1]]`.

    Attributes:
        data: Shape (total,), uint8.
        offsets: Shape (n + 1,), int64, non-decreasing.
    """

    data: ByteArray
    offsets: Int64Array

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def sizes(self) -> Int64Array:
        """Return the length of each row in bytes, shape (n,)."""
        return np.diff(self.offsets)

    def slice_rows(self, start: int, stop: int) -> ByteRows:
        return ByteRows(self.data, self.offsets[start : stop + 1])


def offsets_from_sizes(sizes: Int64Array) -> Int64Array:
    """Return the start of each of n rows and the total size, shape (n + 1,)."""
    offsets = np.zeros(len(sizes) + 1, np.int64)
    np.cumsum(sizes, out=offsets[1:])
    return offsets


def join_rows(rows: list[bytes]) -> ByteRows:
    sizes = np.fromiter(map(len, rows), np.int64, len(rows))
    return ByteRows(np.frombuffer(b"".join(rows), np.uint8), offsets_from_sizes(sizes))


def sliding_byte_windows(data: ByteArray, size: int) -> npt.NDArray[np.void]:
    """Return overlapping views: element `i` is the `size` bytes from `i` on, to copy rows of equal length."""
    return np.ndarray((max(len(data) - size + 1, 0),), np.dtype((np.void, size)), data, 0, (1,))


def copy_rows(
    target: ByteArray, target_starts: Int64Array, source: ByteArray, source_starts: Int64Array, sizes: Int64Array
) -> None:
    """Copy `sizes[i]` bytes from `source_starts[i]` to `target_starts[i]` for all i.

    Args:
        target: Written in place.
        source: Read.
        target_starts, source_starts, sizes: Shape (n,).
    """
    if not len(sizes):
        return
    first_size = int(sizes[0])
    if (sizes == first_size).all():
        if first_size:
            sliding_byte_windows(target, first_size)[target_starts] = sliding_byte_windows(source, first_size)[
                source_starts
            ]
        return
    distinct, group, counts = np.unique(sizes, return_inverse=True, return_counts=True)
    order = np.argsort(group, kind="stable")
    stops = np.cumsum(counts)
    for size, start, stop in zip(distinct.tolist(), (stops - counts).tolist(), stops.tolist(), strict=True):
        rows = order[start:stop]
        if size and stop - start >= MIN_ROWS_OF_ONE_LENGTH_TO_VECTORISE:
            sliding_byte_windows(target, size)[target_starts[rows]] = sliding_byte_windows(source, size)[
                source_starts[rows]
            ]
        else:
            for to, at in zip(target_starts[rows].tolist(), source_starts[rows].tolist(), strict=True):
                target[to : to + size] = source[at : at + size]


def encode_varints(values: npt.NDArray[np.uint64]) -> ByteRows:
    """Encode numbers as protobuf varints: base 128, least significant group first.

    Args:
        values: Shape (n,).

    Returns:
        n rows of 1 to 10 bytes.
    """
    n = len(values)
    if not n:
        return ByteRows(np.zeros(0, np.uint8), np.zeros(1, np.int64))
    width = max((int(values.max()).bit_length() + 6) // 7, 1)
    shifts = np.arange(width, dtype=np.uint64) * np.uint64(7)
    groups = (values[:, None] >> shifts).astype(np.uint64)
    sizes = np.maximum((groups != 0).sum(axis=1), 1).astype(np.int64)
    more = np.arange(width) < sizes[:, None] - 1
    encoded = ((groups & np.uint64(0x7F)) | (more.astype(np.uint64) << np.uint64(7))).astype(np.uint8)
    is_byte_used = np.arange(width) < sizes[:, None]
    return ByteRows(encoded[is_byte_used], offsets_from_sizes(sizes))


def encode_varint(value: int) -> bytes:
    """Encode one non-negative number as a protobuf varint."""
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    encoded.append(value)
    return bytes(encoded)
