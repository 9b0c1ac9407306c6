"""CSV and TSV of any program: GNSS loggers, CAN tools, vehicle data; and cwcli's own tables."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.delimited import read_delimited
from cwcli.importing.readers.own_table import with_own_presets
from cwcli.importing.readers.phone import is_of_phone, stem_of_table, with_phone_meaning
from cwcli.importing.tables import Answers, SourceTable


def _accepts(head: FileHead) -> bool:
    return head.text is not None


def _read(path: str, answers: Answers) -> Sequence[SourceTable]:
    table = with_own_presets(read_delimited(path, answers))
    if is_of_phone(table):
        return [with_phone_meaning(table, stem_of_table(path), b"")]
    return [table]


KIND = ImportKind("CSV and TSV of any program, with a line of names", (".csv", ".tsv", ".txt"), _accepts, _read)
"""The description of this kind."""
