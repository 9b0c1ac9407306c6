"""One warning in two figures: where both cars were expected to go, and how near they came."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cwcli.report.decimate import envelope_rows, track_rows
from cwcli.report.drawing import (
    ALERT,
    EGO,
    OTHERS,
    Figure,
    Trace,
    axis,
    dots,
    equal_axes,
    line,
    polygon,
    rounded,
    upright,
)
from cwcli.report.drive import Drive, ego_size
from cwcli.report.encounters import Encounter, predicted
from cwcli.report.map_figure import other_name, with_breaks
from cwcli.report.paths import Path2D
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import NS_PER_S
from cwcli.warning.actual import interpolate
from cwcli.warning.types import ActualTrack

OTHER = OTHERS[0]
BEFORE_S, AFTER_S = 6.0, 6.0
FAN_BEFORE_S, FAN_AFTER_S = 1.0, 4.0
ELLIPSE_EVERY_S = 0.5
MAX_ELLIPSES = 12
N_PIECES = 250
MAX_TTC_S = 10.0


def fan_figure(drive: Drive, encounter: Encounter, paths: tuple[Path2D | None, Path2D | None]) -> Figure | None:
    """Both predicted paths at the moment of the warning, with 1-sigma ellipses, and what both really did.

    Seen from above, turned so that the car drives upwards. None where the ego's place is not known.

    Args:
        paths: Of the ego and of the other, as known when the warning was given.
    """
    assert drive.ego is not None
    at = np.array([encounter.raised_ns], np.int64)
    ego = ActualTrack(drive.ego.stamp_ns, drive.ego.state)
    own = interpolate(ego, at, drive.rule.max_gap_s)[0]
    if not np.isfinite(own).all():
        return None
    view = _View(own)
    tracks = [(ego, EGO, "the car", ego_size(drive.ego))]
    if encounter.other is not None:
        tracks.append((encounter.other.track, OTHER, other_name(encounter.other), encounter.other.size_m))
    data: list[Trace] = []
    for path, (_, colour, name, _) in zip(paths, tracks, strict=False):
        if path is not None:
            data += _fan(view, path, colour, name, drive.rule.horizon_s)
    for track, colour, name, size in tracks:
        data += _driven(drive, encounter, view, track, colour, name, size)
    layout: dict[str, Any] = equal_axes(
        {
            "xaxis": axis("to the right of the car [m]"),
            "yaxis": axis("ahead of the car [m]"),
            "dragmode": "pan",
        }
    )
    return {"data": data, "layout": layout}


class _View:
    """From the map into what the driver sees: x to the right, y ahead."""

    def __init__(self, own: FloatArray) -> None:
        self._origin = own[:2]
        forward = np.array([math.cos(own[3]), math.sin(own[3])])
        self._right_ahead = np.array([[forward[1], forward[0]], [-forward[0], forward[1]]])

    def points(self, xy: FloatArray) -> FloatArray:
        """Points of the map, shape (n, 2)."""
        return np.asarray((xy - self._origin) @ self._right_ahead, np.float64)

    def xy(self, xy: FloatArray) -> tuple[list[float | None], list[float | None]]:
        """The points as Plotly's two lists."""
        seen = self.points(xy)
        return rounded(seen[:, 0], 2), rounded(seen[:, 1], 2)


def _fan(view: _View, path: Path2D, colour: str, name: str, horizon_s: float) -> list[Trace]:
    keep = path.time_s <= horizon_s + 1e-6
    x, y = view.xy(path.xy_m[keep])
    every = np.arange(ELLIPSE_EVERY_S, horizon_s + 1e-6, max(ELLIPSE_EVERY_S, horizon_s / MAX_ELLIPSES))
    rows = np.unique(np.clip(np.searchsorted(path.time_s, every - 1e-6), 0, int(keep.sum()) - 1))
    edges_x: list[float | None] = []
    edges_y: list[float | None] = []
    for row in rows.tolist():
        ellipse = _ellipse(path.xy_m[row], path.covariance_m2[row])
        if ellipse is not None:
            ex, ey = view.xy(ellipse)
            edges_x += [*ex, None]
            edges_y += [*ey, None]
    return [
        polygon(edges_x, edges_y, f"{name}: 1-sigma of the prediction", colour, alpha=0.22, legendgroup=name),
        line(
            x,
            y,
            f"{name}: predicted",
            colour,
            width=3,
            legendgroup=name,
            customdata=rounded(path.time_s[keep], 2),
            hovertemplate="%{customdata} s ahead",
        ),
    ]


def _ellipse(centre: FloatArray, packed: FloatArray) -> FloatArray | None:
    """Points of the 1-sigma ellipse, shape (n, 2), or None where the covariance is none."""
    xx, xy, yy = packed.tolist()
    covariance = np.array([[xx, xy], [xy, yy]])
    if not np.isfinite(covariance).all():
        return None
    sizes, directions = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * math.pi, 25)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.asarray(centre + (circle * np.sqrt(np.maximum(sizes, 0.0))) @ directions.T, np.float64)


def _driven(
    drive: Drive,
    encounter: Encounter,
    view: _View,
    track: ActualTrack,
    colour: str,
    name: str,
    size_m: tuple[float, float],
) -> list[Trace]:
    """The outline at the warning, the way that was really driven, and the outline at the nearest approach."""
    first = np.searchsorted(track.stamp_ns, encounter.raised_ns - round(FAN_BEFORE_S * NS_PER_S))
    last = np.searchsorted(track.stamp_ns, _fan_end_ns(encounter), side="right")
    stamps, states = with_breaks(track.stamp_ns[first:last], track.state[first:last, :2])
    rows = track_rows(states, 0.05)
    x, y = view.xy(states[rows])
    seconds = rounded(drive.seconds(stamps[rows]), 2)
    hover = {"customdata": seconds, "hovertemplate": "%{customdata} s"}
    traces = [line(x, y, f"{name}: driven", colour, dash="dot", width=2, legendgroup=name, **hover)]
    moments = [(encounter.raised_ns, "at the warning", 0.85)]
    if encounter.verdict is not None and encounter.verdict.closest_ns >= 0:
        moments.append((encounter.verdict.closest_ns, "at the nearest approach", 0.25))
    for at_ns, when, alpha in moments:
        state = interpolate(track, np.array([at_ns], np.int64), drive.rule.max_gap_s)[0]
        if np.isfinite(state).all():
            x, y = view.xy(_outline(state, size_m))
            shape = polygon(x, y, f"{name} {when}", colour, alpha=alpha, legendgroup=name)
            traces.append({**shape, "line": {"width": 1.5, "color": colour}, "showlegend": False})
    return traces


def _fan_end_ns(encounter: Encounter) -> int:
    end_ns = encounter.raised_ns + round(FAN_AFTER_S * NS_PER_S)
    if encounter.verdict is not None and encounter.verdict.closest_ns >= 0:
        end_ns = min(end_ns, encounter.verdict.closest_ns + NS_PER_S // 2)
    return max(end_ns, encounter.raised_ns + NS_PER_S)


def _outline(state: FloatArray, size_m: tuple[float, float]) -> FloatArray:
    """The corners of a vehicle's outline in the map, closed, shape (5, 2)."""
    length, width = size_m
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]]) * np.array([length, width]) / 2.0
    cos, sin = math.cos(state[3]), math.sin(state[3])
    return np.asarray(state[:2] + corners @ np.array([[cos, sin], [-sin, cos]]), np.float64)


def distance_figure(drive: Drive, encounter: Encounter) -> Figure | None:
    """Distance and time to collision around a warning; None where the tracks do not tell."""
    motion = encounter.motion
    if motion is None or drive.warnings is None:
        return None
    before_ns, after_ns = round(BEFORE_S * NS_PER_S), round(AFTER_S * NS_PER_S)
    first = int(np.searchsorted(motion.stamp_ns, encounter.raised_ns - before_ns))
    last = int(np.searchsorted(motion.stamp_ns, max(encounter.last_ns, encounter.raised_ns + after_ns), side="right"))
    if last - first < 2:
        return None
    part = slice(first, last)
    stamps = motion.stamp_ns[part]
    columns = np.column_stack([motion.distance_m[part], motion.gap_m[part], motion.ttc_s[part]])
    columns[columns[:, 2] > MAX_TTC_S, 2] = np.nan
    stamps, columns = with_breaks(stamps, columns, drive.rule.max_gap_s)
    seconds = drive.seconds(stamps)

    def curve(column: int, name: str, colour: str, decimals: int, unit: str, **more: Any) -> Trace:
        rows = envelope_rows(columns[:, column], N_PIECES)
        hover = f"%{{x}} s: %{{y}} {unit}"
        x, y = rounded(seconds[rows], 3), rounded(columns[rows, column], decimals)
        return line(x, y, name, colour, hovertemplate=hover, **more)

    data = [
        curve(0, "distance, centre to centre", EGO, 2, "m"),
        curve(1, "gap between the outlines", OTHERS[1], 2, "m", dash="dash"),
        _predictions(drive, encounter),
        curve(2, "time to collision", OTHERS[4], 2, "s", yaxis="y2"),
    ]
    limit_m = drive.rule.distance_m
    shapes: list[Any] = [
        {
            "type": "line",
            "xref": "paper",
            "x0": 0,
            "x1": 1,
            "yref": "y",
            "y0": limit_m,
            "y1": limit_m,
            "line": {"color": "#000000", "width": 1, "dash": "dot"},
        }
    ]
    labels: list[Any] = [
        {
            "xref": "paper",
            "x": 0,
            "xanchor": "left",
            "yref": "y",
            "y": limit_m,
            "yanchor": "bottom",
            "text": f"collision distance {limit_m:g} m",
            "showarrow": False,
            "font": {"size": 11},
        }
    ]
    marks = [(encounter.raised_ns, "warning", ALERT)]
    if encounter.verdict is not None and encounter.verdict.closest_ns >= 0:
        marks.append((encounter.verdict.closest_ns, "nearest", "#000000"))
    for at_ns, text, colour in marks:
        shape, label = upright(round((at_ns - drive.start_ns) / NS_PER_S, 3), text, colour)
        shapes.append(shape)
        labels.append(label)
    layout = {
        "xaxis": axis("time since the log began [s]", anchor="y2"),
        "yaxis": axis("distance [m]", domain=[0.4, 1.0], rangemode="tozero"),
        "yaxis2": axis("time to<br>collision [s]", domain=[0.0, 0.3], rangemode="tozero"),
        "shapes": shapes,
        "annotations": labels,
    }
    return {"data": data, "layout": layout}


def _predictions(drive: Drive, encounter: Encounter) -> Trace:
    """What the warning said while it stood: the distance that both would have at the event."""
    assert drive.warnings is not None
    distance_m = predicted(drive.warnings, encounter.rows, "predicted_distance_m")
    stamp_ns = np.asarray(drive.warnings.fields["stamp_ns"])[encounter.rows].astype(np.int64)
    rows = envelope_rows(distance_m, N_PIECES // 2)
    x, y = rounded(drive.seconds(stamp_ns[rows]), 3), rounded(distance_m[rows], 2)
    name = "predicted least distance, while the warning stood"
    return dots(x, y, name, ALERT, size=5, symbol="diamond", hovertemplate="%{x} s: %{y} m")
