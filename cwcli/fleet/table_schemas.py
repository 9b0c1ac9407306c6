"""The schemas of a run's tables: one for all logs, whatever their order and however they were spread over shards."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyarrow as pa

TABLES_SCHEMA_VERSION = 1
"""Version of the tables of a run, in the column `schema_version`: it grows with each change of a column, of which
tests/cli/table_schemas.json holds the state."""
LOG_COLUMN, RUN_ID_COLUMN, SCHEMA_VERSION_COLUMN = "log", "run_id", "schema_version"
"""Columns that every table of a run has: id of the log, id of the run, and `TABLES_SCHEMA_VERSION`."""
COMMON_COLUMNS = frozenset({LOG_COLUMN, RUN_ID_COLUMN, SCHEMA_VERSION_COLUMN})
"""Names of the columns that no log's own table has."""


def unify_schemas(schemas: Sequence[pa.Schema]) -> pa.Schema:
    """Return the schema that holds the rows of tables with any of the schemas.

    Different schemas give columns in order of name, so that the order of the logs does not matter. Numbers become the
    wider type; where types have nothing in common, the column becomes text.
    """
    import pyarrow as pa

    distinct: list[pa.Schema] = []
    for schema in schemas:
        canonical = pa.schema([each.with_type(_canonical_type(each.type)) for each in schema], metadata=schema.metadata)
        if not any(canonical.equals(known, check_metadata=True) for known in distinct):
            distinct.append(canonical)
    if len(distinct) == 1:
        return distinct[0]
    names = sorted({name for schema in distinct for name in schema.names})
    fields = []
    for name in names:
        own = [each.field(name) for each in distinct if name in each.names]
        unified = _unify_fields_or_fall_back_to_text(own)
        if len(own) < len(distinct) and pa.types.is_fixed_size_list(unified.type):
            # Arrow before 26 does not read its own Parquet files where a list of fixed size is null.
            unified = unified.with_type(pa.list_(unified.type.value_field))
        fields.append(unified)
    return pa.schema(fields, metadata=_items_equal_in_all([each.metadata or {} for each in distinct]))


def _unify_fields_or_fall_back_to_text(fields: Sequence[pa.Field]) -> pa.Field:
    """Return the field that holds the values of all fields, which have one name."""
    import pyarrow as pa

    plain = [pa.schema([each.remove_metadata()]) for each in fields]
    try:
        unified = pa.unify_schemas(plain, promote_options="permissive").field(0)
    except (pa.ArrowInvalid, pa.ArrowTypeError):
        unified = pa.field(fields[0].name, pa.string())
    unified = unified.with_type(_canonical_type(unified.type))
    return unified.with_metadata(_items_equal_in_all([each.metadata or {} for each in fields]))


def _canonical_type(kind: pa.DataType) -> pa.DataType:
    """Return a type whose lists call their values as Parquet does; Arrow has other names, which the file would show."""
    import pyarrow as pa

    if not (pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind)):
        return kind
    value = pa.field("element", _canonical_type(kind.value_type))
    return pa.list_(value, kind.list_size) if pa.types.is_fixed_size_list(kind) else pa.list_(value)


def _items_equal_in_all(mappings: Sequence[dict[bytes, bytes]]) -> dict[bytes, bytes]:
    """Return what all mappings hold alike."""
    first, *others = mappings
    return {key: value for key, value in sorted(first.items()) if all(each.get(key) == value for each in others)}


def columns_in_types_of_schema(table: pa.Table, schema: pa.Schema) -> list[pa.ChunkedArray]:
    """Return a table's columns in the types of a schema; a column that it lacks is null."""
    import pyarrow as pa

    columns = []
    for field in schema:
        if field.name not in table.column_names:
            columns.append(pa.chunked_array([pa.nulls(len(table), field.type)]))
            continue
        column = table.column(field.name)
        if column.type != field.type:
            is_fixed = pa.types.is_fixed_size_list(column.type)
            column = _column_as_json_text(column) if pa.types.is_string(field.type) else column.cast(field.type)
            if is_fixed and column.null_count and pa.types.is_list(field.type):
                # a null keeps its values, which Arrow 16 does not write
                column = column.take(pa.array(range(len(column))))
        columns.append(column)
    return columns


def _column_as_json_text(column: Iterable[pa.Scalar]) -> pa.ChunkedArray:
    """Return values as JSON, for a column that holds text in other logs."""
    import pyarrow as pa

    values = [each.as_py() for each in column]
    return pa.chunked_array([[None if each is None else json.dumps(each, default=str) for each in values]], pa.string())


def has_nested_column(schema: pa.Schema) -> bool:
    """Whether a column holds several values a row."""
    import pyarrow as pa

    return any(pa.types.is_nested(field.type) for field in schema)
