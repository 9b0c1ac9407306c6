"""Predicted paths as lines that viewers draw: `foxglove.SceneUpdate` beside `cwcli.v1.PredictedPath`.

The scene is for viewing only: about five paths a second of each vehicle, each with eleven points. Computations use
`/cwcli/ego/path` and `/cwcli/remote/path`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cwcli.channels.predicted_path import LENGTH_FRACTION_BITS, AnyPaths
from cwcli.channels.published import PATH_SCENE
from cwcli.signals.columns import (
    FloatArray,
    Int64Array,
    OutputChannel,
    OutputField,
    Repeated,
    StreamedChannel,
    encode_strings,
    repeat_string,
)
from cwcli.signals.precision import round_to_binary_step
from cwcli.signals.row_order import Rows, iter_rows_by_id
from cwcli.signals.vehicle_state import EGO_ID, MAP_FRAME

MIN_DRAWING_PERIOD_NS = 190_000_000
"""Time between drawn paths of a vehicle; chosen just below 0.2 s, so that jitter of states at 5 or 10 Hz skips none."""
POINTS_PER_DRAWN_PATH = 11
"""Points of a drawn path; chosen by eye."""
EMPTY_ARRAY_OF_TIMES_NS = np.zeros(0, np.int64)
"""An empty array of times, for concatenation."""
DRAWN_PATH_LIFETIME_NS = 500_000_000
"""Time for which a viewer shows a path that is not replaced, ns; chosen by hand."""
DRAWN_PATH_WIDTH_M = 0.3
"""Width of a drawn path, m; chosen by eye."""
EGO_PATH_RGBA = (0.15, 0.5, 1.0, 0.9)
"""Colour of the ego's paths: red, green, blue, alpha, 0 to 1 each; chosen by eye."""
OTHER_VEHICLE_PATH_RGBA = (1.0, 0.55, 0.0, 0.9)
"""Colour of the paths of other vehicles: red, green, blue, alpha, 0 to 1 each; chosen by eye."""


def make_path_scene_channel(predicted: Sequence[AnyPaths]) -> OutputChannel:
    """Make the scene of one line a path; its entity has the vehicle's id, so that the next path replaces it.

    Args:
        predicted: Paths in the map frame, each in the order of their log times.
    """
    drawn = [_first_path_rows_of_each_vehicle_and_period(each) for each in predicted]
    log_time_ns = np.concatenate(
        [EMPTY_ARRAY_OF_TIMES_NS, *(each.log_time_ns[rows] for each, rows in zip(predicted, drawn, strict=True))]
    )
    order = np.argsort(log_time_ns, kind="stable")
    which = np.repeat(np.arange(len(drawn)), [len(rows) for rows in drawn])[order]
    row = np.concatenate([np.zeros(0, np.intp), *drawn])[order]

    def rows(start: int, stop: int) -> Mapping[str, OutputField]:
        n = stop - start
        stamp_ns, points, names = (
            np.zeros(n, np.int64),
            np.zeros((n, POINTS_PER_DRAWN_PATH, 2)),
            np.empty(n, np.object_),
        )
        for k, each in enumerate(predicted):
            rows_of_path = np.flatnonzero(which[start:stop] == k)
            own = row[start:stop][rows_of_path]
            stamp_ns[rows_of_path], points[rows_of_path] = each.stamp_ns[own], _evenly_spaced_path_points_m(each, own)
            names[rows_of_path] = [each.ids.values[code] for code in each.ids.codes[own]]
        return _scene_entity_fields_of_lines(stamp_ns, names.tolist(), points)

    return StreamedChannel(PATH_SCENE.topic, PATH_SCENE.schema, log_time_ns[order], make_rows=rows)


def _first_path_rows_of_each_vehicle_and_period(predicted: AnyPaths) -> Rows:
    """Rows of the first path of each vehicle in each drawing period, increasing."""
    first_rows = [_first_row_of_each_period(rows, predicted.log_time_ns) for _, rows in iter_rows_by_id(predicted.ids)]
    return np.sort(np.concatenate([np.zeros(0, np.intp), *first_rows]))


def _evenly_spaced_path_points_m(predicted: AnyPaths, rows: Rows) -> FloatArray:
    """Evenly spaced points along n paths, shape (n, N_POINTS, 2), m."""
    at = np.linspace(0, len(predicted.time_s) - 1, POINTS_PER_DRAWN_PATH).round().astype(np.intp)
    points, place = np.unique(at, return_inverse=True)
    return round_to_binary_step(predicted.positions_m_of_points(rows, points)[:, place], LENGTH_FRACTION_BITS)


def _first_row_of_each_period(rows: Rows, log_time_ns: Int64Array) -> Rows:
    """Select the first row in each period, counted from the first row's log time."""
    if not len(rows):
        return rows
    slot = (log_time_ns[rows] - log_time_ns[rows[0]]) // MIN_DRAWING_PERIOD_NS
    return rows[np.concatenate(([True], np.diff(slot) > 0))]


def _scene_entity_fields_of_lines(
    stamp_ns: Int64Array, names: list[str], points: FloatArray
) -> Mapping[str, OutputField]:
    n = len(stamp_ns)
    one_each = np.arange(n + 1, dtype=np.int64)
    is_ego = np.array([name == EGO_ID for name in names], np.bool_)
    color = np.where(is_ego[:, None], EGO_PATH_RGBA, OTHER_VEHICLE_PATH_RGBA)
    flat = points.reshape(-1, 2)
    line: dict[str, OutputField] = {
        "pose.orientation.w": np.ones(n),
        "thickness": np.full(n, DRAWN_PATH_WIDTH_M),
        "points": Repeated(
            one_each * POINTS_PER_DRAWN_PATH, {"x": flat[:, 0], "y": flat[:, 1], "z": np.zeros(len(flat), np.float64)}
        ),
        **{f"color.{part}": color[:, k] for k, part in enumerate("rgba")},
    }
    entity: dict[str, OutputField] = {
        "timestamp": stamp_ns,
        "frame_id": repeat_string(MAP_FRAME, n),
        "id": encode_strings(names),
        "lifetime": np.full(n, DRAWN_PATH_LIFETIME_NS, np.int64),
        "lines": Repeated(one_each, line),
    }
    return {"entities": Repeated(one_each, entity)}
