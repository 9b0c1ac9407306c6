"""Signals over time with their 1-sigma bands: the car's motion, and its place in the lane."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cwcli.digest.drive import Drive
from cwcli.digest.encounters import DriveEncounters
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.result import GatedMeasurements
from cwcli.lazy_dataclass import dataclass
from cwcli.report.decimate import first_row_per_grid_cell, min_max_row_indices, reduce_band_to_rows_and_bounds
from cwcli.report.drawing import (
    EGO_COLOUR,
    MEASURED_COLOUR,
    OTHER_SYSTEM_COLOUR,
    WARNING_COLOUR,
    Figure,
    Trace,
    axis_settings,
    line_trace,
    marker_trace,
    polygon_trace,
    rounded_json_numbers,
    vertical_line_with_label,
)
from cwcli.report.map_figure import insert_nan_rows_in_time_gaps
from cwcli.signals.columns import BoolArray, FloatArray, Int64Array
from cwcli.signals.packed_covariances import variances_of_states
from cwcli.signals.row_order import first_and_last_rows_of_runs
from cwcli.signals.units import NS_PER_S

MAX_MARKED_WARNINGS = 30
"""The greatest number of warnings that a figure marks. Chosen by hand; not fitted."""
PANEL_GAP_SHARE = 0.035
"""Gap between panels, as a share of the figure's height. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class SignalCurve:
    """One signal: stamps, values and standard deviations (n,), its raw measurements, and which were gated."""

    title: str
    unit: str
    decimals: int
    stamp_ns: Int64Array
    values: FloatArray
    sigma: FloatArray
    measured: tuple[Int64Array, FloatArray] | None = None
    gated: BoolArray | None = None


def motion_figure(drive: Drive, drive_encounters: DriveEncounters, n_pieces: int) -> Figure | None:
    """Draw speed, heading, yaw rate and acceleration of the car; None without its states."""
    curves = motion_curves(drive)
    return stacked_curves_figure(drive, curves, drive_encounters, n_pieces) if curves else None


def motion_curves(drive: Drive) -> list[SignalCurve]:
    """Return the curves of the car's motion; [] without its states."""
    ego = drive.ego
    if ego is None:
        return []
    sigma = np.sqrt(np.maximum(variances_of_states(ego.covariance, range(ego.state.shape[1])), 0.0))
    turn = np.degrees(1.0)
    curves = []
    for title, unit, decimals, state, scale, kinds in (
        ("speed", "m/s", 3, 2, 1.0, (Kind.SPEED,)),
        ("heading", "deg", 2, 3, turn, (Kind.HEADING,)),
        ("yaw rate", "deg/s", 3, 5, turn, (Kind.YAW_RATE,)),
        ("acceleration", "m/s²", 3, 4, 1.0, (Kind.ACCEL,)),
    ):
        raw = _first_measured_signal(drive.measurements, kinds[0])
        if raw is not None and kinds[0] is Kind.HEADING:
            raw = replace(
                raw, values=_unwrap_headings_near_track(raw.stamp_ns, raw.values, ego.stamp_ns, ego.state[:, 3])
            )
        scaled = None if raw is None else (raw.stamp_ns, raw.values * scale)
        values, spread = ego.state[:, state] * scale, sigma[:, state] * scale
        gated = (
            None
            if raw is None
            else gated_measurement_mask(raw.topic, raw.quantity.name.lower(), raw.stamp_ns, drive.gated)
        )
        curves.append(SignalCurve(title, unit, decimals, ego.stamp_ns, values, spread, scaled, gated))
    return curves


def lane_figure(drive: Drive, drive_encounters: DriveEncounters, n_pieces: int) -> Figure | None:
    """Draw the car's place in the lane at the preview point; None without lanes."""
    curves = lane_curves(drive)
    return stacked_curves_figure(drive, curves, drive_encounters, n_pieces) if curves else None


def lane_curves(drive: Drive) -> list[SignalCurve]:
    """Return the curves of the place in the lane; [] without lanes."""
    lanes = drive.lanes
    if lanes is None or not len(lanes):
        return []
    curves = []
    for k, (title, unit, scale) in enumerate(
        (("offset", "m", 1.0), ("heading", "deg", np.degrees(1.0)), ("curvature", "1/km", 1000.0))
    ):
        values, sigma = lanes.preview[:, k] * scale, lanes.preview_sigma[:, k] * scale
        curves.append(SignalCurve(title, unit, 3, lanes.stamp_ns, values, sigma))
    return curves


@dataclass(frozen=True)
class _MeasuredSignal:
    """Measurements of one quantity from one source: stamps and values (n,)."""

    topic: str
    quantity: Kind
    stamp_ns: Int64Array
    values: FloatArray


def _first_measured_signal(measured: tuple[Measurements, ...], kind: Kind) -> _MeasuredSignal | None:
    """Return the first source that measures a quantity; a velocity gives a speed, an IMU yaw rate and acceleration."""
    for source in measured:
        if source.kind is kind:
            return _MeasuredSignal(source.source, kind, source.stamp_ns, source.values[:, 0])
    for source in measured:
        if source.kind is Kind.VELOCITY and kind is Kind.SPEED:
            speed = np.hypot(source.values[:, 0], source.values[:, 1])
            return _MeasuredSignal(source.source, Kind.VELOCITY, source.stamp_ns, speed)
        if source.kind is Kind.IMU and kind in (Kind.ACCEL, Kind.YAW_RATE):
            return _MeasuredSignal(
                source.source, kind, source.stamp_ns, source.values[:, 0 if kind is Kind.ACCEL else 5]
            )
    return None


def gated_measurement_mask(topic: str, quantity: str, stamp_ns: Int64Array, gated: GatedMeasurements) -> BoolArray:
    """Return which of a source's measurements the estimator gated, by their stamps (n,), shape (n,)."""
    is_own = np.zeros(len(gated), bool)
    if topic in gated.topic.values and quantity in gated.quantity.values:
        topics = [name == topic for name in gated.topic.values]
        quantities = [name == quantity for name in gated.quantity.values]
        is_own = np.array(topics)[gated.topic.codes] & np.array(quantities)[gated.quantity.codes]
    return np.asarray(np.isin(stamp_ns, gated.stamp_ns[is_own]))


def _unwrap_headings_near_track(
    stamp_ns: Int64Array, heading: FloatArray, track_ns: Int64Array, track: FloatArray
) -> FloatArray:
    """Shift headings by whole turns to the track's heading, which is not wrapped."""
    at = np.clip(np.searchsorted(track_ns, stamp_ns), 0, len(track_ns) - 1)
    return np.asarray(heading + 2.0 * np.pi * np.round((track[at] - heading) / (2.0 * np.pi)), np.float64)


def stacked_curves_figure(
    drive: Drive,
    curves: list[SignalCurve],
    drive_encounters: DriveEncounters,
    n_pieces: int,
    *,
    around_zero: bool = False,
) -> Figure:
    """Draw curves one above the other over a common time axis.

    Args:
        around_zero: The bands lie around zero, not around the curves: what is drawn are errors.
    """
    data: list[Trace] = []
    layout: dict[str, Any] = {"shapes": [], "annotations": []}
    height = (1.0 + PANEL_GAP_SHARE) / len(curves) - PANEL_GAP_SHARE
    first_gated = next((k for k, each in enumerate(curves) if each.gated is not None and each.gated.any()), -1)
    for index, curve in enumerate(curves):
        name = "y" if index == 0 else f"y{index + 1}"
        top = 1.0 - index * (height + PANEL_GAP_SHARE)
        layout[f"yaxis{name[1:]}"] = axis_settings(
            f"{curve.title}<br>[{curve.unit}]", domain=[round(max(top - height, 0.0), 4), round(top, 4)]
        )
        in_legend = index == first_gated
        data += _curve_traces(
            drive, curve, name, n_pieces, is_first=index == 0, around_zero=around_zero, with_gated=in_legend
        )
    layout["xaxis"] = axis_settings(
        "time since the log began [s]", anchor=f"y{len(curves)}" if len(curves) > 1 else "y"
    )
    ends = [drive.seconds_since_start(each.stamp_ns[[0, -1]]) for each in curves if len(each.stamp_ns)]
    if ends:
        layout["xaxis"]["range"] = rounded_json_numbers(
            np.array([min(first for first, _ in ends), max(last for _, last in ends)]), 2
        )
    for encounter in drive_encounters.encounters[:MAX_MARKED_WARNINGS]:
        at = round((encounter.raised_ns - drive.start_ns) / NS_PER_S, 3)
        shape, label = vertical_line_with_label(at, f"warning {encounter.event_id}", WARNING_COLOUR)
        layout["shapes"].append(shape)
        layout["annotations"].append(label)
    for shape, label in other_system_warning_lines(drive):
        layout["shapes"].append(shape)
        layout["annotations"].append(label)
    return {"data": data, "layout": layout}


def other_system_warning_lines(
    drive: Drive, span_ns: tuple[int, int] | None = None
) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Return vertical lines where another system warned, at most `MAX_MARKED_WARNINGS`, labelled at the bottom."""
    outcomes = () if drive.other_system is None else drive.other_system.flag_scores.judged
    raised = [each.raised_ns for each in outcomes if span_ns is None or span_ns[0] <= each.raised_ns <= span_ns[1]]
    marks = [
        vertical_line_with_label(round((at - drive.start_ns) / NS_PER_S, 3), "other system", OTHER_SYSTEM_COLOUR)
        for at in raised[:MAX_MARKED_WARNINGS]
    ]
    return [(shape, {**label, "y": 0, "yanchor": "bottom"}) for shape, label in marks]


def _curve_traces(
    drive: Drive, curve: SignalCurve, name: str, n_pieces: int, *, is_first: bool, around_zero: bool, with_gated: bool
) -> list[Trace]:
    """Return the traces of one curve: measurements, gated ones, band and line."""
    both = np.column_stack([curve.values, curve.sigma])
    stamp_ns, both = insert_nan_rows_in_time_gaps(curve.stamp_ns, both)
    values, sigma = both.T
    seconds = drive.seconds_since_start(stamp_ns)
    traces: list[Trace] = []
    more = {"yaxis": name, "showlegend": is_first}
    if curve.measured is not None:
        at, raw = drive.seconds_since_start(curve.measured[0]), curve.measured[1]
        rows = first_row_per_grid_cell(at, raw, n_pieces, 150)
        x, y = rounded_json_numbers(at[rows], 2), rounded_json_numbers(raw[rows], curve.decimals)
        traces.append(
            marker_trace(
                x, y, "measured", MEASURED_COLOUR, size=3, opacity=0.55, legendgroup="raw", hoverinfo="skip", **more
            )
        )
        if curve.gated is not None and curve.gated.any():
            rows = np.flatnonzero(curve.gated)[
                first_row_per_grid_cell(at[curve.gated], raw[curve.gated], n_pieces, 150)
            ]
            x, y = rounded_json_numbers(at[rows], 2), rounded_json_numbers(raw[rows], curve.decimals)
            crosses = {"symbol": "x", "size": 5, "legendgroup": "gated", "hovertemplate": "%{x} s: gated", **more}
            traces.append(marker_trace(x, y, "gated", WARNING_COLOUR, **{**crosses, "showlegend": with_gated}))
    if np.isfinite(sigma).any():
        middle = np.zeros_like(values) if around_zero else values
        x, y = _closed_band_outline_x_and_y(seconds, middle - sigma, middle + sigma, curve.decimals, n_pieces // 2)
        said = "95 % band" if around_zero else "1-sigma band"
        traces.append(polygon_trace(x, y, said, EGO_COLOUR, alpha=0.25, legendgroup="band", **more))
    rows = min_max_row_indices(values, n_pieces)
    x, y = rounded_json_numbers(seconds[rows], 3), rounded_json_numbers(values[rows], curve.decimals)
    hover = f"%{{x}} s: %{{y}} {curve.unit}"
    what = "error" if around_zero else "estimated"
    traces.append(line_trace(x, y, what, EGO_COLOUR, width=1.5, legendgroup="line", hovertemplate=hover, **more))
    return traces


def _closed_band_outline_x_and_y(
    seconds: FloatArray, lower: FloatArray, upper: FloatArray, decimals: int, n_pieces: int
) -> tuple[list[float | None], list[float | None]]:
    """Return the band as closed outlines, one for each stretch without a gap."""
    rows, lower, upper = reduce_band_to_rows_and_bounds(lower, upper, n_pieces)
    x: list[float | None] = []
    y: list[float | None] = []
    for first, last in first_and_last_rows_of_runs(np.isfinite(lower) & np.isfinite(upper)):
        part = slice(first, last + 1)
        forth = rounded_json_numbers(seconds[rows[part]], 2)
        x += [*forth, *reversed(forth), None]
        y += [
            *rounded_json_numbers(upper[part], decimals),
            *reversed(rounded_json_numbers(lower[part], decimals)),
            None,
        ]
    return x, y
