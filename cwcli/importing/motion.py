"""The way between positions, and what it says about units, signs and directions of other columns.

Every comparison is over spans of at least a second, so that the noise of single positions hardly counts.
"""

from __future__ import annotations

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

METRES_PER_DEGREE_OF_LATITUDE = 111_195.0
"""Length of a degree of latitude on a sphere of 6,371 km, m."""
MIN_TIME_BETWEEN_SPAN_POSITIONS_S = 1.0
"""Shortest time over which a way is measured."""
MAX_TIME_BETWEEN_SPAN_POSITIONS_S = 5.0
"""Longest time in s between two positions from which a speed and a direction are computed. Chosen by hand."""
MIN_TRACK_LENGTH_TO_SHOW_UNITS_M = 100.0
"""Least length in m of a track that can show the unit of a speed or the sense of a heading. Chosen by hand."""
MIN_SPEED_FOR_COURSE_MPS = 2.0
"""Least speed in m/s at which the direction between two positions is used: walking pace. Chosen by hand."""
MAX_LOG_DEVIATION_OF_SPEED_RATIO_FROM_UNIT_RATIO = 0.06
"""Largest deviation of the natural logarithm of a ratio of two speeds from that of a unit; mph and knots differ by
0.14."""


@dataclass(frozen=True)
class TrackSpans:
    """Spans of a track of positions, m each.

    Attributes:
        start_ns, end_ns: Shape (m,): stamps of the two positions.
        east_m, north_m: Shape (m,): the way between them.
    """

    start_ns: Int64Array
    end_ns: Int64Array
    east_m: FloatArray
    north_m: FloatArray

    @property
    def span_durations_s(self) -> FloatArray:
        """Length of the spans in s."""
        return (self.end_ns - self.start_ns) / NS_PER_S

    @property
    def span_lengths_m(self) -> FloatArray:
        """Way of the spans."""
        return np.hypot(self.east_m, self.north_m)

    @property
    def speed_mps(self) -> FloatArray:
        """Speed over ground of the spans."""
        return self.span_lengths_m / self.span_durations_s

    @property
    def span_middles_ns(self) -> Int64Array:
        """Times in the middle of the spans."""
        return self.start_ns + (self.end_ns - self.start_ns) // 2

    @property
    def moving_span_mask(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Whether a span shows a direction."""
        return np.asarray(self.speed_mps > MIN_SPEED_FOR_COURSE_MPS)

    @property
    def can_show_units_and_directions(self) -> bool:
        """Whether the track can show units and directions."""
        return bool(self.span_lengths_m[self.moving_span_mask].sum() >= MIN_TRACK_LENGTH_TO_SHOW_UNITS_M)

    @property
    def course_rad(self) -> FloatArray:
        """Direction of the way, counter-clockwise from east, (m,)."""
        return np.arctan2(self.north_m, self.east_m)


def spans_of_geographic_places(
    stamp_ns: Int64Array, latitude_deg: FloatArray, longitude_deg: FloatArray
) -> TrackSpans | None:
    """Return the spans between places, by stamp; None for too few."""
    keep = np.isfinite(latitude_deg) & np.isfinite(longitude_deg) & ((latitude_deg != 0) | (longitude_deg != 0))
    if np.count_nonzero(keep) < 3:
        return None
    latitude, longitude, stamps = latitude_deg[keep], longitude_deg[keep], stamp_ns[keep]
    middle = float(np.median(latitude))
    east = np.unwrap(np.deg2rad(longitude)) * 180.0 / np.pi * METRES_PER_DEGREE_OF_LATITUDE * np.cos(np.deg2rad(middle))
    return spans_of_map_points(stamps, east, latitude * METRES_PER_DEGREE_OF_LATITUDE)


def spans_of_map_points(stamp_ns: Int64Array, x_m: FloatArray, y_m: FloatArray) -> TrackSpans | None:
    """Return the spans between points; None for too few."""
    order = np.argsort(stamp_ns, kind="stable")
    stamps, x, y = stamp_ns[order], x_m[order], y_m[order]
    changed = np.concatenate([[True], (np.diff(x) != 0) | (np.diff(y) != 0)])
    if np.count_nonzero(changed) > 2:  # a value that is held is no new position
        is_too_soon = np.concatenate([[False], np.diff(stamps) < MIN_TIME_BETWEEN_SPAN_POSITIONS_S * NS_PER_S])
        is_new_place = changed | ~is_too_soon
        stamps, x, y = stamps[is_new_place], x[is_new_place], y[is_new_place]
    if len(stamps) < 3:
        return None
    rows = first_rows_of_intervals(stamps, MIN_TIME_BETWEEN_SPAN_POSITIONS_S)
    if len(rows) < 3:
        return None
    start, end = rows[:-1], rows[1:]
    span_ns = stamps[end] - stamps[start]
    sound = (span_ns > 0) & (span_ns <= MAX_TIME_BETWEEN_SPAN_POSITIONS_S * NS_PER_S)
    start, end = start[sound], end[sound]
    if len(start) < 2:
        return None
    return TrackSpans(stamps[start], stamps[end], x[end] - x[start], y[end] - y[start])


def first_rows_of_intervals(stamp_ns: Int64Array, length_s: float) -> Int64Array:
    """Return the first row of each interval of a length that has any, counted from the first stamp; stamps ascend."""
    interval = (stamp_ns - stamp_ns[0]) // int(length_s * NS_PER_S)
    return np.flatnonzero(np.diff(interval, prepend=-1)).astype(np.int64)


def mean_over_spans(track: TrackSpans, stamp_ns: Int64Array, values: FloatArray) -> FloatArray:
    """Return the mean of a column over each span (m,), NaN for a span without rows: trapezes between the rows."""
    finite = np.isfinite(values)
    stamps, finite_values = stamp_ns[finite], values[finite]
    if len(stamps) < 2:
        return np.full(len(track.start_ns), np.nan)
    order = np.argsort(stamps, kind="stable")
    stamps, finite_values = stamps[order], finite_values[order]
    time_s = (stamps - stamps[0]) / NS_PER_S
    area = np.concatenate([[0.0], np.cumsum(0.5 * (finite_values[1:] + finite_values[:-1]) * np.diff(time_s))])
    start_s, end_s = (track.start_ns - stamps[0]) / NS_PER_S, (track.end_ns - stamps[0]) / NS_PER_S

    def integral_until(at_s: FloatArray) -> FloatArray:
        row = np.clip(np.searchsorted(time_s, at_s) - 1, 0, len(time_s) - 2)
        step = np.maximum(time_s[row + 1] - time_s[row], 1e-12)
        inside = at_s - time_s[row]
        slope = (finite_values[row + 1] - finite_values[row]) / step
        return np.asarray(area[row] + finite_values[row] * inside + 0.5 * slope * inside**2)

    mean = (integral_until(end_s) - integral_until(start_s)) / (end_s - start_s)
    outside = (start_s < time_s[0] - 0.5) | (end_s > time_s[-1] + 0.5)
    gaps = np.diff(time_s)
    row = np.clip(np.searchsorted(time_s, start_s), 0, len(gaps) - 1)
    outside |= gaps[row] > MAX_TIME_BETWEEN_SPAN_POSITIONS_S
    return np.where(outside, np.nan, mean)


def speed_units_per_mps(track: TrackSpans | None, stamp_ns: Int64Array, values: FloatArray) -> float:
    """Return how many units of a column of speeds make 1 m/s over ground; NaN where the track can't tell."""
    if track is None or not track.can_show_units_and_directions:
        return float("nan")
    mean = mean_over_spans(track, stamp_ns, np.abs(values))
    use = track.moving_span_mask & np.isfinite(mean) & (mean > 0)
    if np.count_nonzero(use) < 5:
        return float("nan")
    return float(np.median(mean[use] / track.speed_mps[use]))


def speed_ratio_spread(track: TrackSpans, stamp_ns: Int64Array, values: FloatArray) -> float:
    """Return half the width of the middle 80 % of the logarithm of a speed by the way; NaN if unknown."""
    mean = mean_over_spans(track, stamp_ns, np.abs(values))
    use = track.moving_span_mask & np.isfinite(mean) & (mean > 0)
    if np.count_nonzero(use) < 10:
        return float("nan")
    low, high = np.percentile(np.log(mean[use] / track.speed_mps[use]), [10, 90])
    return float(high - low) / 2.0


def heading_minus_course_of_moving_spans_rad(
    track: TrackSpans, stamp_ns: Int64Array, heading_rad: FloatArray
) -> FloatArray:
    """Return heading minus course, (k,), wrapped, of the spans in motion that have a heading."""
    finite = np.isfinite(heading_rad)
    if np.count_nonzero(finite) < 2:
        return np.zeros(0)
    order = np.argsort(stamp_ns[finite], kind="stable")
    stamps, heading = stamp_ns[finite][order], heading_rad[finite][order]
    at = track.span_middles_ns[track.moving_span_mask]
    row = np.clip(np.searchsorted(stamps, at), 0, len(stamps) - 1)
    near = np.abs(stamps[row] - at) < 2 * NS_PER_S
    error = heading[row] - track.course_rad[track.moving_span_mask]
    return np.asarray(np.angle(np.exp(1j * error))[near])


def turn_rate_units_per_radps_and_correlation(
    track: TrackSpans | None, stamp_ns: Int64Array, values: FloatArray
) -> tuple[float, float]:
    """Return how many units of a turn rate make 1 rad/s of the course, and the correlation; NaN where it can't tell."""
    nothing = float("nan"), 0.0
    if track is None or not track.can_show_units_and_directions:
        return nothing
    course = track.course_rad
    neighbours = (track.start_ns[1:] == track.end_ns[:-1]) & track.moving_span_mask[1:] & track.moving_span_mask[:-1]
    if np.count_nonzero(neighbours) < 10:
        return nothing
    change = np.angle(np.exp(1j * np.diff(course)))
    middle = track.span_middles_ns
    between = TrackSpans(middle[:-1], middle[1:], np.ones(len(middle) - 1), np.zeros(len(middle) - 1))
    rate = mean_over_spans(between, stamp_ns, values)
    use = neighbours & np.isfinite(rate)
    if np.count_nonzero(use) < 10:
        return nothing
    course_rate = change[use] / between.span_durations_s[use]
    if np.abs(course_rate * between.span_durations_s[use]).sum() < 0.7:  # 40 degrees in all
        return nothing
    measured_rate = rate[use] - np.median(rate[use])
    course_rate = course_rate - np.median(course_rate)
    scale = float((course_rate * course_rate).sum())
    strength = float(np.sqrt(scale * (measured_rate * measured_rate).sum()))
    if scale <= 0 or strength <= 0:
        return nothing
    both = float((course_rate * measured_rate).sum())
    return both / scale, both / strength
