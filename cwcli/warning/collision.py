"""The probability that the outlines of a pair touch: on the predicted paths, and if the host brakes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.measures.collision_probability import UncertainPaths, collision_probability, is_touch_improbable
from cwcli.measures.outlines import LengthAndWidthM
from cwcli.signals.columns import FloatArray, sort_distinct_values
from cwcli.warning.remote_alignment import PlacesOnPaths
from cwcli.warning.types import PathArrays

Rows = npt.NDArray[np.intp]

MAX_STEP_OF_THINNED_PATHS_S = 0.1
"""Largest step between compared points, s. Chosen: no car turns by a tenth of a radian in it."""
N_BRAKING_STEPS = 60
"""Number of steps from the begin of the braking to standstill. Chosen by hand."""


@dataclass(frozen=True)
class PathPairs:
    """m pairs of predicted paths.

    Attributes:
        host, other: Paths of the host and of the other.
        host_row, other_row, age_s: Shape (m,): rows of both, and the age at which the other's path begins to count.
        host_size, other_size: Length and width of the outlines.
    """

    host: PathArrays
    other: PathArrays
    host_row: Rows
    other_row: Rows
    age_s: FloatArray
    host_size: LengthAndWidthM
    other_size: LengthAndWidthM

    def select_rows(self, rows: Rows) -> PathPairs:
        """Some of the pairs."""
        at = (self.host_row[rows], self.other_row[rows], self.age_s[rows])
        return PathPairs(self.host, self.other, *at, self.host_size, self.other_size)

    def contact_probability_by_times(
        self, min_distance_m: FloatArray, time_s: FloatArray, ends_s: tuple[float, ...]
    ) -> FloatArray:
        """Compute the probability of contact by each of the times, (m, e).

        Args:
            min_distance_m: Shape (m,): the least distance of the centres, NaN where a path is not finite.
            time_s: Shape (q,): the paths' times, from 0 to the last of the ends, and with all of them.
        """
        out = np.zeros((len(self.host_row), len(ends_s)))
        out[np.isnan(min_distance_m)] = np.nan
        variance_m2 = largest_position_variance_m2(self.host, self.host_row) + largest_position_variance_m2(
            self.other, self.other_row
        )
        with np.errstate(invalid="ignore"):
            far = is_touch_improbable(min_distance_m, variance_m2, self.host_size, self.other_size)
        near = np.flatnonzero(~far & ~np.isnan(min_distance_m))
        if not len(near):
            return out
        every = max(1, int(MAX_STEP_OF_THINNED_PATHS_S / float(time_s[1]) + 1e-6))
        ends = np.searchsorted(time_s, np.array(ends_s) - 1e-9)
        checked_times = sort_distinct_values(np.concatenate([np.arange(0, len(time_s), every), ends]))
        at_s = time_s[checked_times]
        out[near] = self.select_rows(near)._contact_probability(at_s, at_s, ends=np.searchsorted(checked_times, ends))
        return out

    def contact_probability_if_braking(self, deceleration_mps2: float, horizon_s: float) -> FloatArray:
        """Compute the probability of contact by standstill or the horizon if the host brakes on its path, (m,).

        A host that is predicted to brake harder does that. After the end of its path the other goes straight on; while
        the host stands the covariances do not grow.
        """
        speed = np.abs(self.host.speed_mps[self.host_row, 0, None])
        stop_s = speed / deceleration_mps2
        time_s = np.maximum(stop_s, horizon_s) * np.linspace(0.0, 1.0, N_BRAKING_STEPS + 1)
        braking_s = np.minimum(time_s, stop_s)
        way_m = speed * braking_s - 0.5 * deceleration_mps2 * braking_s**2
        at_s = np.minimum(self._times_of_driven_distance_s(way_m), time_s)
        return self._contact_probability(at_s, time_s, (np.minimum(at_s, braking_s), braking_s))[:, 0]

    def _times_of_driven_distance_s(self, way_m: FloatArray) -> FloatArray:
        """The times at which the host's path has covered the distances `way_m`, s, (m, q)."""
        time_s, rows = self.host.time_s, self.host_row
        gone = np.hypot(np.diff(self.host.x_m[rows], axis=1), np.diff(self.host.y_m[rows], axis=1))
        gone_m = np.concatenate([np.zeros((len(rows), 1)), np.cumsum(gone, axis=1)], axis=1)
        at = np.stack([np.interp(way, own, time_s) for way, own in zip(way_m, gone_m, strict=True)])
        last_mps = np.abs(self.host.speed_mps[rows, -1:])
        with np.errstate(divide="ignore", invalid="ignore"):
            beyond = np.where(way_m > gone_m[:, -1:], (way_m - gone_m[:, -1:]) / last_mps, 0.0)
        return np.asarray(at + beyond)

    def _contact_probability(
        self,
        host_time_s: FloatArray,
        other_time_s: FloatArray,
        covariance_times_s: tuple[FloatArray, FloatArray] | None = None,
        ends: Rows | None = None,
    ) -> FloatArray:
        """The probability of contact, (m, e); paths and covariances may have times of their own, (q,) or (m, q)."""
        none = np.zeros(len(self.host_row))
        own = PlacesOnPaths.locate(self.host, self.host_row, none, host_time_s)
        theirs = PlacesOnPaths.locate(self.other, self.other_row, self.age_s, other_time_s)
        own_spread, their_spread = own, theirs
        if covariance_times_s is not None:
            own_spread = PlacesOnPaths.locate(self.host, self.host_row, none, covariance_times_s[0])
            their_spread = PlacesOnPaths.locate(self.other, self.other_row, self.age_s, covariance_times_s[1])
        own_heading, their_heading = (
            own.interpolate_values(self.host.heading_rad),
            theirs.interpolate_values(self.other.heading_rad),
        )
        own_x, own_y = own.interpolate_positions(self.host, own_heading)
        their_x, their_y = theirs.interpolate_positions(self.other, their_heading)
        return collision_probability(
            their_x - own_x,
            their_y - own_y,
            UncertainPaths(own_heading, own_spread.interpolate_covariances(self.host), self.host_size),
            UncertainPaths(their_heading, their_spread.interpolate_covariances(self.other), self.other_size),
            ends=ends,
        )


def largest_position_variance_m2(paths: PathArrays, rows: Rows) -> FloatArray:
    """Variance along the direction in which it is largest, (m,), at the path's begin or end, whichever is larger."""
    begin, end = (_largest_variance_m2(paths.position_covariance_m2[:, point]) for point in (0, -1))
    return np.asarray(np.maximum(begin, end)[rows])


def _largest_variance_m2(covariance_m2: FloatArray) -> FloatArray:
    """Variance along the direction in which it is largest, (n,), of covariances (n, 3)."""
    xx, xy, yy = covariance_m2[:, 0], covariance_m2[:, 1], covariance_m2[:, 2]
    return np.asarray(0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy))
