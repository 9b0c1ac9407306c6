"""Build warning rows and tables from evaluated pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cwcli.metrics.table import ColumnSpec, Table, table_from_records
from cwcli.signals.columns import Strings, repeat_string
from cwcli.signals.units import NS_PER_S
from cwcli.warning.kinds import WarningKind
from cwcli.warning.pair import PairEvaluation
from cwcli.warning.rows import CLEARED, HELD, RAISED, WarningRow, WarningRows, build_warning_rows
from cwcli.warning.types import EventIdByPairAndEvent, VehicleTrack

NOT_CLEARED_NS = -1
"""Time of clearing of a warning that was still active at the end of the log."""


def event_id_by_pair_and_event(pairs: Sequence[PairEvaluation]) -> dict[tuple[int, int], int]:
    """Assign event ids 1, 2, ... in order of time, then of the other's id: (pair, event) -> id."""
    found = [
        (int(pair.stamp_ns[span.raised]), pair.other.id, at, which)
        for at, pair in enumerate(pairs)
        for which, span in enumerate(pair.spans)
    ]
    return {(at, which): number for number, (_, _, at, which) in enumerate(sorted(found), start=1)}


def warning_rows_of_pairs(
    pairs: Sequence[PairEvaluation],
    ids: EventIdByPairAndEvent,
    *,
    rule: str,
    clock: VehicleTrack,
    words: str,
) -> WarningRows:
    """The warnings' states over time: raised, held and cleared; `words` are those of the `Rule`."""
    rows: list[WarningRow] = []
    for at, own in enumerate(pairs):
        for which, span in enumerate(own.spans):
            number = ids[at, which]
            for index in range(span.raised, span.last + 1):
                rows.append(_make_warning_row(own, index, number, RAISED if index == span.raised else HELD, words))
            if span.cleared is not None:
                stamp, log = int(clock.stamp_ns[span.cleared]), int(clock.log_time_ns[span.cleared])
                known = int(clock.known_ns[span.cleared])
                text = f"warning {number} of {own.other.id} is over"
                rows.append(WarningRow(log, stamp, known, number, CLEARED, own.other.id, text))
    return build_warning_rows(rows, rule=rule, host_id=clock.id)


def _make_warning_row(pair: PairEvaluation, index: int, event_id: int, state: int, text_for_driver: str) -> WarningRow:
    """The row of a warning at one evaluation, with its text for the driver."""
    time = float(pair.decision.time_to_event_s[index])
    distance = float(pair.decision.predicted_distance_m[index])
    ahead = f"in {time:.1f} s" if np.isfinite(time) else "near"
    kind = WarningKind(pair.kinds[index])
    ahead = f"{kind.name_in_tables}, {ahead}" if kind else ahead
    return WarningRow(
        int(pair.log_time_ns[index]),
        int(pair.stamp_ns[index]),
        int(pair.known_ns[index]),
        event_id,
        state,
        pair.other.id,
        f"{text_for_driver.format(other=pair.other.id)} {ahead}, predicted distance {distance:.1f} m",
        time,
        distance,
        float(pair.measures.ttc_s[index]),
        float(pair.probability[index]),
        float(pair.alert_probability[index]),
    )


def warning_events_table(
    pairs: Sequence[PairEvaluation],
    ids: EventIdByPairAndEvent,
    *,
    rule: str,
    clock: VehicleTrack,
) -> Table:
    """The table with one row per event, in order of its id."""
    rows: list[dict[str, Any]] = []
    for at, own in enumerate(pairs):
        for which, span in enumerate(own.spans):
            during = slice(span.raised, span.last + 1)
            raised, last = int(own.known_ns[span.raised]), int(own.known_ns[span.last])
            rows.append(
                {
                    "event_id": ids[at, which],
                    "rule": rule,
                    "host_id": clock.id,
                    "other_id": own.other.id,
                    "raised_ns": raised,
                    "last_held_ns": last,
                    "cleared_ns": NOT_CLEARED_NS if span.cleared is None else int(clock.known_ns[span.cleared]),
                    "duration_s": (last - raised) / NS_PER_S,
                    "raised_stamp_ns": int(own.stamp_ns[span.raised]),
                    "last_held_stamp_ns": int(own.stamp_ns[span.last]),
                    "cleared_stamp_ns": NOT_CLEARED_NS if span.cleared is None else int(clock.stamp_ns[span.cleared]),
                    "time_to_event_s": float(own.decision.time_to_event_s[span.raised]),
                    "predicted_distance_m": float(own.decision.predicted_distance_m[span.raised]),
                    "distance_m": float(own.measures.distance_m[span.raised]),
                    "ttc_s": float(own.measures.ttc_s[span.raised]),
                    "probability": float(own.probability[span.raised]),
                    "alert_probability": float(own.alert_probability[span.raised]),
                    "max_probability": float(np.nanmax(own.probability[during])),
                    "age_s": float(own.age_s[span.raised]),
                    "kind": WarningKind(own.kinds[span.raised]).name_in_tables,
                }
            )
    rows.sort(key=lambda row: int(row["event_id"]))
    return table_from_records("events", _EVENT_COLUMNS, rows)


def evaluation_series_table(pairs: Sequence[PairEvaluation], *, host_id: str) -> Table:
    """The table with one row per evaluation of a pair within reach."""
    total = sum(len(own.stamp_ns) for own in pairs)

    def concatenate_or_empty(parts: list[Any], dtype: Any) -> Any:
        return np.concatenate(parts) if parts else np.zeros(0, dtype)

    columns: dict[str, Any] = {
        "stamp_ns": concatenate_or_empty([own.stamp_ns for own in pairs], np.int64),
        "host_id": repeat_string(host_id, total),
        "other_id": Strings(
            concatenate_or_empty([np.full(len(own.stamp_ns), at, np.int32) for at, own in enumerate(pairs)], np.int32),
            tuple(own.other.id for own in pairs),
        ),
        "age_s": concatenate_or_empty([own.age_s for own in pairs], np.float64),
    }
    for column, field in _MEASURE_FIELDS_BY_SERIES_COLUMN.items():
        columns[column] = concatenate_or_empty([getattr(own.measures, field) for own in pairs], np.float64)
    columns["is_withheld"] = concatenate_or_empty([own.is_withheld for own in pairs], np.bool_)
    columns["is_active"] = concatenate_or_empty([_is_warning_active_mask(own) for own in pairs], np.bool_)
    return Table("series", columns)


def _is_warning_active_mask(pair: PairEvaluation) -> Any:
    """Whether a warning is active at each evaluation, (m,)."""
    active = np.zeros(len(pair.stamp_ns), dtype=bool)
    for span in pair.spans:
        active[span.raised : span.last + 1] = True
    return active


_MEASURE_FIELDS_BY_SERIES_COLUMN = {
    **{name: name for name in ("distance_m", "closing_mps", "ttc_s")},
    "predicted_distance_m": "horizon_distance_m",
    "min_predicted_distance_m": "min_distance_m",
    **{name: name for name in ("entry_s", "overlap_s", "probability", "braked_probability")},
}
"""Columns of the table of evaluations, in order -> fields of `Measures`."""
_EVENT_COLUMNS = {
    "event_id": ColumnSpec(int),
    "rule": ColumnSpec(str),
    "host_id": ColumnSpec(str),
    "other_id": ColumnSpec(str),
    "raised_ns": ColumnSpec(int, "when the warning could be given; for states in hindsight their stamp"),
    "last_held_ns": ColumnSpec(int),
    "cleared_ns": ColumnSpec(int, "-1: still active at the end of the log"),
    "duration_s": ColumnSpec(float),
    "raised_stamp_ns": ColumnSpec(int, "stamp of the host's state at which it was raised"),
    "last_held_stamp_ns": ColumnSpec(int),
    "cleared_stamp_ns": ColumnSpec(int, "-1: still active at the end of the log"),
    "time_to_event_s": ColumnSpec(float),
    "predicted_distance_m": ColumnSpec(float),
    "distance_m": ColumnSpec(float),
    "ttc_s": ColumnSpec(float),
    "probability": ColumnSpec(float, "of a collision within the horizon, as stated when the warning was raised"),
    "alert_probability": ColumnSpec(
        float, "what the rule compared with its threshold when the warning was raised; NaN: it has no threshold"
    ),
    "max_probability": ColumnSpec(float),
    "age_s": ColumnSpec(float, "age of the remote state when the warning was raised"),
    "kind": ColumnSpec(str, "collision, from behind, beside lane or host stands; see docs/warning.md"),
}
"""Columns of the table of events, in order."""
