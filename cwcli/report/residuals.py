"""Each source's residuals over time: what it measured minus the estimate, once what was found of it is taken off."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from cwcli.digest.drive import Drive
from cwcli.estimation.imu import level_imu_by_gravity
from cwcli.estimation.latency import MAX_DRIFT_EXTRAPOLATION_S
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.parameter import ParameterStatus
from cwcli.lazy_dataclass import dataclass
from cwcli.pipeline.records import (
    parse_json_entry_or_empty,
    read_finite_number_or_nan,
    read_latency_s,
    read_recorded_summary,
)
from cwcli.report.decimate import first_row_per_grid_cell
from cwcli.report.drawing import (
    EGO_COLOUR,
    MEASURED_COLOUR,
    WARNING_COLOUR,
    Figure,
    Trace,
    axis_settings,
    escape_figure_text,
    marker_trace,
    polygon_trace,
    rounded_json_numbers,
)
from cwcli.report.sensors import INTERVAL_95_SIGMAS, MAX_INTERPOLATION_GAP_S, leading_number_or_nan
from cwcli.report.signal_figures import gated_measurement_mask
from cwcli.report.views import Plot
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import BoolArray, FloatArray, Int64Array
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import ACCEL, EGO_ID, HEADING, SPEED, YAW_RATE

MAX_RESIDUAL_FIGURES = 8
"""The greatest number of residual figures. Chosen by hand; not fitted."""
N_DOT_GRID_ROWS = 60
"""Cells of the grid over the height; of dots in one cell the first is drawn. Chosen by hand; not fitted."""
PANEL_HEIGHT_PX = 130
"""Height of one component's panel, in pixels. Chosen by hand; not fitted."""
AXIS_AND_LEGEND_HEIGHT_PX = 110
"""Height of the axis and legend around the panels, in pixels. Chosen by hand; not fitted."""
MIN_HALF_HEIGHT_OF_AXIS_SIGMAS = 2.2
"""Least half height of the axis, in sigmas of the noise; it also covers 99.8 % of the residuals that were not gated.
Chosen by hand; not fitted."""
DEGREES_PER_RADIAN = math.degrees(1.0)
"""The factor from radians to degrees."""
RESIDUAL_COMPONENTS: Mapping[Kind, tuple[tuple[str, str, float], ...]] = {
    Kind.POSITION: (("ahead", "m", 1.0), ("left", "m", 1.0)),
    Kind.VELOCITY: (("ahead", "m/s", 1.0), ("left", "m/s", 1.0)),
    Kind.SPEED: (("speed", "m/s", 1.0),),
    Kind.HEADING: (("heading", "deg", DEGREES_PER_RADIAN),),
    Kind.ACCEL: (("acceleration", "m/s²", 1.0),),
    Kind.YAW_RATE: (("yaw rate", "deg/s", DEGREES_PER_RADIAN),),
}
"""The components of each quantity's residuals: name, unit, and factor from SI units."""


@dataclass(frozen=True)
class SourceResiduals:
    """The residuals of one source and quantity.

    Attributes:
        stamp_ns: Shape (n,): as measured.
        values: Shape (n, d), one column for each of `PARTS`, in its unit; NaN where nothing was estimated.
        is_gated: Shape (n,): which the estimator did not believe.
        sigma: One sigma of the white noise that the filter took, in the same unit; NaN where the record has none.
        hint: What was found of the source, in words.
    """

    source: str
    kind: Kind
    stamp_ns: Int64Array
    values: FloatArray
    is_gated: BoolArray
    sigma: float
    hint: str


def build_residual_plots(drive: Drive, anchor: str, n_pieces: int) -> tuple[list[Plot], int]:
    """Build a figure for each source and quantity of the ego; none if the record names no sources.

    Returns:
        At most MAX_SOURCES, and how many there could be.
    """
    plots = []
    found = list(iter_source_residuals(drive))
    for index, each in enumerate(found[:MAX_RESIDUAL_FIGURES]):
        title = f"Residuals of {each.source}: {each.kind.name.lower().replace('_', ' ')}"
        height_px = AXIS_AND_LEGEND_HEIGHT_PX + PANEL_HEIGHT_PX * each.values.shape[1]
        figure = residual_figure(drive, each, n_pieces)
        plots.append(
            Plot(f"{anchor}-residuals-{index + 1}", "residuals", title, each.hint, figure, height_px=height_px)
        )
    return plots, len(found)


def iter_source_residuals(drive: Drive) -> Iterator[SourceResiduals]:
    """Yield the residuals of each of the ego's sources, in the order of the record's table.

    They are taken against the estimate by hindsight at the corrected time: stamps less the latency, speeds by their
    scale, biases off. Slow errors, and what a lever arm or a road's grade does to a source, stay in them.
    """
    if drive.ego is None:
        return
    states = drive.ego.sort_by_stamp_without_repeats()
    record = drive.records.get("estimate", {})
    found = read_recorded_summary(record)
    of_parameters = found.rows_of_table_columns_or_empty(
        "parameters", "source", "quantity", "parameter", "value +- sigma", "unit", "use of the value"
    )
    of_noise = found.rows_of_table_columns_or_empty("noise", "source", "quantity", "white noise (1 sigma)")
    measured = {
        (each.source, each.kind): each
        for source in drive.measurements
        for each in _level_and_sort_measurements(drive, source)
    }
    for report in parse_json_entry_or_empty(record, "sources", list):
        if not isinstance(report, dict) or report.get("vehicle") != EGO_ID:
            continue
        source = str(report.get("source"))
        kind = next((kind for kind in RESIDUAL_COMPONENTS if kind.name.lower() == report.get("quantity")), None)
        if kind is None or (source, kind) not in measured:
            continue
        rows = measured[source, kind]
        own = (source, kind.name.lower().replace("_", " "))
        parameters = [row for row in of_parameters if row[:2] == own]
        noise = next((row for row in of_noise if row[:2] == own), None)
        scale = RESIDUAL_COMPONENTS[kind][0][2]
        estimated = interpolate_signal_at_times(
            states.stamp_ns,
            states.state,
            _subtract_latency_from_stamps(rows.stamp_ns, report),
            max_gap_s=MAX_INTERPOLATION_GAP_S,
        )
        values = _compute_residuals(
            rows,
            estimated,
            bias=_used_parameter_value_or_default(parameters, "bias", 0.0),
            factor=_used_parameter_value_or_default(parameters, "scale", 1.0),
        )
        if not np.isfinite(values).any():
            continue
        sigma = math.nan if noise is None else leading_number_or_nan(noise[2])
        gated = gated_measurement_mask(source, kind.name.lower(), rows.stamp_ns, drive.gated)
        yield SourceResiduals(
            source,
            kind,
            rows.stamp_ns,
            values * scale,
            gated,
            sigma * scale,
            _source_findings_text(report, parameters, noise),
        )


def _level_and_sort_measurements(drive: Drive, measured: Measurements) -> list[Measurements]:
    """Sort measurements by stamp; an IMU becomes levelled acceleration and yaw rate."""
    order = np.argsort(measured.stamp_ns, kind="stable")
    stamp_ns, values = measured.stamp_ns[order], np.asarray(measured.values, np.float64)[order]
    if values.ndim == 1:
        values = values[:, None]
    if measured.kind is not Kind.IMU:
        return [Measurements(measured.source, measured.kind, stamp_ns, values)]
    known = np.isfinite(values).all(axis=1)
    stamp_ns, values = stamp_ns[known], values[known]
    if not len(values):
        return []
    levelled = level_imu_by_gravity(drive.seconds_since_start(stamp_ns), values, None)
    levelled_ns = stamp_ns[np.isin(drive.seconds_since_start(stamp_ns), levelled.time_s)]
    if len(levelled_ns) != len(levelled.time_s):  # equal stamps, one of which was left out
        return []
    return [
        Measurements(measured.source, kind, levelled_ns, each[:, None])
        for kind, each in ((Kind.ACCEL, levelled.accel_mps2), (Kind.YAW_RATE, levelled.yaw_rate_radps))
    ]


def _subtract_latency_from_stamps(stamp_ns: Int64Array, report: Mapping[str, Any]) -> Int64Array:
    """Subtract the latency that the estimator applied from the stamps."""
    latency_s, drift = read_latency_s(report, "latency_s"), read_finite_number_or_nan(report, "latency_drift")
    taken_s = np.full(len(stamp_ns), latency_s if math.isfinite(latency_s) else 0.0)
    if 0.0 < abs(drift) <= 1.0 and len(stamp_ns):
        middle_ns = (int(stamp_ns[0]) + int(stamp_ns[-1])) // 2
        taken_s += drift * np.clip(
            (stamp_ns - middle_ns) / NS_PER_S, -MAX_DRIFT_EXTRAPOLATION_S, MAX_DRIFT_EXTRAPOLATION_S
        )
    return np.asarray(stamp_ns - np.rint(taken_s * NS_PER_S).astype(np.int64))


def _compute_residuals(measured: Measurements, estimated: FloatArray, *, bias: float, factor: float) -> FloatArray:
    """Subtract the estimates from the measurements, shape (n, d); vectors along the heading and to its left."""
    values, heading = measured.values, estimated[:, HEADING]
    along, left = (
        np.column_stack([np.cos(heading), np.sin(heading)]),
        np.column_stack([-np.sin(heading), np.cos(heading)]),
    )
    match measured.kind:
        case Kind.POSITION:
            off = values - estimated[:, :2]
        case Kind.VELOCITY:
            off = values - estimated[:, SPEED, None] * along
        case Kind.HEADING:
            return np.asarray(wrap_angle(values - estimated[:, HEADING, None] - bias))
        case _:
            column = {Kind.SPEED: SPEED, Kind.ACCEL: ACCEL, Kind.YAW_RATE: YAW_RATE}[measured.kind]
            return np.asarray(values - factor * estimated[:, column, None] - bias)
    return np.column_stack([np.einsum("ni,ni->n", off, along), np.einsum("ni,ni->n", off, left)])


def _used_parameter_value_or_default(parameters: list[tuple[Any, ...]], parameter: str, default: float) -> float:
    """Return the value of a parameter that the estimator used, else the default."""
    for _, _, name, value, _, status in parameters:
        if (
            name == parameter
            and (status in (ParameterStatus.USED, ParameterStatus.GIVEN) or name == "bias")  # which is always a state
            and math.isfinite(leading_number_or_nan(value))
        ):
            return leading_number_or_nan(value)
    return default


def _source_findings_text(
    report: Mapping[str, Any], parameters: list[tuple[Any, ...]], noise: tuple[Any, ...] | None
) -> str:
    """Format the findings: `latency 1013 ± 88 ms (applied); bias -1.8 m/s² (used); 75 of 2117 gated`."""
    said = []
    status, found = report.get("latency_status"), 1e3 * read_finite_number_or_nan(report, "latency_found_s")
    if math.isfinite(found):
        sigma = 1e3 * read_finite_number_or_nan(report, "latency_sigma_s")
        said.append(f"latency {found:.0f}{f' +- {sigma:.0f}' if math.isfinite(sigma) else ''} ms ({status})")
    elif status:
        said.append(f"latency: {status}")
    said += [
        f"{name} {_with_unit_behind_number(str(value), str(unit))} ({status})"
        for _, _, name, value, unit, status in parameters
        if value
    ]
    if noise is not None:
        said.append(f"white noise {noise[2]}")
    nis, inside = read_finite_number_or_nan(report, "nis_per_dof"), report.get("nis_inside")
    if math.isfinite(nis):
        where = f", {'inside' if inside else 'outside'} its 95 % bounds" if isinstance(inside, bool) else ""
        said.append(f"NIS per degree of freedom {nis:.2f}{where}")
    gated, used = read_finite_number_or_nan(report, "gated"), read_finite_number_or_nan(report, "used")
    if gated > 0.0 and math.isfinite(used):
        said.append(f"{gated:.0f} of {gated + used:.0f} gated")
    return "; ".join(said).replace("+-", "±").replace("^2", "²")


def _with_unit_behind_number(value: str, unit: str) -> str:
    """Insert the unit: `2.02 m for 90 s`, `-1.82 +- 0.096 m/s^2`."""
    first, parts, rest = value.partition(" for ")
    return f"{first} {unit}".rstrip() + parts + rest


def residual_figure(drive: Drive, residuals: SourceResiduals, n_pieces: int) -> Figure:
    """The residuals as dots, gated ones as crosses, in the 95 % band of the white noise; what is beyond the axis stands
    at its edge."""
    data: list[Trace] = []
    layout: dict[str, Any] = {}
    parts = RESIDUAL_COMPONENTS[residuals.kind]
    n = len(parts)
    at = drive.seconds_since_start(residuals.stamp_ns)
    span = rounded_json_numbers(np.array([at.min(), at.max()]), 2)
    for index, (name, unit, _) in enumerate(parts):
        key = "y" if index == 0 else f"y{index + 1}"
        values = residuals.values[:, index]
        limit = _half_height_of_residual_axis(values[~residuals.is_gated], residuals.sigma)
        top = 1.0 - index * (1.0 / n)
        layout[f"yaxis{key[1:]}"] = axis_settings(
            f"{name}<br>[{unit}]", domain=[round(top - 1.0 / n + (0.06 if n > 1 else 0.0), 4), round(top, 4)],
            range=rounded_json_numbers(np.array([-limit, limit]), 6), zeroline=True,
        )  # fmt: skip
        more = {"yaxis": key, "showlegend": index == 0}
        if math.isfinite(residuals.sigma):
            edge = rounded_json_numbers(np.array([-1.0, 1.0]) * INTERVAL_95_SIGMAS * residuals.sigma, 6)
            x, y = [span[0], span[1], span[1], span[0]], [edge[0], edge[0], edge[1], edge[1]]
            data.append(polygon_trace(x, y, "95 % of the noise", EGO_COLOUR, alpha=0.15, legendgroup="noise", **more))
        for rows, label, style in (
            (~residuals.is_gated, "residual", {"colour": MEASURED_COLOUR, "size": 3, "opacity": 0.6}),
            (residuals.is_gated, "gated", {"colour": WARNING_COLOUR, "size": 5, "symbol": "x"}),
        ):
            data += _residual_dot_traces(at[rows], values[rows], limit, n_pieces, label, {**style, **more}, unit)
    layout["xaxis"] = axis_settings("time since the log began [s]", anchor=f"y{n}" if n > 1 else "y", range=span)
    return {"data": data, "layout": layout}


def _half_height_of_residual_axis(believed: FloatArray, sigma: float) -> float:
    """Return half the height of the axis, in the component's unit."""
    known = np.abs(believed[np.isfinite(believed)])
    most = float(np.quantile(known, 0.998)) if len(known) else 0.0
    return 1.1 * max(most, MIN_HALF_HEIGHT_OF_AXIS_SIGMAS * sigma if math.isfinite(sigma) else 0.0) or 1.0


def _residual_dot_traces(
    times_s: FloatArray, values: FloatArray, limit: float, n_pieces: int, label: str, style: dict[str, Any],
    unit: str,
) -> list[Trace]:  # fmt: skip
    """Return the dots of residuals; those beyond the axis are drawn at its edge."""
    shown = np.clip(values, -limit, limit)
    rows = first_row_per_grid_cell(times_s, shown, n_pieces, N_DOT_GRID_ROWS)
    if not len(rows):
        return []
    x, y = rounded_json_numbers(times_s[rows], 2), rounded_json_numbers(shown[rows], 4)
    text = [f"{value:.3g} {escape_figure_text(unit)}" for value in values[rows].tolist()] if label == "gated" else None
    hover = {"text": text, "hovertemplate": "%{x} s: %{text}, gated"} if text else {"hoverinfo": "skip"}
    return [marker_trace(x, y, label, legendgroup=label, **hover, **style)]
