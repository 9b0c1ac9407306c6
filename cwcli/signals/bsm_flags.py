"""The event flags of BSMs (part II, VehicleSafetyExtensions.events), whatever form the message has.

- `{"eventHardBraking": true, ...}`: JSON of the USDOT Operational Data Environment;
- `"0000000100000"` or `"0080"`: bits or octets as text, the first flag first, bare or as `value` of an object (JER);
- a number of 13 bits, the first flag the highest: what `signals.radio.bsm` decodes;
- `j2735_v2x_msgs/VehicleEventFlags`: a sum of the message's own constants, which begin at the second flag: hazard
  lights are 0 there, and can't be told.

Part II is a list of extensions, of which one at most has flags.
"""

from __future__ import annotations

import re

import numpy as np

from cwcli.signals.columns import Columns, Field, FloatArray, Int64Array, Ragged, Strings, constant_strings
from cwcli.signals.leaf_fields import bits_of
from cwcli.signals.quality import BoolArray
from cwcli.signals.road_events import HARD_BRAKING, RoadEvents, joined_events

EVENT_FLAGS = (
    "eventHazardLights",
    "eventStopLineViolated",
    "eventABSactivated",
    "eventTractionControlLoss",
    "eventStabilityControlactivated",
    "eventHazardousMaterials",
    "eventReserved1",
    "eventHardBraking",
    "eventLightsChanged",
    "eventWipersChanged",
    "eventFlatTire",
    "eventDisabledVehicle",
    "eventAirBagDeployment",
)
"""Of VehicleEventFlags, the first one in the highest of the 13 bits."""
N_FLAGS = len(EVENT_FLAGS)
HARD_BRAKING_NAME = "eventHardBraking"
HARD_BRAKING_FLAG = 1 << (N_FLAGS - 1 - EVENT_FLAGS.index(HARD_BRAKING_NAME))
"""The sender brakes with more than 0.4 g."""

CODED = ("partII.partII-Value.events", "partII.partII-Value.VehicleSafetyExtensions.events")
"""Where a JSON BSM has them as text or number, itself or as `value`."""
NAMED = ("payload.data.partII.value.events", "partII.value.events", "partII.partII-Value.events")
"""Where a JSON message has them flag by flag."""
_EXTENSIONS = "part_ii.vehicle_safety_extensions."
ROS = _EXTENSIONS + "events.vehicle_event_flag"
ROS_PRESENCE = _EXTENSIONS + "presence_vector"
HAS_EVENTS = 1
ROS_BITS = {1 << (k - 1): flag for k, flag in enumerate(EVENT_FLAGS) if k}
"""Constant of the ROS message -> flag: EVENT_STOP_LINE_VIOLATION is 1, EVENT_HARD_BRAKING 64."""
_BITS, _OCTETS = re.compile(r"[01]{13,}"), re.compile(r"[0-9A-Fa-f]{4}")


def json_fields(prefixes: tuple[str, ...]) -> tuple[str, ...]:
    """Every leaf that a JSON BSM, which may lie behind some prefixes, can have its flags in."""
    return (*_coded_paths(prefixes), *(f"{place}.{flag}" for place in NAMED for flag in EVENT_FLAGS))


def json_flags(columns: Columns, prefixes: tuple[str, ...]) -> Int64Array:
    """The 13 flags of each message (n,) as bits, the first one the highest; 0 where it has none."""
    n = len(columns)
    found = np.zeros(n, np.int64)
    for path in _coded_paths(prefixes):
        found |= _coded(columns.fields.get(path), n)
    for place in NAMED:
        for k, flag in enumerate(EVENT_FLAGS):
            is_set = _is_set(columns.fields.get(f"{place}.{flag}"), n)
            found |= is_set.astype(np.int64) << (N_FLAGS - 1 - k)
    return found


def ros_fields() -> tuple[str, ...]:
    """Every leaf of a ROS BSM that its flags are in."""
    return (ROS, ROS_PRESENCE)


def ros_flags(columns: Columns) -> Int64Array:
    """The same of a ROS channel, of the extensions that say that they have flags."""
    n = len(columns)
    found = np.zeros(n, np.int64)
    rows, values = _elements(columns.fields.get(ROS), n)
    has_rows, has = _elements(columns.fields.get(ROS_PRESENCE), n)
    if np.array_equal(rows, has_rows):
        told = np.where(bits_of(has) & HAS_EVENTS, bits_of(values), 0)
        for bit, flag in ROS_BITS.items():
            np.bitwise_or.at(found, rows[(told & bit) != 0], 1 << (N_FLAGS - 1 - EVENT_FLAGS.index(flag)))
    return found


def flag_events(
    codes: Int64Array,
    station: Strings,
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    latitude_deg: FloatArray,
    longitude_deg: FloatArray,
) -> RoadEvents:
    """One event a flag and message; each holds for its own moment. All arguments have n rows."""
    of_flags = []
    for k, name in enumerate(EVENT_FLAGS):
        rows = np.flatnonzero(codes & (1 << (N_FLAGS - 1 - k)))
        if len(rows):
            kind = constant_strings(HARD_BRAKING if name == HARD_BRAKING_NAME else name, len(rows))
            nothing = np.full(len(rows), np.nan)
            times = stamp_ns[rows], log_time_ns[rows], stamp_ns[rows]
            place = latitude_deg[rows], longitude_deg[rows]
            of_flags.append(RoadEvents(station.rows(rows), kind, *times, nothing, nothing, *place, nothing))
    return joined_events(of_flags)


def hard_braking_note(codes: Int64Array, station: Strings) -> str:
    """How many messages of how many stations flag hard braking; "" where none does."""
    rows = np.flatnonzero(codes & HARD_BRAKING_FLAG)
    if not len(rows):
        return ""
    return f"{len(rows)} messages of {len(np.unique(station.codes[rows]))} stations flag hard braking (over 0.4 g)"


def _coded_paths(prefixes: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(prefix + place + end for prefix in prefixes for place in CODED for end in ("", ".value"))


def _coded(field: Field | None, n: int) -> Int64Array:
    """Numbers of 13 bits, or texts."""
    if isinstance(field, Strings):
        return np.array([*(_from_text(text) for text in field.values), 0], np.int64)[field.codes]
    found = np.zeros(n, np.int64)
    rows, values = _elements(field, n)
    is_code = (values >= 0) & (values < 1 << N_FLAGS) & (values == np.floor(values))
    np.bitwise_or.at(found, rows[is_code], values[is_code].astype(np.int64))
    return found


def _from_text(text: str) -> int:
    if _BITS.fullmatch(text):
        return int(text[:N_FLAGS], 2)
    if _OCTETS.fullmatch(text):
        return int(text, 16) >> (16 - N_FLAGS)
    return 0


def _is_set(field: Field | None, n: int) -> BoolArray:
    found = np.zeros(n, np.bool_)
    if isinstance(field, Strings):
        found[np.array([*(text.lower() == "true" for text in field.values), False])[field.codes]] = True
        return found
    rows, values = _elements(field, n)
    found[rows[values != 0.0]] = True
    return found


def _elements(field: Field | None, n: int) -> tuple[Int64Array, FloatArray]:
    """Row and value of each finite number of a field, however many a message has."""
    rows = np.arange(n, dtype=np.int64)
    values = np.zeros(0)
    if isinstance(field, Ragged):
        rows, values = np.repeat(rows, np.diff(field.offsets)), field.values.astype(np.float64)
    elif isinstance(field, np.ndarray) and len(field) == n:
        rows, values = np.repeat(rows, field.size // max(n, 1)), field.astype(np.float64).ravel()
    known = np.isfinite(values)
    return rows[: len(values)][known], values[known]
