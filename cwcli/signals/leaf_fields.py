"""Reading leaf fields from decoded columns of any message encoding.

Each reader is lenient: what is not there, or no such thing, is NaN or absent. With `required` it is an error instead:
so are read the channels that cwcli itself has published.
"""

from __future__ import annotations

from math import isfinite
from typing import Literal, overload

import numpy as np
import numpy.typing as npt

from cwcli.errors import DataError
from cwcli.kernels.message_scan import intern_spans
from cwcli.signals.clocks import MAX_STAMP_NS, MIN_STAMP_NS
from cwcli.signals.columns import (
    BoolArray,
    Columns,
    Field,
    FloatArray,
    Int64Array,
    NumericArray,
    Ragged,
    StampsNsAndIsGiven,
    Strings,
    encode_strings,
)
from cwcli.signals.units import NS_PER_S
from cwcli.text import parse_float_or_nan

_PATHS_OF_MESSAGE_TIME_SECONDS = (
    "header.stamp.sec",
    "header.stamp.secs",
    "timestamp.seconds",
    "timestamp.sec",
    "stamp.sec",
)
"""The leaf fields that can hold the seconds of a message's time, in order of preference."""
_PATHS_OF_MESSAGE_TIME_NANOSECONDS = (
    "header.stamp.nanosec",
    "header.stamp.nsecs",
    "header.stamp.nsec",
    "timestamp.nanos",
    "timestamp.nsec",
    "timestamp.nanosec",
    "stamp.nanosec",
)
"""The leaf fields that can hold the nanoseconds of a message's time, in order of preference."""

MAX_EXACT_INTEGER = 2.0**53
"""The number up to which a double holds every whole number."""
MAX_BELIEVED_NUMBER_IN_PUBLISHED_CHANNEL = 1e10
"""The largest number, in the unit of its field, that is believed of a channel that cwcli published. Chosen by hand."""
SQUARED_QUANTITY_FIELDS = frozenset({"covariance", "position_covariance", "nis"})
"""Fields that hold squares, which may be as large as the square of `MAX_BELIEVED_NUMBER_IN_PUBLISHED_CHANNEL`."""


def find_field(columns: Columns, *paths: str) -> Field | None:
    """Return the first of these fields that the columns hold, or None."""
    for path in paths:
        field = columns.fields.get(path)
        if field is not None:
            return field
    return None


def read_numbers(
    columns: Columns, *paths: str, required: bool = False, takes_impossible_numbers: bool = False
) -> FloatArray:
    """Read a field as numbers (n,): the first of `paths` that is there, NaN where absent or not a number.

    Strings that spell numbers are read as such (JSON written from XER does that).

    Args:
        required: It is a field that cwcli writes, always and within `MAX_BELIEVED_NUMBER_IN_PUBLISHED_CHANNEL`.
        takes_impossible_numbers: The caller leaves out what is beyond that, and counts it.

    Raises:
        DataError: It is required, and not there as numbers, or one is impossible.
    """
    field = find_field(columns, *paths)
    if isinstance(field, np.ndarray) and field.ndim == 1:
        values = field.astype(np.float64)
        if required and not takes_impossible_numbers:
            require_possible_numbers(columns, paths[0], values)
        return values
    if required:
        raise unusable_field_error(columns, paths[0])
    if isinstance(field, Strings):
        parsed_values = np.array([parse_float_or_nan(text) for text in field.values] + [np.nan])
        return parsed_values[field.codes]
    return np.full(len(columns), np.nan)


def read_integers(columns: Columns, *paths: str, required: bool = False) -> tuple[Int64Array, BoolArray]:
    """Read a field as int64, exactly where it is an integer column.

    Returns:
        Values and whether they are there, both of shape (n,).

    Raises:
        DataError: It is required, and not there as numbers.
    """
    field = find_field(columns, *paths)
    if isinstance(field, np.ndarray) and field.ndim == 1 and np.issubdtype(field.dtype, np.integer):
        largest = np.iinfo(np.int64).max
        beyond = field.view(np.int64) < 0 if field.dtype == np.uint64 else np.zeros(len(field), np.bool_)
        return np.where(beyond, largest, field.astype(np.int64)), ~beyond
    values = read_numbers(columns, *paths, required=required)
    is_valid = np.isfinite(values) & (np.abs(values) < 9e18)
    return np.where(is_valid, values, 0.0).astype(np.int64), is_valid


@overload
def read_texts(columns: Columns, *paths: str, required: Literal[True]) -> Strings: ...
@overload
def read_texts(columns: Columns, *paths: str, required: Literal[False] = False) -> Strings | None: ...
def read_texts(columns: Columns, *paths: str, required: bool = False) -> Strings | None:
    """Read a field as n strings, None when there is none; numbers become integers, byte sequences hexadecimal.

    Args:
        columns: n messages.
        paths: Names of the field; the first that is there counts.

    Raises:
        DataError: It is required, and not there as strings.
    """
    field = find_field(columns, *paths)
    if isinstance(field, Strings):
        return field
    if required:
        raise unusable_field_error(columns, paths[0])
    if field is None:
        return None
    if isinstance(field, Ragged):
        return _format_octet_sequences(field)
    if field.ndim == 2:
        n_rows, width = field.shape
        return _format_octet_sequences(Ragged(field.ravel(), np.arange(n_rows + 1, dtype=np.int64) * width))
    return format_numbers(field.astype(np.float64))


def _format_octet_sequences(sequences: Ragged) -> Strings:
    """Format n sequences of octets in hexadecimal; an empty one, and one with a number that is no octet, is absent."""
    octets, is_octet = _octets_and_validity_of_numbers(sequences.values)
    spans = np.column_stack([sequences.offsets[:-1], np.diff(sequences.offsets)]).astype(np.int64)
    n_wrong_before = np.concatenate([[0], np.cumsum(~is_octet)])
    has_wrong = np.diff(n_wrong_before[sequences.offsets]) > 0
    spans[has_wrong | (spans[:, 1] == 0), 0] = -1
    codes, values = np.empty(len(spans), np.int32), list[bytes]()
    intern_spans(octets, spans, codes, {}, values)
    return Strings(codes, tuple(value.hex() for value in values))


def numbers_to_bit_flags(values: FloatArray) -> Int64Array:
    """Return numbers (n,) as bit flags; a number that is not whole, negative or too large has none set."""
    is_whole = (values >= 0.0) & (values < MAX_EXACT_INTEGER) & (values == np.floor(values))
    return np.where(is_whole, values, 0.0).astype(np.int64)


def format_numbers(values: FloatArray) -> Strings:
    """Format numbers (n,) as texts, whole ones as integers; absent where not finite. Different numbers get different
    texts."""
    distinct, codes = np.unique(values, return_inverse=True)
    is_whole = (distinct == np.floor(distinct)) & (np.abs(distinct) < MAX_EXACT_INTEGER)
    each = zip(distinct.tolist(), is_whole.tolist(), strict=True)
    words = encode_strings(
        [str(int(value)) if whole else repr(value) if isfinite(value) else "" for value, whole in each]
    )
    return Strings(codes=words.codes[codes].astype(np.int32), values=words.values)


def _octets_and_validity_of_numbers(values: NumericArray) -> tuple[npt.NDArray[np.uint8], BoolArray]:
    """Return numbers (n,) as octets (n,), and which of them (n,) are valid octets."""
    if values.dtype.itemsize == 1:
        return np.ascontiguousarray(values).view(np.uint8), np.ones(len(values), np.bool_)
    numbers = values.astype(np.float64)
    is_octet = (numbers >= 0.0) & (numbers <= 255.0) & (numbers == np.floor(numbers))
    return np.where(is_octet, numbers, 0.0).astype(np.uint8), is_octet


def require_possible_numbers(columns: Columns, name: str, values: NumericArray) -> None:
    """Check a field of a channel of cwcli's; NaN is unknown.

    Raises:
        DataError: A number is beyond what cwcli writes: squares of it would overflow.
    """
    largest = (
        MAX_BELIEVED_NUMBER_IN_PUBLISHED_CHANNEL**2
        if name in SQUARED_QUANTITY_FIELDS
        else MAX_BELIEVED_NUMBER_IN_PUBLISHED_CHANNEL
    )
    if values.size and max(np.fmax.reduce(values, None), -np.fmin.reduce(values, None)) > largest:
        n_beyond = np.count_nonzero(np.abs(values) > largest)
        what = f"the field `{name}` has {n_beyond:,} numbers beyond {largest:g}, which cwcli does not write"
        raise DataError(what, where=columns.topic)


def unusable_field_error(columns: Columns, name: str) -> DataError:
    """Return the error for a channel of cwcli's that lacks a field or has another in its place: another version wrote
    it."""
    return DataError(
        f"the channel has no usable field `{name}`",
        where=columns.topic,
        hint="write it again with this version of cwcli (`--replace`)",
    )


def accepted_text_mask(field: Strings | None, n_rows: int, *accepted: str) -> BoolArray:
    """Return where a string field has one of the accepted values (lower case, compared without case), shape (n,)."""
    if field is None:
        return np.zeros(n_rows, dtype=np.bool_)
    matches = np.array([value.lower() in accepted for value in field.values] + [False])
    result: BoolArray = matches[field.codes]
    return result


def read_matrix(columns: Columns, path: str, width: int | None = None, *, required: bool = False) -> FloatArray:
    """Read a repeated numeric field as shape (n, width); rows of another length are NaN.

    Args:
        columns: n messages.
        width: The length of a row; None: that of the first row.

    Raises:
        DataError: It is required, and a row lacks it, or a number is beyond `MAX_BELIEVED_NUMBER_IN_PUBLISHED_CHANNEL`.
    """
    field = find_field(columns, path)
    n = len(columns)
    if isinstance(field, np.ndarray) and field.ndim == 2 and width in (None, field.shape[1]):
        values = np.asarray(field, np.float64)
        if required:
            require_possible_numbers(columns, path, values)
        return values
    lengths = np.diff(field.offsets) if isinstance(field, Ragged) else np.full(n, -1)
    if width is None:
        width = max(int(lengths[0]), 0) if n else 0
    rows = np.flatnonzero(lengths == width)
    if isinstance(field, Ragged) and len(rows) == n:
        values = np.asarray(field.values, np.float64).reshape(n, width)
        if required:
            require_possible_numbers(columns, path, values)
        return values
    if required:
        raise unusable_field_error(columns, path)
    out = np.full((n, width), np.nan)
    if isinstance(field, Ragged):
        out[rows] = field.values[field.offsets[rows, None] + np.arange(width)]
    return out


def numbers_of_row(field: Field | None, row: int) -> FloatArray:
    """Return the numbers of a repeated numeric field in one message, empty when there are none."""
    if row < 0 or field is None or isinstance(field, Strings):
        return np.zeros(0)
    if isinstance(field, Ragged):
        return field.values[field.offsets[row] : field.offsets[row + 1]].astype(np.float64)
    return np.atleast_1d(field[row].astype(np.float64))


def read_vector(columns: Columns, path: str, names: tuple[str, ...] = ("x", "y", "z")) -> FloatArray:
    """Read the fields `path.x`, `path.y`, `path.z` side by side, shape (n, 3)."""
    return np.stack([read_numbers(columns, f"{path}.{name}") for name in names], axis=1)


def read_frame_id(columns: Columns, *paths: str) -> str:
    """Read the frame that the first row with one names, "" when there is none. A leading slash (ROS 1, tf) is
    removed."""
    field = find_field(columns, *(paths or ("header.frame_id", "frame_id")))
    if not isinstance(field, Strings):
        return ""
    named = field.codes[field.codes >= 0]
    return field.values[int(named[0])].lstrip("/") if len(named) else ""


def read_stamps(columns: Columns) -> StampsNsAndIsGiven:
    """Read the messages' own time (`header.stamp`, `timestamp`).

    Returns:
        Stamps in ns and whether they are usable (given, not zero, between 1970 and 2261, no more nanoseconds than a
        second has), both of shape (n,).
    """
    text = columns.fields.get("timestamp")
    if isinstance(text, Strings):
        return parse_iso_times_ns_and_is_read(text)
    seconds, has_seconds = read_integers(columns, *_PATHS_OF_MESSAGE_TIME_SECONDS)
    nanoseconds, _ = read_integers(columns, *_PATHS_OF_MESSAGE_TIME_NANOSECONDS)
    max_s = MAX_STAMP_NS // NS_PER_S
    in_range = has_seconds & (np.abs(seconds) < max_s) & (np.abs(nanoseconds) < MAX_STAMP_NS)
    in_range &= (seconds == 0) | ((nanoseconds >= 0) & (nanoseconds <= NS_PER_S))
    stamp_ns = np.where(in_range, seconds, 0) * NS_PER_S + np.where(in_range, nanoseconds, 0)
    return stamp_ns, in_range & (stamp_ns >= MIN_STAMP_NS) & (stamp_ns <= MAX_STAMP_NS)


def parse_iso_times_ns_and_is_read(field: Strings) -> StampsNsAndIsGiven:
    """Parse ISO 8601 times in UTC (`2018-05-01T16:04:10.894Z`, or ending in `[UTC]` or `+00:00`) into ns since 1970.

    Returns:
        Times and whether they could be read, both of shape (n,).
    """
    parsed = np.array([_parse_iso_time_ns(text) for text in field.values] + [0], dtype=np.int64)
    stamp_ns = parsed[field.codes]
    return stamp_ns, stamp_ns >= MIN_STAMP_NS


def _parse_iso_time_ns(text: str) -> int:
    body = text.strip().removesuffix("[UTC]").removesuffix("Z").removesuffix("+00:00")
    try:
        stamp = np.datetime64(body, "ns")
    except ValueError:
        return 0
    return 0 if np.isnat(stamp) else int(stamp.astype(np.int64))
