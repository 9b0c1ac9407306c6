"""u-blox UBX: the navigation solutions NAV-PVT.

A message begins with two sync bytes, has a length and ends with a checksum (u-blox M8 protocol specification, 32). One
whose checksum is wrong, or whose end is missing, is passed over to the next sync bytes.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cwcli.errors import DataError, InputError
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.tables import Answers, Preset, SourceTable
from cwcli.importing.times import MAX_STAMP_NS
from cwcli.signals.columns import BoolArray, Int64Array
from cwcli.signals.units import NS_PER_S

UBX_SYNC_BYTES = b"\xb5\x62"
"""The first two bytes of a UBX message (u-blox M8 protocol specification, 32.2)."""
NAV_PVT_CLASS_AND_NUMBER = b"\x01\x07"
"""Class and number of the message NAV-PVT (u-blox M8 protocol specification, 32.17.14)."""
UBX_MESSAGE_HEAD_STRUCT = struct.Struct("<2s2sH")
"""The beginning of a message: sync bytes, class and number, length of the payload."""
UBX_CHECKSUM_BYTES = 2
"""The number of bytes of the checksum behind the payload."""
NAV_PVT_PAYLOAD_STRUCT = struct.Struct("<4xH5BB4xiBB2x4i8x2i")
"""The used fields of NAV-PVT: year, month, day, hour, minute, second, valid, nano, fixType, flags, longitude, latitude,
height, height above the sea, north and east velocity."""
MIN_NAV_PVT_PAYLOAD_BYTES = 84
"""The least length of NAV-PVT: that of u-blox 7; later receivers send 92 bytes."""
MAX_UBX_MESSAGE_BYTES = UBX_MESSAGE_HEAD_STRUCT.size + 0xFFFF + UBX_CHECKSUM_BYTES
"""The greatest length of a message."""
BYTES_READ_AT_ONCE = 1 << 20
"""Number of bytes that are read at a time, 1 MiB. Chosen by hand."""
DATE_AND_TIME_VALID_FLAG_BITS, FIX_OK_FLAG_BIT = 0b11, 0b1
"""The bits of the fields valid and flags that say that date, time and fix can be used."""
FIX_TYPE_OF_NO_FIX, FIX_TYPE_OF_TIME_ONLY_FIX = 0, 5
"""Values of the field fixType of NAV-PVT that have no position: no fix, and time only (u-blox protocol
specification)."""
PRESET_BY_COLUMN = {
    "time": Preset("time", "ns"),
    "latitude": Preset("latitude", "deg"),
    "longitude": Preset("longitude", "deg"),
    "height": Preset("altitude", "m"),
    "velE": Preset("velocity_east", "mps"),
    "velN": Preset("velocity_north", "mps"),
}
"""Column -> the quantity and unit that the format fixes."""


def _accepts_ubx_file(head: FileHead) -> bool:
    at = head.data.find(UBX_SYNC_BYTES + b"\x01")
    return head.data.startswith(UBX_SYNC_BYTES) or (0 <= at < 4096 and head.text is None)


def _read_ubx_tables(path: str, answers: Answers) -> Sequence[SourceTable]:
    rows, counts = _read_solutions_and_count_skipped(path)
    if not rows:
        skipped = tuple(f"{reason}: {n} messages" for reason, n in counts.items())
        raise DataError(
            "it has no NAV-PVT message with a fix", where=path, found=skipped, hint="let the receiver send NAV-PVT"
        )
    table = np.array(rows, np.float64)
    stamps = np.array([row[0] for row in rows], np.int64)
    columns: dict[str, Any] = {name: table[:, k] for k, name in enumerate(PRESET_BY_COLUMN)}
    columns["time"] = stamps
    notes = [f"{reason}: {n} messages" for reason, n in counts.items()]
    return [SourceTable.of_arrays(path, "NAV-PVT", "ubx", columns, presets=PRESET_BY_COLUMN, notes=notes)]


def _read_solutions_and_count_skipped(path: str) -> tuple[list[tuple[float, ...]], Counter[str]]:
    rows: list[tuple[float, ...]] = []
    counts: Counter[str] = Counter()
    data, is_end = b"", False
    try:
        with Path(path).open("rb") as file:
            while not is_end:
                block = file.read(BYTES_READ_AT_ONCE)
                data, is_end = data + block, not block
                stop = len(data) if is_end else max(len(data) - MAX_UBX_MESSAGE_BYTES, 0)
                payloads, n_damaged, at = _find_solution_payloads_damaged_count_and_next_place(data, stop)
                counts["damaged"] += n_damaged
                for payload in payloads:
                    _append_solution_or_count(rows, counts, payload)
                data = data[at:]
    except OSError as error:
        raise InputError(f"it can't be read: {error.strerror}", where=path) from error
    return rows, +counts


def _find_solution_payloads_damaged_count_and_next_place(data: bytes, stop: int) -> tuple[list[bytes], int, int]:
    """Find the NAV-PVT messages that begin before a place.

    All beginnings are judged at once, so that a file of nothing but sync bytes takes no longer than another.

    Returns:
        The payloads, the number of damaged ones, and the place where the next search must begin.
    """
    octets = np.frombuffer(data, np.uint8).astype(np.int64)
    starts = np.flatnonzero((octets[:-1] == UBX_SYNC_BYTES[0]) & (octets[1:] == UBX_SYNC_BYTES[1]))
    starts = starts[(starts < stop) & (starts + UBX_MESSAGE_HEAD_STRUCT.size <= len(octets))]
    ends = starts + UBX_MESSAGE_HEAD_STRUCT.size + octets[starts + 4] + 256 * octets[starts + 5] + UBX_CHECKSUM_BYTES
    is_solution = (octets[starts + 2] == NAV_PVT_CLASS_AND_NUMBER[0]) & (
        octets[starts + 3] == NAV_PVT_CLASS_AND_NUMBER[1]
    )
    is_solution &= ends - starts >= UBX_MESSAGE_HEAD_STRUCT.size + MIN_NAV_PVT_PAYLOAD_BYTES + UBX_CHECKSUM_BYTES
    is_sound = ends <= len(octets)
    is_sound[is_sound] = _have_right_checksums(octets, starts[is_sound], ends[is_sound])
    damaged = starts[is_solution & ~is_sound]
    payloads, at, n_inside = [], 0, 0
    for start, end, has_position in zip(
        starts[is_sound].tolist(), ends[is_sound].tolist(), is_solution[is_sound].tolist(), strict=True
    ):
        if start < at:  # inside the message before
            continue
        at = end
        if len(damaged):
            n_inside += int(np.searchsorted(damaged, end) - np.searchsorted(damaged, start))
        if has_position:
            payloads.append(data[start + UBX_MESSAGE_HEAD_STRUCT.size : end - UBX_CHECKSUM_BYTES])
    return payloads, len(damaged) - n_inside, max(at, stop)


def _have_right_checksums(octets: Int64Array, starts: Int64Array, ends: Int64Array) -> BoolArray:
    """Tell of each message whether its checksum is right: the 8-bit Fletcher algorithm of RFC 1145, by running sums."""
    sums = np.concatenate([[0], np.cumsum(octets)])
    weighted = np.concatenate([[0], np.cumsum(octets * np.arange(len(octets)))])
    begin, end = starts + len(UBX_SYNC_BYTES), ends - UBX_CHECKSUM_BYTES
    first = sums[end] - sums[begin]
    second = end * first - (weighted[end] - weighted[begin])
    is_right: BoolArray = (first & 0xFF == octets[end]) & (second & 0xFF == octets[end + 1])
    return is_right


def _append_solution_or_count(rows: list[tuple[float, ...]], counts: Counter[str], payload: bytes) -> None:
    year, month, day, hour, minute, second, valid, nano, fix, flags, lon, lat, height, _, north, east = (
        NAV_PVT_PAYLOAD_STRUCT.unpack_from(payload)
    )
    if valid & DATE_AND_TIME_VALID_FLAG_BITS != DATE_AND_TIME_VALID_FLAG_BITS:
        counts["no time"] += 1
        return
    if fix in {FIX_TYPE_OF_NO_FIX, FIX_TYPE_OF_TIME_ONLY_FIX} or not flags & FIX_OK_FLAG_BIT:
        counts["no fix"] += 1
        return
    try:
        days = int(np.datetime64(f"{year:04d}-{month:02d}-{day:02d}", "D").astype(np.int64))
    except ValueError:
        counts["no time"] += 1
        return
    stamp_ns = ((days * 24 + hour) * 3600 + minute * 60 + second) * NS_PER_S + nano
    if not 0 <= stamp_ns <= MAX_STAMP_NS:
        counts["no time"] += 1
        return
    rows.append((stamp_ns, lat / 1e7, lon / 1e7, height / 1e3, east / 1e3, north / 1e3))


KIND = ImportKind("u-blox UBX: NAV-PVT", (".ubx",), _accepts_ubx_file, _read_ubx_tables)
"""How u-blox UBX files are recognised and read, for the table of import formats."""
