"""Pair each host state with the newest remote state, and interpolate the remote vehicle's path to that moment.

A V2X state is old when it is used, because of the link and the message period. Its predicted path is therefore read at
`age + tau`: the motion model brings the state forward. Paths of remote vehicles should reach `horizon + max age`; after
their end they go on straight at their last speed, and that is counted.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import NS_PER_S
from cwcli.warning.types import PathArrays, RemoteStateUse, VehicleTrack


@dataclass(frozen=True)
class StatePairing:
    """The usable evaluations of one pair.

    Attributes:
        host_row, other_row: Shape (m,): rows of the two tracks.
        age_s: Shape (m,): host stamp minus remote stamp, >= 0.
        n_without_message: Host stamps before the first message with a remote state.
        n_stale: Host stamps at which the newest remote state was too old.
    """

    host_row: npt.NDArray[np.intp]
    other_row: npt.NDArray[np.intp]
    age_s: FloatArray
    n_without_message: int
    n_stale: int


def pair_with_newest_state(
    host: VehicleTrack, other: VehicleTrack, use: RemoteStateUse, max_age_s: float
) -> StatePairing:
    """Pair every host stamp with the newest remote state that may be used.

    With "received" neither its log time nor its stamp is after the host's; with "stamp" its stamp is not.
    """
    n, m = len(host.stamp_ns), len(other.stamp_ns)
    usable_from = np.searchsorted(host.stamp_ns, other.stamp_ns, side="left")
    if use == "received":
        known = np.maximum.accumulate(host.log_time_ns) if n else host.log_time_ns
        usable_from = np.maximum(usable_from, np.searchsorted(known, other.log_time_ns, side="left"))
    newest = np.full(n + 1, -1, dtype=np.intp)
    np.maximum.at(newest, np.minimum(usable_from, n), np.arange(m, dtype=np.intp))
    newest = np.maximum.accumulate(newest[:n])
    has_state = newest >= 0
    age_ns = np.zeros(n, dtype=np.int64)
    age_ns[has_state] = host.stamp_ns[has_state] - other.stamp_ns[newest[has_state]]
    fresh = has_state & (age_ns <= round(max_age_s * NS_PER_S))
    rows = np.flatnonzero(fresh)
    return StatePairing(
        host_row=rows,
        other_row=newest[rows],
        age_s=age_ns[rows] / NS_PER_S,
        n_without_message=int(n - has_state.sum()),
        n_stale=int(has_state.sum() - fresh.sum()),
    )


@dataclass(frozen=True)
class PathPoints:
    """Points of m paths at q times, (m, q); `beyond` (m,) is true where a time is after the path's end."""

    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    is_beyond_end: npt.NDArray[np.bool_]

    def select_rows_and_times(self, rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]) -> PathPoints:
        """The points of some rows at some of the times."""
        flat = rows[:, None] * self.x_m.shape[1] + columns
        x, y, heading, speed = (values.take(flat) for values in (self.x_m, self.y_m, self.heading_rad, self.speed_mps))
        return PathPoints(x, y, heading, speed, self.is_beyond_end[rows])


def interpolate_paths(
    paths: PathArrays, rows: npt.NDArray[np.intp], offset_s: FloatArray, time_s: FloatArray
) -> PathPoints:
    """Interpolate the paths `rows` (m,) linearly at the times `offset_s[i] + time_s[j]`.

    `time_s` may be (q,) or (m, q). After its end a path goes straight on at its last speed and heading.
    """
    places = PlacesOnPaths.locate(paths, rows, offset_s, time_s)
    heading, speed = places.interpolate_values(paths.heading_rad), places.interpolate_values(paths.speed_mps)
    x, y = places.interpolate_positions(paths, heading, speed)
    return PathPoints(x, y, heading, speed, places.is_beyond_end)


@dataclass(frozen=True)
class PlacesOnPaths:
    """Where m paths are read at q times: between which of their points, (m, q) each.

    Attributes:
        flat: Index of the point before, in the flattened arrays of the paths.
        share: Share of the way to the next point.
        past_s: Time since the path's end.
        is_beyond_end: Shape (m,): a time is after the path's end.
    """

    flat: npt.NDArray[np.intp]
    share: FloatArray
    past_s: FloatArray
    is_beyond_end: npt.NDArray[np.bool_]

    @staticmethod
    def locate(
        paths: PathArrays, rows: npt.NDArray[np.intp], offset_s: FloatArray, time_s: FloatArray
    ) -> PlacesOnPaths:
        """Find the places on the paths `rows` (m,) at the times `offset_s[i] + time_s[j]`."""
        step_s = float(paths.time_s[1] - paths.time_s[0])
        last = len(paths.time_s) - 1
        place = (offset_s[:, None] + time_s) / step_s
        past_s = np.maximum(place - last, 0.0) * step_s
        past_s[past_s < 1e-9] = 0.0
        before = np.clip(np.floor(place + 1e-9).astype(np.intp), 0, last - 1)
        share = np.minimum(place - before, 1.0)
        return PlacesOnPaths(rows[:, None] * (last + 1) + before, share, past_s, np.asarray(past_s.any(axis=1)))

    def interpolate_values(self, values: FloatArray) -> FloatArray:
        """Read an array (n, k) of the paths there, (m, q)."""
        first = values.take(self.flat)
        step = values.take(self.flat + 1)
        step -= first
        step *= self.share
        first += step
        return first

    def interpolate_positions(
        self, paths: PathArrays, heading_rad: FloatArray, speed_mps: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Read the positions east and north, m, (m, q); after its end a path goes straight on."""
        x, y = self.interpolate_values(paths.x_m), self.interpolate_values(paths.y_m)
        if self.is_beyond_end.any():
            speed_mps = self.interpolate_values(paths.speed_mps) if speed_mps is None else speed_mps
            x += self.past_s * speed_mps * np.cos(heading_rad)
            y += self.past_s * speed_mps * np.sin(heading_rad)
        return x, y

    def interpolate_covariances(self, paths: PathArrays) -> FloatArray:
        """Read the position covariances, (m, q, 3); after its end a path keeps its last one."""
        covariance = paths.position_covariance_m2.reshape(-1, 3)
        first = covariance.take(self.flat, axis=0)
        step = covariance.take(self.flat + 1, axis=0)
        step -= first
        step *= self.share[:, :, None]
        first += step
        return first
