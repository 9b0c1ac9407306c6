"""Files of apps, receivers, autopilots and data sets with traps: units, time bases and names that are easily mistaken."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.unit.importing.drive import START_S, digits
from tests.unit.importing.files import KMH, _with_checksum
from tests.unit.importing.other_base import (
    COURSE,
    FILL,
    LAT,
    LON,
    NS,
    SLOW,
    D,
    N,
    OtherCase,
    P,
    R,
    V,
    phone_vectors,
    stamps,
    table,
)

# fmt: off

GPS_EPOCH_S, LEAP_S = 315_964_800, 18
"""The GPS epoch in seconds since 1970, and the leap seconds between GPS time and UTC in 2023 (IERS Bulletin C)."""
ISO = stamps("%Y-%m-%dT%H:%M:%S.%fZ")
SPEED = digits(D.speed_mps, 4)
KMH_TEXT = digits(D.speed_mps * KMH, 3)


def _integers(values: np.ndarray) -> list[str]:
    return [str(value) for value in np.rint(values).astype(np.int64).tolist()]


def sensorlog(folder: Path) -> list[Path]:
    """SensorLog for iOS."""
    force, turn = phone_vectors()
    head = "loggingTime(txt),loggingSample(N),locationTimestamp_since1970(s),locationLatitude(WGS84),locationLongitude(WGS84),locationAltitude(m),locationSpeed(m/s),locationSpeedAccuracy(m/s),locationCourse(°),locationCourseAccuracy(°),locationVerticalAccuracy(m),locationHorizontalAccuracy(m),locationFloor(Z),accelerometerTimestamp_sinceReboot(s),accelerometerAccelerationX(G),accelerometerAccelerationY(G),accelerometerAccelerationZ(G),gyroTimestamp_sinceReboot(s),gyroRotationX(rad/s),gyroRotationY(rad/s),gyroRotationZ(rad/s)"
    boot = digits(D.t_s + 5000.25, 4)
    cols = [stamps("%Y-%m-%dT%H:%M:%S.%f+01:00", hours=1), [str(k) for k in range(N)], [f"{START_S + t:.3f}" for t in D.t_s], LAT, LON, FILL, SPEED, FILL, COURSE, FILL, FILL, FILL, ["-9999"] * N, boot, *(digits(-force[:, k] / 9.80665, 6) for k in range(3)), boot, *(digits(turn[:, k], 6) for k in range(3))]
    return table(folder, "2023-11-14_23_13_20_my_iOS_device.csv", head, cols)


def hyperimu(folder: Path) -> list[Path]:
    force, turn = phone_vectors()
    ms = [str(NS // 10**6 + round(t * 1000)) for t in D.t_s]
    head = "Timestamp,acc_x,acc_y,acc_z,gyro_x,gyro_y,gyro_z,latitude,longitude,altitude"
    return table(folder, "HIMU-2023-11-14.csv", head, [ms, *(digits(force[:, k], 6) for k in range(3)), *(digits(turn[:, k], 7) for k in range(3)), LAT, LON, FILL])


def torque_zone(folder: Path) -> list[Path]:
    """Torque writes the zone of the phone into its times."""
    r = SLOW
    head = "GPS Time, Device Time, Longitude, Latitude,GPS Speed (Meters/second),Bearing,Speed (GPS)(km/h)"
    cols = [stamps("%a %b %d %H:%M:%S GMT+01:00 %Y", r, hours=1), stamps("%d-%b-%Y %H:%M:%S.%f", r, hours=1, cut=3), LON[r], LAT[r], digits(D.speed_mps[r], 3), COURSE[r], digits(D.speed_mps[r] * KMH, 3)]
    return table(folder, "trackLog.csv", head, cols)


def semicircles(folder: Path) -> list[Path]:
    """Garmin FIT records as most converters write them: 2^31 semicircles are 180 degrees."""
    scale = 2.0**31 / 180.0
    head = "timestamp,position_lat,position_long,enhanced_speed"
    return table(folder, "fit_records.csv", head, [ISO, _integers(D.lat_deg * scale), _integers(D.lon_deg * scale), SPEED])


def semicircles_named(folder: Path) -> list[Path]:
    scale = 2.0**31 / 180.0
    head = "timestamp,position_lat (semicircles),position_long (semicircles),speed (m/s)"
    return table(folder, "fit.csv", head, [ISO, _integers(D.lat_deg * scale), _integers(D.lon_deg * scale), SPEED])


def mavlink(folder: Path) -> list[Path]:
    """GLOBAL_POSITION_INT of MAVLink: degrees * 1e7, mm, cm/s and hundredths of a degree."""
    head = "timestamp,lat,lon,alt,relative_alt,vx,vy,vz,hdg"
    unix = [f"{START_S + t:.6f}" for t in D.t_s]
    north, east = D.speed_mps * np.sin(D.heading_rad), D.speed_mps * np.cos(D.heading_rad)
    cols = [unix, _integers(D.lat_deg * 1e7), _integers(D.lon_deg * 1e7), ["31200"] * N, ["0"] * N, _integers(north * 100), _integers(east * 100), ["0"] * N, _integers(D.course_deg * 100)]
    return table(folder, "flight.tlog.csv", head, cols)


def parked_mavlink(folder: Path) -> list[Path]:
    """As above, while the vehicle stands: nothing shows the unit of the heading."""
    cols = [[f"{START_S + t:.6f}" for t in D.t_s], ["474000000"] * N, ["-32000000"] * N, _integers(27_100 + D.t_s)]
    return table(folder, "parked.csv", "timestamp,lat,lon,hdg", cols)


def _hhmmss(t_s: np.ndarray) -> list[str]:
    return [text[:-4] for text in stamps("%H%M%S.%f")]


def digit_clock(folder: Path) -> list[Path]:
    """A clock as a number, hhmmss.ss, without a date, as receivers and Racelogic's exports have it."""
    return table(folder, "vbox.csv", "UTC time,latitude,longitude,velocity (km/h),heading (deg)", [_hhmmss(D.t_s), LAT, LON, KMH_TEXT, COURSE])


def basic_iso(folder: Path) -> list[Path]:
    return table(folder, "basic.csv", "time,lat,lon", [stamps("%Y%m%dT%H%M%S.%fZ"), LAT, LON])


def digit_dates(folder: Path) -> list[Path]:
    return table(folder, "digits.csv", "time_utc,lat,lon", [stamps("%Y%m%d%H%M%S.%f", cut=3), LAT, LON])


def exif_dates(folder: Path) -> list[Path]:
    return table(folder, "exif.csv", "datetime_utc,lat,lon", [stamps("%Y:%m:%d %H:%M:%S.%f", cut=3), LAT, LON])


def file_dates(folder: Path) -> list[Path]:
    return table(folder, "names.csv", "time (UTC),lat,lon", [stamps("%Y-%m-%d_%H-%M-%S-%f", cut=3), LAT, LON])


def zone_names(folder: Path) -> list[Path]:
    return table(folder, "cet.csv", "time,lat,lon", [stamps("%Y-%m-%d %H:%M:%S.%f CET", hours=1), LAT, LON])


def gps_week(folder: Path) -> list[Path]:
    gps = START_S + D.t_s - GPS_EPOCH_S + LEAP_S
    week = np.floor(gps / 604_800)
    return table(folder, "week.csv", "GPSWeek;GPSSeconds [s];Lat [deg];Lon [deg];Speed [kn]", [_integers(week), digits(gps - week * 604_800, 2), LAT, LON, digits(D.speed_mps * KMH / 1.852, 3)], ";")


def gps_seconds(folder: Path) -> list[Path]:
    return table(folder, "gps.csv", "gps_time_s,lat,lon", [[f"{START_S + t - GPS_EPOCH_S + LEAP_S:.2f}" for t in D.t_s], LAT, LON])


def apple_seconds(folder: Path) -> list[Path]:
    """Seconds since 2001, as Apple's systems count them."""
    return table(folder, "ios.csv", "timestamp,latitude,longitude", [[f"{START_S + t - 978_307_200:.3f}" for t in D.t_s], LAT, LON])


def minus_one(folder: Path) -> list[Path]:
    """A table of CLLocation: speed and course are -1 where they are not known."""
    speed, course = list(SPEED), list(COURSE)
    for k in range(90):
        speed[k] = course[k] = "-1.0"
    return table(folder, "locations.csv", "timestamp,latitude,longitude,speed (m/s),course", [ISO, LAT, LON, speed, course])


def feet_and_knots(folder: Path) -> list[Path]:
    head = "Timestamp (UTC);Latitude;Longitude;Altitude (ft);Ground Speed (kt);Track (deg)"
    return table(folder, "flight.csv", head, [stamps("%Y-%m-%d %H:%M:%S.%f"), LAT, LON, digits(np.full(N, 31.2 / 0.3048), 2), digits(D.speed_mps * KMH / 1.852, 3), COURSE], ";")


def two_talkers(folder: Path) -> list[Path]:
    """Two receivers or systems in one file: GP and GN sentences of the same moments."""
    clock, date = stamps("%H%M%S.%f", cut=4), stamps("%d%m%y")
    lines = []
    for k in range(N):
        lat, lon = abs(D.lat_deg[k]), abs(D.lon_deg[k])
        place = f"{int(lat):02d}{lat % 1 * 60:010.7f},N,{int(lon):03d}{lon % 1 * 60:010.7f},W"
        motion = f"{D.speed_mps[k] * KMH / 1.852:.3f},{COURSE[k]},{date[k]},,,A"
        for talker in ("GP", "GN"):
            lines += [_with_checksum(f"{talker}GGA,{clock[k]},{place},1,12,0.6,31.2,M,47.7,M,,"), _with_checksum(f"{talker}RMC,{clock[k]},A,{place},{motion}")]
    (folder / "two.nmea").write_text("\r\n".join(lines) + "\r\n")
    return [folder / "two.nmea"]


def oxts_ncom(folder: Path) -> list[Path]:
    """NCOM exported as CSV."""
    head = "Date,Time (UTC),Latitude (deg),Longitude (deg),Altitude (m),Speed2D (m/s),SpeedForward (m/s),Heading (deg),Track (deg),AngRateZ (deg/s)"
    return table(folder, "oxts.csv", head, [stamps("%Y-%m-%d"), stamps("%H:%M:%S.%f"), LAT, LON, FILL, SPEED, SPEED, COURSE, COURSE, digits(-np.degrees(D.yaw_rate_radps), 4)])


def oxts_kitti(folder: Path) -> list[Path]:
    """A packet of KITTI's oxts: 30 numbers without names."""
    (folder / "0000000000.txt").write_text(" ".join(["49.015", "8.434", "116.4", *["0.1"] * 22, "4", "11", "4", "4", "0"]) + "\n")
    return [folder / "0000000000.txt"]


def argoverse(folder: Path) -> list[Path]:
    """Poses of Argoverse 2 (`city_SE3_egovehicle`)."""
    half, zero = 0.5 * D.heading_rad, ["0.0"] * N
    return table(folder, "city_SE3_egovehicle.csv", "timestamp_ns,qw,qx,qy,qz,tx_m,ty_m,tz_m", [[str(s) for s in D.stamp_ns.tolist()], digits(np.cos(half), 8), zero, zero, digits(np.sin(half), 8), digits(D.x_m, 5), digits(D.y_m, 5), zero])


def argoverse_1(folder: Path) -> list[Path]:
    rows = [f"{START_S + t:.2f},{track},{kind},{x:.3f},{y:.3f},MIA" for t, x, y in zip(D.t_s, D.x_m, D.y_m, strict=True) for track, kind in (("0-1", "AV"), ("0-2", "AGENT"))]
    (folder / "1.csv").write_text("TIMESTAMP,TRACK_ID,OBJECT_TYPE,X,Y,CITY_NAME\n" + "\n".join(rows) + "\n")
    return [folder / "1.csv"]


def novatel(folder: Path) -> list[Path]:
    rows = [f"#INSPVAA,COM1,0,60.0,FINESTEERING,2288,{t:.2f},02000000,54e2,16809;2288,{t:.2f},{a},{o},31.2,0.1,0.2,0.0,0.1,0.2,90.0,INS_SOLUTION_GOOD*5ca30894" for t, a, o in zip(D.t_s, LAT, LON, strict=True)]
    (folder / "ins.gps").write_text("\n".join(rows) + "\n")
    return [folder / "ins.gps"]


def ardupilot(folder: Path) -> list[Path]:
    rows = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns", "FMT, 130, 50, GPS, QBIHBcLLefffB, TimeUS,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,U"]
    rows += [f"GPS, {round(t * 1e6)}, 3, 166400000, 2288, 12, 0.8, {a}, {o}, 31.2, {s}, {c}, 0, 1" for t, a, o, s, c in zip(D.t_s, LAT, LON, SPEED, COURSE, strict=True)]
    (folder / "00000012.log").write_text("\n".join(rows) + "\n")
    return [folder / "00000012.log"]


def thousands(folder: Path) -> list[Path]:
    """Dots between thousands and decimal commas."""
    ms = [f"{round(t * 1000):,}".replace(",", ".") for t in D.t_s + 1.0]
    return table(folder, "t.csv", "Zeit [ms];Breite;Länge", [ms, [a.replace(".", ",") for a in LAT], [o.replace(".", ",") for o in LON]], ";")


def coordinates(folder: Path) -> list[Path]:
    return table(folder, "pairs.csv", "time,coordinates,speed (km/h)", [ISO, [f'"{a}, {o}"' for a, o in zip(LAT, LON, strict=True)], KMH_TEXT])


def xsens(folder: Path) -> list[Path]:
    """SampleTimeFine counts 0.1 ms."""
    ticks = _integers(D.t_s * 1e4 + 7)
    head = "// Device: MTi-680\nPacketCounter,SampleTimeFine,UTC_Year,UTC_Month,UTC_Day,UTC_Hour,UTC_Minute,UTC_Second,UTC_Nano,UTC_Valid,Latitude,Longitude,Altitude,Yaw"
    cols = [_integers(np.arange(N)), ticks, *(stamps(f"%{each}") for each in "YmdHMS"), [str(int(text) * 1000) for text in stamps("%f")], FILL, LAT, LON, FILL, digits(np.degrees(np.angle(np.exp(1j * D.heading_rad))), 3)]
    return table(folder, "MT_0.txt", head, cols)


def long_form(folder: Path) -> list[Path]:
    rows = [f"{START_S + t:.2f},{name},{value}" for t, a, o in zip(D.t_s, LAT, LON, strict=True) for name, value in (("lat", a), ("lon", o))]
    (folder / "signals.csv").write_text("timestamp,signal,value\n" + "\n".join(rows) + "\n")
    return [folder / "signals.csv"]


def candump_shown(folder: Path) -> list[Path]:
    """What `candump -tz can0` shows on the terminal."""
    (folder / "can.txt").write_text("".join(f" ({t:010.6f})  can0  100   [8]  01 02 03 04 05 06 07 08\n" for t in D.t_s))
    return [folder / "can.txt"]


def strava(folder: Path) -> list[Path]:
    """Strava: extensions without namespaces, power and heart rate beside."""
    times = stamps("%Y-%m-%dT%H:%M:%SZ", SLOW)
    points = "".join(f'<trkpt lat="{LAT[10 * k]}" lon="{LON[10 * k]}"><ele>31.2</ele><time>{times[k]}</time><extensions><power>180</power><gpxtpx:TrackPointExtension><gpxtpx:atemp>20</gpxtpx:atemp><gpxtpx:hr>120</gpxtpx:hr><gpxtpx:cad>80</gpxtpx:cad></gpxtpx:TrackPointExtension></extensions></trkpt>' for k in range(len(times)))
    (folder / "Ride.gpx").write_text(f'<?xml version="1.0"?><gpx creator="StravaGPX" version="1.1" xmlns="http://www.topografix.com/GPX/1/1" xmlns:gpxtpx="http://www.garmin.com/xmlschemas/TrackPointExtension/v1"><trk><name>Ride</name><type>1</type><trkseg>{points}</trkseg></trk></gpx>')
    return [folder / "Ride.gpx"]


def osmand(folder: Path) -> list[Path]:
    times = stamps("%Y-%m-%dT%H:%M:%SZ", SLOW)
    points = "".join(f'<trkpt lat="{LAT[10 * k]}" lon="{LON[10 * k]}"><ele>31.2</ele><time>{times[k]}</time><hdop>3.7</hdop><extensions><osmand:speed>{D.speed_mps[10 * k]:.2f}</osmand:speed><osmand:heading>{(D.course_deg[10 * k] + 140) % 360:.0f}</osmand:heading></extensions></trkpt>' for k in range(len(times)))
    (folder / "2023-11-14_23-13_Tue.gpx").write_text(f'<?xml version="1.0"?><gpx version="1.1" creator="OsmAnd~ 4.6" xmlns="http://www.topografix.com/GPX/1/1" xmlns:osmand="https://osmand.net"><trk><trkseg>{points}</trkseg></trk></gpx>')
    return [folder / "2023-11-14_23-13_Tue.gpx"]


def kmh_gpx(folder: Path) -> list[Path]:
    """A program that writes km/h where GPX has m/s."""
    times = stamps("%Y-%m-%dT%H:%M:%SZ", SLOW)
    points = "".join(f'<trkpt lat="{LAT[10 * k]}" lon="{LON[10 * k]}"><time>{times[k]}</time><speed>{D.speed_mps[10 * k] * KMH:.2f}</speed></trkpt>' for k in range(len(times)))
    (folder / "kmh.gpx").write_text(f'<gpx version="1.0"><trk><trkseg>{points}</trkseg></trk></gpx>')
    return [folder / "kmh.gpx"]


def _binary(name: str, data: bytes) -> Callable[[Path], list[Path]]:
    def make(folder: Path) -> list[Path]:
        (folder / name).write_bytes(data)
        return [folder / name]

    return make


APP_CASES = {
    "sensorlog": OtherCase(sensorlog, P | V | {"gyro": 0.02, "accel": 0.3}),
    "hyperimu": OtherCase(hyperimu, P | {"gyro": 0.02, "accel": 0.3}),
    "torque-zone": OtherCase(torque_zone, P | V),
    "semicircles": OtherCase(semicircles, {}, asks="semicircles"),
    "semicircles-named": OtherCase(semicircles_named, P | R),
    "mavlink": OtherCase(mavlink, P | {"heading": 0.02}),
    "mavlink-parked": OtherCase(parked_mavlink, {}, asks="hdg"),
    "digit-clock": OtherCase(digit_clock, P | V, (START_S % 86_400) * 10**9),
    "basic-iso": OtherCase(basic_iso, P),
    "digit-dates": OtherCase(digit_dates, P),
    "exif-dates": OtherCase(exif_dates, P),
    "file-dates": OtherCase(file_dates, P),
    "zone-names": OtherCase(zone_names, {}, asks="zone"),
    "gps-week": OtherCase(gps_week, P | R),
    "gps-seconds": OtherCase(gps_seconds, P),
    "apple-seconds": OtherCase(apple_seconds, {}, asks="2001"),
    "minus-one": OtherCase(minus_one, P | V),
    "feet-and-knots": OtherCase(feet_and_knots, P | V),
    "two-talkers": OtherCase(two_talkers, P | V),
    "oxts": OtherCase(oxts_ncom, P | V | R | {"heading": 0.01, "yaw_rate": 0.01}),
    "oxts-kitti": OtherCase(oxts_kitti, {}, asks="names"),
    "argoverse": OtherCase(argoverse, {"pose": 0.01}),
    "argoverse-1": OtherCase(argoverse_1, {}, asks="2 vehicles"),
    "novatel": OtherCase(novatel, {}, asks="NovAtel"),
    "ardupilot": OtherCase(ardupilot, {}, asks="ArduPilot"),
    "thousands": OtherCase(thousands, {}, asks=r"'Zeit \[ms\]'"),
    "coordinates": OtherCase(coordinates, P | R),
    "xsens": OtherCase(xsens, P | {"heading": 0.01}),
    "long-form": OtherCase(long_form, {}, asks="no column is a position"),
    "candump-shown": OtherCase(candump_shown, {}, asks="from its start"),
    "strava": OtherCase(strava, P),
    "osmand": OtherCase(osmand, P | R),
    "kmh-gpx": OtherCase(kmh_gpx, {}, asks="kmh"),
    "feather": OtherCase(_binary("a.feather", b"ARROW1\0\0" + bytes(99)), {}, asks="Feather"),
    "rlog": OtherCase(_binary("rlog.bz2", b"BZh91AY&SY" + bytes(99)), {}, asks="bzip2"),
    "zst": OtherCase(_binary("rlog.zst", b"\x28\xb5\x2f\xfd" + bytes(99)), {}, asks="Zstandard"),
    "ulog": OtherCase(_binary("a.ulg", b"ULog\x01\x12\x35\x01" + bytes(99)), {}, asks="PX4"),
    "dataflash": OtherCase(_binary("a.bin", b"\xa3\x95\x80\x80\x59" + bytes(99)), {}, asks="ArduPilot"),
    "pcap": OtherCase(_binary("a.pcap", struct.pack("<I", 0xA1B2C3D4) + bytes(99)), {}, asks="packets"),
    "rosbag": OtherCase(_binary("a.bag", b"#ROSBAG V2.0\n" + bytes(99)), {}, asks="a log"),
    "mcap": OtherCase(_binary("a.mcap", b"\x89MCAP0\r\n" + bytes(99)), {}, asks="a log"),
}
