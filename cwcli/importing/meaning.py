"""What a table means: its stamps and its quantities in SI, with every guess and every open question."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

import numpy as np

from cwcli.importing.load import LoadedTable
from cwcli.importing.motion import TrackSpans
from cwcli.importing.names import COLUMN_WORDS_BY_QUANTITY, split_name, unit_of_name
from cwcli.importing.tables import Answers, Guess, Question, UnitChoice
from cwcli.importing.units import FACTOR_BY_KIND_AND_UNIT, find_unit
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array

MAX_RELATIVE_DIFFERENCE_OF_EQUAL_COLUMNS = 1e-4
"""Largest relative difference of two columns that count as the same quantity. Chosen by hand: rounding of a text
changes less."""

MAX_RELATIVE_DIFFERENCE_OF_CONVERTED_COLUMNS = 0.01
"""The same for two columns in different units, which are rounded one by one. Chosen by hand: 0.1 mph is less."""


@dataclass
class Meaning:
    """The meaning of a table, n rows by stamp.

    Attributes:
        table: The table as loaded.
        answers: What the user decided.
        rows: The rows that have a stamp, by stamp.
        stamp_ns: Shape (n,).
        since: `1970`, or `start` where stamps count from the start of the recording.
        values: Quantity -> (n,) in SI; places in degrees; headings in rad counter-clockwise from east.
        guesses: What was guessed, or given.
        questions: What only the user knows.
        notes: What the user should know.
    """

    table: LoadedTable
    answers: Answers
    rows: Int64Array
    stamp_ns: Int64Array
    since: str
    values: dict[str, FloatArray] = field(default_factory=dict)
    guesses: list[Guess] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    chosen: dict[str, str] = field(default_factory=dict)
    track: TrackSpans | None = None

    @property
    def name(self) -> str:
        """Name of the table."""
        return self.table.source.name

    def numbers_in_file_unit(self, column: str) -> FloatArray:
        """Return a column of numbers in the file's unit, (n,)."""
        if column in self.table.numbers:
            return self.table.numbers[column][self.rows]
        return self.table.instants[column].values_or_nan()[self.rows]

    def add_question(self, what: str, option: str) -> None:
        """Add a question."""
        self.questions.append(Question(self.name, what, option))

    def candidate_columns(self, quantity: str) -> list[str]:
        """Return the columns that can be a quantity and hold any number."""
        return [
            column
            for column in self.table.candidates.get(quantity, ())
            if column in self.table.numbers and np.isfinite(self.table.numbers[column]).any()
        ]

    def choose_column_or_ask(self, quantity: str) -> str | None:
        """Return the column of a quantity; None where there is none, or where a question is asked."""
        columns = [column for column in self.candidate_columns(quantity) if column not in self.chosen.values()]
        if not columns:
            return None
        if len(columns) > 1:
            if not all(self._do_both_hold_same_quantity(quantity, columns[0], column) for column in columns[1:]):
                self.add_question(
                    f"{_join_column_names(columns)} can each be the {quantity.replace('_', ' ')}",
                    " or ".join(f"--column {quantity}='{column}'" for column in columns[:4]),
                )
                return None
            self.notes.append(f"{_join_column_names(columns)} hold the same {quantity}: the first one is read")
        self.chosen[quantity] = columns[0]
        return columns[0]

    def _do_both_hold_same_quantity(self, quantity: str, first: str, second: str) -> bool:
        """Tell whether two columns hold the same values, or do so after a change of the units that they state."""
        numbers = self.numbers_in_file_unit(first), self.numbers_in_file_unit(second)
        if _do_columns_hold_same_values(*numbers, MAX_RELATIVE_DIFFERENCE_OF_EQUAL_COLUMNS):
            return True
        units = [self.stated_unit(quantity, column).unit for column in (first, second)]
        factors = FACTOR_BY_KIND_AND_UNIT.get(COLUMN_WORDS_BY_QUANTITY[quantity].kind, {})
        if units[0] == units[1] or not all(unit in factors for unit in units):
            return False
        scaled = [values * factors[unit] for values, unit in zip(numbers, units, strict=True)]
        return _do_columns_hold_same_values(scaled[0], scaled[1], MAX_RELATIVE_DIFFERENCE_OF_CONVERTED_COLUMNS)

    def stated_unit(self, quantity: str, column: str) -> UnitChoice:
        """Return the unit of a column that the user, the format or the header states; "" where nothing does."""
        kind, said = COLUMN_WORDS_BY_QUANTITY[quantity].kind, "the header says it"
        column_and_unit = self.answers.column_and_unit_for(self.table.source, quantity)
        if column_and_unit is not None and column_and_unit[0] == column:
            unit = (
                column_and_unit[1]
                or unit_of_name(column, kind)
                or find_unit(self.table.source.units.get(column, ""), kind)
            )
            return UnitChoice(unit, "given", "as you said") if column_and_unit[1] else UnitChoice(unit, "certain", said)
        preset = self.table.source.presets.get(column)
        if preset is not None and preset.unit:
            return UnitChoice(preset.unit, "certain", f"{self.table.source.kind} files have it so")
        unit = find_unit(self.table.source.units.get(column, ""), kind) or unit_of_name(column, kind)
        return UnitChoice(unit, "certain", said)

    def add_quantity(self, quantity: str, values: FloatArray, guess: Guess) -> None:
        """Add a quantity with its guess."""
        self.values[quantity] = values
        self.guesses.append(guess)

    def add_scaled_quantity(self, quantity: str, column: str, choice: UnitChoice) -> None:
        """Add a quantity whose unit is a factor."""
        factor = FACTOR_BY_KIND_AND_UNIT[COLUMN_WORDS_BY_QUANTITY[quantity].kind][choice.unit]
        values = self.numbers_in_file_unit(column) if factor == 1.0 else self.numbers_in_file_unit(column) * factor
        self.add_quantity(quantity, values, Guess(quantity, column, *choice))

    def is_decided_by_user(self, quantity: str) -> bool:
        """Tell whether the user decided about a quantity."""
        return self.answers.column_and_unit_for(self.table.source, quantity) is not None

    def words_of_column(self, column: str) -> tuple[str, ...]:
        """Return the words of a column's name."""
        return split_name(column).words


def _do_columns_hold_same_values(first: FloatArray, second: FloatArray, share: float) -> bool:
    both = np.isfinite(first) & np.isfinite(second)
    if not both.any():
        return False
    scale = max(float(np.ptp(first[both])), 1e-9)
    return bool(np.abs(first[both] - second[both]).max() <= share * scale)


def _join_column_names(columns: Sequence[str]) -> str:
    return " and ".join(repr(column) for column in columns[:6]) + (
        f" and {len(columns) - 6} more" if len(columns) > 6 else ""
    )
