"""u-blox UBX: the navigation solutions NAV-PVT, read by `pyubx2`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cwcli.errors import DataError, InputError, UsageError, install_hint
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.tables import Answers, Batch, Preset, SourceTable
from cwcli.signals.units import NS_PER_S

SYNC = b"\xb5\x62"
"""The first two bytes of a UBX message (u-blox protocol specification)."""
LAST_FIX_WITHOUT_POSITION, TIME_ONLY_FIX = 0, 5
"""Values of the field fixType of NAV-PVT that have no position: no fix, and time only (u-blox protocol
specification)."""
PRESETS = {
    "time": Preset("time", "ns"),
    "latitude": Preset("latitude", "deg"),
    "longitude": Preset("longitude", "deg"),
    "height": Preset("altitude", "m"),
    "velE": Preset("velocity_east", "mps"),
    "velN": Preset("velocity_north", "mps"),
}
"""Column -> the quantity and unit that the format fixes."""


def _accepts_ubx_file(head: FileHead) -> bool:
    at = head.data.find(SYNC + b"\x01")
    return head.data.startswith(SYNC) or (0 <= at < 4096 and head.text is None)


def _read_ubx_tables(path: str, answers: Answers) -> Sequence[SourceTable]:
    rows, counts = _read_solutions_and_count_skipped(path)
    if not rows:
        raise DataError("it has no NAV-PVT message with a fix", where=path, hint="let the receiver send NAV-PVT")
    table = np.array(rows, np.float64)
    stamps = np.array([row[0] for row in rows], np.int64)
    columns: dict[str, Any] = {name: table[:, k] for k, name in enumerate(PRESETS)}
    columns["time"] = stamps
    notes = [f"{reason}: {n} messages" for reason, n in counts.items() if n]

    def read(wanted: Sequence[str]) -> Iterator[Batch]:
        yield {name: columns[name] for name in wanted}

    return [SourceTable(path, "NAV-PVT", "ubx", tuple(PRESETS), read, presets=PRESETS, notes=notes)]


def _read_solutions_and_count_skipped(path: str) -> tuple[list[tuple[float, ...]], dict[str, int]]:
    try:
        from pyubx2 import ERR_IGNORE, UBX_PROTOCOL, UBXReader
    except ImportError as error:
        raise UsageError("UBX files need pyubx2", hint=install_hint("import")) from error
    rows: list[tuple[float, ...]] = []
    counts = {"no fix": 0, "no time": 0, "damaged": 0}
    try:
        with Path(path).open("rb") as file:
            reader = UBXReader(file, protfilter=UBX_PROTOCOL, quitonerror=ERR_IGNORE)
            for _, message in reader:
                if message is None:
                    counts["damaged"] += 1
                elif message.identity == "NAV-PVT":
                    _append_solution_or_count(rows, counts, message)
    except OSError as error:
        raise InputError(f"it can't be read: {error.strerror}", where=path) from error
    except Exception as error:
        if not rows:
            raise InputError(f"the UBX file is damaged: {error}", where=path) from error
        counts["damaged"] += 1
    return rows, counts


def _append_solution_or_count(rows: list[tuple[float, ...]], counts: dict[str, int], message: Any) -> None:
    if not (message.validDate and message.validTime):
        counts["no time"] += 1
        return
    if message.fixType in {LAST_FIX_WITHOUT_POSITION, TIME_ONLY_FIX} or not message.gnssFixOk:
        counts["no fix"] += 1
        return
    try:
        day = np.datetime64(f"{message.year:04d}-{message.month:02d}-{message.day:02d}", "D").astype(np.int64)
    except ValueError:
        counts["no time"] += 1
        return
    seconds = (int(day) * 24 + message.hour) * 3600 + message.min * 60 + message.second
    stamp_ns = seconds * NS_PER_S + message.nano
    rows.append((stamp_ns, message.lat, message.lon, message.height / 1e3, message.velE / 1e3, message.velN / 1e3))


KIND = ImportKind("u-blox UBX: NAV-PVT (needs pyubx2)", (".ubx",), _accepts_ubx_file, _read_ubx_tables)
"""How u-blox UBX files are recognised and read, for the table of import formats."""
