"""ETSI cooperative awareness: `etsi_its_cam_msgs/CAM` (EN 302 637-2) and `etsi_its_cam_ts_msgs/CAM` (TS 103 900).

Codes after TS 102 894-2 (common data dictionary). docs/v2x.md shows the table; a test compares the two.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.angles import heading_from_compass_deg, wrap_angle
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.covariances import (
    SIGMAS_PER_95_PERCENT,
    SIGMAS_PER_95_PERCENT_ELLIPSE,
    covariance_from_ellipse,
)
from cwcli.signals.leaf_fields import read_numbers
from cwcli.signals.quality import RowLedger
from cwcli.signals.v2x_codec import RemoteRows, Senders, V2xCodec
from cwcli.signals.v2x_elements import Element, decode_element, read_station_ids
from cwcli.signals.v2x_time import message_time_or_log_time, stamp_from_generation_delta_time

ELEMENTS: dict[str, Element] = {
    "latitude_deg": Element("Latitude", 1e-7, 1, -900_000_000, 900_000_000, (900_000_001,)),
    "longitude_deg": Element("Longitude", 1e-7, 1, -1_800_000_000, 1_800_000_000, (1_800_000_001,)),
    "altitude_m": Element("AltitudeValue", 0.01, 1, -100_000, 800_000, (800_001,)),
    "semi_major_m": Element("SemiAxisLength (major)", 0.01, 1, 1, 4093, (4095,), (4094,)),
    "semi_minor_m": Element("SemiAxisLength (minor)", 0.01, 1, 1, 4093, (4095,), (4094,)),
    "semi_major_compass_deg": Element("HeadingValue (ellipse)", 0.1, 1, 0, 3600, (3601,)),
    "heading_compass_deg": Element("HeadingValue", 0.1, 1, 0, 3600, (3601,)),
    "heading_95_deg": Element("HeadingConfidence", 0.1, 1, 1, 125, (127,), (126,)),
    "speed_mps": Element("SpeedValue", 0.01, 1, 0, 16_382, (16_383,)),
    "speed_95_mps": Element("SpeedConfidence", 0.01, 1, 1, 125, (127,), (126,)),
    "accel_mps2": Element("LongitudinalAccelerationValue", 0.1, 1, -160, 160, (161,)),
    "accel_95_mps2": Element("AccelerationConfidence", 0.1, 1, 1, 100, (102,), (101,)),
    "lateral_accel_mps2": Element("LateralAccelerationValue", 0.1, 1, -160, 160, (161,)),
    "yaw_rate_degps": Element("YawRateValue", 0.01, 1, -32_766, 32_766, (32_767,)),
    "length_m": Element("VehicleLengthValue", 0.1, 1, 1, 1021, (1023,), (1022,)),
    "width_m": Element("VehicleWidth", 0.1, 1, 1, 60, (62,), (61,)),
}
"""The data element of each coded quantity of a CAM or VAM (TS 102 894-2)."""
STATION_ID_PATHS = ("header.station_id.value", "header.station_id")
"""The paths of the station id in the ROS messages."""
YAW_RATE_95_DEGPS_BY_CODE: dict[int, float] = {0: 0.01, 1: 0.05, 2: 0.1, 3: 1.0, 4: 5.0, 5: 10.0, 6: 100.0}
"""The 95 % bound of a yaw rate in degrees/s, by code of YawRateConfidence; 7 is out of range, 8 unavailable."""
YAW_RATE_OUT_OF_RANGE_CODE = 7
"""The code of YawRateConfidence that says that the yaw rate can't be trusted."""
DRIVE_BACKWARD_CODE = 1
"""The code of DriveDirection for driving backward."""
ROADSIDE_UNIT_STATION_TYPE = 15
"""The station type of a roadside unit (TS 102 894-2)."""
VEHICLE_CONTAINER_CHOICE = 0
"""The index of the vehicle's container among the high-frequency containers."""

UNTRUSTED_POSITION_REASON = "position confidence out of range"
"""The reason for rejecting a message whose position can't be trusted."""

_PARAMETERS_PREFIX = "cam.cam_parameters."
"""The path prefix of the parameters in the ROS message of a CAM."""
_POSITION_PREFIX = _PARAMETERS_PREFIX + "basic_container.reference_position."
"""The path prefix of the reference position in a CAM."""
_ELLIPSE_PREFIX = _POSITION_PREFIX + "position_confidence_ellipse."
"""The path prefix of the position's confidence ellipse in a CAM."""
_VEHICLE_CONTAINER_PREFIX = _PARAMETERS_PREFIX + "high_frequency_container.basic_vehicle_container_high_frequency."
"""The path prefix of the vehicle's high-frequency container in a CAM."""

_COMMON_CAM_PATHS: dict[str, str] = {
    "station": "header.station_id.value",
    "generation_delta_time": "cam.generation_delta_time.value",
    "station_type": _PARAMETERS_PREFIX + "basic_container.station_type.value",
    "container": _PARAMETERS_PREFIX + "high_frequency_container.choice",
    "latitude_deg": _POSITION_PREFIX + "latitude.value",
    "longitude_deg": _POSITION_PREFIX + "longitude.value",
    "altitude_m": _POSITION_PREFIX + "altitude.altitude_value.value",
    "heading_compass_deg": _VEHICLE_CONTAINER_PREFIX + "heading.heading_value.value",
    "heading_95_deg": _VEHICLE_CONTAINER_PREFIX + "heading.heading_confidence.value",
    "speed_mps": _VEHICLE_CONTAINER_PREFIX + "speed.speed_value.value",
    "speed_95_mps": _VEHICLE_CONTAINER_PREFIX + "speed.speed_confidence.value",
    "drive_direction": _VEHICLE_CONTAINER_PREFIX + "drive_direction.value",
    "yaw_rate_degps": _VEHICLE_CONTAINER_PREFIX + "yaw_rate.yaw_rate_value.value",
    "yaw_rate_confidence": _VEHICLE_CONTAINER_PREFIX + "yaw_rate.yaw_rate_confidence.value",
    "length_m": _VEHICLE_CONTAINER_PREFIX + "vehicle_length.vehicle_length_value.value",
    "width_m": _VEHICLE_CONTAINER_PREFIX + "vehicle_width.value",
    "has_lateral_accel": _VEHICLE_CONTAINER_PREFIX + "lateral_acceleration_is_present",
}
"""The leaf fields that both packages of CAM messages share, by quantity."""
EN_PATHS: dict[str, str] = _COMMON_CAM_PATHS | {
    "semi_major_m": _ELLIPSE_PREFIX + "semi_major_confidence.value",
    "semi_minor_m": _ELLIPSE_PREFIX + "semi_minor_confidence.value",
    "semi_major_compass_deg": _ELLIPSE_PREFIX + "semi_major_orientation.value",
    "accel_mps2": _VEHICLE_CONTAINER_PREFIX + "longitudinal_acceleration.longitudinal_acceleration_value.value",
    "accel_95_mps2": _VEHICLE_CONTAINER_PREFIX + "longitudinal_acceleration.longitudinal_acceleration_confidence.value",
    "lateral_accel_mps2": _VEHICLE_CONTAINER_PREFIX + "lateral_acceleration.lateral_acceleration_value.value",
}
"""The leaf fields of `etsi_its_cam_msgs/CAM`, by quantity."""
TS_PATHS: dict[str, str] = _COMMON_CAM_PATHS | {
    "semi_major_m": _ELLIPSE_PREFIX + "semi_major_axis_length.value",
    "semi_minor_m": _ELLIPSE_PREFIX + "semi_minor_axis_length.value",
    "semi_major_compass_deg": _ELLIPSE_PREFIX + "semi_major_axis_orientation.value",
    "accel_mps2": _VEHICLE_CONTAINER_PREFIX + "longitudinal_acceleration.value.value",
    "accel_95_mps2": _VEHICLE_CONTAINER_PREFIX + "longitudinal_acceleration.confidence.value",
    "lateral_accel_mps2": _VEHICLE_CONTAINER_PREFIX + "lateral_acceleration.value.value",
}
"""The leaf fields of `etsi_its_cam_ts_msgs/CAM`, by quantity; two containers have other names inside."""
_VAM_POSITION_PREFIX = "vam.vam_parameters.basic_container.reference_position."
"""The path prefix of the reference position in a VAM."""
_VAM_ELLIPSE_PREFIX = _VAM_POSITION_PREFIX + "position_confidence_ellipse."
"""The path prefix of the position's confidence ellipse in a VAM."""
_VRU_CONTAINER_PREFIX = "vam.vam_parameters.vru_high_frequency_container."
"""The path prefix of the road user's high-frequency container in a VAM."""
VAM_PATHS: dict[str, str] = {
    "station": "header.station_id.value",
    "generation_delta_time": "vam.generation_delta_time.value",
    "station_type": "vam.vam_parameters.basic_container.station_type.value",
    "latitude_deg": _VAM_POSITION_PREFIX + "latitude.value",
    "longitude_deg": _VAM_POSITION_PREFIX + "longitude.value",
    "altitude_m": _VAM_POSITION_PREFIX + "altitude.altitude_value.value",
    "semi_major_m": _VAM_ELLIPSE_PREFIX + "semi_major_axis_length.value",
    "semi_minor_m": _VAM_ELLIPSE_PREFIX + "semi_minor_axis_length.value",
    "semi_major_compass_deg": _VAM_ELLIPSE_PREFIX + "semi_major_axis_orientation.value",
    "heading_compass_deg": _VRU_CONTAINER_PREFIX + "heading.value.value",
    "heading_95_deg": _VRU_CONTAINER_PREFIX + "heading.confidence.value",
    "speed_mps": _VRU_CONTAINER_PREFIX + "speed.speed_value.value",
    "speed_95_mps": _VRU_CONTAINER_PREFIX + "speed.speed_confidence.value",
    "yaw_rate_degps": _VRU_CONTAINER_PREFIX + "yaw_rate.yaw_rate_value.value",
    "yaw_rate_confidence": _VRU_CONTAINER_PREFIX + "yaw_rate.yaw_rate_confidence.value",
    "has_yaw_rate": _VRU_CONTAINER_PREFIX + "yaw_rate_is_present",
    "accel_mps2": _VRU_CONTAINER_PREFIX + "longitudinal_acceleration.longitudinal_acceleration_value.value",
    "accel_95_mps2": _VRU_CONTAINER_PREFIX + "longitudinal_acceleration.longitudinal_acceleration_confidence.value",
    "lateral_accel_mps2": _VRU_CONTAINER_PREFIX + "lateral_acceleration.lateral_acceleration_value.value",
    "has_lateral_accel": _VRU_CONTAINER_PREFIX + "lateral_acceleration_is_present",
}
"""The leaf fields of `etsi_its_vam_ts_msgs/VAM` (TS 103 300-3), by quantity; it has no size and no driving direction,
and its yaw rate is optional."""


def identify_cam_senders(columns: Columns) -> Senders:
    """Return the senders of CAMs; roadside units are known by station type or high-frequency container."""
    station_type = read_numbers(columns, EN_PATHS["station_type"], VAM_PATHS["station_type"])
    container = read_numbers(columns, EN_PATHS["container"])
    return Senders(
        station=read_station_ids(columns, *STATION_ID_PATHS),
        is_own=np.zeros(len(columns), dtype=np.bool_),
        is_roadside=(station_type == ROADSIDE_UNIT_STATION_TYPE) | (container > VEHICLE_CONTAINER_CHOICE),
    )


def decode_cam(columns: Columns, ledger: RowLedger) -> RemoteRows:
    """Decode a CAM channel of either package, or a VAM channel.

    The heading of a CAM is that of the velocity (TS 102 894-2, HeadingValue). Driving backward, the vehicle's own
    heading is the opposite one and its speed negative: heading and speed together are still the velocity.

    A confidence of "out of range" says that its value is not valid and cannot be trusted: the value is left out, and
    for the position the whole message. Confidences are bounds for 95 %: sigma = bound / 1.96, and for the two axes of
    the position ellipse bound / 2.4477.

    Args:
        columns: The channel, with the fields of `EN_PATHS`, `TS_PATHS` or `VAM_PATHS`.
        ledger: The channel's ledger; messages with an untrusted position are rejected here.

    Returns:
        Decoded rows.
    """
    paths = {name: (path, TS_PATHS[name], VAM_PATHS.get(name, path)) for name, path in EN_PATHS.items()}
    raw = {name: read_numbers(columns, *own) for name, own in paths.items() if name != "station"}
    value = {name: decode_element(element, raw[name], ledger) for name, element in ELEMENTS.items()}
    read_station_ids(columns, *STATION_ID_PATHS, ledger=ledger)

    for name, confidence in (
        ("heading_compass_deg", "heading_95_deg"),
        ("speed_mps", "speed_95_mps"),
        ("accel_mps2", "accel_95_mps2"),
    ):
        value[name] = np.where(np.isin(raw[confidence], ELEMENTS[confidence].out_of_range), np.nan, value[name])
    yaw_untrusted = raw["yaw_rate_confidence"] == YAW_RATE_OUT_OF_RANGE_CODE
    yaw_untrusted |= read_numbers(columns, VAM_PATHS["has_yaw_rate"]) == 0
    value["yaw_rate_degps"] = np.where(yaw_untrusted, np.nan, value["yaw_rate_degps"])
    is_absent = raw["has_lateral_accel"] == 0
    value["lateral_accel_mps2"] = np.where(is_absent, np.nan, value["lateral_accel_mps2"])
    untrusted = np.isin(raw["semi_major_m"], ELEMENTS["semi_major_m"].out_of_range)
    untrusted |= np.isin(raw["semi_minor_m"], ELEMENTS["semi_minor_m"].out_of_range)
    ledger.reject(untrusted, UNTRUSTED_POSITION_REASON)

    is_backward = raw["drive_direction"] == DRIVE_BACKWARD_CODE
    motion_rad = heading_from_compass_deg(value["heading_compass_deg"])
    stamp_ns, has_time = stamp_from_generation_delta_time(raw["generation_delta_time"], columns.log_time_ns)
    return RemoteRows(
        stamp_ns=message_time_or_log_time(ledger, stamp_ns, has_time),
        latitude_deg=value["latitude_deg"],
        longitude_deg=value["longitude_deg"],
        altitude_m=value["altitude_m"],
        speed_mps=np.where(is_backward, -value["speed_mps"], value["speed_mps"]),
        heading_rad=np.where(is_backward, wrap_angle(motion_rad + np.pi), motion_rad),
        accel_mps2=value["accel_mps2"],
        lateral_accel_mps2=value["lateral_accel_mps2"],
        yaw_rate_radps=np.deg2rad(value["yaw_rate_degps"]),
        length_m=value["length_m"],
        width_m=value["width_m"],
        position_covariance_m2=covariance_from_ellipse(
            value["semi_major_m"] / SIGMAS_PER_95_PERCENT_ELLIPSE,
            value["semi_minor_m"] / SIGMAS_PER_95_PERCENT_ELLIPSE,
            value["semi_major_compass_deg"],
        ),
        speed_sigma_mps=value["speed_95_mps"] / SIGMAS_PER_95_PERCENT,
        heading_sigma_rad=np.deg2rad(value["heading_95_deg"]) / SIGMAS_PER_95_PERCENT,
        accel_sigma_mps2=value["accel_95_mps2"] / SIGMAS_PER_95_PERCENT,
        yaw_rate_sigma_radps=np.deg2rad(_yaw_rate_bounds_degps(raw["yaw_rate_confidence"])) / SIGMAS_PER_95_PERCENT,
        message_count=np.full(len(columns), np.nan),
    )


def _yaw_rate_bounds_degps(code: FloatArray) -> FloatArray:
    bound = np.full(len(code), np.nan)
    for known, degps in YAW_RATE_95_DEGPS_BY_CODE.items():
        bound[code == known] = degps
    return bound


CAM = V2xCodec(identify_cam_senders, decode_cam)
"""The codec of ROS channels of CAMs and VAMs."""
