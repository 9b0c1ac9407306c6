"""Measures of the two predicted paths of a pair at one moment: distances, times and the probability of a collision.

Positions are relative, other minus host; r(tau) is linear between the path points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, fields

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass, replace
from cwcli.measures.outlines import LengthAndWidthM, outline_separation_m
from cwcli.signals.columns import FloatArray
from cwcli.warning.collision import PathPairs
from cwcli.warning.remote_alignment import PathPoints


@dataclass(frozen=True)
class PairStates:
    """The states of a pair at m moments.

    Attributes:
        host, other: Shapes (m, 8) and (m, 7), columns as in `STATE_NAMES`; the other's is brought forward by its age.
        says_hard_braking: Shape (m,): the other has sent that it brakes hard (`VehicleTrack.says_hard_braking`).
        sizes: Length and width of each, m.
    """

    host: FloatArray
    other: FloatArray
    says_hard_braking: npt.NDArray[np.bool_]
    sizes: tuple[LengthAndWidthM, LengthAndWidthM]


@dataclass(frozen=True)
class Measures:
    """Measures of m evaluations of one pair, each of shape (m,). Times count from the evaluation.

    Attributes:
        distance_m, closing_mps: Centre distance now, and how fast it shrinks.
        ttc_s: distance / closing speed; infinity when not closing.
        horizon_distance_m: Predicted centre distance at the horizon.
        min_distance_m, min_time_s: Smallest predicted centre distance, and when.
        entry_s: When the predicted centre distance falls below the collision distance; infinity if it doesn't.
        overlap_s: When the outlines first overlap along the paths; infinity if they don't.
        probability: Probability that the outlines touch within the horizon.
        late_probability: Probability that they touch within the horizon plus the rule's persistence.
        braked_probability: Probability that they touch although the host brakes from now on (`warning.collision`); NaN
            where it was not computed.
        by_name: Further measures that the rule names: name of a measure of docs/measures.md -> (m,), NaN where it has
            no value. They follow from the present states, so there are none under the onset hypothesis.
        states: The present states, for a rule that uses them; None under the onset hypothesis.
        farther: The same to the horizon that braking needs (`warning.braking_horizon`), for a rule that uses it.
    """

    distance_m: FloatArray
    closing_mps: FloatArray
    ttc_s: FloatArray
    horizon_distance_m: FloatArray
    min_distance_m: FloatArray
    min_time_s: FloatArray
    entry_s: FloatArray
    overlap_s: FloatArray
    probability: FloatArray
    late_probability: FloatArray
    braked_probability: FloatArray
    by_name: Mapping[str, FloatArray] = field(default_factory=dict)
    states: PairStates | None = None
    farther: Measures | None = None


MEASURE_ARRAY_NAMES = tuple(
    entry.name for entry in fields(Measures) if entry.name not in ("by_name", "states", "farther")
)
"""Names of the fields of `Measures` that are arrays (m,)."""
MIN_HORIZON_DISTANCE_ADVANTAGE_OF_ONSET_PATH_M = 0.25
"""Least advantage in m of the onset path's distance at the horizon over the mean path's for the onset to count. Chosen
by hand."""


def measure_paths(
    host: PathPoints,
    other: PathPoints,
    time_s: FloatArray,
    *,
    horizon_s: float,
    radius_m: float,
    host_size: LengthAndWidthM,
    other_size: LengthAndWidthM,
) -> Measures:
    """Compute the measures from points of both paths at the times `time_s` (q,), which begin at 0 and hold `horizon_s`.

    The probabilities are still NaN (`add_contact_probabilities`).
    """
    x, y = other.x_m - host.x_m, other.y_m - host.y_m
    distance, closing = _centre_distance_and_closing_speed_now(host, other, x[:, 0], y[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        ttc = np.where(closing > 0.0, distance / closing, np.inf)
    segments = _RelativeSegments.from_points(x, y, time_s)
    nearest, share, smallest = segments.segment_share_and_distance_of_closest_approach()
    start = time_s[nearest]
    nearest_s = start + share * (time_s[nearest + 1] - start)
    at_horizon = int(np.searchsorted(time_s, horizon_s - 1e-9))
    reach = 0.5 * (np.hypot(*host_size) + np.hypot(*other_size))
    return Measures(
        distance_m=distance,
        closing_mps=closing,
        ttc_s=ttc,
        horizon_distance_m=np.hypot(x[:, at_horizon], y[:, at_horizon]),
        min_distance_m=smallest,
        min_time_s=nearest_s,
        entry_s=segments.entry_time_s(radius_m),
        overlap_s=_first_overlap_time_s(x, y, host, other, time_s, smallest <= reach, (host_size, other_size)),
        probability=np.full(len(x), np.nan),
        late_probability=np.full(len(x), np.nan),
        braked_probability=np.full(len(x), np.nan),
    )


def add_contact_probabilities(
    measures: Measures,
    pairs: PathPairs,
    time_s: FloatArray,
    *,
    horizon_s: float,
    min_probability_to_brake: float,
    braking_deceleration_mps2: float,
    is_wanted: npt.NDArray[np.bool_] | None = None,
) -> Measures:
    """Add the probabilities of contact to the measures.

    Args:
        time_s: Shape (q,): the times of the paths; the last is the horizon plus the persistence.
        horizon_s: One of the times.
        min_probability_to_brake: Where contact is at least this probable, the probability under braking is computed.
        braking_deceleration_mps2: Deceleration of that braking; 0: it is not computed.
        is_wanted: Shape (m,): rows in which probabilities are computed; None: all.
    """
    distance = measures.min_distance_m if is_wanted is None else np.where(is_wanted, measures.min_distance_m, np.nan)
    in_time, late = pairs.contact_probability_by_times(distance, time_s, (horizon_s, float(time_s[-1]))).T
    braked = np.full(len(late), np.nan)
    rows = (
        np.flatnonzero((late >= min_probability_to_brake) & (late > 0.0))
        if braking_deceleration_mps2 > 0.0
        else np.zeros(0, np.intp)
    )
    if len(rows):
        braked[rows] = pairs.select_rows(rows).contact_probability_if_braking(braking_deceleration_mps2, horizon_s)
    return replace(measures, probability=in_time, late_probability=late, braked_probability=braked)


def _centre_distance_and_closing_speed_now(
    host: PathPoints, other: PathPoints, relative_x_m: FloatArray, relative_y_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Centre distance (m) and closing speed (m/s) at tau = 0, (m,) each."""
    own_v, their_v = host.speed_mps[:, 0], other.speed_mps[:, 0]
    own_heading, their_heading = host.heading_rad[:, 0], other.heading_rad[:, 0]
    dvx = their_v * np.cos(their_heading) - own_v * np.cos(own_heading)
    dvy = their_v * np.sin(their_heading) - own_v * np.sin(own_heading)
    distance = np.hypot(relative_x_m, relative_y_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        closing = np.where(distance > 0.0, -(relative_x_m * dvx + relative_y_m * dvy) / distance, 0.0)
    return distance, closing


@dataclass(frozen=True)
class _RelativeSegments:
    """The relative path as q - 1 straight segments, (m, q - 1) each: start (x, y), step (ex, ey)."""

    time_s: FloatArray
    x: FloatArray
    y: FloatArray
    ex: FloatArray
    ey: FloatArray

    @staticmethod
    def from_points(relative_x_m: FloatArray, relative_y_m: FloatArray, time_s: FloatArray) -> _RelativeSegments:
        """The segments between relative positions (m, q) at the times (q,)."""
        return _RelativeSegments(
            time_s,
            relative_x_m[:, :-1],
            relative_y_m[:, :-1],
            np.diff(relative_x_m, axis=1),
            np.diff(relative_y_m, axis=1),
        )

    def closest_share_and_distance_of_each_segment(self) -> tuple[FloatArray, FloatArray]:
        """The share (0 to 1) of each segment at which the distance is smallest, and that distance, (m, q - 1)."""
        length2 = self.ex**2 + self.ey**2
        with np.errstate(divide="ignore", invalid="ignore"):
            share = -(self.x * self.ex + self.y * self.ey) / length2
        share = np.clip(np.where(length2 > 0.0, share, 0.0), 0.0, 1.0)
        return share, np.hypot(self.x + share * self.ex, self.y + share * self.ey)

    def segment_share_and_distance_of_closest_approach(self) -> tuple[np.ndarray, FloatArray, FloatArray]:
        """The segment of the closest approach, the share of it, and the distance there, (m,) each."""
        share, distance = self.closest_share_and_distance_of_each_segment()
        filled = np.where(np.isnan(distance), np.inf, distance)
        index = filled.argmin(axis=1)
        rows = np.arange(len(index))
        return index, share[rows, index], distance[rows, index]

    def entry_time_s(self, radius_m: float) -> FloatArray:
        """Time at which the distance first falls below the radius, (m,); 0 inside already, infinity if never."""
        _, distance = self.closest_share_and_distance_of_each_segment()
        inside = distance < radius_m
        rows = np.flatnonzero(inside.any(axis=1))
        out = np.full(len(distance), np.inf)
        first = inside[rows].argmax(axis=1)
        x, y, ex, ey = (values[rows, first] for values in (self.x, self.y, self.ex, self.ey))
        # |r + s e|^2 = R^2, the smaller root; a start inside is 0
        a, b, c = ex**2 + ey**2, x * ex + y * ey, x**2 + y**2 - radius_m**2
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(c <= 0.0, 0.0, (-b - np.sqrt(np.maximum(b**2 - a * c, 0.0))) / a)
        step = self.time_s[first + 1] - self.time_s[first]
        out[rows] = self.time_s[first] + share * step
        return out


def _first_overlap_time_s(
    relative_x_m: FloatArray,
    relative_y_m: FloatArray,
    host: PathPoints,
    other: PathPoints,
    time_s: FloatArray,
    near_rows: np.ndarray,
    host_and_other_size: tuple[LengthAndWidthM, LengthAndWidthM],
) -> FloatArray:
    """Time (s) of the first overlap of the outlines, (m,), linear between points; infinity outside `near_rows`."""
    out = np.full(len(relative_x_m), np.inf)
    rows = np.flatnonzero(near_rows)
    if not len(rows):
        return out
    margin = outline_separation_m(
        relative_x_m[rows], relative_y_m[rows], host.heading_rad[rows], other.heading_rad[rows], *host_and_other_size
    )
    touching = margin <= 0.0
    hits = np.flatnonzero(touching.any(axis=1))
    first = touching[hits].argmax(axis=1)
    before = np.maximum(first - 1, 0)
    margin_before, inside = margin[hits, before], margin[hits, first]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(first > 0, margin_before / (margin_before - inside), 0.0)
    out[rows[hits]] = time_s[before] + share * (time_s[first] - time_s[before])
    return out
