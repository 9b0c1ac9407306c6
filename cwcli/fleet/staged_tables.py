"""The tables of one log, in one file from when the log is done until the tables of the run are written.

The file holds Arrow streams one after the other, then an index in JSON, its length (8 bytes) and
`STAGED_TABLE_END_MAGIC`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from cwcli.errors import InputError
from cwcli.metrics.table import Table, to_arrow_table
from cwcli.output import open_output

if TYPE_CHECKING:
    import pyarrow as pa

STAGED_TABLE_END_MAGIC = b"CWTABLE1"
"""The last bytes of a file; chosen here."""
STREAM_ALIGNMENT_BYTES = 64
"""Each stream begins at a multiple of this many bytes, as Arrow recommends for its buffers."""


class StagedTable(NamedTuple):
    """One table in a file.

    Attributes:
        name: Its path in the output folder without `.parquet`, e.g. `details/events`.
        fingerprint: Hash of its schema.
        offset: Where its stream begins, in bytes.
    """

    name: str
    fingerprint: str
    offset: int


def write_staged_tables_file_of_log(tables: Iterable[tuple[str, Table]], path: Path) -> None:
    """Write the tables of one log, given by name; the file appears whole or not at all.

    Raises:
        OutputError: It can't be written.
    """
    import pyarrow as pa

    index: list[StagedTable] = []
    with open_output(path, force=True, durable=False) as output:
        offset = 0
        for name, table in tables:
            arrow = decode_dictionaries(to_arrow_table(table))
            sink = pa.BufferOutputStream()
            with pa.ipc.new_stream(sink, arrow.schema) as stream:
                stream.write_table(arrow)
            content = sink.getvalue()
            index.append(StagedTable(name, fingerprint_of_schema(arrow.schema), offset))
            output.write(memoryview(content))
            padding = bytes(-content.size % STREAM_ALIGNMENT_BYTES)
            output.write(padding)
            offset += content.size + len(padding)
        encoded = json.dumps(index).encode()
        output.write(encoded + len(encoded).to_bytes(8, "little") + STAGED_TABLE_END_MAGIC)


def decode_dictionaries(table: pa.Table) -> pa.Table:
    """Return the table with plain columns for dictionaries, whose values differ from log to log."""
    import pyarrow as pa

    for k, field in enumerate(table.schema):
        if pa.types.is_dictionary(field.type):
            plain = table.column(k).cast(field.type.value_type)
            table = table.set_column(k, field.with_type(plain.type), plain)
    return table


def fingerprint_of_schema(schema: pa.Schema) -> str:
    """Return a hash of names, types and metadata."""
    return hashlib.sha256(memoryview(schema.serialize())).hexdigest()[:16]


def list_staged_tables(path: Path) -> list[StagedTable]:
    """Read the index of a file.

    Raises:
        InputError: The file is damaged.
    """
    import pyarrow as pa

    try:
        with pa.memory_map(str(path)) as source:
            size = source.size()
            end = source.read_at(8 + len(STAGED_TABLE_END_MAGIC), max(size - 8 - len(STAGED_TABLE_END_MAGIC), 0))
            length = int.from_bytes(end[:8], "little")
            if end[8:] != STAGED_TABLE_END_MAGIC or length > size:
                raise ValueError("its end is missing")
            encoded = source.read_at(length, size - 8 - len(STAGED_TABLE_END_MAGIC) - length)
            return [StagedTable(str(name), str(kind), int(at)) for name, kind, at in json.loads(encoded)]
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"the tables of the log can't be read: {error}", where=str(path)) from error


def iter_staged_tables(path: Path, tables: Iterable[StagedTable]) -> Iterator[tuple[str, pa.Table]]:
    """Yield name and content of tables of a file, whose pages are mapped into memory and not copied.

    Raises:
        InputError: The file is damaged.
    """
    import pyarrow as pa

    try:
        source = pa.memory_map(str(path))
        for each in tables:
            source.seek(each.offset)
            yield each.name, pa.ipc.open_stream(source).read_all()
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"the tables of the log can't be read: {error}", where=str(path)) from error
