"""ETSI collective perception (TS 103 324): `etsi_its_cpm_ts_msgs/CollectivePerceptionMessage`, and as received by
radio.

Codes after TS 102 894-2. Offsets, velocities and accelerations are east and north of the reference position, angles
counter-clockwise from east: the axes of cwcli. docs/v2x.md shows the table; a test compares the two.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals import perceived
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.covariances import (
    SIGMAS_PER_95_PERCENT_ELLIPSE_RADIUS,
    SIGMAS_PER_95_PERCENT_HALF_WIDTH,
    east_north_covariance_from_ellipse,
)
from cwcli.signals.elements import Elements
from cwcli.signals.etsi import UNTRUSTED_POSITION_REASON
from cwcli.signals.leaf_fields import read_numbers
from cwcli.signals.quality import RowLedger
from cwcli.signals.v2x_codec import Objects, RemoteRows
from cwcli.signals.v2x_elements import decode_codes_to_values, decode_enumeration
from cwcli.signals.v2x_tables import load_message_table, ros_leaf_path, ros_presence_paths
from cwcli.signals.v2x_time import message_times_or_log_times_ns, stamps_ns_and_validity_from_timestamp_its

_CPM_QUANTITY_TABLE = load_message_table("cpm", "etsi")
"""The quantities of a CPM's sender and objects: their data elements, and their paths."""
DATA_ELEMENTS_BY_CPM_QUANTITY = _CPM_QUANTITY_TABLE.elements
"""The data element of each coded quantity of a CPM (TS 103 324, TS 102 894-2)."""
CPM_PATHS = _CPM_QUANTITY_TABLE.columns["cpm"]
"""The component of a CPM, by quantity."""
OBJECTS_PATH = "payload.cpmContainers.containerData.perceivedObjects"
"""The component that is the list of perceived objects."""
ROS_OBJECTS_PATH = (
    "payload.cpm_containers.value.array.container_data_perceived_object_container.perceived_objects.array"
)
"""The path of the perceived objects in the ROS message."""
YAW_RATE_95_PERCENT_BOUND_BY_CONFIDENCE_CODE_DEGPS: dict[int, float] = {
    0: 1.0,
    1: 2.0,
    2: 5.0,
    3: 10.0,
    4: 20.0,
    5: 50.0,
}
"""The 95 % bound of a yaw rate in degrees/s, by code of AngularSpeedConfidence; 6 is out of range, 7 unavailable."""
YAW_RATE_OUT_OF_RANGE_CODE = 6
"""The code of AngularSpeedConfidence that says that the yaw rate can't be trusted."""
MIN_SPEED_FOR_DIRECTION_MPS = 1.0
"""The speed in m/s above which an object's velocity says where it is heading. Chosen by hand; not fitted."""
MAX_VELOCITY_TO_HEADING_ANGLE_OF_FORWARD_MOTION_RAD = 0.5 * np.pi
"""The largest angle in rad between velocity and heading of forward motion: a quarter turn."""

_OBJECT_PATHS = {
    name: path.removeprefix(f"{OBJECTS_PATH}.") for name, path in CPM_PATHS.items() if path.startswith(OBJECTS_PATH)
}
"""The component of an object, below the list of objects, by quantity."""
ROS_SENDER_PATHS = {
    name: [ros_leaf_path(each[name]) for each in (_CPM_QUANTITY_TABLE.columns["cpm_older"], CPM_PATHS) if name in each]
    for name in CPM_PATHS
    if name not in _OBJECT_PATHS
}
"""The leaf fields that can hold a quantity of the sender in the ROS message."""
ROS_OBJECT_PATHS = {name: f"{ROS_OBJECTS_PATH}.{ros_leaf_path(path)}" for name, path in _OBJECT_PATHS.items()}
"""The leaf field of an object in the ROS message, by quantity."""
ROS_PRESENCE_FLAG_PATHS_BY_OBJECT_QUANTITY = {
    name: f"{ROS_OBJECTS_PATH}.{flag}" for name, flag in ros_presence_paths(_OBJECT_PATHS).items()
}
"""The flag of an object in the ROS message without which a quantity is not valid, by quantity."""
QUANTITIES_BY_VECTOR_FORM: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "velocity": (("speed_mps", "direction_deg"), ("east_mps", "north_mps")),
    "acceleration": (("accel_mps2", "accel_direction_deg"), ("east_mps2", "north_mps2")),
}
"""The quantities of each form of a vector of the object (0 polar, 1 Cartesian), by vector."""


def _presence_and_form_paths(vector: str) -> tuple[str, str]:
    """Return the leaf fields that say whether an object has a vector, and in which form."""
    return f"{ROS_OBJECTS_PATH}.{vector}_is_present", f"{ROS_OBJECTS_PATH}.{vector}.choice"


ROS_LEAF_FIELDS = (
    *(path for paths in ROS_SENDER_PATHS.values() for path in paths),
    *ROS_OBJECT_PATHS.values(),
    *ROS_PRESENCE_FLAG_PATHS_BY_OBJECT_QUANTITY.values(),
    *(path for vector in QUANTITIES_BY_VECTOR_FORM for path in _presence_and_form_paths(vector)),
)
"""The leaf fields of the ROS message that are read."""


def read_ros_cpm_objects(columns: Columns) -> Objects:
    """Read the objects of a ROS channel; a leaf that is there more or less often than the times is not used."""
    objects = Elements(columns, None, ROS_OBJECT_PATHS["delta_time_ms"])
    rows = objects.message_rows
    if not len(rows):
        return ()
    values = {name: read_numbers(columns, *paths)[rows] for name, paths in ROS_SENDER_PATHS.items()}
    values |= {name: objects.read_numbers(path) for name, path in ROS_OBJECT_PATHS.items()}
    for name, path in ROS_PRESENCE_FLAG_PATHS_BY_OBJECT_QUANTITY.items():
        is_there = objects.read_numbers(path) != 0
        values[name] = np.where(is_there, values[name], np.nan)
    for vector, forms in QUANTITIES_BY_VECTOR_FORM.items():
        is_there, choice = (objects.read_numbers(path) for path in _presence_and_form_paths(vector))
        for k, names in enumerate(forms):
            values |= {name: np.where((is_there != 0) & (choice == k), values[name], np.nan) for name in names}
    return ((columns.with_fields_of_rows(rows, values), PERCEIVED_OBJECT_CODEC),)


def decode_perceived_objects(columns: Columns, ledger: RowLedger) -> RemoteRows:
    """Decode perceived objects, one a row, from the codes of senders and objects.

    The heading is that of the object's box where it is given, else the direction of its velocity; the speed is negative
    where the velocity points backward. The acceleration along it is the vector's part in that direction.
    A confidence of "out of range" takes its value away, and that of a position the object.
    """
    raw = {name: read_numbers(columns, name) for name in DATA_ELEMENTS_BY_CPM_QUANTITY}
    value = {
        name: decode_codes_to_values(element, raw[name], ledger)
        for name, element in DATA_ELEMENTS_BY_CPM_QUANTITY.items()
    }
    untrusted = np.zeros(len(columns), np.bool_)
    for name in ("east_95_m", "north_95_m", "semi_major_m", "semi_minor_m"):
        untrusted |= np.isin(raw[name], DATA_ELEMENTS_BY_CPM_QUANTITY[name].out_of_range)
    ledger.reject(untrusted, UNTRUSTED_POSITION_REASON)
    for name, confidence in (
        *(("speed_mps", "speed_95_mps"), ("direction_deg", "direction_95_deg"), ("heading_deg", "heading_95_deg")),
        *(("east_mps", "east_95_mps"), ("north_mps", "north_95_mps"), ("accel_mps2", "accel_95_mps2")),
        *(("east_mps2", "east_95_mps2"), ("north_mps2", "north_95_mps2")),
    ):
        value[name] = np.where(
            np.isin(raw[confidence], DATA_ELEMENTS_BY_CPM_QUANTITY[confidence].out_of_range), np.nan, value[name]
        )
    yaw_code = read_numbers(columns, "yaw_rate_confidence")
    yaw_rate_95 = decode_enumeration(YAW_RATE_95_PERCENT_BOUND_BY_CONFIDENCE_CODE_DEGPS, yaw_code)
    yaw_rate = np.where(yaw_code == YAW_RATE_OUT_OF_RANGE_CODE, np.nan, value["yaw_rate_degps"])
    east, north, speed_sigma, direction_sigma = _velocity_and_sigmas(value)
    speed, direction = np.hypot(east, north), np.arctan2(north, east)
    is_moving = speed > MIN_SPEED_FOR_DIRECTION_MPS
    own = wrap_angle(np.deg2rad(value["heading_deg"]))
    heading = np.where(np.isfinite(own), own, np.where(is_moving, direction, np.nan))
    is_backward = is_moving & (
        np.abs(wrap_angle(direction - heading)) > MAX_VELOCITY_TO_HEADING_ANGLE_OF_FORWARD_MOTION_RAD
    )
    polar = np.deg2rad(value["accel_direction_deg"])
    accel = np.where(
        np.isfinite(value["accel_mps2"]),
        value["accel_mps2"] * np.cos(polar - heading),
        value["east_mps2"] * np.cos(heading) + value["north_mps2"] * np.sin(heading),
    )
    lateral = np.where(
        np.isfinite(value["accel_mps2"]),
        value["accel_mps2"] * np.sin(polar - heading),
        value["north_mps2"] * np.cos(heading) - value["east_mps2"] * np.sin(heading),
    )
    accel_95 = np.where(
        np.isfinite(value["accel_95_mps2"]),
        value["accel_95_mps2"],
        np.hypot(value["east_95_mps2"] * np.cos(heading), value["north_95_mps2"] * np.sin(heading)),
    )
    latitude, longitude = perceived.shift_wgs84_positions(
        value["latitude_deg"], value["longitude_deg"], value["east_m"], value["north_m"]
    )
    stamp_ns, has_time = stamps_ns_and_validity_from_timestamp_its(
        read_numbers(columns, "reference_time_ms"), columns.log_time_ns
    )
    own_m2 = (np.stack([value["east_95_m"], value["north_95_m"]]) / SIGMAS_PER_95_PERCENT_HALF_WIDTH) ** 2
    heading_95 = np.deg2rad(value["heading_95_deg"])
    return perceived.make_object_rows(
        ledger,
        message_times_or_log_times_ns(ledger, stamp_ns, has_time),
        value,
        latitude_deg=latitude,
        longitude_deg=longitude,
        speed_mps=np.where(is_backward, -speed, speed),
        heading_rad=heading,
        accel_mps2=accel,
        lateral_accel_mps2=lateral,
        yaw_rate_radps=np.deg2rad(yaw_rate),
        position_covariance_m2=perceived.add_position_covariances(
            east_north_covariance_from_ellipse(
                value["semi_major_m"] / SIGMAS_PER_95_PERCENT_ELLIPSE_RADIUS,
                value["semi_minor_m"] / SIGMAS_PER_95_PERCENT_ELLIPSE_RADIUS,
                value["semi_major_compass_deg"],
            ),
            np.stack([own_m2[0], np.where(np.isnan(own_m2).any(axis=0), np.nan, 0.0), own_m2[1]], axis=1),
        ),
        speed_sigma_mps=speed_sigma,
        heading_sigma_rad=np.where(np.isfinite(own), heading_95 / SIGMAS_PER_95_PERCENT_HALF_WIDTH, direction_sigma),
        accel_sigma_mps2=accel_95 / SIGMAS_PER_95_PERCENT_HALF_WIDTH,
        yaw_rate_sigma_radps=np.deg2rad(yaw_rate_95) / SIGMAS_PER_95_PERCENT_HALF_WIDTH,
    )


def _velocity_and_sigmas(
    values_by_quantity: dict[str, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return east and north velocity (m/s) and the sigmas of speed (m/s) and direction (rad), (m,) each, from either
    form."""
    polar = np.deg2rad(values_by_quantity["direction_deg"])
    is_polar = np.isfinite(values_by_quantity["speed_mps"] + polar)
    east = np.where(is_polar, values_by_quantity["speed_mps"] * np.cos(polar), values_by_quantity["east_mps"])
    north = np.where(is_polar, values_by_quantity["speed_mps"] * np.sin(polar), values_by_quantity["north_mps"])
    speed = np.hypot(east, north)
    with np.errstate(divide="ignore", invalid="ignore"):
        cos, sin = east / speed, north / speed
        along = np.hypot(cos * values_by_quantity["east_95_mps"], sin * values_by_quantity["north_95_mps"])
        across = np.hypot(sin * values_by_quantity["east_95_mps"], cos * values_by_quantity["north_95_mps"]) / speed
    speed_95 = np.where(is_polar, values_by_quantity["speed_95_mps"], along)
    direction_95 = np.where(is_polar, np.deg2rad(values_by_quantity["direction_95_deg"]), across)
    return east, north, speed_95 / SIGMAS_PER_95_PERCENT_HALF_WIDTH, direction_95 / SIGMAS_PER_95_PERCENT_HALF_WIDTH


PERCEIVED_OBJECT_CODEC = perceived.make_object_codec(decode_perceived_objects)
"""The codec of the perceived objects of a CPM, one a row."""
ROS_CPM_CODEC = perceived.make_objects_only_codec("CPM", read_ros_cpm_objects)
"""The codec of a ROS channel of CPMs."""
