"""EuRoC and ASL files: the `data.csv` of a ground truth (`p_RS_R_x [m]`) and of an IMU (`w_RS_S_x [rad s^-1]`).

Source: Burri et al., The EuRoC micro aerial vehicle datasets, IJRR 2016; docs of the ASL dataset format.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.delimited import read_delimited_table
from cwcli.importing.tables import Answers, Preset, SourceTable

_PRESET_BY_COLUMN = {
    "timestamp": Preset("time", "ns"),
    **{f"p_RS_R_{axis}": Preset(axis, "m") for axis in "xyz"},
    **{f"q_RS_{axis}": Preset(f"quaternion_{axis}") for axis in "xyzw"},
    **{f"w_RS_S_{axis}": Preset(f"gyro_{axis}", "radps") for axis in "xyz"},
    **{f"a_RS_S_{axis}": Preset(f"accel_{axis}", "mps2") for axis in "xyz"},
}
_IGNORED_COLUMNS = ("v_RS_R_", "b_w_RS_S_", "b_a_RS_S_")
"""Velocities in the axes of the world and biases: not read."""


def _accepts_euroc_file(head: FileHead) -> bool:
    first = head.lines[0] if head.lines else ""
    return first.startswith("#") and "timestamp" in first and any(name in first for name in ("p_RS_R_x", "w_RS_S_x"))


def _read_euroc_tables(path: str, answers: Answers) -> Sequence[SourceTable]:
    table = read_delimited_table(path, answers, kind="euroc")
    presets = {}
    for column in table.columns:
        name = column.split("[")[0].strip()
        if name in _PRESET_BY_COLUMN:
            presets[column] = _PRESET_BY_COLUMN[name]
        elif name.startswith(_IGNORED_COLUMNS):
            presets[column] = Preset("ignored")
    return [replace(table, presets=presets)]


KIND = ImportKind("EuRoC and ASL: ground truth and IMU", (".csv",), _accepts_euroc_file, _read_euroc_tables)
"""The description of this kind."""
