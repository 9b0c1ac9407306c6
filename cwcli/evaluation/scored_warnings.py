"""Score warnings against the actual motion: a verdict on each, the real conflicts, and counts of both."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from cwcli.evaluation.conflicts import (
    OUTCOME_MISSED,
    VERDICT_FALSE,
    VERDICT_LATE,
    VERDICT_TRUE,
    VERDICT_UNDECIDED,
    RealConflict,
    WarningVerdict,
    find_real_conflicts,
    judge_warning,
)
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.measures import MEASURES
from cwcli.measures.distances import GAP
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.metrics.table import ColumnSpec, Table, table_from_records
from cwcli.signals.units import NS_PER_S
from cwcli.warning.evaluate import FoundWarnings
from cwcli.warning.pair import PairEvaluation
from cwcli.warning.rows import WarningRows
from cwcli.warning.types import EventIdByPairAndEvent

NS_PER_H = 3600 * NS_PER_S
"""Nanoseconds in an hour."""


@dataclass(frozen=True)
class WarningScores:
    """Counts of warnings by verdict and of conflicts by outcome.

    Attributes:
        n_true, n_late, n_false, n_undecided: Warnings by verdict (`cwcli.evaluation.conflicts.Verdict`).
        n_conflicts, n_in_time, n_warned_late: Real conflicts; those whose first warning came before they began, and
            after it.
        lead_times_s: Lead times of the conflicts with a warning.
        host_hours: Length of the host's track.
    """

    n_true: int
    n_late: int
    n_false: int
    n_undecided: int
    n_conflicts: int
    n_in_time: int
    n_warned_late: int
    lead_times_s: tuple[float, ...]
    host_hours: float

    @property
    def n_warnings(self) -> int:
        """Number of warnings."""
        return self.n_true + self.n_late + self.n_false + self.n_undecided


def score_warning_verdicts(
    pairs: Iterable[Sequence[WarningVerdict]], *, n_conflicts: int, host_hours: float
) -> WarningScores:
    """Count the verdicts on the warnings of each pair, in order of time, and the outcomes of all conflicts."""
    kinds: list[str] = []
    first: list[str] = []
    leads: list[float] = []
    for verdicts in pairs:
        warned: set[int] = set()
        for verdict in verdicts:
            kinds.append(verdict.kind)
            if verdict.conflict_index >= 0 and verdict.conflict_index not in warned:
                warned.add(verdict.conflict_index)
                first.append(verdict.kind)
                leads.append(verdict.lead_time_s)
    return WarningScores(
        n_true=kinds.count(VERDICT_TRUE),
        n_late=kinds.count(VERDICT_LATE),
        n_false=kinds.count(VERDICT_FALSE),
        n_undecided=kinds.count(VERDICT_UNDECIDED),
        n_conflicts=n_conflicts,
        n_in_time=first.count(VERDICT_TRUE),
        n_warned_late=first.count(VERDICT_LATE),
        lead_times_s=tuple(leads),
        host_hours=host_hours,
    )


@dataclass(frozen=True)
class ScoredPair:
    """A pair with its actual motion, real conflicts and verdicts.

    Attributes:
        least_gaps_m: The least distance of the outlines in each conflict, m; negative where they overlapped: a crash.
    """

    evaluation: PairEvaluation
    actual: Pair
    conflicts: list[RealConflict]
    verdicts: list[WarningVerdict]
    least_gaps_m: list[float]


@dataclass(frozen=True)
class ScoredWarnings:
    """Warnings of one host against all others, scored by the actual motion.

    Attributes:
        events: One row per event (warning), with its verdict.
        conflicts: One row per real conflict, warned of or missed.
        pairs: One row per pair: counts of evaluations and criticality measures of the actual motion.
        series: One row per evaluation of a pair that came within reach.
        scores: One row: counts of true, false, late, undecided and missed.
    """

    rows: WarningRows
    events: Table
    conflicts: Table
    pairs: Table
    series: Table
    scores: Table
    counts: Mapping[str, int] = field(default_factory=dict)

    @property
    def tables(self) -> tuple[Table, ...]:
        """All tables, in the order of the output."""
        return (self.events, self.conflicts, self.pairs, self.series, self.scores)


def score_warnings(warnings: FoundWarnings, *, actual: Mapping[str, ActualTrack] | None = None) -> ScoredWarnings:
    """Score warnings against the actual motion.

    Args:
        actual: Vehicle id -> actual track; for missing ones `VehicleTrack.state` is used.
    """
    host, ids = warnings.host, warnings.event_ids
    pairs = [_score_pair(warnings, evaluation, actual or {}) for evaluation in warnings.pairs]
    hours = float(host.stamp_ns[-1] - host.stamp_ns[0]) / NS_PER_H if len(host.stamp_ns) else 0.0
    verdicts = {
        ids[at, k]: (verdict, pair.least_gaps_m[verdict.conflict_index] if verdict.conflict_index >= 0 else math.nan)
        for at, pair in enumerate(pairs)
        for k, verdict in enumerate(pair.verdicts)
    }
    scores = score_warning_verdicts(
        (pair.verdicts for pair in pairs), n_conflicts=sum(len(pair.conflicts) for pair in pairs), host_hours=hours
    )
    n_crashes = sum(gap_m <= 0.0 for pair in pairs for gap_m in pair.least_gaps_m)
    return ScoredWarnings(
        rows=warnings.rows,
        events=_add_verdict_and_least_gap_columns(
            warnings.events_table, [verdicts[number] for number in sorted(verdicts)]
        ),
        conflicts=_build_conflicts_table(pairs, ids, host_id=host.id),
        pairs=_build_pairs_table(pairs, host_id=host.id),
        series=warnings.evaluations_of_pairs_table,
        scores=_build_scores_table(scores, warnings.config.rule, warnings.n_withheld, n_crashes=n_crashes),
        counts=warnings.evaluation_counts_by_outcome,
    )


def _score_pair(warnings: FoundWarnings, evaluation: PairEvaluation, actual: Mapping[str, ActualTrack]) -> ScoredPair:
    """Score the warnings of one pair."""
    host, other, config = warnings.host, evaluation.other, warnings.config
    own = actual.get(host.id, ActualTrack(host.stamp_ns, host.state))
    theirs = actual.get(other.id, ActualTrack(other.stamp_ns, other.state))
    pair = Pair(own, theirs, host.length_and_width_m, other.length_and_width_m, config.max_gap_s)
    conflicts = find_real_conflicts(pair, config)
    known_ns = evaluation.known_ns
    verdicts = [
        judge_warning(int(known_ns[span.raised]), int(known_ns[span.last]), conflicts, pair, config)
        for span in evaluation.spans
    ]
    return ScoredPair(evaluation, pair, conflicts, verdicts, [_least_gap_m(pair, each) for each in conflicts])


def _least_gap_m(pair: Pair, conflict: RealConflict) -> float:
    """Return the least distance of the outlines in a conflict, m; NaN where it is not known."""
    rows = (pair.stamp_ns >= conflict.onset_ns) & (pair.stamp_ns <= conflict.end_ns)
    gap_m = pair.evaluate_measure(GAP)[rows]
    return float(np.min(gap_m[np.isfinite(gap_m)], initial=math.inf)) if np.isfinite(gap_m).any() else math.nan


def _add_verdict_and_least_gap_columns(events: Table, verdicts: Sequence[tuple[WarningVerdict, float]]) -> Table:
    """Add the verdicts, with the least gaps (m) of their conflicts, to the events, which are in order of their ids."""
    records = [
        {
            "verdict": verdict.kind,
            "lead_time_s": verdict.lead_time_s,
            "closest_stamp_ns": verdict.closest_ns,
            "closest_distance_m": verdict.closest_m,
            "least_gap_m": least_gap_m,
        }
        for verdict, least_gap_m in verdicts
    ]
    more = table_from_records(events.name, _VERDICT_COLUMNS, records)
    return replace(events, columns={**events.columns, **more.columns}, docs={**events.docs, **more.docs})


def _build_conflicts_table(pairs: Sequence[ScoredPair], ids: EventIdByPairAndEvent, *, host_id: str) -> Table:
    """Build a table with one row per real conflict: when, how near, and its first event (0: missed)."""
    rows: list[dict[str, Any]] = []
    for at, pair in enumerate(pairs):
        for index, conflict in enumerate(pair.conflicts):
            about = [which for which, verdict in enumerate(pair.verdicts) if verdict.conflict_index == index]
            verdict = pair.verdicts[about[0]] if about else None
            rows.append(
                {
                    "host_id": host_id,
                    "other_id": pair.evaluation.other.id,
                    "onset_stamp_ns": conflict.onset_ns,
                    "end_stamp_ns": conflict.end_ns,
                    "closest_stamp_ns": conflict.closest_ns,
                    "closest_distance_m": conflict.closest_m,
                    "least_gap_m": pair.least_gaps_m[index],
                    "event_id": ids[at, about[0]] if about else 0,
                    "lead_time_s": verdict.lead_time_s if verdict else float("nan"),
                    "outcome": verdict.kind if verdict else OUTCOME_MISSED,
                }
            )
    rows.sort(key=lambda row: (int(row["onset_stamp_ns"]), str(row["other_id"])))
    return table_from_records("conflicts", _CONFLICT_COLUMNS, rows)


def _build_pairs_table(pairs: Sequence[ScoredPair], *, host_id: str) -> Table:
    """Build a table with one row per pair: counts of evaluations, and the criticality of the actual motion."""
    measures = [measure for measure in MEASURES.values() if measure.with_warnings]
    rows: list[dict[str, Any]] = []
    for pair in pairs:
        own = pair.evaluation
        rows.append(
            {
                "host_id": host_id,
                "other_id": own.other.id,
                "n_evaluated": own.n_evaluated,
                "n_out_of_reach": own.n_out_of_reach,
                "n_unheard": own.n_without_message,
                "n_stale": own.n_stale,
                "n_beyond_path": own.n_beyond_path,
                "n_not_finite": own.n_not_finite,
                "n_withheld": own.n_withheld,
                "n_events": len(own.spans),
                "n_conflicts": len(pair.conflicts),
                **{measure.extreme_column_name: measure.most_critical_value(pair.actual) for measure in measures},
            }
        )
    of_measures = {measure.extreme_column_name: ColumnSpec(float, measure.note) for measure in measures}
    return table_from_records("pairs", _PAIR_COLUMNS | of_measures, rows)


def _build_scores_table(scores: WarningScores, rule: str, n_withheld: int, *, n_crashes: int) -> Table:
    """Build the table with one row of counts over all pairs; in `n_crashes` conflicts the outlines touched."""
    leads = scores.lead_times_s
    row = {
        "rule": rule,
        "n_events": scores.n_warnings,
        "n_true": scores.n_true,
        "n_late": scores.n_late,
        "n_false": scores.n_false,
        "n_undecided": scores.n_undecided,
        "n_withheld": n_withheld,
        "n_conflicts": scores.n_conflicts,
        "n_conflicts_warned": scores.n_in_time,
        "n_conflicts_late": scores.n_warned_late,
        "n_conflicts_missed": scores.n_conflicts - scores.n_in_time - scores.n_warned_late,
        "n_crashes": n_crashes,
        "lead_time_mean_s": float(np.mean(leads)) if leads else float("nan"),
        "lead_time_min_s": min(leads, default=float("nan")),
        "host_hours": scores.host_hours,
    }
    return table_from_records("scores", {name: ColumnSpec(type(value)) for name, value in row.items()}, [row])


_LEAST_GAP_COLUMN = ColumnSpec(
    float, "least distance of the outlines in the real conflict; 0 or less: they touched, a crash"
)
"""The column `least_gap_m` of the tables `events` and `conflicts`."""
_VERDICT_COLUMNS = {
    "verdict": ColumnSpec(str, "true, late, false or undecided; see docs/warning.md"),
    "lead_time_s": ColumnSpec(float, "onset of the real conflict minus the time of the warning"),
    "closest_stamp_ns": ColumnSpec(int, "real closest approach of the centres; -1: not known"),
    "closest_distance_m": ColumnSpec(float),
    "least_gap_m": _LEAST_GAP_COLUMN,
}
"""Columns that verdicts add to the table of events."""
_CONFLICT_COLUMNS = {
    "host_id": ColumnSpec(str),
    "other_id": ColumnSpec(str),
    "onset_stamp_ns": ColumnSpec(int),
    "end_stamp_ns": ColumnSpec(int),
    "closest_stamp_ns": ColumnSpec(int),
    "closest_distance_m": ColumnSpec(float),
    "least_gap_m": _LEAST_GAP_COLUMN,
    "event_id": ColumnSpec(int),
    "lead_time_s": ColumnSpec(float),
    "outcome": ColumnSpec(str),
}
"""Columns of the table `conflicts`."""
_PAIR_COLUMNS = {
    "host_id": ColumnSpec(str),
    "other_id": ColumnSpec(str),
    "n_evaluated": ColumnSpec(int),
    "n_out_of_reach": ColumnSpec(int),
    "n_unheard": ColumnSpec(int),
    "n_stale": ColumnSpec(int),
    "n_beyond_path": ColumnSpec(int),
    "n_not_finite": ColumnSpec(int),
    "n_withheld": ColumnSpec(int),
    "n_events": ColumnSpec(int),
    "n_conflicts": ColumnSpec(int),
}
"""Columns of the table `pairs`; the measures follow them."""
