"""Scenario files: reading, checking, overriding. The format is described key by key in `docs/scenarios.md`."""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping
from contextlib import suppress
from copy import deepcopy
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from cwcli.errors import UsageError
from cwcli.input import is_file, read_file
from cwcli.lazy_dataclass import dataclass
from cwcli.simulation.attitude import Attitude
from cwcli.simulation.catalogue import scenario_names, scenario_text
from cwcli.simulation.profile import read_motion_profile
from cwcli.simulation.road.names import ROAD_SCENARIOS
from cwcli.simulation.spec import (
    DETECTOR_KEYS,
    ORIGIN_KEYS,
    SCENARIO_TOP_LEVEL_KEYS,
    SENSOR_KEYS,
    V2X_KEYS,
    VEHICLE_KEYS,
    check_scenario_table,
)
from cwcli.simulation.truth import Motion, TrueMotion, check_motion_is_drivable
from cwcli.toml_text import parse_toml, toml_value_error

EGO_VEHICLE_KEY = "host"
"""Key of the ego vehicle among the vehicles of a scenario."""
DEFAULT_START_TIME = datetime(2016, 10, 1, 8, 0, 0, tzinfo=UTC)
"""Time of a run's start if the scenario states none. Chosen by hand."""
MAX_VEHICLE_SECONDS = 80_000
"""Greatest duration of a run, times the number of its vehicles [s]: 22 vehicles for an hour. Chosen by hand: a vehicle
takes 27 kB and a millisecond of processor time for each second."""

_UNIX_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
"""Start of Unix time, from which stamps are counted."""
_VEHICLE_NAME_PATTERN = re.compile(r"[a-z0-9][a-z0-9_-]*")
"""Permitted names of vehicles."""
_STATION_ID_PATTERN = re.compile(r"[0-9a-f]{8}")
"""Permitted station ids: eight lower-case hexadecimal digits."""


@dataclass(frozen=True)
class ScenarioVehicle:
    """One vehicle of a scenario.

    Attributes:
        name: Key in the file; `host` is the ego.
        station_id: Eight hexadecimal digits, its id in V2X messages and in the truth.
        motion: Its true motion.
        attitude: Pitch and roll of the vehicle on its way.
        length_m, width_m: Outline.
        has_v2x: Whether it sends V2X messages.
    """

    name: str
    station_id: str
    motion: Motion
    attitude: Attitude
    length_m: float
    width_m: float
    has_v2x: bool


@dataclass(frozen=True)
class Scenario:
    """A checked scenario.

    Attributes:
        name: File name without `.toml`.
        description, duration_s, seed, truth_rate_hz, friction: As in the file.
        start_ns: Time of the run's start, ns since 1970.
        origin: `latitude_deg`, `longitude_deg`, `altitude_m` of the map's origin.
        vehicles: By name, `host` first.
        sensors: The host's sensors: name -> checked settings (see `spec.SENSOR_KEYS` and `spec.DETECTOR_KEYS`).
        v2x: Settings of the link (see `spec.V2X_KEYS`), or None: no link.
        document: The file's content after overrides, for the log's metadata.
    """

    name: str
    description: str
    duration_s: float
    seed: int
    truth_rate_hz: float
    friction: float
    start_ns: int
    origin: Mapping[str, float]
    vehicles: Mapping[str, ScenarioVehicle]
    sensors: Mapping[str, Mapping[str, Any]]
    v2x: Mapping[str, Any] | None
    document: Mapping[str, Any]


def read_scenario_name_and_document(name_or_path: str | Path) -> tuple[str, dict[str, Any]]:
    """Read a scenario file, without checking its content.

    Args:
        name_or_path: The name of a scenario that comes with cwcli, or a file.

    Returns:
        The scenario's name and the file's content.

    Raises:
        UsageError: No such scenario or file, or not TOML.
    """
    text_name = str(name_or_path)
    if text_name in scenario_names():
        source, text = f"{text_name}.toml", scenario_text(text_name)
    else:
        path = Path(name_or_path)
        if not is_file(path):
            raise UsageError(
                f"no scenario and no file is named {text_name!r}",
                found=tuple(scenario_names()),
                hint=f"name one of these, a rendered drive ({', '.join(ROAD_SCENARIOS)}), or a scenario file",
            )
        source, text = path.name, _read_scenario_file(path)
    try:
        return source.removesuffix(".toml"), parse_toml(text)
    except ValueError as error:  # TOMLDecodeError is a ValueError; so is a number of 5000 digits
        raise UsageError(f"not TOML: {error}", where=source) from error


def load_scenario(name_or_path: str | Path, overrides: tuple[str, ...] = ()) -> Scenario:
    """Read a scenario, apply overrides such as `host.speed_mps=12`, and check it.

    Raises:
        UsageError: No such scenario, not TOML, a wrong override, or wrong content.
    """
    name, document = read_scenario_name_and_document(name_or_path)
    for text in overrides:
        document = with_override(document, text)
    return parse_scenario(document, name=name)


def with_override(document: Mapping[str, Any], text: str) -> dict[str, Any]:
    """Return a copy of a scenario document with one value replaced.

    Args:
        document: A scenario file's content.
        text: `key.key=value`. The first key may be a vehicle's name (`host.speed_mps=12` stands for
            `vehicles.host.speed_mps=12`), a list is entered by index from 0 (`lead.longitudinal.1.accel_mps2=-4`), and
            the value is written as in TOML; what isn't TOML is taken as text.

    Raises:
        UsageError: No `=`, or a key that leads through something else than a table or list.
    """
    path, equals, value_text = text.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        raise UsageError(f"--set {text!r} is not of the form key.key=value", hint="for example --set host.speed_mps=12")
    changed = deepcopy(dict(document))
    if keys[0] not in changed and keys[0] in changed.get("vehicles", {}):
        keys = ["vehicles", *keys]
    place: Any = changed
    for key in keys[:-1]:
        place = _child_table_or_list(place, key, text)
    last = keys[-1]
    if isinstance(place, list):
        place[_parse_list_index(place, last, text)] = _parse_toml_value(value_text.strip())
    elif isinstance(place, dict):
        place[last] = _parse_toml_value(value_text.strip())
    else:
        raise UsageError(f"--set {text!r}: {'.'.join(keys[:-1])} is a value, not a table")
    return changed


def parse_scenario(document: Mapping[str, Any], *, name: str) -> Scenario:
    """Check a scenario file's content.

    Args:
        name: Name of the scenario; error messages name `<name>.toml`.

    Raises:
        UsageError: One line with file, key and permitted range, for: unknown keys, wrong types, values out of range,
            profiles with a gap, too short segments, reverse driving, more acceleration than friction allows.
    """
    source = f"{name}.toml"
    top = check_scenario_table(
        document,
        SCENARIO_TOP_LEVEL_KEYS,
        path="",
        source=source,
        others=("start_time", "origin", "vehicles", "sensors", "v2x"),
    )
    sensor_tables = document.get("sensors", {})
    if not isinstance(sensor_tables, Mapping):
        raise toml_value_error(source, "sensors", f"is {sensor_tables!r}", "a table")
    known = {**SENSOR_KEYS, **DETECTOR_KEYS}
    for sensor in sensor_tables:
        if sensor not in known:
            raise toml_value_error(source, f"sensors.{sensor}", "is unknown", ", ".join(known))
    v2x = document.get("v2x")
    return Scenario(
        name=name,
        start_ns=_read_start_ns(document.get("start_time", DEFAULT_START_TIME), source),
        origin=MappingProxyType(
            check_scenario_table(document.get("origin", {}), ORIGIN_KEYS, path="origin", source=source)
        ),
        vehicles=MappingProxyType(_read_vehicles(document.get("vehicles"), top, source)),
        sensors=MappingProxyType(
            {
                sensor: MappingProxyType(
                    check_scenario_table(table, known[sensor], path=f"sensors.{sensor}", source=source)
                )
                for sensor, table in sensor_tables.items()
            }
        ),
        v2x=None if v2x is None else MappingProxyType(check_scenario_table(v2x, V2X_KEYS, path="v2x", source=source)),
        document=document,
        **top,
    )


def _read_vehicles(tables: Any, top: Mapping[str, Any], source: str) -> dict[str, ScenarioVehicle]:
    """Check the table of vehicles, and that station ids differ; the host comes first."""
    if not isinstance(tables, Mapping) or EGO_VEHICLE_KEY not in tables:
        raise toml_value_error(source, f"vehicles.{EGO_VEHICLE_KEY}", "is missing", "a table: the ego vehicle")
    if len(tables) * top["duration_s"] > MAX_VEHICLE_SECONDS:
        what = f"has {len(tables)} tables, for {top['duration_s']:g} s"
        raise toml_value_error(source, "vehicles", what, f"{MAX_VEHICLE_SECONDS:,} s of all vehicles together")
    vehicles = {
        name: _read_vehicle(name, tables[name], top, source)
        for name in (EGO_VEHICLE_KEY, *(key for key in tables if key != EGO_VEHICLE_KEY))
    }
    owners: dict[str, str] = {}
    for vehicle in vehicles.values():
        other = owners.setdefault(vehicle.station_id, vehicle.name)
        if other != vehicle.name:
            raise toml_value_error(
                source, f"vehicles.{vehicle.name}.station_id", f"is also that of {other}", "an id of its own"
            )
    return vehicles


def _read_vehicle(name: str, table: Any, top: Mapping[str, Any], source: str) -> ScenarioVehicle:
    """Check the table of one vehicle and integrate its motion."""
    path = f"vehicles.{name}"
    if not _VEHICLE_NAME_PATTERN.fullmatch(name):
        raise toml_value_error(source, path, "is no name", "lower-case letters, digits, - and _")
    values = check_scenario_table(table, VEHICLE_KEYS, path=path, source=source, others=("longitudinal", "lateral"))
    profile = read_motion_profile(
        table.get("longitudinal"),
        table.get("lateral"),
        speed_mps=values["speed_mps"],
        end_s=top["duration_s"],
        path=path,
        source=source,
    )
    motion = TrueMotion(
        profile, x_m=values["x_m"], y_m=values["y_m"], heading_rad=float(np.radians(values["heading_deg"]))
    )
    check_motion_is_drivable(
        motion,
        end_s=top["duration_s"],
        friction=top["friction"],
        turning_radius_m=values["turning_radius_m"],
        path=path,
        source=source,
    )
    station_id = values["station_id"] or f"{zlib.crc32(name.encode()):08x}"
    if not _STATION_ID_PATTERN.fullmatch(station_id):
        raise toml_value_error(
            source, f"{path}.station_id", f"is {station_id!r}", "eight lower-case hexadecimal digits"
        )
    attitude = Attitude(values["slope_deg"], values["bounce_deg"], values["squat_degpmps2"], name)
    return ScenarioVehicle(name, station_id, motion, attitude, values["length_m"], values["width_m"], values["v2x"])


def _read_start_ns(value: Any, source: str) -> int:
    """The start time as ns since 1970; refuse what is no date and time with offset."""
    if isinstance(value, str):  # as JSON holds it
        with suppress(ValueError):
            value = datetime.fromisoformat(value)
    if not isinstance(value, datetime) or value.tzinfo is None:
        raise toml_value_error(
            source, "start_time", f"is {value!r}", "a date and time with offset, e.g. 2016-10-01T08:00:00Z"
        )
    since = value - _UNIX_EPOCH
    nanoseconds = ((since.days * 86_400 + since.seconds) * 1_000_000 + since.microseconds) * 1_000
    if nanoseconds < 0:
        raise toml_value_error(source, "start_time", f"is {value}", "1970 or later")
    return nanoseconds


def _read_scenario_file(path: Path) -> str:
    """Read a scenario file as text; refuse one that can't be read."""
    try:
        return read_file(path).decode()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"can't be read: {error}", where=path.name) from error


def _child_table_or_list(place: Any, key: str, text: str) -> Any:
    """The entry of a list, or the table of a table (made if missing), under a key."""
    if isinstance(place, list):
        return place[_parse_list_index(place, key, text)]
    if isinstance(place, dict):
        return place.setdefault(key, {})
    raise UsageError(f"--set {text!r}: {key} is inside a value, not a table")


def _parse_list_index(place: list[Any], key: str, text: str) -> int:
    """Parse the index of a list's entry; refuse one outside the list."""
    if not key.isdecimal() or int(key) >= len(place):
        raise UsageError(f"--set {text!r}: {key} is not an entry of the list; permitted: 0 to {len(place) - 1}")
    return int(key)


def _parse_toml_value(text: str) -> Any:
    """Parse text as a TOML value; text that is no TOML stays text."""
    try:
        return parse_toml(f"value = {text}")["value"]
    except ValueError:
        return text
