"""SAE J3224 sensor data sharing: `j3224_v2x_msgs` and `carma_v2x_msgs/SensorDataSharingMessage`, and as received by
radio.

Offsets are north and east of the reference position (J3224's axes are north, east, down); the rest has the codes, units
and signs of a BSM. Confidences are bounds for 95 %. docs/v2x.md shows the table; a test compares the two.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals import perceived
from cwcli.signals.angles import heading_from_compass_deg
from cwcli.signals.columns import Columns, Field, FloatArray, absent_strings
from cwcli.signals.covariances import SIGMAS_PER_95_PERCENT, covariance_from_ellipse
from cwcli.signals.j2735 import ELEMENTS as BSM_ELEMENTS
from cwcli.signals.j2735 import MIN_SEMI_AXIS_M
from cwcli.signals.leaf_fields import read_numbers, read_texts
from cwcli.signals.quality import RowLedger
from cwcli.signals.v2x_codec import Objects, RemoteRows
from cwcli.signals.v2x_elements import Element, decode_element, validate_decoded
from cwcli.signals.v2x_time import message_time_or_log_time, stamp_from_dsecond

_DISTANCE_ELEMENT = Element("ObjectDistance", 0.1, 1, -32_767, 32_767)
"""The data element of an offset from the reference position."""
ELEMENTS: dict[str, Element] = BSM_ELEMENTS | {
    "delta_time_ms": Element("MeasurementTimeOffset", 1.0, 1, -1500, 1500),
    "north_m": _DISTANCE_ELEMENT,
    "east_m": _DISTANCE_ELEMENT,
}
"""The data element of each coded quantity of an SDSM (SAE J3224, SAE J2735)."""
CONFIDENCE_BOUNDS_BY_QUANTITY: dict[str, tuple[str, tuple[float, ...]]] = {
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

ROS_SENDER_PATHS: dict[str, str] = {
    "station": "source_id.id",
    "dsecond_ms": "sdsm_time_stamp.second.millisecond",
    "latitude_deg": "ref_pos.latitude",
    "longitude_deg": "ref_pos.longitude",
    "altitude_m": "ref_pos.elevation",
    "semi_major_m": "ref_pos_xy_conf.semi_major",
    "semi_minor_m": "ref_pos_xy_conf.semi_minor",
    "semi_major_compass_deg": "ref_pos_xy_conf.orientation",
}
"""The leaf fields of the ROS messages, by quantity of the sender."""
OBJECTS_PATH = "objects.detected_object_data."
"""The path prefix of the objects in the ROS messages."""
_COMMON_DATA_PREFIX, _VEHICLE_DATA_PREFIX = "detected_object_common_data.", "detected_object_optional_data.det_veh."
"""The path prefixes of an object's common data and of its vehicle data."""
ROS_OBJECT_PATHS: dict[str, str] = {
    "object": _COMMON_DATA_PREFIX + "detected_id.object_id",
    "delta_time_ms": _COMMON_DATA_PREFIX + "measurement_time.measurement_time_offset",
    "north_m": _COMMON_DATA_PREFIX + "pos.offset_x.object_distance",
    "east_m": _COMMON_DATA_PREFIX + "pos.offset_y.object_distance",
    "position_confidence": _COMMON_DATA_PREFIX + "pos_confidence.pos.confidence",
    "speed_mps": _COMMON_DATA_PREFIX + "speed.speed",
    "speed_confidence": _COMMON_DATA_PREFIX + "speed_confidence.speed_confidence",
    "heading_compass_deg": _COMMON_DATA_PREFIX + "heading.heading",
    "heading_confidence": _COMMON_DATA_PREFIX + "heading_conf.confidence",
    "accel_mps2": _COMMON_DATA_PREFIX + "accel_4_way.longitudinal",
    "lateral_accel_mps2": _COMMON_DATA_PREFIX + "accel_4_way.lateral",
    "yaw_rate_degps": _COMMON_DATA_PREFIX + "accel_4_way.yaw_rate",
    "accel_confidence": _COMMON_DATA_PREFIX + "acc_cfd_x.acceleration_confidence",
    "yaw_rate_confidence": _COMMON_DATA_PREFIX + "acc_cfd_yaw.yaw_rate_confidence",
    "width_m": _VEHICLE_DATA_PREFIX + "size.vehicle_width",
    "length_m": _VEHICLE_DATA_PREFIX + "size.vehicle_length",
}
"""The leaf fields of an object in the ROS messages, behind the prefix of the objects, by quantity."""
_ACCELERATION_QUANTITIES = ("accel_mps2", "lateral_accel_mps2")
"""The quantities of an acceleration."""
OBJECT_PRESENCE_BITS: tuple[tuple[str, int, tuple[str, ...]], ...] = (
    (_COMMON_DATA_PREFIX + "presence_vector", 4, (*_ACCELERATION_QUANTITIES, "yaw_rate_degps")),
    (_COMMON_DATA_PREFIX + "presence_vector", 8, ("accel_confidence",)),
    (_COMMON_DATA_PREFIX + "presence_vector", 64, ("yaw_rate_confidence",)),
    ("presence_vector", 1, ("width_m", "length_m")),
    (_VEHICLE_DATA_PREFIX + "presence_vector", 32, ("width_m", "length_m")),
)
"""The presence fields of an object: path, the bit that is set when a value is there, and the quantities concerned."""
CARMA_OBJECT_PRESENCE_BITS: tuple[tuple[str, int, tuple[str, ...]], ...] = (
    (_COMMON_DATA_PREFIX + "accel_4_way.presence_vector", 1, _ACCELERATION_QUANTITIES),
    (_COMMON_DATA_PREFIX + "accel_4_way.presence_vector", 4, ("yaw_rate_degps",)),
    (_VEHICLE_DATA_PREFIX + "size.presence_vector", 1, ("width_m",)),
    (_VEHICLE_DATA_PREFIX + "size.presence_vector", 2, ("length_m",)),
)
"""Further presence fields of an object in `carma_v2x_msgs`."""
CARMA_UNAVAILABLE_PATHS = {
    "speed_mps": _COMMON_DATA_PREFIX + "speed.unavailable",
    "heading_compass_deg": _COMMON_DATA_PREFIX + "heading.unavailable",
}
"""The fields of `carma_v2x_msgs` that say that a quantity is unavailable, by quantity."""
SENDER_PRESENCE_BITS: tuple[tuple[str, int, tuple[str, ...]], ...] = (
    ("sdsm_time_stamp.presence_vector", 32, ("dsecond_ms",)),
    ("ref_pos.elevation_exists", 1, ("altitude_m",)),
)
"""The presence fields of the sender: path, bit, and the quantities concerned."""
CARMA_SENDER_PRESENCE_BITS: tuple[tuple[str, int, tuple[str, ...]], ...] = (
    ("ref_pos_xy_conf.presence_vector", 1, ("semi_major_m", "semi_minor_m")),
    ("ref_pos_xy_conf.presence_vector", 2, ("semi_major_compass_deg",)),
)
"""Further presence fields of the sender in `carma_v2x_msgs`."""
_OBJECT_TYPE_PATH = "detected_object_optional_data.choice"
"""The path of an object's type: 0 is a vehicle."""
CARMA_MS_PER_S = 1000.0
"""The milliseconds in a second; `carma_v2x_msgs` has time offsets in seconds."""
MAX_FLAG_FIELD_VALUE = 2.0**32 - 1.0
"""The largest value of a presence field of 32 bits."""


def ros_fields() -> tuple[str, ...]:
    """Return the paths of every leaf of the ROS messages that is read."""
    flags = dict.fromkeys(path for path, *_ in (*OBJECT_PRESENCE_BITS, *CARMA_OBJECT_PRESENCE_BITS))
    of_objects = (*ROS_OBJECT_PATHS.values(), *flags, *CARMA_UNAVAILABLE_PATHS.values(), _OBJECT_TYPE_PATH)
    of_sender = dict.fromkeys(path for path, *_ in (*SENDER_PRESENCE_BITS, *CARMA_SENDER_PRESENCE_BITS))
    return (*ROS_SENDER_PATHS.values(), *of_sender, *(OBJECTS_PATH + path for path in of_objects))


def read_ros_objects(columns: Columns) -> Objects:
    """Read the objects of a `j3224_v2x_msgs` channel, as codes."""
    return _read_objects(columns, is_carma=False)


def read_carma_objects(columns: Columns) -> Objects:
    """Read the objects of a `carma_v2x_msgs` channel, in degrees, metres, m/s, m/s^2, degrees/s, ms and J3224's
    signs."""
    return _read_objects(columns, is_carma=True)


def _read_objects(columns: Columns, *, is_carma: bool) -> Objects:
    counts, rows = perceived.count_objects(columns, OBJECTS_PATH + ROS_OBJECT_PATHS["delta_time_ms"])
    if not len(rows):
        return ()
    value = {name: read_numbers(columns, path)[rows] for name, path in ROS_SENDER_PATHS.items() if name != "station"}
    value |= {
        name: perceived.read_object_leaf(columns, OBJECTS_PATH + path, counts)
        for name, path in ROS_OBJECT_PATHS.items()
    }
    by_sender = (*SENDER_PRESENCE_BITS, *(CARMA_SENDER_PRESENCE_BITS if is_carma else ()))
    by_object = (*OBJECT_PRESENCE_BITS, *(CARMA_OBJECT_PRESENCE_BITS if is_carma else ()))
    flags = [(read_numbers(columns, path)[rows], bit, names) for path, bit, names in by_sender]
    flags += [
        (perceived.read_object_leaf(columns, OBJECTS_PATH + path, counts), bit, names) for path, bit, names in by_object
    ]
    for flag, bit, names in flags:
        is_there = (np.clip(np.nan_to_num(flag), 0.0, MAX_FLAG_FIELD_VALUE).astype(np.int64) & bit) != 0
        value |= {name: np.where(is_there, value[name], np.nan) for name in names}
    is_vehicle = perceived.read_object_leaf(columns, OBJECTS_PATH + _OBJECT_TYPE_PATH, counts) == 0
    value |= {name: np.where(is_vehicle, value[name], np.nan) for name in ("width_m", "length_m")}
    if is_carma:
        for name, path in CARMA_UNAVAILABLE_PATHS.items():
            value[name] = np.where(
                perceived.read_object_leaf(columns, OBJECTS_PATH + path, counts) != 0, np.nan, value[name]
            )
        value["delta_time_ms"] = CARMA_MS_PER_S * value["delta_time_ms"]
    made: dict[str, Field] = dict(value)
    station = read_texts(columns, ROS_SENDER_PATHS["station"]) or absent_strings(len(columns))
    made["station"] = station.select_rows(rows)
    return (
        (perceived.columns_per_object(columns, rows, made), CARMA_OBJECT_CODEC if is_carma else CODED_OBJECT_CODEC),
    )


def decode_object_codes(columns: Columns, ledger: RowLedger) -> RemoteRows:
    """Decode objects, one a row, whose quantities are codes."""
    value = {name: decode_element(element, read_numbers(columns, name), ledger) for name, element in ELEMENTS.items()}
    return _make_object_rows(columns, ledger, value)


def decode_objects_in_units(columns: Columns, ledger: RowLedger) -> RemoteRows:
    """Decode objects, one a row, whose quantities are in units, with J3224's signs and ranges."""
    value = {name: validate_decoded(element, read_numbers(columns, name), ledger) for name, element in ELEMENTS.items()}
    return _make_object_rows(columns, ledger, value)


def _make_object_rows(columns: Columns, ledger: RowLedger, value: dict[str, FloatArray]) -> RemoteRows:
    sigma = {
        name: _bounds_of_codes(bounds, read_numbers(columns, name)) / SIGMAS_PER_95_PERCENT
        for name, (_, bounds) in CONFIDENCE_BOUNDS_BY_QUANTITY.items()
    }
    latitude, longitude = perceived.shift_wgs84_positions(
        value["latitude_deg"], value["longitude_deg"], value["east_m"], value["north_m"]
    )
    stamp_ns, has_time = stamp_from_dsecond(read_numbers(columns, "dsecond_ms"), columns.log_time_ns)
    own_m2 = sigma["position_confidence"] ** 2
    return perceived.make_object_rows(
        ledger,
        message_time_or_log_time(ledger, stamp_ns, has_time),
        value["delta_time_ms"],
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_m=value["altitude_m"],
        speed_mps=value["speed_mps"],
        heading_rad=heading_from_compass_deg(value["heading_compass_deg"]),
        accel_mps2=value["accel_mps2"],
        lateral_accel_mps2=value["lateral_accel_mps2"],
        yaw_rate_radps=np.deg2rad(value["yaw_rate_degps"]),
        length_m=value["length_m"],
        width_m=value["width_m"],
        position_covariance_m2=perceived.add_position_covariances(
            covariance_from_ellipse(
                np.maximum(value["semi_major_m"], MIN_SEMI_AXIS_M),
                np.maximum(value["semi_minor_m"], MIN_SEMI_AXIS_M),
                value["semi_major_compass_deg"],
            ),
            np.stack([own_m2, 0.0 * own_m2, own_m2], axis=1),
        ),
        speed_sigma_mps=sigma["speed_confidence"],
        heading_sigma_rad=np.deg2rad(sigma["heading_confidence"]),
        accel_sigma_mps2=sigma["accel_confidence"],
        yaw_rate_sigma_radps=np.deg2rad(sigma["yaw_rate_confidence"]),
    )


def _bounds_of_codes(bounds: tuple[float, ...], code: FloatArray) -> FloatArray:
    """Return the bound of each code, NaN for 0 and for an unknown code."""
    table = np.array([np.nan, *bounds])
    is_known = (code >= 0) & (code < len(table))
    return table[np.where(is_known, code, 0).astype(np.int64)]


CODED_OBJECT_CODEC = perceived.make_object_codec(decode_object_codes)
"""The codec of an SDSM's objects in codes, one a row."""
CARMA_OBJECT_CODEC = perceived.make_object_codec(decode_objects_in_units)
"""The codec of an SDSM's objects in units, one a row."""
ROS_SDSM = perceived.make_objects_only_codec("SDSM", read_ros_objects)
"""The codec of `j3224_v2x_msgs` channels of SDSMs."""
CARMA_SDSM = perceived.make_objects_only_codec("SDSM", read_carma_objects)
"""The codec of `carma_v2x_msgs` channels of SDSMs."""
