"""The event flags of BSMs (part II, VehicleSafetyExtensions.events), whatever form the message has.

- `{"eventHardBraking": true, ...}`: JSON of the USDOT Operational Data Environment;
- `"0000000100000"` or `"0100"`: bits or octets as text, the first flag first, bare or as `value` of an object (JER);
- a number of 13 bits, the first flag the highest: what `signals.radio` decodes;
- `j2735_v2x_msgs/VehicleEventFlags`: a sum of the message's own constants, which begin at the second flag: hazard
  lights are 0 there and can't be recognised.

Part II is a list of extensions, of which one at most has flags.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from cwcli.signals.columns import (
    BoolArray,
    Columns,
    Field,
    FloatArray,
    Int64Array,
    Ragged,
    Strings,
    repeat_string,
    sort_distinct_values,
)
from cwcli.signals.leaf_fields import numbers_to_bit_flags
from cwcli.signals.road_events import HARD_BRAKING_KIND, RoadEvents, join_road_events

EVENT_FLAG_NAMES = (
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
"""The names of the 13 flags of VehicleEventFlags (SAE J2735), from the highest bit to the lowest."""
N_EVENT_FLAGS = len(EVENT_FLAG_NAMES)
"""The number of event flags (13)."""
HARD_BRAKING_FLAG_NAME = "eventHardBraking"
"""The name of the flag with which a sender reports that it brakes with more than 0.4 g (SAE J2735)."""

JSON_PATHS_OF_CODED_EVENT_FLAGS = ("partII.partII-Value.events", "partII.partII-Value.VehicleSafetyExtensions.events")
"""The paths at which a JSON BSM has all flags in one text or number, directly or as `value`."""
JSON_PARENT_PATHS_OF_SEPARATE_EVENT_FLAG_FIELDS = (
    "payload.data.partII.value.events",
    "partII.value.events",
    "partII.partII-Value.events",
)
"""The paths below which a JSON message has each flag as a field of its own."""
_ROS_EXTENSIONS_PREFIX = "part_ii.vehicle_safety_extensions."
"""The path prefix of the vehicle safety extensions in a ROS BSM."""
ROS_FLAGS_PATH = _ROS_EXTENSIONS_PREFIX + "events.vehicle_event_flag"
"""The path of the flags in a ROS BSM."""
ROS_FIELD_PATH_OF_PRESENCE_BITS = _ROS_EXTENSIONS_PREFIX + "presence_vector"
"""The path of the bits that say which extensions a ROS BSM has."""
ROS_EVENT_FLAG_PATHS = (ROS_FLAGS_PATH, ROS_FIELD_PATH_OF_PRESENCE_BITS)
"""The leaf fields that hold the event flags of a ROS BSM."""
EVENTS_PRESENT_BIT = 1
"""The bit of the presence field that says that the extension has event flags."""
FLAG_NAMES_BY_ROS_BIT = {1 << (k - 1): flag for k, flag in enumerate(EVENT_FLAG_NAMES) if k}
"""The flag name for each constant of the ROS message: EVENT_STOP_LINE_VIOLATION is 1, EVENT_HARD_BRAKING 64."""
FLAGS_OF_UNREADABLE_TEXT = -1
"""The result for a text that holds no flags; no combination of flags is negative."""
_BIT_TEXT_PATTERN, _HEX_TEXT_PATTERN = re.compile(r"[01]{13,}"), re.compile(r"[0-9A-Fa-f]{4}")
"""The form of flags as a text of 13 or more bits and of two octets in hexadecimal."""


def json_event_flag_paths(prefixes: tuple[str, ...]) -> tuple[str, ...]:
    """Return the paths of every leaf in which a JSON BSM behind one of the prefixes can have its event flags."""
    return (
        *_coded_flags_paths(prefixes),
        *(f"{place}.{flag}" for place in JSON_PARENT_PATHS_OF_SEPARATE_EVENT_FLAG_FIELDS for flag in EVENT_FLAG_NAMES),
    )


def read_json_event_flags_and_unreadable(columns: Columns, prefixes: tuple[str, ...]) -> tuple[Int64Array, BoolArray]:
    """Return the 13 flags of each message (n,) as bits, 0 where there are none, and which messages (n,) can't be
    read."""
    n = len(columns)
    found, is_unread = np.zeros(n, np.int64), np.zeros(n, np.bool_)
    for path in _coded_flags_paths(prefixes):
        flags, is_odd = _decode_coded_flags_and_unreadable(columns.fields.get(path), n)
        found, is_unread = found | flags, is_unread | is_odd
    for place in JSON_PARENT_PATHS_OF_SEPARATE_EVENT_FLAG_FIELDS:
        for k, flag in enumerate(EVENT_FLAG_NAMES):
            is_set, is_odd = _read_single_flag_and_unreadable(columns.fields.get(f"{place}.{flag}"), n)
            found, is_unread = found | is_set.astype(np.int64) << (N_EVENT_FLAGS - 1 - k), is_unread | is_odd
    return found, is_unread


def read_ros_event_flags_and_unreadable(columns: Columns) -> tuple[Int64Array, BoolArray]:
    """Return the 13 flags of each message (n,) of a ROS channel as bits, and which messages (n,) can't be read.

    A message is unread that has flags, and does not tell of each of its extensions whether it has some.
    """
    n = len(columns)
    found = np.zeros(n, np.int64)
    rows, values = _finite_elements_with_rows(columns.fields.get(ROS_FLAGS_PATH), n)
    has_rows, has = _finite_elements_with_rows(columns.fields.get(ROS_FIELD_PATH_OF_PRESENCE_BITS), n)
    is_told = np.bincount(rows, minlength=n) == np.bincount(has_rows, minlength=n)
    is_unread = np.zeros(n, np.bool_)
    is_unread[rows[(values != 0.0) & ~is_told[rows]]] = True
    rows, values, has = rows[is_told[rows]], values[is_told[rows]], has[is_told[has_rows]]
    event_bits = np.where(numbers_to_bit_flags(has) & EVENTS_PRESENT_BIT, numbers_to_bit_flags(values), 0)
    for bit, flag in FLAG_NAMES_BY_ROS_BIT.items():
        np.bitwise_or.at(found, rows[(event_bits & bit) != 0], 1 << (N_EVENT_FLAGS - 1 - EVENT_FLAG_NAMES.index(flag)))
    return found, is_unread


def events_from_flag_bits(
    codes: Int64Array,
    station: Strings,
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    latitude_deg: FloatArray,
    longitude_deg: FloatArray,
) -> RoadEvents:
    """Return one event for each set flag of each message; it is valid at its stamp only. All arguments have n rows."""
    of_flags = []
    for k, name in enumerate(EVENT_FLAG_NAMES):
        rows = np.flatnonzero(codes & (1 << (N_EVENT_FLAGS - 1 - k)))
        if len(rows):
            kind = repeat_string(HARD_BRAKING_KIND if name == HARD_BRAKING_FLAG_NAME else name, len(rows))
            nothing = np.full(len(rows), np.nan)
            times = stamp_ns[rows], log_time_ns[rows], stamp_ns[rows]
            place = latitude_deg[rows], longitude_deg[rows]
            of_flags.append(RoadEvents(station.select_rows(rows), kind, *times, nothing, nothing, *place, nothing))
    return join_road_events(of_flags)


def format_flag_notes(events: RoadEvents, is_unread: BoolArray) -> tuple[str, ...]:
    """Return notes on how many messages of how many stations flag hard braking, and how many flags can't be read.

    Args:
        events: Flags of BSMs; events of DENMs are ignored here.
        is_unread: Which messages have flags that can't be read.
    """
    names = np.array([*(name == HARD_BRAKING_KIND for name in events.kind.values), False])
    rows = np.flatnonzero(names[events.kind.codes] & np.isnan(events.cause))
    notes = []
    if len(rows):
        n_stations = len(sort_distinct_values(events.station.codes[rows]))
        notes.append(f"{len(rows)} messages of {n_stations} stations flag hard braking (over 0.4 g)")
    if is_unread.any():
        n_unread = np.count_nonzero(is_unread)
        notes.append(f"the event flags of {n_unread} messages can't be read and are left out")
    return tuple(notes)


def _coded_flags_paths(prefixes: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(
        prefix + place + end
        for prefix in prefixes
        for place in JSON_PATHS_OF_CODED_EVENT_FLAGS
        for end in ("", ".value")
    )


def _decode_coded_flags_and_unreadable(field: Field | None, n: int) -> tuple[Int64Array, BoolArray]:
    """Return flags (n,) from a field of 13-bit numbers or texts, and which rows (n,) hold neither."""
    if isinstance(field, Strings):
        flags = np.array([*(_flag_bits_from_text(text) for text in field.values), 0], np.int64)[field.codes]
        return np.maximum(flags, 0), flags == FLAGS_OF_UNREADABLE_TEXT
    found, is_unread = np.zeros(n, np.int64), _has_non_numeric_value(field, n)
    rows, values = _finite_elements_with_rows(field, n)
    is_code = (values >= 0) & (values < 1 << N_EVENT_FLAGS) & (values == np.floor(values))
    if _value_dtype(field) == np.bool_:
        is_code[:] = False
    elif _value_dtype(field) != np.int64:
        is_code &= values != 1.0  # a truth value beside what is absent is the same
    np.bitwise_or.at(found, rows[is_code], values[is_code].astype(np.int64))
    is_unread[rows[~is_code]] = True
    return found, is_unread


def _flag_bits_from_text(text: str) -> int:
    if _BIT_TEXT_PATTERN.fullmatch(text):
        return int(text[:N_EVENT_FLAGS], 2)
    if _HEX_TEXT_PATTERN.fullmatch(text):
        return int(text, 16) >> (16 - N_EVENT_FLAGS)
    return FLAGS_OF_UNREADABLE_TEXT


def _read_single_flag_and_unreadable(field: Field | None, n: int) -> tuple[BoolArray, BoolArray]:
    if isinstance(field, Strings):
        words = [text.lower() for text in field.values]
        is_true = np.array([*(word == "true" for word in words), False])
        is_odd = np.array([*(word not in ("true", "false") for word in words), False])
        return is_true[field.codes], is_odd[field.codes]
    found = np.zeros(n, np.bool_)
    rows, values = _finite_elements_with_rows(field, n)
    found[rows[values != 0.0]] = True
    return found, _has_non_numeric_value(field, n)


def _value_dtype(field: Field | None) -> np.dtype[Any] | None:
    """Return the type of a field's numbers, or None where it holds none."""
    if isinstance(field, Ragged):
        return field.values.dtype
    return field.dtype if isinstance(field, np.ndarray) else None


def _has_non_numeric_value(field: Field | None, n: int) -> BoolArray:
    """Return which messages (n,) hold a null or a text among numbers; outside lists these look like absent values."""
    found = np.zeros(n, np.bool_)
    if isinstance(field, Ragged):
        found[np.repeat(np.arange(n), np.diff(field.offsets))[~np.isfinite(field.values)]] = True
    elif isinstance(field, np.ndarray) and field.ndim > 1 and len(field) == n:
        found[:] = ~np.isfinite(field).all(axis=tuple(range(1, field.ndim)))
    return found


def _finite_elements_with_rows(field: Field | None, n: int) -> tuple[Int64Array, FloatArray]:
    """Return the row and the value of each finite number of a field, whatever their number per message."""
    rows = np.arange(n, dtype=np.int64)
    values = np.zeros(0)
    if isinstance(field, Ragged):
        rows, values = np.repeat(rows, np.diff(field.offsets)), field.values.astype(np.float64)
    elif isinstance(field, np.ndarray) and len(field) == n:
        rows, values = np.repeat(rows, field.size // max(n, 1)), field.astype(np.float64).ravel()
    known = np.isfinite(values)
    return rows[: len(values)][known], values[known]
