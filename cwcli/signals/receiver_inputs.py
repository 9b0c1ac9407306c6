"""The registry rows of messages of GNSS receivers and inertial units: a part of the table in `inputs`."""

from __future__ import annotations

from cwcli.signals.builders.base import Input
from cwcli.signals.input_rows import (
    FUSED_INS_RANK,
    NMEA_SENTENCE_RANK,
    RECEIVER_RANK,
    RECEIVER_SUMMARY_RANK,
    header_free_leaf_fields,
    inputs_of_message,
    inputs_of_receiver_message,
    ros_leaf_fields,
    xyz_leaf_paths,
)
from cwcli.signals.role import Role

_NAV_PVT_FIELDS = header_free_leaf_fields(
    *("year", "month", "day", "hour", "min", "sec", "valid", "nano", "flags", "lon", "lat", "height"),
    *("fix_type", "h_acc", "vel_n", "vel_e", "s_acc", "head_acc", "head_veh"),
    *("reserved1", "fixType", "hAcc", "velN", "velE", "sAcc", "headAcc", "headVeh"),
)
"""The leaf fields of a `NavPVT`, by encoding."""
_OEM7_TIME_PATHS = ("nov_header.gps_week_number", "nov_header.gps_week_milliseconds")
"""The leaf paths of the GPS time in messages of `novatel_oem7_msgs`."""
_OEM6_TIME_PATHS = ("novatel_msg_header.gps_week_num", "novatel_msg_header.gps_seconds")
"""The leaf paths of the GPS time in messages of `novatel_gps_msgs`."""
_PATHS_SHARED_BY_NOVATEL_INERTIAL_SOLUTIONS = (
    "latitude",
    "longitude",
    "undulation",
    "north_velocity",
    "east_velocity",
    "azimuth",
)
"""The leaf paths that all inertial solutions of NovAtel share."""
_INSPVAX_QUANTITIES_WITH_STANDARD_DEVIATION = ("latitude", "longitude", "north_velocity", "east_velocity", "azimuth")
"""The names of the quantities of which an INSPVAX gives a standard deviation."""
_INSPVA_PATHS = (*_PATHS_SHARED_BY_NOVATEL_INERTIAL_SOLUTIONS, "height", "status.status", "status")
"""The leaf paths of INSPVA."""
_PATHS_SHARED_BY_SEPTENTRIO_POSITION_MESSAGES = (
    *("block_header.wnc", "block_header.tow", "error"),
    *("latitude", "longitude", "height", "ve", "vn"),
)
"""The leaf paths that the position messages of Septentrio share."""
_SBG_POSITION_PATHS = ("latitude", "longitude", "altitude", "undulation", "position_accuracy.x", "position_accuracy.y")
"""The leaf paths of an SBG position."""
_SBG_VELOCITY_PATHS = tuple(f"{name}.{axis}" for name in ("velocity", "velocity_accuracy") for axis in "xy")
"""The leaf paths of an SBG velocity."""
_SBG_EKF_NAV_FIELDS = ros_leaf_fields(
    *("status.position_valid", "status.velocity_valid", *xyz_leaf_paths("position")),
    *(*_SBG_POSITION_PATHS, *_SBG_VELOCITY_PATHS),
)
"""The leaf fields of an `SbgEkfNav`, by encoding."""


_POSITION_VELOCITY_ROLES = (Role.EGO_POSITION, Role.EGO_VELOCITY)
"""The roles that a message with position and velocity can fill."""
_WHOLE_MOTION_ROLES = (*_POSITION_VELOCITY_ROLES, Role.EGO_HEADING)
"""The roles that a message with position, velocity and heading can fill."""

RECEIVER_INPUTS: dict[str, tuple[Input, ...]] = {
    **dict.fromkeys(
        ("gps_msgs/GPSFix", "gps_common/GPSFix"),
        inputs_of_receiver_message(
            ros_leaf_fields(
                *("status.status", "latitude", "longitude", "altitude", "track", "speed"),
                *("err_horz", "err_track", "err_speed", "position_covariance", "position_covariance_type"),
            ),
            RECEIVER_SUMMARY_RANK,
            "gps_fix.read_gps_fix",
            *_POSITION_VELOCITY_ROLES,
        ),
    ),
    "nmea_msgs/Sentence": inputs_of_receiver_message(
        ros_leaf_fields("sentence"), NMEA_SENTENCE_RANK, "nmea.read_sentences", *_WHOLE_MOTION_ROLES
    ),
    "ublox_msgs/NavPVT": (
        *inputs_of_receiver_message(_NAV_PVT_FIELDS, RECEIVER_RANK, "ublox.read_nav_pvt", *_POSITION_VELOCITY_ROLES),
        # only of receivers with an IMU or two antennas
        *inputs_of_receiver_message(_NAV_PVT_FIELDS, None, "ublox.read_nav_pvt", Role.EGO_HEADING),
    ),
    "novatel_oem7_msgs/BESTPOS": inputs_of_receiver_message(
        ros_leaf_fields(
            *(*_OEM7_TIME_PATHS, "sol_status.status", "pos_type.type"),
            *("lat", "lon", "hgt", "undulation", "lat_stdev", "lon_stdev"),
        ),
        RECEIVER_RANK,
        "novatel.read_bestpos",
        Role.EGO_POSITION,
    ),
    "novatel_gps_msgs/NovatelPosition": inputs_of_receiver_message(
        ros_leaf_fields(
            *(*_OEM6_TIME_PATHS, "solution_status", "position_type"),
            *("lat", "lon", "height", "undulation", "lat_sigma", "lon_sigma"),
        ),
        RECEIVER_RANK,
        "novatel.read_bestpos",
        Role.EGO_POSITION,
    ),
    "novatel_oem7_msgs/BESTVEL": inputs_of_receiver_message(
        ros_leaf_fields(*_OEM7_TIME_PATHS, "sol_status.status", "vel_type.type", "latency", "hor_speed", "trk_gnd"),
        RECEIVER_RANK,
        "novatel.read_bestvel",
        Role.EGO_VELOCITY,
    ),
    "novatel_gps_msgs/NovatelVelocity": inputs_of_receiver_message(
        ros_leaf_fields(
            *(*_OEM6_TIME_PATHS, "solution_status", "velocity_type"), *("latency", "horizontal_speed", "track_ground")
        ),
        RECEIVER_RANK,
        "novatel.read_bestvel",
        Role.EGO_VELOCITY,
    ),
    "novatel_oem7_msgs/INSPVAX": inputs_of_receiver_message(
        ros_leaf_fields(
            *(*_OEM7_TIME_PATHS, "ins_status.status", *_PATHS_SHARED_BY_NOVATEL_INERTIAL_SOLUTIONS, "height"),
            *(f"{name}_stdev" for name in _INSPVAX_QUANTITIES_WITH_STANDARD_DEVIATION),
        ),
        FUSED_INS_RANK,
        "novatel.read_inspvax",
        *_WHOLE_MOTION_ROLES,
    ),
    "novatel_gps_msgs/Inspvax": inputs_of_receiver_message(
        ros_leaf_fields(
            *(*_OEM6_TIME_PATHS, "ins_status", *_PATHS_SHARED_BY_NOVATEL_INERTIAL_SOLUTIONS, "altitude"),
            *(f"{name}_std" for name in _INSPVAX_QUANTITIES_WITH_STANDARD_DEVIATION),
        ),
        FUSED_INS_RANK,
        "novatel.read_inspvax",
        *_WHOLE_MOTION_ROLES,
    ),
    "novatel_oem7_msgs/INSPVA": inputs_of_receiver_message(
        ros_leaf_fields(*_OEM7_TIME_PATHS, *_INSPVA_PATHS), FUSED_INS_RANK, "novatel.read_inspva", *_WHOLE_MOTION_ROLES
    ),
    "novatel_gps_msgs/Inspva": inputs_of_receiver_message(
        ros_leaf_fields(*_OEM6_TIME_PATHS, *_INSPVA_PATHS), FUSED_INS_RANK, "novatel.read_inspva", *_WHOLE_MOTION_ROLES
    ),
    "septentrio_gnss_driver/PVTGeodetic": inputs_of_receiver_message(
        ros_leaf_fields(*_PATHS_SHARED_BY_SEPTENTRIO_POSITION_MESSAGES, "mode", "h_accuracy"),
        RECEIVER_RANK,
        "septentrio.read_pvt_geodetic",
        *_POSITION_VELOCITY_ROLES,
    ),
    "septentrio_gnss_driver/INSNavGeod": inputs_of_receiver_message(
        ros_leaf_fields(
            *_PATHS_SHARED_BY_SEPTENTRIO_POSITION_MESSAGES,
            *(f"{name}_std_dev" for name in ("latitude", "longitude", "ve", "vn")),
        ),
        FUSED_INS_RANK,
        "septentrio.read_ins_nav_geod",
        *_POSITION_VELOCITY_ROLES,
    ),
    # the driver sends a sensor_msgs/Imu of the same
    "sbg_driver/SbgImuData": inputs_of_message(
        ros_leaf_fields(*xyz_leaf_paths("accel"), *xyz_leaf_paths("gyro")), RECEIVER_RANK, imu="sbg.build_imu"
    ),
    "sbg_driver/SbgGpsPos": inputs_of_receiver_message(
        ros_leaf_fields("status.status", "status.type", *_SBG_POSITION_PATHS),
        RECEIVER_RANK,
        "sbg.read_sbg_gps_position",
        Role.EGO_POSITION,
    ),
    "sbg_driver/SbgGpsVel": inputs_of_receiver_message(
        ros_leaf_fields("status.vel_status", "status.vel_type", *_SBG_VELOCITY_PATHS),
        RECEIVER_RANK,
        "sbg.read_gps_vel",
        Role.EGO_VELOCITY,
    ),
    "sbg_driver/SbgEkfNav": (
        *inputs_of_receiver_message(
            _SBG_EKF_NAV_FIELDS, FUSED_INS_RANK, "sbg.read_ekf_nav_position", Role.EGO_POSITION
        ),
        *inputs_of_receiver_message(_SBG_EKF_NAV_FIELDS, FUSED_INS_RANK, "sbg.read_ekf_velocity", Role.EGO_VELOCITY),
    ),
    "sbg_driver/SbgEkfEuler": inputs_of_receiver_message(
        ros_leaf_fields("status.heading_valid", "angle.z", "accuracy.z"),
        FUSED_INS_RANK,
        "sbg.read_ekf_euler",
        Role.EGO_HEADING,
    ),
}
"""The registry rows of messages of receivers and inertial units, by schema name."""
