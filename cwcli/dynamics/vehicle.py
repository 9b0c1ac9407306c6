"""The parameters of a car, read from a TOML file and checked.

`vehicles/zhang2011.toml` is the paper's car (table 5) and shows every key. Errors are one line: file, key, what is
wrong, what is permitted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from cwcli.errors import InputError, UsageError
from cwcli.input import read_file
from cwcli.lazy_dataclass import dataclass
from cwcli.registry import bundled_file_stems
from cwcli.toml_text import parse_toml, require_number_in_range, toml_value_error

VEHICLE_FILE_SUFFIX = ".toml"
"""File name ending of vehicle files."""
DEFAULT_VEHICLE = "zhang2011"
"""Name of the shipped car that is assumed if none is given: that of zhang2011 (table 5)."""

RANGE_AND_UNIT_BY_VEHICLE_KEY: Mapping[str, tuple[float, float, str]] = {
    "front_axle_m": (0.1, 10.0, "m ahead of the centre of gravity"),
    "rear_axle_m": (0.1, 10.0, "m behind the centre of gravity"),
    "front_stiffness_nprad": (1e3, 1e7, "N/rad for the whole axle, positive"),
    "rear_stiffness_nprad": (1e3, 1e7, "N/rad for the whole axle, positive"),
    "yaw_inertia_kgm2": (10.0, 1e6, "kg m^2"),
    "width_m": (0.3, 4.0, "m"),
    "camera_forward_m": (-10.0, 10.0, "m ahead of the centre of gravity"),
}
"""Number keys of a vehicle file: lowest and highest permitted value, and the unit in words. Chosen by hand: wide enough
for all road vehicles, narrow enough to find a wrong unit or sign."""
OPTIONAL_KEY_DEFAULTS: Mapping[str, float] = {"width_m": 1.8, "camera_forward_m": 0.0}
"""Default values of the number keys that may be missing, m."""
LOADED_CAR_MASS_RANGE_KG = (50.0, 60_000.0)
"""Lowest and highest permitted mass of a load, kg. Chosen by hand, from an empty quadricycle to a lorry."""
LOAD_CHOICE_KEYS = ("load", "correction_load")
"""Keys of the table `use` of a vehicle file: the load of the model and that of the steering correction."""


@dataclass(frozen=True)
class Vehicle:
    """A car as the single-track model sees it.

    Attributes:
        name: Name in messages.
        front_axle_m, rear_axle_m: l_f and l_r, distances of the axles from the centre of gravity.
        front_stiffness_nprad, rear_stiffness_nprad: k_f and k_r, cornering stiffness of each axle.
        yaw_inertia_kgm2: I_zz.
        mass_kg: m, the mass of the chosen load.
        correction_mass_kg: The mass in f(v).
        load_kg: Load name -> mass.
        width_m: Width over the outsides of the front tyres.
        camera_forward_m: Distance of the camera ahead of the centre of gravity.
    """

    name: str
    front_axle_m: float
    rear_axle_m: float
    front_stiffness_nprad: float
    rear_stiffness_nprad: float
    yaw_inertia_kgm2: float
    mass_kg: float
    correction_mass_kg: float
    load_kg: Mapping[str, float] = field(default_factory=dict)
    width_m: float = OPTIONAL_KEY_DEFAULTS["width_m"]
    camera_forward_m: float = OPTIONAL_KEY_DEFAULTS["camera_forward_m"]

    @property
    def wheelbase_m(self) -> float:
        """The distance between the axles: L = l_f + l_r."""
        return self.front_axle_m + self.rear_axle_m

    def with_load(self, load: str) -> Vehicle:
        """The same car with another load of its file; the mass of f(v) stays.

        Raises:
            UsageError: The file has no such load.
        """
        if load not in self.load_kg:
            raise UsageError(f"load {load!r} is unknown; permitted: {', '.join(self.load_kg)}", where=self.name)
        return replace(self, mass_kg=self.load_kg[load])


def vehicle_names() -> tuple[str, ...]:
    """Names of the cars that come with cwcli."""
    return bundled_file_stems("cwcli.dynamics", "vehicles", VEHICLE_FILE_SUFFIX)


def load_vehicle(source: str | Path = DEFAULT_VEHICLE, *, load: str | None = None) -> Vehicle:
    """Load a shipped car by its name, or a car from a file.

    Args:
        source: A name of `vehicle_names()`, or a file whose name ends in `.toml`.
        load: A load of the file; None: the file's own choice.

    Raises:
        UsageError: The file's content is wrong, or there is no such car or load.
        InputError: The file can't be read.
    """
    text, where = _read_vehicle_text_and_name(source)
    try:
        table = parse_toml(text)
    except ValueError as error:  # TOMLDecodeError is a ValueError; so is a number of 5000 digits
        raise UsageError(f"not TOML: {error}", where=where) from None
    vehicle = vehicle_from_table(table, where)
    return vehicle if load is None else vehicle.with_load(load)


def vehicle_from_table(table: Mapping[str, Any], where: str) -> Vehicle:
    """Check the content of a vehicle file and return the car.

    Raises:
        UsageError: An unknown or missing key, a wrong type, a value outside its range.
    """
    known = ("name", *RANGE_AND_UNIT_BY_VEHICLE_KEY, "load_kg", "use")
    for key in table:
        if key not in known:
            raise toml_value_error(where, key, "is unknown", ", ".join(known))
    values = {key: _read_number(table, key, where) for key in RANGE_AND_UNIT_BY_VEHICLE_KEY}
    loads = _read_loads_kg(table.get("load_kg"), where)
    use = table.get("use", {})
    if not isinstance(use, Mapping):
        raise toml_value_error(where, "use", f"is {use!r}", "a table")
    for key in use:
        if key not in LOAD_CHOICE_KEYS:
            raise toml_value_error(where, f"use.{key}", "is unknown", ", ".join(LOAD_CHOICE_KEYS))
    first = next(iter(loads))
    chosen = {key: use.get(key, use.get("load", first)) for key in LOAD_CHOICE_KEYS}
    for key, load in chosen.items():
        if not isinstance(load, str) or load not in loads:
            raise toml_value_error(where, f"use.{key}", f"is {load!r}", ", ".join(loads))
    return Vehicle(
        name=str(table.get("name", where)),
        **values,
        mass_kg=loads[chosen["load"]],
        correction_mass_kg=loads[chosen["correction_load"]],
        load_kg=loads,
    )


def _read_vehicle_text_and_name(source: str | Path) -> tuple[str, str]:
    """Read the text of a shipped or other vehicle file; also return its name for messages."""
    if str(source) in vehicle_names():
        name = f"{source}{VEHICLE_FILE_SUFFIX}"
        return (files("cwcli.dynamics") / "vehicles" / name).read_text(encoding="utf-8"), name
    path = Path(source)
    if path.suffix != VEHICLE_FILE_SUFFIX:
        hint = f"a file ending in {VEHICLE_FILE_SUFFIX}, or one of: {', '.join(vehicle_names())}"
        raise UsageError(f"there is no vehicle '{source}'", hint=hint)
    try:
        return read_file(path).decode(), str(source)
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        reason = "not UTF-8 text" if isinstance(error, UnicodeDecodeError) else getattr(error, "strerror", str(error))
        raise InputError(f"can't be read: {reason}", where=str(source)) from None


def _read_number(table: Mapping[str, Any], key: str, where: str) -> float:
    """The checked number under a key, or its default if the key may be missing."""
    low, high, unit = RANGE_AND_UNIT_BY_VEHICLE_KEY[key]
    permitted = f"{low:g} to {high:g} {unit}"
    if key not in table:
        if key in OPTIONAL_KEY_DEFAULTS:
            return OPTIONAL_KEY_DEFAULTS[key]
        raise toml_value_error(where, key, "is missing", permitted)
    return require_number_in_range(table[key], low, high, where, key, permitted)


def _read_loads_kg(table: Any, where: str) -> dict[str, float]:
    """The checked mass of each load, kg."""
    if not isinstance(table, Mapping) or not table:
        raise toml_value_error(where, "load_kg", "is missing or empty", "a table of names and masses")
    low, high = LOADED_CAR_MASS_RANGE_KG
    permitted = f"{low:g} to {high:g} kg"
    return {
        str(name): require_number_in_range(mass, low, high, where, f"load_kg.{name}", permitted)
        for name, mass in table.items()
    }
