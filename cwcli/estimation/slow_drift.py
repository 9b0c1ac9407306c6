"""Fixes that drift off: a slow error that becomes far larger in the log than its own sigma.

Sigma and time constant of a slow error are fitted to the whole log. A drift of some minutes in an otherwise good log
hardly changes them, but the smoothed error then is many sigma large. How much of it belongs to the fixes, and how much
to the speed and the heading that it was found from, is not known: both are named, and the covariance of the states has
to hold it. The velocity of a receiver shows no drift, because it is smoothed: the way by it is metres off after turns.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from cwcli.estimation.contradiction import Contradiction, SourceQuantity
from cwcli.estimation.limit_check import reference_quantity_of_comparison
from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import N_MOTION_STATES, SensorSeries
from cwcli.estimation.result import SourceReport
from cwcli.estimation.step_evidence import MIN_COURSE_SPEED_MPS
from cwcli.signals.columns import FloatArray, StateCovariance, median_of_values
from cwcli.signals.vehicle_state import HEADING, SPEED, X, Y

MAX_SLOW_ERROR_SIGMAS_WITHOUT_DRIFT = 4.5
"""Greatest value of a slow error in its sigmas that is no drift. A Gaussian error exceeds it on one of two axes once in
73,000 independent values; an hour with a time constant of 10 s has 720."""
MIN_DRIFT_M = 3.3
"""Least drift on one axis, m: one sigma of what the GPS Standard Positioning Service (2020) promises (8 m in 95 %)."""

COMPARED_CHANGE_DURATIONS_S = (2.0, 5.0)
"""Times over which changes of a slow error are compared, s. Chosen by hand: a car keeps its direction for as long."""
MIN_COMPARED_DRIVE_S = 60.0
"""Least time of driving, s: of 12 changes over 5 s the ratio has a sigma of 0.3. Chosen by hand; not fitted."""


def largest_slow_position_error_or_nan_m(s: SensorSeries, state: FloatArray) -> float:
    """Return the largest absolute slow error of a position in the states (m, n) of the filter, m; NaN without one."""
    if s.kind is not Kind.POSITION or s.slow_state < 0:
        return float("nan")
    error_m = np.abs(state[:, s.slow_state : s.slow_state + 2])
    return float(np.max(error_m, where=np.isfinite(error_m), initial=0.0))


def slow_changes_along_to_across_or_nan(s: SensorSeries, time_s: FloatArray, state: FloatArray) -> float:
    """Return how much more the slow error of a position changes along the way than across it; NaN where unknown.

    A receiver knows nothing of the way, so its errors have no preference. One along the way is that of a speed.

    Args:
        s: The position.
        time_s, state: Times (m,) and states (m, n) of the filter.
    """
    if s.kind is not Kind.POSITION or s.slow_state < 0 or len(time_s) < 2:
        return math.nan
    step_s = median_of_values(np.diff(time_s))
    error_m, ratios = state[:, s.slow_state : s.slow_state + 2], []
    for duration_s in COMPARED_CHANGE_DURATIONS_S:
        n = round(duration_s / step_s) if step_s > 0.0 else 0
        middle = state[n // 2 : n // 2 + len(state) - n]
        if not 0 < n < len(state):
            return math.nan
        change_m = error_m[n:] - error_m[:-n]
        rows = (np.abs(middle[:, SPEED]) > MIN_COURSE_SPEED_MPS) & np.isfinite(change_m).all(axis=1)
        if rows.sum() * step_s < MIN_COMPARED_DRIVE_S:
            return math.nan
        turned = change_m[rows] @ [1.0, 1j] * np.exp(-1j * middle[rows, HEADING])
        ratios.append(float(turned.real.std() / max(turned.imag.std(), 1e-9)))
    return min(ratios)


def find_contradictions_of_drifting_fixes(
    reports: Sequence[SourceReport], known_contradictions: Sequence[Contradiction]
) -> list[Contradiction]:
    """Return contradictions of the positions that drift off the way by the other sources."""
    contradicted = {quantity for each in known_contradictions for quantity in (each.who, each.against)}
    found = []
    for report in _iter_reports_of_drifting_fixes(reports):
        who = SourceQuantity(report.source, report.kind)
        if who not in contradicted:
            what = f"its fixes drift up to {report.slow_error.largest:.0f} m off the way that the other sources show"
            found.append(Contradiction(who, reference_quantity_of_comparison(report, reports), what))
    return found


def covariance_from_fix_drifts(reports: Sequence[SourceReport]) -> StateCovariance:
    """Return the covariance (8, 8) that drifting fixes add to all states: the mean square of a wave of that height.

    It is 0 where another position does not drift.
    """
    added = np.zeros((N_MOTION_STATES, N_MOTION_STATES))
    drifts_m = [report.slow_error.largest for report in _iter_reports_of_drifting_fixes(reports)]
    if drifts_m and len(drifts_m) == sum(r.kind is Kind.POSITION and r.n_used > 0 for r in reports):
        added[X, X] = added[Y, Y] = 0.5 * min(drifts_m) ** 2
    return added


def _iter_reports_of_drifting_fixes(reports: Sequence[SourceReport]) -> Iterator[SourceReport]:
    """Yield the used positions whose slow error is far larger than its own sigma allows."""
    if any(r.kind is Kind.VELOCITY and r.n_used for r in reports):
        return
    for r in reports:
        limit_m = max(MAX_SLOW_ERROR_SIGMAS_WITHOUT_DRIFT * r.slow_error.sigma, MIN_DRIFT_M)
        if r.kind is Kind.POSITION and r.n_used and r.slow_error.largest > limit_m:
            yield r
