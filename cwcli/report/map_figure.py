"""The map: where the car and the others drove, the raw fixes, and where the warnings were."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cwcli.digest.drive import Drive, OtherTrack
from cwcli.digest.encounters import DriveEncounters
from cwcli.estimation.measurements import Kind
from cwcli.measures.pair import ActualTrack, interpolate_x_y_speed_heading
from cwcli.report.decimate import first_row_per_grid_cell, simplified_track_row_indices
from cwcli.report.drawing import (
    EGO_COLOUR,
    MEASURED_COLOUR,
    OTHER_VEHICLE_COLOURS,
    TRUTH_COLOUR,
    WARNING_COLOUR,
    Figure,
    Trace,
    axis_settings,
    equalise_axis_scales,
    escape_figure_text,
    line_trace,
    marker_trace,
    rounded_json_numbers,
)
from cwcli.signals.columns import FloatArray, Int64Array

MAX_OTHERS_ON_MAP = 12
"""The greatest number of other vehicles on the map. Chosen by hand; not fitted."""
MAX_OTHERS_IN_LEGEND = 4
"""The greatest number of other vehicles that the legend names. Chosen by hand; not fitted."""
MAX_SPELLED_OUT_WARNINGS = 4
"""Greatest number of warnings whose labels say `warning 1`; of more they say only `1`. Chosen by hand; not fitted."""
MAX_WARNINGS_ON_MAP = 30
"""The greatest number of warnings that the map marks. Chosen by hand; not fitted."""
N_FIX_GRID_CELLS_PER_AXIS = 500
"""Cells of the grid along each axis; of fixes in one cell the first is drawn. Chosen by hand; not fitted."""
TRACK_EXTENT_PER_TOLERANCE = 4000.0
"""The track's extent divided by this is the tolerance of its simplification. Chosen by hand; not fitted."""
MIN_TRACK_TOLERANCE_M = 0.02
"""The least tolerance of a track's simplification, in m. Chosen by hand; not fitted."""
MAX_GAP_OF_DRAWN_LINE_S = 2.0
"""Longest gap in s across which a line is drawn. Chosen by hand; not fitted."""
MIN_HEADING_COSINE_OF_LABEL_ABOVE_CAR = 0.7
"""Least cosine of the heading at which a label stands above the car, else to its left. Chosen by hand; not fitted."""
AXIS_MARGIN_SHARE = 0.04
"""Margin at each end of an axis, as a share of what is drawn. Chosen by hand; not fitted."""
MIN_AXIS_MARGIN_M = 1.0
"""The least margin at each end of an axis, in m. Chosen by hand; not fitted."""
OTHERS_LINE_WIDTH_PX = 1.3
"""Line width of the other vehicles' tracks, in pixels. Chosen by hand; not fitted."""
TRACK_END_SYMBOLS = ("square", "diamond", "triangle-down", "pentagon", "hexagon", "star")
"""Plotly symbols at the ends of the others' tracks, in order."""


def build_map_figure(drive: Drive, drive_encounters: DriveEncounters) -> tuple[Figure, tuple[str, ...]] | None:
    """Build the map and the notes on what it leaves out; None if there is no position to draw."""
    if drive.ego is None and not drive.others:
        return None
    shown = select_other_tracks_for_map(drive, drive_encounters)
    data, own = [{**trace, "legendrank": 1} for trace in _fix_traces(drive)], list[Trace]()
    tolerance = MIN_TRACK_TOLERANCE_M
    if drive.ego is not None:
        xy = drive.ego.state[:, :2]
        tolerance = max(tolerance, float(np.ptp(xy, axis=0).max()) / TRACK_EXTENT_PER_TOLERANCE)
        if drive.truth is not None:
            own.append(
                _track_trace(
                    drive, drive.truth.stamp_ns, drive.truth.xy, tolerance, "the truth", LineStyle(TRUTH_COLOUR, "dot")
                )
            )
        own.append(_track_trace(drive, drive.ego.stamp_ns, xy, tolerance, "the car, estimated", LineStyle(EGO_COLOUR)))
    for index, other in enumerate(shown):
        stamps, states = other.track.stamp_ns, other.track.state
        colour = OTHER_VEHICLE_COLOURS[index % len(OTHER_VEHICLE_COLOURS)]
        track = _track_trace(
            drive,
            stamps,
            states[:, :2],
            tolerance,
            escaped_vehicle_name(other),
            LineStyle(colour, width_px=OTHERS_LINE_WIDTH_PX),
        )
        data.append(track if index < MAX_OTHERS_IN_LEGEND else {**track, "showlegend": False})
        data.append(_track_end_trace(other, index))
    data += [{**trace, "legendrank": 2} for trace in own]  # above the others, but named before them
    if drive.ego is not None:
        x, y = (rounded_json_numbers(drive.ego.state[:1, column], 2) for column in (0, 1))
        data.append(marker_trace(x, y, "start", EGO_COLOUR, symbol="circle-open", size=11))
        data += _warning_traces(drive, drive_encounters, ActualTrack(drive.ego.stamp_ns, drive.ego.state))
    across, up = _axis_range_with_margin_m(data, "x"), _axis_range_with_margin_m(data, "y")
    if across is None or up is None:
        return None
    layout: dict[str, Any] = equalise_axis_scales(
        {
            "xaxis": axis_settings("east [m]", range=across),
            "yaxis": axis_settings("north [m]", range=up),
            "dragmode": "pan",
        }
    )
    left_out = []
    if len(shown) > MAX_OTHERS_IN_LEGEND:
        left_out.append(
            f"the map's legend names {MAX_OTHERS_IN_LEGEND} of the {len(shown)} others; pointing at a line names it"
        )
    if len(drive.others) > len(shown):
        left_out.append(f"{len(drive.others) - len(shown)} of {len(drive.others)} other vehicles are not on the map")
    if drive_encounters.n_not_compared:
        left_out.append(f"the distance of {drive_encounters.n_not_compared} others was not computed")
    if len(drive_encounters.encounters) > MAX_WARNINGS_ON_MAP:
        left_out.append(f"the map marks the first {MAX_WARNINGS_ON_MAP} of {len(drive_encounters.encounters)} warnings")
    return {"data": data, "layout": layout}, tuple(left_out)


def select_other_tracks_for_map(drive: Drive, drive_encounters: DriveEncounters) -> list[OtherTrack]:
    """Return the others on the map: those warned of, missed or nearest, then the longest tracks."""
    first: dict[int, OtherTrack] = {}
    for other in (
        *(encounter.other for encounter in drive_encounters.encounters),
        *(missed.other for missed in drive_encounters.missed_conflicts),
        drive_encounters.nearest.other if drive_encounters.nearest else None,
        *sorted(drive.others, key=lambda other: -len(other.track.stamp_ns)),
    ):
        if other is not None:
            first.setdefault(id(other), other)
    return list(first.values())[:MAX_OTHERS_ON_MAP]


def escaped_vehicle_name(other: OtherTrack) -> str:
    """Return a name such as `vehicle 17`, escaped for a figure."""
    return f"{other.kind} {escape_figure_text(other.id)}"


def insert_nan_rows_in_time_gaps(
    stamp_ns: Int64Array, values: FloatArray, break_s: float = MAX_GAP_OF_DRAWN_LINE_S
) -> tuple[Int64Array, FloatArray]:
    """Insert a row of NaN in each gap longer than `break_s`, so that no line is drawn there."""
    after = np.flatnonzero(np.diff(stamp_ns) > break_s * 1e9) + 1
    if not len(after):
        return stamp_ns, values
    return np.insert(stamp_ns, after, stamp_ns[after - 1]), np.insert(values, after, np.nan, axis=0)


def _axis_range_with_margin_m(data: list[Trace], name: str) -> list[float | None] | None:
    """Return the range of an axis: all that is drawn and a margin; None if nothing is drawn."""
    numbers = np.array([value for trace in data for value in trace[name] if value is not None], np.float64)
    if not len(numbers):
        return None
    margin = max(AXIS_MARGIN_SHARE * float(np.ptp(numbers)), MIN_AXIS_MARGIN_M)
    return rounded_json_numbers(np.array([numbers.min() - margin, numbers.max() + margin]), 2)


def _track_end_trace(other: OtherTrack, index: int) -> Trace:
    """Return the marker at the end of a track, with the vehicle's name if the legend has it."""
    colour = OTHER_VEHICLE_COLOURS[index % len(OTHER_VEHICLE_COLOURS)]
    known = np.flatnonzero(np.isfinite(other.track.state[:, :2]).all(axis=1))[-1:]
    x, y = (rounded_json_numbers(other.track.state[known, column], 2) for column in (0, 1))
    end = marker_trace(
        x, y, escaped_vehicle_name(other), colour, symbol=TRACK_END_SYMBOLS[index % len(TRACK_END_SYMBOLS)], size=8
    )
    end |= {"showlegend": False, "hovertemplate": "the end of %{fullData.name}<extra></extra>"}
    if index < MAX_OTHERS_IN_LEGEND:
        end |= {"mode": "markers+text", "text": [escape_figure_text(other.id)], "textposition": "top right"}
        end["textfont"] = {"color": colour, "size": 11}
    return end


class LineStyle(NamedTuple):
    """How a line is drawn: colour, `solid` or `dot`, and width."""

    colour: str
    dash: str = "solid"
    width_px: float = 2.0


def _track_trace(
    drive: Drive, stamp_ns: Int64Array, xy: FloatArray, tolerance: float, name: str, style: LineStyle
) -> Trace:
    """Return the simplified line of a track."""
    stamp_ns, xy = insert_nan_rows_in_time_gaps(stamp_ns, xy)
    rows = simplified_track_row_indices(xy, tolerance)
    return line_trace(
        rounded_json_numbers(xy[rows, 0], 2),
        rounded_json_numbers(xy[rows, 1], 2),
        name,
        style.colour,
        dash=style.dash,
        width=style.width_px,
        customdata=rounded_json_numbers(drive.seconds_since_start(stamp_ns[rows]), 2),
        hovertemplate="%{customdata} s<br>%{x} m east, %{y} m north",
    )


def _fix_traces(drive: Drive) -> list[Trace]:
    """Return the trace of the raw positions; those in one grid cell are drawn once."""
    found = [measured for measured in drive.measurements if measured.kind is Kind.POSITION]
    traces = []
    for measured in found[:1]:
        rows = first_row_per_grid_cell(
            measured.values[:, 0], measured.values[:, 1], N_FIX_GRID_CELLS_PER_AXIS, N_FIX_GRID_CELLS_PER_AXIS
        )
        x, y = measured.values[rows].T
        traces.append(
            marker_trace(
                rounded_json_numbers(x, 2),
                rounded_json_numbers(y, 2),
                "raw position fixes",
                MEASURED_COLOUR,
                size=4,
                opacity=0.6,
                customdata=rounded_json_numbers(drive.seconds_since_start(measured.stamp_ns[rows]), 2),
                hovertemplate="%{customdata} s<br>%{x} m east, %{y} m north",
            )
        )
    return traces


def _warning_traces(drive: Drive, drive_encounters: DriveEncounters, ego: ActualTrack) -> list[Trace]:
    """Return the markers of the warnings: the ego, the other, and the nearest approach."""
    gap_s = drive.warning_config.max_gap_s
    shown = drive_encounters.encounters[:MAX_WARNINGS_ON_MAP]
    if not shown:
        return []
    word = "warning " if len(shown) <= MAX_SPELLED_OUT_WARNINGS else ""
    raised = interpolate_x_y_speed_heading(ego, np.array([each.raised_ns for each in shown], np.int64), gap_s)
    traces = [
        {
            **marker_trace(
                rounded_json_numbers(raised[:, 0], 2),
                rounded_json_numbers(raised[:, 1], 2),
                "warning given",
                WARNING_COLOUR,
                symbol="triangle-up",
                size=15,
            ),
            "mode": "markers+text",
            "text": [f"<b>{word}{each.event_id}</b>" for each in shown],
            "textposition": [
                "top center" if abs(np.cos(state[3])) > MIN_HEADING_COSINE_OF_LABEL_ABOVE_CAR else "middle left"
                for state in raised
            ],
            "textfont": {"color": WARNING_COLOUR, "size": 13},
            "cliponaxis": False,
        }
    ]
    others = [(each, each.other) for each in shown if each.other is not None]
    at_warning = [
        interpolate_x_y_speed_heading(other.track, np.array([each.raised_ns], np.int64), gap_s)[0]
        for each, other in others
    ]
    if at_warning:
        warning_places = np.array(at_warning)
        name = "the other at that moment"
        traces.append(
            marker_trace(
                rounded_json_numbers(warning_places[:, 0], 2),
                rounded_json_numbers(warning_places[:, 1], 2),
                name,
                WARNING_COLOUR,
                symbol="triangle-up-open",
                size=12,
            )
        )
    nearest_ns = [each.verdict.closest_ns for each, _ in others if each.verdict and each.verdict.closest_ns >= 0]
    if nearest_ns:
        nearest = interpolate_x_y_speed_heading(ego, np.array(nearest_ns, np.int64), gap_s)
        traces.append(
            marker_trace(
                rounded_json_numbers(nearest[:, 0], 2),
                rounded_json_numbers(nearest[:, 1], 2),
                "nearest approach",
                "#000000",
                symbol="x",
                size=9,
            )
        )
    return traces
