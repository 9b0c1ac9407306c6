"""Another system in the report: its warnings with what became of them, and its scores beside cwcli's own."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

from cwcli.evaluation.happened import what_happened
from cwcli.evaluation.system.flag import read_flag
from cwcli.evaluation.system.topics import System
from cwcli.evaluation.system.warnings import judge_flag
from cwcli.logs.read.reader import Log
from cwcli.metrics.beside import beside
from cwcli.metrics.pooling import MetricRow
from cwcli.report.drive import Drive, JudgedSystem
from cwcli.report.story import SAID
from cwcli.report.tables import MAX_ROWS, value_text
from cwcli.report.views import TableView
from cwcli.signals.units import NS_PER_S
from cwcli.text import count, join_names, printable


def judged_system(log: Log, system: System | None) -> JudgedSystem | None:
    """Judge another system's warnings; None if none are named or nothing can judge them.

    Raises:
        UsageError: Its topic or its field is not there.
        MissingSignalError: Its topic is empty.
        DataError: None of its messages can be used.
    """
    if system is None or system.condition is None:
        return None
    system.require_topics(log)
    real = what_happened(log)
    if real is None:
        return None
    flag = read_flag(log, system.warning, system.condition)
    return JudgedSystem(system.warning, judge_flag(flag.spans(), real), flag.notes)


def system_sentences(drive: Drive) -> list[str]:
    """Format `The other system (/adas/fcw) gave 3 warnings: ... It warned of 2 of 2 conflicts, ...`."""
    if drive.system is None:
        return []
    topic, scores = printable(drive.system.topic), drive.system.found.scores
    if not scores.n_events:
        text = f"The other system ({topic}) gave no warning"
    else:
        kinds = Counter(each.kind for each in drive.system.found.judged)
        parts = join_names([f"{kinds[kind]} {said}" for kind, said in SAID.items() if kinds[kind]])
        text = f"The other system ({topic}) gave {count(scores.n_events, 'warning')}: {parts}"
    if not scores.n_conflicts:
        return [f"{text}."]
    n_warned = scores.n_in_time + scores.n_warned_late
    text += f". It warned of {n_warned} of {count(scores.n_conflicts, 'conflict')}"
    if scores.lead_times_s:
        text += f", on average {math.fsum(scores.lead_times_s) / len(scores.lead_times_s):.1f} s before it began"
    return [f"{text}."]


def system_tables(drive: Drive, metrics: Mapping[str, MetricRow]) -> list[TableView]:
    """Build the tables of another system: its metrics next to cwcli's, and its warnings."""
    tables = []
    rows = [
        (
            known,
            value_text(known, row.value),
            "-" if own is None else value_text(known, own.value),
            row.states,
            str(row.n),
        )
        for known, row, own in beside(metrics)
    ]
    if rows:
        columns = (("metric", False), ("the system", True), ("cwcli", True), ("states", False), ("samples", True))
        tables.append(TableView("The other system beside cwcli", columns, tuple(rows)))
    if drive.system is not None and drive.system.found.judged:
        tables.append(_warnings(drive, drive.system))
    return tables


def _warnings(drive: Drive, system: JudgedSystem) -> TableView:
    """Build the table of another system's warnings."""
    judged = system.found.judged
    rows = []
    for k, each in enumerate(judged[:MAX_ROWS], start=1):
        at, until = (f"{(stamp_ns - drive.start_ns) / NS_PER_S:.2f}" for stamp_ns in (each.raised_ns, each.last_ns))
        lead = f"{each.lead_time_s:.2f}" if math.isfinite(each.lead_time_s) else "-"
        about = printable(each.other_id)[:40] or "-"
        rows.append((str(k), at, until, SAID[each.kind], about, lead))
    columns = (
        ("warning", True),
        ("at [s]", True),
        ("until [s]", True),
        ("verdict", False),
        ("the conflict was with", False),
        ("lead [s]", True),
    )
    hint = f"the first {MAX_ROWS} of {len(judged)} are listed" if len(judged) > MAX_ROWS else ""
    return TableView(f"Warnings of {printable(system.topic)}", columns, tuple(rows), hint)
