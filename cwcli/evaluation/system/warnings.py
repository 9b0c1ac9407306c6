"""Verdicts on another system's warnings against the real conflicts.

A flag tells of danger but not from which vehicle. So each warning is compared with the conflicts with every vehicle. It
is assigned to the earliest one that fits by the limits of cwcli's own warnings
(`cwcli.evaluation.conflicts.judge_warning`). A
conflict counts as warned of if a warning fits it, even if that warning fits others too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.evaluation.actual_outcomes import ActualOutcomes
from cwcli.evaluation.conflicts import VERDICT_FALSE, VERDICT_LATE, VERDICT_TRUE, VERDICT_UNDECIDED, RealConflict
from cwcli.evaluation.scored_warnings import WarningScores
from cwcli.lazy_dataclass import dataclass
from cwcli.measures.pair import Pair
from cwcli.signals.columns import BoolArray, FirstAndLastNs, Int64Array
from cwcli.signals.units import NS_PER_S

NO_VEHICLE_ID = ""
"""Vehicle id of a warning without a conflict."""


@dataclass(frozen=True)
class JudgedFlagWarning:
    """Verdict on one warning of a flag.

    Attributes:
        raised_ns, last_ns: Times of the first and the last message in which it was set.
        kind: As in `cwcli.evaluation.conflicts.WarningVerdict`.
        other_id, conflict: Vehicle and conflict to which it is assigned, or `NO_VEHICLE_ID` and None.
        lead_time_s: From the warning to the beginning of the conflict; NaN without one.
    """

    raised_ns: int
    last_ns: int
    kind: str
    other_id: str = NO_VEHICLE_ID
    conflict: RealConflict | None = None
    lead_time_s: float = float("nan")


@dataclass(frozen=True)
class FlagScores:
    """Verdicts on a flag's warnings, and counts of warnings and conflicts."""

    judged: tuple[JudgedFlagWarning, ...]
    scores: WarningScores


def judge_flag_warnings(flag_spans_ns: Sequence[FirstAndLastNs], real: ActualOutcomes) -> FlagScores:
    """Judge warnings, in order of time, against all conflicts.

    Args:
        flag_spans_ns: Times (ns) of the first and the last message of each warning.
    """
    times = np.array(flag_spans_ns, np.int64).reshape(-1, 2)
    raised_ns, last_ns = times[:, 0], times[:, 1]
    n = len(times)
    best_onset = np.full(n, np.iinfo(np.int64).max)
    best: list[tuple[str, RealConflict] | None] = [None] * n
    first: list[str] = []
    leads: list[float] = []
    max_lead_ns = round(real.config.max_lead_s * NS_PER_S)
    for vehicle, conflicts in real.conflicts.items():
        is_free = np.ones(n, np.bool_)
        for conflict in conflicts:
            lead_ns = conflict.onset_ns - raised_ns
            fits = (raised_ns <= conflict.end_ns) & ((lead_ns <= max_lead_ns) | (conflict.onset_ns <= last_ns))
            own = np.flatnonzero(fits & is_free)  # a warning is about the first conflict with a vehicle
            is_free[own] = False
            if len(own):
                lead_s = int(lead_ns[own[0]]) / NS_PER_S
                first.append(VERDICT_TRUE if lead_s >= 0 else VERDICT_LATE)
                leads.append(lead_s)
            for k in own[conflict.onset_ns < best_onset[own]].tolist():
                best_onset[k], best[k] = conflict.onset_ns, (vehicle, conflict)
    is_known = _nearest_vehicle_stays_known_mask(raised_ns, real)
    outcomes = []
    for k, (raised, last) in enumerate(flag_spans_ns):
        about = best[k]
        if about is None:
            outcomes.append(JudgedFlagWarning(raised, last, VERDICT_FALSE if is_known[k] else VERDICT_UNDECIDED))
            continue
        lead = about[1].onset_ns - raised
        outcomes.append(
            JudgedFlagWarning(raised, last, VERDICT_TRUE if lead >= 0 else VERDICT_LATE, *about, lead / NS_PER_S)
        )
    kinds = [each.kind for each in outcomes]
    scores = WarningScores(
        n_true=kinds.count(VERDICT_TRUE),
        n_late=kinds.count(VERDICT_LATE),
        n_false=kinds.count(VERDICT_FALSE),
        n_undecided=kinds.count(VERDICT_UNDECIDED),
        n_conflicts=real.n_conflicts,
        n_in_time=first.count(VERDICT_TRUE),
        n_warned_late=first.count(VERDICT_LATE),
        lead_times_s=tuple(leads),
        host_hours=real.host_hours,
    )
    return FlagScores(tuple(outcomes), scores)


def _nearest_vehicle_stays_known_mask(raised_ns: Int64Array, real: ActualOutcomes) -> BoolArray:
    """Return a mask of the warnings whose nearest vehicle is known for as long as a conflict could follow.

    It is False where no vehicle is known at the warning.
    """
    horizon_ns = round(real.config.horizon_s * NS_PER_S)
    nearest_m = np.full(len(raised_ns), np.inf)
    is_known = np.zeros(len(raised_ns), np.bool_)
    for pair in real.pairs.values():
        distance_m = _next_known_distance_m(pair, raised_ns)
        nearer = distance_m < nearest_m  # NaN is not
        nearest_m[nearer] = distance_m[nearer]
        is_known[nearer] = _distance_known_without_gap_mask(pair, raised_ns[nearer], raised_ns[nearer] + horizon_ns)
    return is_known


def _next_known_distance_m(pair: Pair, at_ns: Int64Array) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return the distance (m) of the centres at the next known stamp; NaN where there is none within `max_gap_s`."""
    known = np.flatnonzero(np.isfinite(pair.distance_m))
    stamp_ns = pair.stamp_ns[known]
    after = np.searchsorted(stamp_ns, at_ns)
    out = np.full(len(at_ns), np.nan)
    inside = np.flatnonzero(after < len(known))
    inside = inside[stamp_ns[after[inside]] - at_ns[inside] <= pair.max_gap_s * NS_PER_S]
    out[inside] = pair.distance_m[known[after[inside]]]
    return out


def _distance_known_without_gap_mask(pair: Pair, begin_ns: Int64Array, end_ns: Int64Array) -> BoolArray:
    """Return a mask: the distance is known from begin to end without a gap; it must be known at the begin."""
    stamp_ns = pair.stamp_ns[np.isfinite(pair.distance_m)]
    gap_ns = pair.max_gap_s * NS_PER_S
    ends = np.append(np.flatnonzero(np.diff(stamp_ns) > gap_ns), len(stamp_ns) - 1)
    begin = np.searchsorted(stamp_ns, begin_ns)
    run_end = stamp_ns[ends[np.searchsorted(ends, begin)]] if len(begin) else begin_ns
    return np.asarray(end_ns - run_end <= gap_ns)
