"""Tables as loggers, fleet services, test benches and spreadsheets write them, of the drive of `real_drive`."""

# fmt: off
from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.unit.importing.real_drive import ALL, GPS_TOW_S, GPS_WEEK, SECONDS, START_NS, N, R, show, times

Columns = Sequence[Sequence[str]]
EPOCH_S = START_NS // 10**9


@dataclass(frozen=True)
class RealCase:
    """A file, and what the import may make of it.

    Attributes:
        make: Folder -> files.
        holds: Quantities that the log holds, whose errors are bounded by `BOUNDS`.
        asks: Words of the refusal, "" where the file needs no answer.
        start: Stamp of the drive's first moment, ns.
        bounds: Bounds of this case beyond the usual ones.
    """

    make: Callable[[Path], list[Path]]
    holds: str = ""
    asks: str = ""
    start: int = START_NS
    bounds: dict[str, float] = field(default_factory=dict)


BOUNDS = {
    "fix": 1.6, "height": 2.8, "velocity": 0.25, "speed": 0.25, "rate": 0.012, "heading": 0.06,
    "gyro": 0.012, "accel": 0.3, "pose": 1.6, "pose_heading": 0.06,
}  # fmt: skip
"""Greatest 95th percentile of the error: m, m, m/s, m/s, rad/s, rad, rad/s, m/s^2, m, rad."""

REAL_TABLES: dict[str, RealCase] = {}


def real(holds: str = "", asks: str = "", start: int = START_NS, **bounds: float) -> Callable[[Callable[[Path], list[Path]]], Callable[[Path], list[Path]]]:
    """Register the maker of a case under its name."""

    def keep(make: Callable[[Path], list[Path]]) -> Callable[[Path], list[Path]]:
        REAL_TABLES[make.__name__] = RealCase(make, holds, asks, start, bounds)
        return make

    return keep


def rows_of(columns: Columns, mark: str = ",", decimal: str = ".") -> list[str]:
    """Join columns to lines; `decimal` replaces the points of cells that are numbers."""

    def cell(text: str) -> str:
        if decimal != "." and text.replace(".", "", 1).lstrip("+-").isdigit():
            return text.replace(".", decimal)
        return text

    return [mark.join(cell(each) for each in row) for row in zip(*columns, strict=True)]


def write(folder: Path, name: str, *lines: str | list[str], end: str = "\n", encoding: str = "utf-8") -> list[Path]:
    texts = [line for each in lines for line in ([each] if isinstance(each, str) else each)]
    (folder / name).write_bytes((end.join(texts) + end).encode(encoding))
    return [folder / name]


def quoted(columns: Columns) -> list[str]:
    """Return lines whose cells are all in quotes."""
    text = io.StringIO()
    csv.writer(text, quoting=csv.QUOTE_ALL, lineterminator="\n").writerows(zip(*columns, strict=True))
    return text.getvalue().splitlines()


def minutes(values: np.ndarray, width: int, letters: str, n: int = 4) -> tuple[list[str], list[str]]:
    """Return ddmm.mmmm and hemispheres."""
    texts, marks = [], []
    for value in values.tolist():
        whole, rest = divmod(round(abs(value) * 60, n), 60)
        texts.append(f"{int(whole):0{width}d}{rest:0{n + 3}.{n}f}")
        marks.append(letters[0] if value >= 0 else letters[1])
    return texts, marks


def lat(rows: slice = SECONDS, n: int = 7) -> list[str]:
    return show(R.lat_deg, n, rows)


def lon(rows: slice = SECONDS, n: int = 7) -> list[str]:
    return show(R.lon_deg, n, rows)


def same(value: str, rows: slice = SECONDS) -> list[str]:
    return [value] * len(R.t_s[rows])


def number(rows: slice = SECONDS, first: int = 1) -> list[str]:
    return [str(first + k) for k in range(len(R.t_s[rows]))]


HEIGHT, SPEED, COURSE = show(R.height_m, 1), R.gps_speed_mps, show(R.course_deg, 1)
KMH = show(SPEED * 3.6, 1)


# ---- loggers of positions


@real("fix height")
def gpsd_csv(folder: Path) -> list[Path]:
    return write(folder, "tpv.csv", "time,lat,lon,altHAE", rows_of([times("%Y-%m-%dT%H:%M:%S.000Z"), lat(), lon(), HEIGHT]))


@real(asks="zone")
def pyubx2_csv(folder: Path) -> list[Path]:
    """NAV-PVT as ubx2csv writes it: heights and speeds in millimeters, the clock in six columns."""
    clock = [[str(int(text)) for text in times(each)] for each in ("%Y", "%m", "%d", "%H", "%M", "%S")]
    tow = [str(round((GPS_TOW_S + t) % 604800 * 1000)) for t in R.t_s[SECONDS]]
    head = "iTOW,year,month,day,hour,min,second,validDate,tAcc,nano,fixType,numSV,lon,lat,height,hMSL,hAcc,vAcc,velN,velE,velD,gSpeed,headMot,sAcc,headAcc,pDOP"
    mm = [show(each * 1000, 0) for each in (R.height_m + 22, R.height_m)]
    v = [show(each * 1000, 0) for each in (R.north_mps, R.east_mps, R.z_m * 0, SPEED)]
    return write(folder, "nav_pvt.csv", head, rows_of([tow, *clock, same("1"), same("22"), same("-12034"), same("3"), same("17"), lon(), lat(), *mm, same("812"), same("1204"), *v, show(R.course_deg, 5), same("120"), same("1.2"), same("1.31")]))


@real("fix height", asks="")
def rtklib_gpst(folder: Path) -> list[Path]:
    """Positions of RTKLIB in GPS time, as week and seconds."""
    tow = GPS_TOW_S + R.t_s[SECONDS]
    head = [
        "% program   : RTKPOST ver.2.4.3 b34", "% inp file  : rover.obs", "% pos mode  : kinematic", "%",
        "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)",
        "%  GPST             latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio",
    ]  # fmt: skip
    body = [f"{GPS_WEEK + int(t // 604800)} {t % 604800:10.3f}  {a:13.9f} {o:14.9f} {float(h):10.4f}   1  14   0.0100   0.0100   0.0200   0.0010  -0.0010   0.0010   0.00    9.9" for t, a, o, h in zip(tow, R.lat_deg[SECONDS], R.lon_deg[SECONDS], HEIGHT, strict=True)]
    return write(folder, "rover.pos", head, body)


@real("fix height velocity")
def rtklib_velocity(folder: Path) -> list[Path]:
    """RTKLIB's output of velocities in UTC, with its statistics."""
    head = [
        "% program   : demo5 b34k", "% ref pos   :-33.900000000  151.100000000    80.0000", "%",
        "%  UTC                   latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio    vn(m/s)    ve(m/s)    vu(m/s)      sdvn     sdve     sdvu    sdvne    sdveu    sdvun",
    ]  # fmt: skip
    body = [
        f"{c}  {a:13.9f} {o:14.9f} {h:10.4f}   2  14   0.0100   0.0100   0.0200   0.0010  -0.0010   0.0010   0.00    1.9 {vn:10.5f} {ve:10.5f} {0:10.5f}  0.01 0.01 0.01 0.01 0.01 0.01"
        for c, a, o, h, vn, ve in zip(times("%Y/%m/%d %H:%M:%S.%f", ALL, cut=3), R.lat_deg, R.lon_deg, R.height_m, R.north_mps, R.east_mps, strict=True)
    ]
    return write(folder, "solution.pos", head, body)


@real(asks="ECEF|ecef|geocentric")
def rtklib_ecef(folder: Path) -> list[Path]:
    a, f = 6378137.0, 1 / 298.257223563
    e2 = f * (2 - f)
    la, lo = np.radians(R.lat_deg), np.radians(R.lon_deg)
    n = a / np.sqrt(1 - e2 * np.sin(la) ** 2)
    xyz = ((n + R.height_m) * np.cos(la) * np.cos(lo), (n + R.height_m) * np.cos(la) * np.sin(lo), (n * (1 - e2) + R.height_m) * np.sin(la))
    head = "%  GPST                      x-ecef(m)      y-ecef(m)      z-ecef(m)   Q  ns   sdx(m)   sdy(m)   sdz(m)  sdxy(m)  sdyz(m)  sdzx(m) age(s)  ratio"
    more = [same(each) for each in ("1", "12", "0.01", "0.01", "0.01", "0.00", "0.00", "0.00", "0.00", "9.9")]
    return write(folder, "ecef.pos", "% program   : RTKLIB", head, rows_of([times("%Y/%m/%d %H:%M:%S.%f", cut=3, hours=18 / 3600), *[show(each, 4) for each in xyz], *more], "  "))


@real(asks="names")
def emlid_llh(folder: Path) -> list[Path]:
    """Emlid's LLH log is RTKLIB's without any line of names."""
    more = [same(each) for each in ("1", "14", "0.01", "0.01", "0.02", "0.00", "0.00", "0.00", "0.00", "9.9")]
    return write(folder, "reach.LLH", rows_of([times("%Y/%m/%d %H:%M:%S.%f", cut=3, hours=18 / 3600), lat(n=9), lon(n=9), HEIGHT, *more], "   "))


@real("fix height velocity heading", start=round(GPS_TOW_S * 1e9))
def pospac_export(folder: Path) -> list[Path]:
    """POSPac's ASCII export: seconds of the GPS week alone, and a line of units in brackets."""
    head = ["Input SBET file: sbet_1.out", "Datum: WGS84", "", "      TIME,      LATITUDE,     LONGITUDE, ELLIPSOID HEIGHT,  ROLL,  PITCH,  HEADING, EAST VELOCITY, NORTH VELOCITY, UP VELOCITY", "(time in Sec, lat, long in Deg, height in Meter, rpy in Deg, velocity in Meter/Sec)"]
    return write(folder, "export.txt", head, rows_of([show(GPS_TOW_S + R.t_s, 3, ALL), lat(ALL, 9), lon(ALL, 9), show(R.height_m, 3, ALL), same("0.1", ALL), same("0.2", ALL), show(np.mod(90 - np.degrees(R.heading_rad), 360), 4, ALL), show(R.east_mps, 3, ALL), show(R.north_mps, 3, ALL), same("0.0", ALL)]))


@real(asks="zone")
def columbus(folder: Path) -> list[Path]:
    """Columbus V-900: 240309 and 235920, latitudes with a letter behind."""
    a = [f"{-value:.6f}S" for value in R.lat_deg[SECONDS]]
    o = [f"{value:.6f}E" for value in R.lon_deg[SECONDS]]
    return write(folder, "24030923.CSV", "INDEX,TAG,DATE,TIME,LATITUDE N/S,LONGITUDE E/W,HEIGHT,SPEED,HEADING,VOX", rows_of([number(), same("T"), times("%y%m%d"), times("%H%M%S"), a, o, show(R.height_m, 0), show(SPEED * 3.6, 0), show(R.course_deg, 0), same("         ")]), end="\r\n")


@real(asks="zone")
def bt747(folder: Path) -> list[Path]:
    """Qstarz and BT747: unsigned degrees, hemispheres beside them, a comma at the end of every line."""
    head = "INDEX,RCR,DATE,TIME,VALID,LATITUDE,N/S,LONGITUDE,E/W,HEIGHT(m),SPEED(km/h),HEADING,DSTA,DAGE,PDOP,HDOP,VDOP,NSAT(USED/VIEW),DISTANCE(m),"
    return write(
        folder,
        "qstarz.csv",
        head,
        rows_of([number(), same("T"), times("%Y/%m/%d"), times("%H:%M:%S.000"), same("SPS"), show(-R.lat_deg, 6), same("S"), lon(n=6), same("E"), show(R.height_m, 3), show(SPEED * 3.6, 3), show(R.course_deg, 6), same(""), same(""), same("1.63"), same("0.92"), same("1.34"), same("9(14)"), same("1.2"), same("")]),
    )


@real(asks="zone")
def gpsbabel_unicsv(folder: Path) -> list[Path]:
    return write(folder, "unicsv.csv", "No,Latitude,Longitude,Altitude,Speed,Course,Date,Time", rows_of([number(), lat(n=6), lon(n=6), HEIGHT, show(SPEED, 2), COURSE, times("%Y/%m/%d"), times("%H:%M:%S")]))


@real("fix height velocity")
def gps_visualizer(folder: Path) -> list[Path]:
    return write(folder, "gpsv.txt", "type\ttime\tlatitude\tlongitude\talt\tspeed (mph)\tcourse\tname\tdesc", rows_of([same("T"), times("%Y-%m-%d %H:%M:%SZ"), lat(n=6), lon(n=6), HEIGHT, show(SPEED * 2.2369363, 2), COURSE, ["Track 1", *same("")[1:]], same("")], "\t"))


@real(asks="order of day")
def basecamp(folder: Path) -> list[Path]:
    """Garmin's text export: degrees with minutes behind a letter, US dates in local time."""

    def angle(value: float, letters: str) -> str:
        whole, rest = divmod(abs(value) * 60, 60)
        return f"{letters[0] if value >= 0 else letters[1]}{int(whole)} {rest:.3f}"

    where = [f"{angle(a, 'NS')} {angle(o, 'EW')}" for a, o in zip(R.lat_deg[SECONDS], R.lon_deg[SECONDS], strict=True)]
    return write(folder, "track.txt", "Header\tPosition\tTime\tAltitude\tLeg Length\tLeg Speed\tLeg Course", rows_of([same("Trackpoint"), where, times("%m/%d/%Y %I:%M:%S %p", hours=11), [f"{h} m" for h in HEIGHT], same("14 m"), [f"{v} kph" for v in KMH], [f"{c}° true" for c in COURSE]], "\t"))


@real("fix height velocity")
def traccar(folder: Path) -> list[Path]:
    return write(
        folder,
        "report.csv",
        "Device,Valid,Fix Time,Latitude,Longitude,Altitude,Speed (kn),Course,Address,Attributes",
        rows_of([same("Van 12"), same("true"), times("%Y-%m-%dT%H:%M:%S.000+00:00"), lat(n=6), lon(n=6), HEIGHT, show(SPEED / 0.514444, 2), COURSE, same('"Sydney Rd, Sydney"'), same('"{""sat"":12,""ignition"":true}"')]),
    )


@real("fix height velocity")
def ais_like(folder: Path) -> list[Path]:
    """Names of ships' data: SOG in knots, COG, and a heading of 511 that means none."""
    return write(folder, "sog.csv", "BaseDateTime,LAT,LON,SOG,COG,Heading,Alt", rows_of([times("%Y-%m-%dT%H:%M:%SZ"), lat(), lon(), show(SPEED / 0.514444, 1), COURSE, same("511.0"), HEIGHT]))


@real("fix")
def qgis_wkt(folder: Path) -> list[Path]:
    points = [f"POINT ({o} {a})" for a, o in zip(lat(), lon(), strict=True)]
    return write(folder, "layer.csv", "WKT,fid,time", rows_of([points, number(), times("%Y/%m/%d %H:%M:%S+00")]))


@real("fix height")
def google_e7(folder: Path) -> list[Path]:
    """Records of a phone's place history: integers of 1e-7 degrees, milliseconds as text."""
    ms = [f'"{EPOCH_S * 1000 + round(t * 1000)}"' for t in R.t_s[SECONDS]]
    return write(folder, "records.csv", "timestampMs,latitudeE7,longitudeE7,accuracy,altitude,source", rows_of([ms, show(R.lat_deg * 1e7, 0), show(R.lon_deg * 1e7, 0), same("5"), show(R.height_m, 0), same("GPS")]))


@real("fix height velocity")
def gopro(folder: Path) -> list[Path]:
    cts = show(R.t_s * 1000 + 132.7, 3, ALL)
    return write(
        folder,
        "GX010042_GPS5.csv",
        '"cts","date","GPS (Lat.) [deg]","GPS (Long.) [deg]","GPS (Alt.) [m]","GPS (2D speed) [m/s]","GPS (3D speed) [m/s]","fix","precision","altitude system","cog"',
        rows_of([cts, times("%Y-%m-%dT%H:%M:%S.%fZ", ALL), lat(ALL), lon(ALL), show(R.height_m, 2, ALL), show(SPEED, 3, ALL), show(SPEED, 2, ALL), same("3", ALL), same("162", ALL), same("MSLV", ALL), show(R.course_deg, 1, ALL)]),
    )


@real("fix height speed")
def gopro_own(folder: Path) -> list[Path]:
    """The same as the tool writes it: no course."""
    return write(
        folder,
        "GX010043_GPS5.csv",
        '"cts","date","GPS (Lat.) [deg]","GPS (Long.) [deg]","GPS (Alt.) [m]","GPS (2D speed) [m/s]","GPS (3D speed) [m/s]","fix","precision"',
        rows_of([show(R.t_s * 1000 + 132.7, 3, ALL), times("%Y-%m-%dT%H:%M:%S.%fZ", ALL), lat(ALL), lon(ALL), show(R.height_m, 2, ALL), show(SPEED, 3, ALL), show(SPEED, 2, ALL), same("3", ALL), same("162", ALL)]),
    )


@real("fix height speed")
def exiftool_csv(folder: Path) -> list[Path]:
    """What a dash camera's film holds: sexagesimal degrees with a hemisphere, dates with colons."""

    def angle(value: float, letters: str) -> str:
        whole, rest = divmod(abs(value) * 3600, 3600)
        low, seconds = divmod(rest, 60)
        return f'"{int(whole)} deg {int(low)}\' {seconds:.3f}"" {letters[0] if value >= 0 else letters[1]}"'

    return write(
        folder,
        "exif.csv",
        "SourceFile,GPSDateTime,GPSLatitude,GPSLongitude,GPSAltitude,GPSSpeed,GPSSpeedRef,GPSTrack",
        rows_of([same("a.mp4"), times("%Y:%m:%d %H:%M:%SZ"), [angle(v, "NS") for v in R.lat_deg[SECONDS]], [angle(v, "EW") for v in R.lon_deg[SECONDS]], [f"{h} m" for h in HEIGHT], KMH, same("km/h"), COURSE]),
    )


@real("fix height velocity gyro accel")
def sensorlog_long(folder: Path) -> list[Path]:
    """SensorLog of iOS: accelerations in g in a phone that lies flat, its top ahead; gravity and turn rates apart."""
    clock = times("%Y-%m-%d %H:%M:%S.%f +1100", ALL, hours=11)
    epoch = show(EPOCH_S + R.t_s, 3, ALL)
    # A phone's x is right, y is ahead, z is up; its accelerations have the sign of gravity pulling down (-1 g at rest).
    force, turn = R.force_mps2 / 9.80665, R.turn_radps
    raw = np.stack([force[:, 1], -force[:, 0], -force[:, 2]], axis=1) * np.array([1, 1, 1])
    gyro = np.stack([-turn[:, 1], turn[:, 0], turn[:, 2]], axis=1)
    hold = np.repeat(np.arange(0, N, 10), 10)
    gps = [[f"{each[k]:.{n}f}" for k in hold] for each, n in ((R.lat_deg, 7), (R.lon_deg, 7), (R.height_m, 2), (SPEED, 2), (R.course_deg, 2))]
    stamp = [f"{EPOCH_S + R.t_s[k]:.3f}" for k in hold]
    head = "loggingTime(txt),loggingSample(N),locationTimestamp_since1970(s),locationLatitude(WGS84),locationLongitude(WGS84),locationAltitude(m),locationSpeed(m/s),locationCourse(°),locationVerticalAccuracy(m),accelerometerTimestamp_sinceReboot(s),accelerometerAccelerationX(G),accelerometerAccelerationY(G),accelerometerAccelerationZ(G),gyroTimestamp_sinceReboot(s),gyroRotationX(rad/s),gyroRotationY(rad/s),gyroRotationZ(rad/s),label(N)"
    boot = show(R.t_s + 81234.567, 3, ALL)
    del epoch
    return write(folder, "2024-03-10.csv", head, rows_of([clock, number(ALL), stamp, *gps, same("3", ALL), boot, *[show(raw[:, k], 5, ALL) for k in range(3)], boot, *[show(gyro[:, k], 5, ALL) for k in range(3)], same("0", ALL)]))


# ---- races


@real("fix height velocity")
def laptimer(folder: Path) -> list[Path]:
    """Harry's LapTimer: two speeds and two heights, dates of the day's own order in UTC."""
    head = "INDEX,LAPINDEX,DATE,TIME,TIME_LAP,LATITUDE,LONGITUDE,SPEED_KPH,SPEED_MPH,HEIGHT_M,HEIGHT_FT,GPSDIFFERENTIAL[0:UNKNOWN/1:2D3D/2:DGPS/3:INVALID],GPSFIX[0:NOFIX/1:2D/2:3D/3:UNKNOWN],SATELLITES,HDOP,ACCURACY_M,DISTANCE_KM,DISTANCE_MILE,ACCELERATIONSOURCE[0:CALCULATED/1:MEASURED/2:UNDEFINED],LATERALG,LINEALG,LEAN,HEADING"
    g = [show(each / 9.81, 2, ALL) for each in (R.force_mps2[:, 1], R.force_mps2[:, 0])]
    return write(
        folder,
        "laps.csv",
        head,
        rows_of(
            [
                number(ALL),
                same("1", ALL),
                times("%Y-%m-%d", ALL),
                times("%H:%M:%S.%fZ", ALL),
                show(R.t_s, 2, ALL),
                lat(ALL),
                lon(ALL),
                show(SPEED * 3.6, 1, ALL),
                show(SPEED * 2.23694, 1, ALL),
                show(R.height_m, 1, ALL),
                show(R.height_m / 0.3048, 1, ALL),
                same("1", ALL),
                same("2", ALL),
                same("12", ALL),
                same("0.8", ALL),
                same("3.0", ALL),
                show(R.t_s * 0.01, 3, ALL),
                show(R.t_s * 0.006, 3, ALL),
                same("0", ALL),
                *g,
                same("0.0", ALL),
                show(R.course_deg, 1, ALL),
            ]
        ),
    )


@real("fix velocity height", start=0)
def motec(folder: Path) -> list[Path]:
    """MoTeC i2: a dozen lines of what the log is, a line of units, all quoted; dated in the lines above."""
    top = [
        '"Format","MoTeC CSV File",,,"Workbook",""',
        '"Venue","Eastern Creek",,,"Worksheet",""',
        '"Vehicle","GT3",,,"Vehicle Desc",""',
        '"Log Date","10/03/2024",,,"Origin Time","0","s"',
        '"Log Time","10:59:20",,,"Start Time","0","s"',
        '"Sample Rate","10.000","Hz",,"End Time","119.9","s"',
        '"Duration","119.9","s",,"Start Distance","0","m"',
        "",
        "",
    ]
    head = ['"Time","GPS Latitude","GPS Longitude","GPS Altitude","GPS Speed","GPS Heading","G Force Long","G Force Lat"', '"s","deg","deg","m","km/h","deg","G","G"', ""]
    return write(folder, "motec.csv", top, head, quoted([show(R.t_s, 3, ALL), lat(ALL), lon(ALL), show(R.height_m, 1, ALL), show(SPEED * 3.6, 2, ALL), show(R.course_deg, 1, ALL), show(R.force_mps2[:, 0] / 9.80665, 3, ALL), show(R.force_mps2[:, 1] / 9.80665, 3, ALL)]))


@real("fix height velocity")
def racechrono_vbo(folder: Path) -> list[Path]:
    """A VBOX file: minutes, west positive, times of day without colons, the date in its first line."""
    top = ["File created on 09/03/2024 at 23:59:20", "", "[header]", "satellites", "time", "latitude", "longitude", "velocity kmh", "heading", "height", "", "[comments]", "Log rate 10 Hz", "", "[column names]", "sats time lat long velocity heading height", "", "[data]"]
    return write(folder, "session.vbo", top, rows_of([same("011", ALL), times("%H%M%S.%f", ALL, cut=4), show(R.lat_deg * 60, 5, ALL), show(-R.lon_deg * 60, 5, ALL), show(SPEED * 3.6, 3, ALL), show(R.course_deg, 2, ALL), show(R.height_m, 2, ALL)], " "), end="\r\n")


@real("fix height velocity")
def racerender(folder: Path) -> list[Path]:
    """Comment lines above, unit words in brackets, UTC in seconds, miles and feet."""
    top = ["# RaceRender Data: Track logger", "# Vehicle: none", "# Start: somewhere"]
    return write(
        folder,
        "rr.csv",
        top,
        '"Time","UTC Time","Lap","GPS_Update","Latitude","Longitude","Altitude (ft)","Speed (MPH)","Heading","Accuracy (ft)"',
        rows_of([show(R.t_s, 3, ALL), show(EPOCH_S + R.t_s, 3, ALL), same("0", ALL), same("1", ALL), lat(ALL), lon(ALL), show(R.height_m / 0.3048, 1, ALL), show(SPEED * 2.2369363, 2, ALL), show(R.course_deg, 1, ALL), same("16.4", ALL)]),
    )


# ---- the diagnostic plug


@real(asks="zone|day|month|order")
def torque_mph(folder: Path) -> list[Path]:
    """Torque with miles, dashes where nothing came, and its header once more where the log went on."""
    head = "GPS Time, Device Time, Longitude, Latitude,GPS Speed (Meters/second), Horizontal Dilution of Precision, Altitude, Bearing, G(x), G(y), G(z), G(calibrated),Speed (OBD)(mph),Engine RPM(rpm)"
    device = times("%d-%b-%Y %H:%M:%S.000", hours=11)
    gps = times("Sun Mar %d %H:%M:%S AEDT 2024", hours=11)
    body = rows_of([gps, device, lon(), lat(), show(SPEED, 2), same("3.2"), HEIGHT, COURSE, same("0.1"), same("9.8"), same("0.3"), same("0.0"), [("-" if k % 3 else v) for k, v in enumerate(show(R.wheel_mps * 2.2369363, 1))], same("-")])
    return write(folder, "trackLog.csv", head, body[:50], head, body[50:])


@real("fix velocity height", start=0)
def obd_fusion(folder: Path) -> list[Path]:
    """OBD Fusion: the start in a comment in local time, rows that count from it."""
    head = ["# StartTime = 03/10/2024 10:59:20.0000 AM", "Time (sec), Latitude (deg), Longitude (deg), Altitude (ft), Vehicle speed (MPH), GPS speed (MPH), Bearing (deg), Accel X (ft/s²)"]
    return write(folder, "CSVLog_20240310_105920.csv", head, rows_of([show(R.t_s, 3), lat(), lon(), show(R.height_m / 0.3048, 1), show(R.wheel_mps * 2.2369363, 1), show(SPEED * 2.2369363, 2), COURSE, same("0.1")], ", "))


@real(asks="no column is a position")
def car_scanner_long(folder: Path) -> list[Path]:
    """Seconds, name, value and unit: a row for each reading."""
    rows = []
    for k in range(0, N, 10):
        t = f"{86400 - 40 + R.t_s[k]:.3f}"
        for name, value, unit in (("Vehicle speed", R.wheel_mps[k] * 3.6, "km/h"), ("GPS Latitude", R.lat_deg[k], "°"), ("GPS Longitude", R.lon_deg[k], "°")):
            rows.append(f'"{t}";"{name}";"{value:.7f}";"{unit}"')
    return write(folder, "scan.csv", '"SECONDS";"PID";"VALUE";"UNITS"', rows)


@real("fix speed rate", fix=2.4)
def canoe_csv(folder: Path) -> list[Path]:
    """Signals of a bus, each in the rows when its message came; empty elsewhere."""
    n = 4 * N
    cells = [[""] * n for _ in range(6)]
    t = np.repeat(R.t_s, 4) + np.tile([0.0, 0.01, 0.02, 0.03], N)
    for k in range(N):
        cells[0][4 * k] = f"{R.wheel_mps[k] * 3.6:.2f}"
        cells[1][4 * k + 1] = f"{np.degrees(R.turn_radps[k, 2]):.3f}"
        cells[2][4 * k + 2] = f"{R.force_mps2[k, 0]:.3f}"
        if k % 10 == 0:
            cells[3][4 * k + 3], cells[4][4 * k + 3] = f"{R.lat_deg[k]:.7f}", f"{R.lon_deg[k]:.7f}"
        cells[5][4 * k] = f"{R.wheel_mps[k] * 300:.0f}"
    head = "Timestamp;ESP_21::ESP_v_Signal [km/h];ESP_02::ESP_Gierrate [deg/s];ESP_02::ESP_Laengsbeschl [m/s²];NP_01::NP_LatDegree [°];NP_01::NP_LongDegree [°];MO_01::Engine_RPM [1/min]"
    return write(folder, "trace.csv", head, rows_of([[f"{EPOCH_S + each:.4f}" for each in t], *cells], ";"))


@real("speed rate")
def wheel_speeds(folder: Path) -> list[Path]:
    """Four wheel speeds, the vehicle's speed and its yaw rate; no position at all."""
    w = [show((R.wheel_mps + side * 0.75 * R.rate_radps) * 3.6, 2, ALL) for side in (-1, 1, -1, 1)]
    return write(
        folder,
        "esc.csv",
        "t_utc_us,WheelSpeedFL [km/h],WheelSpeedFR [km/h],WheelSpeedRL [km/h],WheelSpeedRR [km/h],VehicleSpeed [km/h],YawRate [deg/s],SteeringWheelAngle [deg]",
        rows_of([[str(EPOCH_S * 10**6 + round(t * 1e6)) for t in R.t_s], *w, show(R.wheel_mps * 3.6, 2, ALL), show(np.degrees(R.turn_radps[:, 2]), 3, ALL), show(R.rate_radps * 500, 1, ALL)]),
    )


@real(asks="no column is a position")
def savvycan(folder: Path) -> list[Path]:
    """Frames without a meaning."""
    rows = [f"{EPOCH_S * 10**6 + k * 1000},00000123,false,Rx,0,8,{k % 256:02X},00,00,00,00,00,00,00," for k in range(300)]
    return write(folder, "frames.csv", "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8", rows)


# ---- instruments and simulators


@real("fix height velocity")
def septentrio(folder: Path) -> list[Path]:
    """PVTGeodetic in radians, with milliseconds of the week and the week."""
    tow = GPS_TOW_S + R.t_s[SECONDS]
    head = "TOW [0.001 s],WNc [w],Mode,Error,Latitude [rad],Longitude [rad],Height [m],Undulation [m],Vn [m/s],Ve [m/s],Vu [m/s],COG [°]"
    return write(
        folder, "pvt.csv", head, rows_of([[str(round(t % 604800 * 1000)) for t in tow], [str(GPS_WEEK + int(t // 604800)) for t in tow], same("4"), same("0"), show(np.radians(R.lat_deg), 12), show(np.radians(R.lon_deg), 12), HEIGHT, same("22.1"), show(R.north_mps, 4), show(R.east_mps, 4), same("0.0"), COURSE])
    )


@real("fix height velocity heading")
def oxts_down(folder: Path) -> list[Path]:
    """Axes of an OxTS unit: z points down, so the yaw rate is positive to the right."""
    head = "Date,Time (UTC),Latitude (deg),Longitude (deg),Altitude (m),Speed horizontal (m/s),Track (deg),Heading (deg),Acceleration Xv (m/s²),Acceleration Yv (m/s²),Angular rate Zv (deg/s)"
    return write(
        folder,
        "rt3000.csv",
        head,
        rows_of(
            [
                times("%d-%b-%Y", ALL),
                times("%H:%M:%S.%f", ALL, cut=3),
                lat(ALL, 9),
                lon(ALL, 9),
                show(R.height_m, 3, ALL),
                show(SPEED, 3, ALL),
                show(R.course_deg, 3, ALL),
                show(np.mod(90 - np.degrees(R.heading_rad), 360), 3, ALL),
                show(R.force_mps2[:, 0], 3, ALL),
                show(-R.force_mps2[:, 1], 3, ALL),
                show(-np.degrees(R.turn_radps[:, 2]), 4, ALL),
            ]
        ),
    )


@real("fix velocity")
def px4(folder: Path) -> list[Path]:
    """ulog2csv of vehicle_gps_position: integers, radians, velocities, microseconds since boot and since 1970."""
    head = "timestamp,time_utc_usec,lat,lon,alt,alt_ellipsoid,s_variance_m_s,c_variance_rad,eph,epv,hdop,vdop,noise_per_ms,vel_m_s,vel_n_m_s,vel_e_m_s,vel_d_m_s,cog_rad,timestamp_time_relative,heading,fix_type,satellites_used"
    cog = show(np.angle(np.exp(1j * np.radians(R.course_deg))), 4)
    e = EPOCH_S * 10**6
    return write(
        folder,
        "log_vehicle_gps_position_0.csv",
        head,
        rows_of(
            [
                show(R.t_s * 1e6 + 143_002_812, 0),
                [str(e + round(t * 1e6)) for t in R.t_s[SECONDS]],
                show(R.lat_deg * 1e7, 0),
                show(R.lon_deg * 1e7, 0),
                show(R.height_m * 1000, 0),
                show(R.height_m * 1000 + 22000, 0),
                same("0.2"),
                same("0.1"),
                same("0.8"),
                same("1.1"),
                same("0.7"),
                same("1.0"),
                same("90"),
                show(SPEED, 3),
                show(R.north_mps, 3),
                show(R.east_mps, 3),
                same("0.0"),
                cog,
                same("0"),
                same("nan"),
                same("3"),
                same("17"),
            ]
        ),
    )


@real(asks="(?i)id|vehicle")
def ngsim(folder: Path) -> list[Path]:
    """Many vehicles in one table, in feet."""
    rows = [f"{v},{k},{N},{EPOCH_S * 1000 + k * 100},{5 + 10 * v}.0,{(R.t_s[k] * 40 + v * 60):.3f},{40 + v}.00,{R.accel_mps2[k] / 0.3048:.2f}" for v in range(3) for k in range(300)]
    return write(folder, "ngsim.csv", "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,v_Vel,v_Acc", rows)


@real(asks="(?i)id|vehicle")
def two_vans(folder: Path) -> list[Path]:
    """Two vehicles whose rows alternate."""
    a = rows_of([times("%Y-%m-%dT%H:%M:%SZ"), same("van-1"), lat(), lon(), KMH])
    b = rows_of([times("%Y-%m-%dT%H:%M:%SZ"), same("van-2"), show(R.lat_deg + 0.05, 7), lon(), KMH])
    return write(folder, "fleet.csv", "timestamp,vehicle,lat,lon,speed_kmh", [line for pair in zip(a, b, strict=True) for line in pair])


@real("fix speed")
def influx(folder: Path) -> list[Path]:
    """Annotated CSV of a time series database, pivoted."""
    top = ["#group,false,false,true,false,false,false,false", "#datatype,string,long,string,dateTime:RFC3339,double,double,double,double", "#default,_result,,,,,,,"]
    return write(folder, "query.csv", top, ",result,table,vehicle,_time,lat,lon,speed,track", rows_of([same(""), same(""), same("0"), same("car7"), times("%Y-%m-%dT%H:%M:%SZ"), lat(), lon(), show(SPEED, 3), COURSE]), end="\r\n")


@real("fix velocity")
def pandas_index(folder: Path) -> list[Path]:
    """A data frame with its index and an elapsed Timedelta."""
    delta = [f"0 days 00:{int(t // 60):02d}:{t % 60:09.6f}" for t in R.t_s[ALL]]
    return write(folder, "frame.csv", ",stamp,elapsed,lat,lon,speed_mps,course_deg", rows_of([number(ALL, 0), times("%Y-%m-%d %H:%M:%S.%f+00:00", ALL), delta, lat(ALL), lon(ALL), show(SPEED, 3, ALL), show(R.course_deg, 2, ALL)]))


@real("fix speed", start=0)
def matlab_timetable(folder: Path) -> list[Path]:
    return write(folder, "tt.csv", "Time,Latitude,Longitude,Speed", rows_of([[f"{t:.1f} sec" for t in R.t_s], lat(ALL), lon(ALL), show(SPEED, 3, ALL)]))


@real(asks="no column is the time")
def datenum(folder: Path) -> list[Path]:
    """MATLAB's days since the year 0."""
    days = [f"{719529 + (EPOCH_S + t) / 86400:.10f}" for t in R.t_s[SECONDS]]
    return write(folder, "datenum.csv", "datenum,lat,lon,speed_mps,course_deg", rows_of([days, lat(), lon(), show(SPEED, 3), COURSE]))


@real(asks="no column is the time")
def filetime(folder: Path) -> list[Path]:
    """Windows' tenths of microseconds since 1601."""
    ticks = [str((EPOCH_S + 11644473600) * 10**7 + round(t * 1e7)) for t in R.t_s[SECONDS]]
    return write(folder, "ticks.csv", "FileTimeUtc,Latitude,Longitude", rows_of([ticks, lat(), lon()]))


@real(asks="2038")
def labview_1904(folder: Path) -> list[Path]:
    seconds = [f"{EPOCH_S + 2082844800 + t:.3f}" for t in R.t_s[SECONDS]]
    return write(folder, "labview.txt", "Time\tLat\tLon", rows_of([seconds, lat(), lon()], "\t"), end="\r\n")


@real(asks="(?i)time|stamp")
def rounded_epoch(folder: Path) -> list[Path]:
    """A spreadsheet has cut the seconds since 1970 to six digits: most times are equal."""
    return write(folder, "rounded.csv", "time,lat,lon,speed_mps", rows_of([[f"{EPOCH_S + t:.5E}" for t in R.t_s], lat(ALL), lon(ALL), show(SPEED, 2, ALL)]))


# ---- spreadsheets and habits


@real("fix height velocity", start=START_NS)
def excel_german(folder: Path) -> list[Path]:
    """A line for the spreadsheet, German words, decimal commas; the zone stands in the header."""
    return write(folder, "Fahrt.csv", "sep=;", "Zeitstempel (UTC);Breitengrad;Längengrad;Höhe ü. NN [m];Geschwindigkeit [km/h];Kurs [°]", rows_of([times("%d.%m.%Y %H:%M:%S"), lat(), lon(), HEIGHT, KMH, COURSE], ";", ","), end="\r\n", encoding="cp1252")


@real(asks="zone")
def excel_local(folder: Path) -> list[Path]:
    return write(folder, "Fahrt2.csv", "Datum;Uhrzeit;Breite;Länge;km/h;Richtung", rows_of([times("%d.%m.%Y", hours=11), times("%H:%M:%S", hours=11), lat(), lon(), KMH, COURSE], ";", ","), end="\r\n", encoding="utf-8-sig")


@real("fix velocity")
def utf16_tabs(folder: Path) -> list[Path]:
    return write(folder, "unicode.txt", "UTC\tLatitude\tLongitude\tSpeed (m/s)\tCourse", rows_of([times("%Y-%m-%d %H:%M:%S"), lat(), lon(), show(SPEED, 2), COURSE], "\t"), end="\r\n", encoding="utf-16")


@real("fix velocity")
def all_quoted(folder: Path) -> list[Path]:
    return write(folder, "quoted.csv", '"timestamp","lat","lng","speed_kph","bearing"', quoted([times("%Y-%m-%dT%H:%M:%S.%f+00:00"), lat(), lon(), KMH, COURSE]), encoding="utf-8-sig", end="\r\n")


@real("fix velocity")
def reversed_rows(folder: Path) -> list[Path]:
    """The newest row first."""
    return write(folder, "newest.csv", "time,lat,lon,speed_kmh,course", rows_of([times("%Y-%m-%dT%H:%M:%SZ"), lat(), lon(), KMH, COURSE])[::-1])


@real(asks="time of the row before")
def twice_written(folder: Path) -> list[Path]:
    """A logger of 10 Hz that writes whole seconds: ten rows with one stamp."""
    return write(folder, "tenfold.csv", "gps_time,lat,lon,speed_mps,course", rows_of([times("%Y-%m-%dT%H:%M:%SZ", ALL), lat(ALL), lon(ALL), show(SPEED, 2, ALL), show(R.course_deg, 1, ALL)]))


@real("fix velocity")
def holes(folder: Path) -> list[Path]:
    """Empty cells, NaN, N/A and a null, a blank line now and then, and a comment behind the last row."""
    cells = [lat(), lon(), KMH, COURSE]
    for k, word in zip(range(5, 100, 6), ["", "NaN", "N/A", "null", "-", "#N/A", "None", "nan"] * 2, strict=False):
        for column in cells:
            column[k] = word
    body = rows_of([times("%Y-%m-%dT%H:%M:%SZ"), *cells])
    body[20:20] = ["", ""]
    return write(folder, "holes.csv", "time,latitude,longitude,speed (km/h),course (deg)", body, "", "# end of log", "# rows: 120")


@real("fix velocity")
def totals(folder: Path) -> list[Path]:
    """A summary below the rows."""
    return write(folder, "totals.csv", "Time (UTC),Lat,Lon,Speed (km/h),Course", rows_of([times("%Y-%m-%d %H:%M:%S"), lat(), lon(), KMH, COURSE]), "", "Total distance,1.2 km,,,", "Average speed,37.1 km/h,,,")


@real("fix velocity")
def numpy_savetxt(folder: Path) -> list[Path]:
    """The names stand in a comment, the numbers in powers of ten with 18 digits."""
    values = np.stack([EPOCH_S + R.t_s, R.lat_deg, R.lon_deg, SPEED, R.course_deg], axis=1)
    path = folder / "array.txt"
    np.savetxt(path, values, header="time_unix lat_deg lon_deg speed_mps course_deg")
    return [path]


@real(asks="swapped")
def swapped_with_motion(folder: Path) -> list[Path]:
    """lat and lon are exchanged; the range shows it, as longitudes here are beyond 90."""
    return write(folder, "swapped.csv", "time,lat,lon,speed_mps,course", rows_of([times("%Y-%m-%dT%H:%M:%SZ"), lon(), lat(), show(SPEED, 2), COURSE]))


@real("fix height velocity")
def nmea_degrees(folder: Path) -> list[Path]:
    """Degrees and minutes as in NMEA, hemispheres in their own columns, knots by the name."""
    a, ns = minutes(R.lat_deg[SECONDS], 2, "NS")
    o, ew = minutes(R.lon_deg[SECONDS], 3, "EW")
    return write(folder, "gprmc.csv", "date,utc,lat,lat_dir,lon,lon_dir,speed_knots,course,alt_m", rows_of([times("%d%m%y"), times("%H%M%S.00"), a, ns, o, ew, show(SPEED / 0.514444, 2), COURSE, HEIGHT]))


@real("fix speed")
def arduino(folder: Path) -> list[Path]:
    """No course, one speed without a unit in km/h, and milliseconds since power-on beside the clock."""
    return write(folder, "LOG00012.TXT", "millis,date,time,lat,lng,speed,sats", rows_of([show(R.t_s * 1000 + 51234, 0), times("%Y-%m-%d"), times("%H:%M:%SZ"), lat(n=6), lon(n=6), show(SPEED * 3.6, 2), same("9")]))


@real("fix velocity gyro accel")
def raw_mpu(folder: Path) -> list[Path]:
    """An IMU in milli-g and milli-degrees per second beside a receiver, the units in the names."""
    f, w = R.force_mps2 / 9.80665 * 1000, np.degrees(R.turn_radps) * 1000
    return write(
        folder,
        "imu_gps.csv",
        "unix_ms,lat,lon,gps_speed_mps,gps_course_deg,ax_mg,ay_mg,az_mg,gx_mdps,gy_mdps,gz_mdps",
        rows_of([[str(EPOCH_S * 1000 + round(t * 1000)) for t in R.t_s], lat(ALL), lon(ALL), show(SPEED, 2, ALL), show(R.course_deg, 1, ALL), *[show(f[:, k], 0, ALL) for k in range(3)], *[show(w[:, k], 0, ALL) for k in range(3)]]),
    )


@real(asks="(?i)unit")
def raw_counts(folder: Path) -> list[Path]:
    """The same in counts of the converter: 16384 are 1 g, 131 are 1 deg/s; nothing says so."""
    f, w = R.force_mps2 / 9.80665 * 16384, np.degrees(R.turn_radps) * 131
    return write(folder, "counts.csv", "unix_ms,lat,lon,ax,ay,az,gx,gy,gz", rows_of([[str(EPOCH_S * 1000 + round(t * 1000)) for t in R.t_s], lat(ALL), lon(ALL), *[show(f[:, k], 0, ALL) for k in range(3)], *[show(w[:, k], 0, ALL) for k in range(3)]]))


@real("pose pose_heading")
def csv_pose(folder: Path) -> list[Path]:
    """Poses as an odometry's table has them."""
    q = [np.zeros(N), np.zeros(N), np.sin(R.heading_rad / 2), np.cos(R.heading_rad / 2)]
    ns = [str(START_NS + round(t * 1e9)) for t in R.t_s]
    return write(folder, "odom.csv", "stamp_ns,x,y,z,qx,qy,qz,qw", rows_of([ns, *[show(each, 4, ALL) for each in (R.x_m, R.y_m, R.z_m)], *[show(each, 6, ALL) for each in q]]))


@real(asks="(?i)time")
def waypoints(folder: Path) -> list[Path]:
    return write(folder, "waypoints.csv", "x,y,z,yaw,velocity", rows_of([show(each, 3, ALL) for each in (R.x_m, R.y_m, R.z_m, R.heading_rad, R.speed_mps)]))


@real(asks="grid")
def utm(folder: Path) -> list[Path]:
    x, y = 324000 + R.x_m, 6_247_000 + R.y_m
    return write(folder, "utm.csv", "timestamp,easting,northing,elevation", rows_of([times("%Y-%m-%dT%H:%M:%SZ"), show(x, 3), show(y, 3), HEIGHT]))


@real("fix velocity")
def two_sessions(folder: Path) -> list[Path]:
    """A log that was switched off at noon the day before: rows of two days, the header again between them."""
    head = "time,lat,lon,speed_kmh,course"
    old = rows_of([times("%Y-%m-%dT%H:%M:%SZ", slice(0, 300, 10), hours=-12), *[each[:30] for each in (lat(), lon(), KMH, COURSE)]])
    return write(folder, "appended.csv", head, old, head, rows_of([times("%Y-%m-%dT%H:%M:%SZ"), lat(), lon(), KMH, COURSE]))


@real("fix speed heading")
def heading_math(folder: Path) -> list[Path]:
    """A yaw in radians, counter-clockwise from east, that the word alone does not tell."""
    return write(folder, "yaw.csv", "t_unix,lat,lon,v,yaw", rows_of([show(EPOCH_S + R.t_s, 3, ALL), lat(ALL), lon(ALL), show(SPEED, 2, ALL), show(np.angle(np.exp(1j * R.heading_rad)), 4, ALL)]))


@real("fix")
def degree_signs(folder: Path) -> list[Path]:
    """Degrees and decimal minutes with signs, one column for both."""

    def angle(value: float, letters: str) -> str:
        whole, rest = divmod(abs(value) * 60, 60)
        return f"{int(whole)}°{rest:.4f}'{letters[0] if value >= 0 else letters[1]}"

    both = [f'"{angle(a, "NS")}, {angle(o, "EW")}"' for a, o in zip(R.lat_deg[SECONDS], R.lon_deg[SECONDS], strict=True)]
    return write(folder, "signs.csv", "UTC time,Position", rows_of([times("%Y-%m-%dT%H:%M:%SZ"), both]))


@real("fix velocity")
def midnight_clock(folder: Path) -> list[Path]:
    """The date stands once in a column of the first row's day; the clock passes midnight."""
    return write(folder, "clock.csv", "date,utc_time,lat,lon,speed_kmh,course", rows_of([same("2024-03-09"), times("%H:%M:%S"), lat(), lon(), KMH, COURSE]))


@real("fix")
def ecef_and_enu_names(folder: Path) -> list[Path]:
    """Positions beside the offsets from a start: the offsets are not read as a second position."""
    return write(folder, "offsets.csv", "time,latitude,longitude,east_m,north_m", rows_of([times("%Y-%m-%dT%H:%M:%SZ"), lat(), lon(), show(R.x_m, 2), show(R.y_m, 2)]))
