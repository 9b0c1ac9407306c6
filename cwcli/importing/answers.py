"""Checks of what the user decided about columns: every answer must say something about one of the tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.importing.names import COLUMN_WORDS_BY_QUANTITY
from cwcli.importing.readers.base import Recording
from cwcli.importing.tables import Answers, SourceTable
from cwcli.importing.units import FACTOR_BY_KIND_AND_UNIT, find_unit
from cwcli.importing.utm import parse_utm_zone_or_none

ANGLE_SENSES = ("cw-north", "ccw-east")
"""Senses of an angle."""
TIME_ORIGINS = ("1970", "2001", "gps", "week", "start")
"""The instants from which numbers of time may count."""


def check_answers(answers: Answers, tables: Sequence[SourceTable | Recording]) -> Answers:
    """Return the answers with their units spelled as in `FACTOR_BY_KIND_AND_UNIT`.

    Raises:
        UsageError: An answer has a unit that its quantity can't have, or names a table or a column that there is not.
    """
    names = {name for table in tables for name in _accepted_names_of_table(table)}
    columns = [column for table in tables if isinstance(table, SourceTable) for column in table.columns]
    checked = {}
    for (table, quantity), (column, unit) in answers.columns.items():
        if table and table not in names:
            shown = [each.name for each in tables]
            raise UsageError(
                f"{quantity} of {table}: there is no such table",
                found=tuple(shown[:20]),
                hint=hint_at_closest_or_all_known_names(table, shown),
            )
        if not table and column and column not in columns:
            raise UsageError(
                f"--column {quantity}={column}: there is no column {column!r}",
                found=tuple(columns[:30]),
                hint=hint_at_closest_or_all_known_names(column, columns),
            )
        checked[table, quantity] = column, _spell_unit_as_known(quantity, column, unit)
    return replace(answers, columns=checked)


def _accepted_names_of_table(table: SourceTable | Recording) -> tuple[str, ...]:
    if not isinstance(table, SourceTable):
        return table.name, PurePath(table.name).name
    return table.name, PurePath(table.file).name, *([table.part] if table.part else [])


def _spell_unit_as_known(quantity: str, column: str, text: str) -> str:
    """Return a unit as `FACTOR_BY_KIND_AND_UNIT` spells it, with its sense or base behind it; "" for none.

    Raises:
        UsageError: There is no such unit.
    """
    if not text:
        return ""
    kind = COLUMN_WORDS_BY_QUANTITY[quantity].kind
    if quantity in {"x", "y"} and parse_utm_zone_or_none(text):
        return text.lower()
    units = FACTOR_BY_KIND_AND_UNIT.get(kind, {})
    if unit := text if text in units else find_unit(text, kind) if kind in FACTOR_BY_KIND_AND_UNIT else "":
        return unit
    ends = ANGLE_SENSES if quantity in {"course", "heading"} else TIME_ORIGINS if kind == "time" else ()
    head, dash, end = text.partition("-")
    unit = head if head in units else find_unit(head, kind) if kind in FACTOR_BY_KIND_AND_UNIT else ""
    if dash and unit and end in ends:
        return f"{unit}-{end}"
    known = [f"{unit}-{end}" for unit in units for end in ends] if quantity in {"course", "heading"} else list(units)
    raise UsageError(
        f"{quantity}={column}*{text}: there is no such unit of this quantity",
        hint=f"one of {', '.join(known)}" if known else "it has no unit",
    )
