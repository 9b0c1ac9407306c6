"""Evaluated pairs as rows of warnings and as tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cwcli.measures import MEASURES
from cwcli.metrics.table import ColumnDoc, Table, table_of
from cwcli.signals.columns import Int64Array, Strings, constant_strings
from cwcli.signals.units import NS_PER_S
from cwcli.warning.conflicts import FALSE, LATE, MISSED, TRUE, UNDECIDED
from cwcli.warning.pair import PairEvaluation, ScoredPair
from cwcli.warning.rows import CLEARED, HELD, RAISED, WarningRow, WarningRows, warning_rows

UNKNOWN_NS = -1


def number_events(pairs: Sequence[ScoredPair]) -> dict[tuple[int, int], int]:
    """(pair, event) -> event id: 1, 2, ... in order of time, then of the other's id."""
    found = [
        (int(pair.evaluation.stamp_ns[span.raised]), pair.evaluation.other.id, at, which)
        for at, pair in enumerate(pairs)
        for which, span in enumerate(pair.evaluation.spans)
    ]
    return {(at, which): number for number, (_, _, at, which) in enumerate(sorted(found), start=1)}


def rows_of(
    pairs: Sequence[ScoredPair],
    ids: dict[tuple[int, int], int],
    *,
    rule: str,
    host_id: str,
    clock_ns: Int64Array,
    clock_log_ns: Int64Array,
) -> WarningRows:
    """The life of the warnings: raised, held evaluations, cleared."""
    rows: list[WarningRow] = []
    for at, pair in enumerate(pairs):
        own = pair.evaluation
        for which, span in enumerate(own.spans):
            number = ids[at, which]
            for index in range(span.raised, span.last + 1):
                rows.append(_row(own, index, number, RAISED if index == span.raised else HELD))
            if span.cleared is not None:
                stamp, log = int(clock_ns[span.cleared]), int(clock_log_ns[span.cleared])
                text = f"warning {number} of {own.other.id} is over"
                rows.append(WarningRow(log, stamp, number, CLEARED, own.other.id, text))
    return warning_rows(rows, rule=rule, host_id=host_id)


def _row(own: PairEvaluation, index: int, number: int, state: int) -> WarningRow:
    time = float(own.decision.time_to_event_s[index])
    distance = float(own.decision.predicted_distance_m[index])
    ahead = f"in {time:.1f} s" if np.isfinite(time) else "near"
    return WarningRow(
        int(own.log_time_ns[index]),
        int(own.stamp_ns[index]),
        number,
        state,
        own.other.id,
        f"collision with {own.other.id} {ahead}, predicted distance {distance:.1f} m",
        time,
        distance,
        float(own.measures.ttc_s[index]),
        float(own.probability[index]),
        float(own.alert_probability[index]),
    )


def events_table(
    pairs: Sequence[ScoredPair], ids: dict[tuple[int, int], int], *, rule: str, host_id: str, clock_ns: Int64Array
) -> Table:
    """One row an event, in order of its id."""
    rows: list[dict[str, Any]] = []
    for at, pair in enumerate(pairs):
        own = pair.evaluation
        for which, (span, verdict) in enumerate(zip(own.spans, pair.verdicts, strict=True)):
            during = slice(span.raised, span.last + 1)
            raised, last = int(own.stamp_ns[span.raised]), int(own.stamp_ns[span.last])
            rows.append(
                {
                    "event_id": ids[at, which],
                    "rule": rule,
                    "host_id": host_id,
                    "other_id": own.other.id,
                    "raised_stamp_ns": raised,
                    "last_held_stamp_ns": last,
                    "cleared_stamp_ns": UNKNOWN_NS if span.cleared is None else int(clock_ns[span.cleared]),
                    "duration_s": (last - raised) / NS_PER_S,
                    "time_to_event_s": float(own.decision.time_to_event_s[span.raised]),
                    "predicted_distance_m": float(own.decision.predicted_distance_m[span.raised]),
                    "distance_m": float(own.measures.distance_m[span.raised]),
                    "ttc_s": float(own.measures.ttc_s[span.raised]),
                    "probability": float(own.probability[span.raised]),
                    "alert_probability": float(own.alert_probability[span.raised]),
                    "max_probability": float(np.nanmax(own.probability[during])),
                    "age_s": float(own.age_s[span.raised]),
                    "verdict": verdict.kind,
                    "lead_time_s": verdict.lead_time_s,
                    "closest_stamp_ns": verdict.closest_ns,
                    "closest_distance_m": verdict.closest_m,
                }
            )
    rows.sort(key=lambda row: int(row["event_id"]))
    return table_of("events", _EVENT_TYPES, rows, docs=_EVENT_DOCS)


def conflicts_table(pairs: Sequence[ScoredPair], ids: dict[tuple[int, int], int], *, host_id: str) -> Table:
    """One row a real conflict: when, how near, and the first event that was about it (0: missed)."""
    rows: list[dict[str, Any]] = []
    for at, pair in enumerate(pairs):
        for index, conflict in enumerate(pair.conflicts):
            about = [which for which, verdict in enumerate(pair.verdicts) if verdict.conflict == index]
            verdict = pair.verdicts[about[0]] if about else None
            rows.append(
                {
                    "host_id": host_id,
                    "other_id": pair.evaluation.other.id,
                    "onset_stamp_ns": conflict.onset_ns,
                    "end_stamp_ns": conflict.end_ns,
                    "closest_stamp_ns": conflict.closest_ns,
                    "closest_distance_m": conflict.closest_m,
                    "event_id": ids[at, about[0]] if about else 0,
                    "lead_time_s": verdict.lead_time_s if verdict else float("nan"),
                    "outcome": verdict.kind if verdict else MISSED,
                }
            )
    rows.sort(key=lambda row: (int(row["onset_stamp_ns"]), str(row["other_id"])))
    return table_of("conflicts", _CONFLICT_TYPES, rows)


def pairs_table(pairs: Sequence[ScoredPair], *, host_id: str) -> Table:
    """One row a pair: evaluations, and the criticality of what really happened."""
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
                "n_unheard": own.n_unheard,
                "n_stale": own.n_stale,
                "n_beyond_path": own.n_beyond,
                "n_not_finite": own.n_not_finite,
                "n_events": len(own.spans),
                "n_conflicts": len(pair.conflicts),
                **{measure.extreme_column: measure.extreme(pair.actual) for measure in measures},
            }
        )
    docs = {measure.extreme_column: ColumnDoc(doc=measure.note) for measure in measures if measure.note}
    return table_of("pairs", _PAIR_TYPES | {measure.extreme_column: float for measure in measures}, rows, docs=docs)


def series_table(pairs: Sequence[ScoredPair], *, host_id: str) -> Table:
    """One row an evaluation of a pair within reach."""
    owns = [pair.evaluation for pair in pairs]
    names = (
        "distance_m",
        "closing_mps",
        "ttc_s",
        "horizon_distance_m",
        "min_distance_m",
        "entry_s",
        "overlap_s",
        "hit_probability",
        "probability",
    )
    rename = {"min_distance_m": "min_predicted_distance_m", "horizon_distance_m": "predicted_distance_m"}
    total = sum(len(own.stamp_ns) for own in owns)

    def joined(parts: list[Any], dtype: Any) -> Any:
        return np.concatenate(parts) if parts else np.zeros(0, dtype)

    columns: dict[str, Any] = {
        "stamp_ns": joined([own.stamp_ns for own in owns], np.int64),
        "host_id": constant_strings(host_id, total),
        "other_id": Strings(
            joined([np.full(len(own.stamp_ns), at, np.int32) for at, own in enumerate(owns)], np.int32),
            tuple(own.other.id for own in owns),
        ),
        "age_s": joined([own.age_s for own in owns], np.float64),
    }
    for name in names:
        columns[rename.get(name, name)] = joined([getattr(own.measures, name) for own in owns], np.float64)
    columns["is_active"] = joined([_active(own) for own in owns], np.bool_)
    return Table("series", columns)


def _active(own: PairEvaluation) -> Any:
    active = np.zeros(len(own.stamp_ns), dtype=bool)
    for span in own.spans:
        active[span.raised : span.last + 1] = True
    return active


def scores_table(pairs: Sequence[ScoredPair], *, rule: str, hours: float) -> Table:
    """Counts over all pairs, in one row."""
    kinds = [verdict.kind for pair in pairs for verdict in pair.verdicts]
    warned: dict[tuple[int, int], str] = {}
    leads: list[float] = []
    for at, pair in enumerate(pairs):
        for verdict in pair.verdicts:
            if verdict.conflict >= 0 and (at, verdict.conflict) not in warned:
                warned[at, verdict.conflict] = verdict.kind
                leads.append(verdict.lead_time_s)
    n_conflicts = sum(len(pair.conflicts) for pair in pairs)
    row = {
        "rule": rule,
        "n_events": len(kinds),
        "n_true": kinds.count(TRUE),
        "n_late": kinds.count(LATE),
        "n_false": kinds.count(FALSE),
        "n_undecided": kinds.count(UNDECIDED),
        "n_conflicts": n_conflicts,
        "n_conflicts_warned": list(warned.values()).count(TRUE),
        "n_conflicts_late": list(warned.values()).count(LATE),
        "n_conflicts_missed": n_conflicts - len(warned),
        "lead_time_mean_s": float(np.mean(leads)) if leads else float("nan"),
        "lead_time_min_s": min(leads, default=float("nan")),
        "host_hours": hours,
    }
    return table_of("scores", {name: type(value) for name, value in row.items()}, [row])


_EVENT_TYPES: dict[str, type] = {
    "event_id": int,
    "rule": str,
    "host_id": str,
    "other_id": str,
    "raised_stamp_ns": int,
    "last_held_stamp_ns": int,
    "cleared_stamp_ns": int,
    "duration_s": float,
    "time_to_event_s": float,
    "predicted_distance_m": float,
    "distance_m": float,
    "ttc_s": float,
    "probability": float,
    "alert_probability": float,
    "max_probability": float,
    "age_s": float,
    "verdict": str,
    "lead_time_s": float,
    "closest_stamp_ns": int,
    "closest_distance_m": float,
}
_CONFLICT_TYPES: dict[str, type] = {
    "host_id": str,
    "other_id": str,
    "onset_stamp_ns": int,
    "end_stamp_ns": int,
    "closest_stamp_ns": int,
    "closest_distance_m": float,
    "event_id": int,
    "lead_time_s": float,
    "outcome": str,
}
_PAIR_TYPES: dict[str, type] = {
    "host_id": str,
    "other_id": str,
    "n_evaluated": int,
    "n_out_of_reach": int,
    "n_unheard": int,
    "n_stale": int,
    "n_beyond_path": int,
    "n_not_finite": int,
    "n_events": int,
    "n_conflicts": int,
}
_EVENT_DOCS = {
    "cleared_stamp_ns": ColumnDoc(doc="-1: still up at the end of the log"),
    "probability": ColumnDoc(doc="of a collision within the horizon, as the warning said when it was raised"),
    "alert_probability": ColumnDoc(
        doc="what the rule compared with its threshold when the warning was raised; NaN: it has no threshold"
    ),
    "verdict": ColumnDoc(doc="true, late, false or undecided; see docs/warning.md"),
    "lead_time_s": ColumnDoc(doc="onset of the real conflict minus the time of the warning"),
    "closest_stamp_ns": ColumnDoc(doc="real closest approach of the centres; -1: not known"),
    "age_s": ColumnDoc(doc="age of the remote state when the warning was raised"),
}
