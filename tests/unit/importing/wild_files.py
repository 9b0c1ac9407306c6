"""Forty more files as loggers, spreadsheets and apps write them, of the drive of `real_drive`, with odd dialects."""

# fmt: off
from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyproj

from tests.unit.importing.real_drive import ALL, GPS_TOW_S, GPS_WEEK, SECONDS, START, N, R, show, times
from tests.unit.importing.real_tables import (
    COURSE,
    EPOCH_S,
    HEIGHT,
    KMH,
    SPEED,
    RealCase,
    lat,
    lon,
    minutes,
    number,
    quoted,
    rows_of,
    same,
    write,
)

WILD_FILES: dict[str, RealCase] = {}
ISO = "%Y-%m-%dT%H:%M:%SZ"
GPS_S = [f"{GPS_WEEK * 604800 + GPS_TOW_S + t:.3f}" for t in R.t_s[SECONDS].tolist()]


def wild(holds: str = "", asks: str = "", start: int | None = None, **bounds: float) -> Callable[[Callable[[Path], list[Path]]], Callable[[Path], list[Path]]]:
    """Register the maker of a case under its name."""

    def keep(make: Callable[[Path], list[Path]]) -> Callable[[Path], list[Path]]:
        more = {} if start is None else {"start": start}
        WILD_FILES[make.__name__] = RealCase(make, holds, asks, bounds=bounds, **more)
        return make

    return keep


def clocks(pattern: str, rows: slice = SECONDS) -> list[str]:
    """Times of day of a recording that begins at 11:58:30 in the forenoon, so that it passes noon and one o'clock."""
    shift = (11 * 3600 + 58 * 60 + 30 - (START.hour * 3600 + START.minute * 60 + START.second)) / 3600
    return times(pattern, rows, hours=shift)


def near_one(pattern: str, rows: slice = SECONDS) -> list[str]:
    """The same, of one that begins at 12:58:30."""
    shift = (12 * 3600 + 58 * 60 + 30 - (START.hour * 3600 + START.minute * 60 + START.second)) / 3600
    return times(pattern, rows, hours=shift)


def grid(rows: slice = SECONDS) -> tuple[list[str], list[str]]:
    east, north = pyproj.Transformer.from_crs(4326, 32756, always_xy=True).transform(R.lon_deg, R.lat_deg)
    return show(np.array(east), 3, rows), show(np.array(north), 3, rows)


# ---- clocks


@wild(asks="12 hours")
def clock_of_twelve_hours(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "UTC time,lat,lon", rows_of([near_one("%I:%M:%S"), lat(), lon()]))


@wild(asks="12 hours")
def dated_clock_of_twelve_hours(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "utc,lat,lon", rows_of([near_one("%Y-%m-%d %I:%M:%S"), lat(), lon()]))


@wild(asks="12 hours")
def date_beside_clock_of_twelve_hours(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "date,utc time,lat,lon", rows_of([near_one("%Y-%m-%d"), near_one("%I:%M:%S"), lat(), lon()]))


@wild(asks="half a day|12 hours")
def two_clocks_half_a_day_apart(folder: Path) -> list[Path]:
    afternoon = times("%I:%M:%S", hours=13 - START.hour + 0.0)
    full = times("%H:%M:%S", hours=13 - START.hour + 0.0)
    return write(folder, "a.csv", "time,utc time,lat,lon", rows_of([afternoon, full, lat(), lon()]))


@wild("fix")
def half_in_its_own_column(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "Date UTC,Time UTC,AM/PM,lat,lon", rows_of([times("%Y-%m-%d"), times("%I:%M:%S"), times("%p"), lat(), lon()]))


@wild("fix")
def halves_behind(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "UTC,lat,lon", rows_of([times("%Y-%m-%d %I:%M:%S %p"), lat(), lon()]))


@wild("fix velocity", start=0)
def minutes_since_start(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "Elapsed time [min],lat,lon,speed [km/h],course [deg]", rows_of([show(R.t_s / 60, 6), lat(), lon(), KMH, COURSE]))


@wild(asks="1980|gps", start=None)
def gps_seconds_without_a_word(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "timestamp,lat,lon", rows_of([GPS_S, lat(), lon()]))


@wild("fix")
def gps_seconds_said(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "gps_time_s,lat,lon", rows_of([GPS_S, lat(), lon()]))


@wild("fix velocity")
def epoch_microseconds(folder: Path) -> list[Path]:
    us = [str(EPOCH_S * 10**6 + round(t * 1e6)) for t in R.t_s.tolist()]
    return write(folder, "a.tsv", "ts_us\tLat\tLng\tspd_mps\tcog_deg", rows_of([us, lat(ALL), lon(ALL), show(SPEED, 3, ALL), show(R.course_deg, 2, ALL)], "\t"))


@wild("fix velocity")
def epoch_in_powers(folder: Path) -> list[Path]:
    """Seconds as a spreadsheet prints them: six digits are lost in `%.15e`, none."""
    s = [f"{EPOCH_S + t:.15e}" for t in R.t_s.tolist()]
    return write(folder, "a.csv", "unix time (s),lat,lon,speed (m/s),course (deg)", rows_of([s, lat(ALL), lon(ALL), show(SPEED, 3, ALL), show(R.course_deg, 2, ALL)]))


@wild(asks="(?i)time|zone|serial")
def excel_serial_days(folder: Path) -> list[Path]:
    days = [f"{25569 + (EPOCH_S + t) / 86400:.9f}" for t in R.t_s[SECONDS].tolist()]
    return write(folder, "a.csv", "Time;Latitude;Longitude", rows_of([days, lat(), lon()], ";", ","))


@wild("fix")
def offset_in_the_text(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "when,latitude,longitude\n".replace("when", "timestamp").rstrip(), rows_of([times("%Y-%m-%d %H:%M:%S+05:30", hours=5.5), lat(), lon()]))


@wild(asks="order")
def day_or_month(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "UTC;lat;lon", rows_of([times("%d/%m/%Y %H:%M:%S", slice(0, 300, 10)), lat()[:30], lon()[:30]], ";"))


@wild("fix")
def german_months(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "Zeit (UTC);Breite;Länge", rows_of([times("%d.%m.%Y %H:%M:%S"), lat(), lon()], ";", ","), encoding="cp1252")


# ---- places


@wild(asks="milliarcseconds")
def milliarcseconds(folder: Path) -> list[Path]:
    a, o = (show(each * 3.6e6 * scale, 0) for each, scale in ((R.lat_deg, 1), (R.lon_deg, 1)))
    return write(folder, "a.csv", "time,lat,lon", rows_of([times(ISO), a, o]))


@wild("fix")
def milliarcseconds_said(folder: Path) -> list[Path]:
    a, o = (show(each * 3.6e6, 0) for each in (R.lat_deg, R.lon_deg))
    return write(folder, "a.csv", "time,lat_mas,lon_mas", rows_of([times(ISO), a, o]))


@wild("fix")
def arcseconds_said(folder: Path) -> list[Path]:
    a, o = (show(each * 3600, 4) for each in (R.lat_deg, R.lon_deg))
    return write(folder, "a.csv", "time,lat [arcsec],lon [arcsec]", rows_of([times(ISO), a, o]))


@wild("fix")
def radians_said(folder: Path) -> list[Path]:
    a, o = (show(np.radians(each), 10) for each in (R.lat_deg, R.lon_deg))
    return write(folder, "a.csv", "time,lat_rad,lon_rad", rows_of([times(ISO), a, o]))


@wild(asks="degrees or radians")
def radians_not_said(folder: Path) -> list[Path]:
    a, o = (show(np.radians(each), 10) for each in (R.lat_deg, R.lon_deg))
    return write(folder, "a.csv", "time,lat,lon", rows_of([times(ISO), a, o]))


@wild("fix velocity")
def nmea_numbers(folder: Path) -> list[Path]:
    a, ns = minutes(R.lat_deg[SECONDS], 2, "NS", 5)
    o, ew = minutes(R.lon_deg[SECONDS], 3, "EW", 5)
    return write(folder, "a.csv", "utc,latitude,n/s,longitude,e/w,sog (kn),cog", rows_of([times(ISO), a, ns, o, ew, show(SPEED / 0.514444, 3), COURSE]))


@wild(asks="degrees and minutes|ddmm")
def nmea_numbers_without_hemisphere(folder: Path) -> list[Path]:
    a, _ = minutes(R.lat_deg[SECONDS], 2, "NS", 5)
    o, _ = minutes(R.lon_deg[SECONDS], 3, "EW", 5)
    return write(folder, "a.csv", "utc,latitude,longitude", rows_of([times(ISO), a, o]))


@wild("fix")
def dms_texts(folder: Path) -> list[Path]:
    def angle(value: float, letters: str) -> str:
        whole, rest = divmod(round(abs(value) * 3600, 3), 3600)
        return f"{int(whole)}° {int(rest // 60)}' {rest % 60:.3f}\" {letters[value < 0]}"

    columns = [times(ISO), [angle(a, "NS") for a in R.lat_deg[SECONDS].tolist()], [angle(o, "EW") for o in R.lon_deg[SECONDS].tolist()]]
    return write(folder, "a.csv", "time,lat,lon", quoted(columns))


@wild(asks="grid")
def utm_columns(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "time,utm_easting,utm_northing", rows_of([times(ISO), *grid()]))


@wild(asks="grid")
def projected_x_y(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "time,x,y,speed (km/h)", rows_of([times(ISO), *grid(), KMH]))


@wild("pose pose_heading speed", pose_heading=4.0)
def local_east_north(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "time,east_m,north_m,speed_kmh", rows_of([times(ISO), show(R.x_m, 3), show(R.y_m, 3), KMH]))


@wild("fix")
def sentinels(folder: Path) -> list[Path]:
    """-9999 where nothing was measured."""
    a, o = lat(), lon()
    a[5::9] = ["-9999"] * len(a[5::9])
    o[5::9] = ["-9999"] * len(o[5::9])
    return write(folder, "a.csv", "time,lat,lon", rows_of([times(ISO), a, o]))


@wild("fix height velocity")
def sentinel_speeds(folder: Path) -> list[Path]:
    v, h = list(KMH), list(HEIGHT)
    v[7::11], h[3::13] = ["-9999"] * len(v[7::11]), ["-9999"] * len(h[3::13])
    return write(folder, "a.csv", "time,lat,lon,alt_m,speed_kmh,course", rows_of([times(ISO), lat(), lon(), h, v, COURSE]))


# ---- speeds, angles


@wild("fix height velocity")
def feet_and_knots(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "Time (UTC),Lat,Lon,Altitude (ft),Speed (kts),Track (deg)", rows_of([times(ISO), lat(), lon(), show(R.height_m / 0.3048, 2), show(SPEED / 0.514444, 3), COURSE]))


@wild("fix velocity")
def units_in_second_row(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "time;lat;lon;speed;course", "UTC;°;°;mph;°", rows_of([times(ISO), lat(), lon(), show(SPEED / 0.44704, 3), COURSE], ";"))


@wild("fix speed heading")
def math_heading(folder: Path) -> list[Path]:
    deg = np.mod(np.degrees(R.heading_rad), 360)
    return write(folder, "a.csv", "time_s_unix,lat,lon,v_kmh,psi_deg,roll_deg", rows_of([show(EPOCH_S + R.t_s, 3, ALL), lat(ALL), lon(ALL), show(SPEED * 3.6, 2, ALL), show(deg, 3, ALL), same("0.1", ALL)]))


@wild(asks="each be the speed|speed")
def speeds_twice(folder: Path) -> list[Path]:
    """Two columns of one name, whose numbers differ by more than their noise."""
    return write(folder, "a.csv", "time,lat,lon,speed,speed", rows_of([times(ISO), lat(), lon(), KMH, show(SPEED * 3.6 * 1.4, 2)]))


@wild("fix velocity")
def interleaved(folder: Path) -> list[Path]:
    """A row for each sensor; the cells of the others are empty."""
    rows = []
    for k, stamp in enumerate(show(EPOCH_S + R.t_s, 3, ALL)):
        if k % 10 == 0:
            rows.append(f"{stamp},{R.lat_deg[k]:.7f},{R.lon_deg[k]:.7f},{SPEED[k]:.3f},{R.course_deg[k]:.2f},")
        rows.append(f"{stamp}1,,,,,{20 + k % 7}")
    return write(folder, "a.csv", "unix_s,lat,lon,speed_mps,course_deg,temperature", rows)


# ---- dialects


@wild("fix velocity")
def byte_order_mark(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "time;lat;lon;speed [km/h];course [°]", rows_of([times(ISO), lat(), lon(), KMH, COURSE], ";", ","), end="\r\n", encoding="utf-8-sig")


@wild("fix")
def wide_characters(folder: Path) -> list[Path]:
    return write(folder, "a.txt", "Time UTC\tLatitude\tLongitude", rows_of([times("%Y-%m-%d %H:%M:%S"), lat(), lon()], "\t"), end="\r\n", encoding="utf-16")


@wild("fix")
def line_ends_in_quotes(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "id,time,note,lat,lon", quoted([number(), times(ISO), same("two\nlines, one cell"), lat(), lon()]))


@wild("fix")
def preamble(folder: Path) -> list[Path]:
    return write(folder, "a.csv", "# logger 4.2", "# device: van 7", "", "time,lat,lon", rows_of([times(ISO), lat(), lon()]))


# ---- other formats


@wild("fix height velocity")
def gpx_with_extensions(folder: Path) -> list[Path]:
    points = "".join(
        f'<trkpt lat="{a}" lon="{o}"><ele>{h}</ele><time>{t}</time><extensions><gpxtpx:TrackPointExtension><gpxtpx:speed>{v:.3f}</gpxtpx:speed>'
        f"<gpxtpx:course>{c}</gpxtpx:course></gpxtpx:TrackPointExtension></extensions></trkpt>"
        for a, o, h, t, v, c in zip(lat(), lon(), HEIGHT, times(ISO), SPEED[SECONDS].tolist(), COURSE, strict=True)
    )
    head = '<?xml version="1.0"?><gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1" xmlns:gpxtpx="http://www.garmin.com/xmlschemas/TrackPointExtension/v2"><trk><trkseg>'
    return write(folder, "a.gpx", head + points + "</trkseg></trk></gpx>")


@wild("fix height velocity")
def mixed_talkers(folder: Path) -> list[Path]:
    """GGA of all systems, RMC of GPS, and sentences of other kinds and with wrong sums between them."""

    def sentence(body: str) -> str:
        check = 0
        for letter in body:
            check ^= ord(letter)
        return f"${body}*{check:02X}"

    a, ns = minutes(R.lat_deg[SECONDS], 2, "NS", 5)
    o, ew = minutes(R.lon_deg[SECONDS], 3, "EW", 5)
    lines = []
    for k, (clock, date) in enumerate(zip(times("%H%M%S.00"), times("%d%m%y"), strict=True)):
        place = f"{a[k]},{ns[k]},{o[k]},{ew[k]}"
        lines += [
            sentence(f"GNGGA,{clock},{place},1,12,0.8,{HEIGHT[k]},M,0.0,M,,"),
            sentence("GLGSV,1,1,00"),
            sentence(f"GPRMC,{clock},A,{place},{SPEED[SECONDS][k] / 0.514444:.3f},{COURSE[k]},{date},,,A"),
            f"$GNGGA,{clock},0000.00,N,00000.00,E,1,12,0.8,1.0,M,20.0,M,,*00",
        ]
    return write(folder, "a.nmea", lines, end="\r\n")


@wild(asks="(?i)kind|json|read")
def phone_json(folder: Path) -> list[Path]:
    rows = [{"sensor": "Location", "time": str(EPOCH_S * 10**9 + round(t * 1e9)), "latitude": a, "longitude": o} for t, a, o in zip(R.t_s[SECONDS].tolist(), lat(), lon(), strict=True)]
    return write(folder, "a.json", json.dumps(rows))


assert len(R.t_s) == N
