"""Google's GNSSLogger for Android: lines that begin with what they are, and remarks that name their columns.

`Fix` lines hold positions by provider; those of GPS are read, else of the fused location. `UncalAccel` and `UncalGyro`
hold the phone's inertial measurements. Source: developer.android.com/develop/sensors-and-location/sensors/gnss.
"""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.errors import DataError
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.delimited import read_delimited_table
from cwcli.importing.tables import Answers, Preset, SourceTable
from cwcli.importing.text_file import iter_text_lines

READ_LINE_KINDS = ("Fix", "UncalAccel", "UncalGyro", "Accel", "Gyro")
"""First cells of the lines that are read."""
POSITION_PROVIDERS = ("GPS", "gps", "FLP", "fused", "NLP", "network")
"""Providers of positions, the best first."""
_PRESET_BY_COLUMN = {
    "UnixTimeMillis": Preset("time", "ms"),
    "utcTimeMillis": Preset("time", "ms"),
    "(UTC)TimeInMs": Preset("time", "ms"),
    "LatitudeDegrees": Preset("latitude", "deg"),
    "Latitude": Preset("latitude", "deg"),
    "LongitudeDegrees": Preset("longitude", "deg"),
    "Longitude": Preset("longitude", "deg"),
    "AltitudeMeters": Preset("altitude", "m"),
    "Altitude": Preset("altitude", "m"),
    "SpeedMps": Preset("speed", "mps"),
    "Speed": Preset("speed", "mps"),
    "BearingDegrees": Preset("course", "deg-cw-north"),
    **{
        f"{name}{axis}Mps2": Preset(f"accel_{axis.lower()}", "mps2")
        for name in ("UncalAccel", "Accel")
        for axis in "XYZ"
    },
    **{
        f"{name}{axis}RadPerSec": Preset(f"gyro_{axis.lower()}", "radps")
        for name in ("UncalGyro", "Gyro")
        for axis in "XYZ"
    },
}


def _accepts_gnsslogger_file(head: FileHead) -> bool:
    lines = head.lines
    named = any(line.startswith(("# Fix,", "# Raw,", "#Fix,", "#Raw,")) for line in lines)
    return named or (any("GnssLogger" in line for line in lines) and any(line.startswith("Fix,") for line in lines))


def _read_gnsslogger_tables(path: str, answers: Answers) -> Sequence[SourceTable]:
    names: dict[str, str] = {}
    rows: dict[str, bytearray] = {}
    for line in iter_text_lines(path):
        word, _, rest = line.lstrip("# ").partition(",")
        if line.startswith("#") and word in READ_LINE_KINDS:
            names[word] = rest.strip()
        elif word in READ_LINE_KINDS and word in names:
            row = rest if rest.endswith("\n") else f"{rest}\n"
            rows.setdefault(word, bytearray(f"{names[word]}\n".encode())).extend(row.encode())
    if not rows:
        raise DataError("it has no Fix line", where=path, hint="let GNSSLogger record the location, too")
    tables = []
    for word in list(rows):
        data, notes = bytes(rows.pop(word)), []
        if word == "Fix":
            data, said = _rows_of_best_provider_and_note(data)
            notes.append(said)
        table = read_delimited_table(path, answers, part=word, data=data, kind="gnsslogger")
        tables.append(_with_gnsslogger_presets(table, notes))
    return _without_calibrated_duplicates(tables)


def _with_gnsslogger_presets(table: SourceTable, notes: list[str]) -> SourceTable:
    from dataclasses import replace

    presets = {column: _PRESET_BY_COLUMN.get(column, Preset("ignored")) for column in table.columns}
    return replace(
        table, presets=presets, is_device_frame=True, attitude_is_of_device=True, notes=[*table.notes, *notes]
    )


def _rows_of_best_provider_and_note(data: bytes) -> tuple[bytes, str]:
    """Return the line of names with the positions of one provider, and which one it is."""
    names, *rows = data.splitlines(keepends=True)
    found = {row.partition(b",")[0].decode() for row in rows}
    best = next((name for name in POSITION_PROVIDERS if name in found), min(found))
    provider_rows = [row for row in rows if row.startswith(f"{best},".encode())]
    others = ", ".join(sorted(found - {best}))
    return b"".join([names, *provider_rows]), f"positions of {best}" + (
        f"; those of {others} left out" if others else ""
    )


def _without_calibrated_duplicates(tables: Sequence[SourceTable]) -> list[SourceTable]:
    """Leave out calibrated measurements where the raw ones are there."""
    parts = {table.part for table in tables}
    return [table for table in tables if f"Uncal{table.part}" not in parts]


KIND = ImportKind("recordings of Google's GNSSLogger", (".txt",), _accepts_gnsslogger_file, _read_gnsslogger_tables)
"""The description of this kind."""
