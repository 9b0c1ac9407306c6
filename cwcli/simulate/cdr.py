"""The ROS 2 messages of a simulated log, encoded as CDR, a whole channel at a time.

With a constant `frame_id` every message of these types has the same layout, so that a channel is one NumPy array of
records. (The writer of `mcap-ros2-support` writes files of CDR channels only, and has no public function that encodes a
message.) The tests read the bytes with the official decoder.

Values are rounded to a fixed, tiny step (stated in each function), so that the last bits of a processor's sine can't
change the bytes of a log.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cwcli.signals.columns import Int64Array
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.units import NS_PER_S
from cwcli.simulation.sensors import SensorData

BODY_FRAME_ID = "base_link"
"""Value of `frame_id` in all headers: the vehicle's body frame of REP-105."""
CDR_LITTLE_ENDIAN_HEADER = b"\x00\x01\x00\x00"
"""Encapsulation header of little-endian CDR, the first four bytes of a message."""

_HEADER_DEFINITION = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id

================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
"""Definition of `std_msgs/Header`, as the MCAP schema of a message that uses it appends it."""
_QUATERNION_DEFINITION = """
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""
"""Definition of `geometry_msgs/Quaternion`, as the MCAP schema of a message that uses it appends it."""

ROS_MESSAGE_DEFINITIONS = {
    "sensor_msgs/msg/NavSatFix": """uint8 COVARIANCE_TYPE_UNKNOWN=0
uint8 COVARIANCE_TYPE_APPROXIMATED=1
uint8 COVARIANCE_TYPE_DIAGONAL_KNOWN=2
uint8 COVARIANCE_TYPE_KNOWN=3
std_msgs/Header header
sensor_msgs/NavSatStatus status
float64 latitude
float64 longitude
float64 altitude
float64[9] position_covariance
uint8 position_covariance_type
"""
    + _HEADER_DEFINITION
    + """
================================================================================
MSG: sensor_msgs/NavSatStatus
int8 STATUS_NO_FIX=-1
int8 STATUS_FIX=0
int8 STATUS_SBAS_FIX=1
int8 STATUS_GBAS_FIX=2
uint16 SERVICE_GPS=1
uint16 SERVICE_GLONASS=2
uint16 SERVICE_COMPASS=4
uint16 SERVICE_GALILEO=8
int8 status
uint16 service
""",
    "geometry_msgs/msg/QuaternionStamped": """std_msgs/Header header
geometry_msgs/Quaternion quaternion
"""
    + _HEADER_DEFINITION
    + _QUATERNION_DEFINITION,
    "autoware_vehicle_msgs/msg/VelocityReport": """std_msgs/Header header
float32 longitudinal_velocity
float32 lateral_velocity
float32 heading_rate
"""
    + _HEADER_DEFINITION,
    "sensor_msgs/msg/Imu": """std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
"""
    + _HEADER_DEFINITION
    + _QUATERNION_DEFINITION
    + """
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
""",
}
"""ROS 2 message definitions by schema name, from common_interfaces and autoware_msgs without their comments."""

_MEMBER_LAYOUTS = {
    "sensor_msgs/msg/NavSatFix": (
        ("status", "<i1", 1),
        ("service", "<u2", 1),
        ("position", "<f8", 3),
        ("covariance", "<f8", 9),
        ("covariance_type", "<u1", 1),
    ),
    "geometry_msgs/msg/QuaternionStamped": (("quaternion", "<f8", 4),),
    "autoware_vehicle_msgs/msg/VelocityReport": (("velocity", "<f4", 3),),
    "sensor_msgs/msg/Imu": (
        ("orientation", "<f8", 4),
        ("orientation_covariance", "<f8", 9),
        ("gyro", "<f8", 3),
        ("gyro_covariance", "<f8", 9),
        ("accel", "<f8", 3),
        ("accel_covariance", "<f8", 9),
    ),
}
"""Members of each message after the header: name, NumPy type and count; neighbours of one type are joined."""


def encode_navsat_fixes(data: SensorData, local_map: LocalMap) -> list[bytes]:
    """Encode `gnss` measurements as `sensor_msgs/msg/NavSatFix`; steps of 1e-9 deg and 0.1 mm."""
    lat_deg, lon_deg, alt_m = local_map.wgs84_from_map(*data.values.T)
    records = _make_cdr_records("sensor_msgs/msg/NavSatFix", data.stamp_ns)
    records["status"] = 2  # GBAS fix: differential corrections
    records["service"] = 1  # GPS
    records["position"] = np.column_stack([lat_deg.round(9), lon_deg.round(9), alt_m.round(4)])
    records["covariance"][:, [0, 4, 8]] = data.sigma**2
    records["covariance_type"] = 2  # diagonal known
    return _split_records_into_messages(records)


def encode_gnss_headings(data: SensorData) -> list[bytes]:
    """Encode headings of a GNSS as `geometry_msgs/msg/QuaternionStamped` (map from body); steps of 1e-12."""
    records = _make_cdr_records("geometry_msgs/msg/QuaternionStamped", data.stamp_ns)
    half = data.values[:, 0] / 2
    records["quaternion"][:, 2] = np.sin(half).round(12)
    records["quaternion"][:, 3] = np.cos(half).round(12)
    return _split_records_into_messages(records)


def encode_velocity_reports(data: SensorData) -> list[bytes]:
    """Encode `speed` measurements as `autoware_vehicle_msgs/msg/VelocityReport`; its yaw rate is NaN."""
    records = _make_cdr_records("autoware_vehicle_msgs/msg/VelocityReport", data.stamp_ns)
    records["velocity"][:, 0] = data.values[:, 0].round(6)
    records["velocity"][:, 2] = np.nan
    return _split_records_into_messages(records)


def encode_imu_messages(data: SensorData) -> list[bytes]:
    """Encode `imu` measurements as `sensor_msgs/msg/Imu` without orientation; steps of 1e-9."""
    records = _make_cdr_records("sensor_msgs/msg/Imu", data.stamp_ns)
    records["orientation"][:, 3] = 1.0
    records["orientation_covariance"][:, 0] = -1.0  # REP-145: no orientation
    records["accel"] = data.values[:, :3].round(9)
    records["accel_covariance"][:, [0, 4, 8]] = data.sigma[:3] ** 2
    records["gyro"] = data.values[:, 3:].round(9)
    records["gyro_covariance"][:, [0, 4, 8]] = data.sigma[3:] ** 2
    return _split_records_into_messages(records)


def _make_cdr_records(schema_name: str, stamp_ns: Int64Array) -> np.ndarray[Any, np.dtype[np.void]]:
    """Make zeroed records of one message type, shape (n,), with the CDR and the ROS header filled in.

    CDR aligns each member to its size, counted from the end of the 4-byte encapsulation header.
    """
    frame = BODY_FRAME_ID.encode() + b"\0"
    names, formats, offsets = ["cdr"], [f"V{len(CDR_LITTLE_ENDIAN_HEADER)}"], [0]
    position = 0
    members = (("sec", "<i4", 1), ("nanosec", "<u4", 1), ("frame_length", "<u4", 1), ("frame", f"V{len(frame)}", 1))
    for name, code, count in (*members, *_MEMBER_LAYOUTS[schema_name]):
        size = np.dtype(code).itemsize
        alignment = 1 if code.startswith("V") else size
        position += -position % alignment
        names.append(name)
        formats.append(code if count == 1 else f"({count},){code}")
        offsets.append(len(CDR_LITTLE_ENDIAN_HEADER) + position)
        position += size * count
    layout = np.dtype(
        {"names": names, "formats": formats, "offsets": offsets, "itemsize": len(CDR_LITTLE_ENDIAN_HEADER) + position}
    )
    records = np.zeros(len(stamp_ns), layout)
    records["cdr"] = np.void(CDR_LITTLE_ENDIAN_HEADER)
    records["sec"], records["nanosec"] = np.divmod(stamp_ns, NS_PER_S)
    records["frame_length"] = len(frame)
    records["frame"] = np.void(frame)
    return records


def _split_records_into_messages(records: np.ndarray[Any, np.dtype[np.void]]) -> list[bytes]:
    """Split records (n,) into the bytes of n messages."""
    size = records.dtype.itemsize
    data = records.tobytes()
    return [data[start : start + size] for start in range(0, len(data), size)]
