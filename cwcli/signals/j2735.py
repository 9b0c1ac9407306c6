"""SAE J2735 Basic Safety Messages, in four formats.

- raw integers, JSON with the standard's names (`BasicSafetyMessage`, also inside an ODE record or a MessageFrame);
- raw integers, `j2735_v2x_msgs/BSM`;
- decoded units, the JSON of the USDOT Operational Data Environment (`OdeBsmData`);
- decoded units with presence flags, `carma_v2x_msgs/BSM`.

Codes after SAE J2735. docs/v2x.md shows the table; a test compares the two.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals import bsm_flags
from cwcli.signals.angles import heading_from_compass_deg
from cwcli.signals.canonical import MESSAGE_COUNT_MODULUS
from cwcli.signals.columns import BoolArray, Columns, FloatArray, Int64Array, Strings, absent_strings
from cwcli.signals.covariances import east_north_covariance_from_ellipse
from cwcli.signals.leaf_fields import accepted_text_mask, numbers_to_bit_flags, read_numbers, read_texts
from cwcli.signals.quality import RowLedger
from cwcli.signals.road_events import RoadEvents
from cwcli.signals.v2x_codec import RemoteRows, Senders, V2xCodec, make_remote_rows
from cwcli.signals.v2x_elements import decode_codes_to_values, nan_unless_a_code_could_express
from cwcli.signals.v2x_tables import load_message_table, parse_presence_bits
from cwcli.signals.v2x_time import message_times_or_log_times_ns, stamps_ns_and_validity_from_dsecond

_BSM_QUANTITY_TABLE = load_message_table("bsm", "sae")
"""The quantities of a BSM: their data elements, and their paths per encoding."""
DATA_ELEMENTS_BY_BSM_QUANTITY = _BSM_QUANTITY_TABLE.elements
"""The data element of each coded quantity of a BSM (SAE J2735)."""
STANDARD_JSON_PATHS_BY_QUANTITY, ROS_PATHS = _BSM_QUANTITY_TABLE.columns["json"], _BSM_QUANTITY_TABLE.columns["ros"]
"""The leaf fields of a JSON BSM with the standard's names and codes, and those of `j2735_v2x_msgs/BSM` and
`carma_v2x_msgs/BSM`, by quantity."""
JSON_ODE_PATHS = STANDARD_JSON_PATHS_BY_QUANTITY | _BSM_QUANTITY_TABLE.columns["ode"]
"""The leaf fields of a BSM of the USDOT Operational Data Environment (ODE), by quantity."""
CARMA_PRESENCE_MASKS = parse_presence_bits(_BSM_QUANTITY_TABLE.columns["carma_flags"])
"""The presence flags of `carma_v2x_msgs`: (quantity, path of the field of flags, mask of the bit that is set when the
value is there)."""
MIN_POSITION_ACCURACY_SEMI_AXIS_M = 0.05
"""The least semi-axis of the position accuracy, in metres: a code of 0 means less than one step and counts as one."""
REVERSE_GEARS_CODE = 3
"""The code of TransmissionState for reverse gears."""

JSON_BSM_PREFIXES = (
    "",
    "BasicSafetyMessage.",
    "value.BasicSafetyMessage.",
    "MessageFrame.value.BasicSafetyMessage.",
    "payload.data.",
    "payload.data.value.BasicSafetyMessage.",
    "payload.data.MessageFrame.value.BasicSafetyMessage.",
)
"""The path prefixes behind which a JSON message can have a BSM."""
REVERSE_GEAR_AS_OBJECT_PATHS = ("coreData.transmission.reverseGears", "coreData.transmission.REVERSEGEARS")
"""The leaf fields of an enumeration written as an object (`{"reverseGears": ""}`), as in JSON made from XER."""
ODE_SOURCE_PATH = "metadata.bsmSource"
"""The leaf field in which the ODE says who sent a BSM."""
ODE_SOURCE_OF_EGO = "ev"
"""The text of that field for the recording vehicle, in lower case."""
M_PER_ODE_SIZE_STEP = 0.01
"""One step of a vehicle size in the ODE's messages, in metres."""
QUANTITIES_OF_EVENT_FLAG_PLACE_AND_TIME = ("latitude_deg", "longitude_deg", "dsecond_ms")
"""The quantities that give place and time of an event flag."""
JSON_LEAF_FIELDS = (
    ODE_SOURCE_PATH,
    *dict.fromkeys(
        prefix + leaf
        for prefix in JSON_BSM_PREFIXES
        for leaf in (*STANDARD_JSON_PATHS_BY_QUANTITY.values(), *JSON_ODE_PATHS.values(), *REVERSE_GEAR_AS_OBJECT_PATHS)
    ),
    *bsm_flags.json_event_flag_paths(JSON_BSM_PREFIXES),
)
"""The leaf fields in which a JSON message can have a BSM."""
ROS_LEAF_FIELDS = (*ROS_PATHS.values(), *bsm_flags.ROS_EVENT_FLAG_PATHS)
"""The leaf fields of `j2735_v2x_msgs/BSM` that are read."""
CARMA_LEAF_FIELDS = (*ROS_LEAF_FIELDS, *dict.fromkeys(path for _, path, _ in CARMA_PRESENCE_MASKS))
"""The leaf fields of `carma_v2x_msgs/BSM` that are read."""


def identify_json_senders(columns: Columns) -> Senders:
    """Return the senders of a JSON channel; the ODE says which messages the ego sent (`bsmSource` EV)."""
    return _read_json_or_ros_senders(
        columns, *(prefix + STANDARD_JSON_PATHS_BY_QUANTITY["station"] for prefix in JSON_BSM_PREFIXES)
    )


def identify_ros_senders(columns: Columns) -> Senders:
    """Return the senders of a ROS channel; an id is four octets in hexadecimal."""
    return _read_json_or_ros_senders(columns, ROS_PATHS["station"])


def decode_json_bsm(columns: Columns, ledger: RowLedger) -> RemoteRows:
    """Decode a JSON channel, in codes or in units, as its field names tell (`lat`, or `position.latitude`)."""
    for prefix in JSON_BSM_PREFIXES:
        if prefix + JSON_ODE_PATHS["latitude_deg"] in columns.fields:
            return _remote_rows_from_ode_units(columns, ledger, prefix)
        if prefix + STANDARD_JSON_PATHS_BY_QUANTITY["latitude_deg"] in columns.fields:
            return _remote_rows_from_raw_codes(
                columns, ledger, {name: prefix + leaf for name, leaf in STANDARD_JSON_PATHS_BY_QUANTITY.items()}, prefix
            )
    return _remote_rows_from_raw_codes(columns, ledger, STANDARD_JSON_PATHS_BY_QUANTITY, "")


def decode_ros_bsm(columns: Columns, ledger: RowLedger) -> RemoteRows:
    """Decode a `j2735_v2x_msgs/BSM` channel (raw integers)."""
    return _remote_rows_from_raw_codes(columns, ledger, ROS_PATHS, "")


def decode_carma_bsm(columns: Columns, ledger: RowLedger) -> RemoteRows:
    """Decode a `carma_v2x_msgs/BSM` channel: degrees, metres, m/s, degrees/s, J2735's signs, and presence flags."""
    return _make_bsm_rows(columns, ledger, _validate_decoded_values(_read_carma_values(columns), ledger), ROS_PATHS, "")


def _read_carma_values(columns: Columns) -> dict[str, FloatArray]:
    """Read the values that the presence flags say are there."""
    value = {name: read_numbers(columns, ROS_PATHS[name]) for name in (*DATA_ELEMENTS_BY_BSM_QUANTITY, "dsecond_ms")}
    for name, path, bit in CARMA_PRESENCE_MASKS:
        flags = read_numbers(columns, path)
        is_there = (numbers_to_bit_flags(flags) & bit) != 0
        value[name] = np.where(is_there, value[name], np.nan)
    return value


def read_json_flag_events_and_unreadable(columns: Columns) -> tuple[RoadEvents, BoolArray]:
    """Read the event flags of a JSON channel with place and time, and which messages' flags can't be read."""
    paths = STANDARD_JSON_PATHS_BY_QUANTITY
    for prefix in JSON_BSM_PREFIXES:
        for each in (STANDARD_JSON_PATHS_BY_QUANTITY, JSON_ODE_PATHS):
            if prefix + each["latitude_deg"] in columns.fields:
                paths = {name: prefix + leaf for name, leaf in each.items()}
    value = {name: read_numbers(columns, paths[name]) for name in QUANTITIES_OF_EVENT_FLAG_PLACE_AND_TIME}
    if paths["latitude_deg"].endswith(STANDARD_JSON_PATHS_BY_QUANTITY["latitude_deg"]):
        value = _decode_place_codes_of_events(value)
    return _make_flag_events_and_unreadable(
        columns,
        bsm_flags.read_json_event_flags_and_unreadable(columns, JSON_BSM_PREFIXES),
        identify_json_senders(columns).station,
        value,
    )


def read_ros_flag_events_and_unreadable(columns: Columns) -> tuple[RoadEvents, BoolArray]:
    """Read the event flags of a `j2735_v2x_msgs/BSM` channel."""
    value = _decode_place_codes_of_events(
        {name: read_numbers(columns, ROS_PATHS[name]) for name in QUANTITIES_OF_EVENT_FLAG_PLACE_AND_TIME}
    )
    return _make_flag_events_and_unreadable(
        columns, bsm_flags.read_ros_event_flags_and_unreadable(columns), identify_ros_senders(columns).station, value
    )


def read_carma_flag_events_and_unreadable(columns: Columns) -> tuple[RoadEvents, BoolArray]:
    """Read the event flags of a `carma_v2x_msgs/BSM` channel."""
    return _make_flag_events_and_unreadable(
        columns,
        bsm_flags.read_ros_event_flags_and_unreadable(columns),
        identify_ros_senders(columns).station,
        _read_carma_values(columns),
    )


def _decode_place_codes_of_events(raw_by_quantity: dict[str, FloatArray]) -> dict[str, FloatArray]:
    return {
        name: decode_codes_to_values(DATA_ELEMENTS_BY_BSM_QUANTITY[name], raw)
        if name in DATA_ELEMENTS_BY_BSM_QUANTITY
        else raw
        for name, raw in raw_by_quantity.items()
    }


def _make_flag_events_and_unreadable(
    columns: Columns, flags: tuple[Int64Array, BoolArray], station: Strings, values_by_quantity: dict[str, FloatArray]
) -> tuple[RoadEvents, BoolArray]:
    """Build one event for each flag, at its message's time (log time where it has none) and place (degrees)."""
    stamp_ns, has_time = stamps_ns_and_validity_from_dsecond(values_by_quantity["dsecond_ms"], columns.log_time_ns)
    stamp_ns = np.where(has_time, stamp_ns, columns.log_time_ns)
    place = values_by_quantity["latitude_deg"], values_by_quantity["longitude_deg"]
    codes, is_unread = flags
    return bsm_flags.events_from_flag_bits(codes, station, stamp_ns, columns.log_time_ns, *place), is_unread


def _remote_rows_from_ode_units(columns: Columns, ledger: RowLedger, prefix: str) -> RemoteRows:
    """Decode the ODE's units: degrees, metres, m/s, m/s^2, degrees/s, size in cm; null where unavailable."""
    paths = {name: prefix + leaf for name, leaf in JSON_ODE_PATHS.items()}
    value = {name: read_numbers(columns, paths[name]) for name in (*DATA_ELEMENTS_BY_BSM_QUANTITY, "dsecond_ms")}
    for name in ("width_m", "length_m"):
        value[name] = np.where(value[name] > 0, value[name] * M_PER_ODE_SIZE_STEP, np.nan)
    return _make_bsm_rows(columns, ledger, _validate_decoded_values(value, ledger), paths, prefix)


def _remote_rows_from_raw_codes(columns: Columns, ledger: RowLedger, paths: dict[str, str], prefix: str) -> RemoteRows:
    value = {
        name: decode_codes_to_values(element, read_numbers(columns, paths[name]), ledger)
        for name, element in DATA_ELEMENTS_BY_BSM_QUANTITY.items()
    }
    value["dsecond_ms"] = read_numbers(columns, paths["dsecond_ms"])
    return _make_bsm_rows(columns, ledger, value, paths, prefix)


def _validate_decoded_values(values_by_quantity: dict[str, FloatArray], ledger: RowLedger) -> dict[str, FloatArray]:
    """Return decoded values with cwcli's signs; those outside the standard's range become NaN and are counted."""
    return {
        name: nan_unless_a_code_could_express(DATA_ELEMENTS_BY_BSM_QUANTITY[name], array, ledger)
        if name in DATA_ELEMENTS_BY_BSM_QUANTITY
        else array
        for name, array in values_by_quantity.items()
    }


def _make_bsm_rows(
    columns: Columns, ledger: RowLedger, values_by_quantity: dict[str, FloatArray], paths: dict[str, str], prefix: str
) -> RemoteRows:
    """Build the canonical rows from values in degrees and metres with cwcli's signs."""
    count = read_numbers(columns, paths["count"])
    stamp_ns, has_time = stamps_ns_and_validity_from_dsecond(values_by_quantity["dsecond_ms"], columns.log_time_ns)
    yaw_unfilled = _unfilled_yaw_rate_mask(values_by_quantity, _read_stations(columns, paths["station"])) & ledger.keep
    if yaw_unfilled.any():
        ledger.add_note(f"{np.count_nonzero(yaw_unfilled)} messages have a yaw rate of 0 that counts as not measured")
    speed_mps = values_by_quantity["speed_mps"]
    return make_remote_rows(
        message_times_or_log_times_ns(ledger, stamp_ns, has_time),
        values_by_quantity,
        speed_mps=np.where(_reverse_gear_mask(columns, paths["transmission"], prefix), -speed_mps, speed_mps),
        heading_rad=heading_from_compass_deg(values_by_quantity["heading_compass_deg"]),
        yaw_rate_radps=np.deg2rad(np.where(yaw_unfilled, np.nan, values_by_quantity["yaw_rate_degps"])),
        position_covariance_m2=east_north_covariance_from_ellipse(
            np.maximum(values_by_quantity["semi_major_m"], MIN_POSITION_ACCURACY_SEMI_AXIS_M),
            np.maximum(values_by_quantity["semi_minor_m"], MIN_POSITION_ACCURACY_SEMI_AXIS_M),
            values_by_quantity["semi_major_compass_deg"],
        ),
        message_count=np.where((count >= 0) & (count < MESSAGE_COUNT_MODULUS), count, np.nan),
    )


def _read_json_or_ros_senders(columns: Columns, *paths: str) -> Senders:
    return Senders(
        station=_read_stations(columns, *paths),
        is_own=accepted_text_mask(read_texts(columns, ODE_SOURCE_PATH), len(columns), ODE_SOURCE_OF_EGO),
        is_roadside=np.zeros(len(columns), dtype=np.bool_),
    )


def _read_stations(columns: Columns, *paths: str) -> Strings:
    return read_texts(columns, *paths) or absent_strings(len(columns))


def _unfilled_yaw_rate_mask(values_by_quantity: dict[str, FloatArray], station: Strings) -> BoolArray:
    """Return where a yaw rate of 0 means that it is not measured.

    J2735 has no code for an unavailable yaw rate, and senders without a gyroscope send 0: a station that never sends
    anything else, or a message that has no acceleration either.
    """
    is_zero = values_by_quantity["yaw_rate_degps"] == 0.0
    has_no_accel = np.isnan(values_by_quantity["accel_mps2"]) & np.isnan(values_by_quantity["lateral_accel_mps2"])
    n_other = np.bincount(station.codes + 1, weights=~is_zero, minlength=len(station.values) + 1)
    n_zero = np.bincount(station.codes + 1, weights=is_zero, minlength=len(station.values) + 1)
    never_fills = (n_other == 0) & (n_zero > 1)
    unfilled: BoolArray = is_zero & (has_no_accel | never_fills[station.codes + 1])
    return unfilled


def _reverse_gear_mask(columns: Columns, path: str, prefix: str) -> BoolArray:
    """Return where the gear is reverse: as a name, as the number 3, or as an object with that name."""
    is_named = accepted_text_mask(read_texts(columns, path), len(columns), "reversegears", str(REVERSE_GEARS_CODE))
    as_object = read_texts(columns, *(prefix + leaf for leaf in REVERSE_GEAR_AS_OBJECT_PATHS))
    return is_named if as_object is None else is_named | (as_object.codes >= 0)


JSON_BSM_CODEC = V2xCodec(identify_json_senders, decode_json_bsm, events=read_json_flag_events_and_unreadable)
"""The codec of JSON channels of BSMs."""
ROS_BSM_CODEC = V2xCodec(identify_ros_senders, decode_ros_bsm, events=read_ros_flag_events_and_unreadable)
"""The codec of `j2735_v2x_msgs/BSM` channels."""
CARMA_BSM_CODEC = V2xCodec(identify_ros_senders, decode_carma_bsm, events=read_carma_flag_events_and_unreadable)
"""The codec of `carma_v2x_msgs/BSM` channels."""
