"""Phone recordings as a zip, or as one of its tables: Sensor Logger and phyphox.

Sensor Logger: `Location.csv`, `Accelerometer.csv`, `Gyroscope.csv` with times in ns since 1970 (column `time`).
phyphox: the same names with `Time (s)` from the start, which `meta/time.csv` dates.

What a phone's `Accelerometer` measures differs: of Sensor Logger it is without gravity, and `TotalAcceleration` or
`AccelerometerUncalibrated` has it; of phyphox it has it. Sensor Logger on iOS writes accelerations with Apple's sign,
down at rest, and the uncalibrated ones in g, unless it was told to standardise them (UNITS.md and CROSSPLATFORM.md of
github.com/tszheichoi/awesome-sensor-logger).
"""

from __future__ import annotations

import csv
import io
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from lzma import LZMAError
from typing import Any

import numpy as np

from cwcli.errors import DataError, InputError, UsageError
from cwcli.importing.cells import read_number_cells_and_count_bad, read_whole_units_fraction_and_validity
from cwcli.importing.names import split_name
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.delimited import read_delimited_table
from cwcli.importing.tables import Answers, ColumnsOfRows, Preset, SourceTable
from cwcli.importing.times import MAX_STAMP_NS, parse_start_ns
from cwcli.text import format_count

MAX_UNPACKED_TABLE_BYTES = 256 << 20
"""Largest table in a zip that is unpacked: 256 MiB, five hours of 100 rows a second."""
MAX_TABLES_READ_FROM_ZIP = 20
"""Largest number of tables of a zip that are read; apps write one for each sensor. Chosen by hand."""
MAX_UNPACKED_TO_ZIPPED_SIZE_RATIO = 200
"""Largest ratio of a table's size to that in the zip: text of numbers has less than 20."""
MAX_FILES_IN_ZIP = 1000
"""Largest number of files in a zip. Chosen by hand; not fitted."""
POSITION_TABLES = ("location", "locationgps", "gps", "locationnetwork")
"""Tables of positions, the best first."""
ACCELERATION_TABLES = ("totalacceleration", "accelerometeruncalibrated", "accelerometer", "acceleration")
"""Tables of accelerations, those with gravity first."""
TURN_RATE_TABLES = ("gyroscope", "gyroscopeuncalibrated")
"""Tables of turn rates, the best first."""
_SENSOR_LOGGER_PRESETS = {
    "time": Preset("time", "ns"),
    "latitude": Preset("latitude", "deg"),
    "longitude": Preset("longitude", "deg"),
    "altitude": Preset("altitude", "m"),
    "speed": Preset("speed", "mps"),
    "bearing": Preset("course", "deg-cw-north"),
}


def _accepts_phone_archive_file(head: FileHead) -> bool:
    return head.data.startswith((b"PK\x03\x04", b"PK\x05\x06"))


def _read_phone_archive_tables(path: str, answers: Answers) -> Sequence[SourceTable]:
    try:
        with zipfile.ZipFile(path) as archive:
            members = _archive_members_by_table_name(archive, path)
            table_names = _names_of_tables_to_read(members)
            if not table_names:
                shown = tuple(sorted(members))[:30]
                raise DataError("it holds no table of positions, accelerations or turn rates", where=path, found=shown)
            _require_bounded_total(members, table_names, path)
            texts = {name: _unpack_archive_member(archive, members[name], path) for name in table_names}
            start, about_phone = (
                next(
                    (
                        _unpack_archive_member(archive, info, path)
                        for info in archive.infolist()
                        if info.filename.lower().endswith(name)
                    ),
                    b"",
                )
                for name in ("meta/time.csv", "metadata.csv")
            )
    except (zipfile.BadZipFile, zlib.error, LZMAError, OSError, ValueError, RuntimeError, EOFError) as error:
        raise InputError(f"the zip is damaged: {error}", where=path) from error
    sources = {
        name: read_delimited_table(path, answers, part=members[name].filename, data=data, kind="phone")
        for name, data in texts.items()
        if data.count(b"\n") >= 2
    }
    _add_gravity_to_accelerations(sources)
    is_of_apple = _are_accelerations_of_apple(about_phone)
    tables = [
        replace(with_phone_units_and_time_base(table, name, start), has_accelerations_of_other_sign=is_of_apple)
        for name, table in sources.items()
    ]
    if not tables and texts.get("accelerometer", b"").count(b"\n") >= 2:
        raise DataError(
            "it holds no more than accelerations without gravity, which show no vertical",
            where=path,
            hint="record the location, too, and the gyroscope and the total acceleration, or gravity",
        )
    if not tables:
        raise InputError("its tables have no rows", where=path)
    has_position = any(table.part and lower_case_name_of_table_file(table.part) in POSITION_TABLES for table in tables)
    if not has_position:
        tables[0].notes.append("the recording has no location")
    return tables


def _are_accelerations_of_apple(data: bytes) -> bool:
    """Tell whether the metadata of a recording of Sensor Logger say that its accelerations have Apple's sign."""
    try:
        row = next(csv.DictReader(io.StringIO(data.decode("utf-8", "replace"))), {})
    except csv.Error:
        return False
    platform, is_standard = (str(row.get(name) or "").strip().lower() for name in ("platform", "standardisation"))
    return platform == "ios" and is_standard != "true"


def lower_case_name_of_table_file(name: str) -> str:
    base = name.rpartition("/")[2].rpartition(".")[0] or name
    return "".join(character for character in base.lower() if character.isalnum())


def _archive_members_by_table_name(archive: zipfile.ZipFile, path: str) -> dict[str, zipfile.ZipInfo]:
    """Return the tables by their names without case, blanks and folders.

    Raises:
        InputError: There are too many files, or one unpacks to too much.
    """
    infos = [info for info in archive.infolist() if not info.is_dir()]
    if len(infos) > MAX_FILES_IN_ZIP:
        raise InputError(f"the zip holds {len(infos)} files; recordings of phones hold few", where=path)
    tables = {
        lower_case_name_of_table_file(info.filename): info
        for info in infos
        if info.filename.lower().endswith((".csv", ".tsv", ".txt")) and "__MACOSX" not in info.filename
    }
    return {name: info for name, info in tables.items() if "/meta/" not in f"/{info.filename}"}


def _names_of_tables_to_read(members: dict[str, zipfile.ZipInfo]) -> list[str]:
    """Return the names of the tables to read: one of positions, one of accelerations, one of turn rates."""
    table_names = []
    for choices in (POSITION_TABLES, ACCELERATION_TABLES, TURN_RATE_TABLES):
        table_names += [name for name in choices if name in members][:1]
    if "accelerometer" in table_names and "gravity" in members:
        table_names.append("gravity")
    if not table_names:  # a zip of other tables
        table_names = [name for name in members if not name.startswith(("metadata", "annotation", "device"))]
    return table_names


def _require_bounded_total(members: dict[str, zipfile.ZipInfo], names: list[str], path: str) -> None:
    """Check that the tables are together no more than a recording.

    Raises:
        InputError: They are.
    """
    n_bytes = sum(members[name].file_size for name in names)
    if len(names) > MAX_TABLES_READ_FROM_ZIP or n_bytes > MAX_UNPACKED_TABLE_BYTES:
        raise InputError(
            f"{format_count(len(names), 'table')} unpack to {n_bytes / 1e6:,.0f} MB: it is no recording of a phone",
            where=path,
            hint=f"unpack it, and import at most {MAX_TABLES_READ_FROM_ZIP} tables",
        )


def _add_gravity_to_accelerations(sources: dict[str, SourceTable]) -> None:
    """Add the table of gravity to Sensor Logger's accelerations without it, where they have the same rows.

    Accelerations that can't be completed so are left out: without gravity they show no vertical.
    """
    gravity, linear = sources.pop("gravity", None), sources.get("accelerometer")
    if linear is None or not {"time", "seconds_elapsed", "x", "y", "z"} <= set(linear.columns):
        return
    del sources["accelerometer"]
    if gravity is None or not {"time", "x", "y", "z"} <= set(gravity.columns):
        return
    first, second = _stamps_and_axis_columns_of_table(linear), _stamps_and_axis_columns_of_table(gravity)
    if not np.array_equal(first["time"], second["time"]):
        return
    total = {axis: first[axis] + second[axis] for axis in "xyz"} | {"time": first["time"]}

    def read_column_batches(columns: Sequence[str]) -> Iterator[ColumnsOfRows]:
        yield {name: total[name] for name in columns}

    part = f"{linear.part} with {gravity.part}"
    sources["totalacceleration"] = replace(linear, part=part, columns=tuple(total), read_batches=read_column_batches)


def _stamps_and_axis_columns_of_table(table: SourceTable) -> dict[str, Any]:
    """Return the times in ns and the numbers of three axes of a table, (n,) each."""
    columns: dict[str, list[Any]] = {name: [] for name in ("time", "x", "y", "z")}
    for batch in table.read_batches(list(columns)):
        columns["time"].append(read_whole_units_fraction_and_validity(batch["time"], ".")[0])
        for axis in "xyz":
            columns[axis].append(read_number_cells_and_count_bad(batch[axis], ".")[0])
    return {name: np.concatenate(pieces) for name, pieces in columns.items()}


def _unpack_archive_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, path: str) -> bytes:
    """Return the bytes of a member.

    Raises:
        InputError: It unpacks to more than a recording does.
    """
    too_large = info.file_size > MAX_UNPACKED_TABLE_BYTES or info.file_size > MAX_UNPACKED_TO_ZIPPED_SIZE_RATIO * max(
        info.compress_size, 4096
    )
    if too_large:
        raise InputError(
            f"{info.filename} unpacks to {info.file_size / 1e6:,.0f} MB: it is not a recording", where=path
        )
    with archive.open(info) as file:
        data = file.read(info.file_size + 1)
    if len(data) > info.file_size:
        raise InputError(f"{info.filename} unpacks to more than the zip says", where=path)
    return data


def with_phone_units_and_time_base(table: SourceTable, name: str, start: bytes) -> SourceTable:
    """Return a table with what the apps fix: units, time base, gravity."""
    columns = set(table.columns)
    is_sensor_logger = {"time", "seconds_elapsed"} <= columns or name == "totalacceleration"
    presets: dict[str, Preset] = {}
    if is_sensor_logger:
        if name in POSITION_TABLES:
            presets = {column: _SENSOR_LOGGER_PRESETS.get(column, Preset("ignored")) for column in table.columns}
        else:
            kind, unit = ("gyro", "radps") if name in TURN_RATE_TABLES else ("accel", "mps2")
            unit = "" if name == "accelerometeruncalibrated" else unit  # gravity shows whether it is g or m/s^2
            presets = {axis: Preset(f"{kind}_{axis}", unit) for axis in "xyz"} | {"time": Preset("time", "ns")}
            presets |= {column: Preset("ignored") for column in columns if column not in presets}
        return replace(table, kind="sensor logger", presets=presets, is_device_frame=True, attitude_is_of_device=True)
    for column in table.columns:
        words = split_name(column).words
        if len(words) == 1 and words[0] in {"x", "y", "z"} and name in {*ACCELERATION_TABLES, *TURN_RATE_TABLES}:
            kind, unit = ("gyro", "radps") if name in TURN_RATE_TABLES else ("accel", "mps2")
            presets[column] = Preset(f"{kind}_{words[0]}", unit)
        elif name in POSITION_TABLES and words[:1] == ("velocity",):
            presets[column] = Preset("speed", "mps")
        elif name in POSITION_TABLES and words[:1] == ("direction",):
            presets[column] = Preset("course", "deg-cw-north")
        elif "absolute" in words or "accuracy" in words or "satellites" in words:
            presets[column] = Preset("ignored")
    return replace(
        table,
        kind="phyphox",
        presets=presets,
        is_device_frame=True,
        attitude_is_of_device=True,
        start_ns=_phyphox_start_ns(start),
    )


def is_phone_recording_table(table: SourceTable) -> bool:
    """Tell whether a table is one of a recording of Sensor Logger or phyphox, by its columns and its name."""
    columns = set(table.columns)
    if {"time", "seconds_elapsed"} <= columns:
        return lower_case_name_of_table_file(table.file) in {*POSITION_TABLES, *ACCELERATION_TABLES, *TURN_RATE_TABLES}
    return "Time (s)" in columns and any(
        name.startswith(("Acceleration x (", "Linear Acceleration x (", "Gyroscope x (", "Latitude (°)"))
        for name in columns
    )


def _phyphox_start_ns(data: bytes) -> int | None:
    """Return the system time of the experiment's zero; None where it is not told, or pauses make it unclear."""
    if not data:
        return None
    text = data.decode("utf-8", "replace")
    mark = next((each for each in (";", "\t") if each in text.partition("\n")[0]), ",")
    rows = list(csv.DictReader(io.StringIO(text if mark == "," else text.replace(",", ".")), delimiter=mark))
    starts = [row for row in rows if (row.get("event") or "").upper() == "START"]
    try:
        first = starts[0]
        system_s = parse_start_ns(str(first["system time"]))
        start_ns = system_s - round(float(first["experiment time"]) * 1e9)
    except (IndexError, KeyError, ValueError, OverflowError, UsageError):
        return None
    return start_ns if 0 <= start_ns <= MAX_STAMP_NS else None


KIND = ImportKind(
    "phone recordings of Sensor Logger and phyphox, as a zip",
    (".zip",),
    _accepts_phone_archive_file,
    _read_phone_archive_tables,
)
"""The description of this kind."""
