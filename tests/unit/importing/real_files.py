"""Files of receivers, phones, cameras and buses that are no plain tables, of the drive of `real_drive`."""

# fmt: off
from __future__ import annotations

import gzip
import json
import struct
import zipfile
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import numpy as np

from tests.unit.importing.real_drive import ALL, SECONDS, START, START_NS, N, R, show, times
from tests.unit.importing.real_tables import EPOCH_S, RealCase, lat, lon, minutes, rows_of, same, write

REAL_FILES: dict[str, RealCase] = {}
UNDULATION_M = 22.0
"""Height of the geoid over the ellipsoid, m; messages of fixes hold heights over the ellipsoid."""
MIDNIGHT_S = 86_360
"""Seconds of the day at the first row."""


def real(holds: str = "", asks: str = "", start: int = START_NS, by_topic: dict[str, float] | None = None, **bounds: float) -> Callable[[Callable[[Path], list[Path]]], Callable[[Path], list[Path]]]:
    """Register the maker of a case under its name."""

    def keep(make: Callable[[Path], list[Path]]) -> Callable[[Path], list[Path]]:
        REAL_FILES[make.__name__] = RealCase(make, holds, asks, start, {**(by_topic or {}), **bounds})
        return make

    return keep


# ---- NMEA


def sentence(body: str) -> str:
    total = 0
    for each in body.encode():
        total ^= each
    return f"${body}*{total:02X}"


def place_of(k: int) -> str:
    a, ns = minutes(R.lat_deg[k : k + 1], 2, "NS", 5)
    o, ew = minutes(R.lon_deg[k : k + 1], 3, "EW", 5)
    return f"{a[0]},{ns[0]},{o[0]},{ew[0]}"


def rmc(k: int, talker: str = "GN") -> str:
    moment = START + timedelta(seconds=round(R.t_s[k], 2))
    clock = f"{moment:%H%M%S}.{moment.microsecond // 10_000:02d}"
    course = f"{R.course_deg[k]:.2f}" if R.speed_mps[k] > 0.2 else ""  # u-blox leaves it empty while standing
    return sentence(f"{talker}RMC,{clock},A,{place_of(k)},{R.gps_speed_mps[k] / 0.514444:.3f},{course},{moment:%d%m%y},,,A")


def gga(k: int, talker: str = "GN") -> str:
    moment = START + timedelta(seconds=round(R.t_s[k], 2))
    clock = f"{moment:%H%M%S}.{moment.microsecond // 10_000:02d}"
    return sentence(f"{talker}GGA,{clock},{place_of(k)},1,12,0.8,{R.height_m[k]:.1f},M,22.1,M,,")


@real("fix height velocity", height=UNDULATION_M + 3.0)
def nmea_of_a_multi_system_receiver(folder: Path) -> list[Path]:
    """Mixed talkers, satellites, proprietary lines, no fix at first, damaged lines, the end cut off."""
    lines = [sentence("GNTXT,01,01,02,ANTSTATUS=OK"), "$GNRMC,,V,,,,,,,,,,N*4D", sentence("GNGGA,,,,,,0,00,99.99,,,,,,")]
    for k in range(N):
        lines.append(rmc(k))
        lines.append(gga(k, "GP" if k % 2 else "GN"))
        if k % 10 == 0:
            lines += [sentence("GNGSA,A,3,05,07,13,14,15,19,24,30,,,,,1.62,0.86,1.37"), sentence("GPGSV,3,1,11,05,29,309,34,07,62,023,43,13,29,197,37,14,18,262,33"), sentence("GLGSV,1,1,02,74,42,040,38,75,35,310,29"), sentence("PUBX,00,1,2,3")]
        if k % 100 == 50:
            lines[-1] = lines[-1][:20] + "9" + lines[-1][21:]  # a bit was lost
            lines.append(rmc(k)[:30])
    (folder / "COM7_240310.nmea").write_bytes(("\r\n".join(lines) + "\r\n$GNRM").encode())
    return [folder / "COM7_240310.nmea"]


@real("fix height velocity", height=UNDULATION_M + 3.0)
def nmea_of_a_dash_camera(folder: Path) -> list[Path]:
    """BlackVue: milliseconds in brackets before each sentence."""
    lines = [f"[{EPOCH_S * 1000 + k * 100 + 37}]{each}" for k in range(0, N, 10) for each in (rmc(k, "GP"), gga(k, "GP"))]
    return write(folder, "20240310_105920_NF.gps", lines, end="\r\n\r\n")


@real("fix velocity")
def nmea_of_a_terminal(folder: Path) -> list[Path]:
    """A terminal's log puts its own clock (local, late) before the line."""
    lines = [f"[{(START + timedelta(hours=11, seconds=k / 10 + 0.3)):%Y-%m-%d %H:%M:%S}.300] {rmc(k)}" for k in range(0, N, 10)]
    return write(folder, "teraterm.log", lines, end="\r\n")


@real("fix height velocity", height=UNDULATION_M + 3.0)
def nmea_of_an_android_logger(folder: Path) -> list[Path]:
    """GNSSLogger's NMEA file: the word NMEA before, milliseconds behind."""
    return write(folder, "gnss_log.nmea", [f"NMEA,{each},{EPOCH_S * 1000 + k * 100}" for k in range(0, N, 10) for each in (gga(k), rmc(k))])


@real("fix height", start=MIDNIGHT_S * 10**9, height=UNDULATION_M + 3.0)
def nmea_of_gga_alone(folder: Path) -> list[Path]:
    """No date at all, and the clock passes midnight."""
    return write(folder, "gga.txt", [gga(k, "GP") for k in range(0, N, 10)])


@real("fix velocity")
def nmea_without_checksums_of_vtg(folder: Path) -> list[Path]:
    """RMC with sound checksums and VTG at the same time, lower-case checksums."""
    lines = []
    for k in range(0, N, 10):
        one = rmc(k, "GL")
        lines += [one[:-2] + one[-2:].lower(), sentence(f"GLVTG,{R.course_deg[k]:.1f},T,,M,{R.gps_speed_mps[k] / 0.514444:.2f},N,{R.gps_speed_mps[k] * 3.6:.2f},K,A")]
    return write(folder, "lower.nmea", lines)


# ---- u-blox


@real("fix height velocity", height=UNDULATION_M + 3.0)
def ubx_beside_raw_measurements(folder: Path) -> list[Path]:
    """NAV-PVT among RXM-RAWX, NAV-SAT and NMEA; nanoseconds below zero; no fix at first; the last message is cut."""
    from pyubx2 import GET, UBXMessage

    def frame(kind: int, number: int, payload: bytes) -> bytes:
        body = struct.pack("<BBH", kind, number, len(payload)) + payload
        a = b = 0
        for each in body:
            a = (a + each) & 255
            b = (b + a) & 255
        return b"\xb5\x62" + body + bytes((a, b))

    data = b""
    for k in range(N):
        moment = START + timedelta(milliseconds=100 * k)
        nano = moment.microsecond * 1000 - 1_234
        if nano > 500_000_000:
            moment, nano = moment + timedelta(seconds=1), nano - 10**9
        has_fix = k >= 20
        data += UBXMessage(
            "NAV", "NAV-PVT", GET, iTOW=k * 100, year=moment.year, month=moment.month, day=moment.day, hour=moment.hour, min=moment.minute, second=moment.second,
            validDate=1, validTime=1, fullyResolved=1, nano=nano, fixType=3 if has_fix else 0, gnssFixOk=int(has_fix),
            lat=float(R.lat_deg[k]), lon=float(R.lon_deg[k]), height=round(1000 * R.height_m[k]) + 22_000, hMSL=round(1000 * R.height_m[k]),
            velN=round(1000 * R.north_mps[k]), velE=round(1000 * R.east_mps[k]), gSpeed=round(1000 * R.gps_speed_mps[k]), headMot=float(R.course_deg[k]),
        ).serialize()  # fmt: skip
        data += frame(0x02, 0x15, bytes(16 + 32 * 3)) if k % 2 else frame(0x01, 0x35, bytes(8 + 12 * 5))
        data += rmc(k).encode() + b"\r\n" if k % 10 == 0 else b""
    (folder / "rover.ubx").write_bytes(data[:-9])
    return [folder / "rover.ubx"]


@real(asks="NAV-PVT")
def ubx_of_raw_measurements_alone(folder: Path) -> list[Path]:
    body = struct.pack("<BBH", 0x02, 0x15, 16) + bytes(16)
    a = b = 0
    for each in body:
        a, b = (a + each) & 255, (b + a + each) & 255
    (folder / "raw.ubx").write_bytes((b"\xb5\x62" + body + bytes((a, b))) * 300)
    return [folder / "raw.ubx"]


# ---- GPX and KML


def gpx(folder: Path, name: str, tracks: list[str], head: str = "") -> list[Path]:
    (folder / name).write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1" xmlns:gpxtpx="http://www.garmin.com/xmlschemas/TrackPointExtension/v2">{head}{"".join(tracks)}</gpx>')
    return [folder / name]


def points(rows: slice, clock: list[str], more: Callable[[int], str] = lambda k: "") -> list[str]:
    return [f'<trkpt lat="{a}" lon="{o}"><ele>{h}</ele><time>{t}</time>{more(k)}</trkpt>' for k, (a, o, h, t) in enumerate(zip(lat(rows), lon(rows), show(R.height_m, 1, rows), clock, strict=True))]


@real("fix height")
def gpx_of_strava(folder: Path) -> list[Path]:
    """Whole seconds, no speed, a pause of its own segment, a way point before."""
    each = points(SECONDS, times("%Y-%m-%dT%H:%M:%SZ"))
    return gpx(folder, "drive.gpx", [f"<trk><name>Morning Drive</name><type>1</type><trkseg>{''.join(each[:62])}</trkseg><trkseg>{''.join(each[68:])}</trkseg></trk>"], '<wpt lat="1" lon="2"><name>home</name></wpt>')


@real("fix height velocity")
def gpx_of_garmin(folder: Path) -> list[Path]:
    """Speeds and courses in extensions, times with an offset."""
    v, c = show(R.gps_speed_mps, 3), show(R.course_deg, 2)
    more = lambda k: f"<extensions><gpxtpx:TrackPointExtension><gpxtpx:atemp>21.0</gpxtpx:atemp><gpxtpx:speed>{v[k]}</gpxtpx:speed><gpxtpx:course>{c[k]}</gpxtpx:course></gpxtpx:TrackPointExtension></extensions>"  # noqa: E731
    return gpx(folder, "garmin.gpx", [f"<trk><trkseg>{''.join(points(SECONDS, times('%Y-%m-%dT%H:%M:%S.000+11:00', hours=11), more))}</trkseg></trk>"])


@real(asks="2 tracks")
def gpx_of_two_days(folder: Path) -> list[Path]:
    return gpx(folder, "two.gpx", [f"<trk><name>{name}</name><trkseg>{''.join(points(SECONDS, times('%Y-%m-%dT%H:%M:%SZ', hours=h)))}</trkseg></trk>" for name, h in (("Sat", 0), ("Sun", 24))])


@real("fix height")
def kml_track(folder: Path) -> list[Path]:
    """All times, then all places, as a phone's app writes them."""
    when = "".join(f"<when>{t}</when>" for t in times("%Y-%m-%dT%H:%M:%S.%fZ", ALL))
    where = "".join(f"<gx:coord>{o} {a} {h}</gx:coord>" for o, a, h in zip(lon(ALL), lat(ALL), show(R.height_m, 1, ALL), strict=True))
    (folder / "t.kml").write_text(f'<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document><name>x</name><Placemark><gx:Track><altitudeMode>absolute</altitudeMode>{when}{where}</gx:Track></Placemark></Document></kml>')
    return [folder / "t.kml"]


@real("fix")
def kml_tracks_in_pairs(folder: Path) -> list[Path]:
    """Times and places in turns, in two parts, without heights, with an offset from UTC."""
    each = [f"<when>{t}</when><gx:coord>{o} {a}</gx:coord>" for t, o, a in zip(times("%Y-%m-%dT%H:%M:%S+11:00", hours=11), lon(), lat(), strict=True)]
    (folder / "m.kml").write_text(f'<kml xmlns:gx="http://www.google.com/kml/ext/2.2"><Placemark><gx:MultiTrack><gx:Track>{"".join(each[:50])}</gx:Track><gx:Track>{"".join(each[50:])}</gx:Track></gx:MultiTrack></Placemark></kml>')
    return [folder / "m.kml"]


# ---- trajectories, phones, buses


@real("pose pose_heading", start=0)
def tum_of_a_slam(folder: Path) -> list[Path]:
    """Seconds from the start, in powers of ten, with a lost pose of nan."""
    rows = [f"{t:.9e} {x:.9e} {y:.9e} {0:.9e} {0:.9e} {0:.9e} {np.sin(h / 2):.9e} {np.cos(h / 2):.9e}" for t, x, y, h in zip(R.t_s, R.x_m, R.y_m, R.heading_rad, strict=True)]
    rows[40] = f"{R.t_s[40]:.9e}" + " nan" * 7
    return write(folder, "KeyFrameTrajectory.txt", rows)


@real("gyro accel")
def euroc_imu(folder: Path) -> list[Path]:
    ns = [str(START_NS + round(t * 1e9)) for t in R.t_s]
    head = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
    return write(folder, "data.csv", head, rows_of([ns, *[show(R.turn_radps[:, k], 9, ALL) for k in range(3)], *[show(R.force_mps2[:, k], 9, ALL) for k in range(3)]]))


@real("fix height velocity")
def phyphox_location(folder: Path) -> list[Path]:
    """phyphox' experiment of the receiver alone: one table and the times of its start."""
    head = '"Time (s)","Latitude (°)","Longitude (°)","Height (m)","Velocity (m/s)","Direction (°)","Horizontal Accuracy (m)","Vertical Accuracy (°)"'
    body = rows_of([[f"{t:.9E}" for t in R.t_s[SECONDS]], *[[f"{v:.9E}" for v in each[SECONDS]] for each in (R.lat_deg, R.lon_deg, R.height_m, R.gps_speed_mps, R.course_deg)], same("3.8"), same("2.1")])
    with zipfile.ZipFile(folder / "Location 2024-03-10.zip", "w") as archive:
        archive.writestr("Raw Data.csv", "\n".join([head, *body]))
        archive.writestr("meta/time.csv", f'"event","experiment time","system time","system time text"\n"START",0.000000000E0,{EPOCH_S}.000,"2024-03-10 10:59:20.000 UTC+11:00"\n"PAUSE",1.2E2,{EPOCH_S + 120}.000,"2024-03-10 11:01:20.000 UTC+11:00"\n')
        archive.writestr("meta/device.csv", '"property","value"\n"deviceModel","X"\n')
    return [folder / "Location 2024-03-10.zip"]


@real("fix height velocity gyro accel", accel=0.5)
def sensor_logger_zip(folder: Path) -> list[Path]:
    """Sensor Logger on a phone that lies with its top to the left, screen up; a sensor without rows beside."""

    def phone(v: np.ndarray) -> np.ndarray:
        return np.stack([v[:, 0], v[:, 1], v[:, 2]], axis=1)

    ns = [str(START_NS + round(t * 1e9)) for t in R.t_s]
    force, turn = phone(R.force_mps2), phone(R.turn_radps)
    tables = {
        "Location.csv": ("time,seconds_elapsed,bearingAccuracy,speedAccuracy,verticalAccuracy,horizontalAccuracy,speed,bearing,altitude,longitude,latitude", [ns[::10], show(R.t_s, 3), same("10"), same("0.3"), same("3"), same("4"), show(R.gps_speed_mps, 3), show(R.course_deg, 2), show(R.height_m, 2), lon(), lat()]),
        "TotalAcceleration.csv": ("time,seconds_elapsed,z,y,x", [ns, show(R.t_s, 3, ALL), *[show(force[:, k], 5, ALL) for k in (2, 1, 0)]]),
        "Gyroscope.csv": ("time,seconds_elapsed,z,y,x", [ns, show(R.t_s, 3, ALL), *[show(turn[:, k], 5, ALL) for k in (2, 1, 0)]]),
        "Annotation.csv": ("time,seconds_elapsed,text,millisecond_press_duration", []),
    }
    with zipfile.ZipFile(folder / "2024-03-10_10-59-20.zip", "w") as archive:
        for name, (head, columns) in tables.items():
            archive.writestr(name, "\n".join([head, *(rows_of(columns) if columns else [])]) + "\n")
        archive.writestr("Metadata.csv", "version,device name,recording time,platform\n3,Pixel,2024-03-10_10-59-20,android\n")
    return [folder / "2024-03-10_10-59-20.zip"]


DBC = """VERSION ""

BU_: ESP EPS

BO_ 253 ESP_21: 8 ESP
 SG_ ESP_21_CRC : 0|8@1+ (1,0) [0|255] "" EPS
 SG_ ESP_v_Signal : 32|16@1+ (0.01,0) [0|655.32] "Unit_KiloMeterPerHour" EPS

BO_ 257 ESP_02: 8 ESP
 SG_ ESP_Yaw_Rate : 0|16@1- (0.01,0) [-320|320] "deg/s" EPS
"""


def frames(folder: Path) -> list[tuple[float, int, bytes]]:
    (folder / "car.dbc").write_text(DBC)
    found = []
    for k in range(N):
        found.append((R.t_s[k], 253, bytes([k % 256, 0, 0, 0]) + struct.pack("<H", round(max(R.wheel_mps[k], 0.0) * 360)) + b"\0\0"))
        found.append((R.t_s[k] + 0.004, 257, struct.pack("<h", round(np.degrees(R.turn_radps[k, 2]) * 100)) + bytes(6)))
        found.append((R.t_s[k] + 0.006, 0x6F0, bytes(8)))
    return found


@real("speed gyro")
def candump_of_two_buses(folder: Path) -> list[Path]:
    rows = [f"({EPOCH_S + t:.6f}) {'can1' if i == 0x6F0 else 'can0'} {i:03X}#{data.hex().upper()}" for t, i, data in frames(folder)]
    return [*write(folder, "candump.log", rows), folder / "car.dbc"]


@real(asks="MDF")
def mdf4(folder: Path) -> list[Path]:
    (folder / "rec.mf4").write_bytes(b"MDF     4.10    TGT 15.0" + bytes(200))
    return [folder / "rec.mf4"]


@real(asks="gzip")
def csv_gz(folder: Path) -> list[Path]:
    path = write(folder, "d.csv", "time,lat,lon", rows_of([times("%Y-%m-%dT%H:%M:%SZ"), lat(), lon()]))[0]
    (folder / "d.csv.gz").write_bytes(gzip.compress(path.read_bytes()))
    return [folder / "d.csv.gz"]


@real(asks="JSON")
def geojson(folder: Path) -> list[Path]:
    (folder / "t.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": {"type": "Point", "coordinates": [151.1, -33.9]}, "properties": {"time": "x"}}]}))
    return [folder / "t.geojson"]


@real(asks="names|separated")
def ozi_plt(folder: Path) -> list[Path]:
    head = ["OziExplorer Track Point File Version 2.1", "WGS 84", "Altitude is in Feet", "Reserved 3", "0,2,255,drive,0,0,2,8421376", "120"]
    days = [f"{45360.999537037 + t / 86400:.9f}" for t in R.t_s[SECONDS]]
    return write(folder, "d.plt", head, rows_of([lat(), lon(), same("0"), show(R.height_m / 0.3048, 1), days, times("%d-%b-%y"), times("%I:%M:%S %p")]))


@real(asks=".")
def page_of_a_login(folder: Path) -> list[Path]:
    """What a download without a password gives."""
    return write(folder, "export.csv", "<!DOCTYPE html>", "<html><head><title>Sign in</title></head>", "<body><form action='/login'>", "<input name='user'></form>", "</body></html>")


@real("fix velocity")
def parquet_of_a_fleet(folder: Path) -> list[Path]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    stamp = pa.array((START_NS // 1000 + np.rint(R.t_s * 1e6)).astype(np.int64), pa.timestamp("us", tz="Australia/Sydney"))
    nothing = pa.array([None] * N, pa.float64())
    pq.write_table(pa.table({"event_time": stamp, "gps_latitude": R.lat_deg, "gps_longitude": R.lon_deg, "gps_speed_kph": (R.gps_speed_mps * 3.6).astype(np.float32), "gps_bearing_deg": R.course_deg.astype(np.float32), "fuel": nothing, "driver": pa.array(["x"] * N).dictionary_encode()}), folder / "part-0.parquet")
    return [folder / "part-0.parquet"]


@real("/v2x/bsm fix heading speed", start=0, by_topic={"/v2x/bsm": 1200.0})
def sumo_fcd_of_a_geo_net(folder: Path) -> list[Path]:
    """FCD with longitudes and latitudes, persons, and an `ego` by name."""
    rows = ["<fcd-export>"]
    for k in range(N):
        rows.append(
            f'<timestep time="{R.t_s[k]:.2f}"><vehicle id="ego" x="{R.lon_deg[k]:.7f}" y="{R.lat_deg[k]:.7f}" angle="{(90 - np.degrees(R.heading_rad[k])) % 360:.2f}" type="car" speed="{R.speed_mps[k]:.2f}" pos="0" lane="a_0" slope="0"/><vehicle id="b" x="151.2" y="-33.9" angle="0.00" type="car" speed="0.00" pos="0" lane="a_0" slope="0"/><person id="p" x="151.1" y="-33.9" angle="0" speed="1" pos="0" edge="a"/></timestep>'
        )
    return write(folder, "fcd.xml", rows, "</fcd-export>")
