"""Forty files of fifteen kinds, as other programs write them; what each must become, or what it must ask."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from cantools.database.can import Database

from tests.unit.importing.drive import DRIVE, START_S, N, digits, epoch, iso, write_table

D = DRIVE
KMH, MPH, KNOT = 3.6, 1 / 0.44704, 3600 / 1852


@dataclass(frozen=True)
class Case:
    """A file, or files that belong together.

    Attributes:
        kind: Kind of file.
        make: Folder -> files.
        holds: What the log must hold: fix, pose, velocity, speed, yaw_rate, heading, imu, frames, remote.
        start: Stamp of the first row, ns, or None where stamps count from the start.
        asks: Words of the question, "" where the file needs none.
    """

    kind: str
    make: Callable[[Path], list[Path]]
    holds: str = ""
    start: int | None = START_S * 10**9
    asks: str = ""


LAT, LON, ALT = digits(D.lat_deg, 9), digits(D.lon_deg, 9), ["520.0"] * N
COURSE = digits(D.course_deg, 3)


def csv_logger(folder: Path) -> list[Path]:
    speed = digits(D.speed_mps * KMH, 3)
    return [
        write_table(folder / "log.csv", "timestamp,lat,lon,alt,Speed,heading", [epoch(), LAT, LON, ALT, speed, COURSE])
    ]


def csv_german(folder: Path) -> list[Path]:
    columns = [digits(D.t_s, 1), LAT, LON, digits(D.speed_mps * KMH, 3)]
    comma = [[cell.replace(".", ",") for cell in column] for column in columns]
    return [write_table(folder / "fahrt.csv", "Zeit [s];Breite [°];Länge [°];Geschwindigkeit [km/h]", comma, ";")]


def csv_quoted_commas(folder: Path) -> list[Path]:
    columns = [digits(D.t_s, 1), LAT, LON, digits(D.speed_mps * KMH, 3)]
    comma = [[f'"{cell.replace(".", ",")}"' for cell in column] for column in columns]
    return [write_table(folder / "fahrt.csv", "Time (s),Latitude,Longitude,Speed (km/h)", comma)]


def tsv_iso(folder: Path) -> list[Path]:
    columns = [iso(D), LAT, LON, digits(D.speed_mps * MPH, 3)]
    return [write_table(folder / "drive.tsv", "Time\tLatitude\tLongitude\tSpeed (mph)", columns, "\t")]


def csv_offset(folder: Path) -> list[Path]:
    columns = [iso(D, "+01:00", hours=1), LAT, LON, digits(D.speed_mps, 3)]
    return [write_table(folder / "drive.csv", "datetime,latitude,longitude,vel_mps", columns)]


def csv_milliseconds(folder: Path) -> list[Path]:
    times = [str(START_S * 1000 + round(t * 1000)) for t in D.t_s.tolist()]
    columns = [times, LON, LAT, digits(D.speed_mps * KNOT, 3), COURSE]
    return [write_table(folder / "drive.csv", "time_ms,lng,lat,speed_knots,course", columns)]


def csv_vehicle(folder: Path) -> list[Path]:
    yaw_rate = digits(np.degrees(D.yaw_rate_radps), 4)
    columns = [digits(D.t_s, 3), LAT, LON, digits(D.speed_mps * KMH, 2), yaw_rate, ["0.1"] * N]
    names = "t [s],GPS_Latitude [deg],GPS_Longitude [deg],VehicleSpeed [km/h],YawRate [deg/s],Throttle [%]"
    return [write_table(folder / "can.csv", names, columns)]


def csv_with_imu(folder: Path) -> list[Path]:
    forward, left = D.accel_mps2 / 9.80665, D.speed_mps * D.yaw_rate_radps / 9.80665
    imu = [epoch(), digits(forward, 5), digits(left, 5), ["1.0"] * N, ["0.01"] * N, ["0.02"] * N]
    imu.append(digits(np.degrees(D.yaw_rate_radps), 4))
    gnss = write_table(folder / "gnss.csv", "unix_time,lat,lon", [epoch(), LAT, LON])
    return [gnss, write_table(folder / "imu.csv", "timestamp,ax,ay,az,gx,gy,gz", imu)]


def csv_utf16(folder: Path) -> list[Path]:
    columns = [iso(D, "", "%Y-%m-%d %H:%M:%S"), LAT, LON, digits(D.speed_mps * KMH, 3)]
    return [write_table(folder / "excel.txt", "UTC\tLatitude\tLongitude\tSpeed [km/h]", columns, "\t", "utf-16")]


def csv_units_row(folder: Path) -> list[Path]:
    columns = [digits(D.t_s, 2), LAT, LON, digits(D.speed_mps * KMH, 3)]
    return [write_table(folder / "m.csv", "Time;Latitude;Longitude;Speed\ns;°;°;km/h", columns, ";", "cp1252")]


def csv_gps_week(folder: Path) -> list[Path]:
    gps_s = START_S - 315_964_800 + 18
    tow = [f"{gps_s % 604_800 + t:.2f}" for t in D.t_s.tolist()]
    columns = [[str(gps_s // 604_800)] * N, tow, LAT, LON, digits(D.speed_mps, 3)]
    return [write_table(folder / "ins.csv", "GPS Week,TOW (s),Latitude (deg),Longitude (deg),Speed (m/s)", columns)]


def csv_date_and_time(folder: Path) -> list[Path]:
    moments = iso(D, "", "%d.%m.%Y|%H:%M:%S")
    dates, clocks = zip(*(moment.split("|") for moment in moments), strict=True)
    columns = [list(dates), list(clocks), LAT, LON, digits(D.speed_mps * KMH, 3)]
    return [write_table(folder / "drive.csv", "Date;UTC Time;Lat;Lon;Speed (km/h)", columns, ";")]


def csv_integers(folder: Path) -> list[Path]:
    times = [str(START_S * 10**6 + round(t * 1e6)) for t in D.t_s.tolist()]
    columns = [times, digits(D.lat_deg * 1e7, 0), digits(D.lon_deg * 1e7, 0), digits(D.speed_mps * 1000, 0)]
    return [write_table(folder / "ublox.csv", "timestamp_us,lat,lon,gSpeed [mm/s]", columns)]


def csv_local(folder: Path) -> list[Path]:
    columns = [digits(D.t_s, 2), digits(D.x_m, 4), digits(D.y_m, 4), digits(D.heading_rad, 6), digits(D.speed_mps, 4)]
    return [write_table(folder / "path.csv", "time_s,x [m],y [m],yaw [rad],v [m/s]", columns)]


def csv_local_time(folder: Path) -> list[Path]:
    columns = [iso(D, "", "%Y-%m-%d %H:%M:%S"), LAT, LON, digits(D.speed_mps * KMH, 3)]
    return [write_table(folder / "drive.csv", "time,lat,lon,speed_kmh", columns)]


def parquet_zone(folder: Path) -> list[Path]:
    import pyarrow as pa
    from pyarrow import parquet

    stamps = pa.array(D.stamp_ns, pa.timestamp("ns", tz="UTC"))
    table = pa.table(
        {"timestamp": stamps, "latitude": D.lat_deg, "longitude": D.lon_deg, "speed_kmh": D.speed_mps * KMH}
    )
    parquet.write_table(table, folder / "drive.parquet")
    return [folder / "drive.parquet"]


def parquet_epoch(folder: Path) -> list[Path]:
    import pyarrow as pa
    from pyarrow import parquet

    table = pa.table(
        {"t_ns": D.stamp_ns, "lat": D.lat_deg, "lon": D.lon_deg, "speed": D.speed_mps, "course_deg": D.course_deg}
    )
    parquet.write_table(table, folder / "drive.pq")
    return [folder / "drive.pq"]


def _gpx(folder: Path, n_tracks: int, *, with_speed: bool = False) -> list[Path]:
    rows = []
    for track in range(n_tracks):
        rows.append(f"<trk><name>day {track + 1}</name><trkseg>")
        for k, time in enumerate(iso(D)):
            speed = f"<extensions><speed>{D.speed_mps[k]:.3f}</speed></extensions>" if with_speed else ""
            rows.append(f'<trkpt lat="{LAT[k]}" lon="{LON[k]}"><ele>520.0</ele><time>{time}</time>{speed}</trkpt>')
        rows.append("</trkseg></trk>")
    head = '<?xml version="1.0"?><gpx version="1.1" creator="test" xmlns="http://www.topografix.com/GPX/1/1">'
    (folder / "track.gpx").write_text("\n".join([head, *rows, "</gpx>"]))
    return [folder / "track.gpx"]


def gpx_plain(folder: Path) -> list[Path]:
    return _gpx(folder, 1)


def gpx_speed(folder: Path) -> list[Path]:
    return _gpx(folder, 1, with_speed=True)


def gpx_two_tracks(folder: Path) -> list[Path]:
    return _gpx(folder, 2)


def _nmea(folder: Path, kinds: tuple[str, ...], name: str = "drive.nmea") -> list[Path]:
    import pynmea2

    def angle(value: float, width: int) -> str:
        whole = int(value)
        return f"{whole:0{width}d}{(value - whole) * 60:010.7f}"

    lines = []
    for k, clock in enumerate(iso(D, "", "%H%M%S")):
        place = (angle(D.lat_deg[k], 2), "N", angle(D.lon_deg[k], 3), "E")
        knots, course = f"{D.speed_mps[k] * KNOT:.4f}", COURSE[k]
        fields = {
            "GGA": (clock, *place, "1", "09", "0.9", "475.0", "M", "45.0", "M", "", ""),
            "RMC": (clock, "A", *place, knots, course, "141123", "", "", "A"),
            "VTG": (course, "T", "", "M", knots, "N", f"{D.speed_mps[k] * KMH:.4f}", "K", "A"),
        }
        lines += [
            str(pynmea2.NMEASentence("GP", kind, fields[kind]))
            if kind not in {"GGA", "RMC", "VTG"}
            else str(pynmea2.parse(_with_checksum(f"GP{kind},{','.join(fields[kind])}")))
            for kind in kinds
        ]
    (folder / name).write_text("\r\n".join(lines) + "\r\n")
    return [folder / name]


def _with_checksum(body: str) -> str:
    total = 0
    for character in body.encode():
        total ^= character
    return f"${body}*{total:02X}"


def nmea_full(folder: Path) -> list[Path]:
    return _nmea(folder, ("RMC", "GGA", "VTG"))


def nmea_rmc(folder: Path) -> list[Path]:
    return _nmea(folder, ("RMC",), "gps.log")


def nmea_gga(folder: Path) -> list[Path]:
    return _nmea(folder, ("GGA",), "gps.txt")


def ubx(folder: Path) -> list[Path]:
    from pyubx2 import GET, UBXMessage

    data = b""
    for k, stamp in enumerate(D.stamp_ns.tolist()):
        moment = np.datetime64(stamp, "ns")
        text = str(moment)
        speed, heading = D.speed_mps[k], D.heading_rad[k]
        data += UBXMessage(
            "NAV", "NAV-PVT", GET,
            iTOW=0, year=int(text[:4]), month=int(text[5:7]), day=int(text[8:10]), hour=int(text[11:13]),
            min=int(text[14:16]), second=int(text[17:19]), validDate=1, validTime=1, fullyResolved=1,
            nano=int(text[20:29]), fixType=3, gnssFixOk=1, lat=float(D.lat_deg[k]), lon=float(D.lon_deg[k]),
            height=520_000, hMSL=475_000, velN=round(1000 * speed * np.sin(heading)),
            velE=round(1000 * speed * np.cos(heading)), gSpeed=round(1000 * speed), headMot=float(D.course_deg[k]),
        ).serialize()  # fmt: skip
    (folder / "rover.ubx").write_bytes(data)
    return [folder / "rover.ubx"]


def _tum_lines(times: list[str]) -> list[str]:
    half = 0.5 * D.heading_rad
    return [
        f"{time} {x:.6f} {y:.6f} 0 0 0 {s:.9f} {c:.9f}"
        for time, x, y, s, c in zip(times, D.x_m, D.y_m, np.sin(half), np.cos(half), strict=True)
    ]


def tum(folder: Path) -> list[Path]:
    (folder / "poses.tum").write_text("\n".join(["# timestamp tx ty tz qx qy qz qw", *_tum_lines(epoch(6)), ""]))
    return [folder / "poses.tum"]


CAMERA = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Body axes -> camera axes."""


def _rotations() -> np.ndarray:
    c, s, zero = np.cos(D.heading_rad), np.sin(D.heading_rad), np.zeros(N)
    return np.moveaxis(np.array([[c, -s, zero], [s, c, zero], [zero, zero, zero + 1.0]]), -1, 0)


def tum_camera(folder: Path) -> list[Path]:
    """Poses of a camera: its own axes, a world with z up."""
    from tests.unit.importing.oracles import quaternion_of

    lines = []
    for k, time in enumerate(epoch(6)):
        q = quaternion_of(_rotations()[k] @ CAMERA.T)
        lines.append(f"{time} {D.x_m[k]:.6f} {D.y_m[k]:.6f} 0.0 " + " ".join(f"{value:.9f}" for value in q))
    (folder / "camera.txt").write_text("\n".join([*lines, ""]))
    return [folder / "camera.txt"]


def _kitti_lines() -> list[str]:
    """Poses of KITTI's left camera: the world are the axes of the first camera."""
    place = np.stack([D.x_m, D.y_m, np.zeros(N)], axis=1) @ CAMERA.T
    turned = CAMERA @ _rotations() @ CAMERA.T
    rows = np.concatenate([turned, place[:, :, None]], axis=2).reshape(N, 12)
    return [" ".join(f"{value:.9e}" for value in row) for row in rows.tolist()]


def kitti(folder: Path) -> list[Path]:
    (folder / "00.txt").write_text("\n".join([*_kitti_lines(), ""]))
    (folder / "times.txt").write_text("\n".join([f"{t:.6e}" for t in D.t_s.tolist()] + [""]))
    return [folder / "00.txt", folder / "times.txt"]


def kitti_no_times(folder: Path) -> list[Path]:
    (folder / "01.txt").write_text("\n".join([*_kitti_lines(), ""]))
    return [folder / "01.txt"]


def euroc_truth(folder: Path) -> list[Path]:
    half = 0.5 * D.heading_rad
    columns = [[str(s) for s in D.stamp_ns.tolist()], digits(D.x_m, 6), digits(D.y_m, 6), ["0.0"] * N]
    columns += [digits(np.cos(half), 9), ["0.0"] * N, ["0.0"] * N, digits(np.sin(half), 9), ["0.1"] * N]
    names = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
    names += ", v_RS_R_x [m s^-1]"
    return [write_table(folder / "data.csv", names, columns)]


def euroc_imu(folder: Path) -> list[Path]:
    columns = [[str(s) for s in D.stamp_ns.tolist()], ["0.01"] * N, ["0.02"] * N, digits(D.yaw_rate_radps, 6)]
    columns += [digits(D.accel_mps2, 5), digits(D.speed_mps * D.yaw_rate_radps, 5), ["9.81"] * N]
    names = ",".join(
        [
            "#timestamp [ns]",
            *(f"{w}_RS_S_{axis} [{unit}]" for w, unit in (("w", "rad s^-1"), ("a", "m s^-2")) for axis in "xyz"),
        ]
    )
    return [write_table(folder / "imu0.csv", names, columns)]


PHONE = np.array([[0.0, -1.0, 0.0], [0.5, 0.0, np.sqrt(0.75)], [-np.sqrt(0.75), 0.0, 0.5]])
"""Body axes -> axes of a phone in a tilted holder."""


def _phone_vectors() -> tuple[np.ndarray, np.ndarray]:
    force = np.stack([D.accel_mps2, D.speed_mps * D.yaw_rate_radps, np.full(N, 9.80665)], axis=1)
    turn = np.stack([np.zeros(N), np.zeros(N), D.yaw_rate_radps], axis=1)
    return force @ PHONE.T, turn @ PHONE.T


def _zip(path: Path, tables: dict[str, tuple[str, list[list[str]]]]) -> list[Path]:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, (names, columns) in tables.items():
            text = io.StringIO()
            text.write(names + "\n")
            text.writelines(",".join(row) + "\n" for row in zip(*columns, strict=True))
            archive.writestr(name, text.getvalue())
    return [path]


def sensor_logger(folder: Path) -> list[Path]:
    force, turn = _phone_vectors()
    times, elapsed = [str(s) for s in D.stamp_ns.tolist()], digits(D.t_s, 9)
    location = [times, elapsed, ["3.0"] * N, ["1.0"] * N, digits(D.speed_mps, 4), COURSE, ALT, LON, LAT]
    vectors = {
        name: ("time,seconds_elapsed,z,y,x", [times, elapsed, *(digits(v[:, k], 6) for k in (2, 1, 0))])
        for name, v in {"TotalAcceleration.csv": force, "Gyroscope.csv": turn, "Accelerometer.csv": force * 0.0}.items()
    }
    names = "time,seconds_elapsed,horizontalAccuracy,speedAccuracy,speed,bearing,altitude,longitude,latitude"
    metadata = {"Metadata.csv": ("version,device name,platform", [["3"], ["phone"], ["android"]])}
    return _zip(folder / "2023-11-14.zip", {"Location.csv": (names, location), **vectors, **metadata})


def phyphox(folder: Path) -> list[Path]:
    force, turn = _phone_vectors()
    times = [f"{t:.9E}" for t in D.t_s.tolist()]
    e = [[f"{value:.9E}" for value in each.tolist()] for each in (D.lat_deg, D.lon_deg, D.speed_mps, D.course_deg)]
    q = '"{}"'.format

    def names(*each: str) -> str:
        return ",".join(map(q, each))

    location = names(
        "Time (s)", "Latitude (°)", "Longitude (°)", "Velocity (m/s)", "Direction (°)", "Horizontal Accuracy (m)"
    )
    vectors = {
        f"{file}.csv": (
            names("Time (s)", *(f"{word} {axis} ({unit})" for axis in "xyz")),
            [times, *([f"{value:.9E}" for value in v[:, k].tolist()] for k in range(3))],
        )
        for file, word, unit, v in (
            ("Accelerometer", "Acceleration", "m/s^2", force),
            ("Gyroscope", "Gyroscope", "rad/s", turn),
        )
    }
    time = (
        '"event","experiment time","system time","system time text"',
        [['"START"'], ["0.0"], [f"{START_S}.000"], ['"x"']],
    )
    return _zip(
        folder / "phyphox.zip", {"Location.csv": (location, [times, *e, times]), **vectors, "meta/time.csv": time}
    )


def gnss_logger(folder: Path) -> list[Path]:
    force, turn = _phone_vectors()
    ms = [str(s // 10**6) for s in D.stamp_ns.tolist()]
    lines = [
        "# Version: v3.0.6.4 Platform: 14", "#",
        "# Raw,utcTimeMillis,TimeNanos,Svid",
        "# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,BearingDegrees,UnixTimeMillis",
        "# UncalAccel,utcTimeMillis,elapsedRealtimeNanos,UncalAccelXMps2,UncalAccelYMps2,UncalAccelZMps2,BiasXMps2",
        "# UncalGyro,utcTimeMillis,elapsedRealtimeNanos,UncalGyroXRadPerSec,UncalGyroYRadPerSec,UncalGyroZRadPerSec",
    ]  # fmt: skip
    for k in range(N):
        a, w = ",".join(digits(force[k], 6)), ",".join(digits(turn[k], 6))
        lines += [
            f"Raw,{ms[k]},1,5",
            f"Fix,GPS,{LAT[k]},{LON[k]},520.0,{D.speed_mps[k]:.4f},{COURSE[k]},{ms[k]}",
            f"Fix,NLP,48.2,11.6,520.0,,,{ms[k]}",
            f"UncalAccel,{ms[k]},{k},{a},0.0",
            f"UncalGyro,{ms[k]},{k},{w}",
        ]
    (folder / "gnss_log.txt").write_text("\n".join(lines) + "\n")
    return [folder / "gnss_log.txt"]


DBC = """VERSION ""

NS_ :

BS_:

BU_: ESP

BO_ 256 Motion: 8 ESP
 SG_ VehicleSpeed : 0|16@1+ (0.01,0) [0|655.35] "km/h" ESP
 SG_ YawRate : 16|16@1- (0.005,0) [-163|163] "deg/s" ESP

BO_ 512 Position: 8 ESP
 SG_ GPS_Latitude : 0|32@1- (1E-007,0) [-90|90] "deg" ESP
 SG_ GPS_Longitude : 32|32@1- (1E-007,0) [-180|180] "deg" ESP

BO_ 768 Engine: 8 ESP
 SG_ EngineTorque : 0|16@1+ (0.1,0) [0|6553.5] "Nm" ESP
"""


def _can(folder: Path, name: str) -> list[Path]:
    """Write a CAN trace and its DBC file: the same bytes on any day."""
    import can
    import cantools

    (folder / "car.dbc").write_text(DBC)
    database = cantools.database.load_file(folder / "car.dbc")
    assert isinstance(database, Database)
    with can.Logger(folder / name) as writer:
        for k in range(N):
            stamp = START_S + D.t_s[k]
            values = {
                "Motion": {"VehicleSpeed": D.speed_mps[k] * KMH, "YawRate": np.degrees(D.yaw_rate_radps[k])},
                "Position": {"GPS_Latitude": D.lat_deg[k], "GPS_Longitude": D.lon_deg[k]},
                "Engine": {"EngineTorque": 100.0},
            }
            for message, signals in values.items():
                description = database.get_message_by_name(message)
                data = description.encode(signals, strict=False)
                writer(
                    can.Message(
                        timestamp=stamp, arbitration_id=description.frame_id, is_extended_id=False, data=data, channel=0
                    )
                )
    if name.endswith(".asc"):
        text = (folder / name).read_text()
        (folder / name).write_text(re.sub(r"^date .*$", "date Sun Jan 7 10:00:00.000 2024", text, flags=re.MULTILINE))
    return [folder / name, folder / "car.dbc"]


def can_asc(folder: Path) -> list[Path]:
    return _can(folder, "trace.asc")


def can_blf(folder: Path) -> list[Path]:
    return _can(folder, "trace.blf")


def can_trc(folder: Path) -> list[Path]:
    return _can(folder, "trace.trc")


def can_dump(folder: Path) -> list[Path]:
    return _can(folder, "candump.log")


def _fcd(folder: Path, name: str) -> list[Path]:
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<fcd-export>"]
    for k in range(N):
        rest = 'type="car" pos="0" lane="a_0" slope="0.00"'
        place = f'x="{D.x_m[k]:.3f}" y="{D.y_m[k]:.3f}" angle="{COURSE[k]}" speed="{D.speed_mps[k]:.3f}"'
        other = f'x="{100 + D.t_s[k]:.3f}" y="50.0" angle="90.00" speed="1.00"'
        lines += [
            f'  <timestep time="{D.t_s[k]:.2f}">',
            f'    <vehicle id="{name}" {place} {rest}/>',
            f'    <vehicle id="other" {other} {rest}/>',
            "  </timestep>",
        ]
    (folder / "fcd.xml").write_text("\n".join([*lines, "</fcd-export>"]))
    return [folder / "fcd.xml"]


def fcd_ego(folder: Path) -> list[Path]:
    return _fcd(folder, "ego")


def fcd_nobody(folder: Path) -> list[Path]:
    return _fcd(folder, "v0")


def video(folder: Path) -> list[Path]:
    import cv2

    writer = cv2.VideoWriter(str(folder / "front.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, (64, 48))
    for k in range(20):
        writer.write(np.full((48, 64, 3), 10 * k, np.uint8))
    writer.release()
    (folder / "frames.txt").write_text("\n".join(str(s) for s in D.stamp_ns[:20].tolist()))
    return [folder / "front.mp4", folder / "frames.txt"]


def own_table(folder: Path, name: str) -> list[Path]:
    from tests.unit.importing.oracles import exported

    return [exported(folder, name)]


CASES = {
    "csv-logger": Case("csv", csv_logger, "fix velocity"),
    "csv-german": Case("csv", csv_german, "fix speed", None),
    "csv-quoted-commas": Case("csv", csv_quoted_commas, "fix speed", None),
    "tsv-iso": Case("csv", tsv_iso, "fix speed"),
    "csv-offset": Case("csv", csv_offset, "fix speed"),
    "csv-milliseconds": Case("csv", csv_milliseconds, "fix velocity"),
    "csv-vehicle": Case("csv", csv_vehicle, "fix speed yaw_rate", None),
    "csv-with-imu": Case("csv", csv_with_imu, "fix imu"),
    "csv-utf16": Case("csv", csv_utf16, "fix speed"),
    "csv-units-row": Case("csv", csv_units_row, "fix speed", None),
    "csv-gps-week": Case("csv", csv_gps_week, "fix speed"),
    "csv-date-and-time": Case("csv", csv_date_and_time, "fix speed"),
    "csv-integers": Case("csv", csv_integers, "fix speed"),
    "csv-local": Case("csv", csv_local, "pose speed", None),
    "csv-local-time": Case("csv", csv_local_time, asks="without a zone"),
    "parquet-zone": Case("parquet", parquet_zone, "fix speed"),
    "parquet-epoch": Case("parquet", parquet_epoch, "fix velocity"),
    "gpx": Case("gpx", gpx_plain, "fix"),
    "gpx-speed": Case("gpx", gpx_speed, "fix speed"),
    "gpx-two-tracks": Case("gpx", gpx_two_tracks, asks="2 tracks"),
    "nmea": Case("nmea", nmea_full, "fix velocity"),
    "nmea-rmc": Case("nmea", nmea_rmc, "fix velocity"),
    "nmea-gga": Case("nmea", nmea_gga, "fix", 80_000 * 10**9),
    "ubx": Case("ubx", ubx, "fix velocity"),
    "tum": Case("tum", tum, "pose"),
    "tum-camera": Case("tum", tum_camera, "pose"),
    "kitti": Case("kitti", kitti, "pose", None),
    "kitti-no-times": Case("kitti", kitti_no_times, asks="no times"),
    "euroc-truth": Case("euroc", euroc_truth, "pose"),
    "euroc-imu": Case("euroc", euroc_imu, "imu"),
    "sensor-logger": Case("zip", sensor_logger, "fix velocity imu"),
    "phyphox": Case("zip", phyphox, "fix velocity imu"),
    "gnsslogger": Case("gnsslogger", gnss_logger, "fix velocity imu"),
    "can-asc": Case("asc", can_asc, "fix speed yaw_rate", None),
    "can-blf": Case("blf", can_blf, "fix speed yaw_rate"),
    "can-candump": Case("candump", can_dump, "fix speed yaw_rate"),
    "fcd": Case("sumo fcd", fcd_ego, "plane speed heading remote", None),
    "fcd-nobody": Case("sumo fcd", fcd_nobody, asks="one of them is the ego"),
    "video": Case("video", video, "frames"),
    "csv-own": Case("csv", lambda folder: own_table(folder, "ego.csv"), "own"),
}
"""The forty files."""
