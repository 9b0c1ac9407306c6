"""The reproduction of xiang2019: its numbers beside the paper's, its tables and figures, and the verdict in words."""

from __future__ import annotations

from cwcli.pipeline.result import Cell, SummaryTable
from cwcli.reproduction.findings import StudyPart
from cwcli.reproduction.findings_report import PROCESSOR_TIMES_SECTION_KEY, Reproduction, assemble_reproduction
from cwcli.reproduction.request import ReproductionRequest
from cwcli.reproduction.xiang2019.figures import (
    distance_errors_plot,
    filter_tracks_part,
    measured_numbers_of_tables,
    sensor_looks_plot,
)
from cwcli.reproduction.xiang2019.reproduce import Table, compute_tables
from cwcli.reproduction.xiang2019.sentences import ukf_against_ekf_sentences

TABLE_TITLES = {
    "figure_6": "Figures 5 and 6: error of the distance (paper: both together below 0.01 m)",
    "looks": "How many looks of each sensor bring the error at 4.90 m to the paper's 0.01 m",
    "table_1": "Table 1: mean square error in per mille of a square metre",
    "settings": "Table 1 with other process noises",
    "table_2": "Table 2: time of 500 samples on this machine, which is no class",
    "where": "EKF and UKF elsewhere: radar alone, near and far, narrow and wide beams",
}
"""Table -> its title on the terminal."""
SHOWN_COLUMNS: dict[str, dict[str, str]] = {
    "figure_6": {
        "range_m": "range [m]",
        "lidar_error_m": "lidar [m]",
        "radar_error_m": "radar [m]",
        "combined_error_m": "both [m]",
        "combined_low_m": "95 % from",
        "combined_high_m": "to",
        "lidar_gain_pct": "lidar [%]",
        "radar_gain_pct": "radar [%]",
        "lidar_single_gain_pct": "one lidar [%]",
        "radar_single_gain_pct": "one radar [%]",
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
"""Table -> the columns that the terminal shows, with their headings; of other tables all columns are shown."""


FIGURES_BY_TABLE = {
    "figure_6": ("fig 6",),
    "table_1": ("table 1",),
    "table_2": ("table 2",),
    "looks": ("where",),
    "settings": ("where",),
    "where": ("where",),
}
"""Table -> the figures and tables of the paper that it holds."""


def reproduce_xiang2019(request: ReproductionRequest) -> Reproduction:
    """Run the study. 1,000 seeds take about half a minute."""
    names = [name for name, figures in FIGURES_BY_TABLE.items() if request.wants_any_of(figures)]
    tables = compute_tables(request.seeds, progress=request.tick, names=names) if names else {}
    parts = [StudyPart(measured_numbers_of_tables(tables))]
    if request.wants_any_of(("fig 5",)):
        parts.append(StudyPart((), (sensor_looks_plot(),)))
    if "figure_6" in tables:
        parts.append(StudyPart((), (distance_errors_plot(tables["figure_6"]),)))
    if request.wants_any_of(("fig 7", "fig 8")):
        parts.append(filter_tracks_part())
    sections = [_table_section(name, tables[name]) for name in TABLE_TITLES if name in tables]
    if not request.only:
        findings: tuple[tuple[Cell, ...], ...] = tuple((text,) for text in ukf_against_ekf_sentences(tables))
        sections.append(SummaryTable("verdict", "Does the UKF beat the EKF?", ("finding",), findings))
    return assemble_reproduction(
        "xiang2019", parts, f"{request.seeds} paired seeds", sections=sections, only=request.only
    )


def _table_section(name: str, table: Table) -> SummaryTable:
    """Convert a table to a section of the summary."""
    shown = SHOWN_COLUMNS.get(name, {column: column.replace("_", " ") for column in table})
    rows: list[tuple[Cell, ...]] = [tuple(cells) for cells in zip(*(table[column] for column in shown), strict=True)]
    key = PROCESSOR_TIMES_SECTION_KEY if name == "table_2" else f"ours_{name}" if name.startswith("table") else name
    return SummaryTable(key, TABLE_TITLES[name], tuple(shown.values()), tuple(rows))
