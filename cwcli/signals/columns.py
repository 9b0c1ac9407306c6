"""A decoded channel: one array per leaf field.

This is the common language of the file formats (which produce it), the role bindings (which give it a meaning) and
the stages (which publish it). Nothing here knows of MCAP.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import field
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass, replace

Int64Array = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
NumericArray = npt.NDArray[np.generic]
StateRows = FloatArray
"""Vehicle states, shape (n, 8), in the order of `vehicle_state.STATE_NAMES`."""
StateCovariances = FloatArray
"""Covariances of vehicle states, shape (n, 8, 8)."""
StateCovariance = FloatArray
"""One covariance of a vehicle state, shape (8, 8)."""
ValueRows = FloatArray
"""Values of one quantity, shape (n, d): one row per sample, one column per component."""
AccelGyroRows = FloatArray
"""Samples of an IMU, shape (n, 6): specific force along x, y, z and turn rates about them."""
EastNorthRows = FloatArray
"""Places or displacements on the map, shape (n, 2): east and north, m."""
StampsNsAndIsGiven = tuple[Int64Array, npt.NDArray[np.bool_]]
"""Stamps in ns since 1970 and whether each message has a usable one, (n,) each."""
LatLonAltColumns = tuple[FloatArray, FloatArray, FloatArray]
"""Latitude and longitude in degrees and altitude in m above the ellipsoid, (n,) each."""
EastNorthUpColumns = tuple[FloatArray, FloatArray, FloatArray]
"""Places on the map in m to the east, north and up, (n,) each."""
LatLonAlt = tuple[float, float, float]
"""Latitude and longitude in degrees and altitude in m above the ellipsoid."""
FirstAndLastNs = tuple[int, int]
"""The first and the last time of a span, ns since 1970."""
T = TypeVar("T")
Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True)
class Ragged:
    """Numeric sequences of varying length: row `i` is `values[offsets[i]:offsets[i + 1]]`.

    Attributes:
        values: Shape (total,).
        offsets: Shape (n + 1,), int64, from 0 to total.
    """

    values: NumericArray
    offsets: Int64Array

    def __len__(self) -> int:
        return len(self.offsets) - 1


@dataclass(frozen=True)
class Strings:
    """Dictionary-coded strings: row `i` is `values[codes[i]]`; a code of -1 means absent.

    Attributes:
        codes: Shape (n,), int32.
        values: The distinct strings, in order of first appearance.
    """

    codes: npt.NDArray[np.int32]
    values: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.codes)

    def select_rows(self, rows: npt.NDArray[np.intp]) -> Strings:
        """The given rows, in the given order."""
        return Strings(self.codes[rows], self.values)

    def text_of_row(self, row: int) -> str:
        """The string of a row, "" where it is absent."""
        code = int(self.codes[row])
        return self.values[code] if code >= 0 else ""

    def merge_equal_values(self) -> Strings:
        """The same rows with every value held once: writers of dictionaries rely on that."""
        index: dict[str, int] = {}
        code_of = np.array([*(index.setdefault(value, len(index)) for value in self.values), -1], np.int32)
        return self if len(index) == len(self.values) else Strings(code_of[self.codes], tuple(index))


def repeat_string(value: str, n: int) -> Strings:
    """Return `n` rows of one string."""
    return Strings(np.zeros(n, np.int32), (value,))


def absent_strings(n: int) -> Strings:
    """Return `n` rows without a string."""
    return Strings(np.full(n, -1, np.int32), ())


def concat_strings(parts: Sequence[Strings]) -> Strings:
    """Return the rows of several columns one after the other, equal values held once."""
    index: dict[str, int] = {}
    codes = [
        np.array([*(index.setdefault(value, len(index)) for value in part.values), -1], np.int32)[part.codes]
        for part in parts
    ]
    return Strings(np.concatenate(codes), tuple(index))


def encode_strings(rows: Iterable[str]) -> Strings:
    """Dictionary-code n strings in order of first appearance; an empty one is absent (code -1)."""
    index: dict[str, int] = {}
    codes = np.fromiter((index.setdefault(row, len(index)) if row else -1 for row in rows), np.int32)
    return Strings(codes=codes, values=tuple(index))


def key_numbers_and_rows_of_first_appearance(keys: NumericArray) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.intp]]:
    """Number the distinct keys of n rows, m in all, in order of first appearance.

    Returns:
        The number of each row's key, shape (n,), and the row in which each key appears first, shape (m,).
    """
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    return rank[inverse], first[order]


Field = NumericArray | Ragged | Strings


@dataclass(frozen=True)
class Columns:
    """One channel as columns, in log-time order.

    Attributes:
        topic: Channel topic.
        schema_name: Schema name as the file gives it: `sensor_msgs/msg/NavSatFix`, `foxglove.LocationFix`.
        message_encoding: `cdr`, `protobuf` or `json`.
        log_time_ns: Shape (n,), int64.
        publish_time_ns: Shape (n,), int64.
        sequence: Shape (n,), uint32.
        fields: Dotted leaf path -> array with n rows. Numeric scalars are (n,), fixed-size numeric arrays
            (n, k); strings are `Strings`; numeric sequences of varying length, and leaves inside a sequence of
            messages (`returns.range`), are `Ragged`. Absent JSON and protobuf values are NaN in a float
            column. Byte blobs (image data) are never here: see `Log.frames`.
        n_undecodable: Messages of the channel that could not be decoded and are left out of every array.
    """

    topic: str
    schema_name: str
    message_encoding: str
    log_time_ns: Int64Array
    publish_time_ns: Int64Array
    sequence: npt.NDArray[np.uint32]
    fields: Mapping[str, Field]
    n_undecodable: int = 0

    def __len__(self) -> int:
        return len(self.log_time_ns)

    def slice_by_log_time(self, start_ns: int | None, end_ns: int | None) -> Columns:
        """The messages logged in [start_ns, end_ns)."""
        if start_ns is None and end_ns is None:
            return self
        first = 0 if start_ns is None else int(np.searchsorted(self.log_time_ns, start_ns))
        last = len(self) if end_ns is None else int(np.searchsorted(self.log_time_ns, end_ns))
        return self.slice_rows(first, max(first, last))

    def with_fields_of_rows(self, rows: npt.NDArray[np.integer], fields: Mapping[str, Field]) -> Columns:
        """Columns with the times of the messages `rows` (m,), of which some may come twice, and other fields."""
        return replace(
            self,
            log_time_ns=self.log_time_ns[rows],
            publish_time_ns=self.publish_time_ns[rows],
            sequence=self.sequence[rows],
            fields=fields,
            n_undecodable=0,
        )

    def slice_rows(self, first: int, last: int) -> Columns:
        """The rows `first` to `last`, without the latter."""
        fields: dict[str, Any] = {name: slice_column(values, first, last) for name, values in self.fields.items()}
        return replace(
            self,
            log_time_ns=self.log_time_ns[first:last],
            publish_time_ns=self.publish_time_ns[first:last],
            sequence=self.sequence[first:last],
            fields=fields,
        )


@dataclass(frozen=True)
class Repeated:
    """Messages inside messages: row `i` holds the elements `offsets[i]` to `offsets[i + 1]`. Only for output.

    Attributes:
        offsets: Shape (n + 1,), int64, from 0 to total.
        fields: Field path inside the element -> total rows.
    """

    offsets: Int64Array
    fields: Mapping[str, OutputField]

    def __len__(self) -> int:
        return len(self.offsets) - 1


OutputField = Field | Repeated


def slice_column(column: OutputField, start: int, stop: int) -> OutputField:
    """Return rows `start` to `stop` of a column; the bulk of the data is viewed, not copied."""
    if isinstance(column, Strings):
        return Strings(column.codes[start:stop], column.values)
    if isinstance(column, Ragged):
        offsets = column.offsets[start : stop + 1]
        return Ragged(column.values[offsets[0] : offsets[-1]], offsets - offsets[0])
    if isinstance(column, Repeated):
        offsets = column.offsets[start : stop + 1]
        first, last = int(offsets[0]), int(offsets[-1])
        return Repeated(
            offsets - first, {path: slice_column(inner, first, last) for path, inner in column.fields.items()}
        )
    return column[start:stop]


def select_column_rows(column: Field, rows: npt.NDArray[np.intp]) -> Field:
    """The given rows of a column, in the given order."""
    if isinstance(column, Strings):
        return column.select_rows(rows)
    if isinstance(column, Ragged):
        lengths = np.diff(column.offsets)[rows]
        offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        inside = np.arange(offsets[-1]) - np.repeat(offsets[:-1], lengths)
        return Ragged(column.values[np.repeat(column.offsets[:-1][rows], lengths) + inside], offsets)
    return column.take(rows, axis=0)


def sort_distinct_values(values: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
    """Return the distinct values in increasing order, each NaN one of its own.

    `np.unique` imports `numpy.ma` to find out that an array is not masked, which takes a tenth of a short command.
    """
    ordered = np.sort(values, axis=None)
    is_first = np.ones(len(ordered), bool)
    np.not_equal(ordered[1:], ordered[:-1], out=is_first[1:])
    return ordered[is_first]


def median_of_values(values: npt.NDArray[Any]) -> float:
    """Return the median of all values, NaN where one is or there is none: as `np.median`, but without `numpy.ma`."""
    if not values.size or np.isnan((ordered := np.sort(values, axis=None))[-1]):
        return np.nan
    middle = len(ordered) // 2
    return float(np.mean(ordered[middle - 1 + len(ordered) % 2 : middle + 1]))


def median_of_finite(values: FloatArray) -> float | None:
    """Return the median of the finite values; None without any."""
    finite = values[np.isfinite(values)]
    return median_of_values(finite) if len(finite) else None


def quantile_of_values(values: npt.NDArray[Any], share: float) -> float:
    """Return a quantile of all values, at least one, interpolated as `np.quantile` does; NaN where one is NaN."""
    ordered = np.sort(values, axis=None)
    if np.isnan(ordered[-1]):
        return np.nan
    place = (len(ordered) - 1) * share
    below = int(place)
    low, high = float(ordered[below]), float(ordered[min(below + 1, len(ordered) - 1)])
    part = place - below
    return high - (high - low) * (1.0 - part) if part >= 0.5 else low + (high - low) * part


def select_table_rows(table: T, rows: npt.NDArray[np.generic] | slice, *, shared: Collection[str] = ()) -> T:
    """Return some rows of a data class of columns, in the given order; what is no column stays as it is.

    Args:
        table: Its arrays, `Strings` and tables hold n rows each.
        rows: Numbers of rows, a mask (n,), or a slice.
        shared: Names of the columns that do not hold one value per row.
    """
    columns = {
        name: column if name in shared else _select_rows_if_column(column, rows) for name, column in vars(table).items()
    }
    kind: Any = type(table)
    selected: T = kind(**columns)
    return selected


def _select_rows_if_column(column: Any, rows: Any) -> Any:
    if isinstance(column, np.ndarray):
        is_numbers = isinstance(rows, np.ndarray) and rows.dtype.kind in "iu"  # `take` copies whole rows
        if is_numbers and len(column) > 1 and column.strides[0] == 0:  # one row for all, e.g. an unknown covariance
            return np.broadcast_to(column[:1], (len(rows), *column.shape[1:]))
        return column.take(rows, axis=0) if is_numbers else column[rows]
    return column.select_rows(rows) if hasattr(column, "select_rows") else column


@dataclass(frozen=True)
class OutputChannel:
    """A channel that a stage publishes, as columns named like the fields of its protobuf message.

    Attributes:
        topic: The topic on which it is published, e.g. `/cwcli/ego/state`.
        schema_name: A message of `schemas/`, e.g. `cwcli.v1.VehicleState`, or a standard `foxglove.*` one.
        log_time_ns: Shape (n,), int64, non-decreasing.
        fields: Field path -> n rows. (n, k) arrays and `Ragged` fill repeated numbers, `Repeated` fills repeated
            messages. A field that is not named is left out of the message.
    """

    topic: str
    schema_name: str
    log_time_ns: Int64Array
    fields: Mapping[str, OutputField] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.log_time_ns)


@dataclass(frozen=True)
class StreamedChannel(OutputChannel):
    """A channel whose columns are made a few rows at a time while they are written, because they may not fit memory.

    `fields` is empty; whoever reads the channel in the same run has its columns made.

    Attributes:
        make_rows: Rows `start` to `stop` as columns. After a first look at the very first rows for their size, it is
            called with spans that move forward; a span may begin with rows of the one before.
    """

    make_rows: Callable[[int, int], Mapping[str, OutputField]] = field(kw_only=True)
