"""CSV and TSV of any program: GNSS loggers, CAN tools, vehicle data; and cwcli's own tables."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.delimited import read_delimited_table
from cwcli.importing.readers.own_table import with_presets_if_cwcli_table
from cwcli.importing.readers.phone import is_phone_recording_table, stem_of_table, with_phone_units_and_time_base
from cwcli.importing.tables import Answers, SourceTable


def _accepts_csv_file(head: FileHead) -> bool:
    return head.text is not None


def _read_csv_as_table(path: str, answers: Answers) -> Sequence[SourceTable]:
    table = with_presets_if_cwcli_table(read_delimited_table(path, answers))
    if is_phone_recording_table(table):
        return [with_phone_units_and_time_base(table, stem_of_table(path), b"")]
    return [table]


KIND = ImportKind(
    "CSV and TSV of any program, with a line of names",
    (".csv", ".tsv", ".txt"),
    _accepts_csv_file,
    _read_csv_as_table,
)
"""The description of this kind."""
