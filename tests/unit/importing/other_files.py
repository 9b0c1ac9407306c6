"""Files of other kinds as programs write them that the first forty files do not show."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from tests.unit.importing.drive import START_S, digits
from tests.unit.importing.files import KMH, KNOT, MPH, _with_checksum
from tests.unit.importing.other_base import (
    COURSE,
    FILL,
    HOLDER,
    LAT,
    LON,
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
from tests.unit.importing.other_tables import TABLE_CASES

# fmt: off

def _utc_lines(make: Callable[[int, str, str], list[str]], rows: range) -> list[str]:
    clock, date = stamps("%H%M%S.%f", cut=4), stamps("%d%m%y")
    return [line for k in rows for line in make(k, clock[k], date[k])]


def _angle(value: float, width: int) -> str:
    value = abs(value)
    return f"{int(value):0{width}d}{value % 1 * 60:010.7f}"


def nmea_mixed(folder: Path) -> list[Path]:
    def make(k: int, clock: str, date: str) -> list[str]:
        place = f"{_angle(D.lat_deg[k], 2)},N,{_angle(D.lon_deg[k], 3)},W"
        knots = f"{D.speed_mps[k] * KNOT:.3f}"
        course = COURSE[k] if D.speed_mps[k] > 0.5 else ""
        bodies = [
            f"GNRMC,{clock},A,{place},{knots},{course},{date},,,D,V", f"GNVTG,{course},T,,M,{knots},N,{D.speed_mps[k] * KMH:.3f},K,D",
            f"GNGGA,{clock},{place},4,12,0.60,31.2,M,47.7,M,1.0,0000", "GNGSA,A,3,02,05,07,,,,,,,,,,1.1,0.6,0.9,1",
            "GPGSV,3,1,11,02,44,120,44,05,30,060,41,07,12,200,33,09,02,010,20,1", f"GNHDT,{COURSE[k]},T",
            "PUBX,00,1,2,3", "PSTMPV,1,2", f"GNZDA,{clock},14,11,2023,00,00",
        ]  # fmt: skip
        return [_with_checksum(body) for body in bodies]

    (folder / "sept.nmea").write_text("\r\n".join(_utc_lines(make, range(N))) + "\r\n")
    return [folder / "sept.nmea"]


def nmea_logger(folder: Path) -> list[Path]:
    local = stamps("%Y-%m-%d %H:%M:%S.%f", hours=1, cut=3)

    def make(k: int, clock: str, date: str) -> list[str]:
        status = "V" if k < 30 else "A"
        place = f"{_angle(D.lat_deg[k], 2)},N,{_angle(D.lon_deg[k], 3)},W"
        return [f"{local[k]} " + _with_checksum(f"GPRMC,{clock},{status},{place},{D.speed_mps[k] * KNOT:.3f},{COURSE[k]},{date},,,A")]

    (folder / "serial.log").write_text("--- log opened ---\n" + "\n".join(_utc_lines(make, range(N))) + "\n")
    return [folder / "serial.log"]


def garmin_gpx(folder: Path) -> list[Path]:
    times = stamps("%Y-%m-%dT%H:%M:%S.%fZ", SLOW, cut=0)
    head = '<?xml version="1.0" encoding="UTF-8"?><gpx creator="Garmin Connect" version="1.1" xmlns:ns3="http://www.garmin.com/xmlschemas/TrackPointExtension/v2" xmlns="http://www.topografix.com/GPX/1/1"><metadata><time>2023-11-14T22:13:20.000Z</time></metadata><trk><name>Drive</name><type>driving</type><trkseg>'
    points = [
        f'<trkpt lat="{LAT[10 * k]}" lon="{LON[10 * k]}"><ele>31.2</ele><time>{times[k]}</time><extensions><ns3:TrackPointExtension><ns3:atemp>21.0</ns3:atemp><ns3:speed>{D.speed_mps[10 * k]:.3f}</ns3:speed><ns3:course>{COURSE[10 * k]}</ns3:course></ns3:TrackPointExtension></extensions></trkpt>'
        for k in range(len(times))
    ]
    points.insert(40, "</trkseg><trkseg>")
    (folder / "activity.gpx").write_text(head + "\n".join(points) + "</trkseg></trk></gpx>")
    return [folder / "activity.gpx"]


def gpx_10(folder: Path) -> list[Path]:
    times = stamps("%Y-%m-%dT%H:%M:%SZ", SLOW)
    points = [f'<trkpt lat="{LAT[10 * k]}" lon="{LON[10 * k]}"><time>{times[k]}</time><course>{COURSE[10 * k]}</course><speed>{D.speed_mps[10 * k]:.3f}</speed><src>gps</src></trkpt>' for k in range(len(times))]
    (folder / "old.gpx").write_text('<?xml version="1.0"?><gpx version="1.0" creator="GPSLogger" xmlns="http://www.topografix.com/GPX/1/0"><wpt lat="1" lon="2"><name>x</name></wpt><trk><trkseg>' + "".join(points) + "</trkseg></trk></gpx>")
    return [folder / "old.gpx"]


def gpx_route(folder: Path) -> list[Path]:
    points = [f'<trkpt lat="{LAT[10 * k]}" lon="{LON[10 * k]}"><ele>3</ele></trkpt>' for k in range(90)]
    (folder / "route.gpx").write_text('<?xml version="1.0"?><gpx version="1.1" creator="StravaGPX" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>' + "".join(points) + "</trkseg></trk></gpx>")
    return [folder / "route.gpx"]


def ubx_mixed(folder: Path) -> list[Path]:
    from pyubx2 import GET, UBXMessage

    data = b""
    for k, stamp in enumerate(D.stamp_ns.tolist()):
        moment = datetime.fromtimestamp(stamp // 10**9, UTC)
        nano = stamp % 10**9
        if nano > 500_000_000:  # receivers round the second and give a negative rest
            moment, nano = moment + timedelta(seconds=1), nano - 10**9
        data += _with_checksum("GNTXT,01,01,02,u-blox AG").encode() + b"\r\n" if k % 50 == 0 else b""
        data += UBXMessage("NAV", "NAV-CLOCK", GET, iTOW=k).serialize()
        speed, heading = D.speed_mps[k], D.heading_rad[k]
        data += UBXMessage(
            "NAV", "NAV-PVT", GET, iTOW=k * 100, year=moment.year, month=moment.month, day=moment.day, hour=moment.hour, min=moment.minute, second=moment.second,
            validDate=1, validTime=1, fullyResolved=1, nano=nano, fixType=0 if k < 20 else 3, gnssFixOk=0 if k < 20 else 1,
            lat=0.0 if k < 20 else float(D.lat_deg[k]), lon=0.0 if k < 20 else float(D.lon_deg[k]), height=78_000, hMSL=31_000,
            velN=round(1000 * speed * np.sin(heading)), velE=round(1000 * speed * np.cos(heading)), gSpeed=round(1000 * speed), headMot=float(D.course_deg[k]),
        ).serialize()  # fmt: skip
    (folder / "COM3_231114.ubx").write_bytes(b"\x00\x81garbage" + data + b"\xb5\x62\x01\x07\x5c")
    return [folder / "COM3_231114.ubx"]


def tum_commented(folder: Path) -> list[Path]:
    half = 0.5 * D.heading_rad
    rows = ["# ground truth trajectory", "# file: 'drive.bag'", "# timestamp tx ty tz qx qy qz qw"]
    rows += [f"{START_S + D.t_s[k]:.4f} {D.x_m[k]:.4f} {D.y_m[k]:.4f} 0.0000 0.0000 0.0000 {np.sin(half[k]):.6f} {np.cos(half[k]):.6f}" for k in range(N)]
    (folder / "groundtruth.txt").write_text("\n".join(rows) + "\n")
    return [folder / "groundtruth.txt"]


def euroc_csv(folder: Path) -> list[Path]:
    half, zero = 0.5 * D.heading_rad, ["0.000000"] * N
    head = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]"
    cols = [[str(s) for s in D.stamp_ns.tolist()], digits(D.x_m, 6), digits(D.y_m, 6), zero, digits(np.cos(half), 6), zero, zero, digits(np.sin(half), 6), digits(D.speed_mps * np.cos(D.heading_rad), 4), digits(D.speed_mps * np.sin(D.heading_rad), 4), zero, *[zero] * 6]
    return table(folder, "data.csv", head, cols, end="\r\n")


def _pack(path: Path, members: dict[str, str]) -> list[Path]:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in members.items():
            archive.writestr(name, text)
    return [path]


def _csv(head: str, columns: Sequence[Sequence[str]], mark: str = ",") -> str:
    return "\n".join([head, *(mark.join(row) for row in zip(*columns, strict=True))]) + "\n"


def sensor_logger_ios(folder: Path) -> list[Path]:
    """iOS: accelerations without gravity, gravity in a table of its own, both with Apple's sign."""
    force, turn = phone_vectors()
    axes_down = _phone_linear() - force
    ns, elapsed = [str(s) for s in D.stamp_ns.tolist()], digits(D.t_s, 6)
    r = SLOW
    members = {
        "Location.csv": _csv("time,seconds_elapsed,bearingAccuracy,speedAccuracy,verticalAccuracy,horizontalAccuracy,speed,bearing,altitude,longitude,latitude",
            [ns[r], elapsed[r], *[["1.0"] * 90] * 4, digits(D.speed_mps[r], 4), COURSE[r], ["31.0"] * 90, LON[r], LAT[r]]),
        "Metadata.csv": "version,device name,recording epoch time,recording time,recording timezone,platform\n3,iPhone,1700000000000,2023-11-14_22-13-20,Europe/Paris,ios\n",
        "Annotation.csv": "time,seconds_elapsed,text,millisecond_press_duration\n",
        "Orientation.csv": _csv("time,seconds_elapsed,yaw,qx,qz,roll,qw,qy,pitch", [ns, elapsed, *[FILL] * 7]),
    }  # fmt: skip
    for name, values in {"Accelerometer": -_phone_linear(), "Gravity": axes_down, "Gyroscope": turn}.items():
        members[f"{name}.csv"] = _csv("time,seconds_elapsed,z,y,x", [ns, elapsed, *(digits(values[:, k], 6) for k in (2, 1, 0))])
    return _pack(folder / "Drive-2023-11-14_22-13-20.zip", members)


def _phone_linear() -> np.ndarray:
    force, _ = phone_vectors()
    up = HOLDER @ np.array([0.0, 0.0, 9.80665])
    return force - up


def phyphox_comma(folder: Path) -> list[Path]:
    """phyphox' export "CSV (semicolon, decimal comma)"."""
    force, turn = phone_vectors()

    def e(values: np.ndarray) -> list[str]:
        return [f"{value:.9E}".replace(".", ",") for value in values.tolist()]

    quoted = '"Time (s)";"Latitude (°)";"Longitude (°)";"Height (m)";"Velocity (m/s)";"Direction (°)";"Horizontal Accuracy (m)";"Vertical Accuracy (°)"'
    r = SLOW
    one = e(np.ones(90))
    members = {
        "Location.csv": _csv(quoted, [e(D.t_s[r]), e(D.lat_deg[r]), e(D.lon_deg[r]), one, e(D.speed_mps[r]), e(D.course_deg[r]), one, one], ";"),
        "Accelerometer.csv": _csv('"Time (s)";"X (m/s^2)";"Y (m/s^2)";"Z (m/s^2)"', [e(D.t_s), *(e(force[:, k]) for k in range(3))], ";"),
        "Gyroscope.csv": _csv('"Time (s)";"X (rad/s)";"Y (rad/s)";"Z (rad/s)"', [e(D.t_s), *(e(turn[:, k]) for k in range(3))], ";"),
        "meta/device.csv": '"property";"value"\n"version";"1.1.11"\n',
        "meta/time.csv": f'"event";"experiment time";"system time";"system time text"\n"START";0,000000000E0;"{START_S},000";"2023-11-14 23:13:20.000 UTC+01:00"\n"PAUSE";9,0E1;"{START_S + 90},000";"x"\n',
    }
    return _pack(folder / "GPS 2023-11-14.zip", members)


def gnsslogger_raw(folder: Path) -> list[Path]:
    force, turn = phone_vectors()
    ms = [str(s // 10**6) for s in D.stamp_ns.tolist()]
    rows = ["# ", "# Header Description:", "# ", "# Version: v3.1.0.4 Platform: 15 Manufacturer: Google Model: Pixel 8 GNSS Hardware Model Name: qcom", "# ",
        "# Raw,utcTimeMillis,TimeNanos,LeapSecond,TimeUncertaintyNanos,FullBiasNanos,BiasNanos,Svid", "# ",
        "# UncalAccel,utcTimeMillis,elapsedRealtimeNanos,UncalAccelXMps2,UncalAccelYMps2,UncalAccelZMps2,BiasXMps2,BiasYMps2,BiasZMps2,CalibrationAccuracy",
        "# UncalGyro,utcTimeMillis,elapsedRealtimeNanos,UncalGyroXRadPerSec,UncalGyroYRadPerSec,UncalGyroZRadPerSec,DriftXRadPerSec,DriftYRadPerSec,DriftZRadPerSec,CalibrationAccuracy",
        "# UncalMag,utcTimeMillis,elapsedRealtimeNanos,UncalMagXMicroT,UncalMagYMicroT,UncalMagZMicroT,BiasXMicroT,BiasYMicroT,BiasZMicroT,CalibrationAccuracy",
        "# OrientationDeg,utcTimeMillis,elapsedRealtimeNanos,yawDeg,rollDeg,pitchDeg,CalibrationAccuracy", "# Nav,Svid,Type,Status,MessageId,Sub-messageId,Data(Bytes)",
        "# GameRotationVector,utcTimeMillis,elapsedRealtimeNanos,x,y,z,w",
        "# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,UnixTimeMillis,SpeedAccuracyMps,BearingAccuracyDegrees,elapsedRealtimeNanos,VerticalAccuracyMeters,MockLocation,NumberOfUsedSignals", "# "]  # fmt: skip
    for k in range(N):
        if k % 10 == 0:
            rows += [f"Raw,{ms[k]},1,18,,-1,0.0,{sv}" for sv in range(3)]
            rows.append(f"Fix,FLP,{LAT[k]},{LON[k]},31.2,{D.speed_mps[k]:.3f},3.1,{COURSE[k]},{ms[k]},0.3,4.0,{k},2.0,0,12")
        rows.append(f"UncalAccel,{ms[k]},{k},{','.join(digits(force[k], 6))},0.0,0.0,0.0,3")
        rows.append(f"UncalGyro,{ms[k]},{k},{','.join(digits(turn[k], 7))},0.0,0.0,0.0,3")
        rows.append(f"OrientationDeg,{ms[k]},{k},10,20,30,3")
    (folder / "gnss_log_2023_11_14_23_13_20.txt").write_text("\n".join(rows) + "\n")
    return [folder / "gnss_log_2023_11_14_23_13_20.txt"]


DBC_MOTOROLA = """VERSION "7"

NS_ :

BS_:

BU_: GW ESC

BO_ 2566834709 VehDyn: 8 ESC
 SG_ VehYawRate : 7|16@0- (0.0002,0) [-6|6] "rad/s" GW
 SG_ VehLongAccel : 23|16@0- (0.001,0) [-30|30] "m/s2" GW

BO_ 291 WheelSpeeds: 8 ESC
 SG_ WheelSpd_FL : 7|16@0+ (0.01,0) [0|300] "km/h" GW
 SG_ WheelSpd_FR : 23|16@0+ (0.01,0) [0|300] "km/h" GW

BO_ 801 DisplaySpeed: 8 GW
 SG_ DISPLAY_Vehicle_Speed : 7|12@0+ (0.5,0) [0|400] "mph" ESC
"""


def _frames(folder: Path, channel: str = "can0") -> list[tuple[float, int, bool, bytes]]:
    import cantools

    (folder / "veh.dbc").write_text(DBC_MOTOROLA)
    database = cantools.database.load_file(folder / "veh.dbc")
    assert isinstance(database, cantools.database.can.Database)
    found = []
    for k in range(N):
        values = {"VehDyn": {"VehYawRate": D.yaw_rate_radps[k], "VehLongAccel": D.accel_mps2[k]}, "WheelSpeeds": {"WheelSpd_FL": D.speed_mps[k] * KMH, "WheelSpd_FR": D.speed_mps[k] * KMH}, "DisplaySpeed": {"DISPLAY_Vehicle_Speed": D.speed_mps[k] * MPH}}
        for j, (message, signals) in enumerate(values.items()):
            of = database.get_message_by_name(message)
            found.append((D.t_s[k] + 0.001 * j, of.frame_id, of.is_extended_frame, of.encode(signals, strict=False)))
    return found


def candump_extended(folder: Path) -> list[Path]:
    rows = [f"({START_S + t:.6f}) can0 {f'{i:08X}' if x else f'{i:03X}'}#{data.hex().upper()}" for t, i, x, data in _frames(folder)]
    rows.insert(5, f"({START_S + 0.05:.6f}) can0 7DF##1AABB")
    (folder / "candump-2023-11-14_231320.log").write_text("\n".join(rows) + "\n")
    return [folder / "candump-2023-11-14_231320.log", folder / "veh.dbc"]


def candump_places_apart(folder: Path, multiplexed: bool) -> list[Path]:
    """Latitude and longitude in different frames, 2 ms apart: of a multiplexed message, or of two messages."""
    import cantools

    b, selector, switch = ("A", " SG_ Mux M : 0|8@1+ (1,0) [0|9] \"\" ECU\n", (" m0", " m1")) if multiplexed else ("B", "", ("", ""))
    places = [f' SG_ {name}{mux} : 8|32@1- (1E-07,0) [-180|180] "deg" ECU\n' for name, mux in zip(("Latitude", "Longitude"), switch, strict=True)]
    (folder / "gps.dbc").write_text('VERSION ""\nNS_ :\nBS_:\nBU_: ECU\nBO_ 256 A: 8 ECU\n' + selector + places[0] + ("" if multiplexed else "\nBO_ 257 B: 8 ECU\n") + places[1])
    database = cantools.database.can.Database()
    database.add_dbc_file(folder / "gps.dbc")
    rows = []
    for k in range(N):
        for j, (message, name, value) in enumerate((("A", "Latitude", D.lat_deg[k]), (b, "Longitude", D.lon_deg[k]))):
            frame = database.get_message_by_name(message)
            data = frame.encode({name: float(value), **({"Mux": j} if multiplexed else {})})
            rows.append(f"({START_S + D.t_s[k] + 0.002 * j:.6f}) can0 {frame.frame_id:03X}#{data.hex().upper()}")
    (folder / "candump-gps.log").write_text("\n".join(rows) + "\n")
    return [folder / "candump-gps.log", folder / "gps.dbc"]


def asc_text(folder: Path, base: str, relative: bool) -> list[Path]:
    rows = ["date Tue Nov 14 11:13:20.000 pm 2023", f"base {base}  timestamps {'relative' if relative else 'absolute'}", "internal events logged", "// version 9.0.0", "Begin Triggerblock Tue Nov 14 11:13:20.000 pm 2023", "   0.000000 Start of measurement"]
    last = 0.0
    for t, i, x, data in _frames(folder):
        name = f"{i:X}" if base == "hex" else str(i)
        cells = " ".join(f"{b:02X}" if base == "hex" else f"{b:3d}" for b in data)
        rows.append(f"{t - last if relative else t:11.6f} 1  {name + ('x' if x else ''):<15} Rx   d {len(data)} {cells}  Length = 0 BitCount = 0 ID = {i}")
        last = t
    rows.insert(9, f"{0.0 if relative else 0.0015:11.6f} 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%")
    (folder / "canoe.asc").write_text("\n".join([*rows, "End TriggerBlock"]) + "\n")
    return [folder / "canoe.asc", folder / "veh.dbc"]


def fcd_geo(folder: Path) -> list[Path]:
    rows = ['<?xml version="1.0" encoding="UTF-8"?>', "<!-- generated by Eclipse SUMO -->", '<fcd-export xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">']
    for k in range(N):
        rows.append(f'<timestep time="{D.t_s[k]:.2f}"><vehicle id="ego" x="{LON[k]}" y="{LAT[k]}" angle="{COURSE[k]}" type="DEFAULT" speed="{D.speed_mps[k]:.2f}" pos="1" lane="e_0" slope="0"/></timestep>')
    (folder / "geo.fcd.xml").write_text("\n".join([*rows, "</fcd-export>"]))
    return [folder / "geo.fcd.xml"]


def _parquet(folder: Path, columns: dict) -> list[Path]:
    import pyarrow as pa
    from pyarrow import parquet

    parquet.write_table(pa.table(columns), folder / "drive.parquet")
    return [folder / "drive.parquet"]


def parquet_berlin(folder: Path) -> list[Path]:
    import pyarrow as pa

    return _parquet(folder, {"lat": D.lat_deg, "lon": D.lon_deg, "vehicle_speed_kph": (D.speed_mps * KMH).astype(np.float32), "__index_level_0__": pa.array(D.stamp_ns // 1000, pa.timestamp("us", tz="Europe/Berlin"))})


def parquet_naive(folder: Path) -> list[Path]:
    import pyarrow as pa

    return _parquet(folder, {"time": pa.array(D.stamp_ns, pa.timestamp("ns")), "lat": D.lat_deg, "lon": D.lon_deg})


def parquet_struct(folder: Path) -> list[Path]:
    import pyarrow as pa

    place = pa.StructArray.from_arrays([pa.array(D.lat_deg), pa.array(D.lon_deg)], ["latitude", "longitude"])
    return _parquet(folder, {"stamp_ns": D.stamp_ns, "position": place, "speed_mps": D.speed_mps})


def video_ntsc(folder: Path) -> list[Path]:
    import cv2

    writer = cv2.VideoWriter(str(folder / "dash.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30000 / 1001, (64, 48))
    for k in range(20):
        writer.write(np.full((48, 64, 3), 10 * k, np.uint8))
    writer.release()
    return [folder / "dash.avi"]


def excel(folder: Path) -> list[Path]:
    return _pack(folder / "drive.xlsx", {"[Content_Types].xml": "<Types/>", "xl/workbook.xml": "<workbook/>", "xl/worksheets/sheet1.xml": "<worksheet/>"})


def kml(folder: Path) -> list[Path]:
    (folder / "t.kml").write_text('<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><LineString><coordinates>11,48,0 11,49,0</coordinates></LineString></Placemark></Document></kml>')
    return [folder / "t.kml"]


def tcx(folder: Path) -> list[Path]:
    times = stamps("%Y-%m-%dT%H:%M:%SZ", SLOW)
    points = [f"<Trackpoint><Time>{times[k]}</Time><Position><LatitudeDegrees>{LAT[10 * k]}</LatitudeDegrees><LongitudeDegrees>{LON[10 * k]}</LongitudeDegrees></Position></Trackpoint>" for k in range(90)]
    (folder / "a.tcx").write_text('<?xml version="1.0"?>\n<TrainingCenterDatabase xmlns="http://www.garmin.com/xmlschemas/TrainingCenterDatabase/v2">\n' + "\n".join(points) + "\n</TrainingCenterDatabase>")
    return [folder / "a.tcx"]


def fit(folder: Path) -> list[Path]:
    (folder / "a.fit").write_bytes(bytes([14, 16, 0, 0, 64, 0, 0, 0]) + b".FIT" + bytes(range(64)))
    return [folder / "a.fit"]


def jsonl(folder: Path) -> list[Path]:
    rows = [json.dumps({"t": START_S + t, "lat": a, "lon": o}) for t, a, o in zip(D.t_s, D.lat_deg, D.lon_deg, strict=True)]
    (folder / "a.jsonl").write_text("\n".join(rows) + "\n")
    return [folder / "a.jsonl"]


def parquet_utc_name(folder: Path) -> list[Path]:
    import pyarrow as pa

    return _parquet(folder, {"timestamp_utc": pa.array(D.stamp_ns // 1000, pa.timestamp("us")), "latitude": D.lat_deg.astype(np.float64), "longitude": D.lon_deg, "created_at": pa.array(D.stamp_ns // 1000, pa.timestamp("us"))})


def nmea_bare(folder: Path) -> list[Path]:
    def make(k: int, clock: str, date: str) -> list[str]:
        return [f"$GPRMC,{clock},A,{_angle(D.lat_deg[k], 2)},N,{_angle(D.lon_deg[k], 3)},W,{D.speed_mps[k] * KNOT:.2f},{COURSE[k]},{date},,"]

    (folder / "bare.nmea").write_text("\n".join(_utc_lines(make, range(N))) + "\n")
    return [folder / "bare.nmea"]


def ubx_old(folder: Path) -> list[Path]:
    from pyubx2 import GET, UBXMessage

    data = b"".join(UBXMessage("NAV", "NAV-POSLLH", GET, iTOW=k * 100, lon=float(D.lon_deg[k]), lat=float(D.lat_deg[k])).serialize() for k in range(N))
    (folder / "old.ubx").write_bytes(data)
    return [folder / "old.ubx"]


def fcd_clock(folder: Path) -> list[Path]:
    """Times of day, as `--human-readable-time` writes them, and a person beside the car."""
    rows = ["<fcd-export>"]
    for k in range(N):
        at = f'x="{D.x_m[k]:.2f}" y="{D.y_m[k]:.2f}" angle="{COURSE[k]}" speed="{D.speed_mps[k]:.2f}"'
        rows.append(f'<timestep time="00:{int(D.t_s[k] // 60):02d}:{D.t_s[k] % 60:05.2f}"><vehicle id="ego" {at}/><person id="p" x="1" y="2" angle="0" speed="1"/></timestep>')
    (folder / "fcd.xml").write_text("\n".join([*rows, "</fcd-export>"]))
    return [folder / "fcd.xml"]



OTHER_CASES = TABLE_CASES | {
    "nmea-mixed": OtherCase(nmea_mixed, P | V | {"heading": 0.01}),
    "nmea-logger": OtherCase(nmea_logger, P | V),
    "garmin-gpx": OtherCase(garmin_gpx, P | V),
    "gpx-1.0": OtherCase(gpx_10, P | V),
    "gpx-route": OtherCase(gpx_route, {}, asks="time"),
    "ubx-mixed": OtherCase(ubx_mixed, P | V),
    "tum-commented": OtherCase(tum_commented, {"pose": 0.01}),
    "euroc-csv": OtherCase(euroc_csv, {"pose": 0.01}),
    "sensor-logger-ios": OtherCase(sensor_logger_ios, P | V | {"gyro": 0.02, "accel": 0.3}),
    "phyphox-comma": OtherCase(phyphox_comma, P | V | {"gyro": 0.02, "accel": 0.3}),
    "gnsslogger-raw": OtherCase(gnsslogger_raw, P | V | {"gyro": 0.02, "accel": 0.3}),
    "candump-extended": OtherCase(candump_extended, R | {"gyro": 0.01}),
    "asc-hex-relative": OtherCase(lambda f: asc_text(f, "hex", True), R | {"gyro": 0.01}, 0),
    "candump-multiplexed-places": OtherCase(lambda f: candump_places_apart(f, True), P),
    "candump-two-messages": OtherCase(lambda f: candump_places_apart(f, False), P),
    "asc-dec": OtherCase(lambda f: asc_text(f, "dec", False), R | {"gyro": 0.01}, 0),
    "fcd-clock": OtherCase(fcd_clock, {"fix": 1e9} | R | {"heading": 0.02}, 0),
    "fcd-geo": OtherCase(fcd_geo, P | R | {"heading": 0.01}, 0),
    "parquet-berlin": OtherCase(parquet_berlin, P | R),
    "parquet-naive": OtherCase(parquet_naive, {}, asks="zone"),
    "parquet-struct": OtherCase(parquet_struct, P | R),
    "video-ntsc": OtherCase(video_ntsc, {}, asks="frames"),
    "excel": OtherCase(excel, {}, asks="Excel"),
    "kml": OtherCase(kml, {}, asks="KML"),
    "tcx": OtherCase(tcx, {}, asks="TCX"),
    "fit": OtherCase(fit, {}, asks="FIT"),
    "jsonl": OtherCase(jsonl, {}, asks="JSON"),
    "parquet-utc-name": OtherCase(parquet_utc_name, P),
    "nmea-bare": OtherCase(nmea_bare, {}, asks="checksum"),
    "ubx-old": OtherCase(ubx_old, {}, asks="NAV-PVT"),
}
