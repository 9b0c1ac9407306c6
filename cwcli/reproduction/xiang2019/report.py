"""The reproduction of xiang2019 as a summary for people, a table for programs, and what must not be worse."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cwcli.metrics.table import ColumnDoc
from cwcli.metrics.table import Table as MetricsTable
from cwcli.pipeline.result import Cell, Section, Summary
from cwcli.reproduction.xiang2019.reproduce import Table, reproduce
from cwcli.reproduction.xiang2019.sentences import exit_note, shortfalls, verdict

TITLES = {
    "figure_6": "Figures 5 and 6: error of the distance (paper: both together below 0.01 m)",
    "looks": "How many looks of each sensor bring the error at 4.90 m to the paper's 0.01 m",
    "table_1": "Table 1: mean square error in per mille of a square metre",
    "settings": "Table 1 with other process noises",
    "table_2": "Table 2: time of 500 samples, inside the process",
    "where": "EKF and UKF elsewhere: radar alone, near and far, narrow and wide beams",
}
LABELS = {
    "figure_6": ("range_m",),
    "looks": ("looks",),
    "table_1": ("segment", "axis"),
    "settings": ("process_noise",),
    "table_2": ("filter",),
    "where": ("scene", "azimuth_sigma_deg"),
}
"""The columns that name a row."""
SHOWN: dict[str, dict[str, str]] = {
    "figure_6": {
        "range_m": "range [m]",
        "lidar_error_m": "lidar [m]",
        "radar_error_m": "radar [m]",
        "combined_error_m": "both [m]",
        "combined_low_m": "95 % from",
        "combined_high_m": "to",
        "lidar_gain_pct": "lidar gain [%]",
        "radar_gain_pct": "radar gain [%]",
    },
    "table_1": {
        "segment": "segment",
        "axis": "axis",
        "ekf": "EKF",
        "ukf": "UKF",
        "difference": "EKF - UKF",
        "difference_low": "95 % from",
        "difference_high": "to",
        "paper_ekf": "paper EKF",
        "paper_ukf": "paper UKF",
    },
    "where": {
        "scene": "scene",
        "azimuth_sigma_deg": "sigma [deg]",
        "bend": "bend",
        "ekf_rmse_m": "EKF [m]",
        "ukf_rmse_m": "UKF [m]",
        "gain_pct": "gain [%]",
        "gain_low_pct": "95 % from",
        "gain_high_pct": "to",
    },
}
"""What the terminal shows, with its headings; of the other tables all columns."""


@dataclass(frozen=True)
class Report:
    """What came out.

    Attributes:
        summary: For people and `--json`.
        table: Every number: figure, row, quantity, value; `text` where the value is a word.
        failed: What is worse than the paper's and makes the exit code 1, one line each.
    """

    summary: Summary
    table: MetricsTable
    failed: tuple[str, ...]


def report_xiang2019(n_seeds: int = 1000, tick: Callable[[str], None] = lambda what: None) -> Report:
    """Run the whole study. 1,000 seeds take about half a minute. `tick` is called with the name of each part."""
    tables = reproduce(n_seeds, progress=tick)
    worse = shortfalls(tables)
    sections = [_section(name, tables[name]) for name in TITLES]
    findings: tuple[tuple[Cell, ...], ...] = tuple((text,) for text in verdict(tables))
    sections.append(Section("verdict", "Does the UKF beat the EKF?", ("finding",), findings))
    others = [f"worse than the paper's, without a say in the exit code: {line}" for line in worse.others]
    notes = (f"{n_seeds} paired seeds", *others, exit_note(worse))
    return Report(Summary("reproduce xiang2019", tuple(sections), (), notes), _table(tables), worse.deciding)


def _section(name: str, table: Table) -> Section:
    shown = SHOWN.get(name, {column: column.replace("_", " ") for column in table})
    rows: list[tuple[Cell, ...]] = [tuple(cells) for cells in zip(*(table[column] for column in shown), strict=True)]
    return Section(name, TITLES[name], tuple(shown.values()), tuple(rows))


def _table(tables: dict[str, Table]) -> MetricsTable:
    """All tables in long form."""
    rows: list[tuple[str, str, str, float, str]] = []
    for name, table in tables.items():
        labels = LABELS[name]
        for k in range(len(table[labels[0]])):
            row = " ".join(_text(table[label][k]) for label in labels)
            for column, cells in table.items():
                if column not in labels:
                    cell = cells[k]
                    is_text = isinstance(cell, str)
                    rows.append((name, row, column, math.nan if is_text else float(cell), str(cell) if is_text else ""))
    figure, label, quantity, value, text = zip(*rows, strict=True)
    return MetricsTable(
        "xiang2019",
        {
            "figure": list(figure),
            "row": list(label),
            "quantity": list(quantity),
            "value": np.array(value, np.float64),
            "text": list(text),
        },
        docs={"value": ColumnDoc(doc="in the unit that the quantity's name ends with; table_1 in m^2 / 1000")},
    )


def _text(cell: float | str) -> str:
    return cell if isinstance(cell, str) else f"{cell:g}"
