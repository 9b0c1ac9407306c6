"""The metadata records `cwcli.run.<stage>`, read back: how a log was annotated, and with which car it was observed.

A log may come from anybody, so nothing in a record is believed: what is missing or does not fit is as if it were not
there.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any, get_args

from cwcli.dynamics.vehicle import Vehicle, load_vehicle
from cwcli.errors import DataError
from cwcli.logs.read.reader import Log
from cwcli.signals.geodesy import LocalMap
from cwcli.stages.inputs.sources import SourceConfig
from cwcli.warning.types import Use, WarningConfig

PREFIX = "cwcli.run."
VEHICLE = "vehicle"
ORIGIN_NAMES = ("map_origin_latitude_deg", "map_origin_longitude_deg", "map_origin_altitude_m")
OLD_THRESHOLDS = {"ttc": ("<", "conflict_ttc_s"), "drac": (">", "conflict_drac_mps2")}
"""Where earlier versions recorded the threshold of a conflict by these measures."""

Record = Mapping[str, str]


def run_records(log: Log) -> dict[str, Record]:
    """Stage -> its record, the last one of each."""
    return {name.removeprefix(PREFIX): entries for name, entries in log.metadata if name.startswith(PREFIX)}


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
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else float("nan")


def whole(value: object) -> int | None:
    """A whole number of a JSON object; None where there is none."""
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def configuration_of(record: Record) -> dict[str, Any]:
    """The stage's resolved configuration."""
    found: dict[str, Any] = json_entry(record, "configuration", dict)
    return found


def inputs_of(record: Record) -> list[dict[str, Any]]:
    """What became of the stage's input messages: `stages.result.InputCount` as JSON."""
    return [entry for entry in json_entry(record, "counts", list) if isinstance(entry, dict)]


def map_of(record: Record) -> LocalMap | None:
    """Where the map frame lies on the earth, from the record of `estimate`."""
    try:
        return LocalMap(*(float(record[name]) for name in ORIGIN_NAMES))
    except (KeyError, ValueError):
        return None


def sources_of(record: Record) -> SourceConfig:
    """Which channels `estimate` read, and how."""
    given = configuration_of(record).get("sources")
    given = given if isinstance(given, dict) else {}
    topics, station = given.get("topics"), given.get("ego_station")
    return SourceConfig(
        topics={str(role): str(topic) for role, topic in topics.items()} if isinstance(topics, dict) else {},
        clock="log" if given.get("clock") == "log" else "stamp",
        ego_station=station if isinstance(station, str) else None,
        start_ns=whole(given.get("start_ns")),
        end_ns=whole(given.get("end_ns")),
    )


def warn_record(records: Mapping[str, Record]) -> tuple[Record, bool]:
    """The record of the warnings of collisions, and whether they are of tracked targets."""
    of_targets = "warn" not in records and "warn-targets" in records
    record = records.get("warn-targets" if of_targets else "warn", {})
    return record, of_targets or configuration_of(record).get("source") == "targets"  # so in older logs


def rule_of(record: Record) -> WarningConfig:
    """The thresholds of `warn`."""
    given = configuration_of(record).get("rule")
    given = given if isinstance(given, dict) else {}
    fitting: dict[str, Any] = {}
    for entry in fields(WarningConfig):
        value = given.get(entry.name)
        if isinstance(entry.default, str):
            is_fit = isinstance(value, str) and (entry.name != "use" or value in get_args(Use))
        else:
            is_fit = isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value < math.inf
        if is_fit:
            fitting[entry.name] = value
    sign, key = OLD_THRESHOLDS.get(fitting.get("conflict", ""), ("", ""))
    if math.isfinite(number(given, key)):
        fitting["conflict"] += f" {sign} {number(given, key)!r}"
    return WarningConfig(**fitting)


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
    except (TypeError, ValueError) as error:
        what = f"the car in the record {PREFIX}observe can't be read: {error}"
        raise DataError(what, where=log.name, hint="observe again") from None
