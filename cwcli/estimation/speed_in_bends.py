"""Find a speed that reads more or less in bends than on straight roads, by the accelerometer of an IMU.

Wheels slip in bends. At the entrance of one such a speed changes by b v more than the acceleration explains, and at its
exit by b v less. An accelerometer errs in bends, too, but otherwise: by a lever arm, and by a yaw of its mounting. So
the changes of speed beyond those of the accelerometer are regressed on all of these, and on the change of v in bends.
Steered front wheels drive farther than the rear axle in tight bends: what any wheelbase explains is no slip.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from cwcli.estimation.contradiction import SourceQuantity
from cwcli.estimation.correction import Correction
from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, Kind, Measurements
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.prepare import PreparedSeries, earliest_stamp_ns, seconds_since_zero_time
from cwcli.estimation.slow_accel import speed_changes_of_lever_arm
from cwcli.estimation.source_checks import MIN_ROWS_OF_COMPARED_SOURCE
from cwcli.estimation.step_motion import compute_step_motion_by_source, means_between_edges, step_edges_s
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.signals.normal_distribution import SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION

BEND_STEP_S = 0.5
"""Length of the steps, s: a car turns in within one or two, and slopes change little. Chosen by hand; not fitted."""
BIAS_STEP_S, MIN_STEPS_WITH_BIAS = 4.0, 8
"""Length, s, and least number of the steps in which fixes show the bias of a gyroscope: longer ones than above, as the
course of fixes is noisy. Chosen by hand; not fitted."""
MIN_STEPS_WITH_BENDS = 60
"""Least number of steps: half a minute. Chosen by hand; not fitted."""
MIN_TURN_RATE_OF_BEND_RADPS = 0.05
"""Turn rate from which on a car is in a bend, rad/s: one of 200 m at 10 m/s. Chosen by hand; not fitted."""
MIN_EXCESS_IN_BENDS, MIN_EXCESS_SIGMAS = 0.01, 4.0
"""Least share by which a speed reads more or less in bends, and in sigmas above it. Chosen by hand; not fitted."""
MAX_WHEELBASE_M = 6.5
"""Longest wheelbase, m, as of a coach. The front wheels drive 1 / cos(steering angle) times as far as the rear axle: by
1.6 % more with 2.7 m round a bend of 15 m, and by 8 % more with 6 m, which is no fault."""
MIN_SPEED_OF_CURVATURE_MPS = 1.0
"""Least speed by which a turn rate is divided, m/s: at standstill noise alone turns. Chosen by hand."""
MAX_BEND_RESIDUAL_IN_SCATTERS = 4.0
"""Greatest residual, in scatters, that the second pass uses; kerbs and lost rows lie beyond. Chosen by hand."""
SMALLEST_POWER = 1e-12
"""Smallest sum of squares by which is divided."""
MIN_POWER_SHARE_BESIDE_OTHERS = 1e-3
"""Least share of the sum of squares that the other causes leave of the change of v in bends. Chosen by hand."""


@dataclass(frozen=True)
class ExcessInBends:
    """By how much a speed reads more in bends.

    Attributes:
        value, sigma: The excess as a share of what it reads there, and one sigma of it.
        low, high: The least and the greatest part of it that no wheelbase of steered wheels explains.
        middle_s, turn_rate_radps: Shape (n,): middles of the steps, and the turn rates in them without their bias.
    """

    value: float
    sigma: float
    low: float
    high: float
    middle_s: FloatArray
    turn_rate_radps: FloatArray

    @property
    def is_clear(self) -> bool:
        """Whether neither chance nor steered wheels explain it."""
        return max(self.low, -self.high) - MIN_EXCESS_SIGMAS * self.sigma > MIN_EXCESS_IN_BENDS

    def is_in_bend(self, time_s: FloatArray) -> BoolArray:
        """Return a mask (n,) of the times (n,), s, in bends and shortly before and behind them."""
        return np.asarray(
            np.abs(np.interp(time_s, self.middle_s, self.turn_rate_radps)) > 0.5 * MIN_TURN_RATE_OF_BEND_RADPS
        )

    def subtract_from(self, speed: SensorSeries) -> SensorSeries:
        """Return a speed without the excess."""
        share = np.where(self.is_in_bend(speed.time_s), self.value, 0.0)
        return replace(speed, values=speed.values * (1.0 - share)[:, None])


def set_speeds_aside_in_bends(
    measurements: Sequence[Measurements], prepared: Sequence[PreparedSeries], trusted: Collection[str]
) -> tuple[list[Measurements], list[Correction], list[PreparedSeries]]:
    """Return the measurements with the rows in bends not measured of speeds that read more or less there.

    Returned are also what was set aside, and the series with the excess taken off these rows, so that a mean over them
    is that of the straight roads.

    Args:
        measurements: Measurements.
        prepared: Their series, after what contradicts the others was left out.
        trusted: Sources that are not corrected.
    """
    usable = [p.series for p in prepared if len(p.series) >= MIN_ROWS_OF_COMPARED_SOURCE and not p.series.is_exact]
    fixes = next((s for s in usable if s.kind is Kind.POSITION), None)
    accel, turning = _first_fast_imu(usable)
    speeds = {s.source: s for s in usable if s.kind is Kind.SPEED and s.source not in trusted}
    found: list[Measurements] = []
    corrections: list[Correction] = []
    without_excess = list(prepared)
    for m in measurements:
        found.append(m)
        if m.kind is not Kind.SPEED or m.source not in speeds or fixes is None or accel is None or turning is None:
            continue
        excess = find_excess_in_bends(speeds[m.source], accel, turning, fixes)
        if excess is None or not excess.is_clear:
            continue
        time_s = seconds_since_zero_time(m.stamp_ns, earliest_stamp_ns(measurements))
        rows = excess.is_in_bend(time_s) & np.isfinite(m.values[:, 0])
        found[-1] = replace(m, values=np.where(rows[:, None], np.nan, m.values))
        n = int(rows.sum())
        fault = f"reads {1.0 / (1.0 - excess.value):.3f} times the speed in bends, as of wheels that slip"
        evidence = f"+- {excess.sigma:.3f} by accelerations of {accel.source}"
        who = SourceQuantity(m.source, m.kind)
        corrections.append(Correction(who, "bends", fault, f"{n} rows set aside", evidence, n_set_aside=n))
        without_excess = [
            replace(p, series=excess.subtract_from(p.series)) if p.series is speeds[m.source] else p
            for p in without_excess
        ]
    return found, corrections, without_excess


def _first_fast_imu(series: Sequence[SensorSeries]) -> tuple[SensorSeries | None, SensorSeries | None]:
    """Return acceleration and turn rate of the first source that has both, and often enough; else None twice."""
    fast = [s for s in series if s.kind in KINDS_THAT_IMU_MEASURES_TOO and _is_fast_enough(s)]
    turning = {s.source: s for s in fast if s.kind is Kind.YAW_RATE}
    return next(((s, turning[s.source]) for s in fast if s.kind is Kind.ACCEL and s.source in turning), (None, None))


def find_excess_in_bends(
    speed: SensorSeries, accel: SensorSeries, turning: SensorSeries, fixes: SensorSeries
) -> ExcessInBends | None:
    """Return by how much a speed reads more in bends; None in short logs, without bends and of slow sources.

    Args:
        speed: A speed.
        accel, turning: Forward acceleration and turn rate of one IMU.
        fixes: Positions, for the time that is looked at.
    """
    edges_s = step_edges_s([fixes], BEND_STEP_S)
    if len(edges_s) < MIN_STEPS_WITH_BENDS or not all(map(_is_fast_enough, (speed, accel, turning))):
        return None
    own, by_imu, turned = (compute_step_motion_by_source(s, edges_s) for s in (speed, accel, turning))
    rate = means_between_edges(turning.time_s, turning.values[:, 0], edges_s)
    rate -= bias_of_gyroscope_or_nan_radps(turning, fixes)
    v, change = own.speed_mps, by_imu.speed_change_to_next_step_mps
    missing = own.speed_change_to_next_step_mps - change
    in_bends = np.diff(v * np.minimum(np.square(rate / MIN_TURN_RATE_OF_BEND_RADPS), 1.0))
    lateral = v * rate
    later = np.concatenate([change[1:], change[-1:]]) - np.concatenate([change[:1], change[:-1]])
    yawed = lateral[1:] + lateral[:-1]
    # Beside a bias: another scale of the IMU, a latency, its yaw and its lever arm.
    others = np.column_stack(
        [np.ones(len(change)), change, later, yawed, *speed_changes_of_lever_arm(turning, edges_s)]
    )
    steered = np.diff(speed_of_steered_wheels_beyond_axle_mps_per_m2(v, rate))
    rows = np.isfinite(missing + turned.turn_rad + later + yawed + in_bends)
    value, sigma, low, high = math.nan, math.nan, math.nan, math.nan
    for _ in range(2):
        if rows.sum() < MIN_STEPS_WITH_BENDS:
            return None
        basis, _ = np.linalg.qr(others[rows])
        free, rest, of_wheelbase = (x[rows] - basis @ (basis.T @ x[rows]) for x in (in_bends, missing, steered))
        power = float(free @ free)
        if power <= MIN_POWER_SHARE_BESIDE_OTHERS * float(in_bends[rows] @ in_bends[rows]):
            return None
        value = float(free @ rest) / power
        rest = rest - value * free
        variance = float(rest @ rest) / (len(rest) - others.shape[1] - 1)
        sigma = math.sqrt(variance / power)
        share = float(free @ of_wheelbase) / power
        wheelbase = _squared_wheelbase_range_m2(of_wheelbase - share * free, rest, variance)
        low, high = sorted(value - share * each for each in wheelbase)
        scatter = SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION * median_of_finite_values(np.abs(rest))
        rows[rows] = np.abs(rest) <= MAX_BEND_RESIDUAL_IN_SCATTERS * scatter
    return ExcessInBends(value, sigma, low, high, 0.5 * (edges_s[1:] + edges_s[:-1]), rate)


def _is_fast_enough(s: SensorSeries) -> bool:
    return median_of_finite_values(np.diff(s.time_s)) <= 0.5 * BEND_STEP_S


def bias_of_gyroscope_or_nan_radps(turning: SensorSeries, fixes: SensorSeries) -> float:
    """Return by how much a turn rate is larger than that of the fixes in most steps; NaN where too few show it.

    The median of a turn rate is no bias: on a roundabout, or an oval, a car turns to one side for most of the time.
    """
    edges_s = step_edges_s([fixes], BIAS_STEP_S)
    if len(edges_s) < MIN_STEPS_WITH_BIAS:
        return math.nan
    own, by_fixes = (compute_step_motion_by_source(s, edges_s).turn_rad for s in (turning, fixes))
    difference = (own - by_fixes + math.pi) % (2.0 * math.pi) - math.pi
    known = difference[np.isfinite(difference)]
    return median_of_finite_values(known) / BIAS_STEP_S if len(known) >= MIN_STEPS_WITH_BIAS else math.nan


def speed_of_steered_wheels_beyond_axle_mps_per_m2(speed_mps: FloatArray, yaw_rate_radps: FloatArray) -> FloatArray:
    """Return by how much steered wheels are faster than the rear axle, (n,), m/s per m^2 of squared wheelbase.

    With a wheelbase l and the curvature k it is v (l k)^2 / 2, the first term of v sqrt(1 + (l k)^2) - v: at l k = 0.4
    it is 4 % of the excess too much. In reverse it is negative, as v is.
    """
    curvature_per_m = yaw_rate_radps / np.maximum(np.abs(speed_mps), MIN_SPEED_OF_CURVATURE_MPS)
    return 0.5 * speed_mps * np.square(curvature_per_m)


def _squared_wheelbase_range_m2(per_m2: FloatArray, rest: FloatArray, variance: float) -> tuple[float, float]:
    """Return the range of squared wheelbases, m^2, of steered wheels that a log leaves: all where bends are alike.

    Args:
        per_m2: Shape (n,): changes of speed for each m^2, beside all other causes.
        rest: Shape (n,): changes of speed that the other causes leave.
        variance: Of one of these.
    """
    power = max(float(per_m2 @ per_m2), SMALLEST_POWER)
    found, half_width = float(per_m2 @ rest) / power, MIN_EXCESS_SIGMAS * math.sqrt(variance / power)
    low, high = (min(max(each, 0.0), MAX_WHEELBASE_M**2) for each in (found - half_width, found + half_width))
    return low, high
