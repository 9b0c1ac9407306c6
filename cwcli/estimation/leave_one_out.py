"""Find the source without which the others agree: the last check, after an estimate that shows a lasting misfit.

A wrong source that no comparison of steps shows, such as one that lags, drifts or has an offset, is taken up by the
noise and the slow errors of the others. Where these are larger than sensors have, the drive is estimated without each
source in turn. A source is left out if the misfit then is gone, and the others are predicted clearly better. What it
measured must still be measured by another source than the fixes: two sources alone do not tell which of them is wrong.
Only an IMU is left out all the same, because it has no position; the fixes then keep the noise that they had with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from cwcli.estimation.contradiction import Contradiction, SourceQuantity
from cwcli.estimation.fix_scatter import (
    is_lasting_error_large,
    is_sigma_a_lasting_error,
    is_sigma_explained_by_scatter,
    may_speed_be_blamed_for_slow_error,
)
from cwcli.estimation.latency import LatencyStatus
from cwcli.estimation.limit_check import find_values_beyond_sensor_limits
from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.parameter import ParameterStatus
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.prepare import PreparedSeries
from cwcli.estimation.result import SourceReport
from cwcli.estimation.score import MIN_LIKELIHOOD_GAIN_PER_PARAMETER
from cwcli.estimation.sensor_limits import LATENCY_CHANGE_PER_SECOND_RANGE
from cwcli.estimation.slow_drift import find_contradictions_of_drifting_fixes
from cwcli.estimation.source_checks import MIN_STEPS_OF_ONE_LENGTH
from cwcli.estimation.source_hypotheses import step_motions_and_edges_for_evidence
from cwcli.estimation.source_vote import emptied_series, quantity_of_series
from cwcli.estimation.step_evidence import MIN_COURSE_SPEED_MPS
from cwcli.estimation.tolerances import MAX_GATED_ROW_SHARE
from cwcli.lazy_dataclass import replace
from cwcli.signals.angles import wrap_angle
from cwcli.signals.normal_distribution import SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION

MAX_UNDOUBTED_SLOW_ERROR_SIGMA_M = 2.5
"""Greatest sigma on each axis of a slow error of fixes that raises no doubt, m. The GPS Standard Positioning Service
(2020) promises 8 m in 95 % as the global average, 3.3 m on each axis; receivers are usually better. Chosen by hand."""
MAX_UNDOUBTED_ROAD_GRADE_ACCEL_SIGMA_MPS2 = 0.6
"""Greatest sigma of gravity through the grade of the road that raises no doubt, m/s^2: a grade that scatters by 6 %."""
MIN_LOG_LIKELIHOOD_GAIN_TO_LEAVE_OUT = 10.0 * MIN_LIKELIHOOD_GAIN_PER_PARAMETER
"""Least gain of log-likelihood of all other sources by which one is left out. Chosen: ten parameters, because all noise
is fitted anew and errors last."""
MAX_UNDOUBTED_GATED_ROW_SHARE = 0.01
"""Greatest share of gated rows that raises no doubt: ten times what the gate rejects by chance. Chosen by hand."""

MIN_CONSTANT_ANGLE_IN_SCATTERS = 2.0
"""Least median angle between a heading and the course, in scatters of that of a step, that counts as constant. Chosen
by hand: a heading that lags, wanders or changes scatters by as much as it differs."""

_MEASURED_MOTIONS_BY_KIND = {
    Kind.VELOCITY: frozenset({"along", "turning"}),
    Kind.SPEED: frozenset({"along"}),
    Kind.ACCEL: frozenset({"along"}),
    Kind.HEADING: frozenset({"turning"}),
    Kind.YAW_RATE: frozenset({"turning"}),
}
"""The parts of the motion that each kind measures: along the vehicle, and its turning. Fixes measure the way alone."""


def quantities_with_unusual_noise_or_error(reports: Sequence[SourceReport]) -> set[SourceQuantity]:
    """Return the quantities with unusually large noise or slow errors, many rejected rows, or impossible constants."""
    found = {
        SourceQuantity(r.source, r.kind)
        for r in reports
        if r.n_used
        and (
            (r.noise_origin != "message" and is_sigma_a_lasting_error(r.kind, r.sigma, r.scatter))
            or (
                r.slow_error.status is ParameterStatus.USED
                and r.slow_error.sigma
                > (
                    MAX_UNDOUBTED_ROAD_GRADE_ACCEL_SIGMA_MPS2
                    if r.kind is Kind.ACCEL
                    else MAX_UNDOUBTED_SLOW_ERROR_SIGMA_M
                )
            )
            or (r.kind not in KINDS_THAT_IMU_MEASURES_TOO and r.n_gated > MAX_GATED_ROW_SHARE * (r.n_used + r.n_gated))
        )
    }
    return found | {each.who for each in find_values_beyond_sensor_limits(reports)}


def quantities_in_doubt(reports: Sequence[SourceReport]) -> set[SourceQuantity]:
    """Return the quantities whose errors last, whose latency changes, or that the gate often rejects."""
    return {
        SourceQuantity(r.source, r.kind)
        for r in reports
        if r.n_used
        and r.kind not in KINDS_THAT_IMU_MEASURES_TOO
        and (
            is_lasting_error_large(r)
            or may_speed_be_blamed_for_slow_error(r)
            or not LATENCY_CHANGE_PER_SECOND_RANGE.contains_or_is_nan(r.latency.drift)
            or r.n_gated > MAX_UNDOUBTED_GATED_ROW_SHARE * (r.n_used + r.n_gated)
        )
    }


def quantity_groups_to_leave_out(
    reports: Sequence[SourceReport], trusted: Collection[str] = ()
) -> list[tuple[SourceQuantity, ...]]:
    """Return what is left out in turn: each quantity but positions, and both of an IMU together.

    A speed or heading is left out only where a third source judges, see `can_third_source_judge`.
    """
    single = [
        SourceQuantity(r.source, r.kind)
        for r in reports
        if r.n_used and r.kind is not Kind.POSITION and r.source not in trusted
    ]
    rates = {
        source: tuple(each for each in single if each.source == source and each.kind in KINDS_THAT_IMU_MEASURES_TOO)
        for source in dict.fromkeys(each.source for each in single)
    }
    groups = [*((each,) for each in single), *(both for both in rates.values() if len(both) > 1)]
    return [
        group
        for group in groups
        if group[0].kind in KINDS_THAT_IMU_MEASURES_TOO or can_third_source_judge(reports, group)
    ]


def can_third_source_judge(reports: Sequence[SourceReport], group: Collection[SourceQuantity]) -> bool:
    """Whether another source than the fixes measures the motion that a group measures."""
    others = {SourceQuantity(r.source, r.kind) for r in reports if r.n_used and r.kind is not Kind.POSITION} - {*group}
    return _measured_motions(group) <= _measured_motions(others)


def _measured_motions(quantities: Collection[SourceQuantity]) -> frozenset[str]:
    return frozenset[str]().union(*(_MEASURED_MOTIONS_BY_KIND[each.kind] for each in quantities))


def raise_noise_of_fixes_to_reported(
    series: Sequence[SensorSeries], reports: Sequence[SourceReport]
) -> list[SensorSeries]:
    """Return the series, the positions with at least the noise and the slow error that reports say."""
    least = {
        r.source: r.sigma**2 + (r.slow_error.sigma**2 if r.slow_error.status is ParameterStatus.USED else 0.0)
        for r in reports
        if r.kind is Kind.POSITION and r.noise_origin != "message"
    }
    found = []
    for s in series:
        noise = s.noise.copy()
        if s.kind is Kind.POSITION and s.source in least:
            noise[:, ::2] = np.maximum(noise[:, ::2], least[s.source])
        found.append(replace(s, noise=noise))
    return found


def empty_series_of_quantities(
    prepared: Sequence[PreparedSeries], quantities: Collection[SourceQuantity]
) -> list[PreparedSeries]:
    """Return the series, those of some quantities without rows."""
    return [replace(p, series=emptied_series(p.series)) if quantity_of_series(p) in quantities else p for p in prepared]


def find_spoiling_sources(
    reports: Sequence[SourceReport],
    reports_without: Callable[[tuple[SourceQuantity, ...]], Sequence[SourceReport]],
    trusted: Collection[str] = (),
) -> tuple[SourceQuantity, ...]:
    """Return the quantities without which all misfit is gone and the others are predicted best; () if there are none.

    There are none, too, where the misfit goes with another source as well, and those in neither judge for that one, but
    nothing is gained by leaving it out: its noise is then large enough already.

    Args:
        trusted: Sources that are never left out.
    """
    is_misfit, in_doubt = bool(quantities_with_unusual_noise_or_error(reports)), quantities_in_doubt(reports)
    if not is_misfit and not in_doubt:
        return ()
    groups = quantity_groups_to_leave_out(reports, trusted)
    if not is_misfit:  # a receiver may err like that, too
        groups = [group for group in groups if can_third_source_judge(reports, group)]
    if any(r.latency.status is LatencyStatus.CONTRADICTS for r in reports):
        # A clock stamps all that a source measures. Without a part of it the latency is only measured worse.
        groups = [group for group in groups if _is_whole_source(group, reports)]
    found_without: dict[tuple[SourceQuantity, ...], Sequence[SourceReport]] = {}
    gains: dict[tuple[SourceQuantity, ...], float] = {}
    for group in groups:
        found = reports_without(group)
        if not _do_sources_agree_clearly(found) or (not is_misfit and quantities_in_doubt(found)):
            continue
        found_without[group] = found
        gains[group] = _log_likelihood_of_other_used_sources(found, group) - _log_likelihood_of_other_used_sources(
            reports, group
        )
    best = max(gains, key=gains.__getitem__, default=())
    best = max(gains, key=lambda group: _log_likelihood_advantage_as_culprit(group, best, found_without), default=())
    min_gain = MIN_LOG_LIKELIHOOD_GAIN_TO_LEAVE_OUT
    if len(gains) == 1 and in_doubt & {*best}:  # what was doubted before is the only one to explain it
        min_gain *= 0.5
    return best if best and gains[best] > min_gain else ()


def _log_likelihood_advantage_as_culprit(
    group: tuple[SourceQuantity, ...],
    other: tuple[SourceQuantity, ...],
    found_without: Mapping[tuple[SourceQuantity, ...], Sequence[SourceReport]],
) -> float:
    """Return by how much a group is the likelier culprit than another, as log-likelihood of the sources in neither.

    It is 0 for the other itself, and -1 where the advantage is too small. A wrong source is itself predicted best where
    the one that denies it is left out, so neither of both judges.
    """
    suspects = {*group, *other}
    advantage = _log_likelihood_of_other_used_sources(
        found_without[group], suspects
    ) - _log_likelihood_of_other_used_sources(found_without[other], suspects)
    return advantage if advantage > MIN_LOG_LIKELIHOOD_GAIN_TO_LEAVE_OUT else 0.0 if group == other else -1.0


def _do_sources_agree_clearly(reports: Sequence[SourceReport]) -> bool:
    """Whether the sources agree clearly: a wrong source is not replaced by errors that just raise no doubt."""
    is_like_scatter = all(
        is_sigma_explained_by_scatter(r.kind, r.sigma, r.scatter)
        for r in reports
        if r.n_used and r.noise_origin != "message"
    )
    return (
        is_like_scatter
        and not quantities_with_unusual_noise_or_error(reports)
        and not find_contradictions_of_drifting_fixes(reports, ())
    )


def _is_whole_source(group: Sequence[SourceQuantity], reports: Sequence[SourceReport]) -> bool:
    return all(SourceQuantity(r.source, r.kind) in group for r in reports if r.n_used and r.source == group[0].source)


def _log_likelihood_of_other_used_sources(
    reports: Sequence[SourceReport], left_out: Collection[SourceQuantity]
) -> float:
    return sum(
        r.log_likelihood
        for r in reports
        if r.kind not in KINDS_THAT_IMU_MEASURES_TOO and SourceQuantity(r.source, r.kind) not in left_out and r.n_used
    )


def contradiction_of_spoiling_sources(
    reports: Sequence[SourceReport], left_out: Sequence[SourceQuantity], prepared: Sequence[PreparedSeries]
) -> Contradiction:
    """Return the contradiction of what was left out against the position; its allies are those who can judge it.

    Args:
        reports: Those without it.
        left_out: What was left out.
        prepared: All series.
    """
    used = [SourceQuantity(r.source, r.kind) for r in reports if r.n_used and r.source != left_out[0].source]
    position = next(SourceQuantity(r.source, r.kind) for r in reports if r.n_used and r.kind is Kind.POSITION)
    who = left_out[0] if len(left_out) == 1 else SourceQuantity(left_out[0].source, Kind.IMU)
    if not can_third_source_judge(reports, left_out):
        what = "the fixes are smooth without it, and not with it"
        return Contradiction(who, position, what, left_out=tuple(left_out))
    own, fixes = (next(p.series for p in prepared if quantity_of_series(p) == each) for each in (left_out[0], position))
    angle_rad = constant_angle_to_course_rad(own, fixes) if own.kind is Kind.HEADING else math.nan
    if abs(angle_rad) > 0.0 and not any(each.kind in (Kind.HEADING, Kind.VELOCITY) for each in used):
        side = "left" if angle_rad > 0.0 else "right"
        what = f"it points {abs(math.degrees(angle_rad)):.1f} degrees to the {side} of the way of the fixes throughout"
        return Contradiction(who, position, what, left_out=tuple(left_out))
    allies = tuple(each for each in used if each.source != position.source)
    what = "the others agree without it, and not with it"
    return Contradiction(who, position, what, allies, tuple(left_out))


def constant_angle_to_course_rad(heading: SensorSeries, fixes: SensorSeries) -> float:
    """Return the angle from the course of the fixes to a heading where it is the same all along; else NaN, rad.

    A rate of turn does not judge such an angle: the map may be turned as well.
    """
    motions, _ = step_motions_and_edges_for_evidence([fixes, heading])
    if not motions:
        return math.nan
    course, own = motions
    with np.errstate(invalid="ignore"):
        rows = np.isfinite(own.angle_rad) & (course.speed_mps > MIN_COURSE_SPEED_MPS)
    difference = np.asarray(wrap_angle(own.angle_rad - course.angle_rad))[rows]
    if len(difference) < MIN_STEPS_OF_ONE_LENGTH:
        return math.nan
    middle = median_of_finite_values(difference)
    scatter = SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION * median_of_finite_values(np.abs(difference - middle))
    return middle if abs(middle) > MIN_CONSTANT_ANGLE_IN_SCATTERS * scatter else math.nan
