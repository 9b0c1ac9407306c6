"""Another system in the report: its warnings with what became of them, and its scores beside cwcli's own."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

from cwcli.digest.drive import Drive, OtherSystemVerdicts
from cwcli.digest.story import VERDICT_PHRASES
from cwcli.evaluation.actual_outcomes import find_actual_outcomes
from cwcli.evaluation.system.flag import read_flag_from_topic
from cwcli.evaluation.system.warnings import judge_flag_warnings
from cwcli.evaluation.system_topics import OtherSystemTopics
from cwcli.logs.read.reader import Log
from cwcli.metrics.pooling import MetricRow
from cwcli.metrics.system_pairs import pair_other_system_metrics_with_own
from cwcli.report.tables import MAX_PAGE_TABLE_ROWS, format_metric_value
from cwcli.report.views import TableView
from cwcli.signals.units import NS_PER_S
from cwcli.text import escape_control_characters, format_count, join_names


def judge_warnings_of_other_system(log: Log, system: OtherSystemTopics | None) -> OtherSystemVerdicts | None:
    """Judge another system's warnings; None if none are named or nothing can judge them.

    Raises:
        UsageError: Its topic or its field is not there.
        MissingSignalError: Its topic is empty.
        DataError: None of its messages can be used.
    """
    if system is None or system.condition is None:
        return None
    system.require_topics_in_log(log)
    real = find_actual_outcomes(log)
    if real is None:
        return None
    flag = read_flag_from_topic(log, system.warning, system.condition)
    return OtherSystemVerdicts(system.warning, judge_flag_warnings(flag.warning_spans_ns(), real), flag.notes)


def other_system_sentences(drive: Drive) -> list[str]:
    """Format `The other system (/adas/fcw) gave 3 warnings: ... It warned of 2 of 2 conflicts, ...`."""
    if drive.other_system is None:
        return []
    topic, scores = escape_control_characters(drive.other_system.topic), drive.other_system.flag_scores.scores
    if not scores.n_warnings:
        text = f"The other system ({topic}) gave no warning"
    else:
        kinds = Counter(each.kind for each in drive.other_system.flag_scores.judged)
        parts = join_names([f"{kinds[kind]} {said}" for kind, said in VERDICT_PHRASES.items() if kinds[kind]])
        text = f"The other system ({topic}) gave {format_count(scores.n_warnings, 'warning')}: {parts}"
    if not scores.n_conflicts:
        return [f"{text}."]
    n_warned = scores.n_in_time + scores.n_warned_late
    text += f". It warned of {n_warned} of {format_count(scores.n_conflicts, 'conflict')}"
    if scores.lead_times_s:
        text += f", on average {math.fsum(scores.lead_times_s) / len(scores.lead_times_s):.1f} s before it began"
    return [f"{text}."]


def other_system_tables(drive: Drive, metrics: Mapping[str, MetricRow]) -> list[TableView]:
    """Build the tables of another system: its metrics next to cwcli's, and its warnings."""
    tables = []
    rows = [
        (
            known,
            format_metric_value(known, row.value),
            "-" if own is None else format_metric_value(known, own.value),
            row.states,
            str(row.n),
        )
        for known, row, own in pair_other_system_metrics_with_own(metrics)
    ]
    if rows:
        columns = (("metric", False), ("the system", True), ("cwcli", True), ("states", False), ("samples", True))
        tables.append(TableView("The other system and cwcli", columns, tuple(rows)))
    if drive.other_system is not None and drive.other_system.flag_scores.judged:
        tables.append(_other_system_warnings_table(drive, drive.other_system))
    return tables


def _other_system_warnings_table(drive: Drive, system: OtherSystemVerdicts) -> TableView:
    """Build the table of another system's warnings."""
    outcomes = system.flag_scores.judged
    rows = []
    for k, each in enumerate(outcomes[:MAX_PAGE_TABLE_ROWS], start=1):
        at, until = (f"{(stamp_ns - drive.start_ns) / NS_PER_S:.2f}" for stamp_ns in (each.raised_ns, each.last_ns))
        lead = f"{each.lead_time_s:.2f}" if math.isfinite(each.lead_time_s) else "-"
        about = escape_control_characters(each.other_id)[:40] or "-"
        rows.append((str(k), at, until, VERDICT_PHRASES[each.kind], about, lead))
    columns = (
        ("warning", True),
        ("at [s]", True),
        ("until [s]", True),
        ("verdict", False),
        ("the conflict was with", False),
        ("lead [s]", True),
    )
    hint = (
        f"the first {MAX_PAGE_TABLE_ROWS} of {len(outcomes)} are listed" if len(outcomes) > MAX_PAGE_TABLE_ROWS else ""
    )
    return TableView(f"Warnings of {escape_control_characters(system.topic)}", columns, tuple(rows), hint)
