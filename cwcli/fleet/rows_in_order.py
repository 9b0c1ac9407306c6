"""Reads the rows of logs from tables that are merged, log by log, of any number of folders."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cwcli.errors import InputError
from cwcli.fleet.table_schemas import LOG_COLUMN

if TYPE_CHECKING:
    import pyarrow as pa

ROWS_PER_READ, BYTES_PER_READ_OF_EACH_COLUMN = 1_024, 16_384
"""Rows read at a time of each table of each shard, and bytes of each column. Chosen by hand. The pages of a column, of
which an open table holds one, are up to a row group each."""
MAX_OPEN_FOOTER_BYTES = 8_000_000
"""Bytes of the footers, which list the row groups, of the tables that are open at a time: at least one table is. In
memory they take twelve times as much (measured with pyarrow 26)."""
MAX_OPEN_READ_TABLES = 800
"""Number of tables that are open to be read at a time; chosen: below the 1,024 files that most systems allow."""


class RowsPiece(NamedTuple):
    """Rows of one log: `n` rows from row `first` of a table, whose other rows may be those of other logs."""

    id: str
    table: pa.Table
    first: int
    n: int


class OpenTables:
    """The tables that are open: where the next is too much for the bounds, the one that was read last is closed.

    The logs of shards alternate, so that their tables are read in turns: the one that was read last is needed last.
    """

    def __init__(self) -> None:
        self._readers: dict[RowsInOrder, None] = {}  # the one that was read last is the last one
        self._n_bytes = 0

    def add(self, reader: RowsInOrder) -> None:
        """Make room for a table that is read now."""
        self.discard(reader)
        while self._readers and (
            self._n_bytes + reader.n_footer_bytes > MAX_OPEN_FOOTER_BYTES or len(self._readers) >= MAX_OPEN_READ_TABLES
        ):
            last = next(reversed(self._readers))
            last.close()
            self.discard(last)
        self._readers[reader] = None
        self._n_bytes += reader.n_footer_bytes

    def discard(self, reader: RowsInOrder) -> None:
        """Forget a table if it is there."""
        if reader in self._readers:
            del self._readers[reader]
            self._n_bytes -= reader.n_footer_bytes


class RowsInOrder:
    """Reads one table from its begin to its end, log by log; it is opened where it has rows to give."""

    def __init__(self, path: Path, n_footer_bytes: int) -> None:
        self.n_footer_bytes = n_footer_bytes
        self._path = path
        self._pieces: Generator[RowsPiece] | None = None
        self._next: RowsPiece | None = None
        self._next_id: str | None = ""  # None after the last row; what is closed in between keeps it
        self._n_rows_before_next = 0
        self._file_at_first: tuple[int, int, int] | None = None

    def iter_rows_of_log(self, id: str, opened: OpenTables) -> Iterator[RowsPiece]:
        """Yield the rows of a log in pieces. Each id must be greater than the one before."""
        if self._next_id is None or self._next_id > id:
            return
        opened.add(self)
        if self._pieces is None:
            self._check_unchanged()
            self._pieces = _iter_pieces_by_log(self._path, self._n_rows_before_next)
            self._read_next()
        while self._next is not None and self._next.id <= id:
            if self._next.id == id:
                yield self._next
            self._n_rows_before_next += self._next.n
            self._read_next()
        if self._next is None:
            opened.discard(self)

    def close(self) -> None:
        """Close the file; the next rows are read from where it stood."""
        if self._pieces is not None:
            self._pieces.close()
        self._pieces = self._next = None

    def _check_unchanged(self) -> None:
        """Check that a table that is opened again is the one that was opened first."""
        try:
            found = self._path.stat()
        except OSError as error:
            raise InputError(f"the table can't be read: {error.strerror}", where=str(self._path)) from error
        now = found.st_ino, found.st_size, found.st_mtime_ns
        if self._file_at_first not in (None, now):
            raise InputError("the table changed while it was merged", where=str(self._path), hint="merge again")
        self._file_at_first = now

    def _read_next(self) -> None:
        assert self._pieces is not None
        self._next = next(self._pieces, None)
        self._next_id = None if self._next is None else self._next.id


def _iter_pieces_by_log(path: Path, n_rows_before: int) -> Generator[RowsPiece]:
    """Yield the rows of each log of a table from some row on; those of one log may come in several pieces."""
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import parquet

    try:
        with parquet.ParquetFile(path, buffer_size=BYTES_PER_READ_OF_EACH_COLUMN) as file:
            ends = np.cumsum([file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)], dtype=np.int64)
            first_group = int(np.searchsorted(ends, n_rows_before, side="right"))
            n_skipped = n_rows_before - (int(ends[first_group - 1]) if first_group else 0)
            groups = list(range(first_group, len(ends)))
            for batch in file.iter_batches(ROWS_PER_READ, row_groups=groups, use_threads=False):
                table = pa.Table.from_batches([batch])
                runs = pc.run_end_encode(batch.column(LOG_COLUMN))
                first = min(n_skipped, len(table))
                n_skipped -= first
                ids = runs.values.to_pylist()
                if not all(isinstance(each, str) for each in ids):
                    raise InputError(
                        f"the table can't be read: an entry of its column {LOG_COLUMN} is no text", where=str(path)
                    )
                for id, end in zip(ids, runs.run_ends.to_pylist(), strict=True):
                    if end > first:
                        yield RowsPiece(id, table, first, end - first)
                        first = end
    except (OSError, ValueError, KeyError, pa.ArrowException) as error:
        raise InputError(f"the table can't be read: {error}", where=str(path)) from error
