"""Files of phones, boxes, data sets and buses whose signs, units or clocks are easily mistaken, of `real_drive`.

Sources: UNITS.md and CROSSPLATFORM.md of Sensor Logger (signs and units of iOS); headers of exports that RaceBox, VESC
Tool, Advanced Navigation, rostopic, Udacity and GoldenCheetah write; REP-103 (units of ROS).
"""

# fmt: off
from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.unit.importing.real_drive import ALL, START_NS, N, R, show, times
from tests.unit.importing.real_files import frames
from tests.unit.importing.real_tables import COURSE, EPOCH_S, SPEED, RealCase, lat, lon, number, rows_of, same, write

DEVICE_FILES: dict[str, RealCase] = {}
G = 9.80665
PHONE = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Axes of the car -> axes of a phone that stands upright, its screen to the driver."""
SIDES = np.array([1.0, -1.0, -1.0])
"""x forward, y left, z up -> x forward, y right, z down."""
NS = [str(START_NS + round(t * 1e9)) for t in R.t_s]
MS = [stamp[:-6] for stamp in NS]


def device(holds: str = "", asks: str = "", start: int = START_NS, **bounds: float) -> Callable[[Callable[[Path], list[Path]]], Callable[[Path], list[Path]]]:
    """Register the maker of a case under its name."""

    def keep(make: Callable[[Path], list[Path]]) -> Callable[[Path], list[Path]]:
        DEVICE_FILES[make.__name__] = RealCase(make, holds, asks, start, bounds)
        return make

    return keep


def axes(values: np.ndarray, n: int = 5, order: tuple[int, ...] = (0, 1, 2)) -> list[list[str]]:
    return [show(values[:, k], n, ALL) for k in order]


def iphone_zip(folder: Path, tables: dict[str, np.ndarray], is_standard: str) -> list[Path]:
    """A recording of Sensor Logger on iOS."""
    fix = rows_of([NS[::10], show(R.t_s, 3), show(R.gps_speed_mps, 3), show(R.course_deg, 2), show(R.height_m, 2), lon(), lat()])
    with zipfile.ZipFile(folder / "drive.zip", "w") as archive:
        archive.writestr("Location.csv", "\n".join(["time,seconds_elapsed,speed,bearing,altitude,longitude,latitude", *fix]))
        for name, values in tables.items():
            rows = rows_of([NS, show(R.t_s, 3, ALL), *axes(values, 6, (2, 1, 0))])
            archive.writestr(f"{name}.csv", "\n".join(["time,seconds_elapsed,z,y,x", *rows]))
        archive.writestr("Metadata.csv", f"version,device name,platform,standardisation\n3,iPhone,ios,{is_standard}\n")
    return [folder / "drive.zip"]


FORCE, TURN, UP = R.force_mps2 @ PHONE.T, R.turn_radps @ PHONE.T, np.broadcast_to(PHONE @ [0.0, 0.0, G], (N, 3))


@device("fix height velocity gyro accel", accel=0.5)
def iphone(folder: Path) -> list[Path]:
    """Apple's sign: accelerations and gravity point the other way than on Android, turn rates do not."""
    return iphone_zip(folder, {"Accelerometer": UP - FORCE, "Gravity": -UP, "Gyroscope": TURN}, "false")


@device("fix height velocity gyro accel", accel=0.5)
def iphone_standardised(folder: Path) -> list[Path]:
    return iphone_zip(folder, {"Accelerometer": FORCE - UP, "Gravity": UP, "Gyroscope": TURN}, "true")


@device("fix height velocity gyro accel", accel=0.5)
def iphone_uncalibrated(folder: Path) -> list[Path]:
    """Uncalibrated accelerations are in g."""
    return iphone_zip(folder, {"AccelerometerUncalibrated": -FORCE / G, "GyroscopeUncalibrated": TURN}, "false")


def sensorlog(folder: Path, gyro: bool) -> list[Path]:
    """SensorLog: the same signs without any metadata, and an attitude of the phone."""
    head = "loggingTime(txt),locationLatitude(WGS84),locationLongitude(WGS84),locationSpeed(m/s),locationCourse(°),motionYaw(rad),accelerometerAccelerationX(G),accelerometerAccelerationY(G),accelerometerAccelerationZ(G)"
    turn = ",motionRotationRateX(rad/s),motionRotationRateY(rad/s),motionRotationRateZ(rad/s)" if gyro else ""
    columns = [times("%Y-%m-%d %H:%M:%S.%f+0000", ALL), lat(ALL), lon(ALL), show(SPEED, 3, ALL), show(R.course_deg, 1, ALL), same("0.1", ALL), *axes(-FORCE / G)]
    return write(folder, "log.csv", head + turn, rows_of([*columns, *(axes(TURN) if gyro else [])]))


@device("fix velocity gyro accel", accel=0.5)
def sensorlog_motion(folder: Path) -> list[Path]:
    return sensorlog(folder, gyro=True)


@device("fix velocity accel", accel=0.5)
def sensorlog_without_gyro(folder: Path) -> list[Path]:
    """Only the accelerations across the way show that they are mirrored."""
    return sensorlog(folder, gyro=False)


@device("fix speed gyro accel", accel=0.5)
def turn_rates_of_a_slanted_phone(folder: Path) -> list[Path]:
    """No axis is vertical, no turn rate is beyond a car's in rad/s, and no header names a unit; `speed` is 0 everywhere."""
    slanted = np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [0.0, -2.0, 1.0]]) / np.sqrt([2.0, 6.0, 3.0])
    columns = [MS, *axes(R.force_mps2 @ slanted.T), *axes(R.turn_radps @ slanted.T), lat(ALL), lon(ALL), same("0", ALL), show(SPEED, 2, ALL)]
    return write(folder, "rec.csv", "timestamp_ms,accX,accY,accZ,gyroX,gyroY,gyroZ,lat,lon,speed,gps_speed", rows_of(columns))


def box(folder: Path, force: np.ndarray, turn: np.ndarray) -> list[Path]:
    top = ["Format,RaceBox CSV", "Lap 1, 33.821, sectors, 9.01,6.759,9.764,0,8.288", ""]
    columns = [number(ALL), times("%Y-%m-%dT%H:%M:%S.%fZ", ALL), lat(ALL), lon(ALL), show(SPEED * 3.6, 2, ALL), *axes(force / G), same("0", ALL), *axes(np.degrees(turn), 2)]
    return write(folder, "s.csv", top, "Record,Time,Latitude,Longitude,Speed,GForceX,GForceY,GForceZ,Lap,GyroX,GyroY,GyroZ", rows_of(columns))


@device("fix speed gyro accel")
def turn_rates_of_the_other_sign(folder: Path) -> list[Path]:
    return box(folder, R.force_mps2, -R.turn_radps)


@device("fix speed gyro accel")
def gravity_along_z_that_points_down(folder: Path) -> list[Path]:
    """x forward, y right, z down, and gravity counts as positive."""
    return box(folder, R.force_mps2 * [1.0, -1.0, 1.0], R.turn_radps * SIDES)


@device("fix velocity gyro accel")
def accelerations_without_gravity(folder: Path) -> list[Path]:
    """An inertial system with z down: no unit, no gravity, microseconds in a column of their own."""
    head = "Unix Time,Microseconds,Latitude,Longitude,Velocity North,Velocity East,Velocity Down,Acceleration X,Acceleration Y,Acceleration Z,Angular Velocity X,Angular Velocity Y,Angular Velocity Z"
    us = [str(round(t * 1e6) % 10**6) for t in R.t_s]
    v = axes(np.stack([R.north_mps, R.east_mps, 0 * R.t_s], axis=1), 3)
    return write(folder, "State.csv", head, rows_of([[str(EPOCH_S + int(t + 1e-6)) for t in R.t_s], us, lat(ALL), lon(ALL), *v, *axes((R.force_mps2 - [0, 0, G]) * SIDES), *axes(np.degrees(R.turn_radps) * SIDES, 3)]))


# ---- clocks


@device("fix speed")
def seconds_and_microseconds(folder: Path) -> list[Path]:
    us = [str(round(t * 1e6) % 10**6) for t in R.t_s]
    return write(folder, "a.csv", "tv_sec,tv_usec,lat,lon,speed_mps", rows_of([[str(EPOCH_S + int(t + 1e-6)) for t in R.t_s], us, lat(ALL), lon(ALL), show(SPEED, 2, ALL)]))


@device("fix")
def clock_and_microseconds(folder: Path) -> list[Path]:
    us = [str(round(t * 1e6) % 10**6) for t in R.t_s]
    return write(folder, "a.csv", "Date (UTC),Time (UTC),Microseconds,lat,lon", rows_of([times("%Y-%m-%d", ALL), times("%H:%M:%S", ALL), us, lat(ALL), lon(ALL)]))


@device("fix speed", start=35_000_000 * 10**6)
def milliseconds_of_the_day(folder: Path) -> list[Path]:
    """Eight digits, which are no dates."""
    return write(folder, "vesc.csv", "ms_today;erpm;gnss_lat;gnss_lon;gnss_gVel", rows_of([show(R.t_s * 1000 + 35e6, 0, ALL), same("1", ALL), lat(ALL), lon(ALL), show(SPEED, 3, ALL)], ";"))


@device("fix speed", start=0)
def seconds_alone(folder: Path) -> list[Path]:
    return write(folder, "ride.csv", "secs,km,kph,lon,lat", rows_of([show(R.t_s, 0), same("0"), show(SPEED * 3.6, 2), lon(), lat()]))


# ---- names and units


@device("fix velocity", start=0)
def u_blox_integers(folder: Path) -> list[Path]:
    """Courses in 1e-5 degrees, speeds in mm/s."""
    return write(folder, "a.csv", "Millis (ms),gps_Lat,gps_Long,gps_GroundSpeed,gps_Heading", rows_of([show(R.t_s * 1000, 0, ALL), show(R.lat_deg * 1e7, 0, ALL), show(R.lon_deg * 1e7, 0, ALL), show(SPEED * 1000, 0, ALL), show(R.course_deg * 1e5, 0, ALL)]))


@device("fix velocity")
def north_east_down(folder: Path) -> list[Path]:
    return write(folder, "vn.csv", "time_utc_ms,Latitude,Longitude,NedVelX,NedVelY,NedVelZ", rows_of([MS, lat(ALL), lon(ALL), show(R.north_mps, 3, ALL), show(R.east_mps, 3, ALL), same("0", ALL)]))


@device("fix height speed")
def height_of_a_picture(folder: Path) -> list[Path]:
    """Three cameras a moment; `height` is that of their pictures."""
    rows = [f"{START_NS + round(R.t_s[k] * 1e9) + 10**6 * at},640,480,{name},{SPEED[k]:.3f},{R.lat_deg[k]:.7f},{R.lon_deg[k]:.7f},{R.height_m[k]:.2f}" for k in range(N) for at, name in enumerate(("left", "center", "right"))]
    return write(folder, "interpolated.csv", "timestamp,width,height,frame_id,speed,lat,long,alt", rows)


@device("pose pose_heading", start=0)
def millimeters(folder: Path) -> list[Path]:
    """Hundreds of thousands of millimeters are no grid."""
    return write(folder, "a.csv", "time_s,x_mm,y_mm,theta", rows_of([show(R.t_s, 2, ALL), show(R.x_m * 1000, 0, ALL), show(R.y_m * 1000, 0, ALL), show(R.heading_rad, 5, ALL)]))


@device("pose pose_heading speed rate")
def rostopic_odometry(folder: Path) -> list[Path]:
    names = ["%time", "field.header.seq", "field.header.stamp", "field.child_frame_id", *[f"field.pose.pose.position.{a}" for a in "xyz"], *[f"field.pose.pose.orientation.{a}" for a in "xyzw"], "field.pose.covariance0", *[f"field.twist.twist.{v}.{a}" for v in ("linear", "angular") for a in "xyz"]]
    zero, half = same("0.0", ALL), R.heading_rad / 2
    return write(folder, "odom.csv", ",".join(names), rows_of([NS, number(ALL), NS, same("base", ALL), show(R.x_m, 3, ALL), show(R.y_m, 3, ALL), zero, zero, zero, show(np.sin(half), 7, ALL), show(np.cos(half), 7, ALL), zero, show(R.speed_mps, 3, ALL), zero, zero, zero, zero, show(R.rate_radps, 5, ALL)]))


@device("gyro accel")
def rostopic_imu(folder: Path) -> list[Path]:
    """Nothing but the rules of ROS shows the unit of the turn rates."""
    names = ["%time", "field.header.stamp", *[f"field.{v}.{a}" for v in ("angular_velocity", "linear_acceleration") for a in "xyz"]]
    return write(folder, "imu.csv", ",".join(names), rows_of([NS, NS, *axes(R.turn_radps), *axes(R.force_mps2)]))


@device("fix velocity")
def pair_of_places_beside_a_course(folder: Path) -> list[Path]:
    """A transmitter's telemetry: the heading is that of its receiver, arbitrary while the car stands."""
    return write(folder, "a.csv", "Date UTC,Time UTC,GPS,GSpd(kmh),Hdg(@)", rows_of([times("%Y-%m-%d", ALL), times("%H:%M:%S.%f", ALL, cut=4), [f"{a} {o}" for a, o in zip(lat(ALL), lon(ALL), strict=True)], show(SPEED * 3.6, 1, ALL), show(R.course_deg, 1, ALL)]))


# ---- buses


@device("speed gyro")
def candump_on_the_screen(folder: Path) -> list[Path]:
    rows = [f" ({EPOCH_S + t:.6f})  can0  {i:03X}   [{len(data)}]  {data.hex(' ').upper()}" for t, i, data in frames(folder)]
    return [*write(folder, "can.txt", rows), folder / "car.dbc"]


@device("speed gyro", start=0)
def trace_of_peak(folder: Path) -> list[Path]:
    """Its date is local time without a zone: times count from its start."""
    top = [";$FILEVERSION=2.1", ";$STARTTIME=45361.4996", ";$COLUMNS=N,O,T,B,I,d,R,L,D", ";"]
    rows = [f"{k + 1:7d} {t * 1000:13.3f} DT 1      {i:04X} Rx -  {len(data)}    {data.hex(' ').upper()} " for k, (t, i, data) in enumerate(frames(folder))]
    return [*write(folder, "a.trc", top, rows), folder / "car.dbc"]


@device(asks="line protocol")
def line_protocol(folder: Path) -> list[Path]:
    return write(folder, "gps.txt", [f"gps,car=1 lat={a},lon={o},course={c} {stamp}" for a, o, c, stamp in zip(lat(), lon(), COURSE, NS[::10], strict=True)])


@device(asks="not that of gravity")
def accelerations_without_gravity_of_an_upright_phone(folder: Path) -> list[Path]:
    """z points backwards: the accelerations across the way are along x, and no axis has the unit of gravity."""
    columns = [NS, lat(ALL), lon(ALL), *axes(FORCE - UP)]
    return write(folder, "a.csv", "time,latitude,longitude,accelerometer_x,accelerometer_y,accelerometer_z", rows_of(columns))
