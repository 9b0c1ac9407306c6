"""Google's GNSSLogger for Android: lines that begin with what they are, and remarks that name their columns.

`Fix` lines hold positions by provider; those of GPS are read, else of the fused location. `UncalAccel` and `UncalGyro`
hold the phone's inertial measurements. Source: developer.android.com/develop/sensors-and-location/sensors/gnss.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from cwcli.errors import DataError, InputError
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.delimited import read_delimited
from cwcli.importing.tables import Answers, Preset, SourceTable

WANTED = ("Fix", "UncalAccel", "UncalGyro", "Accel", "Gyro")
"""First cells of the lines that are read."""
PROVIDERS = ("GPS", "gps", "FLP", "fused", "NLP", "network")
"""Providers of positions, the best first."""
_PRESETS = {
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
    rows: dict[str, io.StringIO] = {}
    try:
        with Path(path).open(encoding="utf-8", errors="replace") as file:
            for line in file:
                word, _, rest = line.lstrip("# ").partition(",")
                if line.startswith("#") and word in WANTED:
                    names[word] = rest.strip()
                elif word in WANTED and word in names:
                    rows.setdefault(word, io.StringIO()).write(rest if rest.endswith("\n") else f"{rest}\n")
    except OSError as error:
        raise InputError(f"it can't be read: {error.strerror}", where=path) from error
    if not rows:
        raise DataError("it has no Fix line", where=path, hint="let GNSSLogger record the location, too")
    tables = []
    for word, text in rows.items():
        lines = text.getvalue()
        notes = []
        if word == "Fix":
            lines, said = _rows_of_best_provider_and_note(lines)
            notes.append(said)
        table = read_delimited(path, answers, part=word, data=f"{names[word]}\n{lines}".encode(), kind="gnsslogger")
        tables.append(_with_gnsslogger_presets(table, notes))
    return _without_calibrated_duplicates(tables)


def _with_gnsslogger_presets(table: SourceTable, notes: list[str]) -> SourceTable:
    from dataclasses import replace

    presets = {column: _PRESETS.get(column, Preset("ignored")) for column in table.columns}
    return replace(
        table, presets=presets, is_device_frame=True, attitude_is_of_device=True, notes=[*table.notes, *notes]
    )


def _rows_of_best_provider_and_note(lines: str) -> tuple[str, str]:
    rows = lines.splitlines()
    found = {row.partition(",")[0] for row in rows}
    best = next((name for name in PROVIDERS if name in found), min(found))
    kept = [row for row in rows if row.partition(",")[0] == best]
    others = ", ".join(sorted(found - {best}))
    return "\n".join(kept) + "\n", f"positions of {best}" + (f"; those of {others} left out" if others else "")


def _without_calibrated_duplicates(tables: Sequence[SourceTable]) -> list[SourceTable]:
    """Leave out calibrated measurements where the raw ones are there."""
    parts = {table.part for table in tables}
    return [table for table in tables if f"Uncal{table.part}" not in parts]


KIND = ImportKind("recordings of Google's GNSSLogger", (".txt",), _accepts_gnsslogger_file, _read_gnsslogger_tables)
"""The description of this kind."""
