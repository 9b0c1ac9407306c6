"""The tables of a run: one Parquet file of each kind, with the rows of all logs in order of their ids.

metrics.parquet               headline metrics
details/<table>.parquet       each table of each stage
tables/<channel>.parquet      the channels' columns (`--tables`)
views.sql                     all of them as views for DuckDB

Equal results of the logs give equal bytes, whoever computed them, so that merged shards equal one run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from cwcli.errors import InputError, OutputError
from cwcli.fleet.rows_in_order import MAX_OPEN_FOOTER_BYTES, OpenTables, RowsInOrder, RowsPiece
from cwcli.fleet.staged_tables import (
    StagedTable,
    decode_dictionaries,
    iter_staged_tables,
    list_staged_tables,
)
from cwcli.fleet.table_schemas import (
    COMMON_COLUMNS,
    LOG_COLUMN,
    RUN_ID_COLUMN,
    SCHEMA_VERSION_COLUMN,
    TABLES_SCHEMA_VERSION,
    columns_in_types_of_schema,
    has_nested_column,
    unify_schemas,
)
from cwcli.input import BYTES_PER_MEGABYTE, is_file
from cwcli.metrics.table import ArrowFileInterface
from cwcli.output import AtomicGroup, make_folder, open_output

if TYPE_CHECKING:
    import pyarrow as pa

METRICS_TABLE, DETAILS_FOLDER, TABLES_FOLDER = "metrics", "details", "tables"
"""The table of headline metrics, and the folders of the other tables."""
TABLE_FILE_SUFFIX = ".parquet"
"""Ending of a table's file."""
SQL_VIEWS_FILE_NAME = "views.sql"
"""Name of the file with the views."""
PARQUET_MAGIC = b"PAR1"
"""First and last bytes of a Parquet file. Source: the Parquet format."""
ROWS_PER_ROW_GROUP, ROWS_PER_ROW_GROUP_WITH_LISTS = 65_536, 4_096
"""Rows of a row group, and of one with lists, which are larger. Chosen by hand: a few MB are held for each table."""
PIECES_PER_JOINED_BLOCK = 256
"""Number of pieces of rows that are joined to one block: each piece takes some kB of memory, however few its rows.
Chosen by hand."""
MAX_OPEN_TABLE_FILES = 400
"""Number of files that are open at a time; chosen: below the 1,024 that most systems allow."""
MIN_FOOTER_BYTES_OF_TABLE, MAX_FOOTER_SHARE_OF_TABLE = 2_000_000, 1 / 8
"""The size of footer that every table may have, and the share of its file. Chosen by hand: of the tables that cwcli
writes a footer is a hundredth at most, a tenth where nearly all values are equal."""


RowsOfLog = Callable[[str], Iterator[tuple[str, RowsPiece]]]
"""The type of a function from a log's id to pieces of its tables by name."""


class RowSource(Protocol):
    """Where the rows of some logs are."""

    def iter_table_names_and_schemas(self, ids: Sequence[str]) -> Iterable[tuple[str, pa.Schema]]:
        """Yield name and schema of the tables of the logs; equal ones need not be repeated."""

    def open_tables_of_logs(self, names: frozenset[str], opened: OpenTables) -> RowsOfLog:
        """Return a function that yields the tables of a log that have these names; ids come in ascending order."""

    def count_footer_bytes(self, name: str) -> int:
        """Count the bytes of the footer that is held while a table is read."""


class StagedRows:
    """The rows of logs that a worker has done."""

    def __init__(self, staged_path_of_log: Callable[[str], Path]) -> None:
        self.staged_path_of_log = staged_path_of_log
        self._index: dict[str, list[StagedTable]] = {}

    def iter_table_names_and_schemas(self, ids: Sequence[str]) -> Iterator[tuple[str, pa.Schema]]:
        """Yield name and schema of each table once for each different schema."""
        known = set()
        for id in ids:
            self._index[id] = list_staged_tables(self.staged_path_of_log(id))
            unknown = [each for each in self._index[id] if each[:2] not in known]
            known |= {each[:2] for each in unknown}
            for name, table in iter_staged_tables(self.staged_path_of_log(id), unknown):
                yield name, table.schema

    def open_tables_of_logs(self, names: frozenset[str], opened: OpenTables) -> RowsOfLog:
        """Return a function that yields the tables of a log."""

        def tables_of_log(id: str) -> Iterator[tuple[str, RowsPiece]]:
            own = [each for each in self._index[id] if each.name in names]
            for name, table in iter_staged_tables(self.staged_path_of_log(id), own):
                yield name, RowsPiece(id, table, 0, len(table))

        return tables_of_log

    def count_footer_bytes(self, name: str) -> int:
        """Return 0: there are no footers."""
        return 0


class MergedRows:
    """The rows of logs in the tables of an output folder."""

    def __init__(self, out: Path) -> None:
        self._out = out

    def iter_table_names_and_schemas(self, ids: Sequence[str]) -> Iterator[tuple[str, pa.Schema]]:
        """Yield name and schema of each table, without the columns that all tables have."""
        import pyarrow as pa
        from pyarrow import parquet

        for name in iter_table_names(self._out) if ids else ():
            path = self._out / f"{name}{TABLE_FILE_SUFFIX}"
            _require_footer_in_bounds(self.count_footer_bytes(name), path)
            try:
                schema = parquet.read_schema(path)
            except (OSError, ValueError, pa.ArrowException) as error:
                raise InputError(f"the table can't be read: {error}", where=str(path)) from error
            metadata = {
                key: value
                for key, value in (schema.metadata or {}).items()
                if key.decode() not in (RUN_ID_COLUMN, SCHEMA_VERSION_COLUMN)
            }
            own = [field for field in schema if field.name not in COMMON_COLUMNS]
            yield name, pa.schema(own, metadata=metadata)

    def open_tables_of_logs(self, names: frozenset[str], opened: OpenTables) -> RowsOfLog:
        """Return a function that yields the rows of a log from all tables."""
        readers = {
            name: RowsInOrder(self._out / f"{name}{TABLE_FILE_SUFFIX}", self.count_footer_bytes(name))
            for name in iter_table_names(self._out)
            if name in names
        }

        def rows_of_log(id: str) -> Iterator[tuple[str, RowsPiece]]:
            for name, reader in readers.items():
                for piece in reader.iter_rows_of_log(id, opened):
                    yield name, piece

        return rows_of_log

    def count_footer_bytes(self, name: str) -> int:
        """Count the bytes of the footer of a table, 0 if there is no such file or its end is cut off."""
        path = self._out / f"{name}{TABLE_FILE_SUFFIX}"
        if not is_file(path):
            return 0
        try:
            with path.open("rb") as file:
                file.seek(max(path.stat().st_size - len(PARQUET_MAGIC) - 4, 0))
                tail = file.read()
        except OSError as error:
            raise InputError(f"the table can't be read: {error.strerror}", where=str(path)) from error
        return int.from_bytes(tail[:4], "little") if tail[4:] == PARQUET_MAGIC else 0


def _require_footer_in_bounds(n_bytes: int, path: Path) -> None:
    """Check that few rows are not in so many row groups that their list alone fills the memory.

    Raises:
        InputError: They are.
    """
    n_most = MIN_FOOTER_BYTES_OF_TABLE + MAX_FOOTER_SHARE_OF_TABLE * path.stat().st_size
    if n_bytes > n_most:
        found, most = (f"{each / BYTES_PER_MEGABYTE:,.1f} MB" for each in (n_bytes, n_most))
        what = f"the list of its row groups takes {found}, more than {most}"
        hint = "run the logs of this folder again, with another one for -d: cwcli writes row groups of many rows"
        raise InputError(what, where=str(path), hint=hint)


def write_tables(out: Path, source_of_log: Mapping[str, RowSource], run_id: str) -> list[str]:
    """Write the tables of a run and the file of views, and remove tables that the run does not have.

    Each file is replaced whole. A run that is killed in between leaves the rows of every log in all of the files that
    held them or in its staged file, so writing them again gives the same.

    Args:
        source_of_log: Id of each log that is done -> where its rows are.
        run_id: What equal pipelines of one version have in common.

    Returns:
        The names of the tables, sorted.

    Raises:
        InputError: A source is damaged.
        OutputError: A table can't be written.
    """
    ids = sorted(source_of_log)
    sources = list({id(each): each for each in source_of_log.values()}.values())
    schemas: dict[str, list[pa.Schema]] = {}
    for source in sources:
        own_ids = [each for each in ids if source_of_log[each] is source]
        for name, schema in source.iter_table_names_and_schemas(own_ids):
            schemas.setdefault(name, []).append(schema)
    names = sorted(schemas)
    for some in _iter_names_for_each_pass(names, sources):
        with AtomicGroup() as together, ExitStack() as stack:
            writers = {
                name: _TableWriter(out, name, unify_schemas(schemas[name]), run_id, stack, together)
                for name in sorted(some)
            }
            opened = OpenTables()
            rows_of_log = {id(source): source.open_tables_of_logs(some, opened) for source in sources}
            for each in ids:
                for name, piece in rows_of_log[id(source_of_log[each])](each):
                    writers[name].append_piece(piece)
            for writer in writers.values():
                writer.close()
    for name in iter_table_names(out):
        if name not in schemas:
            _remove_table(out, name)
    with open_output(out / SQL_VIEWS_FILE_NAME, force=True, durable=False) as output:
        output.write(duckdb_views_sql(names).encode())
    return names


def _iter_names_for_each_pass(names: Sequence[str], sources: Sequence[RowSource]) -> Iterator[frozenset[str]]:
    """Yield the names of tables whose files and footers can be open together."""
    n_most = max(MAX_OPEN_TABLE_FILES // (len(sources) + 1), 1)
    some: set[str] = set()
    n_held = 0
    for name in names:
        n_bytes = sum(each.count_footer_bytes(name) for each in sources)
        if some and (len(some) == n_most or n_held + n_bytes > MAX_OPEN_FOOTER_BYTES):
            yield frozenset(some)
            some, n_held = set(), 0
        some.add(name)
        n_held += n_bytes
    if some:
        yield frozenset(some)


class _TableWriter:
    """Writes one table in row groups of a fixed number of rows."""

    def __init__(
        self, out: Path, name: str, schema: pa.Schema, run_id: str, stack: ExitStack, together: AtomicGroup
    ) -> None:
        import pyarrow as pa
        from pyarrow import parquet

        path = out / f"{name}{TABLE_FILE_SUFFIX}"
        make_folder(path.parent, parents=True)
        self._own, self._run_id = schema, run_id
        self._n_rows = ROWS_PER_ROW_GROUP_WITH_LISTS if has_nested_column(schema) else ROWS_PER_ROW_GROUP
        common = {RUN_ID_COLUMN: run_id, SCHEMA_VERSION_COLUMN: str(TABLES_SCHEMA_VERSION)}
        self._schema = pa.schema(
            [
                pa.field(LOG_COLUMN, pa.string()),
                *schema,
                pa.field(RUN_ID_COLUMN, pa.string()),
                pa.field(SCHEMA_VERSION_COLUMN, pa.int32()),
            ],
            metadata={**(schema.metadata or {}), **common},
        )
        output = stack.enter_context(open_output(path, force=True, durable=False, together=together))
        sink = stack.enter_context(pa.PythonFile(ArrowFileInterface(output), "w"))
        self._writer = stack.enter_context(parquet.ParquetWriter(sink, self._schema, compression="zstd"))
        self._pending: list[pa.Table] = []  # blocks in order
        self._pieces: list[RowsPiece] = []  # after the blocks
        self._n_pending = 0

    def append_piece(self, piece: RowsPiece) -> None:
        """Add rows of one log."""
        self._pieces.append(piece)
        self._n_pending += piece.n
        if len(self._pieces) >= PIECES_PER_JOINED_BLOCK:
            self._join_pieces()
        if self._n_pending >= self._n_rows:
            self._write_pending(all_rows=False)

    def _join_pieces(self) -> None:
        """Make one block of the pieces; tables of one schema are converted together, as each call takes its time."""
        import pyarrow as pa

        tables_by_schema: list[list[pa.Table]] = []
        for table in {id(each.table): each.table for each in self._pieces}.values():
            same = next((known for known in tables_by_schema if known[0].schema.equals(table.schema)), None)
            if same is None:
                tables_by_schema.append([table])
            else:
                same.append(table)
        first_row: dict[int, int] = {}
        converted, n_rows = [], 0
        for tables in tables_by_schema:
            for table in tables:
                first_row[id(table)] = n_rows
                n_rows += len(table)
            columns = columns_in_types_of_schema(decode_dictionaries(pa.concat_tables(tables)), self._own)
            converted.append(pa.Table.from_arrays(columns, schema=self._own))
        rows = [np.arange(each.first, each.first + each.n) + first_row[id(each.table)] for each in self._pieces]
        block = pa.concat_tables(converted).combine_chunks()
        order = np.concatenate(rows).astype(np.int64)
        if not np.array_equal(order, np.arange(n_rows)):
            block = block.take(_array_of_numbers(order))
        n = len(order)
        version = _array_of_numbers(np.full(n, TABLES_SCHEMA_VERSION, np.int32))
        common = _repeat_texts([self._run_id], [n]), version
        ids = _repeat_texts([each.id for each in self._pieces], [each.n for each in self._pieces])
        self._pending.append(pa.Table.from_arrays([ids, *block.columns, *common], schema=self._schema))
        self._pieces = []

    def close(self) -> None:
        """Write the rest; a table without rows has its columns all the same."""
        self._write_pending(all_rows=True)

    def _write_pending(self, *, all_rows: bool) -> None:
        import pyarrow as pa

        # how rows are cut into arrays shows in the file: they are made one array first
        if not self._n_pending:
            return
        if self._pieces:
            self._join_pieces()
        rows = pa.concat_tables(self._pending).combine_chunks()
        self._pending = []
        n_whole = len(rows) if all_rows else len(rows) // self._n_rows * self._n_rows
        for start in range(0, n_whole, self._n_rows):
            group = rows.slice(start, min(self._n_rows, n_whole - start))
            self._writer.write_table(group, row_group_size=self._n_rows)
        # a slice would keep all rows in memory
        rest = rows.take(_array_of_numbers(np.arange(n_whole, len(rows), dtype=np.int64)))
        self._pending, self._n_pending = ([rest] if len(rest) else []), len(rest)
        del rows
        pa.default_memory_pool().release_unused()  # else it keeps some hundred MB for later


def _repeat_texts(texts: Sequence[str], counts: Sequence[int]) -> pa.StringArray:
    """Return each text so many times; Arrow's own functions import pandas where it is installed, which takes 50 MB."""
    import pyarrow as pa

    encoded = [text.encode() for text in texts]
    lengths = np.repeat(np.array([len(each) for each in encoded], np.int32), counts)
    ends = np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)]).astype(np.int32)
    data = b"".join(each * n for each, n in zip(encoded, counts, strict=True))
    return pa.StringArray.from_buffers(len(lengths), pa.py_buffer(ends), pa.py_buffer(data))


def _array_of_numbers(values: npt.NDArray[np.int32] | npt.NDArray[np.int64]) -> pa.Array:
    """Return whole numbers as an array, without Arrow's own function as above."""
    import pyarrow as pa

    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [None, pa.py_buffer(values)])


def iter_table_names(out: Path) -> Iterator[str]:
    """Yield the names of the tables in an output folder, sorted; pipes and devices are none."""
    found = [path.relative_to(out) for pattern in ("*", f"{DETAILS_FOLDER}/*", f"{TABLES_FOLDER}/*")
             for path in out.glob(f"{pattern}{TABLE_FILE_SUFFIX}") if is_file(path)]  # fmt: skip
    yield from sorted(path.as_posix().removesuffix(TABLE_FILE_SUFFIX) for path in found)


def _remove_table(out: Path, name: str) -> None:
    path = out / f"{name}{TABLE_FILE_SUFFIX}"
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"it can't be removed: {error.strerror}", where=str(path)) from error
    with suppress(OSError):  # it is empty only after its last table
        if path.parent != out:
            path.parent.rmdir()


def remove_all_tables(out: Path) -> None:
    """Remove all tables of a run.

    Raises:
        OutputError: One can't be removed.
    """
    for name in [*iter_table_names(out)]:
        _remove_table(out, name)


def are_tables_whole(out: Path, names: object) -> bool:
    """Whether all tables that a manifest names are there with their beginning and their end."""
    if not isinstance(names, list):
        return False
    return all(isinstance(name, str) and _is_parquet_file_whole(out / f"{name}{TABLE_FILE_SUFFIX}") for name in names)


def _is_parquet_file_whole(path: Path) -> bool:
    if not is_file(path):
        return False
    try:
        with path.open("rb") as file:
            begin = file.read(len(PARQUET_MAGIC))
            file.seek(-len(PARQUET_MAGIC), 2)
            return begin == PARQUET_MAGIC == file.read()
    except (OSError, ValueError):
        return False


def duckdb_views_sql(names: Iterable[str]) -> str:
    """Return the views of DuckDB on the tables; their paths are relative to the output folder."""
    lines = ["-- in the output folder: duckdb -init views.sql"]
    lines += [f"create schema if not exists {folder};" for folder in (DETAILS_FOLDER, TABLES_FOLDER)]
    for name in names:
        folder, _, own = name.rpartition("/")
        view = ".".join(filter(None, (folder, '"{}"'.format(own.replace('"', '""')))))
        file = f"{name}{TABLE_FILE_SUFFIX}".replace("'", "''")
        lines.append(f"create or replace view {view} as select * from read_parquet('{file}');")
    return "\n".join(lines) + "\n"
