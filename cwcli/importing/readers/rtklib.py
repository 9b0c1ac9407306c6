"""Positions of RTKLIB (`.pos`): a line of names behind `%`, rows with a date and a time of day, or a GPS week.

The line of names says the time: GPST, UTC or JST. Source: RTKLIB's manual, appendix B, "Positioning solution file".
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from cwcli.errors import InputError
from cwcli.importing.cells import read_whole_units_fraction_and_validity
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.delimited import TextLayout, iter_text_rows, unique_names
from cwcli.importing.tables import Answers, ColumnsOfRows, Preset, SourceTable
from cwcli.importing.text_file import decode_text_head, no_text_error, read_head
from cwcli.importing.times import (
    MAX_STAMP_NS,
    Instants,
    ns_and_validity_of_text_times,
    parse_text_times,
    utc_ns_from_gps_seconds,
)
from cwcli.signals.gnss_time import GPS_EPOCH_UNIX_S, SECONDS_PER_WEEK
from cwcli.signals.units import NS_PER_S

NAME_LINE_PATTERN = re.compile(r"%\s+(?P<scale>GPST|UTC|JST)\s+(?P<names>\S.*)")
"""The line of names: the time, and the names of the other columns."""
PRESET_BY_COLUMN = {
    "latitude(deg)": Preset("latitude", "deg"),
    "longitude(deg)": Preset("longitude", "deg"),
    "height(m)": Preset("altitude", "m"),
    "vn(m/s)": Preset("velocity_north", "mps"),
    "ve(m/s)": Preset("velocity_east", "mps"),
    "Q": Preset("ignored"),
}
"""Column -> the quantity and unit that the format fixes."""
FIRST_TIME_CELL_NAME, SECOND_TIME_CELL_NAME, JOINED_TIME_COLUMN_NAME = "date or week", "clock or seconds", "time"
"""Names of the two cells of the time, and of the time that is made of them."""
NS_PER_WEEK = SECONDS_PER_WEEK * NS_PER_S
"""Nanoseconds of a GPS week."""
JST_OFFSET_S = 9 * 3600
"""Offset of Japan's time from UTC, s."""


def _line_of_names(lines: Sequence[str]) -> tuple[int, str, list[str]] | None:
    """Return number, time scale and names of the line of names."""
    for k, line in enumerate(lines):
        found = NAME_LINE_PATTERN.match(line)
        if found:
            return k, found["scale"], re.findall(r"\S+(?:\([^)]*\))?", found["names"])
    return None


def _accepts_rtklib_file(head: FileHead) -> bool:
    return _line_of_names(head.lines) is not None


def _read_rtklib_table(path: str, answers: Answers) -> Sequence[SourceTable]:
    head = decode_text_head(read_head(path))
    found = None if head is None else _line_of_names(head.lines)
    if head is None or found is None:
        raise no_text_error(path)
    at, scale, names = found[0], found[1], unique_names(found[2], path)
    if not {"latitude(deg)", "longitude(deg)"} <= set(names):
        kind = "positions from the centre of the earth (ECEF)" if any("ecef" in name for name in names) else "baselines"
        raise InputError(
            f"it has {kind}, no latitude and longitude",
            where=path,
            hint="let RTKLIB write `Lat/Lon/Height` with decimal degrees",
        )
    layout = TextLayout(" ", (FIRST_TIME_CELL_NAME, SECOND_TIME_CELL_NAME, *names), {}, at + 1)
    notes: list[str] = []

    def read_column_batches(columns: Sequence[str]) -> Iterator[ColumnsOfRows]:
        plain = [name for name in columns if name != JOINED_TIME_COLUMN_NAME]
        for batch in iter_text_rows(
            path, head, layout, [*plain, FIRST_TIME_CELL_NAME, SECOND_TIME_CELL_NAME], (path, notes)
        ):
            columns_read = (
                {
                    JOINED_TIME_COLUMN_NAME: _utc_ns_of_time_cells(
                        batch[FIRST_TIME_CELL_NAME], batch[SECOND_TIME_CELL_NAME], scale
                    )
                }
                if JOINED_TIME_COLUMN_NAME in columns
                else {}
            )
            yield {**{name: batch[name] for name in plain}, **columns_read}

    presets = {name: PRESET_BY_COLUMN.get(name, Preset("ignored")) for name in names}
    presets[JOINED_TIME_COLUMN_NAME] = Preset("time", "ns")
    notes.append({"GPST": "GPS time, converted to UTC", "JST": "Japan's time, converted to UTC"}.get(scale, "UTC"))
    return [
        SourceTable(
            path, "", "rtklib", (JOINED_TIME_COLUMN_NAME, *names), read_column_batches, presets=presets, notes=notes
        )
    ]


def _utc_ns_of_time_cells(first: Any, second: Any, scale: str) -> Any:
    """Return UTC in ns since 1970 of dates and clocks, or of weeks and seconds: an Arrow array (n,), with nulls."""
    import pyarrow as pa
    import pyarrow.compute as pc

    times = parse_text_times(pc.binary_join_element_wise(first, second, " "))
    if times is not None:
        ns, valid = ns_and_validity_of_text_times(times, "ymd", "")
        gps_ns = ns - GPS_EPOCH_UNIX_S * NS_PER_S
    else:
        week = Instants(*read_whole_units_fraction_and_validity(first, "."))
        seconds = Instants(*read_whole_units_fraction_and_validity(second, "."))
        valid = week.valid & seconds.valid & (week.whole >= 0) & (week.whole <= MAX_STAMP_NS // NS_PER_WEEK)
        gps_ns = np.where(valid, week.whole, 0) * NS_PER_WEEK + seconds.to_ns("s")
        ns = gps_ns + GPS_EPOCH_UNIX_S * NS_PER_S
    if scale == "GPST":
        ns = utc_ns_from_gps_seconds(gps_ns, None)
    elif scale == "JST":
        ns = ns - JST_OFFSET_S * NS_PER_S
    return pa.array(ns, mask=~valid)


KIND = ImportKind("positions of RTKLIB", (".pos",), _accepts_rtklib_file, _read_rtklib_table)
"""The description of this kind."""
