"""SAE J3224 sensor data sharing: `j3224_v2x_msgs` and `carma_v2x_msgs/SensorDataSharingMessage`, and as received by
radio.

Offsets are north and east of the reference position (J3224's axes are north, east, down); the rest has the codes, units
and signs of a BSM. Confidences are bounds for 95 %. docs/v2x.md shows the table; a test compares the two.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from cwcli.signals import perceived
from cwcli.signals.angles import heading_from_compass_deg
from cwcli.signals.columns import Columns, FloatArray, absent_strings
from cwcli.signals.covariances import SIGMAS_PER_95_PERCENT_HALF_WIDTH, east_north_covariance_from_ellipse
from cwcli.signals.elements import Elements
from cwcli.signals.j2735 import MIN_POSITION_ACCURACY_SEMI_AXIS_M
from cwcli.signals.leaf_fields import read_numbers, read_texts
from cwcli.signals.quality import RowLedger
from cwcli.signals.v2x_codec import Objects, RemoteRows
from cwcli.signals.v2x_elements import decode_codes_to_values, nan_unless_a_code_could_express
from cwcli.signals.v2x_tables import Element, load_message_table, parse_presence_bits
from cwcli.signals.v2x_time import message_times_or_log_times_ns, stamps_ns_and_validity_from_dsecond

_SDSM_QUANTITY_TABLE = load_message_table("sdsm", "sae")
"""The quantities of an SDSM's sender and objects: their data elements, and their paths per encoding."""
DATA_ELEMENTS_BY_SDSM_QUANTITY = _SDSM_QUANTITY_TABLE.elements
"""The data element of each coded quantity of an SDSM (SAE J3224, SAE J2735)."""
SDSM_PATHS, ROS_PATHS = _SDSM_QUANTITY_TABLE.columns["packed"], _SDSM_QUANTITY_TABLE.columns["ros"]
"""The component of the packed message and the leaf field of the ROS messages, by quantity."""
OBJECTS_PATH, ROS_OBJECTS_PATH = "objects", "objects.detected_object_data"
"""The path of the list of objects in the packed message and in the ROS messages."""
STANDARD_NAME_AND_95_PERCENT_BOUNDS_BY_QUANTITY: dict[str, tuple[str, tuple[float, ...]]] = {
    "position_confidence": (
        "PositionConfidence",
        (500.0, 200.0, 100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01),
    ),
    "speed_confidence": ("SpeedConfidence", (100.0, 10.0, 5.0, 1.0, 0.1, 0.05, 0.01)),
    "heading_confidence": ("HeadingConfidence", (10.0, 5.0, 1.0, 0.1, 0.05, 0.01, 0.0125)),
    "accel_confidence": ("AccelerationConfidence", (100.0, 10.0, 5.0, 1.0, 0.1, 0.05, 0.01)),
    "yaw_rate_confidence": ("YawRateConfidence", (100.0, 10.0, 5.0, 1.0, 0.1, 0.05, 0.01)),
}
"""The standard's name and the 95 % bounds (m, m/s, degrees, m/s^2, degrees/s) by code from 1 on, by quantity; 0 is
unavailable."""

_OBJECT_TYPE_PATH = f"{ROS_OBJECTS_PATH}.detected_object_optional_data.choice"
"""The path of an object's type: 0 is a vehicle."""
MS_PER_S_IN_CARMA_TIME_OFFSETS = 1000.0
"""The milliseconds in a second; `carma_v2x_msgs` has time offsets in seconds."""
MAX_VALUE_OF_32_BIT_PRESENCE_FIELD = 2.0**32 - 1.0
"""The largest value of a presence field of 32 bits."""


def presence_quantities_paths_and_bits(*, is_carma: bool) -> list[tuple[str, str, int]]:
    """Return the presence fields: quantity, path, and the bit that is set when the value is there."""
    columns = ("ros_flags", "carma_flags") if is_carma else ("ros_flags",)
    return [bit for column in columns for bit in parse_presence_bits(_SDSM_QUANTITY_TABLE.columns[column])]


ROS_LEAF_FIELDS = (
    *ROS_PATHS.values(),
    *dict.fromkeys(path for _, path, _ in presence_quantities_paths_and_bits(is_carma=True)),
    *_SDSM_QUANTITY_TABLE.columns["carma_unavailable"].values(),
    _OBJECT_TYPE_PATH,
)
"""The leaf fields of the ROS messages that are read."""


def read_sdsm_objects(columns: Columns, *, is_carma: bool) -> Objects:
    """Read the objects of a `j3224_v2x_msgs` channel, as codes, or of a `carma_v2x_msgs` channel, in degrees, metres,
    m/s, m/s^2, degrees/s, ms and J3224's signs."""
    objects = Elements(columns, None, ROS_PATHS["delta_time_ms"])
    rows = objects.message_rows
    if not len(rows):
        return ()

    def read_leaf(path: str) -> FloatArray:
        if path.startswith(f"{ROS_OBJECTS_PATH}."):
            return objects.read_numbers(path)
        return read_numbers(columns, path)[rows]

    value = {name: read_leaf(path) for name, path in ROS_PATHS.items() if name != "station"}
    for name, path, bit in presence_quantities_paths_and_bits(is_carma=is_carma):
        flags = np.clip(np.nan_to_num(read_leaf(path)), 0.0, MAX_VALUE_OF_32_BIT_PRESENCE_FIELD).astype(np.int64)
        value[name] = np.where((flags & bit) != 0, value[name], np.nan)
    is_vehicle = read_leaf(_OBJECT_TYPE_PATH) == 0
    value |= {name: np.where(is_vehicle, value[name], np.nan) for name in ("width_m", "length_m")}
    if is_carma:
        for name, path in _SDSM_QUANTITY_TABLE.columns["carma_unavailable"].items():
            value[name] = np.where(read_leaf(path) != 0, np.nan, value[name])
        value["delta_time_ms"] = MS_PER_S_IN_CARMA_TIME_OFFSETS * value["delta_time_ms"]
    station = read_texts(columns, ROS_PATHS["station"]) or absent_strings(len(columns))
    per_object = columns.with_fields_of_rows(rows, {**value, "station": station.select_rows(rows)})
    return ((per_object, CARMA_OBJECT_CODEC if is_carma else CODED_OBJECT_CODEC),)


def _decode_objects(
    decode: Callable[[Element, FloatArray, RowLedger], FloatArray], columns: Columns, ledger: RowLedger
) -> RemoteRows:
    """Decode objects, one a row: with `decode` from codes, or from units with J3224's signs and ranges."""
    values_by_quantity = {
        name: decode(each, read_numbers(columns, name), ledger) for name, each in DATA_ELEMENTS_BY_SDSM_QUANTITY.items()
    }
    sigma = {
        name: _bound_of_each_code_or_nan(bounds, read_numbers(columns, name)) / SIGMAS_PER_95_PERCENT_HALF_WIDTH
        for name, (_, bounds) in STANDARD_NAME_AND_95_PERCENT_BOUNDS_BY_QUANTITY.items()
    }
    latitude, longitude = perceived.shift_wgs84_positions(
        values_by_quantity["latitude_deg"],
        values_by_quantity["longitude_deg"],
        values_by_quantity["east_m"],
        values_by_quantity["north_m"],
    )
    stamp_ns, has_time = stamps_ns_and_validity_from_dsecond(read_numbers(columns, "dsecond_ms"), columns.log_time_ns)
    own_m2 = sigma["position_confidence"] ** 2
    return perceived.make_object_rows(
        ledger,
        message_times_or_log_times_ns(ledger, stamp_ns, has_time),
        values_by_quantity,
        latitude_deg=latitude,
        longitude_deg=longitude,
        heading_rad=heading_from_compass_deg(values_by_quantity["heading_compass_deg"]),
        yaw_rate_radps=np.deg2rad(values_by_quantity["yaw_rate_degps"]),
        position_covariance_m2=perceived.add_position_covariances(
            east_north_covariance_from_ellipse(
                np.maximum(values_by_quantity["semi_major_m"], MIN_POSITION_ACCURACY_SEMI_AXIS_M),
                np.maximum(values_by_quantity["semi_minor_m"], MIN_POSITION_ACCURACY_SEMI_AXIS_M),
                values_by_quantity["semi_major_compass_deg"],
            ),
            np.stack([own_m2, 0.0 * own_m2, own_m2], axis=1),
        ),
        speed_sigma_mps=sigma["speed_confidence"],
        heading_sigma_rad=np.deg2rad(sigma["heading_confidence"]),
        accel_sigma_mps2=sigma["accel_confidence"],
        yaw_rate_sigma_radps=np.deg2rad(sigma["yaw_rate_confidence"]),
    )


def _bound_of_each_code_or_nan(bounds: tuple[float, ...], code: FloatArray) -> FloatArray:
    """Return the bound of each code, NaN for 0 and for an unknown code."""
    table = np.array([np.nan, *bounds])
    is_known = (code >= 0) & (code < len(table))
    return table[np.where(is_known, code, 0).astype(np.int64)]


CODED_OBJECT_CODEC = perceived.make_object_codec(partial(_decode_objects, decode_codes_to_values))
"""The codec of an SDSM's objects in codes, one a row."""
CARMA_OBJECT_CODEC = perceived.make_object_codec(partial(_decode_objects, nan_unless_a_code_could_express))
"""The codec of an SDSM's objects in units, one a row."""
ROS_SDSM_CODEC = perceived.make_objects_only_codec("SDSM", partial(read_sdsm_objects, is_carma=False))
"""The codec of `j3224_v2x_msgs` channels of SDSMs."""
CARMA_SDSM_CODEC = perceived.make_objects_only_codec("SDSM", partial(read_sdsm_objects, is_carma=True))
"""The codec of `carma_v2x_msgs` channels of SDSMs."""
