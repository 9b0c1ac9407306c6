"""The rows of files for `cwcli import`, by libraries that cwcli does not use for them."""

from __future__ import annotations

import csv
import io
import re
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import can as python_can
import cantools
import numpy as np
import pynmea2
from pyubx2 import UBXReader

from cwcli.importing.readers.delimited import find_separator_names_and_units
from cwcli.importing.tables import SourceTable
from cwcli.importing.text_file import decode_text_head, read_head
from cwcli.signals.can import NO_VALUE_NAME_PATTERN

Row = tuple[Any, ...]
Tables = dict[str, list[Row]]
"""Name of a table -> its rows; None stands for a value that is not compared."""
NAN = float("nan")
SYNC = b"\xb5\x62"
SENTENCE = re.compile(r"[$!][A-Z0-9]{5},[^*]*\*[0-9A-Fa-f]{2}")
KMH, KNOT = 1 / 3.6, 1852 / 3600


def number(text: object) -> float:
    """A number of digits, a point and a sign at most; NaN for any other text."""
    return float(str(text)) if re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)", str(text), re.ASCII) else NAN


def angle(text: str, half: str, halves: str) -> float:
    """Degrees of `4807.038`, `N`; NaN beyond 90 to the north or south and 180 to the east or west."""
    match = re.fullmatch(r"\+?(\d*?)(\d{0,2}(?:\.\d*)?)", text, re.ASCII)
    if match is None or half not in (*halves,) or not re.search(r"\d", text) or number(match[2] or "0") >= 60.0:
        return NAN
    size = float(match[1] or "0") + (number(match[2]) / 60.0 if re.search(r"\d", match[2]) else 0.0)
    if size > (90.0 if half in "NS" else 180.0):
        return NAN
    return size if half == halves[0] else -size


def nmea(paths: list[Path], tables: Sequence[SourceTable]) -> Tables:
    """Read the sentences by pynmea2, which checks the checksum and names the fields; the day is not compared."""
    found: dict[str, list[tuple[Any, dict[str, float | None]]]] = {}
    time: Any = None
    with paths[0].open(encoding="ascii", errors="replace") as file:
        for line in file:
            body = line.strip()
            match = SENTENCE.match(body, max(body.find("$"), body.find("!"), 0))
            try:
                message = pynmea2.parse("$" + match[0][1:], check=True) if match and body.isascii() else None
            except pynmea2.ParseError:
                continue
            if message is None:
                continue
            kind = getattr(message, "sentence_type", "")
            if kind in {"GGA", "RMC", "ZDA"}:
                clock = re.fullmatch(r"([01]\d|2[0-3])([0-5]\d)([0-5]\d|60)(?:\.(\d*))?", message.data[0], re.ASCII)
                if clock is None:
                    continue
                hour, minute, second = (int(clock[k]) for k in (1, 2, 3))
                time = ((hour * 60 + minute) * 60 + second) * 10**9 + int((clock[4] or "").ljust(9, "0")[:9])
            values = _values(kind, message.data) if kind in FIELDS else None
            if values is not None and time is not None:
                found.setdefault(kind, []).append((time % (86_400 * 10**9), values))
    made: Tables = {}
    for table in tables:
        kind = next(note for note in table.notes if note.startswith("from ")).split()[1]
        made[table.part] = [
            tuple(time if name == "time" else values[name] for name in table.columns)
            for time, values in found.get(kind, [])
        ]
    return made


FIELDS = {"GGA": 11, "RMC": 8, "VTG": 8, "HDT": 2}


def _values(kind: str, data: list[str]) -> dict[str, float | None] | None:
    """The values of a sentence in SI units; None without a fix, or if fields are missing."""
    if len(data) < FIELDS[kind]:
        return None
    if kind == "GGA":
        has_fix = data[5].isdecimal() and data[5] not in "07"
        place: dict[str, float | None] = {
            "latitude_deg": angle(data[1], data[2], "NS"),
            "longitude_deg": angle(data[3], data[4], "EW"),
        }
        return place | {"altitude_m": number(data[8]) + number(data[10])} if has_fix else None
    if kind == "RMC":
        has_fix = data[1] == "A" and not (len(data) > 11 and data[11] == "N")
        place = {
            "latitude_deg": angle(data[2], data[3], "NS"),
            "longitude_deg": angle(data[4], data[5], "EW"),
        }
        more: dict[str, float | None] = {
            "altitude_m": NAN,
            "speed_mps": number(data[6]) * KNOT,
            "course_deg": number(data[7]),
        }
        return place | more if has_fix else None
    if kind == "VTG":
        speed = number(data[6]) * KMH if data[6] else number(data[4]) * KNOT
        has_fix = not (len(data) > 8 and data[8] == "N")
        return {"speed_mps": speed, "course_deg": number(data[0])} if has_fix else None
    return {"course_deg": number(data[0]) if data[1] == "T" else NAN}


def ubx(paths: list[Path], tables: Sequence[SourceTable]) -> Tables:
    """Read the solutions by pyubx2, at each place where a message can begin."""
    data, at, rows = paths[0].read_bytes(), 0, []
    while (at := data.find(SYNC, at)) >= 0:
        end = at + 8 + int.from_bytes(data[at + 4 : at + 6], "little")
        try:
            message = UBXReader.parse(data[at:end]) if end <= len(data) else None
        except Exception:  # each damage has its own
            message = None
        at = at + 2 if message is None else end
        is_whole = message is not None and message.identity == "NAV-PVT" and message.length >= 84
        if message is not None and is_whole and (row := _solution(message)):
            rows.append(row)
    return {"NAV-PVT": rows}


def _solution(message: Any) -> Row | None:
    is_good = message.validDate and message.validTime and message.gnssFixOk and message.fixType not in (0, 5)
    try:
        day = np.datetime64(f"{message.year:04d}-{message.month:02d}-{message.day:02d}", "D").astype(int)
    except ValueError:
        return None
    seconds = day * 86_400 + message.hour * 3600 + message.min * 60 + message.second
    values = message.lat, message.lon, message.height / 1e3, message.velE / 1e3, message.velN / 1e3
    return (int(seconds) * 10**9 + message.nano, *values) if is_good else None


def with_ubx_checksums(data: bytes) -> bytes:
    """Messages whose checksums are right again, wherever one can begin."""
    changed, at = bytearray(data), 0
    while (at := changed.find(SYNC, at)) >= 0 and at + 6 <= len(changed):
        end = at + 6 + struct.unpack_from("<H", changed, at + 4)[0]
        if end + 2 > len(changed):
            at += 2
            continue
        first = second = 0
        for octet in changed[at + 2 : end]:
            first = (first + octet) & 0xFF
            second = (second + first) & 0xFF
        changed[end : end + 2] = bytes([first, second])
        at = end + 2
    return bytes(changed)


def csv_rows(paths: list[Path], tables: Sequence[SourceTable]) -> Tables | None:
    """Read the rows by Python's csv; the layout is what cwcli finds."""
    head = decode_text_head(read_head(paths[0]))
    assert head is not None
    layout = find_separator_names_and_units(head, "")
    try:
        text = paths[0].read_bytes()[head.bom_bytes :].decode(head.encoding)
        lines = text.splitlines(keepends=True)[layout.n_head_lines :]
        rows = [tuple(row) for row in csv.reader(io.StringIO("".join(lines), newline=""), delimiter=layout.separator)]
    except (UnicodeError, csv.Error):
        return None
    return {"": [row for row in rows if len(row) == len(layout.names)]}


def gpx(paths: list[Path], tables: Sequence[SourceTable]) -> Tables | None:
    """Read the points by a parser of whole trees; None for points inside of points."""
    try:
        root = ElementTree.parse(paths[0]).getroot()
    except (ElementTree.ParseError, ValueError):
        return None
    rows = []
    for point in (each for each in root.iter() if _local(each) == "trkpt"):
        if any(_local(inner) == "trkpt" for inner in point.iter() if inner is not point):
            return None
        fields = {"lat": point.get("lat", ""), "lon": point.get("lon", "")}
        for inner in point.iter():
            if inner.text:
                fields.setdefault(_local(inner), inner.text.strip())
        rows.append(tuple(fields.get(name, "") for name in tables[0].columns))
    return {"": rows}


def _local(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def can(paths: list[Path], tables: Sequence[SourceTable]) -> Tables | None:
    """Read the signals by python-can and cantools, frame by frame; None where cantools can't decode one."""
    reader = {
        ".asc": python_can.ASCReader,
        ".blf": python_can.BLFReader,
        ".log": python_can.CanutilsLogReader,
        ".trc": python_can.TRCReader,
    }
    text = paths[1].read_bytes()
    try:
        described = text.decode("utf-8")
    except UnicodeDecodeError:
        described = text.decode("cp1252", "replace")
    database = cantools.database.load_string(described, database_format="dbc", strict=False)
    assert isinstance(database, cantools.database.can.Database)
    names = [message.name for message in database.messages]
    signals = [(message.name, signal.name) for message in database.messages for signal in message.signals]
    if len({*names}) < len(names) or len({*signals}) < len(signals):
        return None
    made: Tables = {table.part: [] for table in tables}
    columns = {table.part: table.columns for table in tables}
    # The official reader gives up on text that is not UTF-8; with the bytes replaced it reads what we read.
    trace: Any = paths[0]
    if paths[0].suffix != ".blf":
        # The date of a TRC trace is local time, which the official reader takes as UTC.
        lines = io.StringIO(paths[0].read_text("utf-8", errors="replace"))
        trace = io.StringIO("".join(line for line in lines if not line.startswith(";$STARTTIME")))
    with reader[paths[0].suffix](trace) as frames:
        for frame in frames:
            for message in database.messages:
                is_it = message.frame_id == frame.arbitration_id and message.is_extended_frame == frame.is_extended_id
                if not is_it or message.name not in made or frame.is_remote_frame or frame.is_error_frame:
                    continue
                values = dict(_signals(message, bytes(frame.data)))
                row = (values[name] for name in columns[message.name][1:])
                made[message.name].append((round(frame.timestamp * 1e6) * 1000, *row))
    return made


def _signals(message: Any, data: bytes) -> Iterator[tuple[str, float | None]]:
    """The physical value of each signal; NaN where there is none, None where cantools tells none."""
    for signal in message.signals:
        alone = cantools.database.can.Message(message.frame_id, message.name, 64, [signal], strict=False)
        bits = [signal.start + k for k in range(signal.length)]
        if signal.byte_order != "little_endian" or signal.multiplexer_ids or signal.is_float:
            yield signal.name, None
        elif max(bits) >= 8 * len(data):
            yield signal.name, NAN
        else:
            raw = alone.decode(data.ljust(64, b"\0"), decode_choices=False, scaling=False)[signal.name]
            yield signal.name, _physical(signal, raw)


def _physical(signal: Any, raw: Any) -> float:
    name = str((signal.choices or {}).get(raw, "")).replace("_", " ")
    value = float(raw) * float(signal.scale) + float(signal.offset)
    low, high = signal.minimum, signal.maximum
    slack = 0.5 * abs(float(signal.scale))
    is_beyond = None not in (low, high) and low < high and not low - slack <= value <= high + slack
    return NAN if is_beyond or NO_VALUE_NAME_PATTERN.search(name) else value
