"""Faults of sensors as functions on a simulated drive's measurements, for the study `lying_sensors` and its test.

A fault changes measurements as if the sensor, its driver or its mounting were wrong in that way. A quarter of them is
kept aside (`is_kept_aside`): they were written before the detection and not run until it was finished.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cwcli.estimation import Kind, Measurements

G = 9.80665
LATITUDE_DEG = 48.0
EARTH_DEG_M = 111_320.0
"""Length of a degree of latitude, m."""
Change = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Times (n,), s from the start, and values (n, d) -> wrong values (n, d)."""
Rewrite = Callable[[Measurements], list[Measurements]]
"""A source -> what takes its place: other stamps, more rows, or further sources."""


@dataclass(frozen=True)
class Fault:
    """A fault.

    Attributes:
        name: Name in tables.
        kind: Kind of the measurements that it changes.
        change: What it does to them.
        words: Words of which one names the fault in what the user is told.
        is_kept_aside: Not looked at while the detection was built.
        rewrite: What it does to stamps, rows and sources.
        ahead_m: How far ahead of the true point the states then are, lawfully.
        is_drift: It is a slow drift or a scale of the only position, which the verdict may except.
    """

    name: str
    kind: Kind
    change: Change
    words: tuple[str, ...] = ()
    is_kept_aside: bool = False
    rewrite: Rewrite = lambda m: [m]
    ahead_m: float = 0.0
    is_drift: bool = False

    def apply(self, measurements: Sequence[Measurements]) -> list[Measurements]:
        """Measurements with the fault."""
        first_ns = min(int(m.stamp_ns.min()) for m in measurements)
        found = []
        for m in measurements:
            if m.kind is self.kind:
                values = self.change((m.stamp_ns - first_ns) / 1e9, m.values.copy())
                found += self.rewrite(replace(m, values=values, covariance=None))
            else:
                found.append(m)
        return found


def scaled(factor: float) -> Change:
    return lambda _, values: factor * values


def affine(sign: float, offset_deg: float) -> Change:
    return lambda _, values: (sign * values + np.radians(offset_deg) + np.pi) % (2 * np.pi) - np.pi


def imu(accel: Sequence[Sequence[float]] | float = 1.0, gyro: Sequence[Sequence[float]] | float = 1.0) -> Change:
    """Matrices or factors: what is read is this times what should be."""
    a, g = (np.eye(3) * m if np.isscalar(m) else np.array(m, float) for m in (accel, gyro))
    return lambda _, values: np.column_stack([values[:, :3] @ a.T, values[:, 3:] @ g.T])


def turned(*rows: Sequence[float]) -> Change:
    return imu(rows, rows)


def rotation(axis: int, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    m = np.eye(3)
    i, j = [k for k in range(3) if k != axis]
    m[i, i] = m[j, j] = c
    m[i, j], m[j, i] = (-s, s)
    return m


def flipped_at_standstill(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    # The simulated heading has 0.5 deg of noise; the fault needs the truth: the caller stores it here.
    speed = np.interp(time_s, *STANDING_SPEED)
    return np.where(speed[:, None] < 0.3, values + np.pi, values)


def zero_at_standstill(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    speed = np.interp(time_s, *STANDING_SPEED)
    return np.where(speed[:, None] < 0.3, 0.0, values)


def ahead_of_car(distance_m: float) -> Change:
    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        heading = np.interp(time_s, *TRUE_HEADING)
        return values + distance_m * np.column_stack([np.cos(heading), np.sin(heading)])

    return change


TRUE_HEADING: list[np.ndarray] = [np.array([0.0, 1.0]), np.array([0.0, 0.0])]
"""Times and true headings, rad, of the drive at hand; set by the study."""
STANDING_SPEED: list[np.ndarray] = [np.array([0.0, 1.0]), np.array([1.0, 1.0])]
"""Times and absolute true speeds of the drive at hand; set by the study."""


def stuck(begin_s: float, end_s: float) -> Change:
    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        rows = np.flatnonzero((time_s >= begin_s) & (time_s < end_s))
        if len(rows):
            values[rows] = values[rows[0]]
        return values

    return change


def zero_between(begin_s: float, end_s: float) -> Change:
    return lambda time_s, values: np.where(((time_s >= begin_s) & (time_s < end_s))[:, None], 0.0, values)


def clipped(limit: float, *columns: int) -> Change:
    def change(_: np.ndarray, values: np.ndarray) -> np.ndarray:
        values[:, list(columns)] = np.clip(values[:, list(columns)], -limit, limit)
        return values

    return change


def columns(*order: int) -> Change:
    """Columns in this order, from 1; a negative number is a changed sign."""
    return lambda _, values: np.column_stack([np.sign(k) * values[:, abs(k) - 1] for k in order])


def rounded(step: float, *columns: int, cuts: bool = False) -> Change:
    def change(_: np.ndarray, values: np.ndarray) -> np.ndarray:
        chosen = list(columns)
        values[:, chosen] = step * (np.floor if cuts else np.rint)(values[:, chosen] / step)
        return values

    return change


def rounded_degrees(_: np.ndarray, values: np.ndarray) -> np.ndarray:
    step = 1e-5 * EARTH_DEG_M * np.array([np.cos(np.radians(LATITUDE_DEG)), 1.0])
    return step * np.rint(values / step)


def zero_below(limit: float) -> Change:
    return lambda _, values: np.where(np.abs(values) < limit, 0.0, values)


def stuck_while_turning(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A heading that keeps its last value while it changes by more than 6 degrees a second."""
    true = np.interp(time_s, *TRUE_HEADING)
    turns = np.abs(np.gradient(true, time_s)) > 0.1
    last = np.maximum.accumulate(np.where(turns, 0, np.arange(len(values))))
    return values[last]


def low_passed(time_constant_s: float) -> Change:
    """A filter of first order, as a slow display has."""

    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        for i in range(1, len(values)):
            share = 1.0 - np.exp(-(time_s[i] - time_s[i - 1]) / time_constant_s)
            values[i] = values[i - 1] + share * (values[i] - values[i - 1])
        return values

    return change


def added(*offset: float, from_share: float = 0.0) -> Change:
    """A constant that is added, from a share of the log on."""

    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        return values + np.array(offset) * (time_s >= from_share * time_s[-1])[:, None]

    return change


def drifting_off(most_m: float, begin: float, end: float) -> Change:
    """East of the truth by half a sine, between two shares of the log."""

    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        phase = np.clip((time_s / time_s[-1] - begin) / (end - begin), 0.0, 1.0)
        values[:, 0] += most_m * np.sin(np.pi * phase)
        return values

    return change


def unchanged(_: np.ndarray, values: np.ndarray) -> np.ndarray:
    return values


def logged_after(delay_s: float, m: Measurements, stamp_ns: np.ndarray) -> Measurements:
    """The source with other stamps; log times are those of the right stamps and a delay."""
    return replace(m, stamp_ns=stamp_ns, log_time_ns=m.stamp_ns + int(delay_s * 1e9))


def stamps_cut_to(step_s: float) -> Rewrite:
    step_ns = int(step_s * 1e9)
    return lambda m: [logged_after(0.05, m, m.stamp_ns // step_ns * step_ns)]


def late_by(delay_s: float) -> Rewrite:
    """Stamps and log times are those of the arrival."""
    return lambda m: [replace(m, stamp_ns=m.stamp_ns + int(delay_s * 1e9))]


def sent_twice(m: Measurements) -> list[Measurements]:
    half_ns = int(np.median(np.diff(m.stamp_ns))) // 2
    twice = m.select_rows(np.repeat(np.arange(len(m)), 2))
    late_ns = np.tile([0, half_ns], len(m))
    log_ns = None if twice.log_time_ns is None else twice.log_time_ns + late_ns
    return [replace(twice, stamp_ns=twice.stamp_ns + late_ns, log_time_ns=log_ns)]


def with_copy(m: Measurements) -> list[Measurements]:
    return [m, replace(m, source=f"{m.source}_copy")]


def exchanged_degrees(_: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Latitude and longitude exchanged at 48 degrees north, 11 degrees east: the map is another one."""
    stretch = np.cos(np.radians(LATITUDE_DEG))
    return np.column_stack([values[:, 1] * np.cos(np.radians(11.0)), values[:, 0] / stretch])


def late_by_a_ramp(most_s: float, every_s: float) -> Rewrite:
    """Stamps that fall behind, and catch up at once; none is before the one of the row before."""

    def rewrite(m: Measurements) -> list[Measurements]:
        late_s = ((m.stamp_ns - m.stamp_ns[0]) / 1e9) % every_s / every_s * most_s
        return [replace(m, stamp_ns=np.maximum.accumulate(m.stamp_ns + (late_s * 1e9).astype(np.int64)))]

    return rewrite


def held_below(limit_mps: float) -> Change:
    """The last value of a faster drive, as where a receiver holds its fix still."""

    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        slow = np.interp(time_s, *STANDING_SPEED) < limit_mps
        return values[np.maximum.accumulate(np.where(slow, 0, np.arange(len(values))))]

    return change


def partly(change: Change, begin: float, end: float = 1.0) -> Change:
    """A change between two shares of the log alone."""

    def partly_changed(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        wrong = (time_s >= begin * time_s[-1]) & (time_s <= end * time_s[-1])
        return np.where(wrong[:, None], change(time_s, values.copy()), values)

    return partly_changed


def slipping(factor: float) -> Change:
    """A speed of wheels that slip while the car turns."""

    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        return np.where(np.abs(turn_rate_radps(time_s))[:, None] > 0.05, factor * values, values)

    return change


def lagging(delay_s: float) -> Change:
    """Values of some time ago under right stamps; headings need `unwrapped`."""
    return lambda time_s, values: np.column_stack([np.interp(time_s - delay_s, time_s, column) for column in values.T])


def unwrapped(change: Change) -> Change:
    """A change of angles without their jumps by a whole turn."""
    return lambda time_s, values: change(time_s, np.unwrap(values, axis=0))


def noisy(sigma: float, *columns: int, share: float = 1.0) -> Change:
    """White noise on some columns of a share of the rows."""

    def change(_: np.ndarray, values: np.ndarray) -> np.ndarray:
        rng = np.random.default_rng(2)
        hit = rng.random(len(values)) < share
        for k in columns:
            values[:, k] += sigma * hit * rng.standard_normal(len(values))
        return values

    return change


def stepping_east(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Reflections: three pieces of the log lie 8, -15 and 10 m east of the truth."""
    share = time_s / time_s[-1]
    for begin, end, east_m in ((0.2, 0.3, 8.0), (0.5, 0.62, -15.0), (0.8, 0.85, 10.0)):
        values[(share > begin) & (share < end), 0] += east_m
    return values


def wavy_accel(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    values[:, 0] += 2.0 * np.sin(2.0 * np.pi * time_s / 60.0)
    return values


def altitude_for_latitude(_: np.ndarray, values: np.ndarray) -> np.ndarray:
    values[:, 1] = 0.03 * np.random.default_rng(1).standard_normal(len(values)).cumsum()
    return values


def interpolated_from_1_hz(m: Measurements) -> list[Measurements]:
    known = np.arange(0, len(m), max(1, round(1e9 / float(np.median(np.diff(m.stamp_ns))))))
    columns = [np.interp(m.stamp_ns, m.stamp_ns[known], column) for column in m.values[known].T]
    return [replace(m, values=np.column_stack(columns))]


def late_from_middle(delay_s: float) -> Rewrite:
    def rewrite(m: Measurements) -> list[Measurements]:
        late = m.stamp_ns > (m.stamp_ns[0] + m.stamp_ns[-1]) // 2
        return [replace(m, stamp_ns=m.stamp_ns + np.where(late, int(delay_s * 1e9), 0))]

    return rewrite


def clock_ahead(offset_s: float) -> Rewrite:
    return lambda m: [logged_after(0.02, m, m.stamp_ns + int(offset_s * 1e9))]


def clock_drifts(rate: float) -> Rewrite:
    return lambda m: [replace(m, stamp_ns=m.stamp_ns + ((m.stamp_ns - m.stamp_ns[0]) * rate).astype(np.int64))]


def all_times_cut_to_1_s(m: Measurements) -> list[Measurements]:
    return [replace(m, stamp_ns=m.stamp_ns // 10**9 * 10**9)]


def mixed_in_eights(m: Measurements) -> list[Measurements]:
    rng = np.random.default_rng(6)
    order = np.arange(len(m))
    for begin in range(0, len(m) - 8, 8):
        order[begin : begin + 8] = begin + rng.permutation(8)
    return [replace(m, values=m.values[order])]


def at_least(limit: float) -> Change:
    return lambda _, values: np.maximum(values, limit)


def growing_scale(most: float) -> Change:
    """A scale that grows evenly from 1 to this, as tyres that lose pressure or are changed."""
    return lambda time_s, values: values * (1.0 + (most - 1.0) * time_s / time_s[-1])[:, None]


def held_for(step_s: float) -> Change:
    """Values that are measured once in a while and repeated in between."""

    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        return values[np.searchsorted(time_s, np.floor(time_s / step_s) * step_s)]

    return change


def only(change: Change, *columns: int) -> Change:
    """A change of some columns alone."""

    def changed(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        values[:, list(columns)] = change(time_s, values[:, list(columns)])
        return values

    return changed


def with_iron(once_deg: float, twice_deg: float) -> Change:
    """A magnetic compass beside iron: deviations that go once and twice round with the heading."""
    return lambda _, values: (
        values + np.radians(once_deg) * np.sin(values) + np.radians(twice_deg) * np.sin(2.0 * values)
    )


def course_at_random_below(limit_mps: float) -> Change:
    """A course over ground as heading, which has no meaning where the car hardly moves."""

    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        slow = np.interp(time_s, *STANDING_SPEED) < limit_mps
        return np.where(slow[:, None], np.random.default_rng(3).uniform(-np.pi, np.pi, values.shape), values)

    return change


def of_two_antennas(ahead_m: float) -> Change:
    """Every other fix is one of a second antenna."""

    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        other = np.arange(len(values))[:, None] % 2 == 1
        return np.where(other, ahead_of_car(ahead_m)(time_s, values.copy()), values)

    return change


def snapped_to_road(step_s: float) -> Change:
    """Fixes moved to the nearest point of a coarse map: chords between places of the way some seconds apart."""

    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        knots_s = np.append(np.arange(time_s[0], time_s[-1], step_s), time_s[-1])
        knots = np.column_stack([np.interp(knots_s, time_s, column) for column in values.T])
        piece = np.clip(np.searchsorted(knots_s, time_s, side="right") - 1, 0, len(knots) - 2)
        along = knots[piece + 1] - knots[piece]
        share = np.einsum("ni,ni->n", values - knots[piece], along) / np.maximum((along**2).sum(axis=1), 1e-9)
        return knots[piece] + np.clip(share, 0.0, 1.0)[:, None] * along

    return change


def guessed_between(begin: float, end: float) -> Change:
    """A receiver that goes on straight at its last speed between two shares of the log, as in a tunnel."""

    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        rows = np.flatnonzero((time_s >= begin * time_s[-1]) & (time_s <= end * time_s[-1]))
        first = rows[0]
        before = np.searchsorted(time_s, time_s[first] - 1.0)
        velocity = (values[first] - values[before]) / max(time_s[first] - time_s[before], 1e-3)
        values[rows] = values[first] + velocity * (time_s[rows] - time_s[first])[:, None]
        return values

    return change


def lost_rows(share: float) -> Change:
    """Zeros instead of some of the values."""
    return lambda _, values: np.where(np.random.default_rng(4).random(len(values))[:, None] < share, 0.0, values)


def with_late_copy(delay_s: float) -> Rewrite:
    return lambda m: [m, replace(m, source=f"{m.source}_copy", stamp_ns=m.stamp_ns + int(delay_s * 1e9))]


def with_pairs_exchanged(m: Measurements) -> list[Measurements]:
    order = np.arange(len(m) // 2 * 2).reshape(-1, 2)[:, ::-1].ravel()
    return [replace(m, values=np.concatenate([m.values[order], m.values[len(order) :]]))]


def stamped_late_by_up_to(most_s: float) -> Rewrite:
    def rewrite(m: Measurements) -> list[Measurements]:
        delay_ns = (1e9 * most_s * np.random.default_rng(5).random(len(m))).astype(np.int64)
        return [replace(m, stamp_ns=np.maximum.accumulate(m.stamp_ns + delay_ns))]

    return rewrite


def averaged_across_wrap(n: int) -> Change:
    """The mean of the last rows, of angles from -pi to pi: wrong where they wrap."""

    def change(_: np.ndarray, values: np.ndarray) -> np.ndarray:
        wrapped = (values + np.pi) % (2 * np.pi) - np.pi
        mean = np.convolve(wrapped[:, 0], np.ones(n) / n)[: len(values), None]
        return np.where(np.arange(len(values))[:, None] < n, wrapped, mean)

    return change


def east_alone(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A driver that takes the east part of a velocity for the speed."""
    return np.abs(values * np.cos(np.interp(time_s, *TRUE_HEADING))[:, None])


def slipping_while_faster(factor: float) -> Change:
    """A speed of driven wheels, which slip while the car accelerates."""

    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        accel = np.gradient(np.interp(time_s, *STANDING_SPEED), time_s)
        return np.where(accel[:, None] > 0.4, factor * values, values)

    return change


def spiky(share: float, height: float, column: int) -> Change:
    """Spikes of both signs in a share of the rows, as where an angle that wraps is differentiated."""

    def change(_: np.ndarray, values: np.ndarray) -> np.ndarray:
        hit = np.random.default_rng(8).random(len(values)) < share
        values[hit, column] += height * np.random.default_rng(7).choice([-1.0, 1.0], int(hit.sum()))
        return values

    return change


def stamped_in_batches(n: int) -> Rewrite:
    """All rows of a batch have the stamp of its last one."""

    def rewrite(m: Measurements) -> list[Measurements]:
        last = np.minimum(np.arange(len(m)) // n * n + n - 1, len(m) - 1)
        return [replace(m, stamp_ns=m.stamp_ns[last])]

    return rewrite


def of_two_receivers(east_m: float, north_m: float, late_s: float) -> Change:
    """Every other fix is one of a second receiver, which is late and has another datum."""

    def change(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        is_other = np.arange(len(values))[:, None] % 2 == 1
        late = np.column_stack([np.interp(time_s - late_s, time_s, column) for column in values.T])
        return np.where(is_other, late + (east_m, north_m), values)

    return change


def clock_steps_back(step_s: float) -> Rewrite:
    """A clock that repeats a second in the middle of the log, as at a leap second."""

    def rewrite(m: Measurements) -> list[Measurements]:
        is_behind = m.stamp_ns > (m.stamp_ns[0] + m.stamp_ns[-1]) // 2
        return [logged_after(0.02, m, m.stamp_ns - np.where(is_behind, int(step_s * 1e9), 0))]

    return rewrite


def with_new_datum_after_pause(east_m: float, north_m: float) -> Rewrite:
    """A receiver that is silent for 15 % of the log, and then has another datum."""

    def rewrite(m: Measurements) -> list[Measurements]:
        share = (m.stamp_ns - m.stamp_ns[0]) / (m.stamp_ns[-1] - m.stamp_ns[0])
        moved = replace(m, values=m.values + (share > 0.6)[:, None] * np.array([east_m, north_m]))
        return [moved.select_rows((share < 0.45) | (share > 0.6))]

    return rewrite


def in_gears(limit: float, factor: float) -> Change:
    """A speed by the engine's, with the ratio of another gear above a limit."""
    return lambda _, values: np.where(np.abs(values) > limit, factor * values, values)


def of_outer_wheel(half_track_m: float) -> Change:
    """The speed of a wheel to the right of the middle."""
    return lambda time_s, values: values + half_track_m * turn_rate_radps(time_s)[:, None]


def turn_rate_radps(time_s: np.ndarray) -> np.ndarray:
    turn_s, heading = TRUE_HEADING
    return np.interp(time_s, turn_s, np.gradient(np.unwrap(heading), turn_s))


def angle_for_rate(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The yaw in place of the yaw rate."""
    values[:, 5] = np.interp(time_s, *TRUE_HEADING)
    return values


def altitude_for_speed(_: np.ndarray, values: np.ndarray) -> np.ndarray:
    return 112.0 + 0.05 * np.random.default_rng(9).standard_normal(values.shape).cumsum(axis=0)


def not_a_number_in_bursts(share: float, n: int) -> Change:
    """Bursts of n rows without a number."""

    def change(_: np.ndarray, values: np.ndarray) -> np.ndarray:
        begins = np.flatnonzero(np.random.default_rng(10).random(len(values)) < share / n)
        for begin in begins.tolist():
            values[begin : begin + n] = np.nan
        return values

    return change


def with_velocity(change: Change) -> Rewrite:
    """The receiver also sends a velocity, which is wrong."""

    def rewrite(m: Measurements) -> list[Measurements]:
        time_s = (m.stamp_ns - m.stamp_ns[0]) / 1e9
        speed, heading = np.interp(time_s, *STANDING_SPEED), np.interp(time_s, *TRUE_HEADING)
        right = speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        right += 0.1 * np.random.default_rng(11).standard_normal(right.shape)
        return [m, Measurements("velocity of gnss", Kind.VELOCITY, m.stamp_ns, change(time_s, right))]

    return rewrite


FAULTS = (
    Fault("speed in km/h", Kind.SPEED, scaled(3.6), ("km/h",)),
    Fault("speed / 3.6", Kind.SPEED, scaled(1 / 3.6), ("divided by 3.6",)),
    Fault("speed in mph", Kind.SPEED, scaled(2.23694), ("miles/h",)),
    Fault("speed in knots", Kind.SPEED, scaled(1.94384), ("knots",), True),
    Fault("speed in ft/s", Kind.SPEED, scaled(3.28084), ("feet/s",)),
    Fault("speed in cm/s", Kind.SPEED, scaled(100.0), ("cm/s",), True),
    Fault("speed sign", Kind.SPEED, scaled(-1.0), ("wrong sign", "sign is wrong")),
    Fault("speed km/h and sign", Kind.SPEED, scaled(-3.6), ("km/h",), True),
    Fault("speed always 0", Kind.SPEED, scaled(0.0), ("covered 0.0", "ego_speed")),
    Fault("speed stuck 40 s", Kind.SPEED, stuck(130.0, 170.0), ("stuck",)),
    Fault("speed 0 for 20 s", Kind.SPEED, zero_between(100.0, 120.0), ("reads 0", "stuck")),
    Fault("speed clipped at 8", Kind.SPEED, clipped(8.0, 0), ("stuck", "saturat"), True),
    Fault("speed x 1.5", Kind.SPEED, scaled(1.5), ("ego_speed",)),
    Fault("gyro sign", Kind.IMU, imu(gyro=-1.0), ("gyroscope with the wrong sign",)),
    Fault("gyro in deg/s", Kind.IMU, imu(gyro=180 / np.pi), ("degrees/s",)),
    Fault("gyro in mrad/s", Kind.IMU, imu(gyro=1e3), ("milliradians/s",), True),
    Fault("gyro deg/s and sign", Kind.IMU, imu(gyro=-180 / np.pi), ("degrees/s",), True),
    Fault("gyro halved", Kind.IMU, imu(gyro=0.5), ("yaw rate",)),
    Fault("gyro always 0", Kind.IMU, imu(gyro=0.0), ("does not turn", "yaw rate")),
    Fault("gyro clipped at 0.1", Kind.IMU, clipped(0.1, 3, 4, 5), ("saturat", "yaw rate"), True),
    Fault("gyro stuck 20 s", Kind.IMU, stuck(110.0, 130.0), ("stuck",)),
    Fault("accel in g", Kind.IMU, imu(accel=1 / G), (" in g",)),
    Fault("accel in mg", Kind.IMU, imu(accel=1e3 / G), (" in mg",), True),
    Fault("accel sign", Kind.IMU, imu(accel=-1.0), ("accelerometer with the wrong sign",)),
    Fault("IMU x up", Kind.IMU, turned((0, 0, 1), (0, 1, 0), (-1, 0, 0)), ("mounted with -z forward",)),
    Fault("IMU x down", Kind.IMU, turned((0, 0, -1), (0, 1, 0), (1, 0, 0)), ("mounted with z forward",)),
    Fault("IMU y up", Kind.IMU, turned((1, 0, 0), (0, 0, 1), (0, -1, 0)), ("-z left and y up",)),
    Fault("IMU y down", Kind.IMU, turned((1, 0, 0), (0, 0, -1), (0, 1, 0)), ("z left and -y up",), True),
    Fault("IMU backward", Kind.IMU, turned((-1, 0, 0), (0, -1, 0), (0, 0, 1)), ("-x forward",)),
    Fault("IMU x left", Kind.IMU, turned((0, 1, 0), (-1, 0, 0), (0, 0, 1)), ("-y forward",)),
    Fault("IMU x right", Kind.IMU, turned((0, -1, 0), (1, 0, 0), (0, 0, 1)), ("y forward",), True),
    Fault("IMU upside down", Kind.IMU, turned((1, 0, 0), (0, -1, 0), (0, 0, -1)), ("-y left and -z up",)),
    Fault("IMU upside down, backward", Kind.IMU, turned((-1, 0, 0), (0, 1, 0), (0, 0, -1)), ("-z up",), True),
    Fault("IMU x down, backward", Kind.IMU, turned((0, 0, -1), (0, -1, 0), (-1, 0, 0)), ("-x up",)),
    Fault("IMU pitched 30 deg", Kind.IMU, turned(*rotation(1, 30.0)), ("mounted",)),
    Fault("IMU yawed 40 deg", Kind.IMU, turned(*rotation(2, 40.0)), ("mounted", "accel"), True),
    Fault("IMU g and deg/s", Kind.IMU, imu(1 / G, 180 / np.pi), ("degrees/s",)),
    Fault("heading clockwise from north", Kind.HEADING, affine(-1, 90), ("clockwise from north",)),
    Fault("heading clockwise from east", Kind.HEADING, affine(-1, 0), ("clockwise from east",)),
    Fault("heading from north", Kind.HEADING, affine(1, -90), ("from north",)),
    Fault("heading + 90 deg", Kind.HEADING, affine(1, 90), ("from south",)),
    Fault("heading + 180 deg", Kind.HEADING, affine(1, 180), ("backward",)),
    Fault("heading clockwise from south", Kind.HEADING, affine(-1, -90), ("clockwise from south",), True),
    Fault("heading in degrees", Kind.HEADING, scaled(180 / np.pi), ("in degrees",)),
    Fault("heading always 0", Kind.HEADING, scaled(0.0), ("ego_heading",)),
    Fault("heading flipped at standstill", Kind.HEADING, flipped_at_standstill, ("while the car stands",)),
    Fault("heading 0 at standstill", Kind.HEADING, zero_at_standstill, ("while the car stands", "stuck"), True),
    Fault("heading + 45 deg", Kind.HEADING, affine(1, 45), ("45 degrees",)),
    Fault("heading stuck 30 s", Kind.HEADING, stuck(100.0, 130.0), ("stuck",)),
    Fault("fix north before east", Kind.POSITION, columns(2, 1), ("north before east", "ego_position")),
    Fault("fix mirrored east", Kind.POSITION, columns(-1, 2), ("wrong sign", "ego_position"), True),
    Fault("fix latitude, longitude exchanged", Kind.POSITION, exchanged_degrees, ("exchanged", "ego_position")),
    Fault("speed 0 below 1 m/s", Kind.SPEED, zero_below(1.0)),
    Fault("speed 1 s late", Kind.SPEED, unchanged, ("ego_speed",), rewrite=late_by(1.0)),
    Fault("speed smoothed over 2 s", Kind.SPEED, low_passed(2.0), ("ego_speed",)),
    Fault("speed + 2 m/s", Kind.SPEED, added(2.0), ("ego_speed",)),
    Fault("speed doubled in mid-log", Kind.SPEED, lambda t, v: np.where(t[:, None] > 0.5 * t[-1], 2.0 * v, v), ("ego_speed",)),
    Fault("heading stuck in bends", Kind.HEADING, stuck_while_turning, ("ego_heading", "stuck")),
    Fault("heading in sectors of 22.5 deg", Kind.HEADING, rounded(np.radians(22.5), 0), ("ego_heading", "rounded")),
    Fault("IMU of another drive", Kind.IMU, lambda _, v: np.roll(v, len(v) // 2, axis=0), ("yaw rate", "accel")),
    Fault("IMU with x and y exchanged", Kind.IMU, columns(2, 1, 3, 5, 4, 6), ("mounted", "accel")),
    Fault("IMU in counts", Kind.IMU, imu(16384 / G, 131 * 180 / np.pi), ("counts",)),
    Fault("gyro bias steps in mid-log", Kind.IMU, added(0, 0, 0, 0, 0, 0.05, from_share=0.5), ("yaw rate", "bias")),
    Fault("IMU 2 s late", Kind.IMU, unchanged, ("imu",), rewrite=late_by(2.0)),
    Fault("fix of an antenna 3 m ahead", Kind.POSITION, ahead_of_car(3.0), ("antenna",), ahead_m=3.0),
    Fault("fix rounded to 1 m", Kind.POSITION, rounded(1.0, 0, 1), ("round",)),
    Fault("fix rounded to 1e-5 deg", Kind.POSITION, rounded_degrees, ("round",)),
    Fault("fix longitude cut to 4 decimals", Kind.POSITION, rounded(7.45, 0, cuts=True), ("round",)),
    Fault("fix in metres taken as degrees", Kind.POSITION, scaled(EARTH_DEG_M), ("ego_position",)),
    Fault("fix sent twice", Kind.POSITION, unchanged, ("repeat",), rewrite=sent_twice),
    Fault("fix with a copy", Kind.POSITION, unchanged, ("copy",), rewrite=with_copy),
    Fault("fix stamps cut to 1 s", Kind.POSITION, unchanged, ("stamps",), rewrite=stamps_cut_to(1.0)),
    Fault("fix stuck 10 s", Kind.POSITION, stuck(15.0, 25.0), ("stuck",)),
    Fault("fix drifts off by 15 m", Kind.POSITION, drifting_off(15.0, 0.3, 0.7), ("ego_position",), is_drift=True),
    Fault("fix smoothed over 2 s", Kind.POSITION, low_passed(2.0), ("latency",)),
)  # fmt: skip
"""The faults for which the detection was built; numbers and axes by hand. Words are what the sentence on the right fault
must contain."""

LATER_FAULTS = (
    Fault("heading 1 s late", Kind.HEADING, unchanged, ("ego_heading",), rewrite=late_by(1.0)),
    Fault("heading + 7 deg", Kind.HEADING, affine(1, 7), ("ego_heading",)),
    Fault("heading drifts by 0.1 deg/s", Kind.HEADING, lambda t, v: v + np.radians(0.1) * t[:, None], ("ego_heading",)),
    Fault("heading clockwise from mid-log", Kind.HEADING, partly(affine(-1, 90), 0.5), ("ego_heading",)),
    Fault("heading clock + 1 h", Kind.HEADING, unchanged, ("clock",), rewrite=clock_ahead(3600.0)),
    Fault("speed slips by 5 % in bends", Kind.SPEED, slipping(1.05), ("ego_speed",)),
    Fault("speed in km/h from 70 %", Kind.SPEED, partly(scaled(3.6), 0.7), ("ego_speed",)),
    Fault("speed x 0.7 in the first third", Kind.SPEED, partly(scaled(0.7), 0.0, 0.33), ("ego_speed",)),
    Fault("speed x 1.15", Kind.SPEED, scaled(1.15), ("ego_speed",)),
    Fault("speed cut to 1 m/s", Kind.SPEED, rounded(1.0, 0, cuts=True), ("ego_speed", "rounded")),
    Fault("speed rounded to 5 km/h", Kind.SPEED, rounded(5 / 3.6, 0), ("ego_speed", "rounded")),
    Fault("speed smoothed over 5 s", Kind.SPEED, low_passed(5.0), ("ego_speed",)),
    Fault("speed 0.7 s late from mid-log", Kind.SPEED, partly(lagging(0.7), 0.5), ("ego_speed",)),
    Fault("gyro in deg/s from mid-log", Kind.IMU, partly(imu(gyro=180 / np.pi), 0.5), ("yaw rate", "degrees/s")),
    Fault("gyro sign from mid-log", Kind.IMU, partly(imu(gyro=-1.0), 0.5), ("yaw rate", "gyroscope")),
    Fault("gyro x 0.8", Kind.IMU, imu(gyro=0.8), ("yaw rate",)),
    Fault("gyro of 0.3 rad/s noise", Kind.IMU, noisy(0.3, 3, 4, 5), ("yaw rate",)),
    Fault("accel x 1.5", Kind.IMU, imu(accel=1.5), ("accel",)),
    Fault("accel bias comes and goes", Kind.IMU, wavy_accel, ("accel", "imu (imu)")),
    Fault("IMU yawed 10 deg", Kind.IMU, turned(*rotation(2, 10.0)), ("mounted",)),
    Fault("IMU clock drifts by 0.2 %", Kind.IMU, unchanged, ("imu", "clock"), rewrite=clock_drifts(2e-3)),
    Fault("IMU 1 s late from mid-log", Kind.IMU, unchanged, ("imu",), rewrite=late_from_middle(1.0)),
    Fault("IMU mixed in eights", Kind.IMU, unchanged, ("imu",), rewrite=mixed_in_eights),
    Fault("fix altitude for latitude", Kind.POSITION, altitude_for_latitude, ("ego_position",)),
    Fault("fix x 1.1", Kind.POSITION, scaled(1.1), ("ego_position", "gnss is wrong"), is_drift=True),
    Fault("fix east x 1.5", Kind.POSITION, lambda _, v: v * np.array([1.5, 1.0]), ("ego_position",)),
    Fault("fix interpolated from 1 Hz", Kind.POSITION, unchanged, ("interpolated",), rewrite=interpolated_from_1_hz),
    Fault("fix times cut to 1 s", Kind.POSITION, unchanged, ("stamps",), rewrite=all_times_cut_to_1_s),
    Fault("fix clock drifts by 0.2 %", Kind.POSITION, unchanged, ("latency", "clock"), rewrite=clock_drifts(2e-3)),
    Fault("fix 1.5 s late from mid-log", Kind.POSITION, unchanged, ("ego_position",), rewrite=late_from_middle(1.5)),
    Fault("fix steps by reflections", Kind.POSITION, stepping_east, ("ego_position",)),
    Fault("fix with 10 % outliers", Kind.POSITION, noisy(30.0, 0, 1, share=0.1), ("ego_position",)),
)  # fmt: skip
"""Faults that were thought of when the detection stood. In short drives some of them show nowhere: a heading that drifts,
a sensor that is late from mid-log, a clock that drifts, a map of another scale."""

ROAD_FAULTS = (
    Fault("heading of the course, any below 2 m/s", Kind.HEADING, course_at_random_below(2.0), ("ego_heading",)),
    Fault("heading beside iron", Kind.HEADING, with_iron(20.0, 12.0), ("ego_heading",)),
    Fault("heading of an axis, half a turn", Kind.HEADING, lambda _, v: v % np.pi, ("ego_heading",)),
    Fault("heading smoothed over 3 s", Kind.HEADING, unwrapped(low_passed(3.0)), ("ego_heading",)),
    Fault("heading measured once in 5 s, repeated", Kind.HEADING, held_for(5.0), ("ego_heading", "repeat")),
    Fault("speed never below 5 km/h", Kind.SPEED, at_least(5 / 3.6), ("ego_speed",)),
    Fault("speed scale grows to 1.12", Kind.SPEED, growing_scale(1.12), ("ego_speed",)),
    Fault("speed rounded to 1 km/h", Kind.SPEED, rounded(1 / 3.6, 0)),
    Fault("speed measured once in 2 s, repeated", Kind.SPEED, held_for(2.0), ("ego_speed", "repeat")),
    Fault("speed of wheels that block, 3 % zeros", Kind.SPEED, lost_rows(0.03), ("ego_speed",)),
    Fault("speed wraps at 8 m/s", Kind.SPEED, lambda _, v: v % 8.0, ("ego_speed",)),
    Fault("speed in 0.1 km/h", Kind.SPEED, scaled(36.0), ("ego_speed",)),
    Fault("speed clock - 2 h", Kind.SPEED, unchanged, ("clock",), rewrite=clock_ahead(-7200.0)),
    Fault("speed with a late copy", Kind.SPEED, unchanged, ("copy", "ego_speed"), rewrite=with_late_copy(0.6)),
    Fault("gyro smoothed over 1 s", Kind.IMU, only(low_passed(1.0), 3, 4, 5), ("yaw rate", "imu (imu)")),
    Fault("gyro bias grows to 0.06 rad/s", Kind.IMU, lambda t, v: v + np.outer(t / t[-1], [0, 0, 0, 0, 0, 0.06]), ("yaw rate",)),
    Fault("gyro x for z", Kind.IMU, columns(1, 2, 3, 6, 5, 4), ("yaw rate", "mounted")),
    Fault("gyro in turns/s", Kind.IMU, imu(gyro=1 / (2 * np.pi)), ("yaw rate",)),
    Fault("accel z down, gyro z up", Kind.IMU, columns(1, -2, -3, 4, 5, 6), ("imu", "accel", "gravity")),
    Fault("accel without gravity", Kind.IMU, added(0, 0, -G, 0, 0, 0)),
    Fault("accel clipped at 1 m/s^2", Kind.IMU, clipped(1.0, 0), ("accel", "satur")),
    Fault("IMU of a vendor: x back, z down", Kind.IMU, columns(-1, 2, -3, -4, 5, -6), ("mounted",)),
    Fault("IMU of a vendor, g and deg/s", Kind.IMU, imu(np.diag([-1 / G, 1 / G, -1 / G]), np.diag([-57.29578, 57.29578, -57.29578])), ("in g", "mounted")),
    Fault("fix of two antennas in turns", Kind.POSITION, of_two_antennas(3.0), ("ego_position", "antenna", "gnss"), ahead_m=1.5),
    Fault("fix snapped to a coarse road", Kind.POSITION, snapped_to_road(6.0), ("ego_position",)),
    Fault("fix without its minus for a while", Kind.POSITION, partly(columns(-1, 2), 0.55, 0.7), ("ego_position",)),
    Fault("fix guessed in a tunnel", Kind.POSITION, guessed_between(0.4, 0.48), ("ego_position", "used again after repeated rejections")),
    Fault("fix in feet", Kind.POSITION, scaled(3.28084), ("ego_position", "gnss is wrong"), is_drift=True),
    Fault("fix turned by 8 deg", Kind.POSITION, lambda _, v: v @ rotation(2, 8.0)[:2, :2].T, ("ego_position", "ego_heading"), is_drift=True),
    Fault("fix zero in 3 % of rows", Kind.POSITION, lost_rows(0.03), ("ego_position",)),
    Fault("fix rows exchanged in pairs", Kind.POSITION, unchanged, ("stamps", "latency"), rewrite=with_pairs_exchanged),
    Fault("fix late by up to 0.5 s", Kind.POSITION, unchanged, ("stamps", "latency"), rewrite=stamped_late_by_up_to(0.5)),
    Fault("fix with a late copy", Kind.POSITION, unchanged, ("copy",), rewrite=with_late_copy(0.4)),
    Fault("fix clock - 1 h", Kind.POSITION, unchanged, ("clock",), rewrite=clock_ahead(-3600.0)),
)  # fmt: skip
"""Faults of cars on the road and of their drivers' software, thought of by a tester who did not build the detection. An
IMU whose gravity was removed, and a speed in steps of 1 km/h, are no faults and may not do harm."""

SOFTWARE_FAULTS = (
    Fault("heading filtered over 1 s", Kind.HEADING, unwrapped(low_passed(1.0)), ("ego_heading",)),
    Fault("heading averaged across its wrap", Kind.HEADING, averaged_across_wrap(5), ("ego_heading",)),
    Fault("speed of the east alone", Kind.SPEED, east_alone, ("ego_speed",)),
    Fault("speed slips by 8 % while it grows", Kind.SPEED, slipping_while_faster(1.08), ("ego_speed",)),
    Fault("gyro in deg/s, clipped at 10", Kind.IMU, only(lambda _, v: np.clip(180 / np.pi * v, -10.0, 10.0), 3, 4, 5), ("satur", "degrees/s")),
    Fault("gyro with 1 % spikes", Kind.IMU, spiky(0.01, 60.0, 5), ("yaw rate",)),
    Fault("accel without its slow part", Kind.IMU, only(lambda t, v: v - low_passed(5.0)(t, v.copy()), 0), ("accel",)),
    Fault("IMU turned by a restart", Kind.IMU, partly(turned((0, 1, 0), (-1, 0, 0), (0, 0, 1)), 0.5), ("imu", "accel")),
    Fault("IMU upside down after a restart", Kind.IMU, partly(turned((1, 0, 0), (0, -1, 0), (0, 0, -1)), 0.5), ("imu", "accel", "yaw rate")),
    Fault("IMU stamps in batches of ten", Kind.IMU, unchanged, ("imu", "stamps"), rewrite=stamped_in_batches(10)),
    Fault("fix rounded to 1e-4 deg", Kind.POSITION, lambda _, v: np.rint(v / (7.45, 11.13)) * (7.45, 11.13), ("round",)),
    Fault("fix of two receivers in turns", Kind.POSITION, of_two_receivers(3.0, -2.0, 0.2), ("ego_position",)),
    Fault("fix clock - 1 s from mid-log", Kind.POSITION, unchanged, ("clock",), rewrite=clock_steps_back(1.0)),
    Fault("fix of another datum after a pause", Kind.POSITION, unchanged, ("ego_position",), rewrite=with_new_datum_after_pause(6.0, -4.0), is_drift=True),
)  # fmt: skip
"""Faults of drivers and recorders, thought of when all others were found. The datum is a drift: with an IMU alone, no
source shows it. The speed of the east shows nothing on a straight road. A sensor that ends early is a doubt of the whole
log (`cwcli.evaluation.doubts.silences`)."""

VEHICLE_FAULTS = (
    Fault("heading + 12 deg from mid-log", Kind.HEADING, partly(affine(1, 12), 0.5), ("ego_heading",)),
    Fault("heading + 45 deg from mid-log", Kind.HEADING, partly(affine(1, 45), 0.5), ("ego_heading",)),
    Fault("heading of random walk", Kind.HEADING, lambda _, v: v + np.radians(0.5) * np.random.default_rng(12).standard_normal(v.shape).cumsum(axis=0), ("ego_heading",)),
    Fault("speed of another gear above 8 m/s", Kind.SPEED, in_gears(8.0, 1.1), ("ego_speed",)),
    Fault("speed of the outer wheel", Kind.SPEED, of_outer_wheel(0.8), ("ego_speed",)),
    Fault("speed 0 below 5 km/h", Kind.SPEED, zero_below(5 / 3.6)),
    Fault("speed of the altitude", Kind.SPEED, altitude_for_speed, ("ego_speed",)),
    Fault("speed not a number in bursts", Kind.SPEED, not_a_number_in_bursts(0.2, 30)),
    Fault("speed in mph between two restarts", Kind.SPEED, partly(scaled(2.23694), 0.35, 0.65), ("miles/h",)),
    Fault("gyro of angles", Kind.IMU, angle_for_rate, ("yaw rate",)),
    Fault("gyro angle per sample", Kind.IMU, imu(gyro=0.01), ("yaw rate",)),
    Fault("accel in g until mid-log", Kind.IMU, partly(imu(accel=1 / G), 0.0, 0.5), (" in g", "accel")),
    Fault("accel smoothed over 2 s", Kind.IMU, only(low_passed(2.0), 0, 1, 2), ("accel", "imu (imu)")),
    Fault("IMU not a number in bursts", Kind.IMU, not_a_number_in_bursts(0.2, 50)),
    Fault("IMU rows twice", Kind.IMU, unchanged, ("imu", "repeat"), rewrite=sent_twice),
    Fault("IMU fallen on its side", Kind.IMU, partly(turned((1, 0, 0), (0, 0, 1), (0, -1, 0)), 0.6), ("imu",)),
    Fault("fix in degrees and minutes", Kind.POSITION, scaled(0.6), ("ego_position", "gnss is wrong"), is_drift=True),
    Fault("fix of another zone from mid-log", Kind.POSITION, added(3e5, -2e3, from_share=0.5), ("ego_position",)),
    Fault("fix clock - 1024 weeks", Kind.POSITION, unchanged, ("clock",), rewrite=clock_ahead(-1024 * 7 * 86400.0)),
    Fault("velocity north before east", Kind.POSITION, unchanged, ("north before east",), rewrite=with_velocity(columns(2, 1))),
    Fault("velocity to the west", Kind.POSITION, unchanged, ("ego_velocity",), rewrite=with_velocity(columns(-1, 2))),
    Fault("velocity in km/h", Kind.POSITION, unchanged, ("km/h",), rewrite=with_velocity(scaled(3.6))),
    Fault("velocity 1 s late", Kind.POSITION, unchanged, ("latency", "ego_velocity"), rewrite=with_velocity(lagging(1.0))),
)  # fmt: skip
"""Faults of a vehicle's wiring and restarts, thought of when a fault in a part of the log was judged by itself. What is
not a number, or rounded to 0 by less than 5 km/h, is no lie and may not do harm."""

RECEIVER_FAULTS = (
    Fault("speed 255 km/h in 2 % of rows", Kind.SPEED, lambda _, v: np.where(np.random.default_rng(13).random(v.shape) < 0.02, 255 / 3.6, v), ("ego_speed",)),
    Fault("gyro warms up by 0.04 rad/s", Kind.IMU, lambda t, v: v + np.outer(1.0 - np.exp(-t / 60.0), [0, 0, 0, 0, 0, 0.04]), ("yaw rate",)),
    Fault("fix in Web Mercator", Kind.POSITION, scaled(1.4945), ("ego_position", "gnss is wrong"), is_drift=True),
    Fault("fix north in degrees and minutes", Kind.POSITION, lambda _, v: v * np.array([1.0, 0.6]), ("ego_position",)),
    Fault("fix held below 2 m/s", Kind.POSITION, held_below(2.0), ("ego_position (gnss) contradicts", "stuck")),
    Fault("fix 1 s early", Kind.POSITION, unchanged, ("latency", "ego_position"), rewrite=late_by(-1.0)),
    Fault("fix late by 0 to 2 s, in ramps", Kind.POSITION, unchanged, ("stamps", "latency"), rewrite=late_by_a_ramp(2.0, 20.0)),
    Fault("fix north 1 s older than east", Kind.POSITION, only(lagging(1.0), 1), ("ego_position (gnss) contradicts",)),
)  # fmt: skip
"""Faults of receivers and of what takes their place, thought of last. Fixes held while slow, late by ramps, and of two
ages are said to wander at best."""
