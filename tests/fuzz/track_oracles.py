"""The rows of KML, RTKLIB and VBOX files, read plainly by what the formats say."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from xml.etree import ElementTree

from cwcli.importing.readers.kml import MAX_TIME_CHARACTERS
from cwcli.importing.tables import SourceTable
from cwcli.importing.text_file import decode_text_head
from tests.fuzz.import_oracles import NAN, Row, Tables

NS = 10**9
DAY_NS = 86_400 * NS
WEEK_S = 7 * 86_400
GPS_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)
LEAPS = (
    *("1981-07", "1982-07", "1983-07", "1985-07", "1988-01", "1990-01", "1991-01", "1992-07", "1993-07", "1994-07"),
    *("1996-01", "1997-07", "1999-01", "2006-01", "2009-01", "2012-07", "2015-07", "2017-01"),
)
"""The months that a leap second precedes (IERS Bulletin C)."""
DATE_CLOCK = re.compile(r"(\d{4})/(\d{1,2})/(\d{1,2}) (\d{1,2}):(\d{2}):(\d{2})(?:\.(\d{1,9}))?", re.ASCII)
WEEK_SECONDS = re.compile(r"(\d+) (\d+)(?:\.(\d*))?", re.ASCII)
MINUTES = {"lat": 1, "latitude": 1, "long": -1, "longitude": -1}
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?", re.ASCII)
LONG_EXPONENT = re.compile(r"[eE][+-]?\d{4,}$", re.ASCII)
"""cwcli takes `1E0000` for 1 in a column of nothing but numbers, else for a text."""


def number(text: str) -> float:
    """A decimal number, NaN for any other text and beyond what a double holds."""
    value = float(text) if NUMBER.fullmatch(text) else NAN
    return value if abs(value) < float("inf") else NAN


def kml(paths: list[Path], tables: Sequence[SourceTable]) -> Tables | None:
    """Pair the k-th `when` of a `gx:Track` with its k-th `gx:coord`; None for other numbers of them, or nested ones."""
    try:
        root = ElementTree.parse(paths[0]).getroot()
    except (ElementTree.ParseError, ValueError, LookupError):
        return None
    rows: list[Row] = []
    for track in (each for each in root.iter() if _local(each) == "Track"):
        if any(
            _local(inner) in {"Track", "when", "coord"} for each in track for inner in each.iter() if inner is not each
        ):
            return None
        whens, places = ([each for each in track.iter() if _local(each) == name] for name in ("when", "coord"))
        if len(whens) != len(places):
            return None
        for when, place in zip(whens, places, strict=True):
            lon, lat, height = ([number(each) for each in (place.text or "").split()] + [NAN] * 3)[:3]
            time = (when.text or "").strip()[:MAX_TIME_CHARACTERS]
            values = {"when": time, "latitude": lat, "longitude": lon, "height": height}
            rows.append(tuple(values[name] for name in tables[0].columns))
    return {"": rows}


def _local(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def rtklib(paths: list[Path], tables: Sequence[SourceTable]) -> Tables | None:
    """Split the lines below the names; the time is exact where it is of the kind that most rows have."""
    lines = _lines(paths[0])
    at, scale = next(
        (k, found[1]) for k, each in enumerate(lines) if (found := re.match(r"%\s+(GPST|UTC|JST)\s+\S", each))
    )
    cells = [_cells(each) for each in lines[at + 1 :]]
    rows = [each for each in cells if len(each) == len(tables[0].columns) + 1]
    n_dates = sum(DATE_CLOCK.fullmatch(f"{each[0]} {each[1]}") is not None for each in rows)
    n_weeks = sum(WEEK_SECONDS.fullmatch(f"{each[0]} {each[1]}") is not None for each in rows)
    time = _ns_of_date if n_dates > n_weeks else _ns_of_week
    is_sure = max(n_dates, n_weeks) > 0.6 * len(rows)
    return {"": [(time(f"{each[0]} {each[1]}", scale) if is_sure else None, *each[2:]) for each in rows]}


def _ns_of_date(text: str, scale: str) -> float | None:
    """UTC in ns since 1970; None for a text that is no date, NaN for a date that there is not."""
    found = DATE_CLOCK.fullmatch(text)
    if found is None:
        return None
    year, month, day, hour, minute, second = (int(each) for each in found.groups()[:6])
    if hour > 23 or minute > 59 or second > 60:
        return NAN
    try:
        moment = datetime(year, month, day, tzinfo=UTC) + timedelta(hours=hour, minutes=minute, seconds=second)
    except (ValueError, OverflowError):
        return NAN
    if not 1990 <= year < 2037:
        return None
    whole_s = (moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(seconds=1)
    return _utc_ns(whole_s * NS + int((found[7] or "").ljust(9, "0")), scale)


def _ns_of_week(text: str, scale: str) -> float | None:
    found = WEEK_SECONDS.fullmatch(text)
    if found is None:
        return None
    week, seconds = int(found[1]), int(found[2])
    if week * WEEK_S + seconds > 57 * 365 * 86_400:  # beyond 2036
        return NAN if week > 20_000 else None
    epoch_s = (GPS_EPOCH - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(seconds=1)
    return _utc_ns((epoch_s + week * WEEK_S + seconds) * NS + int((found[3] or "").ljust(9, "0")[:9]), scale)


def _utc_ns(ns: int, scale: str) -> int:
    if scale != "GPST":
        return ns - (9 * 3600 * NS if scale == "JST" else 0)
    moments = [int(datetime.fromisoformat(f"{each}-01T00:00:00+00:00").timestamp()) + k for k, each in enumerate(LEAPS)]
    return ns - bisect_right([each * NS + NS for each in moments], ns) * NS


def vbox(paths: list[Path], tables: Sequence[SourceTable]) -> Tables | None:
    """Split the lines below `[data]`; minutes become degrees, and a clock that goes back by half a day is the next."""
    lines = [each.strip(" \t\f\v") for each in _lines(paths[0])]
    names = tables[0].columns
    if "[data]" not in lines:  # it stands behind a character at which Python ends lines, too, as at U+2028
        return None
    date = next(
        (each for each in map(re.compile(r"File created on (\d\d?)/(\d\d?)/(\d{4})").search, lines[:5]) if each), None
    )
    try:
        day, month, year = map(int, date.groups()) if date else (1, 1, 1970)
        first = datetime(year if 1970 <= year < 2100 else 0, month, day, tzinfo=UTC)
    except ValueError:
        first = datetime(1970, 1, 1, tzinfo=UTC)
    midnight_ns = round(first.timestamp()) * NS
    rows: list[Row] = []
    last_ns = 0
    for cells in (_cells(each) for each in lines[lines.index("[data]") + 1 :]):
        if len(cells) != len(names):
            continue
        values: dict[str, object] = {name: cell.strip() for name, cell in zip(names, cells, strict=True)}
        found = re.fullmatch(r"\+?0*(\d{0,6})(?:\.(\d*))?", str(values["time"]), re.ASCII)
        hour, minute, second = (int(found[1].zfill(6)[k : k + 2]) if found else 99 for k in (0, 2, 4))
        values["time"] = None if NUMBER.fullmatch(str(values["time"])) and not found else NAN
        if found is not None and hour < 24 and minute < 60 and second <= 60:
            ns = ((hour * 60 + minute) * 60 + second) * NS + int((found[2] or "").ljust(9, "0")[:9])
            midnight_ns += DAY_NS if ns - last_ns < -DAY_NS // 2 else 0
            last_ns = ns
            values["time"] = midnight_ns + ns
        for name, sign in MINUTES.items():
            if name in values:
                text = str(values[name])
                values[name] = None if LONG_EXPONENT.search(text) else number(text) / 60 * sign
        rows.append(
            tuple(values[name] if name in {"time", *MINUTES} else cell for name, cell in zip(names, cells, strict=True))
        )
    return {"": rows}


def _lines(path: Path) -> list[str]:
    """The lines of a text in the encoding that cwcli finds; code pages are tried by its own tests."""
    data = path.read_bytes()
    head = decode_text_head(data)
    assert head is not None
    return re.split(r"\r\n|\r|\n", data[head.bom_bytes :].decode(head.encoding, "replace"))


def _cells(line: str) -> list[str]:
    """The words between blanks of ASCII."""
    return [each.decode() for each in line.encode().split()]
