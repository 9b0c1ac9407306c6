"""Tables that `cwcli export` wrote: their names fix quantity, unit and sense."""

from __future__ import annotations

from dataclasses import replace

from cwcli.importing.tables import Preset, SourceTable

OWN_COLUMNS = frozenset({"log_time_ns", "stamp_ns", "heading_rad", "speed_mps", "yaw_rate_radps", "x_m", "y_m"})
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
    if not set(table.columns) >= OWN_COLUMNS:
        return table
    return replace(
        table, kind="cwcli table", presets={name: each for name, each in _PRESETS.items() if name in table.columns}
    )
