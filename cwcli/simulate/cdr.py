"""The ROS 2 messages of a simulated log, encoded as CDR, a whole channel at a time.

The tests read the bytes with the official decoder.

Values are rounded to a fixed, tiny step (stated in each function), so that the last bits of a processor's sine can't
change the bytes of a log.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cwcli.logs.encoders.byte_rows import ByteRows
from cwcli.logs.encoders.cdr_encoder import encode_cdr
from cwcli.signals.columns import FloatArray, OutputField, repeat_string
from cwcli.signals.geodesy import LocalMap
from cwcli.simulation.sensors import SensorData

BODY_FRAME_ID = "base_link"
"""Value of `frame_id` in all headers: the vehicle's body frame of REP-105."""

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


def encode_navsat_fixes(data: SensorData, local_map: LocalMap) -> ByteRows:
    """Encode `gnss` measurements as `sensor_msgs/msg/NavSatFix`; steps of 1e-9 deg and 0.1 mm."""
    lat_deg, lon_deg, alt_m = local_map.wgs84_from_map(*data.values.T)
    n = len(data.stamp_ns)
    fields = {
        "status.status": np.full(n, 2),  # GBAS fix: differential corrections
        "status.service": np.full(n, 1),  # GPS
        "latitude": lat_deg.round(9),
        "longitude": lon_deg.round(9),
        "altitude": alt_m.round(4),
        "position_covariance": _flattened_diagonal_covariances(data.sigma, n),
        "position_covariance_type": np.full(n, 2),  # diagonal known
    }
    return _encode_cdr_with_stamp_and_frame("sensor_msgs/msg/NavSatFix", data, fields)


def encode_gnss_headings(data: SensorData) -> ByteRows:
    """Encode headings of a GNSS as `geometry_msgs/msg/QuaternionStamped` (map from body); steps of 1e-12."""
    half = data.values[:, 0] / 2
    fields = {"quaternion.z": np.sin(half).round(12), "quaternion.w": np.cos(half).round(12)}
    return _encode_cdr_with_stamp_and_frame("geometry_msgs/msg/QuaternionStamped", data, fields)


def encode_velocity_reports(data: SensorData) -> ByteRows:
    """Encode `speed` measurements as `autoware_vehicle_msgs/msg/VelocityReport`; its yaw rate is NaN."""
    fields = {"longitudinal_velocity": data.values[:, 0].round(6), "heading_rate": np.full(len(data.values), np.nan)}
    return _encode_cdr_with_stamp_and_frame("autoware_vehicle_msgs/msg/VelocityReport", data, fields)


def encode_imu_messages(data: SensorData) -> ByteRows:
    """Encode `imu` measurements as `sensor_msgs/msg/Imu` without orientation; steps of 1e-9."""
    n, values = len(data.stamp_ns), data.values.round(9)
    fields = {
        "orientation.w": np.ones(n),
        "orientation_covariance": np.tile([-1.0, *np.zeros(8)], (n, 1)),  # REP-145: no orientation
        **{f"linear_acceleration.{axis}": values[:, k] for k, axis in enumerate("xyz")},
        "linear_acceleration_covariance": _flattened_diagonal_covariances(data.sigma[:3], n),
        **{f"angular_velocity.{axis}": values[:, 3 + k] for k, axis in enumerate("xyz")},
        "angular_velocity_covariance": _flattened_diagonal_covariances(data.sigma[3:], n),
    }
    return _encode_cdr_with_stamp_and_frame("sensor_msgs/msg/Imu", data, fields)


def _flattened_diagonal_covariances(sigma: FloatArray, n: int) -> FloatArray:
    """Return n equal 3 x 3 covariances, row by row, of independent values with these three standard deviations."""
    return np.tile(np.diag(sigma**2).ravel(), (n, 1))


def _encode_cdr_with_stamp_and_frame(schema_name: str, data: SensorData, fields: Mapping[str, OutputField]) -> ByteRows:
    """Encode the messages of a sensor from their fields, with stamp and frame of reference in the header."""
    n = len(data.stamp_ns)
    header: dict[str, OutputField] = {
        "header.stamp": data.stamp_ns,
        "header.frame_id": repeat_string(BODY_FRAME_ID, n),
    }
    return encode_cdr(schema_name, {**header, **fields}, n)
