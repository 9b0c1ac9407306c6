"""CSV and TSV of any program: GNSS loggers, CAN tools, vehicle data; and cwcli's own tables."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.delimited import read_delimited
from cwcli.importing.readers.own_table import with_own_presets
from cwcli.importing.tables import Answers, SourceTable


def _accepts(head: FileHead) -> bool:
    return head.text is not None


def _read(path: str, answers: Answers) -> Sequence[SourceTable]:
    return [with_own_presets(read_delimited(path, answers))]


KIND = ImportKind("CSV and TSV of any program, with a line of names", (".csv", ".tsv", ".txt"), _accepts, _read)
"""The description of this kind."""
