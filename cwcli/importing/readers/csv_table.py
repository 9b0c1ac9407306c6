"""CSV and TSV of any program: GNSS loggers, CAN tools, vehicle data; and cwcli's own tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.delimited import read_delimited_table
from cwcli.importing.readers.phone import (
    is_phone_recording_table,
    lower_case_name_of_table_file,
    with_phone_units_and_time_base,
)
from cwcli.importing.readers.ros_paths import with_presets_if_ros_messages
from cwcli.importing.tables import Answers, Preset, SourceTable

COLUMNS_OF_EXPORTED_STATES = frozenset(
    {"log_time_ns", "stamp_ns", "heading_rad", "speed_mps", "yaw_rate_radps", "x_m", "y_m"}
)
"""Columns that every exported table of states has."""
_PRESETS = {
    "stamp_ns": Preset("time", "ns"),
    "log_time_ns": Preset("ignored"),
    "latitude_deg": Preset("latitude", "deg"),
    "longitude_deg": Preset("longitude", "deg"),
    "x_m": Preset("x", "m"),
    "y_m": Preset("y", "m"),
    "speed_mps": Preset("speed", "mps"),
    "heading_rad": Preset("heading", "rad-ccw-east"),
    "yaw_rate_radps": Preset("yaw_rate", "radps"),
}


def with_presets_if_cwcli_table(table: SourceTable) -> SourceTable:
    """Return the table with the meaning of its columns, if cwcli wrote it."""
    if not set(table.columns) >= COLUMNS_OF_EXPORTED_STATES:
        return table
    return replace(
        table, kind="cwcli table", presets={name: each for name, each in _PRESETS.items() if name in table.columns}
    )


def _accepts_csv_file(head: FileHead) -> bool:
    return head.text is not None


def _read_csv_as_table(path: str, answers: Answers) -> Sequence[SourceTable]:
    table = with_presets_if_ros_messages(with_presets_if_cwcli_table(read_delimited_table(path, answers)))
    if is_phone_recording_table(table):
        return [with_phone_units_and_time_base(table, lower_case_name_of_table_file(path), b"")]
    return [table]


KIND = ImportKind(
    "CSV and TSV of any program, with a line of names",
    (".csv", ".tsv", ".txt"),
    _accepts_csv_file,
    _read_csv_as_table,
)
"""The description of this kind."""
