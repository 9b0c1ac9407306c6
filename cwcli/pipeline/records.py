"""The metadata records `cwcli.run.<stage>`, read back: how a log was annotated, and with which car it was observed.

A log may come from anybody, so nothing in a record is believed: what is missing or does not fit is as if it were not
there.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from cwcli.dynamics.vehicle import Vehicle, load_vehicle
from cwcli.errors import DataError
from cwcli.logs.read.reader import Log
from cwcli.pipeline.result import Cell, Section
from cwcli.signals.geodesy import LocalMap

PREFIX = "cwcli.run."
VEHICLE = "vehicle"
WITHHELD = "withheld"
MAX_LATENCY_S = 86_400.0
"""What is later or earlier than a day is no latency."""
ORIGIN_NAMES = ("map_origin_latitude_deg", "map_origin_longitude_deg", "map_origin_altitude_m")

Record = Mapping[str, str]


def run_records(log: Log) -> dict[str, Record]:
    """Stage -> its record, the last one of each."""
    return {name.removeprefix(PREFIX): entries for name, entries in log.metadata_of(PREFIX)}


def json_entry(record: Record, key: str, kind: type) -> Any:
    """An entry that holds JSON of a kind (`dict` or `list`); an empty one where it is missing, broken or another."""
    try:
        value = json.loads(record.get(key, ""))
    except (ValueError, RecursionError):
        return kind()
    return value if isinstance(value, kind) else kind()


def number(entries: Mapping[str, Any], key: str) -> float:
    """A number of a JSON object; NaN where there is none."""
    value = entries.get(key)
    return real(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def real(value: float) -> float:
    """As a float; NaN of a whole number that is too large for one."""
    try:
        return float(value)
    except OverflowError:
        return math.nan


def latency_of(entries: Mapping[str, Any], key: str) -> float:
    """A latency of a JSON object [s]; NaN where there is none, or one that no source has."""
    value = number(entries, key)
    return value if abs(value) <= MAX_LATENCY_S else math.nan


def whole(value: object) -> int | None:
    """A whole number of a JSON object; None where there is none."""
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def configuration_of(record: Record) -> dict[str, Any]:
    """The stage's resolved configuration."""
    found: dict[str, Any] = json_entry(record, "configuration", dict)
    return found


def inputs_of(record: Record) -> list[dict[str, Any]]:
    """What became of the stage's input messages: `pipeline.result.InputCount` as JSON."""
    return [entry for entry in json_entry(record, "counts", list) if isinstance(entry, dict)]


@dataclass(frozen=True)
class Told:
    """What the stage told at its end.

    Attributes:
        verdict, notes: As in `pipeline.result.Summary`.
        sections: Its tables.
    """

    verdict: str
    notes: tuple[str, ...]
    sections: tuple[Section, ...]

    def cells(self, key: str, *columns: str) -> list[tuple[Cell, ...]]:
        """What a table has in some columns, row by row; nothing where the table or one of the columns is missing."""
        section = next((section for section in self.sections if section.key == key), None)
        if section is None or not set(columns) <= set(section.columns):
            return []
        places = [section.columns.index(name) for name in columns]
        return [tuple(row[place] for place in places) for row in section.rows]


def told_by(record: Record) -> Told:
    """The summary in the record; an empty one where there is none, as in logs of older versions."""
    found = json_entry(record, "summary", dict)
    notes, sections = found.get("notes"), found.get("sections")
    return Told(
        str(found.get("verdict") or ""),
        tuple(note for note in notes if isinstance(note, str)) if isinstance(notes, list) else (),
        tuple(filter(None, map(_section, sections))) if isinstance(sections, list) else (),
    )


def _section(found: Any) -> Section | None:
    """A table of the summary, None where it is none."""
    try:
        columns = tuple(str(name) for name in found["columns"])
        rows = tuple(tuple(_cell(cell) for cell in row) for row in found["rows"])
        key, title = str(found["key"]), str(found["title"])
    except (KeyError, TypeError):
        return None
    return Section(key, title, columns, rows) if all(len(row) == len(columns) for row in rows) else None


def _cell(value: Any) -> Cell:
    return value if value is None or isinstance(value, str | int | float) else str(value)


def map_entry(local_map: LocalMap | None) -> dict[str, str]:
    """Where the map frame lies on the earth, if it does, as an entry of the record of `estimate`."""
    if local_map is None:
        return {"map_origin": "cartesian"}
    values = (local_map.origin_lat_deg, local_map.origin_lon_deg, local_map.origin_alt_m)
    return {name: repr(value) for name, value in zip(ORIGIN_NAMES, values, strict=True)}


def map_of(record: Record) -> LocalMap | None:
    """Where the map frame lies on the earth, from the record of `estimate`."""
    try:
        return LocalMap(*(float(record[name]) for name in ORIGIN_NAMES))
    except (KeyError, ValueError):
        return None


def vehicle_entry(vehicle: Vehicle) -> dict[str, str]:
    """The car as an entry of the record of `observe`."""
    return {VEHICLE: json.dumps(asdict(vehicle), sort_keys=True)}


def vehicle_of(log: Log) -> tuple[Vehicle, tuple[str, ...]]:
    """The car with which the log was observed; the shipped example, and a note, if the log does not tell.

    Raises:
        DataError: The record is damaged.
    """
    entry = run_records(log).get("observe", {}).get(VEHICLE)
    if entry is None:
        vehicle = load_vehicle()
        note = f"the log does not tell the car (no record {PREFIX}observe): that of {vehicle.name} is assumed"
        return vehicle, (note,)
    try:
        return Vehicle(**json.loads(entry)), ()
    except (TypeError, ValueError, RecursionError) as error:
        what = f"the car in the record {PREFIX}observe can't be read: {error}"
        raise DataError(what, where=log.name, hint="observe again") from None
