"""One pass over the scans gives every detection a track id.

Per scan: predict, gate, assign (confirmed tracks first, then tentative ones), update, weigh the existence of every
track, end those that are unlikely by now, start new ones from what is left. A track's probability of existence
follows the Bernoulli filter (Ristic et al., IEEE TSP 61(13), 2013) with the assignment as the only hypothesis: a hit
multiplies its odds by P_D likelihood / clutter density, a miss in view by 1 - P_D.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.kernels import track as kernel
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.tracking.assignment import rows_and_columns_assigned_in_groups
from cwcli.tracking.config import TrackerConfig
from cwcli.tracking.detections import SensorModel
from cwcli.tracking.prepare import PreparedDetections

Mask = npt.NDArray[np.bool_]
_MAX_EXISTENCE_LOG_ODDS = 30.0
"""Largest log odds of a track's existence, so that a lost track can still end. Chosen by hand."""


@dataclass(frozen=True)
class Association:
    """Which track each detection belongs to, and the life of the tracks.

    Attributes:
        row_track: Shape (n rows,): id of the track that took the row, 0 = none.
        track_id: Shape (k,): ids of the confirmed tracks, from 1, in the order of confirmation.
        confirmed_ns, ended_ns: Shape (k,): confirmation, and the last time it was alive.
        clutter_density: Source -> the density that was used.
        n_refused: Births refused because `max_tracks` was reached.
    """

    row_track: Int64Array
    track_id: Int64Array
    confirmed_ns: Int64Array
    ended_ns: Int64Array
    clutter_density: dict[str, float]
    n_refused: int


class _LivingTracks:
    """Fixed-size store of the living tracks; the first `n` rows are in use."""

    def __init__(self, capacity: int, d: int) -> None:
        self.n = 0
        self.x = np.zeros((capacity, d))
        self.p = np.zeros((capacity, d, d))
        self.log_odds = np.zeros(capacity)
        self.key = np.zeros(capacity, np.int64)
        self.is_confirmed = np.zeros(capacity, bool)
        self.misses = np.zeros(capacity, np.int64)
        self.last_hit_ns = np.zeros(capacity, np.int64)

    def keep_tracks(self, mask: Mask) -> None:
        """Drop all tracks but those in the mask `mask`."""
        at = np.flatnonzero(mask)
        for column in (self.x, self.p, self.log_odds, self.key, self.is_confirmed, self.misses, self.last_hit_ns):
            column[: len(at)] = column[at]
        self.n = len(at)


def _log_odds_of_probability(probability: float) -> float:
    return float(np.log(probability / (1.0 - probability)))


def in_view_mask(states: FloatArray, sensor_x_y_yaw: FloatArray, model: SensorModel) -> Mask:
    """Whether the sensor at `sensor_x_y_yaw` (x, y, yaw) can see the position of each state."""
    dx, dy = states[:, 0] - sensor_x_y_yaw[0], states[:, 1] - sensor_x_y_yaw[1]
    is_in_view: Mask = dx * dx + dy * dy <= model.max_range_m**2
    if model.field_of_view_rad < 2.0 * np.pi:
        axes = 0.0 if model.axes == "body" else np.pi / 2
        off = np.arctan2(dy, dx) - sensor_x_y_yaw[2] - axes
        off -= 2.0 * np.pi * np.floor((off + np.pi) / (2.0 * np.pi))
        is_in_view &= np.abs(off) <= 0.5 * model.field_of_view_rad
    return is_in_view


class ScanLoop:
    """The state of the pass over the scans; `run` makes the pass."""

    def __init__(self, prepared: PreparedDetections, config: TrackerConfig, density: FloatArray) -> None:
        self.prepared, self.config, self.density = prepared, config, density
        self.filter, self.rows = config.single.build_kernel_filter(), prepared.rows.to_kernel_rows()
        self.living = _LivingTracks(config.max_tracks, len(config.single.motion_model.states))
        self.row_key = np.zeros(len(prepared.rows), np.int64)
        self.n_begun = 0
        self.confirmed: dict[int, int] = {}
        self.ended: dict[int, int] = {}
        self.n_refused = 0
        self.now = 0

    def associate_all_scans(self) -> Association:
        """Associate the detections of all scans in the order of time."""
        scans = self.prepared.scans
        for k in range(len(scans)):
            stamp, first, last = int(scans.stamp_ns[k]), int(scans.first[k]), int(scans.first[k + 1])
            self._end_coasting_tracks(stamp)
            self._predict_tracks(stamp)
            assigned_rows = self._update_tracks_and_get_assigned_rows(
                stamp, first, last, int(scans.source[k]), scans.pose[k]
            )
            self._confirm_and_end_tracks(stamp)
            self._begin_tracks(stamp, np.setdiff1d(np.arange(first, last), assigned_rows))
        return self._build_association()

    def _end_coasting_tracks(self, stamp: int) -> None:
        """End the tracks without a detection for too long, before detections are assigned."""
        living = self.living
        waited_s = stamp * 1e-9 - living.last_hit_ns[: living.n] * 1e-9  # floats: absurd stamps can't overflow
        if (waited_s > self.config.max_coast_s).any():
            living.keep_tracks(waited_s <= self.config.max_coast_s)

    def _predict_tracks(self, stamp: int) -> None:
        """Predict states and existence of all tracks to a stamp."""
        living, dt = self.living, (stamp - self.now) * 1e-9
        self.now = stamp
        if not living.n:
            return
        kernel.predict_many(self.filter, living.x[: living.n], living.p[: living.n], dt)
        odds = living.log_odds[: living.n]  # odds of r exp(-dt / life)
        odds[:] = -np.log(np.expm1(np.logaddexp(0.0, -odds) + dt / self.config.mean_life_s))

    def _update_tracks_and_get_assigned_rows(
        self, stamp: int, first: int, last: int, source: int, sensor_x_y_yaw: FloatArray
    ) -> Int64Array:
        """Assign the rows from `first` to before `last`, and update the tracks; returns the assigned rows."""
        living, model = self.living, self.prepared.models[source]
        n = living.n
        x, p, odds = living.x[:n], living.p[:n], living.log_odds[:n]
        is_in_view = in_view_mask(x, sensor_x_y_yaw, model)
        chance = model.detection_probability
        miss = np.where(is_in_view, np.log1p(-chance * self.config.single.gate_probability), 0.0)
        gain = kernel.score_many(self.filter, x, p, self.rows, first, last)
        gain += np.log(chance / self.density[source])
        track, row = self._pairs_of_assigned_tracks_and_rows(gain - miss[:, None])
        kernel.update_many(self.filter, x, p, track, self.rows, first + row)
        missed = np.ones(n, bool)
        missed[track] = False
        odds[missed] += miss[missed]
        odds[track] += gain[track, row]
        np.minimum(odds, _MAX_EXISTENCE_LOG_ODDS, out=odds)
        living.misses[:n][missed & is_in_view] += 1
        living.misses[track] = 0
        living.last_hit_ns[track] = stamp
        self.row_key[first + row] = living.key[track]
        return first + row

    def _pairs_of_assigned_tracks_and_rows(self, worth: FloatArray) -> tuple[Int64Array, Int64Array]:
        """Assign rows by their gains (tracks, rows): to confirmed tracks first, the rest to tentative ones."""
        confirmed = self.living.is_confirmed[: len(worth)]
        old, new = np.flatnonzero(confirmed), np.flatnonzero(~confirmed)
        a, row = rows_and_columns_assigned_in_groups(worth[old])
        free = np.setdiff1d(np.arange(worth.shape[1]), row)
        b, rest = rows_and_columns_assigned_in_groups(worth[np.ix_(new, free)])
        return np.concatenate([old[a], new[b]]), np.concatenate([row, free[rest]])

    def _confirm_and_end_tracks(self, stamp: int) -> None:
        """Confirm the tracks that are likely to exist, and end those that are not."""
        living, config, n = self.living, self.config, self.living.n
        odds, confirmed = living.log_odds[:n], living.is_confirmed[:n]
        for i in np.flatnonzero((odds > _log_odds_of_probability(config.confirm_probability)) & ~confirmed):
            confirmed[i] = True
            self.confirmed[int(living.key[i])] = stamp
        forlorn = living.misses[:n] >= config.tentative_misses
        dead = np.where(confirmed, odds < _log_odds_of_probability(config.delete_probability), forlorn)
        for key in living.key[:n][~dead & confirmed].tolist():
            self.ended[key] = stamp
        if dead.any():
            living.keep_tracks(~dead)

    def _begin_tracks(self, stamp: int, free: Int64Array) -> None:
        """Begin a tentative track at each of the rows `free`, up to the largest number of tracks."""
        living = self.living
        room = self.config.max_tracks - living.n
        self.n_refused += max(0, len(free) - room)
        free = free[:room]
        if not len(free):
            return
        new = slice(living.n, living.n + len(free))
        kernel.start_many(self.filter, living.x[new], living.p[new], self.rows, free)
        living.key[new] = self.n_begun + 1 + np.arange(len(free))
        living.log_odds[new] = np.log(self.config.new_target_ratio)
        living.is_confirmed[new] = False
        living.misses[new] = 0
        living.last_hit_ns[new] = stamp
        self.row_key[free] = living.key[new]
        self.n_begun += len(free)
        living.n += len(free)

    def _build_association(self) -> Association:
        """Build the result, with ids in the order of confirmation."""
        keys = sorted(self.confirmed, key=lambda key: (self.confirmed[key], key))
        lookup = np.zeros(self.n_begun + 1, np.int64)
        lookup[keys] = np.arange(1, len(keys) + 1)
        return Association(
            row_track=lookup[self.row_key],
            track_id=np.arange(1, len(keys) + 1),
            confirmed_ns=np.array([self.confirmed[key] for key in keys], np.int64),
            ended_ns=np.array([self.ended.get(key, self.confirmed[key]) for key in keys], np.int64),
            clutter_density=dict(zip(self.prepared.rows.sources, self.density.tolist(), strict=True)),
            n_refused=self.n_refused,
        )
