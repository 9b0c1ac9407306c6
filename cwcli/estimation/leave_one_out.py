"""Find the source without which the others agree: the last check, after an estimate that shows a lasting misfit.

A wrong source that no comparison of steps shows, such as one that lags, drifts or has an offset, is taken up by the
noise and the slow errors of the others. Where these are larger than sensors have, the drive is estimated without each
source in turn. A source is left out if the misfit then is gone, and the others are predicted clearly better.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from cwcli.estimation.contradiction import Contradiction, SourceQuantity
from cwcli.estimation.fix_scatter import is_noise_beyond_scatter
from cwcli.estimation.limit_check import find_values_beyond_sensor_limits
from cwcli.estimation.measurements import RATE_KINDS, Kind
from cwcli.estimation.parameter import ParameterStatus
from cwcli.estimation.prepare import PreparedSeries
from cwcli.estimation.result import SourceReport
from cwcli.estimation.score import MIN_LIKELIHOOD_GAIN_PER_PARAMETER
from cwcli.estimation.source_vote import quantity_of_series, without_any_rows

MAX_USUAL_SLOW_ERROR_M = 2.5
"""Greatest sigma on each axis of a slow error of fixes that raises no doubt, m. The GPS Standard Positioning Service
(2020) promises 8 m in 95 % as the global average, 3.3 m on each axis; receivers are usually better. Chosen by hand."""
MAX_USUAL_GRADE_SIGMA_MPS2 = 0.6
"""Greatest sigma of gravity through the grade of the road that raises no doubt, m/s^2: a grade that scatters by 6 %."""
MIN_GAIN = 10.0 * MIN_LIKELIHOOD_GAIN_PER_PARAMETER
"""Least gain of log-likelihood of all other sources by which one is left out. Chosen: ten parameters, because all noise
is fitted anew and errors last."""


def misfits(reports: Sequence[SourceReport]) -> set[SourceQuantity]:
    """Return the quantities whose noise or slow error is larger than usual, or a constant beyond what sensors have."""
    found = {
        SourceQuantity(r.source, r.kind)
        for r in reports
        if r.n_used
        and (
            (r.noise_origin != "message" and is_noise_beyond_scatter(r.kind, r.sigma, r.scatter))
            or (r.slow_error.status is ParameterStatus.USED and r.slow_error.sigma > _usual_slow_error(r.kind))
        )
    }
    return found | {each.who for each in find_values_beyond_sensor_limits(reports)}


def _usual_slow_error(kind: Kind) -> float:
    return MAX_USUAL_GRADE_SIGMA_MPS2 if kind is Kind.ACCEL else MAX_USUAL_SLOW_ERROR_M


def candidate_groups(
    reports: Sequence[SourceReport], trusted: Collection[str] = ()
) -> list[tuple[SourceQuantity, ...]]:
    """Return what is left out in turn: each quantity but positions, and both of an IMU together."""
    single = [
        SourceQuantity(r.source, r.kind)
        for r in reports
        if r.n_used and r.kind is not Kind.POSITION and r.source not in trusted
    ]
    rates = {
        source: tuple(each for each in single if each.source == source and each.kind in RATE_KINDS)
        for source in dict.fromkeys(each.source for each in single)
    }
    return [*((each,) for each in single), *(both for both in rates.values() if len(both) > 1)]


def without_quantities(
    prepared: Sequence[PreparedSeries], quantities: Collection[SourceQuantity]
) -> list[PreparedSeries]:
    """Return the series, those of some quantities without rows."""
    return [
        replace(p, series=without_any_rows(p.series)) if quantity_of_series(p) in quantities else p for p in prepared
    ]


def find_spoiling_sources(
    reports: Sequence[SourceReport],
    reports_without: Callable[[tuple[SourceQuantity, ...]], Sequence[SourceReport]],
    trusted: Collection[str] = (),
) -> tuple[SourceQuantity, ...]:
    """Return the quantities without which all misfit is gone and the others are predicted best; () if there are none.

    Args:
        reports: Reports of the estimate with all sources.
        reports_without: Estimates without some quantities and returns the reports.
        trusted: Sources that are never left out.
    """
    if not misfits(reports):
        return ()
    best: tuple[SourceQuantity, ...] = ()
    best_gain = MIN_GAIN
    for group in candidate_groups(reports, trusted):
        found = reports_without(group)
        if misfits(found):
            continue
        gain = _log_likelihood_of_others(found, group) - _log_likelihood_of_others(reports, group)
        if gain > best_gain:
            best, best_gain = group, gain
    return best


def _log_likelihood_of_others(reports: Sequence[SourceReport], left_out: Collection[SourceQuantity]) -> float:
    return sum(
        r.log_likelihood
        for r in reports
        if r.kind not in RATE_KINDS and SourceQuantity(r.source, r.kind) not in left_out and r.n_used
    )


def contradiction_of_spoiling_sources(
    reports: Sequence[SourceReport], left_out: Sequence[SourceQuantity]
) -> Contradiction:
    """Return the contradiction of what was left out against the position."""
    others = [SourceQuantity(r.source, r.kind) for r in reports if r.n_used and r.source != left_out[0].source]
    position = next(each for each in others if each.kind is Kind.POSITION)
    who = left_out[0] if len(left_out) == 1 else SourceQuantity(left_out[0].source, Kind.IMU)
    allies = tuple(each for each in others if each.source != position.source)
    what = "the others agree without it, and not with it"
    return Contradiction(who, position, what, allies, tuple(left_out))
