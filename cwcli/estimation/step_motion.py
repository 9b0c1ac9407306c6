"""Motion of the car in equal time steps by each source alone, without a filter.

Positions give distance and direction in a step, a speed the distance, a heading the direction, and an IMU the changes
of speed and heading. `source_checks` compares these with each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cwcli.estimation.fix_scatter import noise_sigma_from_scatter_about_neighbours
from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.passes import SensorSeries
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, FloatArray

MAX_BRIDGED_GAP_S = 1.0
"""Longest pause of a source that is interpolated linearly, s: the shortest step. Chosen by hand; not fitted."""
MAX_BRIDGED_GAP_INTERVALS = 2.5
"""Longest pause of a slow source that is interpolated, in its median intervals. Chosen by hand; not fitted."""
MIN_POSITION_SIGMA_M = 0.05
"""Least sigma of a position, m: that of `measurements.QUANTITY_BY_KIND`."""
MIN_FIX_DISTANCE_FOR_COURSE_SIGMAS = 6.0
"""Least distance between two fixes, in sigmas of its noise, that gives a speed and a course. Chosen by hand."""
SHARED_FIX_SIGMA_FACTOR = 1.5**0.5
"""The fix that ends a step begins the next one: the difference x2 - 2 x1 + x0 has 6 and not 4 variances of a fix."""
VELOCITY_COURSE_SIGMA_RAD = 0.05
"""One sigma of the course of a GNSS velocity over a step of at least MIN_CHORD_M, rad: 0.1 m/s of some 2 m/s."""
MIN_FIX_DISTANCE_FOR_COURSE_M = 5.0
"""Least distance between two fixes that gives a speed and a course, m. Chosen: a car's length, to exclude parking."""


@dataclass(frozen=True)
class StepMotion:
    """Motion by one source in n steps of equal length; NaN where it is unknown.

    Attributes:
        series: The source.
        distance_m: Shape (n,): way in each step; of a speed with its sign.
        speed_mps: Shape (n,): mean speed in each step. An accelerometer tells it up to a constant and a drift.
        angle_rad: Shape (n,): mean heading or course in each step. A gyroscope tells it up to a constant.
        speed_sigma_mps: One sigma of the speed by the white noise of fixes; 0 for other sources.
        angle_sigma_rad: Shape (n,): the same of the angle.
        has_zero_angle: The angle counts from east.
    """

    series: SensorSeries
    distance_m: FloatArray
    speed_mps: FloatArray
    angle_rad: FloatArray
    speed_sigma_mps: float
    angle_sigma_rad: FloatArray
    has_zero_angle: bool

    @property
    def source(self) -> str:
        """Name of the source."""
        return self.series.source

    @property
    def kind(self) -> Kind:
        """Measured quantity of the source."""
        return self.series.kind

    @property
    def turn_rad(self) -> FloatArray:
        """Change of the angle from each step to the next, (n - 1,), wrapped unless it comes from a gyroscope."""
        change = np.diff(self.angle_rad)
        return change if self.kind is Kind.YAW_RATE else np.asarray((change + np.pi) % (2.0 * np.pi) - np.pi)

    @property
    def turn_sigma_rad(self) -> FloatArray:
        """One sigma of `turn_rad` by the noise of fixes, (n - 1,)."""
        return np.asarray(SHARED_FIX_SIGMA_FACTOR * np.hypot(self.angle_sigma_rad[:-1], self.angle_sigma_rad[1:]))

    @property
    def speed_change_to_next_step_mps(self) -> FloatArray:
        """Change of the mean speed from each step to the next, (n - 1,)."""
        return np.diff(self.speed_mps)

    @property
    def speed_change_sigma_mps(self) -> float:
        """One sigma of `speed_change_to_next_step_mps` by the noise of fixes."""
        return SHARED_FIX_SIGMA_FACTOR * math.sqrt(2.0) * self.speed_sigma_mps


def compute_step_motion_by_source(s: SensorSeries, edges_s: FloatArray) -> StepMotion:
    """Compute the motion by a source between neighbouring edges.

    Args:
        edges_s: Shape (n + 1,), increasing, equally spaced.
    """
    n = len(edges_s) - 1
    step_s = float(edges_s[1] - edges_s[0])
    nothing, exact = np.full(n, np.nan), np.zeros(n)
    known = covered_step_mask(s.time_s, edges_s)
    if s.kind in (Kind.POSITION, Kind.VELOCITY):
        if s.kind is Kind.POSITION:
            displacement = np.column_stack([np.diff(np.interp(edges_s, s.time_s, s.values[:, k])) for k in (0, 1)])
            chord_sigma_m = math.sqrt(2.0) * np.fmax(noise_sigma_from_scatter_about_neighbours(s), MIN_POSITION_SIGMA_M)
            least_m = max(MIN_FIX_DISTANCE_FOR_COURSE_M, MIN_FIX_DISTANCE_FOR_COURSE_SIGMAS * chord_sigma_m)
        else:
            displacement = (
                np.column_stack([means_between_edges(s.time_s, s.values[:, k], edges_s) for k in (0, 1)]) * step_s
            )
            chord_sigma_m, least_m = 0.0, MIN_FIX_DISTANCE_FOR_COURSE_M
        distance = np.where(known, np.hypot(*displacement.T), np.nan)
        clear = np.where(distance > least_m, distance, np.nan)
        course = np.where(distance > least_m, np.arctan2(displacement[:, 1], displacement[:, 0]), np.nan)
        sigma = chord_sigma_m / clear if s.kind is Kind.POSITION else np.full(n, VELOCITY_COURSE_SIGMA_RAD)
        return StepMotion(s, clear, clear / step_s, course, chord_sigma_m / step_s, sigma, True)
    values = s.values[:, 0]
    if s.kind is Kind.HEADING:
        values = np.unwrap(values)
    elif s.kind is not Kind.SPEED:
        values = trapezoidal_integral(s.time_s, values)
    mean = np.where(known, means_between_edges(s.time_s, values, edges_s), np.nan)
    if s.kind is Kind.SPEED:
        return StepMotion(s, mean * step_s, mean, nothing, 0.0, exact, False)
    if s.kind is Kind.ACCEL:
        return StepMotion(s, nothing, mean, nothing, 0.0, exact, False)
    return StepMotion(s, nothing, nothing, mean, 0.0, exact, s.kind is Kind.HEADING)


def step_edges_s(series: Sequence[SensorSeries], step_s: float) -> FloatArray:
    """Return the edges (n + 1,), s, of steps over the time of the positions; fewer than two if it is shorter."""
    times = [s.time_s for s in series if s.kind is Kind.POSITION and len(s)]
    first, last = min(float(t[0]) for t in times), max(float(t[-1]) for t in times)
    return np.asarray(first + step_s * np.arange(int((last - first) / step_s) + 1))


def trapezoidal_integral(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return the trapezoidal integral from the first row on, (n,)."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time_s))])


def means_between_edges(time_s: FloatArray, values: FloatArray, edges_s: FloatArray) -> FloatArray:
    """Return the means (n,) of a column between neighbouring edges."""
    return np.asarray(np.diff(np.interp(edges_s, time_s, trapezoidal_integral(time_s, values))) / np.diff(edges_s))


def covered_step_mask(time_s: FloatArray, edges_s: FloatArray) -> BoolArray:
    """Return a mask (n,) of the steps that lie within the rows and overlap no pause."""
    gap_s = np.diff(time_s)
    pauses = np.flatnonzero(gap_s > max(MAX_BRIDGED_GAP_S, MAX_BRIDGED_GAP_INTERVALS * median_of_finite_values(gap_s)))
    n = len(edges_s) - 1
    change = np.zeros(n + 1, np.int64)
    np.add.at(change, np.clip(np.searchsorted(edges_s, time_s[pauses], side="right") - 1, 0, n), 1)
    np.add.at(change, np.clip(np.searchsorted(edges_s, time_s[pauses + 1], side="left"), 0, n), -1)
    inside = (edges_s[:-1] >= time_s[0]) & (edges_s[1:] <= time_s[-1])
    return np.asarray(inside & (np.cumsum(change)[:n] == 0))
