"""Parquet tables, read a group of rows at a time."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from cwcli.errors import InputError
from cwcli.importing.cells import ArrowArray
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.csv_table import with_presets_if_cwcli_table
from cwcli.importing.tables import Answers, ColumnsOfRows, SourceTable

PARQUET_MAGIC_BYTES = b"PAR1"
"""First and last bytes of a Parquet file."""
MAX_FOOTER_BYTES = 16_000_000
"""Greatest size of the description at the end of a file; it takes ten times as much memory. Chosen by hand: a thousand
columns in a thousand groups of rows take 100 MB, and those of vehicles a hundredth of it."""
ROWS_PER_BATCH = 65_536
"""Number of rows of a batch. Chosen by hand: a batch takes a few megabytes."""


def _accepts_parquet_file(head: FileHead) -> bool:
    return head.data.startswith(PARQUET_MAGIC_BYTES)


def _read_parquet_tables(path: str, answers: Answers) -> Sequence[SourceTable]:
    import pyarrow as pa
    from pyarrow import parquet

    _require_bounded_footer(path)
    try:
        file = parquet.ParquetFile(path)
        schema = file.schema_arrow
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"the Parquet file is damaged: {str(error).splitlines()[0]}", where=path) from error
    if not file.metadata.num_rows:
        raise InputError("it has no rows", where=path)
    fields = dict(_leaf_fields("", schema))
    names = list(fields)
    units = {
        name: (field.metadata or {}).get(b"unit", b"").decode("utf-8", "replace") for name, field in fields.items()
    }

    def read_column_batches(columns: Sequence[str]) -> Iterator[ColumnsOfRows]:
        try:
            for batch in file.iter_batches(ROWS_PER_BATCH, columns=list(columns)):
                yield {name: _arrow_column_as_plain_values(_leaf_column(batch, name)) for name in columns}
        except (pa.ArrowException, OSError) as error:
            raise InputError(f"the Parquet file is damaged: {str(error).splitlines()[0]}", where=path) from error

    table = SourceTable(
        path, "", "parquet", tuple(names), read_column_batches, units={k: v for k, v in units.items() if v}
    )
    return [with_presets_if_cwcli_table(table)]


def _require_bounded_footer(path: str) -> None:
    """Check the size of the file's description, which stands before its last eight bytes.

    Raises:
        InputError: It is too large, or the file can't be read.
    """
    try:
        with Path(path).open("rb") as file:
            file.seek(-8, os.SEEK_END)
            n_bytes = int.from_bytes(file.read(4), "little")
    except OSError as error:
        raise InputError(f"it can't be read: {error.strerror}", where=path) from error
    if n_bytes > MAX_FOOTER_BYTES:
        what = f"the Parquet file is damaged: its description has {n_bytes:,} bytes"
        raise InputError(what, where=path, hint=f"descriptions of at most {MAX_FOOTER_BYTES:,} bytes are read")


def _leaf_fields(prefix: str, fields: Any) -> Iterator[tuple[str, Any]]:
    """Yield the fields that hold plain values, those of structs by their path (`position.latitude`)."""
    import pyarrow as pa

    for field in fields:
        if pa.types.is_struct(field.type):
            yield from _leaf_fields(f"{prefix}{field.name}.", field.type)
        elif not pa.types.is_nested(field.type):
            yield f"{prefix}{field.name}", field


def _leaf_column(batch: Any, name: str) -> ArrowArray:
    import pyarrow.compute as pc

    if name in batch.schema.names:
        return batch.column(name)
    first, *rest = name.split(".")
    return pc.struct_field(batch.column(first), rest)


def _arrow_column_as_plain_values(array: ArrowArray) -> ArrowArray:
    """Return times as texts of UTC or of local time, dictionaries as texts, other cells as they are."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_dictionary(array.type):
        array = array.dictionary_decode()
    if pa.types.is_timestamp(array.type):
        nanos = array.cast(pa.timestamp("ns", tz=array.type.tz))
        text = pc.strftime(nanos.cast(pa.timestamp("ns")), format="%Y-%m-%d %H:%M:%S")
        return text if array.type.tz is None else pc.binary_join_element_wise(text, "Z", "")
    return array


KIND = ImportKind("Parquet tables", (".parquet", ".pq"), _accepts_parquet_file, _read_parquet_tables)
"""The description of this kind."""
