"""xiang2019 as numbers beside the paper's, and its figures 5 to 8 redrawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cwcli.reproduction.classes import Measured
from cwcli.reproduction.findings import Curve, Part, Plot
from cwcli.reproduction.xiang2019.reproduce import (
    FILTER,
    N_LOOKS,
    N_SEGMENT,
    NOISE,
    Table,
    rows_of,
)
from cwcli.signals.columns import FloatArray
from cwcli.simulation.dual_sensor import PAPER_RANGES_M, SEGMENTS, segment_truth, static_target, watch
from cwcli.tracking.config import FILTERS
from cwcli.tracking.single import run_filter

SENSORS = ("lidar", "radar")
"""Names of the two sensors in tables."""
FIGURE_OF = {"ekf": "fig 7", "ukf": "fig 8"}
"""Filter -> the paper's figure of its tracks."""
APART_M = 14.0
"""Distance at which the segments are drawn side by side, in m. Chosen by hand; not fitted."""


def numbers(tables: Mapping[str, Table]) -> tuple[Measured, ...]:
    """Return the numbers of all tables that the paper has something to say of, and of the radar scenes."""
    measured: list[Measured] = []
    for name, make in MAKERS.items():
        if name in tables:
            measured += make(tables[name])
    return tuple(measured)


def _figure_6(table: Table) -> list[Measured]:
    """Return the errors and gains of figure 6."""
    measured = []
    for k, range_m in enumerate(_column(table, "range_m")):
        at = f"{range_m:.2f} m"
        low, high = (float(_column(table, f"combined_{end}_m")[k]) for end in ("low", "high"))
        measured.append(
            Measured("fig 6", f"{at}: error of both together", float(_column(table, "combined_error_m")[k]), low, high)
        )
        for sensor in SENSORS:
            for kind, text in (("gain", "four looks averaged"), ("single_gain", "single look")):
                gain = float(_column(table, f"{sensor}_{kind}_pct")[k])
                measured.append(Measured("fig 6", f"{at}: {sensor} alone is worse by, {text}", gain))
    return measured


def _table_1(table: Table) -> list[Measured]:
    """Return the mean square errors and gains of table 1."""
    measured = []
    for k, (segment, axis) in enumerate(zip(table["segment"], table["axis"], strict=True)):
        for name in FILTERS:
            value = float(_column(table, name)[k])
            measured.append(Measured("table 1", f"{segment}, {axis}, {name.upper()}: mean square error", value))
        gain, low, high = (float(_column(table, f"gain{end}_pct")[k]) for end in ("", "_low", "_high"))
        measured.append(Measured("table 1", f"{segment}, {axis}: the UKF is better by", gain, low, high))
    for name in FILTERS:
        values = _column(table, name)
        for axis in "xy":
            mean = float(values[np.array(table["axis"]) == axis].mean())
            measured.append(Measured("table 1", f"mean, {axis}, {name.upper()}: mean square error", mean))
        what = f"mean of the eight cells, {name.upper()}: mean square error"
        measured.append(Measured("table 1", what, float(values.mean())))
    return measured


def _table_2(table: Table) -> list[Measured]:
    """Return the times of table 2, and whether the UKF is faster."""
    times = dict(zip(map(str, table["filter"]), _column(table, "time_ms"), strict=True))
    measured = [Measured("table 2", f"{name.upper()}: 500 samples", float(times[name])) for name in ("ukf", "ekf")]
    measured.append(Measured("table 2", "the UKF is the faster one", float(times["ukf"] < times["ekf"])))
    return measured


def _where(table: Table) -> list[Measured]:
    """Return the gains of the UKF in scenes with radar alone."""
    gain, low, high = (_column(table, f"gain{end}_pct") for end in ("", "_low", "_high"))
    return [
        Measured(
            "where", f"{scene}, {sigma:g} deg: the UKF is better by", *(float(each[k]) for each in (gain, low, high))
        )
        for k, (scene, sigma) in enumerate(zip(table["scene"], _column(table, "azimuth_sigma_deg"), strict=True))
    ]


def _looks(table: Table) -> list[Measured]:
    """Return the combined error by number of looks."""
    value, low, high = (_column(table, name) for name in ("error_m", "low_m", "high_m"))
    return [
        Measured(
            "where",
            f"4.90 m, {looks:g} looks of each: error of both together",
            *(float(e[k]) for e in (value, low, high)),
        )
        for k, looks in enumerate(_column(table, "looks"))
    ]


def _settings(table: Table) -> list[Measured]:
    """Return the mean square errors by process noise."""
    return [
        Measured("where", f"process noise {noise:g}, {name.upper()}: mean square error", float(_column(table, name)[k]))
        for k, noise in enumerate(_column(table, "process_noise"))
        for name in FILTERS
    ]


MAKERS = {
    "figure_6": _figure_6,
    "table_1": _table_1,
    "table_2": _table_2,
    "where": _where,
    "looks": _looks,
    "settings": _settings,
}
"""Table -> the function that takes its numbers."""


def looks_plot() -> Plot:
    """Plot figure 5: the four looks of each sensor at the five ranges (seed 0)."""
    at: dict[str, list[float]] = {sensor: [] for sensor in SENSORS}
    for true_m in PAPER_RANGES_M:
        scene = static_target(true_m, 2 * N_LOOKS, NOISE, np.random.default_rng([0, round(100 * true_m)]))
        at["lidar"] += (np.hypot(*scene.lidar_xy.T) - true_m).tolist()
        at["radar"] += (scene.radar[:, 0] - true_m).tolist()
    shown = np.repeat(np.array(PAPER_RANGES_M), N_LOOKS)
    return Plot(
        "fig 5", "four looks of each sensor (first seed)", "true distance [m]", "measured less true distance [m]",
        [Curve(sensor, shown, np.array(values), is_points=True) for sensor, values in at.items()],
        level=("true", 0.0),
    )  # fmt: skip


def errors_plot(table: Table) -> Plot:
    """Plot figure 6: the mean errors over the seeds."""
    labels = {"lidar": "four looks of the lidar", "radar": "four looks of the radar", "combined": "all eight"}
    ranges = _column(table, "range_m")
    curves = [Curve(label, ranges, _column(table, f"{name}_error_m")) for name, label in labels.items()]
    title = "error of the distance, mean over the seeds"
    return Plot(
        "fig 6", title, "true distance [m]", "error [m]", curves, level=("the paper's", 0.01), y_range=(0, 0.12)
    )


def tracks_part() -> Part:
    """Plot figures 7 and 8: the four segments as each filter tracks them (seed 0): true, detected, estimated."""
    plots = []
    for name, figure in FIGURE_OF.items():
        lines: dict[str, list[FloatArray]] = {"detected": [], "true": [], "estimated": []}
        for k, segment in enumerate(SEGMENTS):
            scene = watch(*segment_truth(segment, N_SEGMENT), NOISE, np.random.default_rng([0, k]))
            state = run_filter(rows_of(scene, NOISE), replace(FILTER, filter="ekf" if name == "ekf" else "ukf")).state
            reach, azimuth = scene.radar[:, 0], scene.radar[:, 1]
            radar_xy = np.stack([reach * np.cos(azimuth), reach * np.sin(azimuth)], axis=1)
            found = (np.concatenate([scene.lidar_xy, radar_xy]), scene.truth_state[:, :2], state[:, :2])
            for line, points in zip(lines.values(), found, strict=True):
                line += [points + np.array([APART_M * k, 0.0]), np.full((1, 2), np.nan)]  # the gap ends the line
        curves = []
        for label, parts in lines.items():
            x, y = np.concatenate(parts).T
            curves.append(Curve(label, x, y, is_points=label == "detected"))
        title = f"{name.upper()}: {', '.join(SEGMENTS)}, {APART_M:g} m apart (first seed)"
        plots.append(Plot(figure, title, "x, to the right [m]", "y, ahead [m]", curves, is_map=True))
    return Part((), tuple(plots))


def _column(table: Table, name: str) -> FloatArray:
    """Return a table's column as numbers."""
    return np.array(table[name], np.float64)
