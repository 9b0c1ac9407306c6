"""The mapping file: every guess of an import as TOML, to be edited and given again.

[answers]
timezone = "Europe/Berlin"

[[table]]
name = "drive.csv"
latitude = "lat"                # certain: the name, and the range of the values
speed = "Speed*kmh"             # likely: 3.61 of it make 1 m/s between the positions
heading = ""                    # leaves a quantity out
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.importing.names import COLUMN_WORDS_BY_QUANTITY
from cwcli.importing.tables import Answers, Guess
from cwcli.input import read_file
from cwcli.toml_text import MAX_TOML_FILE_CHARS, parse_toml

MAPPING_FILE_FIRST_LINE = (
    "# How these files were read. Edit it and give it again: cwcli import FILES -o LOG --mapping THIS\n"
)
"""First line of a mapping file."""
ALLOWED_VALUES_BY_ANSWER = {"date_order": ("dmy", "mdy", "ymd"), "decimal": (".", ",")}
"""Answer -> all its values, where they are few."""
_TEXT_ANSWER_NAMES = tuple(field.name for field in fields(Answers) if field.name not in {"columns", "dbc"})


def parse_table_quantity_and_column_unit(text: str) -> tuple[tuple[str, str], tuple[str, str]]:
    """Return (table or "", quantity) and (column, unit) of `QUANTITY=COLUMN*UNIT` or `QUANTITY@TABLE=COLUMN*UNIT`.

    Raises:
        UsageError: There is no such quantity, or no equals sign.
    """
    name, equals, value = text.partition("=")
    quantity, _, table = name.partition("@")
    if not equals:
        raise UsageError(f"--column {text}: expected QUANTITY=COLUMN, or QUANTITY=COLUMN*UNIT")
    if quantity not in COLUMN_WORDS_BY_QUANTITY:
        raise UsageError(
            f"--column {text}: there is no quantity {quantity!r}",
            hint=hint_at_closest_or_all_known_names(quantity, COLUMN_WORDS_BY_QUANTITY),
        )
    return (table, quantity), split_at_unit_star(value)


def split_at_unit_star(column_star_unit: str) -> tuple[str, str]:
    """Return column and unit of `COLUMN*UNIT`."""
    column, star, unit = column_star_unit.rpartition("*")
    return (column, unit) if star and unit and " " not in unit else (column_star_unit, "")


def read_mapping(path: str) -> Answers:
    """Read a mapping file.

    Raises:
        UsageError: It can't be read, or holds something else.
    """
    try:
        document = parse_toml(read_file(path, MAX_TOML_FILE_CHARS + 1).decode())
    except (OSError, ValueError) as error:
        said = getattr(error, "strerror", None) or str(error)
        raise UsageError(f"the mapping can't be read: {said}", where=path) from error
    answers = document.pop("answers", {})
    tables = document.pop("table", [])
    if document or not isinstance(answers, dict) or not isinstance(tables, list):
        raise UsageError(
            f"a mapping has [answers] and [[table]]; found {', '.join(document) or 'something else'}", where=path
        )
    values: dict[str, Any] = {}
    for key, value in answers.items():
        if key == "dbc" and isinstance(value, list):
            values["dbc"] = tuple(str(each) for each in value)
        elif (
            key in _TEXT_ANSWER_NAMES
            and isinstance(value, str)
            and value not in ALLOWED_VALUES_BY_ANSWER.get(key, (value,))
        ):
            raise UsageError(
                f"answers.{key}: {value!r} is none of {', '.join(ALLOWED_VALUES_BY_ANSWER[key])}", where=path
            )
        elif key in _TEXT_ANSWER_NAMES and isinstance(value, str):
            values[key] = value
        else:
            raise UsageError(
                f"answers.{key}: there is no such answer",
                where=path,
                hint=hint_at_closest_or_all_known_names(key, (*_TEXT_ANSWER_NAMES, "dbc")),
            )
    columns: dict[tuple[str, str], tuple[str, str]] = {}
    for table in tables:
        columns.update(_parse_columns_to_column_and_unit(table, path))
    return Answers(columns, **values)


def _parse_columns_to_column_and_unit(table: Any, path: str) -> dict[tuple[str, str], tuple[str, str]]:
    if not isinstance(table, dict) or not isinstance(table.get("name"), str):
        raise UsageError("a [[table]] without a name", where=path)
    found = {}
    for key, value in table.items():
        if key == "name":
            continue
        if not isinstance(value, str):
            raise UsageError(f"{table['name']}: {key} is not of the form COLUMN or COLUMN*UNIT", where=path)
        if key not in COLUMN_WORDS_BY_QUANTITY:
            raise UsageError(
                f"{table['name']}: there is no quantity {key!r}",
                where=path,
                hint=hint_at_closest_or_all_known_names(key, COLUMN_WORDS_BY_QUANTITY),
            )
        found[table["name"], key] = split_at_unit_star(value)
    return found


def merge_answers(base: Answers, later: Answers) -> Answers:
    """Return answers of a mapping file with those of the options, which win."""
    answer_by_name = {field.name: getattr(later, field.name) for field in fields(Answers) if getattr(later, field.name)}
    answer_by_name["columns"] = {**base.columns, **later.columns}
    return replace(base, **answer_by_name)


def format_mapping(answers: Answers, tables: Sequence[tuple[str, Sequence[Guess]]]) -> str:
    """Return the text of a mapping file.

    Args:
        tables: Name of each table, and its guesses.
    """
    lines = [MAPPING_FILE_FIRST_LINE]
    said = {name: getattr(answers, name) for name in _TEXT_ANSWER_NAMES if getattr(answers, name)}
    if said or answers.dbc:
        lines.append("[answers]")
        lines += [f"{name} = {_toml_string(value)}" for name, value in said.items()]
        lines += [f"dbc = [{', '.join(map(_toml_string, answers.dbc))}]"] if answers.dbc else []
        lines.append("")
    for name, guesses in tables:
        lines += ["[[table]]", f"name = {_toml_string(name)}"]
        for guess in guesses:
            unit = guess.unit if _is_unit_for_mapping(guess) else ""
            value = f"{guess.column}*{unit}" if unit else guess.column
            why = " ".join(guess.why.split())
            lines.append(f"{guess.quantity} = {_toml_string(value)}  # {guess.confidence}: {why}")
        lines.append("")
    return "\n".join(lines)


def _is_unit_for_mapping(guess: Guess) -> bool:
    """Tell whether a unit can be given: that of a date or of a turned-round rate can't."""
    return bool(guess.unit) and guess.unit not in {"date", "clock"} and not guess.unit.startswith("-")


def _toml_string(text: str) -> str:
    return json.dumps(text, ensure_ascii=True).replace("\\/", "/")


def mapping_file_name(target: str) -> str:
    """Return the name of the mapping file beside a log."""
    path = Path(target)
    return str(path.with_name(f"{path.name.removesuffix('.mcap')}.import.toml"))
