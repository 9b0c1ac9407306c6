"""Predicted paths as lines that viewers draw: `foxglove.SceneUpdate` beside `cwcli.v1.PredictedPath`.

A picture, not a record: about ten paths a second of each vehicle, each with every tenth of its length. Who computes
with paths takes `/cwcli/ego/path` and `/cwcli/remote/path`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.channels.published import PATH_SCENE
from cwcli.channels.states import vehicle_rows
from cwcli.channels.states_and_paths import EGO_ID, MAP_FRAME, constant_strings
from cwcli.signals.columns import FloatArray, Int64Array, OutputChannel, OutputField, Repeated, Strings

MIN_PERIOD_NS = 95_000_000
"""A little less than 0.1 s, so that of states at 10 or 20 Hz none is missed by jitter."""
N_POINTS = 11
LIFETIME_NS = 500_000_000
THICKNESS_M = 0.3
EGO_COLOR = (0.15, 0.5, 1.0, 0.9)
OTHER_COLOR = (1.0, 0.55, 0.0, 0.9)


def path_scene(paths: Sequence[OutputChannel]) -> OutputChannel:
    """One line a message, with the vehicle's id as the entity's, so that a vehicle's next path replaces its last.

    Args:
        paths: Channels of `cwcli.v1.PredictedPath` in the map frame, as `predicted_paths` makes them.
    """
    parts = [_thinned(channel) for channel in paths]
    log_time_ns = np.concatenate([np.zeros(0, np.int64), *(part[0] for part in parts)])
    stamp_ns = np.concatenate([np.zeros(0, np.int64), *(part[1] for part in parts)])
    names = [name for part in parts for name in part[2]]
    points = np.concatenate([np.zeros((0, N_POINTS, 2)), *(part[3] for part in parts)])
    order = np.argsort(log_time_ns, kind="stable")
    return _scene(log_time_ns[order], stamp_ns[order], [names[row] for row in order], points[order])


def _thinned(channel: OutputChannel) -> tuple[Int64Array, Int64Array, list[str], FloatArray]:
    """Log times, stamps, ids and points (n, N_POINTS, 2) of the paths that are drawn."""
    ids, x_m, y_m, stamp_ns = (channel.fields[name] for name in ("id", "x_m", "y_m", "stamp_ns"))
    assert isinstance(ids, Strings)
    assert isinstance(x_m, np.ndarray) and isinstance(y_m, np.ndarray) and isinstance(stamp_ns, np.ndarray)
    kept = [_spaced(rows, channel.log_time_ns) for _, rows in vehicle_rows(ids)]
    rows = np.sort(np.concatenate([np.zeros(0, np.intp), *kept]))
    at = np.linspace(0, x_m.shape[1] - 1, N_POINTS).round().astype(np.intp)
    points = np.stack([x_m[rows][:, at], y_m[rows][:, at]], axis=2).astype(np.float64)
    return channel.log_time_ns[rows], stamp_ns[rows].astype(np.int64), [ids.values[c] for c in ids.codes[rows]], points


def _spaced(rows: npt.NDArray[np.intp], log_time_ns: Int64Array) -> npt.NDArray[np.intp]:
    """The first row in each period: times that are one apart in whole periods."""
    if not len(rows):
        return rows
    slot = (log_time_ns[rows] - log_time_ns[rows[0]]) // MIN_PERIOD_NS
    return rows[np.concatenate(([True], np.diff(slot) > 0))]


def _scene(log_time_ns: Int64Array, stamp_ns: Int64Array, names: list[str], points: FloatArray) -> OutputChannel:
    n = len(log_time_ns)
    one_each = np.arange(n + 1, dtype=np.int64)
    distinct = {name: code for code, name in enumerate(dict.fromkeys(names))}
    ids = Strings(np.array([distinct[name] for name in names], np.int32), tuple(distinct))
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
        "id": ids,
        "lifetime": np.full(n, LIFETIME_NS, np.int64),
        "lines": Repeated(one_each, line),
    }
    return OutputChannel(
        PATH_SCENE.topic, "foxglove.SceneUpdate", log_time_ns, {"entities": Repeated(one_each, entity)}
    )
