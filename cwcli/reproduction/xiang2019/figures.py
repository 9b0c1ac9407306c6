"""xiang2019 as numbers beside the paper's, and its figures 5 to 8 redrawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.expectations import load_expectations, printed_number_or_nan
from cwcli.reproduction.findings import Curve, Plot, StudyPart
from cwcli.reproduction.xiang2019.reproduce import (
    ASSUMED_SCENE_NOISE,
    N_LOOKS_PER_SENSOR,
    N_SEGMENT_SAMPLES,
    PAPER_FILTER_CONFIG,
    Table,
    detection_rows_of_scene,
)
from cwcli.reproduction.xiang2019.sentences import table_column
from cwcli.signals.columns import FloatArray
from cwcli.simulation.dual_sensor import (
    PAPER_STATIC_RANGES_M,
    TARGET_POSITIONS_BY_PATH_SHAPE,
    observe_single_target,
    simulate_static_target,
    times_and_true_states_on_path,
)
from cwcli.tracking.config import IS_UNSCENTED_BY_FILTER
from cwcli.tracking.single_target import filter_single_target

SENSOR_NAMES = ("lidar", "radar")
"""Names of the two sensors in tables."""
FIGURE_BY_FILTER = {"ekf": "fig 7", "ukf": "fig 8"}
"""Filter -> the paper's figure of its tracks."""
SEGMENT_SPACING_M = 14.0
"""Distance at which the segments are drawn side by side, in m. Chosen by hand; not fitted."""


def measured_numbers_of_tables(tables: Mapping[str, Table]) -> tuple[MeasuredNumber, ...]:
    """Return the numbers of all tables that the paper has something to say of, and of the radar scenes."""
    measured: list[MeasuredNumber] = []
    for name, make in NUMBER_EXTRACTORS.items():
        if name in tables:
            measured += make(tables[name])
    return tuple(measured)


def _numbers_of_figure_6(table: Table) -> list[MeasuredNumber]:
    """Return the errors and gains of figure 6: what the paper prints over the five distances, and each distance's."""
    measured = []
    k = int(np.argmax(errors := table_column(table, "combined_error_m")))
    low, high = (float(table_column(table, f"combined_{end}_m")[k]) for end in ("low", "high"))
    measured.append(
        MeasuredNumber("fig 6", "error of both together, largest of the five distances", float(errors[k]), low, high)
    )
    for sensor in SENSOR_NAMES:
        for kind, text in (("gain", "four looks averaged"), ("single_gain", "single look")):
            gain = table_column(table, f"{sensor}_{kind}_pct")
            named = {"least": gain.min(), "largest": gain.max()}
            if kind == "gain":
                named["mean of the five distances"] = gain.mean()
            measured += [
                MeasuredNumber("fig 6", f"{sensor} alone is worse by, {text}, {which}", float(value))
                for which, value in named.items()
            ]
    for k, range_m in enumerate(table_column(table, "range_m")):
        measured += [
            MeasuredNumber(
                "fig 6",
                f"{range_m:.2f} m: {sensor} alone is worse by, four looks averaged",
                float(table_column(table, f"{sensor}_gain_pct")[k]),
            )
            for sensor in SENSOR_NAMES
        ]
    return measured


def _numbers_of_table_1(table: Table) -> list[MeasuredNumber]:
    """Return the mean square errors and gains of table 1."""
    measured = []
    for k, (segment, axis) in enumerate(zip(table["segment"], table["axis"], strict=True)):
        for name in IS_UNSCENTED_BY_FILTER:
            value = float(table_column(table, name)[k])
            measured.append(MeasuredNumber("table 1", f"{segment}, {axis}, {name.upper()}: mean square error", value))
        gain, low, high = (float(table_column(table, f"gain{end}_pct")[k]) for end in ("", "_low", "_high"))
        measured.append(MeasuredNumber("table 1", f"{segment}, {axis}: the UKF is better by", gain, low, high))
    for name in IS_UNSCENTED_BY_FILTER:
        values = table_column(table, name)
        for axis in "xy":
            mean = float(values[np.array(table["axis"]) == axis].mean())
            measured.append(MeasuredNumber("table 1", f"mean, {axis}, {name.upper()}: mean square error", mean))
        what = f"mean of the eight cells, {name.upper()}: mean square error"
        measured.append(MeasuredNumber("table 1", what, float(values.mean())))
    return measured


def _numbers_of_radar_scenes(table: Table) -> list[MeasuredNumber]:
    """Return the gains of the UKF in scenes with radar alone."""
    gain, low, high = (table_column(table, f"gain{end}_pct") for end in ("", "_low", "_high"))
    return [
        MeasuredNumber(
            "where", f"{scene}, {sigma:g} deg: the UKF is better by", float(gain[k]), float(low[k]), float(high[k])
        )
        for k, (scene, sigma) in enumerate(zip(table["scene"], table_column(table, "azimuth_sigma_deg"), strict=True))
    ]


def _numbers_by_look_count(table: Table) -> list[MeasuredNumber]:
    """Return the combined error by number of looks."""
    value, low, high = (table_column(table, name) for name in ("error_m", "low_m", "high_m"))
    return [
        MeasuredNumber(
            "where",
            f"4.90 m, {looks:g} looks of each: error of both together",
            float(value[k]),
            float(low[k]),
            float(high[k]),
        )
        for k, looks in enumerate(table_column(table, "looks"))
    ]


def _numbers_of_process_noises(table: Table) -> list[MeasuredNumber]:
    """Return the mean square errors by process noise."""
    return [
        MeasuredNumber(
            "where", f"process noise {noise:g}, {name.upper()}: mean square error", float(table_column(table, name)[k])
        )
        for k, noise in enumerate(table_column(table, "process_noise"))
        for name in IS_UNSCENTED_BY_FILTER
    ]


NUMBER_EXTRACTORS = {
    "figure_6": _numbers_of_figure_6,
    "table_1": _numbers_of_table_1,
    "where": _numbers_of_radar_scenes,
    "looks": _numbers_by_look_count,
    "settings": _numbers_of_process_noises,
}
"""Table -> the function that takes its numbers."""


def sensor_looks_plot() -> Plot:
    """Plot figure 5: the four looks of each sensor at the five ranges (seed 0)."""
    at: dict[str, list[float]] = {sensor: [] for sensor in SENSOR_NAMES}
    for true_m in PAPER_STATIC_RANGES_M:
        scene = simulate_static_target(
            true_m, 2 * N_LOOKS_PER_SENSOR, ASSUMED_SCENE_NOISE, np.random.default_rng([0, round(100 * true_m)])
        )
        at["lidar"] += (np.hypot(*scene.lidar_xy.T) - true_m).tolist()
        at["radar"] += (scene.radar[:, 0] - true_m).tolist()
    shown = np.repeat(np.array(PAPER_STATIC_RANGES_M), N_LOOKS_PER_SENSOR)
    return Plot(
        "fig 5", "four looks of each sensor (first seed)", "true distance [m]", "measured less true distance [m]",
        [Curve(sensor, shown, np.array(values), is_points=True) for sensor, values in at.items()],
        level=("true", 0.0),
    )  # fmt: skip


def distance_errors_plot(table: Table) -> Plot:
    """Plot figure 6: the mean errors over the seeds."""
    labels = {"lidar": "four looks of the lidar", "radar": "four looks of the radar", "combined": "all eight"}
    ranges = table_column(table, "range_m")
    curves = [Curve(label, ranges, table_column(table, f"{name}_error_m")) for name, label in labels.items()]
    expected = load_expectations("xiang2019").figures["fig 6"].expectation_by_number
    together = expected["error of both together, largest of the five distances"].paper_range
    assert together is not None
    for sensor in SENSOR_NAMES:
        worse_percent = printed_number_or_nan(
            "xiang2019", "fig 6", f"{sensor} alone is worse by, four looks averaged, largest"
        )
        most_m = together[1] * (1.0 + 0.01 * worse_percent)
        curves.append(Curve(f"{sensor}, at most as printed", ranges[[0, -1]], np.full(2, most_m)))
    title = "error of the distance, mean over the seeds"
    level = ("all eight, at most as printed", together[1])
    return Plot("fig 6", title, "true distance [m]", "error [m]", curves, level=level, y_range=(0, 0.12))


def filter_tracks_part() -> StudyPart:
    """Plot figures 7 and 8: the four segments as each filter tracks them (seed 0): true, detected, estimated."""
    plots = []
    for name, figure in FIGURE_BY_FILTER.items():
        lines: dict[str, list[FloatArray]] = {"detected": [], "true": [], "estimated": []}
        for k, segment in enumerate(TARGET_POSITIONS_BY_PATH_SHAPE):
            scene = observe_single_target(
                *times_and_true_states_on_path(segment, N_SEGMENT_SAMPLES),
                ASSUMED_SCENE_NOISE,
                np.random.default_rng([0, k]),
            )
            state = filter_single_target(
                detection_rows_of_scene(scene, ASSUMED_SCENE_NOISE),
                replace(PAPER_FILTER_CONFIG, filter="ekf" if name == "ekf" else "ukf"),
            ).state
            reach, azimuth = scene.radar[:, 0], scene.radar[:, 1]
            radar_xy = np.stack([reach * np.cos(azimuth), reach * np.sin(azimuth)], axis=1)
            found = (np.concatenate([scene.lidar_xy, radar_xy]), scene.truth_state[:, :2], state[:, :2])
            for line, points in zip(lines.values(), found, strict=True):
                line += [
                    points + np.array([SEGMENT_SPACING_M * k, 0.0]),
                    np.full((1, 2), np.nan),
                ]  # the gap ends the line
        curves = []
        for label, parts in lines.items():
            x, y = np.concatenate(parts).T
            curves.append(Curve(label, x, y, is_points=label == "detected"))
        title = (
            f"{name.upper()}: {', '.join(TARGET_POSITIONS_BY_PATH_SHAPE)}, {SEGMENT_SPACING_M:g} m apart (first seed)"
        )
        plots.append(Plot(figure, title, "x, to the right [m]", "y, ahead [m]", curves, is_map=True))
    return StudyPart((), tuple(plots))
