"""Find the ego among the objects that other stations perceived, so that it is not warned of itself.

An object is the ego if its outline overlaps the ego's in more than half of its messages so far.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.estimation.result import Track
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.remotes import perceived_rows_mask, select_remote_rows
from cwcli.signals.row_order import iter_rows_by_id
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import HEADING, SPEED, X, Y

DEFAULT_CAR_LENGTH_M = 4.5
"""Length of a car of unknown size, m. Chosen as a common car's."""
DEFAULT_CAR_WIDTH_M = 1.8
"""Width of a car of unknown size, m. Chosen as a common car's."""
MAX_EGO_STATE_AGE_S = 1.0
"""Greatest age of the ego state that is compared with an object, s. Chosen by hand; not fitted."""


def drop_ego_seen_by_others_and_note(
    signal: RemoteSignal, ego: Track, size_m: Sequence[float | None], local_map: LocalMap | None
) -> tuple[RemoteSignal, tuple[str, ...]]:
    """Remove the perceived objects that are the ego; returns the signal and notes.

    The decision on a row uses no later row.

    Args:
        signal: Remote vehicles; only its perceived objects are examined.
        size_m: Length and width of the ego, None where unknown.
        local_map: Map of the track; without one no object can be placed.
    """
    perceived = perceived_rows_mask(signal)
    if local_map is None or not perceived.any() or not len(ego.stamp_ns):
        return signal, ()
    overlaps = _overlaps_ego_mask(signal, ego, size_m, local_map)
    is_ego = np.zeros(len(perceived), np.bool_)
    n_objects = 0
    for _, rows in iter_rows_by_id(signal.station):
        own = rows[perceived[rows]]
        so_far = np.cumsum(overlaps[own])
        is_ego[own] = 2 * so_far > np.arange(1, len(own) + 1)
        n_objects += bool(is_ego[own].any())
    if not n_objects:
        return signal, ()
    note = f"{n_objects} perceived objects are the ego itself: {int(is_ego.sum())} times, left out"
    return select_remote_rows(signal, np.flatnonzero(~is_ego)), (note,)


def _overlaps_ego_mask(
    signal: RemoteSignal, ego: Track, size_m: Sequence[float | None], local_map: LocalMap
) -> npt.NDArray[np.bool_]:
    """Return a mask (n,) of the objects that overlap the ego, whose newest state is extrapolated to their stamps."""
    x_m, y_m, _ = local_map.map_from_wgs84(signal.latitude_deg, signal.longitude_deg, signal.altitude_m)
    row = np.searchsorted(ego.stamp_ns, signal.stamp_ns, side="right") - 1
    state = ego.state[np.maximum(row, 0)]
    age_s = (signal.stamp_ns - ego.stamp_ns[np.maximum(row, 0)]) / NS_PER_S
    cos, sin = np.cos(state[:, HEADING]), np.sin(state[:, HEADING])
    dx = x_m - (state[:, X] + age_s * state[:, SPEED] * cos)
    dy = y_m - (state[:, Y] + age_s * state[:, SPEED] * sin)
    along, across = dx * cos + dy * sin, dy * cos - dx * sin
    length_m, width_m = (
        0.5 * ((own or usual) + np.where(np.isfinite(theirs), theirs, usual))
        for own, theirs, usual in zip(
            size_m, (signal.length_m, signal.width_m), (DEFAULT_CAR_LENGTH_M, DEFAULT_CAR_WIDTH_M), strict=True
        )
    )
    is_told = (row >= 0) & (age_s <= MAX_EGO_STATE_AGE_S)
    return np.asarray(is_told & (np.abs(along) < length_m) & (np.abs(across) < width_m))
