"""Quantities -> channels of standard ROS 2 messages, as sensors publish them."""

from __future__ import annotations

import numpy as np

from cwcli.importing.meaning import Meaning
from cwcli.importing.places import new_position_mask
from cwcli.signals.columns import FloatArray, OutputChannel, OutputField, Strings

FIX_TOPIC, POSE_TOPIC = "/gps/fix", "/pose"
VELOCITY_TOPIC, SPEED_TOPIC = "/gps/velocity", "/vehicle/twist"
HEADING_TOPIC, IMU_TOPIC, STEERING_TOPIC = "/vehicle/heading", "/imu/data", "/vehicle/steering"
MAP_FRAME_ID, BODY_FRAME_ID = "map", "base_link"
"""Frame ids of east-north axes and of the axes of the car (REP-105)."""
MIN_UNCHANGED_SHARE_WITHOUT_NEW_POSITION = 0.95
"""Least share of the rows without a new position in which a value that comes with positions does not change. Chosen by
hand."""
UNMEASURED_COVARIANCE_FIRST_ELEMENT = -1.0
"""First element of a covariance whose quantity is not measured (REP-145)."""


def channels_of_table(meaning: Meaning) -> list[OutputChannel]:
    """Return the channels of a table's quantities, each with the rows that hold them."""
    values = meaning.values
    found = []
    if "latitude" in values:
        found.append(_build_fix_channel(meaning))
    elif "x" in values:
        found.append(_build_pose_channel(meaning))
    found += _build_velocity_or_speed_channels(meaning)
    if "heading" in values and "x" not in values:
        found.append(_build_heading_channel(meaning))
    if "accel_x" in values or "gyro_x" in values:
        found.append(_build_imu_channel(meaning))
    if "steering" in values:
        rows = np.isfinite(values["steering"])
        fields: dict[str, OutputField] = {
            "stamp": meaning.stamp_ns[rows],
            "steering_tire_angle": values["steering"][rows],
        }
        found.append(
            OutputChannel(STEERING_TOPIC, "autoware_vehicle_msgs/msg/SteeringReport", meaning.stamp_ns[rows], fields)
        )
    return [channel for channel in found if len(channel)]


def _build_quantity_channel(
    meaning: Meaning, topic: str, schema: str, rows: np.ndarray, frame: str, fields: dict[str, FloatArray]
) -> OutputChannel:
    stamp_ns = meaning.stamp_ns[rows]
    n = len(stamp_ns)
    output_fields: dict[str, OutputField] = {
        "header.stamp": stamp_ns,
        "header.frame_id": Strings(np.zeros(n, np.int32), (frame,)),
        **{path: column[rows] for path, column in fields.items()},
    }
    return OutputChannel(topic, schema, stamp_ns, output_fields)


def _unmeasured_column(meaning: Meaning) -> FloatArray:
    return np.full(len(meaning.stamp_ns), np.nan)


def _build_fix_channel(meaning: Meaning) -> OutputChannel:
    values = meaning.values
    rows = new_position_mask(meaning, ("latitude", "longitude"))
    fields = {
        "latitude": values["latitude"],
        "longitude": values["longitude"],
        "altitude": values.get("altitude", _unmeasured_column(meaning)),
    }
    return _build_quantity_channel(meaning, FIX_TOPIC, "sensor_msgs/msg/NavSatFix", rows, BODY_FRAME_ID, fields)


def _build_pose_channel(meaning: Meaning) -> OutputChannel:
    values = meaning.values
    rows = new_position_mask(meaning, ("x", "y"))
    nothing = np.zeros(len(meaning.stamp_ns))
    fields = {
        "pose.position.x": values["x"],
        "pose.position.y": values["y"],
        "pose.position.z": np.nan_to_num(values.get("z", nothing)),
    }
    if "quaternion_w" in values:
        fields |= {f"pose.orientation.{axis}": values[f"quaternion_{axis}"] for axis in "xyzw"}
        rows = rows & np.isfinite(values["quaternion_w"])
    elif "heading" in values:
        half = 0.5 * values["heading"]
        fields |= {"pose.orientation.z": np.sin(half), "pose.orientation.w": np.cos(half)}
        rows = rows & np.isfinite(half)
    else:
        fields["pose.orientation.w"] = nothing + 1.0
    return _build_quantity_channel(meaning, POSE_TOPIC, "geometry_msgs/msg/PoseStamped", rows, MAP_FRAME_ID, fields)


def _build_velocity_or_speed_channels(meaning: Meaning) -> list[OutputChannel]:
    """Return the velocity over ground, where a course comes with the speed; else the speed and the yaw rate."""
    values = meaning.values
    nothing = _unmeasured_column(meaning)
    east, north = values.get("velocity_east"), values.get("velocity_north")
    speed, course = values.get("speed"), values.get("course")
    if east is None and speed is not None and course is not None:
        east, north = speed * np.cos(course), speed * np.sin(course)
        east, north = np.where(speed == 0.0, 0.0, east), np.where(speed == 0.0, 0.0, north)  # no course while standing
    channels = []
    if east is not None and north is not None:
        rows = np.isfinite(east) & np.isfinite(north)
        if "latitude" in values:
            rows &= new_position_mask(meaning, ("latitude", "longitude"))
        fields = {"twist.linear.x": east, "twist.linear.y": north, "twist.angular.z": nothing}
        channels.append(
            _build_quantity_channel(
                meaning, VELOCITY_TOPIC, "geometry_msgs/msg/TwistStamped", rows, MAP_FRAME_ID, fields
            )
        )
    if speed is not None and (course is None or "yaw_rate" in values):
        fields = {
            "twist.linear.x": speed,
            "twist.linear.y": nothing,
            "twist.angular.z": values.get("yaw_rate", nothing),
        }
        rows = np.isfinite(speed) & _new_value_of_receiver_mask(meaning, speed)
        rate = fields["twist.angular.z"]
        if np.isfinite(rate).any() and not np.isfinite(rate[rows]).any():  # a row for each message of a bus
            fields["twist.linear.x"] = np.where(rows, speed, np.nan)
            rows = rows | np.isfinite(rate)
        channels.append(
            _build_quantity_channel(meaning, SPEED_TOPIC, "geometry_msgs/msg/TwistStamped", rows, BODY_FRAME_ID, fields)
        )
    elif "yaw_rate" in values and "gyro_z" not in values:
        channels.append(_build_yaw_rate_channel(meaning))
    return channels


def _new_value_of_receiver_mask(meaning: Meaning, values: FloatArray) -> np.ndarray:
    """Return the rows of new positions where values come with them, and are repeated until the next; else all rows."""
    every = np.ones(len(values), np.bool_)
    if "latitude" not in meaning.values:
        return every
    is_new = new_position_mask(meaning, ("latitude", "longitude"))
    is_held = np.diff(values, prepend=np.nan) == 0.0
    return is_new if not is_new.all() and is_held[~is_new].mean() > MIN_UNCHANGED_SHARE_WITHOUT_NEW_POSITION else every


def _build_yaw_rate_channel(meaning: Meaning) -> OutputChannel:
    """Return a yaw rate without a speed as an IMU of which only the turn rate about the vertical is measured."""
    rows = np.isfinite(meaning.values["yaw_rate"])
    n = len(meaning.stamp_ns)
    fields = {
        "orientation_covariance": _unmeasured_covariances(n),
        "angular_velocity.z": meaning.values["yaw_rate"],
        "linear_acceleration_covariance": _unmeasured_covariances(n),
    }
    return _build_quantity_channel(meaning, IMU_TOPIC, "sensor_msgs/msg/Imu", rows, BODY_FRAME_ID, fields)


def _build_heading_channel(meaning: Meaning) -> OutputChannel:
    half = 0.5 * meaning.values["heading"]
    fields = {"quaternion.z": np.sin(half), "quaternion.w": np.cos(half)}
    rows = np.isfinite(half) & _new_value_of_receiver_mask(meaning, half)
    return _build_quantity_channel(
        meaning, HEADING_TOPIC, "geometry_msgs/msg/QuaternionStamped", rows, MAP_FRAME_ID, fields
    )


def _build_imu_channel(meaning: Meaning) -> OutputChannel:
    values = meaning.values
    n = len(meaning.stamp_ns)
    rows = np.ones(n, np.bool_)
    fields: dict[str, FloatArray] = {
        "orientation.w": np.ones(n),
        "orientation_covariance": _unmeasured_covariances(n),
    }
    for name, path in (("accel", "linear_acceleration"), ("gyro", "angular_velocity")):
        if f"{name}_x" in values:
            for axis in "xyz":
                fields[f"{path}.{axis}"] = values[f"{name}_{axis}"]
                rows &= np.isfinite(values[f"{name}_{axis}"])
        else:
            fields[f"{path}_covariance"] = _unmeasured_covariances(n)
    return _build_quantity_channel(meaning, IMU_TOPIC, "sensor_msgs/msg/Imu", rows, BODY_FRAME_ID, fields)


def _unmeasured_covariances(n: int) -> FloatArray:
    covariance = np.zeros((n, 9))
    covariance[:, 0] = UNMEASURED_COVARIANCE_FIRST_ELEMENT
    return covariance
