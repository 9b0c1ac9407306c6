"""Growing column buffers of the decoders, filled by the kernels batch by batch through their memory addresses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from cwcli.kernels.message_scan import intern_spans
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, Int64Array, NumericArray, Ragged, Strings

ByteArray = npt.NDArray[np.uint8]
BYTES_PER_START_AND_LENGTH = 16
"""Size in bytes of a span: start and length as int64."""


@dataclass(frozen=True)
class Payloads:
    """The encoded messages of one channel.

    Attributes:
        data: Bytes of a chunk or of the file, shape (size,).
        starts, ends: Places of the messages in `data`, shape (n,), int64.
    """

    data: ByteArray
    starts: Int64Array
    ends: Int64Array

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def n_bytes(self) -> int:
        """Return the total size of the messages in bytes."""
        return int((self.ends - self.starts).sum())

    def slice_messages(self, start: int, stop: int) -> Payloads:
        """Return messages `start` to `stop`."""
        return Payloads(self.data, self.starts[start:stop], self.ends[start:stop])

    def select_messages(self, rows: npt.NDArray[np.intp]) -> Payloads:
        """Return the messages of the given rows."""
        return Payloads(self.data, self.starts[rows], self.ends[rows])

    def message_bytes(self, row: int) -> bytes:
        """Return the bytes of one message."""
        return self.data[self.starts[row] : self.ends[row]].tobytes()


class FixedColumnBuffer:
    """A growing column of numbers; new rows are zero.

    Attributes:
        array: Shape (capacity,), or (capacity, k) for `count` = k.
    """

    def __init__(self, dtype: npt.DTypeLike, count: int | None = None) -> None:
        self.array = np.zeros((0,) if count is None else (0, count), dtype)

    def ensure_capacity(self, capacity: int) -> None:
        """Allocate memory for `capacity` rows."""
        if len(self.array) < capacity:
            grown = np.zeros((capacity, *self.array.shape[1:]), self.array.dtype)
            grown[: len(self.array)] = self.array
            self.array = grown

    def row_zero_address(self, first_row: int, n: int) -> int:
        """Return the memory address of row 0."""
        return memory_address_of_array(self.array)

    def resolve_batch_spans(self, batch_bytes: ByteArray, first_row: int, is_ok: BoolArray) -> None:
        """Finish a batch: numbers need nothing more."""


class StringColumnBuffer:
    """A growing column of strings: the kernel writes spans, which are dictionary-coded after each batch.

    Attributes:
        spans: Start and length in the current batch, shape (n, 2). Rows that the kernel does not set are empty strings.
        codes: Index into `values` of each message, shape (capacity,).
        values: Distinct strings as bytes.
    """

    def __init__(self) -> None:
        self.spans = np.zeros((0, 2), np.int64)
        self.codes = np.zeros(0, np.int32)
        self.values: list[bytes] = []
        self._known: dict[bytes, int] = {}

    def ensure_capacity(self, capacity: int) -> None:
        """Allocate memory for `capacity` rows."""
        if len(self.codes) < capacity:
            grown = np.zeros(capacity, np.int32)
            grown[: len(self.codes)] = self.codes
            self.codes = grown

    def row_zero_address(self, first_row: int, n: int) -> int:
        """Return the memory address that row 0 would have if the spans covered all rows, not only the batch."""
        self.spans = np.zeros((n, 2), np.int64)
        return memory_address_of_array(self.spans) - BYTES_PER_START_AND_LENGTH * first_row

    def resolve_batch_spans(self, batch_bytes: ByteArray, first_row: int, is_ok: BoolArray) -> None:
        """Finish a batch: replace its spans by codes."""
        self.spans[~is_ok, 0] = -1
        n = len(self.spans)
        intern_spans(batch_bytes, self.spans, self.codes[first_row : first_row + n], self._known, self.values)

    def set_string_of_row(self, row: int, text: bytes) -> None:
        """Set the string of one row."""
        code = self._known.setdefault(text, len(self.values))
        if code == len(self.values):
            self.values.append(text)
        self.codes[row] = code

    def build_strings(self, rows: Int64Array) -> Strings:
        """Return the strings of the given rows. Bytes that are not UTF-8 become escapes."""
        values = tuple(value.decode(errors="backslashreplace") for value in self.values)
        return order_values_by_first_use(Strings(self.codes[rows], values).merge_equal_values())


class BlobSpanBuffer(StringColumnBuffer):
    """The spans of the current batch alone: the places of the bytes of images."""

    def ensure_capacity(self, capacity: int) -> None:
        """Do nothing, because only the current batch is stored."""

    def resolve_batch_spans(self, batch_bytes: ByteArray, first_row: int, is_ok: BoolArray) -> None:
        """Finish a batch: store the bytes in which the spans lie."""
        self.spans[~is_ok] = 0
        self.data = batch_bytes
        self.instead: dict[int, bytes] = {}

    def blobs_of_batch(self) -> list[bytes | memoryview]:
        """Return the field's bytes in each message of the batch."""
        whole = self.data.data
        return [
            self.instead[row] if row in self.instead else whole[start : start + size]
            for row, (start, size) in enumerate(self.spans.tolist())
        ]


class RaggedColumnBuffer:
    """A growing column of sequences.

    Attributes:
        dtype: NumPy type of the elements.
        cursors: Bytes written up to each message of the batch, shape (n,).
    """

    def __init__(self, dtype: npt.DTypeLike) -> None:
        self.dtype = np.dtype(dtype)
        self.cursors = np.zeros(0, np.int64)
        self.buffer = np.zeros(0, np.uint8)
        self._values: list[NumericArray] = []
        self._counts: list[Int64Array] = []

    def begin_batch(self, n: int, n_bytes: int) -> None:
        """Begin a batch of n messages: allocate `n_bytes`, which cost nothing until they are written."""
        self.cursors = np.zeros(n, np.int64)
        self.buffer = np.empty(n_bytes + 64, np.uint8)

    def batch_values_and_offsets(self) -> tuple[NumericArray, Int64Array]:
        """Return the elements of the batch, of which message i has those from `offsets[i]` to `offsets[i + 1]`."""
        offsets = np.concatenate([np.zeros(1, np.int64), self.cursors]) // self.dtype.itemsize
        return self.buffer[: int(offsets[-1]) * self.dtype.itemsize].view(self.dtype), offsets

    def store_batch_elements(self, instead: Mapping[int, NumericArray] | None = None) -> None:
        """Finish a batch: store its elements, with those of `instead` for some rows."""
        values, offsets = self.batch_values_and_offsets()
        values, counts = values.copy(), np.diff(offsets)
        if instead:
            rows = sorted(instead)
            is_kept = np.ones(len(counts), np.bool_)
            is_kept[rows] = False
            values = values[np.repeat(is_kept, counts)]
            counts[rows] = 0
            sizes = [len(instead[row]) for row in rows]
            before = np.cumsum(counts)[rows]
            values = np.insert(values, np.repeat(before, sizes), np.concatenate([instead[row] for row in rows]))
            counts[rows] = sizes
        self._values.append(values)
        self._counts.append(counts)
        self.buffer = np.zeros(0, np.uint8)

    def build_ragged(self) -> Ragged:
        """Return the sequences of all rows."""
        counts = np.concatenate([np.zeros(1, np.int64), *self._counts])
        return Ragged(np.concatenate([np.zeros(0, self.dtype), *self._values]), np.cumsum(counts))


def row_zero_addresses(slots: Sequence[FixedColumnBuffer | StringColumnBuffer], first_row: int, n: int) -> Int64Array:
    """Return the memory address of each slot's row 0, shape (len(slots),), after all have grown for the batch."""
    return np.array([slot.row_zero_address(first_row, n) for slot in slots] or [0], np.int64)


def begin_ragged_batch_and_get_addresses(
    slots: Sequence[RaggedColumnBuffer], n: int, n_bytes: int
) -> tuple[Int64Array, Int64Array]:
    """Begin a batch; return the memory addresses of the element buffers and of the cursors, (len(slots),) each."""
    for slot in slots:
        slot.begin_batch(n, n_bytes)
    return (
        np.array([memory_address_of_array(slot.buffer) for slot in slots], np.int64),
        np.array([memory_address_of_array(slot.cursors) for slot in slots], np.int64),
    )


def capacity_for_rows(current: int, needed: int) -> int:
    """Return a capacity of at least `needed` rows, doubled so that growing stays rare."""
    return current if current >= needed else max(needed, 2 * current)


def select_ragged_rows(ragged: Ragged, rows: Int64Array) -> Ragged:
    """Return the given rows, in the given order."""
    sizes = np.diff(ragged.offsets)[rows]
    offsets = np.zeros(len(rows) + 1, np.int64)
    np.cumsum(sizes, out=offsets[1:])
    shift = np.repeat(ragged.offsets[:-1][rows] - offsets[:-1], sizes)
    return Ragged(ragged.values[np.arange(offsets[-1]) + shift], offsets)


def matrix_if_equal_lengths(ragged: Ragged) -> Ragged | NumericArray:
    """Return an array (n, k) if all rows have the same number k > 0 of elements, else the ragged column."""
    sizes = np.diff(ragged.offsets)
    if not len(sizes) or not sizes[0] or (sizes != sizes[0]).any():
        return ragged
    return ragged.values.reshape(len(sizes), -1)


def order_values_by_first_use(strings: Strings) -> Strings:
    """Return the same strings with the values in order of first use, and no unused value."""
    codes, first = np.unique(strings.codes, return_index=True)
    codes, first = codes[codes >= 0], first[codes >= 0]
    order = np.argsort(first)
    new_code = np.full(len(strings.values) + 1, -1, np.int32)
    new_code[codes[order]] = np.arange(len(codes), dtype=np.int32)
    return Strings(new_code[strings.codes], tuple(strings.values[code] for code in codes[order].tolist()))


def memory_address_of_array(array: npt.NDArray[np.generic]) -> int:
    """Return the memory address of an array."""
    address: int = array.__array_interface__["data"][0]
    return address
