"""The columns of a table that can be a quantity, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from typing import Any

import numpy as np

from cwcli.errors import DataError
from cwcli.importing.cells import (
    DECIMAL_COMMA_PATTERN,
    ArrowArray,
    distinct_names_and_row_indices,
    is_text_column,
    read_degree_cells_and_count_bad,
    read_number_cells_and_count_bad,
    read_whole_units_fraction_and_validity,
    texts_without_unit,
    trimmed_texts_or_null,
    unit_behind_every_number_or_empty,
)
from cwcli.importing.names import COLUMN_WORDS_BY_QUANTITY, quantities_of_name, split_name
from cwcli.importing.position_pairs import with_columns_of_position_pairs
from cwcli.importing.tables import Answers, ColumnsOfRows, Question, SourceTable
from cwcli.importing.times import (
    Instants,
    TextTimes,
    is_clock_of_digits,
    is_since_1970,
    join_text_times,
    parse_short_dates,
    parse_text_times,
    times_of_day_from_digits,
)
from cwcli.importing.units import find_unit
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.text import format_count

MIN_ROWS_TO_JOIN_COLUMN_PIECES = 1 << 20
"""Number of rows from which the pieces of a column are joined, so that a file can hold them. Chosen by hand: 8 MiB."""
COLUMN_NAME_WORDS_OF_TIME_SINCE_1970 = frozenset(
    "time timestamp unix epoch posix stamp utc gentime received created ts s sec ms us ns".split()  # noqa: SIM905
)
"""Words of which a column of numbers since 1970 has one, beside any others, in a table that names no time."""
PART_OF_SECOND_BY_UNIT = {"ms": "millisecond", "us": "microsecond", "ns": "nanosecond"}
"""Unit of a column of parts of a second -> its quantity."""
MAX_NON_NUMBER_CELL_SHARE = 0.05
"""Largest share of cells without a number in a column of numbers; a column with more is none. Chosen by hand."""
SENTINEL_NUMBERS_FOR_MISSING_VALUES = frozenset(
    {-99.0, -32768.0, -2147483648.0, *(sign * (10.0**n - 1.0) for n in range(3, 8) for sign in (-1, 1))}
)
"""Numbers that loggers write where nothing was measured: nines, and the least numbers of 16 and 32 bits."""
COMMA_BEFORE_THREE_DIGITS_PATTERN = r"^[+-]?\d{1,3}(,\d{3})+$"
"""A number with a comma before each three digits, which may be a thousand or a decimal."""
POINT_BEFORE_THREE_DIGITS_PATTERN = r"^[+-]?\d{1,3}(\.\d{3})+$"
"""A number with a point before each three digits, which may be a thousand or a decimal."""
POINT_DECIMAL_PATTERN = r"^[+-]?\d*\.\d+([eE][+-]?\d+)?$"
"""A number with decimals behind a point."""


@dataclass
class LoadedTable:
    """A table whose candidate columns are in memory, n rows each.

    Attributes:
        source: The table.
        candidates: Quantity -> columns that can be it.
        numbers: Column -> numbers in the file's unit.
        instants: Column of times -> numbers.
        text_times: Column of times -> dates and times of day.
        codes: Column of names -> (codes, names).
        unused: Names of the columns that are no quantity.
        n_rows: Number of rows.
    """

    source: SourceTable
    candidates: dict[str, list[str]]
    numbers: dict[str, FloatArray] = field(default_factory=dict)
    instants: dict[str, Instants] = field(default_factory=dict)
    text_times: dict[str, TextTimes] = field(default_factory=dict)
    codes: dict[str, tuple[Int64Array, tuple[str, ...]]] = field(default_factory=dict)
    unused: tuple[str, ...] = ()
    n_rows: int = 0


def candidate_columns_by_quantity(table: SourceTable, answers: Answers) -> dict[str, list[str]]:
    """Return the columns that can be each quantity: what the user or the format says, else by their names.

    Behind a column of time that the user names come the others, which can hold the time of its day or its date.
    """
    found: dict[str, list[str]] = {}
    quantity_of_column: dict[str, str] = {}
    for quantity in COLUMN_WORDS_BY_QUANTITY:
        column_and_unit = answers.column_and_unit_for(table, quantity)
        if column_and_unit is not None:
            if column_and_unit[0] and column_and_unit[0] not in table.columns:
                raise DataError(
                    f"there is no column {column_and_unit[0]!r}",
                    where=table.name,
                    found=table.columns,
                    hint="--column QUANTITY=COLUMN",
                )
            if quantity == "time" and not column_and_unit[1] and _is_part_of_time_by_name(column_and_unit[0]):
                continue  # it stays a date, or the year, that others complete
            found[quantity] = [column_and_unit[0]] if column_and_unit[0] else []
            if column_and_unit[0]:
                quantity_of_column[column_and_unit[0]] = quantity
    for column in table.columns:
        if column in quantity_of_column:
            continue
        preset = table.presets.get(column)
        names = [preset.quantity] if preset is not None else quantities_of_name(column)
        for quantity in names:
            decided = answers.column_and_unit_for(table, quantity)
            if quantity in COLUMN_WORDS_BY_QUANTITY and (decided is None or (quantity == "time" and decided[0])):
                found.setdefault(quantity, []).append(column)
    for quantity, columns in found.items():  # what the format fixes leaves no other candidate
        fixed = [column for column in columns if column in table.presets]
        if fixed and len(fixed) < len(columns):
            found[quantity] = fixed
    _drop_incomplete_axes(found)
    _add_parts_of_seconds(table, found)
    return {quantity: columns for quantity, columns in found.items() if columns}


def _is_part_of_time_by_name(column: str) -> bool:
    """Tell whether a column is called a date or a year."""
    return bool({"date", "year"}.intersection(quantities_of_name(column)))


def _add_parts_of_seconds(table: SourceTable, by_quantity: dict[str, list[str]]) -> None:
    """Add the columns of parts of a second whose names differ from that of a column of seconds by the unit alone.

    `tv_sec` and `tv_usec`.
    """
    named = {column: split_name(column) for column in table.columns}
    words_of_seconds = {each.words for each in named.values() if find_unit(each.unit_text, "time") == "s"}
    for column, each in named.items():
        part = PART_OF_SECOND_BY_UNIT.get(find_unit(each.unit_text, "time"))
        is_known = any(column in columns for columns in by_quantity.values())
        if part is not None and each.words in words_of_seconds and not is_known:
            by_quantity.setdefault(part, []).append(column)


def _drop_incomplete_axes(by_quantity: dict[str, list[str]]) -> None:
    """Leave out axes without their companions: `gx` alone, `x` without `y`; but `gz` alone may be a yaw rate."""
    inertial = {name for name in by_quantity if by_quantity[name] and name.startswith(("gyro_", "accel_"))}
    yaw_rate = by_quantity["gyro_z"] if inertial == {"gyro_z"} and not by_quantity.get("yaw_rate") else []
    for names in (
        [f"gyro_{axis}" for axis in "xyz"],
        [f"accel_{axis}" for axis in "xyz"],
        [f"quaternion_{axis}" for axis in "xyzw"],
        ["x", "y"],
        ["velocity_east", "velocity_north"],
    ):
        present = [name for name in names if by_quantity.get(name)]
        if 0 < len(present) < len(names):
            for name in present:
                del by_quantity[name]
    if yaw_rate:
        by_quantity["gyro_z"] = yaw_rate


def load_table(table: SourceTable, answers: Answers) -> LoadedTable:
    """Load the candidate columns.

    Raises:
        InputError, DataError: As the reader.
        AmbiguousError: The decimal mark is not clear.
    """
    if any(column and column not in table.columns for column in answers.columns_for(table)):
        table = with_columns_of_position_pairs(table)
    candidates = candidate_columns_by_quantity(table, answers)
    if not {"latitude", "longitude"} & set(candidates):
        table = with_columns_of_position_pairs(table)
        candidates = candidate_columns_by_quantity(table, answers)
    if candidates and "time" not in candidates and "date" not in candidates:
        candidates |= (
            _date_columns_as_times_by_quantity(table)
            or _epoch_columns_as_times_by_quantity(table)
            or ({} if "minute" in candidates or "second" not in candidates else {"time": candidates.pop("second")})
        )
    columns_to_load = list(dict.fromkeys(column for columns in candidates.values() for column in columns))
    loaded = LoadedTable(table, candidates, unused=tuple(name for name in table.columns if name not in columns_to_load))
    if not columns_to_load:
        return loaded
    of_column = {column: [q for q, columns in candidates.items() if column in columns] for column in columns_to_load}
    pieces: dict[str, list[Any]] = {column: [] for column in columns_to_load}
    decimals: dict[str, str] = {}
    bad = dict.fromkeys(columns_to_load, 0)
    how: dict[str, str] = {}
    cell_units: dict[str, str] = {}
    for batch in table.read_batches(columns_to_load):
        n = len(next(iter(batch.values())))
        if n and not loaded.n_rows and not answers.decimal:
            _ask_about_thousands_separators(batch, table)
        loaded.n_rows += n
        for column in columns_to_load:
            array = batch[column]
            if column not in how and n:
                cell_units[column] = (
                    ""
                    if {"latitude", "longitude"} & set(of_column[column])
                    else unit_behind_every_number_or_empty(array)
                )
            if cell_units.get(column):
                array = texts_without_unit(array, cell_units[column])
            if column not in how and n:
                decimals[column] = answers.decimal or _decimal_mark_of_column(array, table, column)
                how[column] = _reading_method_of_column(array, of_column[column])
            if n:
                bad[column] += _append_cells_and_count_bad(pieces[column], array, how[column], decimals[column])
                _join_last_pieces(pieces[column], how[column])
    for column in columns_to_load:
        _store_finished_column(loaded, column, how.get(column, "numbers"), pieces[column])
    given_units = {column: unit for column, unit in cell_units.items() if unit}
    loaded.source = replace(table, units={**given_units, **table.units})
    _turn_digit_numbers_into_clock_times(loaded, answers)
    _drop_text_columns(loaded, bad, answers)
    return loaded


def _date_columns_as_times_by_quantity(table: SourceTable) -> dict[str, list[str]]:
    """Return the columns whose first cells are dates with times of day as the times of a table that names none."""
    batch = next(iter(table.read_batches(table.columns)), {})
    found = []
    for column, array in batch.items():
        times = parse_text_times(array) if is_text_column(array) else None
        if times is not None and times.has_date and times.has_clock:
            found.append(column)
    return {"time": found} if found else {}


def _epoch_columns_as_times_by_quantity(table: SourceTable) -> dict[str, list[str]]:
    """Return the columns whose first cells are numbers since 1970 that advance, as the times of a table without any.

    A name must not say anything against it: other large numbers are ids and counters.
    """
    batch = next(iter(table.read_batches(table.columns)), {})
    found = []
    for column, array in batch.items():
        words = split_name(column).words
        if quantities_of_name(column) or not COLUMN_NAME_WORDS_OF_TIME_SINCE_1970 & {
            *words,
            *column.lower().replace("_", " ").split(),
        }:
            continue
        instants = Instants(*read_whole_units_fraction_and_validity(array, "."))
        if instants.valid.mean() > 0.5 and is_since_1970(instants):
            found.append(column)
    return {"time": found} if found else {}


def _turn_digit_numbers_into_clock_times(loaded: LoadedTable, answers: Answers) -> None:
    """Read times of day that are written as numbers (hhmmss): beside a column of dates, or by their steps."""
    has_dates = any(times.has_date and not times.has_clock for times in loaded.text_times.values())
    decided = answers.column_and_unit_for(loaded.source, "time")
    for column in list(loaded.instants):
        if decided is not None and decided[1] and column == decided[0]:
            continue
        is_clock = has_dates or is_clock_of_digits(loaded.instants[column])
        clock = times_of_day_from_digits(loaded.instants[column]) if is_clock else None
        if clock is not None and column in loaded.candidates.get("time", ()):
            loaded.text_times[column] = clock
            del loaded.instants[column]


def _reading_method_of_column(array: ArrowArray, quantities: list[str]) -> str:
    if any(COLUMN_WORDS_BY_QUANTITY[quantity].kind == "text" for quantity in quantities) and "date" not in quantities:
        return "texts"
    if quantities[0] in {"time", "date"}:
        if is_text_column(array) and parse_text_times(array) is not None:
            return "text times"
        if is_text_column(array) and quantities == ["date"] and parse_short_dates(array) is not None:
            return "short dates"
        return "instants"
    return "places" if any(quantity in {"latitude", "longitude"} for quantity in quantities) else "numbers"


def _append_cells_and_count_bad(batches: list[Any], array: ArrowArray, reading_method: str, decimal: str) -> int:
    """Append the cells of a batch; returns how many are neither a value nor empty."""
    if reading_method == "texts":
        batches.append(distinct_names_and_row_indices(array))
        return 0
    if reading_method == "instants":
        batches.append(read_whole_units_fraction_and_validity(array, decimal))
        return 0
    if reading_method in {"text times", "short dates"}:
        times = parse_text_times(array) if reading_method == "text times" else parse_short_dates(array)
        n = len(array)
        batches.append(
            times
            or TextTimes(
                np.full((n, 3), -1, np.int64), np.zeros(n, np.int64), np.full(n, np.nan), np.zeros(n, np.bool_), ""
            )
        )
        return 0
    values, n_bad = (
        read_degree_cells_and_count_bad if reading_method == "places" else read_number_cells_and_count_bad
    )(array, decimal)
    batches.append(values)
    return n_bad


def _join_last_pieces(pieces: list[Any], reading_method: str) -> None:
    """Replace the last pieces of a column by one, once they are many.

    Arrays of a few rows lie in memory whatever their number; large ones can lie in a file (`cwcli.array_memory`).
    """
    n_last = 0
    for piece in reversed(pieces):
        if _n_rows_of_piece(piece) >= MIN_ROWS_TO_JOIN_COLUMN_PIECES:
            break
        n_last += 1
    last = pieces[len(pieces) - n_last :]
    if reading_method == "texts" or sum(map(_n_rows_of_piece, last)) < MIN_ROWS_TO_JOIN_COLUMN_PIECES:
        return
    pieces[len(pieces) - n_last :] = [_joined_pieces(last, reading_method)]


def _n_rows_of_piece(piece: Any) -> int:
    """Return the number of rows of numbers, of instants, of times or of texts."""
    return len(piece.valid if isinstance(piece, TextTimes) else piece[-1] if isinstance(piece, tuple) else piece)


def _joined_pieces(pieces: list[Any], reading_method: str) -> Any:
    if reading_method == "instants":
        return tuple(np.concatenate([piece[k] for piece in pieces]) for k in range(3))
    if reading_method in {"text times", "short dates"}:
        return join_text_times(pieces)
    return np.concatenate(pieces)


def _store_finished_column(loaded: LoadedTable, column: str, reading_method: str, batches: list[Any]) -> None:
    if reading_method == "texts":
        names: dict[str, int] = {}
        codes = [
            np.array([names.setdefault(name, len(names)) for name in own], np.int64)[rows] for own, rows in batches
        ]
        loaded.codes[column] = np.concatenate([np.zeros(0, np.int64), *codes]), tuple(names)
    elif reading_method == "instants":
        parts = [np.concatenate([piece[k] for piece in batches]) for k in range(3)]
        loaded.instants[column] = Instants(*parts)
    elif reading_method in {"text times", "short dates"}:
        loaded.text_times[column] = join_text_times(batches)
    else:
        loaded.numbers[column] = np.concatenate(batches) if batches else np.zeros(0)
        n_sentinels, sentinel = _remove_sentinels(loaded.numbers[column])
        if n_sentinels:
            loaded.source.notes.append(
                f"{column}: {format_count(n_sentinels, 'cell')} of {sentinel:.0f} stand for no value and are left out"
            )


def _remove_sentinels(values: FloatArray) -> tuple[int, float]:
    """Replace an extreme value that stands for none by NaN, in place; return how many there were, and the value.

    It is one of `SENTINEL_NUMBERS_FOR_MISSING_VALUES`, and farther from all other values than these from each other.
    """
    n_removed, removed = 0, 0.0
    for find_extreme in (np.fmin, np.fmax):
        sentinel = float(find_extreme.reduce(values)) if len(values) else 0.0
        if sentinel not in SENTINEL_NUMBERS_FOR_MISSING_VALUES:
            continue
        is_one = values == sentinel
        others = values[~is_one & np.isfinite(values)]
        if len(others) and np.abs(others - sentinel).min() <= np.ptp(others):
            continue
        values[is_one] = np.nan
        n_removed, removed = int(np.count_nonzero(is_one)), sentinel
    return n_removed, removed


def _drop_text_columns(loaded: LoadedTable, bad: Mapping[str, int], answers: Answers) -> None:
    """Leave out columns whose cells are no numbers, and note single cells that are none."""
    for column, n_bad in bad.items():
        if not n_bad or column not in loaded.numbers:
            continue
        n_given = int(np.count_nonzero(np.isfinite(loaded.numbers[column]))) + n_bad
        if n_bad <= MAX_NON_NUMBER_CELL_SHARE * n_given:
            loaded.source.notes.append(f"{column}: {n_bad} cells are no numbers and are left out")
            continue
        quantities = [quantity for quantity, columns in loaded.candidates.items() if column in columns]
        named_by_user = [name for name in quantities if answers.column_and_unit_for(loaded.source, name)]
        if named_by_user:
            raise DataError(
                f"{n_bad} of {n_given} cells of {column!r} are no numbers",
                where=loaded.source.name,
                hint=f"--column {named_by_user[0]}=NAME names another column",
            )
        if any(quantity in {"latitude", "longitude"} for quantity in quantities):
            raise DataError(
                f"{n_bad} of {n_given} cells of {column!r} are no numbers",
                where=loaded.source.name,
                hint="latitude and longitude are decimal degrees: 48.137, 48,137 or 48.137 N",
            )
        for quantity in quantities:
            loaded.candidates[quantity].remove(column)
        loaded.candidates = {quantity: columns for quantity, columns in loaded.candidates.items() if columns}
        loaded.unused = (*loaded.unused, column)


def _count_commas_points_and_thousands_marks(texts: ArrowArray) -> tuple[int, int, int, int]:
    """Count the texts with a decimal comma, a decimal point, and with a comma or a point before each three digits."""
    import pyarrow.compute as pc

    n_comma, n_point, n_comma_thousands, n_point_thousands = (
        int(pc.sum(pc.match_substring_regex(texts, pattern)).as_py() or 0)
        for pattern in (
            DECIMAL_COMMA_PATTERN,
            POINT_DECIMAL_PATTERN,
            COMMA_BEFORE_THREE_DIGITS_PATTERN,
            POINT_BEFORE_THREE_DIGITS_PATTERN,
        )
    )
    return n_comma, n_point, n_comma_thousands, n_point_thousands


def _ask_about_thousands_separators(batch: ColumnsOfRows, table: SourceTable) -> None:
    """Ask where one mark stands before three digits in one column, and another column has decimals behind the other.

    Raises:
        AmbiguousError: It may stand before thousands.
    """
    counts = {
        column: _count_commas_points_and_thousands_marks(trimmed_texts_or_null(array))
        for column, array in batch.items()
        if is_text_column(array)
    }
    pointed = next((column for column, (n_comma, n_point, *_) in counts.items() if n_point and not n_comma), None)
    for column, (n_comma, n_point, n_thousands, _) in counts.items():
        if pointed is not None and n_comma and not n_point and n_thousands == n_comma:
            what = f"{column!r}: its commas may stand before thousands, because {pointed!r} has decimal points"
            raise Question(table.name, what, "--decimal , or remove the commas").as_error()
    comma = next((name for name, (n, n_point, n_3, _) in counts.items() if n > n_3 and not n_point), None)
    for column, (n_comma, n_point, _, n_thousands) in counts.items():
        if comma is not None and n_thousands and not n_comma and n_thousands >= n_point:
            what = f"{column!r}: its points may stand before thousands, because {comma!r} has decimal commas"
            raise Question(table.name, what, "--decimal . or remove the points").as_error()


def _decimal_mark_of_column(array: ArrowArray, table: SourceTable, column: str) -> str:
    """Return the decimal mark of a column by its first cells.

    Raises:
        AmbiguousError: Both marks are there, or commas may stand before thousands.
    """
    if not is_text_column(array):
        return "."
    texts = trimmed_texts_or_null(array)
    n_comma, n_point, n_thousands, _ = _count_commas_points_and_thousands_marks(texts)
    if not n_comma:
        return "."
    if n_point:
        what = f"{column!r} has numbers with a comma and numbers with a point"
        raise Question(table.name, what, "--decimal . or --decimal , (the others are then left out)").as_error()
    if n_thousands == n_comma and n_comma < len(texts) - texts.null_count:
        what = f"{column!r}: the commas may be decimal marks or stand before thousands"
        raise Question(table.name, what, "--decimal , or remove the commas").as_error()
    return ","
