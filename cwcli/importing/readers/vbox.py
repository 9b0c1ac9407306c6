"""Racelogic's VBOX files (`.vbo`), which race loggers write, too: sections in brackets, rows behind `[data]`.

Positions are minutes, longitudes count to the west, times of day are UTC as hhmmss.ss, and the first line holds the
date. Source: Racelogic, "VBO file format".
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from cwcli.errors import DataError
from cwcli.importing.cells import read_number_cells_and_count_bad, read_whole_units_fraction_and_validity
from cwcli.importing.names import quantities_of_name
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.delimited import TextLayout, iter_text_rows, unique_names
from cwcli.importing.tables import Answers, ColumnsOfRows, Preset, SourceTable
from cwcli.importing.text_file import decode_text_head, no_text_error, read_head
from cwcli.importing.times import Instants, parse_start_ns, times_of_day_from_digits
from cwcli.importing.units import find_unit
from cwcli.signals.units import NS_PER_DAY, NS_PER_S

DATE_LINE_PATTERN = re.compile(r"File created on (\d{1,2})/(\d{1,2})/(\d{4})")
"""The first line; the day comes first."""
ACCEPTED_YEARS_OF_DATE = range(1970, 2100)
"""Years that a date can have. Chosen by hand."""
QUANTITY_AND_SIGN_BY_MINUTES_COLUMN = {
    "lat": ("latitude", 1.0),
    "latitude": ("latitude", 1.0),
    "long": ("longitude", -1.0),
    "longitude": ("longitude", -1.0),
}
"""Column of minutes -> its quantity, and 1, or -1 as longitudes count to the west."""
SPEED_UNIT_BY_HEADER_WORD = {"": "kmh", "kmh": "kmh", "mph": "mph", "knots": "knots", "kts": "knots"}
"""Word behind `velocity` in the header -> unit; without one it is km/h."""


def _accepts_vbox_file(head: FileHead) -> bool:
    return "[column names]" in head.lines and "[data]" in head.lines


def _lines_of_section(lines: Sequence[str], name: str) -> list[str]:
    """Return the lines of a section that are not empty."""
    if name not in lines:
        return []
    rest = lines[lines.index(name) + 1 :]
    return [
        line for line in rest[: next((k for k, each in enumerate(rest) if each.startswith("[")), len(rest))] if line
    ]


def _read_vbox_table(path: str, answers: Answers) -> Sequence[SourceTable]:
    head = decode_text_head(read_head(path))
    if head is None:
        raise no_text_error(path)
    lines = [line.strip() for line in head.lines]
    names = unique_names(" ".join(_lines_of_section(lines, "[column names]")[:1]).split(), path)
    if "time" not in names:
        raise DataError("its columns have no time", where=path, found=names)
    layout = TextLayout(" ", names, {}, lines.index("[data]") + 1)
    day_ns, notes = _day_and_notes(lines, answers)
    last_ns = [0, 0]  # time of day of the last row, and the midnights before it

    def read_column_batches(columns: Sequence[str]) -> Iterator[ColumnsOfRows]:
        last_ns[:] = [0, 0]
        for batch in iter_text_rows(path, head, layout, list(columns), (path, notes)):
            columns_read: dict[str, object] = {}
            for name in columns:
                if name == "time":
                    columns_read[name] = _utc_ns_of_clock_cells(batch[name], day_ns, last_ns)
                elif name in QUANTITY_AND_SIGN_BY_MINUTES_COLUMN:
                    columns_read[name] = (
                        read_number_cells_and_count_bad(batch[name], ".")[0]
                        / 60.0
                        * QUANTITY_AND_SIGN_BY_MINUTES_COLUMN[name][1]
                    )
                else:
                    columns_read[name] = batch[name]
            yield columns_read

    presets = {"time": Preset("time", "ns")}
    presets |= {
        name: Preset(QUANTITY_AND_SIGN_BY_MINUTES_COLUMN[name][0], "deg")
        for name in names
        if name in QUANTITY_AND_SIGN_BY_MINUTES_COLUMN
    }
    speed = next((line for line in _lines_of_section(lines, "[header]") if line.startswith("velocity")), "")
    unit = SPEED_UNIT_BY_HEADER_WORD.get(speed.removeprefix("velocity").strip(" []()").replace("/", ""), "")
    presets |= {"velocity": Preset("speed", unit or find_unit(speed.removeprefix("velocity"), "speed"))}
    presets |= {"heading": Preset("course", "deg-cw-north"), "height": Preset("altitude", "m")}
    present_presets = {name: each for name, each in presets.items() if name in names}
    others = {name: Preset("ignored") for name in names if name not in present_presets and quantities_of_name(name)}
    return [
        SourceTable(path, "", "vbox", names, read_column_batches, presets={**others, **present_presets}, notes=notes)
    ]


def _day_and_notes(lines: Sequence[str], answers: Answers) -> tuple[int, list[str]]:
    """Return midnight of the first day in ns since 1970, and what to say about it."""
    if answers.start:
        return parse_start_ns(answers.start) // NS_PER_DAY * NS_PER_DAY, ["on the day of --start"]
    found = next((each for line in lines[:5] if (each := DATE_LINE_PATTERN.search(line))), None)
    if found is None:
        return 0, ["the file has no date: stamps count from midnight (--start names the day)"]
    day, month, year = (int(each) for each in found.groups())
    try:
        first = datetime(year if year in ACCEPTED_YEARS_OF_DATE else 0, month, day, tzinfo=UTC)
    except ValueError:
        return 0, [f"{found[0]!r} is no date: stamps count from midnight (--start names the day)"]
    return round(first.timestamp()) * NS_PER_S, [f"the date is that of {found[0]!r}"]


def _utc_ns_of_clock_cells(array: Any, day_ns: int, last_ns: list[int]) -> Any:
    """Return ns since 1970 as an Arrow array (n,), null where there is no time of day; remembers the last row."""
    import pyarrow as pa

    instants = Instants(*read_whole_units_fraction_and_validity(array, "."))
    whole = instants.whole
    is_clock = instants.valid & (whole >= 0) & (whole < 240_000) & (whole // 100 % 100 < 60) & (whole % 100 <= 60)
    times = times_of_day_from_digits(replace(instants, valid=is_clock))
    if times is None:
        return pa.nulls(len(array), pa.int64())
    ns = times.ns_of_day[is_clock]
    n_midnights = last_ns[1] + np.cumsum(np.diff(ns, prepend=last_ns[0]) < -NS_PER_DAY // 2)
    last_ns[:] = [int(ns[-1]), int(n_midnights[-1])]
    stamps = np.zeros(len(array), np.int64)
    stamps[is_clock] = day_ns + ns + n_midnights * NS_PER_DAY
    return pa.array(stamps, mask=~is_clock)


KIND = ImportKind("VBOX files of race loggers", (".vbo",), _accepts_vbox_file, _read_vbox_table)
"""The description of this kind."""
