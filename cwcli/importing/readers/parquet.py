"""Parquet tables, read a group of rows at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from cwcli.errors import InputError
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.own_table import with_presets_if_cwcli_table
from cwcli.importing.tables import Answers, Batch, Question, SourceTable, ambiguity_error_of_questions

MAGIC = b"PAR1"
"""First and last bytes of a Parquet file."""
ROWS_AT_ONCE = 65_536
"""Number of rows of a batch. Chosen by hand: a batch takes a few megabytes."""


def _accepts_parquet_file(head: FileHead) -> bool:
    return head.data.startswith(MAGIC)


def _read_parquet_tables(path: str, answers: Answers) -> Sequence[SourceTable]:
    import pyarrow as pa
    from pyarrow import parquet

    try:
        file = parquet.ParquetFile(path)
        schema = file.schema_arrow
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"the Parquet file is damaged: {str(error).splitlines()[0]}", where=path) from error
    if not file.metadata.num_rows:
        raise InputError("it has no rows", where=path)
    names = [name for name in schema.names if not pa.types.is_nested(schema.field(name).type)]
    units = {field.name: (field.metadata or {}).get(b"unit", b"").decode("utf-8", "replace") for field in schema}
    for name in names:
        kind = schema.field(name).type
        if pa.types.is_timestamp(kind) and kind.tz is None and not answers.timezone:
            raise ambiguity_error_of_questions(
                [Question(path, f"{name!r} has times without a zone", "--timezone UTC, Europe/Berlin or +02:00")]
            )

    def read(columns: Sequence[str]) -> Iterator[Batch]:
        try:
            for batch in file.iter_batches(ROWS_AT_ONCE, columns=list(columns)):
                yield {name: _arrow_column_as_plain_values(batch.column(name)) for name in columns}
        except (pa.ArrowException, OSError) as error:
            raise InputError(f"the Parquet file is damaged: {str(error).splitlines()[0]}", where=path) from error

    table = SourceTable(path, "", "parquet", tuple(names), read, units={k: v for k, v in units.items() if v})
    return [with_presets_if_cwcli_table(table)]


def _arrow_column_as_plain_values(array: Any) -> Any:
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
