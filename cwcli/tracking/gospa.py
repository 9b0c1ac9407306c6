"""Scores of a set of tracks: GOSPA with its parts, id switches, errors of each target.

GOSPA: Rahmathullah, Garcia-Fernandez, Svensson, FUSION 2017, eq. 1 with alpha = 2, for which it splits into
localisation, missed and false targets (prop. 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array, sort_distinct_values
from cwcli.tracking.assignment import rows_and_columns_of_best_pairs


def best_pairs_and_their_distances(
    truth_xy: FloatArray, track_xy: FloatArray, *, cutoff_m: float, p: float = 2.0
) -> tuple[Int64Array, Int64Array, FloatArray]:
    """Pair true positions (m, 2) and tracks (n, 2) best: the rows of the pairs, and their distances."""
    if not len(truth_xy) or not len(track_xy):
        none = np.zeros(0, np.int64)
        return none, none, np.zeros(0)
    distance = np.linalg.norm(truth_xy[:, None, :] - track_xy[None, :, :], axis=2)
    i, j = rows_and_columns_of_best_pairs(cutoff_m**p - distance**p)
    return i, j, distance[i, j]


@dataclass(frozen=True)
class TargetErrors:
    """Errors of one true target over the drive.

    Attributes:
        id: Id of the target.
        n, n_tracked: Number of moments at which it exists, and at which a track is paired with it.
        id_switches: How often the id of its track changed.
        position_rmse_m, velocity_rmse_mps: Root mean squares over the tracked moments, NaN when there is none.
        rmse: Root mean squares by component: x, y in m, vx, vy in m/s.
    """

    id: int
    n: int
    n_tracked: int
    id_switches: int
    position_rmse_m: float
    velocity_rmse_mps: float
    rmse: tuple[float, ...] = (np.nan,) * 4


@dataclass(frozen=True)
class TrackingScores:
    """Scores of a drive.

    Attributes:
        stamp_ns: Shape (k,): the moments.
        distance, localisation, missed, false: Shape (k,): GOSPA and its parts, see `GospaParts`.
        n_missed, n_false: Shape (k,).
        targets: One entry per true target.
        id_switches: Number of id switches of all targets.
    """

    stamp_ns: Int64Array
    distance: FloatArray
    localisation: FloatArray
    missed: FloatArray
    false: FloatArray
    n_missed: Int64Array
    n_false: Int64Array
    targets: tuple[TargetErrors, ...]
    id_switches: int


class TrackLike(Protocol):
    """A track as `TargetMoments.of` reads it."""

    @property
    def id(self) -> int: ...
    @property
    def stamp_ns(self) -> Int64Array: ...
    @property
    def state(self) -> FloatArray: ...


@dataclass(frozen=True)
class TargetMoments:
    """Targets or tracks as rows: `id` at `stamp_ns` is at `state` (n, 4): x, y, vx, vy."""

    stamp_ns: Int64Array
    id: Int64Array
    state: FloatArray

    @classmethod
    def from_tracks(cls, tracks: Sequence[TrackLike]) -> TargetMoments:
        """Collect the rows of tracks; of several rows of a track at one stamp, the last."""
        stamps, ids, states = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros((0, 4))]
        for track in tracks:
            last = np.append(np.diff(track.stamp_ns) != 0, True)
            stamps.append(track.stamp_ns[last])
            ids.append(np.full(int(last.sum()), track.id))
            states.append(track.state[last, :4])
        return cls(np.concatenate(stamps), np.concatenate(ids), np.concatenate(states))

    def interpolate_at(self, stamp_ns: Int64Array, *, max_gap_s: float = 0.5) -> TargetMoments:
        """Interpolate each id at the stamps within its life, linearly between its rows, not across longer gaps."""
        stamps, ids, states = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros((0, 4))]
        distinct_stamp_ns = sort_distinct_values(stamp_ns)
        for k in sort_distinct_values(self.id).tolist():
            mine = np.flatnonzero(self.id == k)
            mine = mine[np.argsort(self.stamp_ns[mine], kind="stable")]
            known = self.stamp_ns[mine]
            inner_stamp_ns = distinct_stamp_ns[(distinct_stamp_ns >= known[0]) & (distinct_stamp_ns <= known[-1])]
            right = np.searchsorted(known, inner_stamp_ns)
            left = np.where(known[right] == inner_stamp_ns, right, right - 1)
            near = (known[right] - known[left]) * 1e-9 <= max_gap_s
            inner_stamp_ns, left, right = inner_stamp_ns[near], left[near], right[near]
            span = np.maximum(known[right] - known[left], 1)
            part = ((inner_stamp_ns - known[left]) / span)[:, None]
            stamps.append(inner_stamp_ns)
            ids.append(np.full(len(inner_stamp_ns), k))
            states.append((1.0 - part) * self.state[mine[left]] + part * self.state[mine[right]])
        return TargetMoments(np.concatenate(stamps), np.concatenate(ids), np.concatenate(states))


def score_tracks(
    truth: TargetMoments, tracks: TargetMoments, *, cutoff_m: float = 5.0, p: float = 2.0
) -> TrackingScores:
    """Score tracks against the truth at every moment of the truth. Track rows at other moments are left out.

    A switch is counted as in CLEAR MOT (Bernardin, Stiefelhagen 2008): the target is paired with another id than when
    it was last paired.
    """
    moments = sort_distinct_values(truth.stamp_ns)
    parts = np.zeros((len(moments), 4))
    numbers = np.zeros((len(moments), 2), np.int64)
    track_of_target: dict[int, int] = {}
    switches: dict[int, int] = {}
    errors: dict[int, list[FloatArray]] = {int(k): [] for k in sort_distinct_values(truth.id)}
    truth_rows, track_rows = _rows_at_moments(truth.stamp_ns, moments), _rows_at_moments(tracks.stamp_ns, moments)
    for k in range(len(moments)):
        a, b = truth_rows[k], track_rows[k]
        i, j, distance = best_pairs_and_their_distances(truth.state[a, :2], tracks.state[b, :2], cutoff_m=cutoff_m, p=p)
        penalty = 0.5 * cutoff_m**p
        numbers[k] = len(a) - len(i), len(b) - len(j)
        parts[k, 1:] = (distance**p).sum(), numbers[k, 0] * penalty, numbers[k, 1] * penalty
        parts[k, 0] = parts[k, 1:].sum() ** (1.0 / p)
        for u, v in zip(a[i].tolist(), b[j].tolist(), strict=True):
            target, track = int(truth.id[u]), int(tracks.id[v])
            errors[target].append(tracks.state[v, :4] - truth.state[u, :4])
            switches[target] = switches.get(target, 0) + (track_of_target.get(target, track) != track)
            track_of_target[target] = track
    targets = tuple(_errors_of_target(truth, k, rows, switches.get(k, 0)) for k, rows in errors.items())
    return TrackingScores(
        moments, parts[:, 0], parts[:, 1], parts[:, 2], parts[:, 3], numbers[:, 0], numbers[:, 1], targets,
        sum(switches.values()),
    )  # fmt: skip


def _errors_of_target(
    truth: TargetMoments, target: int, x_y_vx_vy_errors: list[FloatArray], switches: int
) -> TargetErrors:
    """Errors of one target from its rows of differences (4,): x, y, vx, vy."""
    square = np.mean(np.square(x_y_vx_vy_errors), axis=0) if x_y_vx_vy_errors else np.full(4, np.nan)
    n = int((truth.id == target).sum())
    position, velocity = float(np.sqrt(square[:2].sum())), float(np.sqrt(square[2:].sum()))
    return TargetErrors(target, n, len(x_y_vx_vy_errors), switches, position, velocity, tuple(np.sqrt(square).tolist()))


def _rows_at_moments(stamp_ns: Int64Array, moments: Int64Array) -> list[Int64Array]:
    """Row indices of the stamps at each moment."""
    order = np.argsort(stamp_ns, kind="stable")
    ordered = stamp_ns[order]
    first = np.searchsorted(ordered, moments, side="left")
    last = np.searchsorted(ordered, moments, side="right")
    return [order[i:j] for i, j in zip(first.tolist(), last.tolist(), strict=True)]
