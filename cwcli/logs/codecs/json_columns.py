"""The column of one JSON leaf, whose type follows from the values in all messages.

- numbers: int64 if all are integers, else float64; truth values: bool;
- absent and null: NaN, and the column is float64;
- at least one string: `Strings` (absent: -1), with numbers as text;
- arrays of numbers: (n, k) if all messages have k of them, else `Ragged`; nested arrays are flattened; leaves of
  objects in arrays are `Ragged`, and an object that lacks the leaf adds nothing; null and strings in arrays are NaN.

If most arrays hold a single string, the column is `Strings`: a number in the other arrays becomes text with a decimal
point, several values become `[...]`. Other arrays of strings, and arrays that are always empty, are left out.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.kernels import json_walk
from cwcli.kernels.message_scan import intern_spans
from cwcli.logs.codecs.column_buffers import (
    Payloads,
    matrix_if_equal_lengths,
    memory_address_of_array,
    order_values_by_first_use,
    select_ragged_rows,
)
from cwcli.signals.columns import Field, FloatArray, Int64Array, NumericArray, Ragged, Strings

TAG_ABSENT, TAG_NULL, TAG_BOOL, TAG_INT = json_walk.T_ABSENT, json_walk.T_NULL, json_walk.T_BOOL, json_walk.T_INT
"""The kernel's tags of values: absent, null, truth value, integer."""
TAG_FLOAT, TAG_STRING, TAG_ARRAY, TAG_ESCAPED_STRING = (
    json_walk.T_FLOAT,
    json_walk.T_STRING,
    json_walk.T_ARRAY,
    json_walk.T_ESCAPED,
)
"""The kernel's tags of values: floating-point number, string, array, string with escapes."""
TAG_INTERNED_STRING = 8
"""The tag of a string that is interned: its value is its code. The kernel's own tags end at 7."""
SEVERAL_VALUES_TEXT = "[...]"
"""The text that stands for an array of several values in a column of texts."""
MAX_INT64 = (1 << 63) - 1
"""The greatest integer that an int64 column holds."""
TagArray = npt.NDArray[np.uint8]
MAX_CONTIGUOUS_BUFFER_BYTES = 64 << 20
"""The greatest size in bytes of one allocation for the elements of several leaves. Chosen by hand."""
TagsAndValuesOfElements = tuple[list[int], list[int]]
"""The tags and the values of the elements of one message."""


def tag_and_int64_bits_of_scalar(value: object) -> tuple[int, int]:
    """Return tag and value (as the bits of an int64) of a Python number, truth value or None."""
    if value is None:
        return TAG_NULL, 0
    if isinstance(value, bool):
        return TAG_BOOL, int(value)
    if isinstance(value, int) and -MAX_INT64 - 1 <= value <= MAX_INT64:
        return TAG_INT, value
    try:
        number = float(value)  # type: ignore[arg-type]
    except OverflowError:
        number = float("inf") if value > 0 else float("-inf")  # type: ignore[operator]
    return TAG_FLOAT, int(np.array(number, np.float64).view(np.int64))


class LeafBuffers:
    """Buffers into which the kernel writes the values of some leaves, one row per leaf.

    Most of the names that a signal may have occur in no message of a file, and then cost next to nothing.

    Attributes:
        tags, values: Shape (leaves, capacity), one column per message; see `cwcli.kernels.json_walk`. New columns are
            zero.
        element_tags, element_values: Per leaf, the buffer for elements of arrays in the current batch.
        cursors: Shape (leaves, n): elements of the batch up to each of its messages.
        addresses: Shape (5, leaves): memory addresses of tags, values, elements' tags and values, and cursors.
    """

    def __init__(self, n_leaves: int) -> None:
        self.tags = np.zeros((n_leaves, 0), np.uint8)
        self.values = np.zeros((n_leaves, 0), np.int64)
        self.element_tags: list[TagArray] = []
        self.element_values: list[Int64Array] = []
        self.cursors = np.zeros((n_leaves, 0), np.int64)
        self.addresses = np.zeros((5, n_leaves), np.int64)
        self._n_elements = 0
        self._element_addresses = np.zeros((2, n_leaves), np.int64)

    def __len__(self) -> int:
        return len(self.tags)

    def prepare_batch(self, capacity: int, n_messages: int, n_elements: int) -> None:
        """Allocate memory before a batch.

        Args:
            capacity: Messages in all.
            n_messages: Messages of the batch.
            n_elements: Greatest number of array elements of a leaf in the batch.
        """
        n_earlier = self.tags.shape[1]
        if n_earlier < capacity:
            tags, values = np.zeros((len(self), capacity), np.uint8), np.zeros((len(self), capacity), np.int64)
            tags[:, :n_earlier], values[:, :n_earlier] = self.tags, self.values
            self.tags, self.values = tags, values
        self.cursors = np.zeros((len(self), n_messages), np.int64)
        if self._n_elements < n_elements:
            self._n_elements = n_elements
            self.element_tags = _allocate_element_buffers(len(self), n_elements, np.uint8)
            self.element_values = _allocate_element_buffers(len(self), n_elements, np.int64)
            buffers = (self.element_tags, self.element_values)
            self._element_addresses = np.array(
                [[memory_address_of_array(each) for each in own] for own in buffers], np.int64
            )
        self.addresses = self._buffer_addresses()

    def _buffer_addresses(self) -> Int64Array:
        tags, values, cursors = (_row_addresses(each) for each in (self.tags, self.values, self.cursors))
        return np.stack([tags, values, *self._element_addresses, cursors])


def _allocate_element_buffers(n: int, size: int, dtype: npt.DTypeLike) -> list[npt.NDArray[Any]]:
    """Allocate n buffers: together if that is small, because untouched memory costs nothing but must be available."""
    if n * size * np.dtype(dtype).itemsize <= MAX_CONTIGUOUS_BUFFER_BYTES:
        return list(np.empty((n, size), dtype))
    return [np.empty(size, dtype) for _ in range(n)]


def _row_addresses(matrix: npt.NDArray[np.generic]) -> Int64Array:
    """Return the memory address of each row of a matrix, shape (rows,)."""
    return memory_address_of_array(matrix) + matrix.strides[0] * np.arange(len(matrix), dtype=np.int64)


class JsonColumnBuffer:
    """The values of one leaf in each message, from the first batch on in which the leaf occurs.

    Args:
        room, leaf: The buffers, and the row in them, that the kernel fills. The value of a string is its code.
        n_earlier: Number of messages before that batch.
    """

    def __init__(self, room: LeafBuffers, leaf: int, n_earlier: int) -> None:
        self._room, self._leaf = room, leaf
        self._counts = [np.zeros(n_earlier, np.int64)] if n_earlier else []
        self._is_seen = False
        self._element_tags: list[TagArray] = []
        self._element_values: list[Int64Array] = []
        self._known: dict[bytes, int] = {}
        self._strings: list[bytes] = []

    @property
    def tags(self) -> TagArray:
        """Return the tag of the leaf in each message, shape (capacity,)."""
        tags: TagArray = self._room.tags[self._leaf]
        return tags

    @property
    def values_as_int64_bits(self) -> Int64Array:
        """Return the value of the leaf in each message, shape (capacity,)."""
        values: Int64Array = self._room.values[self._leaf]
        return values

    def store_elements_and_intern_strings(
        self,
        payloads: Payloads,
        first_row: int,
        json_elements_by_row: Mapping[int, TagsAndValuesOfElements],
        n_kernel_elements: int,
        no_counts: Int64Array,
    ) -> None:
        """Store the elements of a batch, with those of `json_elements_by_row` for some rows, and intern its strings.

        Args:
            payloads, first_row: The batch.
            json_elements_by_row: Row -> elements that the json module found.
            n_kernel_elements: Number of elements that the kernel found.
            no_counts: As many zeros as there are messages in the batch.
        """
        if n_kernel_elements or json_elements_by_row:
            self._store_elements(payloads, n_kernel_elements, json_elements_by_row)
        else:  # most names that a role may have occur in no message of the file
            self._counts.append(no_counts)
        largest = self.tags[first_row : first_row + len(payloads)].max()
        self._is_seen = self._is_seen or bool(largest or n_kernel_elements or json_elements_by_row)
        if largest >= TAG_STRING:
            self._intern_batch_strings(payloads, first_row)

    def _store_elements(
        self, payloads: Payloads, n_kernel_elements: int, json_elements_by_row: Mapping[int, TagsAndValuesOfElements]
    ) -> None:
        counts = np.diff(self._room.cursors[self._leaf], prepend=0)
        tags = self._room.element_tags[self._leaf][:n_kernel_elements].copy()
        values = self._room.element_values[self._leaf][:n_kernel_elements].copy()
        self._intern_element_strings(payloads, np.flatnonzero(counts == 1), np.cumsum(counts) - 1, tags, values)
        rows = sorted(row for row, (inner, _) in json_elements_by_row.items() if inner)
        if rows:
            sizes = [len(json_elements_by_row[row][0]) for row in rows]
            at = np.repeat(np.cumsum(counts)[rows], sizes)
            tags = np.insert(
                tags, at, np.array([tag for row in rows for tag in json_elements_by_row[row][0]], np.uint8)
            )
            values = np.insert(
                values, at, np.array([value for row in rows for value in json_elements_by_row[row][1]], np.int64)
            )
            counts[rows] = sizes
        self._counts.append(counts)
        self._element_tags.append(tags)
        self._element_values.append(values)

    def set_string(self, row: int, text: str) -> None:
        """Set the string of one message."""
        self.tags[row], self.values_as_int64_bits[row] = TAG_INTERNED_STRING, self.code_of_string(text)

    def code_of_string(self, text: str) -> int:
        """Return the code of a string, new if it is not known."""
        return self._intern_bytes(text.encode(errors="surrogatepass"))

    def _intern_bytes(self, octets: bytes) -> int:
        """Return the code of a string in UTF-8, new if it is not known."""
        code = self._known.setdefault(octets, len(self._strings))
        if code == len(self._strings):
            self._strings.append(octets)
        return code

    def take_blobs_of_batch(self, payloads: Payloads, first_row: int) -> list[bytes | memoryview]:
        """Return the bytes of the batch's strings without escapes, and forget them."""
        whole = payloads.data.data
        n = len(payloads)
        tags, values = self.tags[first_row : first_row + n], self.values_as_int64_bits[first_row : first_row + n]
        found: list[bytes | memoryview] = []
        for start, tag, value in zip(payloads.starts.tolist(), tags.tolist(), values.tolist(), strict=True):
            if tag == TAG_INTERNED_STRING:
                found.append(self._strings[value])
            elif tag in (TAG_STRING, TAG_ESCAPED_STRING):
                begin = start + (value >> 32)
                text = whole[begin : begin + (value & 0xFFFFFFFF)]
                found.append(text if tag == TAG_STRING else json.loads(b'"' + text.tobytes() + b'"').encode())
            else:
                found.append(b"")
        tags[:] = TAG_ABSENT
        self._known.clear()
        self._strings.clear()
        return found

    def build_column(self, rows: Int64Array) -> Field | None:
        """Return the column for the given messages, or None if the leaf occurs in none of them."""
        if not self._is_seen:
            return None
        tags, values = self.tags[rows], self.values_as_int64_bits[rows]
        counts = np.concatenate([np.zeros(0, np.int64), *self._counts])
        offsets = np.concatenate([[0], np.cumsum(counts)])
        if counts[rows].any():
            all_tags = np.concatenate([np.zeros(0, np.uint8), *self._element_tags])
            all_values = np.concatenate([np.zeros(0, np.int64), *self._element_values])
            element_tags = select_ragged_rows(Ragged(all_tags, offsets), rows)
            element_values = select_ragged_rows(Ragged(all_values, offsets), rows).values.view(np.int64)
            texts = self._column_of_single_strings(tags, values, element_tags, element_values)
            return _sequence_column(tags, values, element_tags, element_values) if texts is None else texts
        if not tags.any():
            return None
        return self._build_strings_column(tags, values) if TAG_STRING in tags else _number_column(tags, values)

    def _column_of_single_strings(
        self, tags: TagArray, values: Int64Array, element_tags: Ragged, element_values: Int64Array
    ) -> Strings | None:
        """Return the column of strings if most arrays hold a single string, else None."""
        sizes, first = np.diff(element_tags.offsets), element_tags.offsets[:-1]
        alone, tags, values = np.flatnonzero(sizes == 1), tags.copy(), values.copy()
        tags[sizes > 1] = TAG_ARRAY
        tags[alone], values[alone] = element_tags.values[first[alone]], element_values[first[alone]]
        tags[tags == TAG_INTERNED_STRING] = TAG_STRING
        if 2 * np.count_nonzero(tags == TAG_STRING) <= np.count_nonzero((tags != TAG_ABSENT) & (tags != TAG_NULL)):
            return None
        whole = np.flatnonzero(tags == TAG_INT)
        tags[whole], values[whole] = TAG_FLOAT, values[whole].astype(np.float64).view(np.int64)
        several = sizes > 1
        tags[several], values[several] = TAG_STRING, self.code_of_string(SEVERAL_VALUES_TEXT) if several.any() else 0
        return self._build_strings_column(tags, values)

    def _build_strings_column(self, tags: TagArray, values: Int64Array) -> Strings:
        texts = [value.decode(errors="backslashreplace") for value in self._strings]
        codes = np.where(tags == TAG_STRING, values, -1).astype(np.int32)
        for row in np.flatnonzero(np.isin(tags, (TAG_BOOL, TAG_INT, TAG_FLOAT))).tolist():
            codes[row] = len(texts)
            texts.append(_number_or_bool_text(int(tags[row]), values[row : row + 1]))
        return order_values_by_first_use(Strings(codes, tuple(texts)).merge_equal_values())

    def _intern_element_strings(
        self, payloads: Payloads, rows: npt.NDArray[np.intp], at: Int64Array, tags: TagArray, values: Int64Array
    ) -> None:
        """Replace places of strings by codes, in rows of one element; `at`: index of the last element of each row."""
        for row in rows[np.isin(tags[at[rows]], (TAG_STRING, TAG_ESCAPED_STRING))].tolist():
            k = int(at[row])
            begin = int(payloads.starts[row]) + (int(values[k]) >> 32)
            text = payloads.data[begin : begin + (int(values[k]) & 0xFFFFFFFF)].tobytes()
            try:
                values[k] = (
                    self.code_of_string(json.loads(b'"' + text + b'"'))
                    if tags[k] == TAG_ESCAPED_STRING
                    else self._intern_bytes(text)
                )
            except ValueError:  # an invalid message leaves the elements before its fault in the buffers
                tags[k] = TAG_NULL
            else:
                tags[k] = TAG_INTERNED_STRING

    def _intern_batch_strings(self, payloads: Payloads, first_row: int) -> None:
        """Replace places of strings in the messages of the batch by codes."""
        n, data, starts = len(payloads), payloads.data, payloads.starts
        tags = self.tags[first_row : first_row + n]
        values = self.values_as_int64_bits[first_row : first_row + n]
        for row in np.flatnonzero(tags == TAG_ESCAPED_STRING).tolist():
            begin = int(starts[row]) + (int(values[row]) >> 32)
            text = data[begin : begin + (int(values[row]) & 0xFFFFFFFF)].tobytes()
            self.set_string(first_row + row, json.loads(b'"' + text + b'"'))
        is_string = tags == TAG_STRING
        at: slice | npt.NDArray[np.intp] = slice(None) if is_string.all() else np.flatnonzero(is_string)
        places = values[at]
        if len(places):
            spans = np.empty((len(places), 2), np.int64)
            np.add(starts[at], places >> 32, out=spans[:, 0])
            np.bitwise_and(places, 0xFFFFFFFF, out=spans[:, 1])
            codes = np.zeros(len(places), np.int32)
            intern_spans(data, spans, codes, self._known, self._strings)
            values[at] = codes
        tags[tags == TAG_INTERNED_STRING] = TAG_STRING


def _number_column(tags: TagArray, values: Int64Array) -> NumericArray:
    """Return a column of truth values, of integers, or of floats if the kinds are mixed."""
    if len(tags) and (tags == TAG_BOOL).all():
        is_true: NumericArray = values != 0
        return is_true
    if len(tags) and (tags == TAG_INT).all():
        return values.astype(np.int64)
    return _float_column_nan_where_no_number(tags, values)


def _float_column_nan_where_no_number(tags: TagArray, values: Int64Array) -> FloatArray:
    """Return a column of floats, NaN for everything but numbers and truth values."""
    floats = np.where(tags == TAG_FLOAT, values.view(np.float64), values.astype(np.float64))
    floats[~np.isin(tags, (TAG_BOOL, TAG_INT, TAG_FLOAT))] = np.nan
    return floats


def _sequence_column(
    tags: TagArray, values: Int64Array, element_tags: Ragged, element_values: Int64Array
) -> Field | None:
    """Return a column of arrays, a single number as an array of one; None if all elements are strings."""
    inner = element_tags.values.astype(np.uint8)
    sizes = np.diff(element_tags.offsets)
    alone = np.flatnonzero(np.isin(tags, (TAG_NULL, TAG_BOOL, TAG_INT, TAG_FLOAT)) & (sizes == 0))
    if np.isin(inner, (TAG_STRING, TAG_ESCAPED_STRING, TAG_INTERNED_STRING)).all() and not len(alone):
        return None
    alone = alone[tags[alone] != TAG_NULL]
    if len(alone):
        at = element_tags.offsets[alone]
        inner = np.insert(inner, at, tags[alone])
        element_values = np.insert(element_values, at, values[alone])
        sizes[alone] = 1
    ragged = Ragged(_number_column(inner, element_values), np.concatenate([[0], np.cumsum(sizes)]))
    return matrix_if_equal_lengths(ragged) if bool((tags == TAG_ARRAY).all()) else ragged


def _number_or_bool_text(tag: int, value: Int64Array) -> str:
    """Return a number or truth value as text."""
    if tag == TAG_BOOL:
        return "true" if value[0] else "false"
    return str(int(value[0])) if tag == TAG_INT else repr(float(value.view(np.float64)[0]))
