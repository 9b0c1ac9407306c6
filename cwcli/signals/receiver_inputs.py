"""The registry rows of messages of GNSS receivers and inertial units: a part of the table in `inputs`."""

from __future__ import annotations

from cwcli.signals.builders.base import Fields, Input
from cwcli.signals.input_rows import (
    FUSED_INS_RANK,
    NMEA_SENTENCE_RANK,
    RECEIVER_RANK,
    RECEIVER_SUMMARY_RANK,
    lazy_builder,
    ros_leaf_fields,
    xyz_leaf_paths,
)
from cwcli.signals.role import Role

_GPS_FIX_FIELDS = ros_leaf_fields(
    *("status.status", "latitude", "longitude", "altitude", "track", "speed", "err_horz", "err_track", "err_speed"),
    *("position_covariance", "position_covariance_type"),
)
"""The leaf fields of a `GPSFix`, by encoding."""
_NAV_PVT_PATHS = (
    *("year", "month", "day", "hour", "min", "sec", "valid", "nano", "flags", "lon", "lat", "height"),
    *("fix_type", "h_acc", "vel_n", "vel_e", "s_acc", "head_acc", "head_veh"),
    *("reserved1", "fixType", "hAcc", "velN", "velE", "sAcc", "headAcc", "headVeh"),
)
"""The leaf paths of a `NavPVT`."""
_NAV_PVT_FIELDS: Fields = dict.fromkeys(("cdr", "json"), _NAV_PVT_PATHS)
"""The leaf fields of a `NavPVT`, by encoding."""
_OEM7_TIME_PATHS = ("nov_header.gps_week_number", "nov_header.gps_week_milliseconds")
"""The leaf paths of the GPS time in messages of `novatel_oem7_msgs`."""
_OEM6_TIME_PATHS = ("novatel_msg_header.gps_week_num", "novatel_msg_header.gps_seconds")
"""The leaf paths of the GPS time in messages of `novatel_gps_msgs`."""
_BEST_POS_OEM7_FIELDS = ros_leaf_fields(
    *(
        *_OEM7_TIME_PATHS,
        "sol_status.status",
        "pos_type.type",
        "lat",
        "lon",
        "hgt",
        "undulation",
        "lat_stdev",
        "lon_stdev",
    )
)
"""The leaf fields of BESTPOS in `novatel_oem7_msgs`, by encoding."""
_BEST_POS_OEM6_FIELDS = ros_leaf_fields(
    *(
        *_OEM6_TIME_PATHS,
        "solution_status",
        "position_type",
        "lat",
        "lon",
        "height",
        "undulation",
        "lat_sigma",
        "lon_sigma",
    )
)
"""The leaf fields of BESTPOS in `novatel_gps_msgs`, by encoding."""
_BEST_VEL_OEM7_FIELDS = ros_leaf_fields(
    *_OEM7_TIME_PATHS, "sol_status.status", "vel_type.type", "latency", "hor_speed", "trk_gnd"
)
"""The leaf fields of BESTVEL in `novatel_oem7_msgs`, by encoding."""
_BEST_VEL_OEM6_FIELDS = ros_leaf_fields(
    *_OEM6_TIME_PATHS, "solution_status", "velocity_type", "latency", "horizontal_speed", "track_ground"
)
"""The leaf fields of BESTVEL in `novatel_gps_msgs`, by encoding."""
_INS_PATHS = ("latitude", "longitude", "undulation", "north_velocity", "east_velocity", "azimuth")
"""The leaf paths that all inertial solutions of NovAtel share."""
_INSPVAX_OEM7_FIELDS = ros_leaf_fields(
    *(*_OEM7_TIME_PATHS, "ins_status.status", *_INS_PATHS, "height"),
    *(f"{name}_stdev" for name in ("latitude", "longitude", "north_velocity", "east_velocity", "azimuth")),
)
"""The leaf fields of INSPVAX in `novatel_oem7_msgs`, by encoding."""
_INSPVAX_OEM6_FIELDS = ros_leaf_fields(
    *(*_OEM6_TIME_PATHS, "ins_status", *_INS_PATHS, "altitude"),
    *(f"{name}_std" for name in ("latitude", "longitude", "north_velocity", "east_velocity", "azimuth")),
)
"""The leaf fields of INSPVAX in `novatel_gps_msgs`, by encoding."""
_INSPVA_PATHS = (*_INS_PATHS, "height", "status.status", "status")
"""The leaf paths of INSPVA."""
_INSPVA_OEM7_FIELDS, _INSPVA_OEM6_FIELDS = (
    ros_leaf_fields(*_OEM7_TIME_PATHS, *_INSPVA_PATHS),
    ros_leaf_fields(*_OEM6_TIME_PATHS, *_INSPVA_PATHS),
)
"""The leaf fields of INSPVA in `novatel_oem7_msgs` and `novatel_gps_msgs`, by encoding."""
_INS_NAV_GEOD_FIELDS = ros_leaf_fields(
    *("block_header.wnc", "block_header.tow", "error", "latitude", "longitude", "height", "ve", "vn"),
    *(f"{name}_std_dev" for name in ("latitude", "longitude", "ve", "vn")),
)
"""The leaf fields of an `INSNavGeod`, by encoding."""
_SBG_IMU_FIELDS = ros_leaf_fields(*xyz_leaf_paths("accel"), *xyz_leaf_paths("gyro"))
"""The leaf fields of a `SbgImuData`, by encoding."""
_PVT_GEODETIC_FIELDS = ros_leaf_fields(
    *("block_header.wnc", "block_header.tow", "mode", "error", "latitude", "longitude", "height", "ve", "vn"),
    "h_accuracy",
)
"""The leaf fields of a `PVTGeodetic`, by encoding."""
_SBG_POSITION_PATHS = ("latitude", "longitude", "altitude", "undulation", "position_accuracy.x", "position_accuracy.y")
"""The leaf paths of an SBG position."""
_SBG_VELOCITY_PATHS = tuple(f"{name}.{axis}" for name in ("velocity", "velocity_accuracy") for axis in "xy")
"""The leaf paths of an SBG velocity."""
_SBG_POS_FIELDS = ros_leaf_fields("status.status", "status.type", *_SBG_POSITION_PATHS)
"""The leaf fields of a `SbgGpsPos`, by encoding."""
_SBG_VEL_FIELDS = ros_leaf_fields("status.vel_status", "status.vel_type", *_SBG_VELOCITY_PATHS)
"""The leaf fields of a `SbgGpsVel`, by encoding."""
_SBG_NAV_FIELDS = ros_leaf_fields(
    *("status.position_valid", "status.velocity_valid", *_SBG_POSITION_PATHS, "position.x", "position.y", "position.z"),
    *_SBG_VELOCITY_PATHS,
)
"""The leaf fields of a `SbgEkfNav`, by encoding."""
_SBG_EULER_FIELDS = ros_leaf_fields("status.heading_valid", "angle.z", "accuracy.z")
"""The leaf fields of a `SbgEkfEuler`, by encoding."""


def _position_input(fields: Fields, name: str, rank: int) -> Input:
    return Input(Role.EGO_POSITION, fields, lazy_builder(name), rank=rank)


def _velocity_input(fields: Fields, name: str, rank: int) -> Input:
    return Input(Role.EGO_VELOCITY, fields, lazy_builder(name), rank=rank)


def _heading_input(fields: Fields, name: str, rank: int | None) -> Input:
    return Input(Role.EGO_HEADING, fields, lazy_builder(name), rank=rank)


def _gps_fix_inputs(fields: Fields) -> tuple[Input, ...]:
    return (
        _position_input(fields, "gps_fix.build_position", RECEIVER_SUMMARY_RANK),
        _velocity_input(fields, "gps_fix.build_velocity", RECEIVER_SUMMARY_RANK),
    )


def _ins_inputs(fields: Fields, message: str = "ins") -> tuple[Input, ...]:
    return (
        _position_input(fields, f"novatel.build_{message}_position", FUSED_INS_RANK),
        _velocity_input(fields, f"novatel.build_{message}_velocity", FUSED_INS_RANK),
        _heading_input(fields, f"novatel.build_{message}_heading", FUSED_INS_RANK),
    )


_NMEA_SENTENCE_FIELDS = ros_leaf_fields("sentence")
"""The leaf fields of an NMEA `Sentence`, by encoding."""

RECEIVER_INPUTS: dict[str, tuple[Input, ...]] = {
    "gps_msgs/GPSFix": _gps_fix_inputs(_GPS_FIX_FIELDS),
    "gps_common/GPSFix": _gps_fix_inputs(_GPS_FIX_FIELDS),
    "nmea_msgs/Sentence": (
        _position_input(_NMEA_SENTENCE_FIELDS, "nmea.build_position", NMEA_SENTENCE_RANK),
        _velocity_input(_NMEA_SENTENCE_FIELDS, "nmea.build_velocity", NMEA_SENTENCE_RANK),
        _heading_input(_NMEA_SENTENCE_FIELDS, "nmea.build_heading", NMEA_SENTENCE_RANK),
    ),
    "ublox_msgs/NavPVT": (
        _position_input(_NAV_PVT_FIELDS, "ublox.build_position", RECEIVER_RANK),
        _velocity_input(_NAV_PVT_FIELDS, "ublox.build_velocity", RECEIVER_RANK),
        # only of receivers with an IMU or two antennas
        _heading_input(_NAV_PVT_FIELDS, "ublox.build_heading", None),
    ),
    "novatel_oem7_msgs/BESTPOS": (_position_input(_BEST_POS_OEM7_FIELDS, "novatel.build_position", RECEIVER_RANK),),
    "novatel_gps_msgs/NovatelPosition": (
        _position_input(_BEST_POS_OEM6_FIELDS, "novatel.build_position", RECEIVER_RANK),
    ),
    "novatel_oem7_msgs/BESTVEL": (_velocity_input(_BEST_VEL_OEM7_FIELDS, "novatel.build_velocity", RECEIVER_RANK),),
    "novatel_gps_msgs/NovatelVelocity": (
        _velocity_input(_BEST_VEL_OEM6_FIELDS, "novatel.build_velocity", RECEIVER_RANK),
    ),
    "novatel_oem7_msgs/INSPVAX": _ins_inputs(_INSPVAX_OEM7_FIELDS),
    "novatel_gps_msgs/Inspvax": _ins_inputs(_INSPVAX_OEM6_FIELDS),
    "novatel_oem7_msgs/INSPVA": _ins_inputs(_INSPVA_OEM7_FIELDS, "inspva"),
    "novatel_gps_msgs/Inspva": _ins_inputs(_INSPVA_OEM6_FIELDS, "inspva"),
    "septentrio_gnss_driver/PVTGeodetic": (
        _position_input(_PVT_GEODETIC_FIELDS, "septentrio.build_position", RECEIVER_RANK),
        _velocity_input(_PVT_GEODETIC_FIELDS, "septentrio.build_velocity", RECEIVER_RANK),
    ),
    "septentrio_gnss_driver/INSNavGeod": (
        _position_input(_INS_NAV_GEOD_FIELDS, "septentrio.build_ins_position", FUSED_INS_RANK),
        _velocity_input(_INS_NAV_GEOD_FIELDS, "septentrio.build_ins_velocity", FUSED_INS_RANK),
    ),
    # the driver sends a sensor_msgs/Imu of the same
    "sbg_driver/SbgImuData": (Input(Role.IMU, _SBG_IMU_FIELDS, lazy_builder("sbg.build_imu"), rank=RECEIVER_RANK),),
    "sbg_driver/SbgGpsPos": (_position_input(_SBG_POS_FIELDS, "sbg.build_position", RECEIVER_RANK),),
    "sbg_driver/SbgGpsVel": (_velocity_input(_SBG_VEL_FIELDS, "sbg.build_velocity", RECEIVER_RANK),),
    "sbg_driver/SbgEkfNav": (
        _position_input(_SBG_NAV_FIELDS, "sbg.build_ekf_position", FUSED_INS_RANK),
        _velocity_input(_SBG_NAV_FIELDS, "sbg.build_ekf_velocity", FUSED_INS_RANK),
    ),
    "sbg_driver/SbgEkfEuler": (_heading_input(_SBG_EULER_FIELDS, "sbg.build_heading", FUSED_INS_RANK),),
}
"""The registry rows of messages of receivers and inertial units, by schema name."""
