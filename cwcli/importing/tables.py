"""What a reader gives: tables of named columns, in batches of rows; and the answers of the user to its questions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import PurePath
from typing import Any, NamedTuple

from cwcli.errors import MissingSignalError
from cwcli.lazy_dataclass import dataclass

ColumnsOfRows = Mapping[str, Any]
"""Columns of some rows: name -> an Arrow array, or a NumPy array of numbers."""


@dataclass(frozen=True)
class Preset:
    """What a format fixes about a column.

    Attributes:
        quantity: A name of `cwcli.importing.names.COLUMN_WORDS_BY_QUANTITY`.
        unit: Its unit, as `cwcli.importing.units` spells it.
    """

    quantity: str
    unit: str = ""


@dataclass(frozen=True)
class SourceTable:
    """One table of a file.

    Attributes:
        file: The file's name as given.
        part: Name of the table inside the file (a member of a zip, a CAN message), or "".
        kind: Name of the kind of file.
        columns: Names of the columns, each once.
        read_batches: The batches of some of the columns; may be called again.
        presets: Column -> what the format fixes about it.
        units: Column -> unit text that the file gives outside the column's name, e.g. in a line of units.
        is_device_frame: The inertial axes are those of a phone, which lies in the car in any direction.
        attitude_is_of_device: Angles and quaternions are of the device, not of the car.
        has_accelerations_of_other_sign: At rest, the accelerations point down, as those of Apple's phones do.
        start_ns: Time of the table's zero where the format has it elsewhere; None otherwise.
        notes: What the user should know; the list grows while the batches are read.
    """

    file: str
    part: str
    kind: str
    columns: tuple[str, ...]
    read_batches: Callable[[Sequence[str]], Iterator[ColumnsOfRows]]
    presets: Mapping[str, Preset] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    is_device_frame: bool = False
    attitude_is_of_device: bool = False
    has_accelerations_of_other_sign: bool = False
    start_ns: int | None = None
    notes: list[str] = field(default_factory=list)

    @classmethod
    def of_arrays(cls, file: str, part: str, kind: str, arrays: Mapping[str, Any], **more: Any) -> SourceTable:
        """Return a table of columns that are in memory, (n,) each; `more`: further attributes."""

        def iter_all_rows(wanted: Sequence[str]) -> Iterator[ColumnsOfRows]:
            yield {name: arrays[name] for name in wanted}

        return cls(file, part, kind, tuple(arrays), iter_all_rows, **more)

    @property
    def name(self) -> str:
        """The file, and the table in it."""
        return f"{self.file}: {self.part}" if self.part else self.file


@dataclass(frozen=True)
class Answers:
    """What the user decided, by options or by a mapping file.

    Attributes:
        columns: (table or "", quantity) -> (column, unit or ""); a column of "" leaves the quantity out.
        timezone: Name of the zone of local times, or "".
        date_order: `dmy`, `mdy`, `ymd`, or "".
        start: ISO 8601 time of the zero of relative times, or "".
        decimal: `.` or `,`, or "" for what the file shows.
        axes: Sensor axes that point forward and up, `x,z`, or "".
        vehicle: Id of the ego or name of the track, or "".
        frame_times: Source of the frames' or poses' times, or "".
        dbc: Files that describe the messages of a CAN bus.
    """

    columns: Mapping[tuple[str, str], tuple[str, str]] = field(default_factory=dict)
    timezone: str = ""
    date_order: str = ""
    start: str = ""
    decimal: str = ""
    axes: str = ""
    vehicle: str = ""
    frame_times: str = ""
    dbc: tuple[str, ...] = ()

    def columns_for(self, table: SourceTable) -> list[str]:
        """Return the columns that the user named for this table alone."""
        names = (table.name, PurePath(table.file).name, table.part)
        return [column for (name, _), (column, _) in self.columns.items() if name and name in names]

    def column_and_unit_for(self, table: SourceTable, quantity: str) -> tuple[str, str] | None:
        """Return column and unit that the user gave for a quantity of a table; None where nothing was given."""
        for name in (table.name, PurePath(table.file).name, table.part):
            own = self.columns.get((name, quantity)) if name else None
            if own is not None:
                return own
        shared = self.columns.get(("", quantity))
        return shared if shared is not None and (not shared[0] or shared[0] in table.columns) else None


@dataclass(frozen=True)
class Question:
    """Something that the file does not tell.

    Attributes:
        where: The table.
        what: What is not known.
        option: The option that decides, with its choices.
    """

    where: str
    what: str
    option: str

    def as_error(self, others: Sequence[Question] = ()) -> AmbiguousError:
        """Return the error that puts the question to the user, with other questions behind `found`."""
        found = tuple(f"{each.where}: {each.what} ({each.option})" for each in others)
        return AmbiguousError(self.what, where=self.where, found=found, hint=self.option)


class AmbiguousError(MissingSignalError):
    """The file can be read in several ways, and only the user knows which one is right."""


class UnitChoice(NamedTuple):
    """The unit of a column ("" where it is not known), how sure that is (as in `Guess`), and why."""

    unit: str
    confidence: str
    why: str

    def usual_unit_where_unknown(self, unit: str, why: str) -> UnitChoice:
        """Return the choice, or the usual unit where it has none."""
        return self if self.unit else UnitChoice(unit, "assumed", why)


UNKNOWN_UNIT = UnitChoice("", "", "")
"""The choice of a column whose unit is asked for."""


@dataclass(frozen=True)
class Guess:
    """The meaning of a column.

    Attributes:
        quantity: A name of `cwcli.importing.names.COLUMN_WORDS_BY_QUANTITY`.
        column: The column.
        unit: Its unit.
        confidence: `given` by the user, `certain` (the format or the header says it), `likely` (the values say it) or
            `assumed` (the usual convention; nothing contradicts).
        why: The reason in words.
    """

    quantity: str
    column: str
    unit: str
    confidence: str
    why: str
