"""Correct the one source whose wrong unit, sign, axes or convention best explains the contradictions."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence

import numpy as np

from cwcli.estimation.contradiction import SourceQuantity
from cwcli.estimation.correction import Correction, correction_of_all_rows
from cwcli.estimation.hypotheses.base import Hypothesis
from cwcli.estimation.hypotheses.imu import GYRO_REVERSED_HYPOTHESIS
from cwcli.estimation.imu_against_motion import RIGHT_GRAVITY_RANGE, is_gyroscope_reversed_against_own_accelerometer
from cwcli.estimation.imu_hypotheses import find_imu_unit_sign_or_axis_fault
from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, Kind, Measurements
from cwcli.estimation.odd_sensors import find_impossible_imu_values, find_tilt_and_evidence
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.prepare import PreparedSeries, finite_rows_by_stamp, seconds_since_zero_time
from cwcli.estimation.source_checks import MIN_ROWS_OF_COMPARED_SOURCE, Judgement, SourceComparison
from cwcli.estimation.source_hypotheses import (
    MIN_LOG_LIKELIHOOD_MARGIN_TO_NEXT,
    Finding,
    find_fault,
    sources_agreeing_after_correction,
)
from cwcli.estimation.source_vote import (
    compare_prepared_sources,
    find_tilted_imus,
)
from cwcli.estimation.standstill_heading import has_heading_jumps
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import AccelGyroRows
from cwcli.signals.units import STANDARD_GRAVITY_MPS2

Prepare = Callable[[Sequence[Measurements]], tuple[list[PreparedSeries], list[str]]]
"""A function that cleans measurements; returns the series and notes."""
MAX_IMU_RATIO_ERROR = 0.35
"""Greatest relative difference from 1 of an IMU's turns and changes of speed after a correction: an IMU that is tilted
by 30 degrees shows 0.87 of both, and slopes and latencies change more. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class CorrectionAttempt:
    """Measurements with one correction more.

    Attributes:
        measurements, prepared, notes: As `JudgedSources`.
        correction: What was corrected.
        hypothesis: Of all rows of its source.
        gain: Log-likelihood of it beyond that of the values as they are.
        unused: Quantities of the source that still contradict the others and are left out.
    """

    measurements: list[Measurements]
    prepared: list[PreparedSeries]
    notes: list[str]
    correction: Correction
    hypothesis: Hypothesis
    gain: float
    unused: tuple[SourceQuantity, ...] = ()


def correct_one_contradicted_source(
    measurements: Sequence[Measurements],
    prepared: Sequence[PreparedSeries],
    comparisons: Sequence[SourceComparison],
    prepare: Prepare,
    trusted: Collection[str],
    zero_ns: int,
) -> CorrectionAttempt | None:
    """Return the measurements with the correction that clearly explains a contradiction best; None without one.

    Args:
        measurements, prepared, comparisons: Measurements, their series, and comparisons of these.
        prepare: Cleans measurements.
        trusted: Sources that are not corrected.
        zero_ns: Stamp from which the times of the series count.
    """
    usable = [p.series for p in prepared if len(p.series) >= MIN_ROWS_OF_COMPARED_SOURCE and not p.series.is_exact]
    contrary = [each for each in comparisons if each.judgement is Judgement.CONTRADICT]
    suspects = {who for each in contrary for who in (each.one, each.other)} | {
        each.who for each in find_tilted_imus(prepared)
    }
    # Headings in degrees jump, and then differ from the course by nothing that lasts.
    suspects |= {
        SourceQuantity(s.source, s.kind)
        for s in usable
        if s.kind is Kind.HEADING and has_heading_jumps(s.time_s, s.values[:, 0])
    }
    suspects = {who for who in suspects if who.source not in trusted}
    imus = {m.source: m for m in measurements if m.kind is Kind.IMU}
    suspected_imus = dict.fromkeys(
        m for m in imus if any(who.source == m and _is_imu_quantity(who) for who in suspects)
    )
    tilted = {each.who.source for each in find_tilted_imus(prepared)}
    level = [s for s in usable if not (s.kind in KINDS_THAT_IMU_MEASURES_TOO and s.source in tilted)]
    if not any(s.kind is Kind.POSITION for s in level):
        return None
    for source in suspected_imus:
        reversed_gyroscope = _attempt_reversed_gyroscope(imus[source], measurements, level, prepare, zero_ns)
        if reversed_gyroscope is not None:
            return reversed_gyroscope
    findings = [
        found
        for i, s in enumerate(level)
        if SourceQuantity(s.source, s.kind) in suspects
        and not (s.kind in KINDS_THAT_IMU_MEASURES_TOO and s.source in imus)
        and (found := find_fault(level, i)) is not None
    ]
    attempts = [_correct_measurements_by_finding(measurements, found, prepare) for found in findings]
    for source in suspected_imus:
        tried = attempt_imu_correction(imus[source], measurements, level, prepare, zero_ns)
        if tried is not None:
            attempts.append(tried)
    # A wrong position shows on a map; so it is corrected only where nothing else explains the contradiction, not even
    # in several ways, of which none is clear.
    attempts.sort(key=lambda each: (each.correction.who.kind is Kind.POSITION, -each.gain))
    for attempt in attempts:
        who = attempt.correction.who
        rivals = (
            each.gain
            for each in attempts
            if each.correction.who.kind is not Kind.POSITION
            and _do_sources_contradict_each_other(contrary, who, each.correction.who)
        )
        if who.kind is Kind.POSITION:
            rivals = (
                found.gain
                for i, s in enumerate(level)
                if s.kind not in (Kind.POSITION, *KINDS_THAT_IMU_MEASURES_TOO)
                and _do_sources_contradict_each_other(contrary, who, SourceQuantity(s.source, s.kind))
                and (found := find_fault(level, i, may_be_ambiguous=True)) is not None
            )
        if all(attempt.gain - other_gain >= MIN_LOG_LIKELIHOOD_MARGIN_TO_NEXT for other_gain in rivals):
            return attempt
    return None


def _attempt_reversed_gyroscope(
    imu: Measurements,
    measurements: Sequence[Measurements],
    levelled_series: Sequence[SensorSeries],
    prepare: Prepare,
    zero_ns: int,
) -> CorrectionAttempt | None:
    """Return the measurements with the gyroscope reversed where the IMU's own accelerometer shows that it is wrong."""
    fixes = next(s for s in levelled_series if s.kind is Kind.POSITION)
    rate = next((s for s in levelled_series if s.kind is Kind.YAW_RATE and s.source == imu.source), None)
    rows = finite_rows_by_stamp(imu)
    time_s = seconds_since_zero_time(imu.stamp_ns[rows], zero_ns)
    if rate is None or not is_gyroscope_reversed_against_own_accelerometer(time_s, imu.values[rows], fixes, rate):
        return None
    hypothesis = GYRO_REVERSED_HYPOTHESIS
    corrected = [hypothesis.correct_measurements(m) if m is imu else m for m in measurements]
    evidence = f"by its own accelerometer and {fixes.source}"
    correction = correction_of_all_rows(imu, hypothesis, evidence)
    return CorrectionAttempt(corrected, *prepare(corrected), correction, hypothesis, math.inf)


def _is_imu_quantity(quantity: SourceQuantity) -> bool:
    return quantity.kind in (*KINDS_THAT_IMU_MEASURES_TOO, Kind.IMU)


def _do_sources_contradict_each_other(
    contrary: Sequence[SourceComparison], who: SourceQuantity, other: SourceQuantity
) -> bool:
    """Whether two sources contradict each other; quantities of one IMU count together."""

    def is_same(one: SourceQuantity, two: SourceQuantity) -> bool:
        return one == two or (one.source == two.source and _is_imu_quantity(one) and _is_imu_quantity(two))

    return not is_same(who, other) and any(
        (is_same(each.one, who) and is_same(each.other, other))
        or (is_same(each.one, other) and is_same(each.other, who))
        for each in contrary
    )


def _correct_measurements_by_finding(
    measurements: Sequence[Measurements], finding: Finding, prepare: Prepare
) -> CorrectionAttempt:
    """Return the measurements with a finding applied."""
    corrected = [
        finding.hypothesis.correct_measurements(m) if SourceQuantity(m.source, m.kind) == finding.who else m
        for m in measurements
    ]
    own = next(m for m in measurements if SourceQuantity(m.source, m.kind) == finding.who)
    correction = correction_of_all_rows(own, finding.hypothesis, finding.evidence_text)
    return CorrectionAttempt(corrected, *prepare(corrected), correction, finding.hypothesis, finding.gain)


def _spoils_right_gravity(hypothesis: Hypothesis, values: AccelGyroRows) -> bool:
    """Whether gravity is right before a correction alone: a lever arm, say, may seem another unit."""
    before_g, after_g = (
        float(np.linalg.norm(each[:, :3].mean(axis=0))) / STANDARD_GRAVITY_MPS2
        for each in (values, hypothesis.correct_values(values))
    )
    low, high = RIGHT_GRAVITY_RANGE
    return low < before_g < high and not low < after_g < high


def attempt_imu_correction(
    imu: Measurements,
    measurements: Sequence[Measurements],
    levelled_series: Sequence[SensorSeries],
    prepare: Prepare,
    zero_ns: int,
) -> CorrectionAttempt | None:
    """Return the measurements with units, signs and axes of an IMU corrected; None where none clearly wins."""
    others = [s for s in levelled_series if s.source != imu.source]
    if not any(s.kind is Kind.POSITION for s in others):
        return None
    rows = finite_rows_by_stamp(imu)
    time_s = seconds_since_zero_time(imu.stamp_ns[rows], zero_ns)
    found = find_imu_unit_sign_or_axis_fault(time_s, imu.values[rows], others)
    if found is None or _spoils_right_gravity(found.hypothesis, imu.values[rows]):
        return None
    hypothesis = found.hypothesis
    tilt = find_tilt_and_evidence(hypothesis.correct_values(imu.values))
    if tilt is not None:
        hypothesis = tilt[0].combine_after(hypothesis)
    corrected = [hypothesis.correct_measurements(m) if m is imu else m for m in measurements]
    prepared, notes = prepare(corrected)
    if any(each.who.source == imu.source for each in find_tilted_imus(prepared)):
        return None
    comparisons = compare_prepared_sources(prepared)
    accel, yaw_rate = (SourceQuantity(imu.source, kind) for kind in KINDS_THAT_IMU_MEASURES_TOO)
    by_turns = sources_agreeing_after_correction(comparisons, yaw_rate, MAX_IMU_RATIO_ERROR)
    by_speed = sources_agreeing_after_correction(comparisons, accel, MAX_IMU_RATIO_ERROR)
    is_contrary = any(c.judgement is Judgement.CONTRADICT and c.involves_source(yaw_rate) for c in comparisons)
    if is_contrary or not (by_turns or by_speed):
        return None
    judges = ", ".join(dict.fromkeys(each.source for each in (*by_turns, *by_speed)))
    correction = correction_of_all_rows(imu, hypothesis, f"log-likelihood ratio {found.gain:.0f} by {judges}")
    unused: tuple[SourceQuantity, ...] = ()
    if not found.is_forward_clear or any(
        c.judgement is Judgement.CONTRADICT and c.involves_source(accel) for c in comparisons
    ):
        if not found.changes_yaw_rate and not find_impossible_imu_values(imu.values):
            return None
        unused = (accel,)
        correction = replace(
            correction,
            action=f"{correction.action}; its acceleration is not used, because its forward axis is not clear",
        )
    return CorrectionAttempt(corrected, prepared, notes, correction, hypothesis, found.gain, unused)
