"""Messages of GNSS receivers as their drivers define them, and what they mean."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from math import pi, radians
from operator import xor
from typing import Any

from cwcli.signals.role import Role

LINE = "\n" + "=" * 80 + "\n"
HEADER = [
    "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id",
    "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec",
]
VECTOR = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z"
TOP = "std_msgs/Header header\n"
OEM7 = [
    "MSG: novatel_oem7_msgs/Oem7Header\nstring message_name\nuint16 message_id\nuint8 message_type\n"
    "uint32 sequence_number\nuint8 time_status\nuint16 gps_week_number\nuint32 gps_week_milliseconds",
    "MSG: novatel_oem7_msgs/SolutionStatus\nuint32 status",
    "MSG: novatel_oem7_msgs/InertialSolutionStatus\nuint32 status",
    "MSG: novatel_oem7_msgs/PositionOrVelocityType\nuint32 type",
    "MSG: novatel_oem7_msgs/BestExtendedSolutionStatus\nuint8 status",
    "MSG: novatel_oem7_msgs/INSExtendedSolutionStatus\nuint32 status",
]
OEM7_TOP = TOP + "novatel_oem7_msgs/Oem7Header nov_header\n"
OEM6 = [
    "MSG: novatel_gps_msgs/NovatelMessageHeader\nstring message_name\nstring port\nuint32 sequence_num\n"
    "float32 percent_idle_time\nstring gps_time_status\nuint32 gps_week_num\nfloat64 gps_seconds"
]
OEM6_TOP = TOP + "novatel_gps_msgs/NovatelMessageHeader novatel_msg_header\n"
EKF_STATUS = (
    "MSG: sbg_driver/SbgEkfStatus\nuint8 solution_mode\nbool attitude_valid\nbool heading_valid\n"
    "bool velocity_valid\nbool position_valid"
)
VECTORS = "geometry_msgs/Vector3 {0}\ngeometry_msgs/Vector3 {0}_accuracy\n"


def _one_line(text: str) -> str:
    """`float64 a b c; uint8 d` as lines of one field each."""
    lines = []
    for declared in text.split(";"):
        kind, *names = declared.split()
        lines += [f"{kind} {name}" for name in names]
    return "\n".join(lines)


_DEFINED: dict[str, tuple[str, list[str]]] = {
    # BSD-3-Clause, swri-robotics/gps_umd
    "gps_msgs/GPSFix": (
        TOP
        + "gps_msgs/GPSStatus status\n"
        + _one_line(
            "float64 latitude longitude altitude track speed climb pitch roll dip time gdop pdop hdop vdop tdop err "
            "err_horz err_vert err_track err_speed err_climb err_time err_pitch err_roll err_dip;"
            "float64[9] position_covariance; uint8 position_covariance_type"
        ),
        [f"MSG: gps_msgs/GPSStatus\n{TOP}uint16 satellites_used\nint16 status"],
    ),
    # BSD-3-Clause, ros-drivers/nmea_msgs
    "nmea_msgs/Sentence": (TOP + "string sentence", []),
    # BSD-3-Clause, KumarRobotics/ublox
    "ublox_msgs/NavPVT": (
        _one_line(
            "uint32 i_tow; uint16 year; uint8 month day hour min sec valid; uint32 t_acc; int32 nano;"
            "uint8 fix_type flags flags2 num_sv; int32 lon lat height h_msl; uint32 h_acc v_acc;"
            "int32 vel_n vel_e vel_d g_speed heading; uint32 s_acc head_acc; uint16 p_dop; uint8[6] reserved1;"
            "int32 head_veh; int16 mag_dec; uint16 mag_acc"
        ),
        [],
    ),
    # MIT, novatel/novatel_oem7_driver
    "novatel_oem7_msgs/BESTPOS": (
        OEM7_TOP
        + _one_line(
            "novatel_oem7_msgs/SolutionStatus sol_status; novatel_oem7_msgs/PositionOrVelocityType pos_type;"
            "float64 lat lon hgt; float32 undulation; uint32 datum_id; float32 lat_stdev lon_stdev hgt_stdev;"
            "string stn_id; float32 diff_age sol_age; uint8 num_svs num_sol_svs num_sol_l1_svs reserved;"
            "novatel_oem7_msgs/BestExtendedSolutionStatus ext_sol_stat;"
            "uint8 galileo_beidou_sig_mask gps_glonass_sig_mask"
        ),
        OEM7,
    ),
    "novatel_oem7_msgs/BESTVEL": (
        OEM7_TOP
        + _one_line(
            "novatel_oem7_msgs/SolutionStatus sol_status; novatel_oem7_msgs/PositionOrVelocityType vel_type;"
            "float32 latency diff_age; float64 hor_speed trk_gnd ver_speed; float32 reserved"
        ),
        OEM7,
    ),
    "novatel_oem7_msgs/INSPVAX": (
        OEM7_TOP
        + _one_line(
            "novatel_oem7_msgs/InertialSolutionStatus ins_status; novatel_oem7_msgs/PositionOrVelocityType pos_type;"
            "float64 latitude longitude height; float32 undulation; float64 north_velocity east_velocity up_velocity "
            "roll pitch azimuth; float32 latitude_stdev longitude_stdev height_stdev north_velocity_stdev "
            "east_velocity_stdev up_velocity_stdev roll_stdev pitch_stdev azimuth_stdev;"
            "novatel_oem7_msgs/INSExtendedSolutionStatus ext_sol_status; uint16 time_since_update"
        ),
        OEM7,
    ),
    "novatel_oem7_msgs/INSPVA": (
        OEM7_TOP
        + _one_line(
            "float64 latitude longitude height north_velocity east_velocity up_velocity roll pitch azimuth;"
            "novatel_oem7_msgs/InertialSolutionStatus status"
        ),
        OEM7,
    ),
    # BSD-3-Clause, swri-robotics/novatel_gps_driver
    "novatel_gps_msgs/Inspva": (
        OEM6_TOP
        + _one_line(
            "uint32 week; float64 seconds latitude longitude height north_velocity east_velocity up_velocity "
            "roll pitch azimuth; string status"
        ),
        OEM6,
    ),
    "novatel_gps_msgs/NovatelPosition": (
        OEM6_TOP
        + _one_line(
            "string solution_status position_type; float64 lat lon height; float32 undulation; string datum_id;"
            "float32 lat_sigma lon_sigma height_sigma; string base_station_id; float32 diff_age solution_age"
        ),
        OEM6,
    ),
    "novatel_gps_msgs/NovatelVelocity": (
        OEM6_TOP
        + _one_line(
            "string solution_status velocity_type; float32 latency age;"
            "float64 horizontal_speed track_ground vertical_speed"
        ),
        OEM6,
    ),
    "novatel_gps_msgs/Inspvax": (
        OEM6_TOP
        + _one_line(
            "string ins_status position_type; float64 latitude longitude altitude; float32 undulation;"
            "float64 north_velocity east_velocity up_velocity roll pitch azimuth; float32 latitude_std longitude_std "
            "altitude_std north_velocity_std east_velocity_std up_velocity_std roll_std pitch_std azimuth_std;"
            "uint16 seconds_since_update"
        ),
        OEM6,
    ),
    # BSD-3-Clause, septentrio-gnss/septentrio_gnss_driver
    "septentrio_gnss_driver/PVTGeodetic": (
        TOP
        + _one_line(
            "septentrio_gnss_driver/BlockHeader block_header; uint8 mode error; float64 latitude longitude height;"
            "float32 undulation vn ve vu cog; float64 rx_clk_bias; float32 rx_clk_drift;"
            "uint8 time_system datum nr_sv wa_corr_info; uint16 reference_id mean_corr_age; uint32 signal_info;"
            "uint8 alert_flag nr_bases; uint16 ppp_info latency h_accuracy v_accuracy; uint8 misc"
        ),
        [
            "MSG: septentrio_gnss_driver/BlockHeader\n"
            + _one_line("uint8 sync_1 sync_2; uint16 crc id length; uint32 tow; uint16 wnc")
        ],
    ),
    "septentrio_gnss_driver/INSNavGeod": (
        TOP
        + _one_line(
            "septentrio_gnss_driver/BlockHeader block_header; uint8 gnss_mode error; uint16 info gnss_age;"
            "float64 latitude longitude height; float32 undulation; uint16 accuracy latency; uint8 datum;"
            "uint16 sb_list; float32 latitude_std_dev longitude_std_dev height_std_dev latitude_longitude_cov "
            "latitude_height_cov longitude_height_cov heading pitch roll heading_std_dev pitch_std_dev roll_std_dev "
            "heading_pitch_cov heading_roll_cov pitch_roll_cov ve vn vu ve_std_dev vn_std_dev vu_std_dev "
            "ve_vn_cov ve_vu_cov vn_vu_cov"
        ),
        [
            "MSG: septentrio_gnss_driver/BlockHeader\n"
            + _one_line("uint8 sync_1 sync_2; uint16 crc id length; uint32 tow; uint16 wnc")
        ],
    ),
    # MIT, SBG-Systems/sbg_ros2_driver
    "sbg_driver/SbgImuData": (
        TOP
        + _one_line(
            "uint32 time_stamp; sbg_driver/SbgImuStatus imu_status; geometry_msgs/Vector3 accel gyro; float32 temp;"
            "geometry_msgs/Vector3 delta_vel delta_angle"
        ),
        [VECTOR, "MSG: sbg_driver/SbgImuStatus\nbool imu_com\nbool imu_status"],
    ),
    "sbg_driver/SbgGpsPos": (
        TOP
        + _one_line(
            "uint32 time_stamp; sbg_driver/SbgGpsPosStatus status; uint32 gps_tow;"
            "float64 latitude longitude altitude; float32 undulation; geometry_msgs/Vector3 position_accuracy;"
            "uint8 num_sv_used; uint16 base_station_id diff_age"
        ),
        [VECTOR, "MSG: sbg_driver/SbgGpsPosStatus\nuint8 status\nuint8 type"],
    ),
    "sbg_driver/SbgGpsVel": (
        TOP
        + "uint32 time_stamp\nsbg_driver/SbgGpsVelStatus status\nuint32 gps_tow\n"
        + VECTORS.format("velocity")
        + "float32 course\nfloat32 course_acc",
        [VECTOR, "MSG: sbg_driver/SbgGpsVelStatus\nuint8 vel_status\nuint8 vel_type"],
    ),
    "sbg_driver/SbgEkfNav": (
        TOP
        + "uint32 time_stamp\n"
        + VECTORS.format("velocity")
        + "float64 latitude\nfloat64 longitude\nfloat64 altitude\nfloat32 undulation\n"
        + "geometry_msgs/Vector3 position_accuracy\nsbg_driver/SbgEkfStatus status",
        [VECTOR, EKF_STATUS],
    ),
    "sbg_driver/SbgEkfEuler": (
        TOP
        + "uint32 time_stamp\ngeometry_msgs/Vector3 angle\ngeometry_msgs/Vector3 accuracy\n"
        + "sbg_driver/SbgEkfStatus status",
        [VECTOR, EKF_STATUS],
    ),
}
DEFINITIONS = {
    name: LINE.join([top, *parts, *(HEADER if TOP in top else [])]) for name, (top, parts) in _DEFINED.items()
}
"""Schema -> its definition, as the driver's package has it."""
DEFINITIONS["gps_common/GPSFix"] = DEFINITIONS["gps_msgs/GPSFix"]

LATITUDE_DEG, LONGITUDE_DEG = 48.125, -11.5
WEEK, WEEK_MS = 2074, 201_648_080
"""2019-10-08T08:00:30.080Z: 18 s less than GPS time says."""


def sentence(content: str) -> str:
    """A sentence with its checksum."""
    return f"${content}*{reduce(xor, content.encode(), 0):02X}"


def made(build: Callable[[int], tuple[dict[str, Any], dict[Role, dict[str, Any]]]], frame: str = "gps") -> Any:
    """A sample with a ROS header."""

    def sample(k: int) -> Any:
        from tests.laws.input_messages import ros  # this module is part of that one's table

        message, means = build(k)
        return ros(k, message, frame), means

    return sample


def _place(k: int, **more: Any) -> dict[str, Any]:
    return {"latitude_deg": LATITUDE_DEG + 1e-5 * k, "longitude_deg": LONGITUDE_DEG, **more}


def _velocity(east: float, north: float, **more: Any) -> dict[str, Any]:
    return {"east_mps": east, "north_mps": north, **more}


def _gps_fix(k: int) -> Any:
    sigma_m, sigma_mps = 0.5, 0.25
    message = {
        "status": {"header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}, "satellites_used": 9, "status": 0},
        "latitude": LATITUDE_DEG + 1e-5 * k,
        "longitude": LONGITUDE_DEG,
        "altitude": 500.25,
        "track": 90.0,
        "speed": 10.0 + k,
        "err_horz": 2.447747 * sigma_m,  # 95 %
        "err_speed": 1.959964 * sigma_mps,
        "err_track": 0.0,
        "position_covariance": [0.0] * 9,
        "position_covariance_type": 0,
    }
    place = _place(k, altitude_m=500.25, covariance_m2=[0.25, 0.0, 0.25])
    velocity = _velocity(10.0 + k, 0.0, covariance_m2ps2=[0.0625, 0.0, 0.0625])
    return message, {Role.EGO_POSITION: place, Role.EGO_VELOCITY: velocity}


def _nmea(k: int) -> Any:
    """One channel with the sentence that this role takes in every message: 48 deg 7.5 min north, 11 deg 30 min west."""
    minutes = 7.5 + 60e-5 * k
    rmc = f"GNRMC,080730.08,A,48{minutes:08.5f},N,01130.00000,W,19.4384449,180.0,081019,,,A"
    place = _place(k)
    velocity = _velocity(0.0, -19.4384449 * 1852.0 / 3600.0)
    return {"sentence": sentence(rmc)}, {Role.EGO_POSITION: place, Role.EGO_VELOCITY: velocity}


def _nmea_heading(k: int) -> Any:
    return {"sentence": sentence(f"HEHDT,{120 + k}.0,T")}, {Role.EGO_HEADING: {"heading_rad": radians(-30.0 - k)}}


def _nav_pvt(k: int) -> Any:
    """Its own time is the stamp of message k: 2019-10-08T08:07:10.08Z and 0.1 s more for each."""
    seconds, nanoseconds = divmod(80_000_000 + 100_000_000 * k, 1_000_000_000)
    message = {
        **{"i_tow": 0, "year": 2019, "month": 10, "day": 8, "hour": 8, "min": 7, "sec": 10 + seconds, "valid": 0b111},
        **{"nano": nanoseconds, "fix_type": 3, "flags": 0b100001},
        **{"lon": -115_000_000, "lat": 481_250_000 + 100 * k, "height": 500_250, "h_acc": 20, "v_acc": 30},
        **{"vel_n": -3_000, "vel_e": 4_000 + k, "vel_d": 0, "s_acc": 100, "head_acc": 200_000, "reserved1": [0] * 6},
        "head_veh": 12_000_000,
    }
    return message, {
        Role.EGO_POSITION: _place(k, altitude_m=500.25, covariance_m2=[0.0004, 0.0, 0.0004]),
        Role.EGO_VELOCITY: _velocity(4.0 + 0.001 * k, -3.0, covariance_m2ps2=[0.01, 0.0, 0.01]),
        Role.EGO_HEADING: {"heading_rad": radians(-30.0), "variance_rad2": radians(2.0) ** 2},
    }


def _oem7(**more: Any) -> dict[str, Any]:
    return {
        "nov_header": {"message_name": "", "gps_week_number": WEEK, "gps_week_milliseconds": WEEK_MS},
        "sol_status": {"status": 0},
        **more,
    }


def _oem6(**more: Any) -> dict[str, Any]:
    header = {"message_name": "", "gps_week_num": WEEK, "gps_seconds": WEEK_MS / 1e3}
    return {"novatel_msg_header": header, "solution_status": "SOL_COMPUTED", **more}


def _best_pos(k: int) -> Any:
    where = {"lat": LATITUDE_DEG + 1e-5 * k, "lon": LONGITUDE_DEG, "hgt": 460.0, "undulation": 40.5}
    sigma = {"lat_stdev": 0.5, "lon_stdev": 0.25}
    message = _oem7(pos_type={"type": 50}, **where, **sigma)
    return message, {Role.EGO_POSITION: _place(k, altitude_m=500.5, covariance_m2=[0.0625, 0.0, 0.25])}


def _novatel_position(k: int) -> Any:
    where = {"lat": LATITUDE_DEG + 1e-5 * k, "lon": LONGITUDE_DEG, "height": 460.0, "undulation": 40.5}
    message = _oem6(position_type="NARROW_INT", **where, lat_sigma=0.5, lon_sigma=0.25)
    return message, {Role.EGO_POSITION: _place(k, altitude_m=500.5, covariance_m2=[0.0625, 0.0, 0.25])}


def _best_vel(k: int) -> Any:
    message = _oem7(vel_type={"type": 8}, latency=0.0, hor_speed=5.0 + k, trk_gnd=270.0)
    return message, {Role.EGO_VELOCITY: _velocity(-5.0 - k, 0.0)}


def _novatel_velocity(k: int) -> Any:
    message = _oem6(velocity_type="DOPPLER_VELOCITY", latency=0.0, horizontal_speed=5.0 + k, track_ground=270.0)
    return message, {Role.EGO_VELOCITY: _velocity(-5.0 - k, 0.0)}


def _ins(k: int, top: dict[str, Any], height: str, sigma: str) -> Any:
    message = {
        **top,
        **{"latitude": LATITUDE_DEG + 1e-5 * k, "longitude": LONGITUDE_DEG, height: 460.0, "undulation": 40.5},
        **{"north_velocity": 3.0 + k, "east_velocity": -4.0, "azimuth": 0.0},
        **{f"latitude_{sigma}": 0.5, f"longitude_{sigma}": 0.25, f"azimuth_{sigma}": 0.5},
        **{f"north_velocity_{sigma}": 0.125, f"east_velocity_{sigma}": 0.0625},
    }
    return message, {
        Role.EGO_POSITION: _place(k, altitude_m=500.5, covariance_m2=[0.0625, 0.0, 0.25]),
        Role.EGO_VELOCITY: _velocity(-4.0, 3.0 + k, covariance_m2ps2=[0.0625**2, 0.0, 0.125**2]),
        Role.EGO_HEADING: {"heading_rad": pi / 2.0, "variance_rad2": radians(0.5) ** 2},
    }


def _ins_7(k: int) -> Any:
    top = {name: value for name, value in _oem7().items() if name != "sol_status"}
    return _ins(k, {**top, "ins_status": {"status": 3}}, "height", "stdev")


def _ins_6(k: int) -> Any:
    top = {name: value for name, value in _oem6().items() if name != "solution_status"}
    return _ins(k, {**top, "ins_status": "INS_SOLUTION_GOOD"}, "altitude", "std")


def _inspva(k: int, message: dict[str, Any], status: Any) -> Any:
    named = {name: value for name, value in message.items() if not name.endswith("status") and "std" not in name}
    _, means = _ins(k, {}, "height", "stdev")
    bare = {role: {name: value for name, value in each.items() if "cov" not in name} for role, each in means.items()}
    bare[Role.EGO_POSITION]["altitude_m"] = 460.0  # above the ellipsoid
    del named["undulation"], bare[Role.EGO_HEADING]["variance_rad2"]
    return {**named, "height": 460.0, "status": status}, bare


def _inspva_7(k: int) -> Any:
    return _inspva(k, _ins_7(k)[0], {"status": 3})


def _inspva_6(k: int) -> Any:
    message = {name: value for name, value in _ins_6(k)[0].items() if name != "altitude"}
    return _inspva(k, message, "INS_SOLUTION_GOOD")


def _ins_nav_geod(k: int) -> Any:
    message = {
        "block_header": {"tow": WEEK_MS, "wnc": WEEK},
        **{"error": 0, "latitude": radians(LATITUDE_DEG + 1e-5 * k), "longitude": radians(LONGITUDE_DEG)},
        **{"height": 500.25, "vn": -3.0, "ve": 4.0 + k, "latitude_std_dev": 0.5, "longitude_std_dev": 0.25},
        **{"ve_std_dev": 0.25, "vn_std_dev": 0.5},
    }
    return message, {
        Role.EGO_POSITION: _place(k, altitude_m=500.25, covariance_m2=[0.0625, 0.0, 0.25]),
        Role.EGO_VELOCITY: _velocity(4.0 + k, -3.0, covariance_m2ps2=[0.0625, 0.0, 0.25]),
    }


def _pvt_geodetic(k: int) -> Any:
    message = {
        "block_header": {"tow": WEEK_MS, "wnc": WEEK},
        **{"mode": 4, "error": 0, "latitude": radians(LATITUDE_DEG + 1e-5 * k), "longitude": radians(LONGITUDE_DEG)},
        **{"height": 500.25, "vn": -3.0, "ve": 4.0 + k, "h_accuracy": 200},
    }
    return message, {
        Role.EGO_POSITION: _place(k, altitude_m=500.25, covariance_m2=[0.5, 0.0, 0.5]),  # 2 m = 2 sqrt(2) sigma
        Role.EGO_VELOCITY: _velocity(4.0 + k, -3.0),
    }


def _vector(x: float, y: float, z: float = 0.0) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


def _sbg_pos(k: int) -> Any:
    message = {
        "status": {"status": 0, "type": 7},
        **{"latitude": LATITUDE_DEG + 1e-5 * k, "longitude": LONGITUDE_DEG, "altitude": 460.0, "undulation": 40.5},
        "position_accuracy": _vector(0.5, 0.25),
    }
    return message, {Role.EGO_POSITION: _place(k, altitude_m=500.5, covariance_m2=[0.0625, 0.0, 0.25])}


def _sbg_motion(k: int) -> dict[str, Any]:
    """North, east, down."""
    return {"velocity": _vector(-3.0, 4.0 + k), "velocity_accuracy": _vector(0.5, 0.25)}


def _sbg_vel(k: int) -> Any:
    means = _velocity(4.0 + k, -3.0, covariance_m2ps2=[0.0625, 0.0, 0.25])
    return {"status": {"vel_status": 0, "vel_type": 2}, **_sbg_motion(k)}, {Role.EGO_VELOCITY: means}


def _sbg_nav(k: int) -> Any:
    place, where = _sbg_pos(k)
    _, moves = _sbg_vel(k)
    status = {"solution_mode": 4, "heading_valid": True, "velocity_valid": True, "position_valid": True}
    return {**place, **_sbg_motion(k), "status": status}, {**where, **moves}


def _sbg_euler(k: int) -> Any:
    status = {"solution_mode": 4, "heading_valid": True}
    message = {"angle": _vector(0.0, 0.0, 0.25 + 0.1 * k), "accuracy": _vector(0.0, 0.0, 0.125), "status": status}
    heading = {"heading_rad": pi / 2.0 - 0.25 - 0.1 * k, "variance_rad2": 0.125**2}
    return message, {Role.EGO_HEADING: heading}


def _sbg_imu(k: int) -> Any:
    """Forward, right, down: gravity pulls the sensor up."""
    message = {"accel": _vector(0.5 + k, 0.25, -9.75), "gyro": _vector(0.125, 0.5, 0.25 + k)}
    return message, {Role.IMU: {"accel_mps2": [0.5 + k, -0.25, 9.75], "gyro_radps": [0.125, -0.5, -0.25 - k]}}


RECEIVER_SAMPLES: dict[str, Callable[[int], Any]] = {
    "gps_msgs/GPSFix": made(_gps_fix),
    "gps_common/GPSFix": made(_gps_fix),
    "nmea_msgs/Sentence": made(_nmea),
    "nmea_msgs/Sentence ego_heading": made(_nmea_heading),
    "ublox_msgs/NavPVT": _nav_pvt,
    "novatel_oem7_msgs/BESTPOS": made(_best_pos),
    "novatel_gps_msgs/NovatelPosition": made(_novatel_position),
    "novatel_oem7_msgs/BESTVEL": made(_best_vel),
    "novatel_gps_msgs/NovatelVelocity": made(_novatel_velocity),
    "novatel_oem7_msgs/INSPVAX": made(_ins_7),
    "novatel_gps_msgs/Inspvax": made(_ins_6),
    "novatel_oem7_msgs/INSPVA": made(_inspva_7),
    "novatel_gps_msgs/Inspva": made(_inspva_6),
    "septentrio_gnss_driver/INSNavGeod": made(_ins_nav_geod),
    "sbg_driver/SbgImuData": made(_sbg_imu, "imu_link_ned"),
    "septentrio_gnss_driver/PVTGeodetic": made(_pvt_geodetic),
    "sbg_driver/SbgGpsPos": made(_sbg_pos, "imu_link_ned"),
    "sbg_driver/SbgGpsVel": made(_sbg_vel, "imu_link_ned"),
    "sbg_driver/SbgEkfNav": made(_sbg_nav, "imu_link_ned"),
    "sbg_driver/SbgEkfEuler": made(_sbg_euler, "imu_link_ned"),
}
"""Schema -> message k and what it means."""
