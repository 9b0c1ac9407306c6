"""The metadata records `cwcli.run.<stage>`, read back: how a log was annotated, and with which car it was observed.

A log may come from anybody, so nothing in a record is believed: what is missing or does not fit is as if it were not
there.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from cwcli.dynamics.vehicle import Vehicle, load_vehicle
from cwcli.errors import DataError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.pipeline.result import Cell, SummaryTable
from cwcli.signals.geodesy import LocalMap

RUN_RECORD_PREFIX = "cwcli.run."
"""Beginning of the names of the metadata records of runs; the name of the stage follows it."""
VEHICLE_RECORD_KEY = "vehicle"
"""Entry of the record of `observe` that holds the car's parameters as JSON."""
WITHHELD_WARNINGS_RECORD_KEY = "withheld"
"""Entry of a warning stage's record that holds the number of withheld warnings of each rule as JSON."""
MAX_RECORDED_LATENCY_S = 86_400.0
"""Greatest latency that a record may state, s: a day; anything beyond is ignored. Chosen by hand."""
MAP_ORIGIN_ENTRY_NAMES = ("map_origin_latitude_deg", "map_origin_longitude_deg", "map_origin_altitude_m")
"""Entries of the record of `estimate` for the map's origin: WGS 84 latitude and longitude [deg], altitude [m]."""

Record = Mapping[str, str]


def read_run_records(log: Log) -> dict[str, Record]:
    """Return the records of runs by stage, the last one of each."""
    return {
        name.removeprefix(RUN_RECORD_PREFIX): entries for name, entries in log.metadata_with_prefix(RUN_RECORD_PREFIX)
    }


def parse_json_entry_or_empty(record: Record, key: str, kind: type) -> Any:
    """Parse an entry with JSON of a kind (`dict` or `list`); return an empty one if it is missing or another."""
    try:
        value = json.loads(record.get(key, ""))
    except (ValueError, RecursionError):
        return kind()
    return value if isinstance(value, kind) else kind()


def read_finite_number_or_nan(entries: Mapping[str, Any], key: str) -> float:
    """Return a finite number of a JSON object; NaN where there is none."""
    value = entries.get(key)
    number = to_float_or_nan(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    return number if math.isfinite(number) else math.nan


def to_float_or_nan(value: float) -> float:
    """Return the value as a float; NaN for a whole number that is too large for one."""
    try:
        return float(value)
    except OverflowError:
        return math.nan


def read_latency_s(entries: Mapping[str, Any], key: str) -> float:
    """Return a latency of a JSON object [s]; NaN where it is missing or exceeds `MAX_RECORDED_LATENCY_S`."""
    value = read_finite_number_or_nan(entries, key)
    return value if abs(value) <= MAX_RECORDED_LATENCY_S else math.nan


def to_int_or_none(value: object) -> int | None:
    """Return the value if it is a whole number, else None."""
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def read_configuration(record: Record) -> dict[str, Any]:
    """Return the resolved configuration of the recorded stage."""
    found: dict[str, Any] = parse_json_entry_or_empty(record, "configuration", dict)
    return found


def read_input_counts(record: Record) -> list[dict[str, Any]]:
    """Return the counts of the stage's input messages, each an `InputMessageCount` as JSON."""
    return [entry for entry in parse_json_entry_or_empty(record, "counts", list) if isinstance(entry, dict)]


@dataclass(frozen=True)
class RecordedSummary:
    """The summary of a stage, read from its record.

    Attributes:
        verdict, notes, contradictions, corrections: As in `pipeline.result.StageSummary`.
        sections: Its tables.
    """

    verdict: str
    notes: tuple[str, ...]
    sections: tuple[SummaryTable, ...]
    contradictions: tuple[str, ...] = ()
    corrections: tuple[str, ...] = ()

    def rows_of_table_columns_or_empty(self, key: str, *columns: str) -> list[tuple[Cell, ...]]:
        """Return the cells of some columns of a table, row by row; [] if the table or a column is missing."""
        section = next((section for section in self.sections if section.key == key), None)
        if section is None or not set(columns) <= set(section.columns):
            return []
        places = [section.columns.index(name) for name in columns]
        return [tuple(row[place] for place in places) for row in section.rows]


def read_recorded_summary(record: Record) -> RecordedSummary:
    """Return the summary in the record; an empty one where there is none, as in logs of older versions."""
    found = parse_json_entry_or_empty(record, "summary", dict)
    sections = found.get("sections")
    return RecordedSummary(
        str(found.get("verdict") or ""),
        _texts_of_list_or_empty(found.get("notes")),
        tuple(filter(None, map(_parse_summary_table_or_none, sections))) if isinstance(sections, list) else (),
        _texts_of_list_or_empty(found.get("contradictions")),
        _texts_of_list_or_empty(found.get("corrections")),
    )


def _texts_of_list_or_empty(value: Any) -> tuple[str, ...]:
    """Return the texts in a list of the summary; () if it is none."""
    return tuple(text for text in value if isinstance(text, str)) if isinstance(value, list) else ()


def _parse_summary_table_or_none(value: Any) -> SummaryTable | None:
    """Parse a table of the summary; return None if it is malformed."""
    try:
        columns = tuple(str(name) for name in value["columns"])
        rows = tuple(tuple(_parse_cell(cell) for cell in row) for row in value["rows"])
        key, title = str(value["key"]), str(value["title"])
    except (KeyError, TypeError):
        return None
    return SummaryTable(key, title, columns, rows) if all(len(row) == len(columns) for row in rows) else None


def _parse_cell(value: Any) -> Cell:
    """Return a cell of a recorded table, as text where JSON holds a list or an object."""
    return value if value is None or isinstance(value, str | int | float) else str(value)


def map_origin_record_entries(local_map: LocalMap | None) -> dict[str, str]:
    """Return the entries of the record of `estimate` that say where the map frame lies on the earth, if it does."""
    if local_map is None:
        return {"map_origin": "cartesian"}
    values = (local_map.origin_lat_deg, local_map.origin_lon_deg, local_map.origin_alt_m)
    return {name: repr(value) for name, value in zip(MAP_ORIGIN_ENTRY_NAMES, values, strict=True)}


def local_map_from_estimate_record(record: Record) -> LocalMap | None:
    """Return the map frame from the record of `estimate`; None where it is Cartesian or not recorded."""
    try:
        return LocalMap(*(float(record[name]) for name in MAP_ORIGIN_ENTRY_NAMES))
    except (KeyError, ValueError):
        return None


def vehicle_to_record_entry(vehicle: Vehicle) -> dict[str, str]:
    """Return the entry of the record of `observe` that holds the car."""
    return {VEHICLE_RECORD_KEY: json.dumps(asdict(vehicle), sort_keys=True)}


def vehicle_and_notes_from_log(log: Log) -> tuple[Vehicle, tuple[str, ...]]:
    """Return the car of the record of `observe`, and notes; without a record the shipped example and a note.

    Raises:
        DataError: The record is damaged.
    """
    entry = read_run_records(log).get("observe", {}).get(VEHICLE_RECORD_KEY)
    if entry is None:
        vehicle = load_vehicle()
        note = f"the log does not name its car (no record {RUN_RECORD_PREFIX}observe): {vehicle.name} is assumed"
        return vehicle, (note,)
    try:
        return Vehicle(**json.loads(entry)), ()
    except (TypeError, ValueError, RecursionError) as error:
        what = f"the car in the record {RUN_RECORD_PREFIX}observe can't be read: {error}"
        raise DataError(what, where=log.name, hint="observe again") from None
