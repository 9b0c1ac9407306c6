"""The registry rows of messages of GNSS receivers and inertial units: a part of the table in `inputs`."""

from __future__ import annotations

from cwcli.signals.builders.base import Fields, Input
from cwcli.signals.input_rows import FUSED, RECEIVER, SENTENCE, SUMMARY, builder, ros, xyz
from cwcli.signals.role import Role

_GPS_FIX = ros(
    *("status.status", "latitude", "longitude", "altitude", "track", "speed", "err_horz", "err_track", "err_speed"),
    *("position_covariance", "position_covariance_type"),
)
"""The leaf fields of a `GPSFix`, by encoding."""
_NAV_PVT_LEAVES = (
    *("year", "month", "day", "hour", "min", "sec", "valid", "nano", "flags", "lon", "lat", "height"),
    *("fix_type", "h_acc", "vel_n", "vel_e", "s_acc", "head_acc", "head_veh"),
    *("reserved1", "fixType", "hAcc", "velN", "velE", "sAcc", "headAcc", "headVeh"),
)
"""The leaf paths of a `NavPVT`."""
_NAV_PVT: Fields = dict.fromkeys(("cdr", "json"), _NAV_PVT_LEAVES)
"""The leaf fields of a `NavPVT`, by encoding."""
_OEM7 = ("nov_header.gps_week_number", "nov_header.gps_week_milliseconds")
"""The leaf paths of the GPS time in messages of `novatel_oem7_msgs`."""
_OEM6 = ("novatel_msg_header.gps_week_num", "novatel_msg_header.gps_seconds")
"""The leaf paths of the GPS time in messages of `novatel_gps_msgs`."""
_BEST_POS_7 = ros(
    *(*_OEM7, "sol_status.status", "pos_type.type", "lat", "lon", "hgt", "undulation", "lat_stdev", "lon_stdev")
)
"""The leaf fields of BESTPOS in `novatel_oem7_msgs`, by encoding."""
_BEST_POS_6 = ros(
    *(*_OEM6, "solution_status", "position_type", "lat", "lon", "height", "undulation", "lat_sigma", "lon_sigma")
)
"""The leaf fields of BESTPOS in `novatel_gps_msgs`, by encoding."""
_BEST_VEL_7 = ros(*_OEM7, "sol_status.status", "vel_type.type", "latency", "hor_speed", "trk_gnd")
"""The leaf fields of BESTVEL in `novatel_oem7_msgs`, by encoding."""
_BEST_VEL_6 = ros(*_OEM6, "solution_status", "velocity_type", "latency", "horizontal_speed", "track_ground")
"""The leaf fields of BESTVEL in `novatel_gps_msgs`, by encoding."""
_INS = ("latitude", "longitude", "undulation", "north_velocity", "east_velocity", "azimuth")
"""The leaf paths that all inertial solutions of NovAtel share."""
_INS_7 = ros(
    *(*_OEM7, "ins_status.status", *_INS, "height"),
    *(f"{name}_stdev" for name in ("latitude", "longitude", "north_velocity", "east_velocity", "azimuth")),
)
"""The leaf fields of INSPVAX in `novatel_oem7_msgs`, by encoding."""
_INS_6 = ros(
    *(*_OEM6, "ins_status", *_INS, "altitude"),
    *(f"{name}_std" for name in ("latitude", "longitude", "north_velocity", "east_velocity", "azimuth")),
)
"""The leaf fields of INSPVAX in `novatel_gps_msgs`, by encoding."""
_INSPVA = (*_INS, "height", "status.status", "status")
"""The leaf paths of INSPVA."""
_INSPVA_7, _INSPVA_6 = ros(*_OEM7, *_INSPVA), ros(*_OEM6, *_INSPVA)
"""The leaf fields of INSPVA in `novatel_oem7_msgs` and `novatel_gps_msgs`, by encoding."""
_INS_NAV_GEOD = ros(
    *("block_header.wnc", "block_header.tow", "error", "latitude", "longitude", "height", "ve", "vn"),
    *(f"{name}_std_dev" for name in ("latitude", "longitude", "ve", "vn")),
)
"""The leaf fields of an `INSNavGeod`, by encoding."""
_SBG_IMU = ros(*xyz("accel"), *xyz("gyro"))
"""The leaf fields of a `SbgImuData`, by encoding."""
_PVT_GEODETIC = ros(
    *("block_header.wnc", "block_header.tow", "mode", "error", "latitude", "longitude", "height", "ve", "vn"),
    "h_accuracy",
)
"""The leaf fields of a `PVTGeodetic`, by encoding."""
_PLACE = ("latitude", "longitude", "altitude", "undulation", "position_accuracy.x", "position_accuracy.y")
"""The leaf paths of an SBG position."""
_VELOCITY = tuple(f"{name}.{axis}" for name in ("velocity", "velocity_accuracy") for axis in "xy")
"""The leaf paths of an SBG velocity."""
_SBG_POS = ros("status.status", "status.type", *_PLACE)
"""The leaf fields of a `SbgGpsPos`, by encoding."""
_SBG_VEL = ros("status.vel_status", "status.vel_type", *_VELOCITY)
"""The leaf fields of a `SbgGpsVel`, by encoding."""
_SBG_NAV = ros(
    *("status.position_valid", "status.velocity_valid", *_PLACE, "position.x", "position.y", "position.z"), *_VELOCITY
)
"""The leaf fields of a `SbgEkfNav`, by encoding."""
_SBG_EULER = ros("status.heading_valid", "angle.z", "accuracy.z")
"""The leaf fields of a `SbgEkfEuler`, by encoding."""


def _position(fields: Fields, name: str, rank: int) -> Input:
    return Input(Role.EGO_POSITION, fields, builder(name), rank=rank)


def _velocity(fields: Fields, name: str, rank: int) -> Input:
    return Input(Role.EGO_VELOCITY, fields, builder(name), rank=rank)


def _heading(fields: Fields, name: str, rank: int | None) -> Input:
    return Input(Role.EGO_HEADING, fields, builder(name), rank=rank)


def _summary(fields: Fields) -> tuple[Input, ...]:
    return (
        _position(fields, "gps_fix.build_position", SUMMARY),
        _velocity(fields, "gps_fix.build_velocity", SUMMARY),
    )


def _ins(fields: Fields, message: str = "ins") -> tuple[Input, ...]:
    return (
        _position(fields, f"novatel.build_{message}_position", FUSED),
        _velocity(fields, f"novatel.build_{message}_velocity", FUSED),
        _heading(fields, f"novatel.build_{message}_heading", FUSED),
    )


_SENTENCE = ros("sentence")
"""The leaf fields of an NMEA `Sentence`, by encoding."""

RECEIVERS: dict[str, tuple[Input, ...]] = {
    "gps_msgs/GPSFix": _summary(_GPS_FIX),
    "gps_common/GPSFix": _summary(_GPS_FIX),
    "nmea_msgs/Sentence": (
        _position(_SENTENCE, "nmea.build_position", SENTENCE),
        _velocity(_SENTENCE, "nmea.build_velocity", SENTENCE),
        _heading(_SENTENCE, "nmea.build_heading", SENTENCE),
    ),
    "ublox_msgs/NavPVT": (
        _position(_NAV_PVT, "ublox.build_position", RECEIVER),
        _velocity(_NAV_PVT, "ublox.build_velocity", RECEIVER),
        # only of receivers with an IMU or two antennas
        _heading(_NAV_PVT, "ublox.build_heading", None),
    ),
    "novatel_oem7_msgs/BESTPOS": (_position(_BEST_POS_7, "novatel.build_position", RECEIVER),),
    "novatel_gps_msgs/NovatelPosition": (_position(_BEST_POS_6, "novatel.build_position", RECEIVER),),
    "novatel_oem7_msgs/BESTVEL": (_velocity(_BEST_VEL_7, "novatel.build_velocity", RECEIVER),),
    "novatel_gps_msgs/NovatelVelocity": (_velocity(_BEST_VEL_6, "novatel.build_velocity", RECEIVER),),
    "novatel_oem7_msgs/INSPVAX": _ins(_INS_7),
    "novatel_gps_msgs/Inspvax": _ins(_INS_6),
    "novatel_oem7_msgs/INSPVA": _ins(_INSPVA_7, "inspva"),
    "novatel_gps_msgs/Inspva": _ins(_INSPVA_6, "inspva"),
    "septentrio_gnss_driver/PVTGeodetic": (
        _position(_PVT_GEODETIC, "septentrio.build_position", RECEIVER),
        _velocity(_PVT_GEODETIC, "septentrio.build_velocity", RECEIVER),
    ),
    "septentrio_gnss_driver/INSNavGeod": (
        _position(_INS_NAV_GEOD, "septentrio.build_ins_position", FUSED),
        _velocity(_INS_NAV_GEOD, "septentrio.build_ins_velocity", FUSED),
    ),
    # the driver sends a sensor_msgs/Imu of the same
    "sbg_driver/SbgImuData": (Input(Role.IMU, _SBG_IMU, builder("sbg.build_imu"), rank=RECEIVER),),
    "sbg_driver/SbgGpsPos": (_position(_SBG_POS, "sbg.build_position", RECEIVER),),
    "sbg_driver/SbgGpsVel": (_velocity(_SBG_VEL, "sbg.build_velocity", RECEIVER),),
    "sbg_driver/SbgEkfNav": (
        _position(_SBG_NAV, "sbg.build_ekf_position", FUSED),
        _velocity(_SBG_NAV, "sbg.build_ekf_velocity", FUSED),
    ),
    "sbg_driver/SbgEkfEuler": (_heading(_SBG_EULER, "sbg.build_heading", FUSED),),
}
"""The registry rows of messages of receivers and inertial units, by schema name."""
