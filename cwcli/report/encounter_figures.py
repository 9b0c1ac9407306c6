"""One warning in two figures: where both cars were expected to go, and how near they came."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cwcli.digest.drive import Drive, ego_length_and_width_m
from cwcli.digest.encounters import Encounter, NearestApproach
from cwcli.measures.collision_time import TTC
from cwcli.measures.deceleration import DRAC
from cwcli.measures.distances import DISTANCE, GAP
from cwcli.measures.pair import ActualTrack, Pair, interpolate_x_y_speed_heading
from cwcli.prediction.paths import Paths
from cwcli.report.decimate import min_max_row_indices, simplified_track_row_indices
from cwcli.report.drawing import (
    EGO_COLOUR,
    OTHER_VEHICLE_COLOURS,
    WARNING_COLOUR,
    Figure,
    Trace,
    axis_settings,
    equalise_axis_scales,
    line_trace,
    marker_trace,
    polygon_trace,
    rounded_json_numbers,
    vertical_line_with_label,
)
from cwcli.report.map_figure import escaped_vehicle_name, insert_nan_rows_in_time_gaps
from cwcli.report.signal_figures import other_system_warning_lines
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import NS_PER_S

OTHER_VEHICLE_COLOUR = OTHER_VEHICLE_COLOURS[0]
"""Colour of the other vehicle."""
DISTANCE_FIGURE_TIME_BEFORE_WARNING_S = 4.0
"""Time before a warning that the distance figure shows, in s. Chosen by hand; not fitted."""
MIN_DISTANCE_FIGURE_TIME_AFTER_WARNING_S = 5.0
"""Time after a warning that the distance figure shows at least, in s. Chosen by hand; not fitted."""
INITIAL_DISTANCE_AXIS_M = 30.0
"""Upper end of the distance axis at first, in m, unless the vehicles stayed farther apart.
Chosen by hand; not fitted."""
DRIVEN_PATH_FIGURE_TIME_BEFORE_WARNING_S = 1.0
"""Time before a warning of which the driven path is drawn, in s. Chosen by hand; not fitted."""
MAX_DRIVEN_PATH_FIGURE_TIME_AFTER_WARNING_S = 4.0
"""Time after a warning of which the driven path is drawn at most, in s. Chosen by hand; not fitted."""
ELLIPSE_SPACING_S = 0.5
"""Time between the ellipses along a predicted path, in s, at least. Chosen by hand; not fitted."""
MAX_ELLIPSES_PER_PATH = 12
"""The greatest number of ellipses along a predicted path. Chosen by hand; not fitted."""
N_ENVELOPE_PIECES = 250
"""Number of pieces whose smallest and largest value is drawn of a curve. Chosen by hand; not fitted."""
MAX_SHOWN_TTC_S = 10.0
"""Largest time to collision that is drawn, s. Chosen by hand; not fitted."""
MAX_SHOWN_DRAC_MPS2 = 10.0
"""Value in m/s^2 at which larger decelerations are drawn. Chosen by hand; not fitted."""
MEASURE_STRIPS = (
    (TTC, "time to collision (TTC)", "TTC [s]", "s", MAX_SHOWN_TTC_S, OTHER_VEHICLE_COLOURS[4]),
    (
        DRAC,
        "deceleration that avoids it (DRAC)",
        "DRAC<br>[m/s²]",
        "m/s²",
        MAX_SHOWN_DRAC_MPS2,
        OTHER_VEHICLE_COLOURS[2],
    ),
)
"""Measures below the distance: measure, description, axis title, unit, top of the axis, colour."""
DISTANCE_PANEL_HEIGHT_SHARE_BY_NUMBER_OF_STRIPS = (1.0, 0.6, 0.44)
"""Share of the figure's height for the distance when no, one or two strips lie below it. Chosen by hand; not fitted."""
DRAWN_SHARE_OF_STRIP_HEIGHT = 0.74
"""Share of a strip's height that is drawn; the rest separates the strips. Chosen by hand; not fitted."""


def predicted_paths_figure(
    drive: Drive, encounter: Encounter, paths: tuple[Paths | None, Paths | None]
) -> Figure | None:
    """Draw both predicted paths at the moment of a warning, with 1-sigma ellipses, and the driven paths.

    Seen from above, turned so that the car drives upwards. None where the ego's place is not known.

    Args:
        paths: Of the ego and of the other, as known when the warning was given.
    """
    if drive.ego is None or encounter.is_lane_departure:
        return None
    at = np.array([encounter.raised_ns], np.int64)
    ego = ActualTrack(drive.ego.stamp_ns, drive.ego.state)
    own = interpolate_x_y_speed_heading(ego, at, drive.warning_config.max_gap_s)[0]
    if not np.isfinite(own).all():
        return None
    view = _DriverView(own)
    tracks = [(ego, EGO_COLOUR, "the car", ego_length_and_width_m(drive.ego))]
    if encounter.other is not None:
        tracks.append(
            (encounter.other.track, OTHER_VEHICLE_COLOUR, escaped_vehicle_name(encounter.other), encounter.other.size_m)
        )
    data: list[Trace] = []
    for path, (_, colour, name, _) in zip(paths, tracks, strict=False):
        if path is not None:
            data += _predicted_path_traces(view, path, colour, name, drive.warning_config.horizon_s)
    for track, colour, name, size in tracks:
        data += _driven_path_traces(drive, encounter, view, track, colour, name, size)
    layout: dict[str, Any] = equalise_axis_scales(
        {
            "xaxis": axis_settings("to the right of the car [m]"),
            "yaxis": axis_settings("ahead of the car [m]"),
            "dragmode": "pan",
        }
    )
    return {"data": data, "layout": layout}


class _DriverView:
    """Transforms points of the map into the driver's view: x to the right, y ahead."""

    def __init__(self, own: FloatArray) -> None:
        self._origin = own[:2]
        forward = np.array([math.cos(own[3]), math.sin(own[3])])
        self._right_ahead = np.array([[forward[1], forward[0]], [-forward[0], forward[1]]])

    def map_points_in_view_m(self, xy: FloatArray) -> FloatArray:
        """Transform points of the map, shape (n, 2), in m."""
        return np.asarray((xy - self._origin) @ self._right_ahead, np.float64)

    def plotly_x_and_y_lists(self, xy: FloatArray) -> tuple[list[float | None], list[float | None]]:
        """Transform points of the map, shape (n, 2), into Plotly's lists of x and y."""
        view_xy_m = self.map_points_in_view_m(xy)
        return rounded_json_numbers(view_xy_m[:, 0], 2), rounded_json_numbers(view_xy_m[:, 1], 2)


def _predicted_path_traces(view: _DriverView, path: Paths, colour: str, name: str, horizon_s: float) -> list[Trace]:
    """Return the traces of a predicted path and of its ellipses."""
    keep = path.time_s <= horizon_s + 1e-6
    xy_m = np.stack([path.x_m[0], path.y_m[0]], axis=1)
    x, y = view.plotly_x_and_y_lists(xy_m[keep])
    every = np.arange(ELLIPSE_SPACING_S, horizon_s + 1e-6, max(ELLIPSE_SPACING_S, horizon_s / MAX_ELLIPSES_PER_PATH))
    rows = np.unique(np.clip(np.searchsorted(path.time_s, every - 1e-6), 0, int(keep.sum()) - 1))
    edges_x: list[float | None] = []
    edges_y: list[float | None] = []
    for row in rows.tolist():
        ellipse = _one_sigma_ellipse_points_or_none(xy_m[row], path.position_covariance_m2[0, row])
        if ellipse is not None:
            ex, ey = view.plotly_x_and_y_lists(ellipse)
            edges_x += [*ex, None]
            edges_y += [*ey, None]
    return [
        polygon_trace(edges_x, edges_y, f"{name}: 1-sigma of the prediction", colour, alpha=0.3, showlegend=False),
        line_trace(
            x,
            y,
            f"{name}: predicted",
            colour,
            width=3,
            customdata=rounded_json_numbers(path.time_s[keep], 2),
            hovertemplate="%{customdata} s ahead",
        ),
    ]


def _one_sigma_ellipse_points_or_none(centre: FloatArray, packed: FloatArray) -> FloatArray | None:
    """Return points of the 1-sigma ellipse, shape (n, 2), or None if the covariance is not finite."""
    xx, xy, yy = packed.tolist()
    covariance = np.array([[xx, xy], [xy, yy]])
    if not np.isfinite(covariance).all():
        return None
    sizes, directions = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * math.pi, 25)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.asarray(centre + (circle * np.sqrt(np.maximum(sizes, 0.0))) @ directions.T, np.float64)


def _driven_path_traces(
    drive: Drive,
    encounter: Encounter,
    view: _DriverView,
    track: ActualTrack,
    colour: str,
    name: str,
    size_m: tuple[float, float],
) -> list[Trace]:
    """Return the traces of the driven path and of the outlines at the warning and at the nearest approach."""
    first = np.searchsorted(
        track.stamp_ns, encounter.raised_ns - round(DRIVEN_PATH_FIGURE_TIME_BEFORE_WARNING_S * NS_PER_S)
    )
    last = np.searchsorted(track.stamp_ns, _driven_path_end_ns(encounter), side="right")
    stamps, states = insert_nan_rows_in_time_gaps(track.stamp_ns[first:last], track.state[first:last, :2])
    rows = simplified_track_row_indices(states, 0.05)
    x, y = view.plotly_x_and_y_lists(states[rows])
    seconds = rounded_json_numbers(drive.seconds_since_start(stamps[rows]), 2)
    hover = {"customdata": seconds, "hovertemplate": "%{customdata} s"}
    traces = [line_trace(x, y, f"{name}: driven", colour, dash="dot", width=2, **hover)]
    moments = [(encounter.raised_ns, "at the warning", 0.85)]
    if encounter.verdict is not None and encounter.verdict.closest_ns >= 0:
        moments.append((encounter.verdict.closest_ns, "at the nearest approach", 0.25))
    for at_ns, when, alpha in moments:
        state = interpolate_x_y_speed_heading(track, np.array([at_ns], np.int64), drive.warning_config.max_gap_s)[0]
        if np.isfinite(state).all():
            x, y = view.plotly_x_and_y_lists(_closed_outline_corners_m(state, size_m))
            shape = polygon_trace(x, y, f"{name} {when}", colour, alpha=alpha)
            traces.append({**shape, "line": {"width": 1.5, "color": colour}, "showlegend": False})
    return traces


def _driven_path_end_ns(encounter: Encounter) -> int:
    """Return the stamp at which the driven path ends."""
    end_ns = encounter.raised_ns + round(MAX_DRIVEN_PATH_FIGURE_TIME_AFTER_WARNING_S * NS_PER_S)
    if encounter.verdict is not None and encounter.verdict.closest_ns >= 0:
        end_ns = min(end_ns, encounter.verdict.closest_ns + NS_PER_S // 2)
    return max(end_ns, encounter.raised_ns + NS_PER_S)


def _closed_outline_corners_m(state: FloatArray, size_m: tuple[float, float]) -> FloatArray:
    """Return the corners of a vehicle's outline in the map, closed, shape (5, 2)."""
    length, width = size_m
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]]) * np.array([length, width]) / 2.0
    cos, sin = math.cos(state[3]), math.sin(state[3])
    return np.asarray(state[:2] + corners @ np.array([[cos, sin], [-sin, cos]]), np.float64)


def distance_and_ttc_figure_around_warning(drive: Drive, encounter: Encounter) -> Figure | None:
    """Draw distance and time to collision around a warning; None where the tracks have no common time."""
    if encounter.pair is None or drive.warnings is None:
        return None
    until_ns = max(encounter.last_ns, encounter.raised_ns + round(MIN_DISTANCE_FIGURE_TIME_AFTER_WARNING_S * NS_PER_S))
    marks = [(encounter.raised_ns, "warning", WARNING_COLOUR)]
    if encounter.verdict is not None and encounter.verdict.closest_ns >= 0:
        marks.append((encounter.verdict.closest_ns, "nearest", "#000000"))
    since_ns = encounter.raised_ns - round(DISTANCE_FIGURE_TIME_BEFORE_WARNING_S * NS_PER_S)
    return _distance_figure_of_pair(
        drive, encounter.pair, (since_ns, until_ns), marks, [_predicted_distance_trace(drive, encounter)]
    )


def nearest_approach_figure(drive: Drive, nearest: NearestApproach) -> Figure | None:
    """Draw distance and time to collision around the nearest approach of a drive without warnings."""
    apart_ns = round(2.0 * MIN_DISTANCE_FIGURE_TIME_AFTER_WARNING_S * NS_PER_S)
    span = (nearest.stamp_ns - apart_ns, nearest.stamp_ns + apart_ns)
    return _distance_figure_of_pair(drive, nearest.pair, span, [(nearest.stamp_ns, "nearest", "#000000")], [])


def _distance_figure_of_pair(
    drive: Drive, pair: Pair, span_ns: tuple[int, int], marks: list[tuple[int, str, str]], more_traces: list[Trace]
) -> Figure | None:
    """Draw distance, gap and criticality of a pair over a time span; None of fewer than two rows."""
    first = int(np.searchsorted(pair.stamp_ns, span_ns[0]))
    last = int(np.searchsorted(pair.stamp_ns, span_ns[1], side="right"))
    if last - first < 2:
        return None
    part = slice(first, last)
    columns = np.column_stack([pair.evaluate_measure(measure)[part] for measure in (DISTANCE, GAP, TTC, DRAC)])
    columns[columns[:, 2] > MAX_SHOWN_TTC_S, 2] = np.nan
    columns[:, 3] = np.minimum(columns[:, 3], MAX_SHOWN_DRAC_MPS2)
    stamps, columns = insert_nan_rows_in_time_gaps(pair.stamp_ns[part], columns, drive.warning_config.max_gap_s)
    seconds = drive.seconds_since_start(stamps)

    def trace_column(column: int, name: str, colour: str, unit: str, **style: Any) -> Trace:
        rows = min_max_row_indices(columns[:, column], N_ENVELOPE_PIECES)
        x, y = rounded_json_numbers(seconds[rows], 3), rounded_json_numbers(columns[rows, column], 2)
        return line_trace(x, y, name, colour, hovertemplate=f"%{{x}} s: %{{y}} {unit}", **style)

    data = [
        trace_column(0, "distance, centre to centre", EGO_COLOUR, "m"),
        trace_column(1, "gap between the outlines", OTHER_VEHICLE_COLOURS[1], "m", dash="dash"),
        *more_traces,
    ]
    limit_m = drive.warning_config.distance_m
    drawn = [_threshold_line_with_label("y", limit_m, f"{limit_m:g} m counts as a collision")]
    strips = [(k, *strip) for k, strip in enumerate(MEASURE_STRIPS, start=2) if np.isfinite(columns[:, k]).any()]
    height = (1.0 - DISTANCE_PANEL_HEIGHT_SHARE_BY_NUMBER_OF_STRIPS[len(strips)]) / max(len(strips), 1)
    layout: dict[str, Any] = {
        "xaxis": axis_settings("time since the log began [s]", anchor="y2" if strips else "y"),
        "yaxis": axis_settings(
            "distance [m]",
            domain=[1.0 - DISTANCE_PANEL_HEIGHT_SHARE_BY_NUMBER_OF_STRIPS[len(strips)], 1.0],
            range=_initial_distance_range(columns),
        ),
    }
    for place, (k, measure, name, title, unit, most, colour) in enumerate(strips):
        data.append(trace_column(k, name, colour, unit, yaxis=f"y{place + 2}"))
        domain = [round(place * height, 3), round(place * height + DRAWN_SHARE_OF_STRIP_HEIGHT * height, 3)]
        layout[f"yaxis{place + 2}"] = axis_settings(title, domain=domain, range=[0.0, most])
        if measure.threshold is not None:
            text = f"{measure.threshold:g} {unit}: a conflict"
            drawn.append(_threshold_line_with_label(f"y{place + 2}", measure.threshold, text))
    drawn += [
        vertical_line_with_label(round((at_ns - drive.start_ns) / NS_PER_S, 3), text, colour)
        for at_ns, text, colour in marks
    ]
    drawn += other_system_warning_lines(drive, span_ns)
    layout["shapes"] = [shape for shape, _ in drawn]
    layout["annotations"] = [label for _, label in drawn]
    return {"data": data, "layout": layout}


def _initial_distance_range(columns: FloatArray) -> list[float]:
    """Return the initial range of the distance axis, which shows the small distances."""
    known = columns[:, :2][np.isfinite(columns[:, :2])]
    if not len(known):
        return [0.0, INITIAL_DISTANCE_AXIS_M]
    least = float(known.min())
    top = min(float(known.max()), max(INITIAL_DISTANCE_AXIS_M, 3.0 * least))
    return [round(min(0.0, least) - 0.05 * top, 2), round(1.05 * top, 2)]


def _threshold_line_with_label(yaxis: str, value: float, text: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a horizontal line at a threshold, and its label."""
    across = {"xref": "paper", "x0": 0, "x1": 1, "yref": yaxis, "y0": value, "y1": value}
    shape = {"type": "line", **across, "line": {"color": "#000000", "width": 1, "dash": "dot"}}
    place = {"xref": "paper", "x": 0, "xanchor": "left", "yref": yaxis, "y": value, "yanchor": "bottom"}
    return shape, {**place, "text": text, "showarrow": False, "font": {"size": 11}}


def _predicted_distance_trace(drive: Drive, encounter: Encounter) -> Trace:
    """Return the trace of the distance that the warning predicted at each evaluation."""
    assert drive.warnings is not None
    distance_m = drive.warnings.predicted_distance_m[encounter.rows]
    known_ns = drive.warnings.known_ns[encounter.rows]
    rows = min_max_row_indices(distance_m, N_ENVELOPE_PIECES // 2)
    x, y = rounded_json_numbers(drive.seconds_since_start(known_ns[rows]), 3), rounded_json_numbers(distance_m[rows], 2)
    name = "predicted least distance, while the warning stood"
    return marker_trace(x, y, name, WARNING_COLOUR, size=5, symbol="diamond", hovertemplate="%{x} s: %{y} m")
