"""Predicted paths as lines that viewers draw: `foxglove.SceneUpdate` beside `cwcli.v1.PredictedPath`.

A picture, not a record: about ten paths a second of each vehicle, each with every tenth of its length. Who computes
with paths takes `/cwcli/ego/path` and `/cwcli/remote/path`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.channels.predicted_path import PredictedPaths
from cwcli.channels.published import PATH_SCENE
from cwcli.signals.columns import (
    FloatArray,
    Int64Array,
    OutputChannel,
    OutputField,
    Repeated,
    constant_strings,
    strings_from,
)
from cwcli.signals.row_order import Rows, rows_by_id
from cwcli.signals.vehicle_state import EGO_ID, MAP_FRAME

MIN_PERIOD_NS = 95_000_000
"""A little less than 0.1 s, so that of states at 10 or 20 Hz none is missed by jitter."""
N_POINTS = 11
LIFETIME_NS = 500_000_000
THICKNESS_M = 0.3
EGO_COLOR = (0.15, 0.5, 1.0, 0.9)
OTHER_COLOR = (1.0, 0.55, 0.0, 0.9)


def write_path_scene(predicted: Sequence[PredictedPaths]) -> OutputChannel:
    """One line a path, with the vehicle's id as the entity's, so that a vehicle's next path replaces its last.

    Args:
        predicted: Paths in the map frame, each in the order of their log times.
    """
    drawn = [_drawn_rows(each) for each in predicted]
    chosen = list(zip(predicted, drawn, strict=True))
    log_time_ns = np.concatenate([np.zeros(0, np.int64), *(each.log_time_ns[rows] for each, rows in chosen)])
    stamp_ns = np.concatenate([np.zeros(0, np.int64), *(each.stamp_ns[rows] for each, rows in chosen)])
    names = [each.ids.values[code] for each, rows in chosen for code in each.ids.codes[rows]]
    points = np.concatenate([np.zeros((0, N_POINTS, 2)), *(_points(each, rows) for each, rows in chosen)])
    order = np.argsort(log_time_ns, kind="stable")
    return _scene(log_time_ns[order], stamp_ns[order], [names[row] for row in order], points[order])


def _drawn_rows(predicted: PredictedPaths) -> Rows:
    """The first path of each vehicle in each period."""
    kept = [_spaced(rows, predicted.log_time_ns) for _, rows in rows_by_id(predicted.ids)]
    return np.sort(np.concatenate([np.zeros(0, np.intp), *kept]))


def _points(predicted: PredictedPaths, rows: Rows) -> FloatArray:
    """Points along some paths, shape (n, N_POINTS, 2)."""
    x_m, y_m = predicted.paths.x_m, predicted.paths.y_m
    at = np.linspace(0, x_m.shape[1] - 1, N_POINTS).round().astype(np.intp)
    return np.stack([x_m[rows][:, at], y_m[rows][:, at]], axis=2)


def _spaced(rows: Rows, log_time_ns: Int64Array) -> Rows:
    """The first row in each period: times that are one apart in whole periods."""
    if not len(rows):
        return rows
    slot = (log_time_ns[rows] - log_time_ns[rows[0]]) // MIN_PERIOD_NS
    return rows[np.concatenate(([True], np.diff(slot) > 0))]


def _scene(log_time_ns: Int64Array, stamp_ns: Int64Array, names: list[str], points: FloatArray) -> OutputChannel:
    n = len(log_time_ns)
    one_each = np.arange(n + 1, dtype=np.int64)
    is_ego = np.array([name == EGO_ID for name in names], np.bool_)
    color = np.where(is_ego[:, None], EGO_COLOR, OTHER_COLOR)
    flat = points.reshape(-1, 2)
    line: dict[str, OutputField] = {
        "pose.orientation.w": np.ones(n),
        "thickness": np.full(n, THICKNESS_M),
        "points": Repeated(
            one_each * N_POINTS, {"x": flat[:, 0], "y": flat[:, 1], "z": np.zeros(len(flat), np.float64)}
        ),
        **{f"color.{part}": color[:, k] for k, part in enumerate("rgba")},
    }
    entity: dict[str, OutputField] = {
        "timestamp": stamp_ns,
        "frame_id": constant_strings(MAP_FRAME, n),
        "id": strings_from(names),
        "lifetime": np.full(n, LIFETIME_NS, np.int64),
        "lines": Repeated(one_each, line),
    }
    return OutputChannel(PATH_SCENE.topic, PATH_SCENE.schema, log_time_ns, {"entities": Repeated(one_each, entity)})
