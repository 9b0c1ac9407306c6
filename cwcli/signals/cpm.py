"""ETSI collective perception (TS 103 324): `etsi_its_cpm_ts_msgs/CollectivePerceptionMessage`, and as received by
radio.

Codes after TS 102 894-2. Offsets, velocities and accelerations are east and north of the reference position, angles
counter-clockwise from east: the axes of cwcli. docs/v2x.md shows the table; a test compares the two.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals import perceived
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import Columns, Field, FloatArray
from cwcli.signals.covariances import SIGMAS_PER_95_PERCENT, SIGMAS_PER_95_PERCENT_ELLIPSE, covariance_from_ellipse
from cwcli.signals.etsi import ELEMENTS as CAM_ELEMENTS
from cwcli.signals.etsi import UNTRUSTED_POSITION_REASON
from cwcli.signals.leaf_fields import read_numbers
from cwcli.signals.quality import RowLedger
from cwcli.signals.v2x_codec import Objects, RemoteRows
from cwcli.signals.v2x_elements import Element, decode_element
from cwcli.signals.v2x_time import message_time_or_log_time, stamp_from_timestamp_its

_ANGLE_ELEMENT = Element("CartesianAngleValue", 0.1, 1, 0, 3600, (3601,))
"""The data element of an angle."""
_ANGLE_95_ELEMENT = Element("AngleConfidence", 0.1, 1, 1, 125, (127,), (126,))
"""The data element of the 95 % bound of an angle."""
_COORDINATE_ELEMENT = Element("CartesianCoordinateLarge", 0.01, 1, -131_071, 131_070, (), (-131_072, 131_071))
"""The data element of a coordinate relative to the sender."""
_COORDINATE_95_ELEMENT = Element("CoordinateConfidence", 0.01, 1, 1, 4094, (4096,), (4095,))
"""The data element of the 95 % bound of a coordinate."""
_VELOCITY_ELEMENT = Element("VelocityComponentValue", 0.01, 1, -16_382, 16_381, (16_383,), (-16_383, 16_382))
"""The data element of a component of a velocity."""
_ACCELERATION_ELEMENT = Element("AccelerationValue", 0.1, 1, -160, 160, (161,))
"""The data element of a component of an acceleration."""
_DIMENSION_ELEMENT = Element("ObjectDimensionValue", 0.1, 1, 1, 254, (256,), (255,))
"""The data element of a length or width."""
ELEMENTS: dict[str, Element] = {
    **{name: CAM_ELEMENTS[name] for name in ("latitude_deg", "longitude_deg", "altitude_m")},
    **{name: CAM_ELEMENTS[name] for name in ("semi_major_m", "semi_minor_m", "semi_major_compass_deg")},
    "delta_time_ms": Element("DeltaTimeMilliSecondSigned", 1.0, 1, -2047, 2046, (), (-2048, 2047)),
    "east_m": _COORDINATE_ELEMENT,
    "north_m": _COORDINATE_ELEMENT,
    "east_95_m": _COORDINATE_95_ELEMENT,
    "north_95_m": _COORDINATE_95_ELEMENT,
    "speed_mps": CAM_ELEMENTS["speed_mps"],
    "speed_95_mps": CAM_ELEMENTS["speed_95_mps"],
    "direction_deg": _ANGLE_ELEMENT,
    "direction_95_deg": _ANGLE_95_ELEMENT,
    "east_mps": _VELOCITY_ELEMENT,
    "north_mps": _VELOCITY_ELEMENT,
    "east_95_mps": CAM_ELEMENTS["speed_95_mps"],
    "north_95_mps": CAM_ELEMENTS["speed_95_mps"],
    "accel_mps2": Element("AccelerationMagnitudeValue", 0.1, 1, 0, 160, (161,)),
    "accel_95_mps2": CAM_ELEMENTS["accel_95_mps2"],
    "accel_direction_deg": _ANGLE_ELEMENT,
    "east_mps2": _ACCELERATION_ELEMENT,
    "north_mps2": _ACCELERATION_ELEMENT,
    "east_95_mps2": CAM_ELEMENTS["accel_95_mps2"],
    "north_95_mps2": CAM_ELEMENTS["accel_95_mps2"],
    "heading_deg": _ANGLE_ELEMENT,
    "heading_95_deg": _ANGLE_95_ELEMENT,
    "yaw_rate_degps": Element("CartesianAngularVelocityComponentValue", 1.0, 1, -254, 254, (256,), (-255, 255)),
    "length_m": _DIMENSION_ELEMENT,
    "width_m": _DIMENSION_ELEMENT,
}
"""The data element of each coded quantity of a CPM (TS 103 324, TS 102 894-2)."""
YAW_RATE_95_DEGPS_BY_CODE: dict[int, float] = {0: 1.0, 1: 2.0, 2: 5.0, 3: 10.0, 4: 20.0, 5: 50.0}
"""The 95 % bound of a yaw rate in degrees/s, by code of AngularSpeedConfidence; 6 is out of range, 7 unavailable."""
YAW_RATE_OUT_OF_RANGE_CODE = 6
"""The code of AngularSpeedConfidence that says that the yaw rate can't be trusted."""
MIN_SPEED_FOR_DIRECTION_MPS = 1.0
"""The speed in m/s above which an object's velocity says where it is heading. Chosen by hand; not fitted."""
MAX_FORWARD_ANGLE_RAD = 0.5 * np.pi
"""The largest angle in rad between velocity and heading of forward motion: a quarter turn."""

_MANAGEMENT_PREFIX = "payload.management_container."
"""The path prefix of the management container in the ROS message."""
_POSITION_PREFIX = _MANAGEMENT_PREFIX + "reference_position."
"""The path prefix of the reference position in the ROS message."""
_ELLIPSE_PREFIX = _POSITION_PREFIX + "position_confidence_ellipse."
"""The path prefix of the position's confidence ellipse in the ROS message."""
ROS_SENDER_PATHS: dict[str, tuple[str, ...]] = {
    "station": ("header.station_id.value",),
    "reference_time_ms": (_MANAGEMENT_PREFIX + "reference_time.value",),
    "latitude_deg": (_POSITION_PREFIX + "latitude.value",),
    "longitude_deg": (_POSITION_PREFIX + "longitude.value",),
    "altitude_m": (_POSITION_PREFIX + "altitude.altitude_value.value",),
    "semi_major_m": (_ELLIPSE_PREFIX + "semi_major_confidence.value", _ELLIPSE_PREFIX + "semi_major_axis_length.value"),
    "semi_minor_m": (_ELLIPSE_PREFIX + "semi_minor_confidence.value", _ELLIPSE_PREFIX + "semi_minor_axis_length.value"),
    "semi_major_compass_deg": (
        _ELLIPSE_PREFIX + "semi_major_orientation.value",
        _ELLIPSE_PREFIX + "semi_major_axis_orientation.value",
    ),
}
"""The leaf fields of the ROS message, by quantity of the sender."""
OBJECTS_PATH = "payload.cpm_containers.value.array.container_data_perceived_object_container.perceived_objects.array."
"""The path prefix of the perceived objects in the ROS message."""
_POLAR_VELOCITY_PREFIX, _CARTESIAN_VELOCITY_PREFIX = "velocity.polar_velocity.", "velocity.cartesian_velocity."
"""The path prefixes of an object's velocity, polar and Cartesian."""
_POLAR_ACCELERATION_PREFIX, _CARTESIAN_ACCELERATION_PREFIX = (
    "acceleration.polar_acceleration.",
    "acceleration.cartesian_acceleration.",
)
"""The path prefixes of an object's acceleration, polar and Cartesian."""
ROS_OBJECT_PATHS: dict[str, str] = {
    "object": "object_id.value",
    "delta_time_ms": "measurement_delta_time.value",
    "east_m": "position.x_coordinate.value.value",
    "east_95_m": "position.x_coordinate.confidence.value",
    "north_m": "position.y_coordinate.value.value",
    "north_95_m": "position.y_coordinate.confidence.value",
    "speed_mps": _POLAR_VELOCITY_PREFIX + "velocity_magnitude.speed_value.value",
    "speed_95_mps": _POLAR_VELOCITY_PREFIX + "velocity_magnitude.speed_confidence.value",
    "direction_deg": _POLAR_VELOCITY_PREFIX + "velocity_direction.value.value",
    "direction_95_deg": _POLAR_VELOCITY_PREFIX + "velocity_direction.confidence.value",
    "east_mps": _CARTESIAN_VELOCITY_PREFIX + "x_velocity.value.value",
    "east_95_mps": _CARTESIAN_VELOCITY_PREFIX + "x_velocity.confidence.value",
    "north_mps": _CARTESIAN_VELOCITY_PREFIX + "y_velocity.value.value",
    "north_95_mps": _CARTESIAN_VELOCITY_PREFIX + "y_velocity.confidence.value",
    "accel_mps2": _POLAR_ACCELERATION_PREFIX + "acceleration_magnitude.acceleration_magnitude_value.value",
    "accel_95_mps2": _POLAR_ACCELERATION_PREFIX + "acceleration_magnitude.acceleration_confidence.value",
    "accel_direction_deg": _POLAR_ACCELERATION_PREFIX + "acceleration_direction.value.value",
    "east_mps2": _CARTESIAN_ACCELERATION_PREFIX + "x_acceleration.value.value",
    "east_95_mps2": _CARTESIAN_ACCELERATION_PREFIX + "x_acceleration.confidence.value",
    "north_mps2": _CARTESIAN_ACCELERATION_PREFIX + "y_acceleration.value.value",
    "north_95_mps2": _CARTESIAN_ACCELERATION_PREFIX + "y_acceleration.confidence.value",
    "heading_deg": "angles.z_angle.value.value",
    "heading_95_deg": "angles.z_angle.confidence.value",
    "yaw_rate_degps": "z_angular_velocity.value.value",
    "yaw_rate_confidence": "z_angular_velocity.confidence.value",
    "width_m": "object_dimension_y.value.value",
    "length_m": "object_dimension_x.value.value",
}
"""The leaf fields of an object in the ROS message, behind the prefix of the objects, by quantity."""
QUANTITIES_BY_PRESENCE_FLAG: dict[str, str] = {
    "object_id_is_present": "object",
    "angles_is_present": "heading_deg",
    "z_angular_velocity_is_present": "yaw_rate_degps",
    "object_dimension_y_is_present": "width_m",
    "object_dimension_x_is_present": "length_m",
}
"""The quantity that is valid only where a flag of the object is set, by flag."""
CHOICE_ALTERNATIVES: dict[str, tuple[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    "velocity": ("velocity.choice", (("speed_mps", "direction_deg"), ("east_mps", "north_mps"))),
    "acceleration": ("acceleration.choice", (("accel_mps2", "accel_direction_deg"), ("east_mps2", "north_mps2"))),
}
"""The field that says which form a vector has (0 polar, 1 Cartesian) and the quantities of each form, by vector."""


def ros_fields() -> tuple[str, ...]:
    """Return the paths of every leaf of the ROS message that is read."""
    flags = (
        *QUANTITIES_BY_PRESENCE_FLAG,
        *(f"{name}_is_present" for name in CHOICE_ALTERNATIVES),
        *(path for path, _ in CHOICE_ALTERNATIVES.values()),
    )
    of_sender = tuple(path for paths in ROS_SENDER_PATHS.values() for path in paths)
    return (*of_sender, *(OBJECTS_PATH + path for path in (*ROS_OBJECT_PATHS.values(), *flags)))


def read_ros_objects(columns: Columns) -> Objects:
    """Read the objects of a ROS channel; a leaf that is there more or less often than the times is not used."""
    counts, rows = perceived.count_objects(columns, OBJECTS_PATH + ROS_OBJECT_PATHS["delta_time_ms"])
    made: dict[str, Field] = {name: read_numbers(columns, *paths)[rows] for name, paths in ROS_SENDER_PATHS.items()}
    made |= {
        name: perceived.read_object_leaf(columns, OBJECTS_PATH + path, counts)
        for name, path in ROS_OBJECT_PATHS.items()
    }

    def keep_where(names: tuple[str, ...], is_there: FloatArray) -> None:
        for name in names:
            values = made[name]
            assert isinstance(values, np.ndarray)
            made[name] = np.where(is_there, values, np.nan)

    for flag, name in QUANTITIES_BY_PRESENCE_FLAG.items():
        keep_where((name,), perceived.read_object_leaf(columns, OBJECTS_PATH + flag, counts) != 0)
    for name, (path, ways) in CHOICE_ALTERNATIVES.items():
        is_there, choice = (
            perceived.read_object_leaf(columns, OBJECTS_PATH + each, counts) for each in (f"{name}_is_present", path)
        )
        for k, told in enumerate(ways):
            keep_where(told, (is_there != 0) & (choice == k))
    return ((perceived.columns_per_object(columns, rows, made), OBJECT_CODEC),) if len(rows) else ()


def decode_perceived_objects(columns: Columns, ledger: RowLedger) -> RemoteRows:
    """Decode perceived objects, one a row, from the codes of senders and objects.

    The heading is that of the object's box where it is given, else the direction of its velocity; the speed is negative
    where the velocity points backward. The acceleration along it is the vector's part in that direction.
    A confidence of "out of range" takes its value away, and that of a position the object.
    """
    raw = {name: read_numbers(columns, name) for name in ELEMENTS}
    value = {name: decode_element(element, raw[name], ledger) for name, element in ELEMENTS.items()}
    untrusted = np.zeros(len(columns), np.bool_)
    for name in ("east_95_m", "north_95_m", "semi_major_m", "semi_minor_m"):
        untrusted |= np.isin(raw[name], ELEMENTS[name].out_of_range)
    ledger.reject(untrusted, UNTRUSTED_POSITION_REASON)
    for name, confidence in (
        *(("speed_mps", "speed_95_mps"), ("direction_deg", "direction_95_deg"), ("heading_deg", "heading_95_deg")),
        *(("east_mps", "east_95_mps"), ("north_mps", "north_95_mps"), ("accel_mps2", "accel_95_mps2")),
        *(("east_mps2", "east_95_mps2"), ("north_mps2", "north_95_mps2")),
    ):
        value[name] = np.where(np.isin(raw[confidence], ELEMENTS[confidence].out_of_range), np.nan, value[name])
    yaw_code = read_numbers(columns, "yaw_rate_confidence")
    yaw_rate = np.where(yaw_code == YAW_RATE_OUT_OF_RANGE_CODE, np.nan, value["yaw_rate_degps"])
    east, north, speed_sigma, direction_sigma = _velocity_and_sigmas(value)
    speed, direction = np.hypot(east, north), np.arctan2(north, east)
    is_moving = speed > MIN_SPEED_FOR_DIRECTION_MPS
    own = wrap_angle(np.deg2rad(value["heading_deg"]))
    heading = np.where(np.isfinite(own), own, np.where(is_moving, direction, np.nan))
    is_backward = is_moving & (np.abs(wrap_angle(direction - heading)) > MAX_FORWARD_ANGLE_RAD)
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
    stamp_ns, has_time = stamp_from_timestamp_its(read_numbers(columns, "reference_time_ms"), columns.log_time_ns)
    own_m2 = (np.stack([value["east_95_m"], value["north_95_m"]]) / SIGMAS_PER_95_PERCENT) ** 2
    heading_95 = np.deg2rad(value["heading_95_deg"])
    return perceived.make_object_rows(
        ledger,
        message_time_or_log_time(ledger, stamp_ns, has_time),
        value["delta_time_ms"],
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_m=value["altitude_m"],
        speed_mps=np.where(is_backward, -speed, speed),
        heading_rad=heading,
        accel_mps2=accel,
        lateral_accel_mps2=lateral,
        yaw_rate_radps=np.deg2rad(yaw_rate),
        length_m=value["length_m"],
        width_m=value["width_m"],
        position_covariance_m2=perceived.add_position_covariances(
            covariance_from_ellipse(
                value["semi_major_m"] / SIGMAS_PER_95_PERCENT_ELLIPSE,
                value["semi_minor_m"] / SIGMAS_PER_95_PERCENT_ELLIPSE,
                value["semi_major_compass_deg"],
            ),
            np.stack([own_m2[0], np.where(np.isnan(own_m2).any(axis=0), np.nan, 0.0), own_m2[1]], axis=1),
        ),
        speed_sigma_mps=speed_sigma,
        heading_sigma_rad=np.where(np.isfinite(own), heading_95 / SIGMAS_PER_95_PERCENT, direction_sigma),
        accel_sigma_mps2=accel_95 / SIGMAS_PER_95_PERCENT,
        yaw_rate_sigma_radps=np.deg2rad(_yaw_rate_bounds_degps(yaw_code)) / SIGMAS_PER_95_PERCENT,
    )


def _velocity_and_sigmas(value: dict[str, FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return east and north velocity (m/s) and the sigmas of speed (m/s) and direction (rad), (m,) each, from either
    form."""
    polar = np.deg2rad(value["direction_deg"])
    is_polar = np.isfinite(value["speed_mps"] + polar)
    east = np.where(is_polar, value["speed_mps"] * np.cos(polar), value["east_mps"])
    north = np.where(is_polar, value["speed_mps"] * np.sin(polar), value["north_mps"])
    speed = np.hypot(east, north)
    with np.errstate(divide="ignore", invalid="ignore"):
        cos, sin = east / speed, north / speed
        along = np.hypot(cos * value["east_95_mps"], sin * value["north_95_mps"])
        across = np.hypot(sin * value["east_95_mps"], cos * value["north_95_mps"]) / speed
    speed_95 = np.where(is_polar, value["speed_95_mps"], along)
    direction_95 = np.where(is_polar, np.deg2rad(value["direction_95_deg"]), across)
    return east, north, speed_95 / SIGMAS_PER_95_PERCENT, direction_95 / SIGMAS_PER_95_PERCENT


def _yaw_rate_bounds_degps(code: FloatArray) -> FloatArray:
    bound = np.full(len(code), np.nan)
    for known, degps in YAW_RATE_95_DEGPS_BY_CODE.items():
        bound[code == known] = degps
    return bound


OBJECT_CODEC = perceived.make_object_codec(decode_perceived_objects)
"""The codec of the perceived objects of a CPM, one a row."""
ROS_CPM = perceived.make_objects_only_codec("CPM", read_ros_objects)
"""The codec of a ROS channel of CPMs."""
