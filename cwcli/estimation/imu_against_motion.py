"""Compare the accelerations of a level IMU with those by the fixes or a wheel: its yaw against the car, and its scale.

In each step the forward and left acceleration by the IMU are those of the others (v', v w), turned by the yaw of the
mounting. Their ratio is 1 unless the accelerometer, which gravity checks, or the map of the fixes has another scale.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Collection, Sequence

import numpy as np
import numpy.typing as npt

from cwcli.estimation.contradiction import CAR_MOTION_TEXT, Contradiction, SourceQuantity
from cwcli.estimation.correction import Correction, correction_of_all_rows
from cwcli.estimation.hypotheses.base import Hypothesis
from cwcli.estimation.hypotheses.imu import ACCEL_UNIT_HYPOTHESES
from cwcli.estimation.map_stretch import MAP_STEP_S, stretch_of_map_or_nan
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.prepare import (
    PreparedSeries,
    earliest_stamp_ns,
    finite_rows_by_stamp,
    seconds_since_zero_time,
)
from cwcli.estimation.source_checks import MIN_ROWS_OF_COMPARED_SOURCE
from cwcli.estimation.source_hypotheses import (
    MIN_LOG_LIKELIHOOD_GAIN_OF_HYPOTHESIS,
    step_motions_and_edges_for_evidence,
)
from cwcli.estimation.step_motion import (
    MAX_BRIDGED_GAP_S,
    StepMotion,
    compute_step_motion_by_source,
    covered_step_mask,
    means_between_edges,
    step_edges_s,
    trapezoidal_integral,
)
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import AccelGyroRows, FloatArray
from cwcli.signals.units import STANDARD_GRAVITY_MPS2

MIN_CORRECTED_MOUNTING_YAW_RAD = math.radians(6.0)
"""Least angle that is corrected: less adds a tenth of the lateral acceleration to the forward one. Chosen by hand; not
fitted."""
MIN_TIME_STEPS_WITH_IMU_AND_FIXES = 10
"""Least number of time steps with accelerations by both the IMU and the fixes. Chosen by hand; not fitted."""
MIN_CORRELATION_OF_IMU_AND_FIX_ACCELERATIONS = 0.8
"""Least correlation of the turned accelerations with those of the fixes. Chosen by hand; not fitted."""
MIN_MOUNTING_YAW_IN_SIGMAS = 4.0
"""Least angle in its sigmas: one log without a fault in 16,000. Not fitted."""
MIN_RMS_ACCELERATION_OF_FIXES_MPS2 = 0.5
"""Least root mean square of both accelerations of the fixes together, m/s^2: without a manoeuvre nothing shows. Chosen
by hand; not fitted."""
MIN_RATIO_SIGMAS = 4.0
"""Least difference from its range, in sigmas, of a ratio that is a fault: as for a yaw."""
LAG_STEP_S, MAX_LAG_S, MIN_LAG_S = 0.1, 2.0, 0.4
"""Step of the lags between gyroscope and accelerometer that are tried, the longest one, and the least one that is a
fault, s. Chosen by hand: an anti-aliasing filter of 1 Hz lags by 0.2 s, and a body rolls within 0.2 s."""
MAX_INTERPOLATED_STEPS = 1.5
"""Longest time between two known speeds, in steps, that is interpolated: no step between them is missing."""
MAX_LEVER_ARM_M, LEVER_ARM_STEP_M = 8.0, 0.5
"""Longest way of an IMU ahead of the rear axle, or behind it, that is tried, and the step, m. Chosen by hand: as in the
front of a bus."""
MAX_EDGES_PER_ROW = 4
"""Most edges of time steps for each row of an IMU: more come of long pauses alone. Chosen by hand."""
LAG_OF_IMU_STEP_S, MAX_LAG_OF_IMU_S = 0.25, 4.0
"""Step of the lags of an IMU behind the fixes that are tried, and the longest one to either side, s."""
HARMLESS_LAG_OF_IMU_RANGE_S = (-1.25, 0.5)
"""Range of the lags of an IMU behind the fixes that the search for latencies explains, s. Chosen by hand: fixes may be
late by a second, and it looks for fixes that are early by at most half a second."""
SMALLEST_RATIO, SMALLEST_POWER = 1e-3, 1e-12
"""Smallest ratio whose logarithm is taken, and smallest product of two powers by which a correlation is divided."""
ACCEL_RATIO_RANGE = (0.85, 1.25)
"""Range of the ratio of an accelerometer's accelerations to those by the fixes that no fault is needed for. Chosen by
hand: a car that leans out of its bends by 6 degrees at 1 g adds a tenth, and a road may be banked."""
MAX_UNSUSPICIOUS_RATIO = 1.05
"""Greatest such ratio, or its inverse, with which no other map is looked for: it only saves time. Chosen by hand."""
RIGHT_GRAVITY_RANGE = (0.9, 1.1)
"""Range of the mean specific force in g that shows that the scale of an accelerometer is right. Chosen by hand."""


@dataclass(frozen=True)
class StepAccelerations:
    """Accelerations in the n steps in which an IMU and the others tell them, without their medians.

    Attributes:
        measured: Shape (n, 2): forward and left by the IMU, m/s^2.
        reference: Shape (n, 2): by the others.
        per_lever_arm: Shape (n, 2): what the IMU reads more for each metre ahead of the axle, -w^2 and w', 1/s^2.
        course_rad: Shape (n,): course by the fixes; NaN where they hardly move.
        judges: Names of the others.
        time_s, speed_mps: Shape (n,): middle of the steps, and speed by the others.
        fixes, edges_s: Motion of the fixes in all steps, and the edges of these.
    """

    measured: FloatArray
    reference: FloatArray
    per_lever_arm: FloatArray
    course_rad: FloatArray
    judges: str
    time_s: FloatArray
    speed_mps: FloatArray
    fixes: StepMotion
    edges_s: FloatArray


def correct_imus_and_find_contradictions_of_motion(
    measurements: Sequence[Measurements],
    prepared: Sequence[PreparedSeries],
    trusted: Collection[str] = (),
) -> tuple[list[Measurements], list[Correction], list[Contradiction]]:
    """Return the measurements with level IMUs put right, what was corrected, and wrong maps, clocks and gyroscopes.

    Args:
        measurements: Measurements.
        prepared: Their series, after what contradicts the others was left out.
        trusted: Sources that are not corrected.
    """
    usable = [p for p in prepared if len(p.series) >= MIN_ROWS_OF_COMPARED_SOURCE]
    fixes = next((p.series for p in usable if p.series.kind is Kind.POSITION), None)
    level = {p.series.source for p in prepared if p.mounting is not None and len(p.series)}
    corrected: list[Measurements] = []
    corrections: list[Correction] = []
    contradictions: list[Contradiction] = []
    for m in measurements:
        corrected.append(m)
        if m.kind is not Kind.IMU or fixes is None or m.source not in level - {*trusted}:
            continue
        rows = finite_rows_by_stamp(m)
        time_s = seconds_since_zero_time(m.stamp_ns[rows], earliest_stamp_ns(measurements))
        helpers = [
            p.series
            for p in usable
            if p.series.kind is Kind.SPEED or (p.series.kind is Kind.YAW_RATE and p.series.source == m.source)
        ]
        accelerations = compute_step_accelerations(time_s, m.values[rows], [fixes, *helpers])
        if accelerations is None:
            continue
        lag_s = lag_of_gyroscope_behind_accelerometer_s(time_s, m.values[rows], accelerations)
        if math.isfinite(lag_s):
            corrected[-1] = _advance_lagging_columns(m, rows, lag_s)
            n_lost = len(rows) - int(np.isfinite(corrected[-1].values).all(axis=1).sum())
            corrections.append(_correction_of_lag(m, lag_s, n_lost))
            continue
        lag_s = lag_of_imu_behind_fixes_s(time_s, m.values[rows], accelerations)
        if math.isfinite(lag_s):
            contradictions.append(_contradiction_of_clocks(fixes.source, m.source, lag_s))
            continue
        gravity_g = float(np.linalg.norm(m.values[rows, :3].mean(axis=0))) / STANDARD_GRAVITY_MPS2
        found = find_imu_yaw_hypothesis_and_evidence(accelerations)
        low, high = bounds_of_ratio(accelerations)
        is_gravity_right = RIGHT_GRAVITY_RANGE[0] < gravity_g < RIGHT_GRAVITY_RANGE[1]
        is_scaled = low < RIGHT_GRAVITY_RANGE[1] * gravity_g and high > RIGHT_GRAVITY_RANGE[0] * gravity_g
        if found is None and not is_gravity_right and is_scaled:
            found = _accel_scale_hypothesis(gravity_g), f"by accelerations of {accelerations.judges}"
        elif found is None and is_gravity_right and _is_ratio_suspicious(low, high):
            # A speed may be wrong itself.
            without_speed = [s for s in helpers if s.kind is not Kind.SPEED]
            contradictions += _contradictions_of_map_or_gyroscope(time_s, m.select_rows(rows), fixes, without_speed)
        if found is not None:
            corrections.append(correction_of_all_rows(m, *found))
            corrected[-1] = found[0].correct_measurements(m)
    return corrected, corrections, contradictions


def _contradiction_of_clocks(fixes: str, imu: str, lag_s: float) -> Contradiction:
    """Return the contradiction of fixes and an IMU whose clocks differ; which one is wrong these two do not tell."""
    what = (
        f"the same turns and changes of speed come about {abs(lag_s):.1f} s {'earlier' if lag_s > 0.0 else 'later'} in "
        "its fixes: check the clocks of both, as either may be wrong, and say how late it is by --latency"
    )
    return Contradiction(SourceQuantity(fixes, Kind.POSITION), SourceQuantity(imu, Kind.IMU), what)


def _is_ratio_suspicious(low: float, high: float) -> bool:
    """Whether the middle of the bounds of a ratio is not near 1; not where they are NaN."""
    return abs(math.log(max(low, SMALLEST_RATIO) * high)) > 2.0 * math.log(MAX_UNSUSPICIOUS_RATIO)


def _contradictions_of_map_or_gyroscope(
    time_s: FloatArray, imu: Measurements, fixes: SensorSeries, turning: Sequence[SensorSeries]
) -> list[Contradiction]:
    """Return the contradiction of fixes whose map, or of a gyroscope whose turn rate, has another scale, or nothing.

    Of speed times turn rate a gyroscope makes the same as a map would; so a map has to show without it, too: in forward
    accelerations and turns of the fixes alone. Else the gyroscope is named.

    Args:
        time_s, imu: Rows of the IMU, whose gravity is right.
        fixes: Positions.
        turning: The IMU's own yaw rate.
    """
    edges_s = step_edges_s([fixes], MAP_STEP_S)

    def measured_and_reference(on_map: SensorSeries) -> tuple[FloatArray, FloatArray] | None:
        a = compute_step_accelerations(time_s, imu.values, [on_map, *turning], edges_s)
        return None if a is None else (a.measured, a.reference)

    def bounds_by(others: Sequence[SensorSeries]) -> tuple[float, float]:
        a = compute_step_accelerations(time_s, imu.values, others)
        return (math.nan, math.nan) if a is None else bounds_of_ratio(a)

    low, high = bounds_by([fixes, *turning])
    stretch = stretch_of_map_or_nan(fixes, measured_and_reference) if _is_ratio_suspicious(low, high) else math.nan
    who, doubt = SourceQuantity(fixes.source, Kind.POSITION), ""
    range_text = f"{1.0 / high:.2f} to {1.0 / max(low, SMALLEST_RATIO):.2f} times as far as"
    if math.isfinite(stretch):
        how = f"{stretch:.2g} times as far to the east as to the north, beside what"
    elif not (high < ACCEL_RATIO_RANGE[0] or low > ACCEL_RATIO_RANGE[1]):
        return []
    else:
        low, high = bounds_by([fixes]) if turning else (low, high)
        if low <= 1.0 <= high:
            what = f"it turns {range_text} the accelerations of {imu.source} and the speed of the fixes show"
            gyroscope, accelerometer = (SourceQuantity(imu.source, kind) for kind in (Kind.YAW_RATE, Kind.ACCEL))
            return [Contradiction(gyroscope, who, what, (accelerometer,), (gyroscope,), explains_misfits=True)]
        # Noise of the fixes alone may hide both.
        doubt = ", unless it turns by another scale" if math.isnan(low) else ""
        how = range_text
    what = (
        f"its fixes, and what agrees with them, move {how} the accelerations of {imu.source} show, whose gravity is "
        f"right{doubt}: check its unit and its map"
    )
    return [Contradiction(who, CAR_MOTION_TEXT, what, explains_misfits=True)]


def _accel_scale_hypothesis(gravity_g: float) -> Hypothesis:
    """Return the unit that a mean specific force, as a multiple of gravity in m/s^2, is in; else its scale."""
    for unit in ACCEL_UNIT_HYPOTHESES:
        if RIGHT_GRAVITY_RANGE[0] < unit.matrix[0][0] * gravity_g < RIGHT_GRAVITY_RANGE[1]:
            return unit
    matrix = np.diag([1.0 / gravity_g] * 3 + [1.0] * 3)
    fault = f"has an accelerometer that reads {gravity_g:.2f} times the acceleration, as gravity shows"
    return Hypothesis("scaled", "accel unit", fault, "divided by it", tuple(map(tuple, matrix.tolist())), (0.0,) * 6)


def lag_of_gyroscope_behind_accelerometer_s(time_s: FloatArray, values: AccelGyroRows, a: StepAccelerations) -> float:
    """Return by how much the turn rate of an IMU lags behind its lateral acceleration, s; NaN where it does not.

    Both come from one clock, and speed times turn rate is the lateral acceleration. So the lag of the best correlation
    is that of a filter in one of them; negative where it is in the accelerometer. An IMU ahead of the rear axle by x
    has x times the change of the turn rate as well, which seems a lag of at most x / speed: a lag has to be clearer.

    Args:
        time_s, values: Rows of the IMU; accelerometer and gyroscope, (n, 6).
        a: Its accelerations in steps.
    """
    n_lags = round(MAX_LAG_S / LAG_STEP_S)
    if not 4 * n_lags < (time_s[-1] - time_s[0]) / LAG_STEP_S <= MAX_EDGES_PER_ROW * len(time_s):
        return math.nan
    edges_s = np.arange(time_s[0], time_s[-1], LAG_STEP_S)
    middle_s = 0.5 * (edges_s[1:] + edges_s[:-1])
    left, rate = (means_between_edges(time_s, values[:, k], edges_s) for k in (1, 5))
    speed = np.interp(middle_s, a.time_s, a.speed_mps)
    after = np.searchsorted(a.time_s, middle_s).clip(1, len(a.time_s) - 1)
    is_near = (middle_s > a.time_s[0]) & (middle_s < a.time_s[-1])
    is_near &= a.time_s[after] - a.time_s[after - 1] < MAX_INTERPOLATED_STEPS * (a.edges_s[1] - a.edges_s[0])
    known = covered_step_mask(time_s, edges_s) & is_near
    product = speed * rate
    inner = slice(n_lags, len(left) - n_lags)
    correlation = np.zeros(2 * n_lags + 1)
    for i in range(len(correlation)):
        other = slice(i, i + inner.stop - inner.start)
        rows = known[inner] & known[other]
        correlation[i] = _correlation(left[inner][rows], product[other][rows])
    best = int(correlation.argmax())
    lag_s = LAG_STEP_S * (best - n_lags)
    if not MIN_CORRELATION_OF_IMU_AND_FIX_ACCELERATIONS < correlation[best] < 1.0 or abs(lag_s) < MIN_LAG_S:
        return math.nan
    # Over four steps, as noise of the change would hide a lever arm.
    change = np.convolve(rate, [1.0, 0.0, 0.0, 0.0, -1.0], "same") / (4.0 * LAG_STEP_S)
    rows = known[inner]
    arms_m = np.arange(-MAX_LEVER_ARM_M, MAX_LEVER_ARM_M + LEVER_ARM_STEP_M, LEVER_ARM_STEP_M).tolist()
    by_arm = max(_correlation(left[inner][rows], (product + x * change)[inner][rows]) for x in arms_m)
    n_independent = int(rows.sum()) * LAG_STEP_S / MAX_LAG_S
    gain = 0.5 * n_independent * math.log(max(1.0 - by_arm**2, SMALLEST_POWER) / (1.0 - correlation[best] ** 2))
    return lag_s if gain > MIN_LOG_LIKELIHOOD_GAIN_OF_HYPOTHESIS else math.nan


def _correlation(a: FloatArray, b: FloatArray) -> float:
    """Return the correlation of two columns; 0 for fewer than MIN_TIME_STEPS_WITH_IMU_AND_FIXES or constant ones."""
    if len(a) < MIN_TIME_STEPS_WITH_IMU_AND_FIXES:
        return 0.0
    a, b = a - a.mean(), b - b.mean()
    return float(a @ b) / math.sqrt(max(float(a @ a) * float(b @ b), SMALLEST_POWER))


def lag_of_imu_behind_fixes_s(time_s: FloatArray, values: AccelGyroRows, a: StepAccelerations) -> float:
    """Return by how much an IMU lags behind the fixes, s; NaN unless that is clear and no usual latency.

    Changes of speed and turns from step to step are compared with those of the IMU some time later. The best lag has to
    be clearer than each of HARMLESS_LAG_OF_IMU_RANGE_S, so that a period of a slalom is not taken for one.

    Args:
        time_s, values: Rows of the IMU; accelerometer and gyroscope, (n, 6).
        a: Its accelerations in steps.
    """
    lags_s = np.arange(-MAX_LAG_OF_IMU_S, MAX_LAG_OF_IMU_S + 0.5 * LAG_OF_IMU_STEP_S, LAG_OF_IMU_STEP_S)
    within = (a.edges_s[:-2] - MAX_LAG_OF_IMU_S > time_s[0]) & (a.edges_s[2:] + MAX_LAG_OF_IMU_S < time_s[-1])
    likelihood, best_correlation = np.zeros(len(lags_s)), np.zeros(len(lags_s))
    motion = compute_step_motion_by_source(_average_fixes_over_half_steps(a), a.edges_s)
    for k, wanted in ((0, motion.speed_change_to_next_step_mps), (5, motion.turn_rad)):
        rows = within & np.isfinite(wanted)
        n = int(rows.sum())
        if n < MIN_TIME_STEPS_WITH_IMU_AND_FIXES:
            continue
        twice = trapezoidal_integral(time_s, trapezoidal_integral(time_s, values[:, k]))
        by_fixes = wanted[rows] - wanted[rows].mean()
        for i, lag_s in enumerate(lags_s.tolist()):
            by_imu = np.diff(np.interp(a.edges_s + lag_s, time_s, twice), 2)[rows]
            by_imu = by_imu - by_imu.mean()
            power = float((by_imu**2).sum() * (by_fixes**2).sum())
            correlation = float((by_imu * by_fixes).sum()) / math.sqrt(max(power, SMALLEST_POWER))
            if 0.0 < correlation < 1.0:
                likelihood[i] -= 0.5 * n * math.log(1.0 - correlation**2)
                best_correlation[i] = max(best_correlation[i], correlation)
    best = int(likelihood.argmax())
    harmless = (lags_s >= HARMLESS_LAG_OF_IMU_RANGE_S[0]) & (lags_s <= HARMLESS_LAG_OF_IMU_RANGE_S[1])
    is_clear = (
        best_correlation[best] > MIN_CORRELATION_OF_IMU_AND_FIX_ACCELERATIONS
        and likelihood[best] - likelihood[harmless].max() > MIN_LOG_LIKELIHOOD_GAIN_OF_HYPOTHESIS
    )
    return float(lags_s[best]) if is_clear else math.nan


def _average_fixes_over_half_steps(a: StepAccelerations) -> SensorSeries:
    """Return the fixes, each the mean over half a step about it: of ten a second, one alone is needlessly noisy."""
    fixes, quarter_s = a.fixes.series, 0.25 * float(a.edges_s[1] - a.edges_s[0])
    edges_s = np.clip([fixes.time_s - quarter_s, fixes.time_s + quarter_s], fixes.time_s[0], fixes.time_s[-1])
    values = [
        np.diff(np.interp(edges_s, fixes.time_s, trapezoidal_integral(fixes.time_s, column)), axis=0)[0]
        for column in fixes.values.T
    ]
    return replace(fixes, values=np.column_stack(values) / np.diff(edges_s, axis=0).T)


def _correction_of_lag(m: Measurements, lag_s: float, n_lost: int) -> Correction:
    names = ("a gyroscope", "accelerometer") if lag_s > 0.0 else ("an accelerometer", "gyroscope")
    fault = f"has {names[0]} that lags behind its {names[1]} by {abs(lag_s):.1f} s, as by a filter"
    action = f"moved by it ({n_lost} rows without later ones are left out)"
    who = SourceQuantity(m.source, Kind.IMU)
    return Correction(who, "lag", fault, action, "by speed times turn rate", len(m) - n_lost)


def _advance_lagging_columns(m: Measurements, rows: npt.NDArray[np.intp], lag_s: float) -> Measurements:
    """Return the measurements with the gyroscope, or with a negative lag the accelerometer, taken from later rows.

    Rows without a later one, or with a pause there, get NaN.
    """
    values = m.values.copy()
    time_s = seconds_since_zero_time(m.stamp_ns[rows], int(m.stamp_ns[rows[0]]))
    later_s = time_s + abs(lag_s)
    after = np.searchsorted(time_s, later_s).clip(1, len(time_s) - 1)
    is_lost = (later_s > time_s[-1]) | (time_s[after] - time_s[after - 1] > MAX_BRIDGED_GAP_S)
    for k in (3, 4, 5) if lag_s > 0.0 else (0, 1, 2):
        values[rows, k] = np.where(is_lost, np.nan, np.interp(later_s, time_s, m.values[rows, k]))
    return replace(m, values=values)


def compute_step_accelerations(
    time_s: FloatArray, values: AccelGyroRows, others: Sequence[SensorSeries], edges_s: FloatArray | None = None
) -> StepAccelerations | None:
    """Return the accelerations by an IMU and the others; None where they hardly correlate, or without manoeuvres.

    The speed v is that of a wheel, else of the fixes. The turn rate w is the IMU's own, which a yaw does not change,
    else that of the fixes.

    Args:
        values: Shape (n, 6): accelerometer and gyroscope, levelled.
        others: Series of fixes first, then of speeds and of the IMU's own yaw rate.
        edges_s: Edges of the steps; None: as the noise of the fixes needs them.
    """
    motions: list[StepMotion] = []
    if edges_s is None:
        motions, edges_s = step_motions_and_edges_for_evidence(others)
    if len(edges_s) < MIN_TIME_STEPS_WITH_IMU_AND_FIXES + 3 or len(time_s) < MIN_TIME_STEPS_WITH_IMU_AND_FIXES:
        return None
    motions = motions or [compute_step_motion_by_source(s, edges_s) for s in others]
    forward, left, rate = values[:, 0], values[:, 1], values[:, 5]
    integrals = (*(trapezoidal_integral(time_s, column) for column in (forward, left, -(rate**2))), rate)
    integral = np.column_stack([means_between_edges(time_s, column, edges_s) for column in integrals])
    integral[~covered_step_mask(time_s, edges_s)] = np.nan
    # Smoothed as the reference is: changes of means over a step from the step before to the one behind it.
    measured = (integral[2:] - integral[:-2]) / (2.0 * float(edges_s[1] - edges_s[0]))
    speed = next((m for m in motions if m.kind is Kind.SPEED), motions[0])
    turning = next((m for m in motions if m.kind is Kind.YAW_RATE), motions[0])
    reference = _forward_and_left_accelerations_mps2(speed.speed_mps, turning.turn_rad, float(edges_s[1] - edges_s[0]))
    measured[~np.isfinite(integral[1:-1]).all(axis=1)] = np.nan
    rows = np.isfinite(measured).all(axis=1) & np.isfinite(reference).all(axis=1)
    n = int(rows.sum())
    if n < MIN_TIME_STEPS_WITH_IMU_AND_FIXES:
        return None
    f, r, k = (
        column[rows] - [median_of_finite_values(column[rows, 0]), median_of_finite_values(column[rows, 1])]
        for column in (measured[:, :2], reference, measured[:, 2:])
    )
    if np.square(r).sum() < n * MIN_RMS_ACCELERATION_OF_FIXES_MPS2**2:
        return None
    judges = ", ".join(dict.fromkeys(m.source for m in (speed, turning)))
    middle_s, speed_mps = 0.5 * (edges_s[2:-1] + edges_s[1:-2])[rows], speed.speed_mps[1:-1][rows]
    course_rad = motions[0].angle_rad[1:-1][rows]
    return StepAccelerations(f, r, k, course_rad, judges, middle_s, speed_mps, motions[0], edges_s)


def is_gyroscope_reversed_against_own_accelerometer(
    time_s: FloatArray, values: AccelGyroRows, fixes: SensorSeries, own_yaw_rate: SensorSeries
) -> bool:
    """Whether the lateral acceleration of an IMU is that of the turns of the fixes, but the opposite of its own turns.

    Then its gyroscope is reversed, however many headings agree with it. Where both are opposite, the map may be
    mirrored.

    Args:
        time_s, values: Rows of the IMU; accelerometer and gyroscope, (n, 6).
        fixes: Positions.
        own_yaw_rate: Yaw rate of the IMU.
    """
    by_turns_of = [compute_step_accelerations(time_s, values, others) for others in ([fixes], [fixes, own_yaw_rate])]
    correlations = [
        float(np.corrcoef(a.measured[:, 1], a.reference[:, 1])[0, 1])
        for a in by_turns_of
        if a is not None and np.ptp(a.measured[:, 1]) > 0.0 and np.ptp(a.reference[:, 1]) > 0.0
    ]
    least = MIN_CORRELATION_OF_IMU_AND_FIX_ACCELERATIONS
    return len(correlations) == len(by_turns_of) and correlations[0] > least and correlations[1] < -least


def find_imu_yaw_hypothesis_and_evidence(a: StepAccelerations) -> tuple[Hypothesis, str] | None:
    """Return the turn of a level IMU about the vertical and what shows it, or None.

    The turn of least squares between two sets of vectors has the angle atan2(sum of cross products, sum of scalar
    products) (Horn, 1987, in the plane). Noise of either makes both sums smaller and does not move it. What a lever arm
    adds, ahead or to the side, is taken out of both first: as complex numbers it is any multiple of i w' - w^2.
    """
    own, other, per_metre = (x[:, 0] + 1j * x[:, 1] for x in (a.measured, a.reference, a.per_lever_arm))
    n, power = len(own), max(float(np.square(np.abs(per_metre)).sum()), SMALLEST_POWER)
    own, other = (column - per_metre * (np.vdot(per_metre, column) / power) for column in (own, other))
    own_power, other_power = (float(np.square(np.abs(column)).sum()) for column in (own, other))
    product = complex(np.vdot(other, own))
    if other_power < 0.5 * n * MIN_RMS_ACCELERATION_OF_FIXES_MPS2**2 or abs(
        product
    ) < MIN_CORRELATION_OF_IMU_AND_FIX_ACCELERATIONS * math.sqrt(own_power * other_power):
        return None
    yaw_rad = cmath.phase(product)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    rest = own * complex(c, -s) - other
    sigma_rad = math.sqrt(float(np.square(np.abs(rest)).sum()) / (2.0 * n) / other_power)
    if abs(yaw_rad) < max(MIN_CORRECTED_MOUNTING_YAW_RAD, MIN_MOUNTING_YAW_IN_SIGMAS * sigma_rad):
        return None
    matrix = np.eye(6)
    matrix[:2, :2] = matrix[3:5, 3:5] = ((c, s), (-s, c))
    side = "right" if yaw_rad > 0.0 else "left"
    fault = f"is mounted turned by {abs(math.degrees(yaw_rad)):.0f} degrees to the {side} about the vertical"
    hypothesis = Hypothesis("yawed", "yaw", fault, "turned back", tuple(map(tuple, matrix.tolist())), (0.0,) * 6)
    return hypothesis, f"accelerations of {a.judges}, sigma {math.degrees(sigma_rad):.1f} degrees in {n} steps"


def bounds_of_ratio(a: StepAccelerations) -> tuple[float, float]:
    """Return the bounds of the ratio of the IMU's accelerations to the others'; NaN where they hardly correlate.

    Two regressions bound it: noise of the reference makes the one on it too small, that of the IMU the other too large.
    """
    own, other = a.measured.ravel(), a.reference.ravel()
    own_power, other_power, dot = float(own @ own), float(other @ other), float(own @ other)
    if not dot > MIN_CORRELATION_OF_IMU_AND_FIX_ACCELERATIONS * math.sqrt(own_power * other_power):
        return math.nan, math.nan
    on_other, on_own = dot / other_power, own_power / dot
    sigma = math.sqrt(max(own_power - on_other * dot, 0.0) / (len(own) - 1) / other_power)
    return on_other - MIN_RATIO_SIGMAS * sigma, on_own + MIN_RATIO_SIGMAS * sigma


def _forward_and_left_accelerations_mps2(speed_mps: FloatArray, turn_rad: FloatArray, step_s: float) -> FloatArray:
    """Return forward and left acceleration in each step but the first and last, (n - 2, 2).

    Args:
        speed_mps: Shape (n,): mean speed in each step.
        turn_rad: Shape (n - 1,): turn from each step to the next.
        step_s: Length of a step.
    """
    forward = (speed_mps[2:] - speed_mps[:-2]) / (2.0 * step_s)
    return np.column_stack([forward, speed_mps[1:-1] * (turn_rad[:-1] + turn_rad[1:]) / (2.0 * step_s)])
