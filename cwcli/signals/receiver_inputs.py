"""The registry rows of messages of GNSS receivers and inertial units: a part of the table in `inputs`."""

from __future__ import annotations

from cwcli.signals.builders.base import Fields, Input
from cwcli.signals.input_rows import (
    FUSED_INS_RANK,
    NMEA_SENTENCE_RANK,
    RECEIVER_RANK,
    RECEIVER_SUMMARY_RANK,
    header_free_leaf_fields,
    inputs_of_message,
    ros_leaf_fields,
    xyz_leaf_paths,
)

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
_INS_PATHS = ("latitude", "longitude", "undulation", "north_velocity", "east_velocity", "azimuth")
"""The leaf paths that all inertial solutions of NovAtel share."""
_INSPVAX_NAMES = ("latitude", "longitude", "north_velocity", "east_velocity", "azimuth")
"""The names of the quantities of which an INSPVAX gives a standard deviation."""
_INSPVA_PATHS = (*_INS_PATHS, "height", "status.status", "status")
"""The leaf paths of INSPVA."""
_SEPTENTRIO_PATHS = (
    *("block_header.wnc", "block_header.tow", "error"),
    *("latitude", "longitude", "height", "ve", "vn"),
)
"""The leaf paths that the position messages of Septentrio share."""
_SBG_POSITION_PATHS = ("latitude", "longitude", "altitude", "undulation", "position_accuracy.x", "position_accuracy.y")
"""The leaf paths of an SBG position."""
_SBG_VELOCITY_PATHS = tuple(f"{name}.{axis}" for name in ("velocity", "velocity_accuracy") for axis in "xy")
"""The leaf paths of an SBG velocity."""


def _ins_inputs(fields: Fields, message: str) -> tuple[Input, ...]:
    return inputs_of_message(
        fields,
        FUSED_INS_RANK,
        ego_position=f"novatel.build_{message}_position",
        ego_velocity=f"novatel.build_{message}_velocity",
        ego_heading=f"novatel.build_{message}_heading",
    )


RECEIVER_INPUTS: dict[str, tuple[Input, ...]] = {
    **dict.fromkeys(
        ("gps_msgs/GPSFix", "gps_common/GPSFix"),
        inputs_of_message(
            ros_leaf_fields(
                *("status.status", "latitude", "longitude", "altitude", "track", "speed"),
                *("err_horz", "err_track", "err_speed", "position_covariance", "position_covariance_type"),
            ),
            RECEIVER_SUMMARY_RANK,
            ego_position="gps_fix.build_position",
            ego_velocity="gps_fix.build_velocity",
        ),
    ),
    "nmea_msgs/Sentence": inputs_of_message(
        ros_leaf_fields("sentence"),
        NMEA_SENTENCE_RANK,
        ego_position="nmea.build_position",
        ego_velocity="nmea.build_velocity",
        ego_heading="nmea.build_heading",
    ),
    "ublox_msgs/NavPVT": (
        *inputs_of_message(
            _NAV_PVT_FIELDS,
            RECEIVER_RANK,
            ego_position="ublox.build_position",
            ego_velocity="ublox.build_velocity",
        ),
        # only of receivers with an IMU or two antennas
        *inputs_of_message(_NAV_PVT_FIELDS, None, ego_heading="ublox.build_heading"),
    ),
    "novatel_oem7_msgs/BESTPOS": inputs_of_message(
        ros_leaf_fields(
            *(*_OEM7_TIME_PATHS, "sol_status.status", "pos_type.type"),
            *("lat", "lon", "hgt", "undulation", "lat_stdev", "lon_stdev"),
        ),
        RECEIVER_RANK,
        ego_position="novatel.build_position",
    ),
    "novatel_gps_msgs/NovatelPosition": inputs_of_message(
        ros_leaf_fields(
            *(*_OEM6_TIME_PATHS, "solution_status", "position_type"),
            *("lat", "lon", "height", "undulation", "lat_sigma", "lon_sigma"),
        ),
        RECEIVER_RANK,
        ego_position="novatel.build_position",
    ),
    "novatel_oem7_msgs/BESTVEL": inputs_of_message(
        ros_leaf_fields(*_OEM7_TIME_PATHS, "sol_status.status", "vel_type.type", "latency", "hor_speed", "trk_gnd"),
        RECEIVER_RANK,
        ego_velocity="novatel.build_velocity",
    ),
    "novatel_gps_msgs/NovatelVelocity": inputs_of_message(
        ros_leaf_fields(
            *(*_OEM6_TIME_PATHS, "solution_status", "velocity_type"), *("latency", "horizontal_speed", "track_ground")
        ),
        RECEIVER_RANK,
        ego_velocity="novatel.build_velocity",
    ),
    "novatel_oem7_msgs/INSPVAX": _ins_inputs(
        ros_leaf_fields(
            *(*_OEM7_TIME_PATHS, "ins_status.status", *_INS_PATHS, "height"),
            *(f"{name}_stdev" for name in _INSPVAX_NAMES),
        ),
        "ins",
    ),
    "novatel_gps_msgs/Inspvax": _ins_inputs(
        ros_leaf_fields(
            *(*_OEM6_TIME_PATHS, "ins_status", *_INS_PATHS, "altitude"), *(f"{name}_std" for name in _INSPVAX_NAMES)
        ),
        "ins",
    ),
    "novatel_oem7_msgs/INSPVA": _ins_inputs(ros_leaf_fields(*_OEM7_TIME_PATHS, *_INSPVA_PATHS), "inspva"),
    "novatel_gps_msgs/Inspva": _ins_inputs(ros_leaf_fields(*_OEM6_TIME_PATHS, *_INSPVA_PATHS), "inspva"),
    "septentrio_gnss_driver/PVTGeodetic": inputs_of_message(
        ros_leaf_fields(*_SEPTENTRIO_PATHS, "mode", "h_accuracy"),
        RECEIVER_RANK,
        ego_position="septentrio.build_position",
        ego_velocity="septentrio.build_velocity",
    ),
    "septentrio_gnss_driver/INSNavGeod": inputs_of_message(
        ros_leaf_fields(*_SEPTENTRIO_PATHS, *(f"{name}_std_dev" for name in ("latitude", "longitude", "ve", "vn"))),
        FUSED_INS_RANK,
        ego_position="septentrio.build_ins_position",
        ego_velocity="septentrio.build_ins_velocity",
    ),
    # the driver sends a sensor_msgs/Imu of the same
    "sbg_driver/SbgImuData": inputs_of_message(
        ros_leaf_fields(*xyz_leaf_paths("accel"), *xyz_leaf_paths("gyro")), RECEIVER_RANK, imu="sbg.build_imu"
    ),
    "sbg_driver/SbgGpsPos": inputs_of_message(
        ros_leaf_fields("status.status", "status.type", *_SBG_POSITION_PATHS),
        RECEIVER_RANK,
        ego_position="sbg.build_position",
    ),
    "sbg_driver/SbgGpsVel": inputs_of_message(
        ros_leaf_fields("status.vel_status", "status.vel_type", *_SBG_VELOCITY_PATHS),
        RECEIVER_RANK,
        ego_velocity="sbg.build_velocity",
    ),
    "sbg_driver/SbgEkfNav": inputs_of_message(
        ros_leaf_fields(
            *("status.position_valid", "status.velocity_valid", *xyz_leaf_paths("position")),
            *(*_SBG_POSITION_PATHS, *_SBG_VELOCITY_PATHS),
        ),
        FUSED_INS_RANK,
        ego_position="sbg.build_ekf_position",
        ego_velocity="sbg.build_ekf_velocity",
    ),
    "sbg_driver/SbgEkfEuler": inputs_of_message(
        ros_leaf_fields("status.heading_valid", "angle.z", "accuracy.z"),
        FUSED_INS_RANK,
        ego_heading="sbg.build_heading",
    ),
}
"""The registry rows of messages of receivers and inertial units, by schema name."""
