"""The actual motion of two vehicles, from which the measures are computed."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import field
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass, replace
from cwcli.measures.outlines import LengthAndWidthM
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.packed_covariances import Covariances
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import N_STATES

SecondsAtStamps = FloatArray
"""A time in s at each stamp of the host, shape (n,)."""
MetresAtStamps = FloatArray
"""A distance in m at each stamp of the host, shape (n,)."""
Mps2AtStamps = FloatArray
"""An acceleration in m/s^2 at each stamp of the host, shape (n,)."""
RatiosAtStamps = FloatArray
"""A number without a unit at each stamp of the host, shape (n,)."""
PairNumber = FloatArray
"""One number for a whole pair, an array of shape ()."""
EastNorthSpeedHeadingRows = FloatArray
"""Place east and north (m), speed (m/s) and heading (rad), shape (n, 4)."""
AccelYawRateJerkRows = FloatArray
"""Acceleration (m/s^2), yaw rate (rad/s) and jerk (m/s^3), shape (n, 3)."""

CosinesAndSinesOfHeadings = tuple[FloatArray, FloatArray]
"""Cosine and sine of headings."""
MAX_CENTRE_DISTANCE_OF_COMPARED_OUTLINES_M = 200.0
"""Greatest distance of the centres, m, at which outlines are compared. Chosen by hand; not fitted."""


class PairQuantity(Protocol):
    """A quantity that can be computed for a pair, such as a `cwcli.measures.base.Measure`."""

    @property
    def compute(self) -> Callable[[Pair], FloatArray]: ...


@dataclass(frozen=True)
class ActualTrack:
    """The actual states of a vehicle.

    Attributes:
        stamp_ns: Shape (n,), strictly increasing.
        state: Shape (n, >= 4): x_m, y_m, speed_mps, heading_rad, and of `STATE_NAMES` as many more as are known.
        covariance: Shape (n, 8, 8), for the measures that need it; None: not known.
    """

    stamp_ns: Int64Array
    state: FloatArray
    covariance: Covariances | None = None


@dataclass(frozen=True)
class RelativeMotion:
    """The other relative to the host, map frame, each (m,): centre, velocity, both headings and their directions."""

    dx_m: FloatArray
    dy_m: FloatArray
    dvx_mps: FloatArray
    dvy_mps: FloatArray
    host_heading_rad: FloatArray
    other_heading_rad: FloatArray
    host_direction: CosinesAndSinesOfHeadings
    other_direction: CosinesAndSinesOfHeadings


@dataclass(frozen=True)
class Pair:
    """Two vehicles at the host's stamps. Quantities that several measures share are computed once.

    Attributes:
        host, other: Their tracks, each at its own stamps; `other_states` is the other's at the host's stamps.
        host_size, other_size: Length and width of the outlines, metres.
        max_gap_s: The other's track is not interpolated across longer gaps.
        known_other: The other's states (n, 4) and derivatives (n, 3) at the host's stamps where they are known already;
            None: they are interpolated from its track.
    """

    host: ActualTrack
    other: ActualTrack
    host_size: LengthAndWidthM
    other_size: LengthAndWidthM
    max_gap_s: float
    known_other: tuple[FloatArray, FloatArray] | None = field(default=None, repr=False, compare=False)
    _values: dict[Callable[[Pair], FloatArray], FloatArray] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def evaluate_measure(self, measure: PairQuantity) -> FloatArray:
        """Evaluate a measure at each stamp, (n,), or for the pair, (); each is computed once."""
        return self.compute_once(measure.compute)

    def compute_once(self, quantity: Callable[[Pair], FloatArray]) -> FloatArray:
        """Return the quantity of this pair, computed at the first call for it."""
        if quantity not in self._values:
            self._values[quantity] = quantity(self)
        return self._values[quantity]

    def select_rows(self, rows: npt.NDArray[np.intp]) -> Pair:
        """The pair at some of the stamps, with the interpolated states of the other there."""
        state = np.concatenate([self.host.state[rows, :4], self.host_accel_yaw_rate_jerk[rows]], axis=1)
        covariance = None if self.host.covariance is None else self.host.covariance[rows]
        track = ActualTrack(self.stamp_ns[rows], state, covariance)
        return self.with_states(track, self.other_states[rows], self.other_derivatives[rows])

    def slice_rows(self, first: int, last: int) -> Pair:
        """The pair at the host's stamps from `first` to before `last`; the other keeps its whole track."""
        track = ActualTrack(self.stamp_ns[first:last], self.host.state[first:last])
        return replace(self, host=track, known_other=None)

    def with_states(
        self, host: ActualTrack, others: EastNorthSpeedHeadingRows, other_motion: AccelYawRateJerkRows
    ) -> Pair:
        """The pair with another host track, and the other's states (n, 4) and derivatives (n, 3) at its stamps."""
        return replace(self, host=host, known_other=(others, other_motion))

    @property
    def stamp_ns(self) -> Int64Array:
        """The host's stamps, (n,)."""
        return self.host.stamp_ns

    @cached_property
    def stamp_weights_s(self) -> FloatArray:
        """The time that each stamp stands for, s, (n,): half of the way to its neighbours, at most `max_gap_s`."""
        step_s = np.minimum(np.diff(self.stamp_ns) / NS_PER_S, self.max_gap_s)
        if not len(step_s):
            return np.zeros(len(self.stamp_ns))
        return np.asarray(0.5 * (np.concatenate([step_s[:1], step_s]) + np.concatenate([step_s, step_s[-1:]])))

    @cached_property
    def other_states(self) -> EastNorthSpeedHeadingRows:
        """The other's x, y, speed, heading at the host's stamps, (n, 4); NaN where its track has no data."""
        if self.known_other is not None:
            return self.known_other[0]
        return interpolate_x_y_speed_heading(self.other, self.stamp_ns, self.max_gap_s)

    @cached_property
    def host_accel_yaw_rate_jerk(self) -> FloatArray:
        """The host's accel_mps2, yaw_rate_radps and jerk_mps3, (n, 3)."""
        return accel_yaw_rate_jerk_of_track(self.host)

    @cached_property
    def other_derivatives(self) -> AccelYawRateJerkRows:
        """The other's accel_mps2, yaw_rate_radps and jerk_mps3 at the host's stamps, (n, 3); NaN without data."""
        if self.known_other is not None:
            return self.known_other[1]
        return interpolate_x_y_speed_heading(
            self.other, self.stamp_ns, self.max_gap_s, accel_yaw_rate_jerk_of_track(self.other)
        )

    def state_covariances(self, rows: npt.NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Covariances (m, 8, 8) of the host's states in some rows and of the other's newest then; NaN if not known."""
        known = np.flatnonzero(np.isfinite(self.other.state[:, :4]).all(axis=1))
        newest = np.searchsorted(self.other.stamp_ns[known], self.stamp_ns[rows], side="right") - 1
        unknown = np.full((len(rows), N_STATES, N_STATES), np.nan)
        own, theirs = self.host.covariance, self.other.covariance
        return (
            unknown if own is None else np.asarray(own[rows]),
            unknown if theirs is None or not len(known) else np.asarray(theirs[known[np.maximum(newest, 0)]]),
        )

    @cached_property
    def distance_m(self) -> FloatArray:
        """Distance of the centres, (n,); NaN where either track has no data."""
        difference = self.other_states - self.host.state[:, :4]
        return np.where(np.isfinite(difference).all(axis=1), np.hypot(difference[:, 0], difference[:, 1]), np.nan)

    @cached_property
    def near_rows(self) -> npt.NDArray[np.intp]:
        """Indices (m,) of the stamps at which the centres are within 200 m; elsewhere outlines are not compared."""
        return np.flatnonzero(self.distance_m <= MAX_CENTRE_DISTANCE_OF_COMPARED_OUTLINES_M)

    @cached_property
    def relative_motion(self) -> RelativeMotion:
        """The relative motion in the rows `near_rows`."""
        return compute_relative_motion(self.host.state[self.near_rows, :4], self.other_states[self.near_rows])

    @cached_property
    def other_in_host_axes(self) -> OtherInHostAxes:
        """The other in the host's axes, in the rows `near_rows`."""
        return OtherInHostAxes(self)

    def expand_near_rows_to_all_rows(self, values: FloatArray) -> FloatArray:
        """Expand values of the rows `near_rows` to all rows, (n,); the other rows are NaN."""
        out = np.full(len(self.stamp_ns), np.nan)
        out[self.near_rows] = values
        return out


def compute_relative_motion(host: FloatArray, other: FloatArray) -> RelativeMotion:
    """Compute the relative motion of two vehicles from their x, y, speed, heading, (m, 4) each."""
    cos_host, sin_host, cos_other, sin_other = (f(each[:, 3]) for each in (host, other) for f in (np.cos, np.sin))
    return RelativeMotion(
        dx_m=other[:, 0] - host[:, 0],
        dy_m=other[:, 1] - host[:, 1],
        dvx_mps=other[:, 2] * cos_other - host[:, 2] * cos_host,
        dvy_mps=other[:, 2] * sin_other - host[:, 2] * sin_host,
        host_heading_rad=host[:, 3],
        other_heading_rad=other[:, 3],
        host_direction=(cos_host, sin_host),
        other_direction=(cos_other, sin_other),
    )


class OtherInHostAxes:
    """The other in the host's axes, x ahead and y to the left, each (m,): the rows `near_rows` of a pair.

    Attributes:
        host_speed_mps, other_speed_mps: Speeds along their own headings.
        x_m, y_m: Position of the other's centre.
        vx_mps, vy_mps: Velocity of the other relative to the host, along the host's present axes.
        cos_turn, sin_turn: Cosine and sine of the other's heading relative to the host's.
        reach_x_m, reach_y_m: Half the extent of both outlines together along the host's axes.
    """

    def __init__(self, pair: Pair) -> None:
        at = pair.relative_motion
        # The pair holds this object: a reference back would keep the arrays of both until the garbage collector runs.
        self._pair: Pair = weakref.proxy(pair)
        cos_host, sin_host = at.host_direction
        cos_other, sin_other = at.other_direction
        self.cos_turn = cos_host * cos_other + sin_host * sin_other
        self.sin_turn = cos_host * sin_other - sin_host * cos_other
        self.host_speed_mps, self.other_speed_mps = (
            pair.host.state[pair.near_rows, 2],
            pair.other_states[pair.near_rows, 2],
        )
        self.x_m, self.y_m = at.dx_m * cos_host + at.dy_m * sin_host, at.dy_m * cos_host - at.dx_m * sin_host
        self.vx_mps = self.other_speed_mps * self.cos_turn - self.host_speed_mps
        self.vy_mps = self.other_speed_mps * self.sin_turn
        (length, width), (their_length, their_width) = pair.host_size, pair.other_size
        cosine, sine = np.abs(self.cos_turn), np.abs(self.sin_turn)
        self.reach_x_m = 0.5 * (length + their_length * cosine + their_width * sine)
        self.reach_y_m = 0.5 * (width + their_length * sine + their_width * cosine)

    @cached_property
    def host_accel_mps2(self) -> FloatArray:
        """The host's acceleration along its heading, (m,)."""
        return np.asarray(self._pair.host_accel_yaw_rate_jerk[self._pair.near_rows, 0])

    @cached_property
    def other_accel_mps2(self) -> tuple[FloatArray, FloatArray]:
        """The other's acceleration along the host's two axes at a constant heading, (m,) each."""
        accel = self._pair.other_derivatives[self._pair.near_rows, 0]
        return accel * self.cos_turn, accel * self.sin_turn

    @cached_property
    def is_straight_ahead(self) -> npt.NDArray[np.bool_]:
        """Whether the other is ahead and in the host's way if the host drives straight on, (m,)."""
        return np.asarray((self.x_m > 0.0) & (np.abs(self.y_m) < self.reach_y_m))

    @cached_property
    def headway_if_straight_ahead_m(self) -> FloatArray:
        """Gap to the other where it is straight ahead, 0 in contact, else NaN, (m,)."""
        return np.where(self.is_straight_ahead, np.maximum(self.x_m - self.reach_x_m, 0.0), np.nan)


def accel_yaw_rate_jerk_of_track(track: ActualTrack) -> AccelYawRateJerkRows:
    """Acceleration, yaw rate and jerk of a track, (n, 3): its own, else the slopes of its speed and heading."""
    known = track.state[:, 4:7]
    missing = 3 - known.shape[1]
    if not missing:
        return np.asarray(known)
    out: FloatArray = np.concatenate([known, np.full((len(known), missing), np.nan)], axis=1)
    rows = np.flatnonzero(np.isfinite(track.state[:, :4]).all(axis=1))
    if len(rows) < 2:
        return out
    time_s = (track.stamp_ns[rows] - track.stamp_ns[rows[0]]) / NS_PER_S
    speed, heading = track.state[rows, 2], np.unwrap(track.state[rows, 3])
    accel = np.gradient(speed, time_s)
    slopes = np.column_stack([accel, np.gradient(heading, time_s), np.gradient(accel, time_s)])
    out[rows, 3 - missing :] = slopes[:, 3 - missing :]
    return out


def interpolate_x_y_speed_heading(
    track: ActualTrack, at_ns: Int64Array, max_gap_s: float, values: FloatArray | None = None
) -> EastNorthSpeedHeadingRows:
    """Interpolate x, y, speed, heading at times, (n, 4); NaN outside the track and inside gaps above `max_gap_s`.

    States that are not finite are left out.

    Args:
        values: Values to interpolate instead of the states, (n, k).
    """
    finite = np.isfinite(track.state[:, :4]).all(axis=1)
    if values is not None:
        if not finite.any():
            return np.full((len(at_ns), values.shape[1]), np.nan)
        return interpolate_signal_at_times(track.stamp_ns[finite], values[finite], at_ns, max_gap_s=max_gap_s)
    values = track.state[finite, :4]
    if len(values) < 2:
        return np.full((len(at_ns), 4), np.nan)
    values[:, 3] = np.unwrap(values[:, 3])
    return interpolate_signal_at_times(track.stamp_ns[finite], values, at_ns, max_gap_s=max_gap_s)
