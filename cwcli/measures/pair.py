"""Two vehicles as they really moved: what the measures are made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from cwcli.measures.outlines import Size
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.resample import resample

OUTLINE_RANGE_M = 100.0  # outlines are compared within this centre distance


class OfPair(Protocol):
    """Something that is computed of a pair, such as `cwcli.measures.base.Measure`."""

    @property
    def of(self) -> Callable[[Pair], FloatArray]: ...


@dataclass(frozen=True)
class ActualTrack:
    """What a vehicle really did.

    Attributes:
        stamp_ns: Shape (n,), strictly increasing.
        state: Shape (n, >= 4): x_m, y_m, speed_mps, heading_rad first.
    """

    stamp_ns: Int64Array
    state: FloatArray


@dataclass(frozen=True)
class Relative:
    """The other relative to the host, map frame, each (m,): centre, velocity, and both headings."""

    dx_m: FloatArray
    dy_m: FloatArray
    dvx_mps: FloatArray
    dvy_mps: FloatArray
    host_heading_rad: FloatArray
    other_heading_rad: FloatArray


@dataclass(frozen=True)
class Pair:
    """Two vehicles at the host's stamps. What several measures share is computed once.

    Attributes:
        host, other: Their tracks.
        host_size, other_size: Length and width of the outlines, metres.
        max_gap_s: The other's track is not interpolated across longer gaps.
    """

    host: ActualTrack
    other: ActualTrack
    host_size: Size
    other_size: Size
    max_gap_s: float
    _values: dict[OfPair, FloatArray] = field(default_factory=dict, init=False, repr=False, compare=False)

    def value(self, measure: OfPair) -> FloatArray:
        """A measure at each stamp, (n,), or of the pair, ()."""
        if measure not in self._values:
            self._values[measure] = measure.of(self)
        return self._values[measure]

    @property
    def stamp_ns(self) -> Int64Array:
        """Of the host, (n,)."""
        return self.host.stamp_ns

    @cached_property
    def others(self) -> FloatArray:
        """The other's x, y, speed, heading at the host's stamps, (n, 4); NaN where its track has no data."""
        return interpolate(self.other, self.stamp_ns, self.max_gap_s)

    @cached_property
    def distance_m(self) -> FloatArray:
        """Of the centres, (n,); NaN where either track has no data."""
        apart = self.others - self.host.state[:, :4]
        return np.where(np.isfinite(apart).all(axis=1), np.hypot(apart[:, 0], apart[:, 1]), np.nan)

    @cached_property
    def near(self) -> npt.NDArray[np.intp]:
        """The rows in which the centres are within 100 m: elsewhere outlines are not compared."""
        return np.flatnonzero(self.distance_m <= OUTLINE_RANGE_M)

    @cached_property
    def relative(self) -> Relative:
        """The relative motion in the rows `near`."""
        own, theirs = self.host.state[self.near, :4], self.others[self.near]
        return Relative(
            dx_m=theirs[:, 0] - own[:, 0],
            dy_m=theirs[:, 1] - own[:, 1],
            dvx_mps=theirs[:, 2] * np.cos(theirs[:, 3]) - own[:, 2] * np.cos(own[:, 3]),
            dvy_mps=theirs[:, 2] * np.sin(theirs[:, 3]) - own[:, 2] * np.sin(own[:, 3]),
            host_heading_rad=own[:, 3],
            other_heading_rad=theirs[:, 3],
        )

    def spread(self, values: FloatArray, far: float) -> FloatArray:
        """Values of the rows `near` over all rows, (n,): `far` in those farther apart, NaN in those without data."""
        out = np.where(np.isnan(self.distance_m), np.nan, far)
        out[self.near] = values
        return out


def interpolate(track: ActualTrack, at_ns: Int64Array, max_gap_s: float) -> FloatArray:
    """x, y, speed, heading at the given times, (n, 4); NaN outside the track and inside gaps above `max_gap_s`.

    States that are not finite are no data.
    """
    finite = np.isfinite(track.state[:, :4]).all(axis=1)
    values = track.state[finite, :4]
    if len(values) < 2:
        return np.full((len(at_ns), 4), np.nan)
    values[:, 3] = np.unwrap(values[:, 3])
    return resample(track.stamp_ns[finite], values, at_ns, max_gap_s=max_gap_s)
