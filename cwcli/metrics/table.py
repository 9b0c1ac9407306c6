"""Tables of metrics, and their files: Parquet or CSV, by the suffix of the name.

Every column of a Parquet file carries the field metadata `unit`, `frame` and `doc`, where it has them. The unit follows
from the column's name (`speed_mps`, `error_mean_m`), so a table only names it where the name can't.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.output import AtomicGroup, open_output
from cwcli.output_stream import Bytes, OutputStream
from cwcli.signals.columns import NumericArray, Ragged, Strings
from cwcli.text import escape_surrogates

if TYPE_CHECKING:
    import pyarrow as pa

TableColumn = NumericArray | Ragged | Strings | Sequence[str | None]

UNIT_BY_NAME_SUFFIX = {
    "mps3": "m/s^3",
    "mps2": "m/s^2",
    "mps": "m/s",
    "m2ps2": "m^2/s^2",
    "m2": "m^2",
    "m": "m",
    "mm": "mm",
    "km": "km",
    "radps2": "rad/s^2",
    "radps": "rad/s",
    "rad2ps2": "rad^2/s^2",
    "rad2": "rad^2",
    "rad": "rad",
    "degps": "deg/s",
    "deg": "deg",
    "ns": "ns",
    "ms": "ms",
    "kj": "kJ",
    "s2": "s^2",
    "s": "s",
    "hz": "Hz",
    "1pm": "1/m",
    "px": "px",
    "pct": "%",
    "percent": "%",
}
"""Last word of a column's name -> the unit that it stands for."""
TABLE_FILE_SUFFIXES = (".parquet", ".csv")
"""Endings of the names of table files."""
MAX_ROWS_OF_SNAPPY_COMPRESSED_TABLE = 2000
"""Number of rows below which a table is compressed with Snappy, others with Zstandard. Chosen by hand."""


@dataclass(frozen=True)
class ColumnDoc:
    """What a column means.

    Attributes:
        unit: SI symbol, or "" to take it from the column's name.
        frame: Frame of reference, e.g. `map`, or "".
    """

    unit: str = ""
    frame: str = ""
    doc: str = ""


EMPTY_COLUMN_DOC = ColumnDoc()
"""The description of a column that needs none beyond its name."""


MetricRow = tuple[str, str, str, str, float, str]
"""The type of a metric row: vehicle ("" for all), source ("" for none), quantity, metric, value and unit."""
METRIC_COLUMNS = ("vehicle", "source", "quantity", "metric", "value", "unit")
"""Columns of a table of metric rows, in the order of `MetricRow`."""


@dataclass(frozen=True)
class Table:
    """Columns of equal length.

    Attributes:
        name: Name of the table, e.g. `warnings`; also the stem of its file in a metrics folder.
        columns: Column name -> n rows: (n,) or (n, k) arrays, `Strings`, a list of strings, or `Ragged`.
        docs: Column name -> meaning, for the columns whose name does not say it all.
        metadata: For the whole table, e.g. version and configuration.

    Raises:
        ValueError: The columns differ in length, or `docs` names a column that is not there.
    """

    name: str
    columns: Mapping[str, TableColumn]
    docs: Mapping[str, ColumnDoc] = field(default_factory=dict)
    metadata: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        lengths = {name: len(column) for name, column in self.columns.items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"table {self.name}: columns differ in length: {lengths}")
        undefined = set(self.docs) - set(self.columns)
        if undefined:
            raise ValueError(f"table {self.name}: docs for columns that are not there: {sorted(undefined)}")

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def rows_as_dicts(self) -> list[dict[str, Any]]:
        """Return each row as a dict of Python values, for small tables; ragged columns are left out."""
        plain: dict[str, list[Any]] = {}
        for name, column in self.columns.items():
            if isinstance(column, Strings):
                plain[name] = [None if code < 0 else column.values[code] for code in column.codes]
            elif isinstance(column, np.ndarray):
                plain[name] = column.tolist()
            elif not isinstance(column, Ragged):
                plain[name] = list(column)
        return [dict(zip(plain, row, strict=True)) for row in zip(*plain.values(), strict=True)]


class ColumnSpec(NamedTuple):
    """The type of a column's values, `int`, `float`, `bool` or `str`, and its description as in `ColumnDoc`."""

    kind: type
    doc: str = ""
    unit: str = ""


def table_from_records(name: str, specs: Mapping[str, ColumnSpec], records: Sequence[Mapping[str, Any]]) -> Table:
    """Build a table from records; without records it has its columns all the same."""
    columns: dict[str, TableColumn] = {}
    for key, spec in specs.items():
        values = [record[key] for record in records]
        columns[key] = values if spec.kind is str else np.array(values, dtype=spec.kind)
    return Table(name, columns, docs_of_columns(specs))


def docs_of_columns(specs: Mapping[str, ColumnSpec]) -> dict[str, ColumnDoc]:
    """Return the descriptions of the columns that have one."""
    return {key: ColumnDoc(unit=spec.unit, doc=spec.doc) for key, spec in specs.items() if spec.doc}


def unit_of_column(column_name: str) -> str:
    """Return the unit that the last word of a column's name stands for, or "".

    `closest_distance_m` is in m; the name `speed_rmse` gives no unit.
    """
    return UNIT_BY_NAME_SUFFIX.get(column_name.rpartition("_")[2], "") if "_" in column_name else ""


def check_table_file_name(target: str | Path) -> None:
    """Refuse a name that no table file has, before any work is done.

    Raises:
        UsageError: The suffix is neither `.parquet` nor `.csv`.
    """
    if Path(target).suffix.lower() not in TABLE_FILE_SUFFIXES:
        raise UsageError(
            "a table is written as Parquet or CSV, by the suffix of its name",
            where=str(target),
            hint="end the name in .parquet or .csv",
        )


def write_table(
    table: Table,
    target: str | Path,
    *,
    force: bool = False,
    durable: bool = True,
    together: AtomicGroup | None = None,
) -> None:
    """Write a table; the file appears whole or not at all.

    In CSV an (n, k) column becomes k columns `name_0` and so on, NaN or an absent string is an empty cell, and a ragged
    column is written as its values with spaces between them.

    Args:
        target: File name ending in `.parquet` or `.csv`.
        durable, together: As in `cwcli.output.open_output`.

    Raises:
        UsageError: The suffix is neither `.parquet` nor `.csv`.
        OutputError: The file can't be written.
    """
    import pyarrow as pa

    check_table_file_name(target)
    opened = open_output(target, force=force, durable=durable, together=together)
    with opened as output, pa.PythonFile(ArrowFileInterface(output), "w") as sink:
        write_table_to_sink(table, sink, Path(target).suffix.lower())


class ArrowFileInterface:
    """An output with the file interface of Arrow, which writes one column of a row group at a time."""

    closed = False

    def __init__(self, output: OutputStream) -> None:
        self._output, self._start = output, output.position

    def write(self, data: Bytes) -> int:
        return self._output.write(data)

    def tell(self) -> int:
        return self._output.position - self._start

    def flush(self) -> None:
        """Do nothing: the output flushes itself."""

    def close(self) -> None:
        self.closed = True


def encode_table_to_bytes(table: Table, suffix: str) -> memoryview:
    """Return the content of the table's file, for `.parquet` or `.csv`."""
    import pyarrow as pa

    sink = pa.BufferOutputStream()
    write_table_to_sink(table, sink, suffix)
    return memoryview(sink.getvalue())


def write_table_to_sink(table: Table, sink: pa.NativeFile, suffix: str) -> None:
    """Write the content of the table's file, for `.parquet` or `.csv`."""
    if suffix == ".csv":
        from pyarrow import csv

        csv.write_csv(_flatten_columns_for_csv(table), sink)
    else:
        from pyarrow import parquet

        # zstd begins with a look at its tables for each column: for few rows that takes four times the writing itself
        compression = "snappy" if len(table) < MAX_ROWS_OF_SNAPPY_COMPRESSED_TABLE else "zstd"
        parquet.write_table(to_arrow_table(table), sink, compression=compression)


def to_arrow_table(table: Table) -> pa.Table:
    """Convert the table to Arrow, with `unit`, `frame` and `doc` in the metadata of each field.

    (n, k) arrays become fixed-size lists, `Ragged` lists, `Strings` dictionaries; an absent string is null, NaN stays.
    """
    import pyarrow as pa

    arrays = {name: _arrow_array(column) for name, column in table.columns.items()}
    fields = [_arrow_field(name, array.type, table.docs.get(name, EMPTY_COLUMN_DOC)) for name, array in arrays.items()]
    metadata = {key: escape_surrogates(text) for key, text in {"name": table.name, **table.metadata}.items()}
    return pa.Table.from_arrays(list(arrays.values()), schema=pa.schema(fields, metadata=metadata))


@lru_cache(maxsize=1024)
def _arrow_field(name: str, kind: pa.DataType, about: ColumnDoc) -> pa.Field:
    """Return the Arrow field of a column, with its description as metadata."""
    import pyarrow as pa

    meaning = {"unit": about.unit or unit_of_column(name), "frame": about.frame, "doc": about.doc}
    return pa.field(name, kind, metadata={key: text for key, text in meaning.items() if text})


def _arrow_array(column: TableColumn) -> pa.Array:
    import pyarrow as pa

    if isinstance(column, Strings):
        # Arrow leaves memory as it found it behind a dictionary with equal values, and writes that into the file
        distinct = column.merge_equal_values()
        codes = pa.array(distinct.codes, mask=distinct.codes < 0)
        return pa.DictionaryArray.from_arrays(codes, _text_array(distinct.values))
    if isinstance(column, Ragged):
        return pa.ListArray.from_arrays(pa.array(column.offsets, pa.int32()), pa.array(column.values))
    if not isinstance(column, np.ndarray):
        return _text_array(column)
    if column.ndim == 2:
        values = pa.array(np.ascontiguousarray(column).reshape(-1))
        return pa.FixedSizeListArray.from_arrays(values, column.shape[1])
    return pa.array(column)


def _text_array(texts: Sequence[str | None]) -> pa.Array:
    """Return texts as an Arrow array; what UTF-8 can't encode is escaped."""
    import pyarrow as pa

    return pa.array([None if text is None else escape_surrogates(text) for text in texts], pa.string())


def _flatten_columns_for_csv(table: Table) -> pa.Table:
    """Return the table with one plain column for each CSV column."""
    import pyarrow as pa

    flat: dict[str, pa.Array] = {}
    for name, column in table.columns.items():
        if isinstance(column, Strings):
            flat[name] = _text_array([None if code < 0 else column.values[code] for code in column.codes])
        elif isinstance(column, Ragged):
            rows = zip(column.offsets[:-1], column.offsets[1:], strict=True)
            flat[name] = pa.array([" ".join(map(str, column.values[start:stop].tolist())) for start, stop in rows])
        elif isinstance(column, np.ndarray) and column.ndim == 2:
            for k in range(column.shape[1]):
                flat[f"{name}_{k}"] = _csv_array(column[:, k])
        elif isinstance(column, np.ndarray):
            flat[name] = _csv_array(column)
        else:
            flat[name] = _text_array(column)
    return pa.table(flat)


def _csv_array(values: NumericArray) -> pa.Array:
    """Return numbers as an Arrow array with null, an empty cell in CSV, for NaN."""
    import pyarrow as pa

    return pa.array(values, from_pandas=True)


def table_of_metric_rows(name: str, rows: Sequence[MetricRow]) -> Table:
    """Build a table with a row for each metric."""
    columns = dict(zip(METRIC_COLUMNS, zip(*rows, strict=True), strict=True))
    return Table(
        name,
        {
            key: np.array(column, np.float64) if key == "value" else [str(cell) for cell in column]
            for key, column in columns.items()
        },
    )


def append_metric_rows(table: Table, rows: Sequence[MetricRow]) -> Table:
    """Return a table of metrics with further rows."""
    return table_of_metric_rows(table.name, [*(tuple(row.values()) for row in table.rows_as_dicts()), *rows])
