"""What `cwcli compare` prints and writes: tables for the terminal, Markdown, the content of `--json`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from cwcli.cli import markdown
from cwcli.cli.console import Console
from cwcli.cli.message_texts import describe_differences, differences_as_json
from cwcli.cli.tables import Cell, format_table
from cwcli.cli.text import (
    escape_control_characters,
    finite_or_none,
    format_count,
    format_interval,
    format_number,
    join_names,
)
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.headline import find_metric

if TYPE_CHECKING:
    from cwcli.fleet.message_changes import RunDifference
    from cwcli.fleet.results import RunMetrics
    from cwcli.metrics.compare import MetricChange, RunComparison
    from cwcli.report.addresses import WarningDifferences

Document = dict[str, Any]
MAX_LOGS_NAMED_IN_NOTE = 5
"""Largest number of logs that a note names; chosen by hand."""
METRIC_CHANGES_HEADINGS = (
    "verdict",
    "metric",
    "value before",
    "value after",
    "change",
    "95 % interval of the change",
    "logs compared",
)
"""Headings of the table of metrics."""

TEXT_BY_WARNING_CHANGE = {"new": "new", "other": "another verdict", "gone": "gone"}
"""Kind of change of a warning or conflict -> the word that the table shows."""


@dataclass(frozen=True)
class ComparedRuns:
    """Two runs and what differs between them.

    Attributes:
        before, after: The runs.
        comparison: Their metrics.
        failed: One line for each finding that `--fail-on` asks for.
        differing: Their warnings; None: they are not compared.
        is_exact: The differences are judged without statistics.
        messages: What differs between their messages; None: they are not compared.
    """

    before: RunMetrics
    after: RunMetrics
    comparison: RunComparison
    failed: Sequence[str]
    differing: WarningDifferences | None
    is_exact: bool
    messages: RunDifference | None = None

    @property
    def uncompared_logs(self) -> tuple[str, ...]:
        """Ids of the logs that are not in both runs, or failed in one or both."""
        runs = self.before, self.after
        scored = [{log.id for log in run.logs if not log.error} for run in runs]
        return tuple(dict.fromkeys(log.id for run in runs for log in run.logs if log.id not in scored[0] & scored[1]))

    @property
    def has_identical_messages(self) -> bool:
        """Whether every message, setting and warning of all logs of both runs was compared and is the same."""
        messages = self.messages
        return messages is not None and not (messages.differing or messages.unread or self.uncompared_logs)


def _changes_with_verdict_or_all(comparison: RunComparison, *, everything: bool) -> list[MetricChange]:
    return [change for change in comparison.changes if everything or change.verdict.value != "-"]


def print_comparison(console: Console, compared: ComparedRuns, *, everything: bool) -> None:
    comparison, differing = compared.comparison, compared.differing
    console.print_heading(
        f"{compared.before.source} -> {compared.after.source}: {format_count(comparison.n_pairs, 'log')} in both"
    )
    rows: list[tuple[Cell, ...]] = [
        (change.verdict.value, change.metric, change.baseline, change.candidate, *_metric_change_cells(change))
        for change in _changes_with_verdict_or_all(comparison, everything=everything)
    ]
    console.print_summary(
        format_table(*_drop_empty_columns(METRIC_CHANGES_HEADINGS, rows)) if rows else "  no metric is in both"
    )
    if differing is not None:
        console.print_summary("")
        console.print_summary("Warnings and conflicts that differ")
        rows = [
            (
                TEXT_BY_WARNING_CHANGE[each.change],
                escape_control_characters(each.words),
                escape_control_characters(each.address),
            )
            for each in differing.listed
        ]
        console.print_summary(
            format_table(("change", "warning or conflict", "address in the report"), rows) if rows else "  none"
        )
    for note in [*_comparison_notes(comparison, exact=compared.is_exact), *_unlisted_warning_notes(differing)]:
        console.print_note(note)
    if compared.messages is not None:
        console.print_summary("")
        for line in describe_differences(compared.messages, compared.uncompared_logs):
            console.print_summary(line)
    if compared.failed:
        console.print_summary("")
        console.print_summary("Failed")
        for line in compared.failed:
            console.print_summary(f"  {escape_control_characters(line)}")
    console.print_summary("")


def _drop_empty_columns(
    columns: Sequence[str], rows: Sequence[tuple[Cell, ...]]
) -> tuple[list[str], list[tuple[Cell, ...]]]:
    """Drop the columns of a table that are empty in all rows."""
    filled_columns = [k for k in range(len(columns)) if any(row[k] != "" for row in rows)]
    return [columns[k] for k in filled_columns], [tuple(row[k] for k in filled_columns) for row in rows]


def _metric_change_cells(change: MetricChange) -> tuple[Cell, ...]:
    """Format the cells of change, interval and number of logs."""
    if not math.isfinite(change.change):
        return "", "", change.n_pairs
    scale, unit = (100.0, " %") if change.is_relative else (1.0, "")
    text = f"{scale * change.change:+.3g}{unit}"
    metric = find_metric(change.metric)
    if metric is not None and metric.better == "near" and change.change:  # the sign is that of the distance
        side = "farther from" if change.change > 0.0 else "nearer to"
        text = f"{abs(change.change):.3g} {side} {metric.target:g}"
    return (
        text,
        format_interval(scale * change.low, scale * change.high),
        change.n_pairs,
    )


def _comparison_notes(comparison: RunComparison, *, exact: bool) -> list[str]:
    """Notes on logs that are too few, missing, failed, or made from another input."""
    from cwcli.metrics.pooling import MIN_LOGS_FOR_BOOTSTRAP

    notes = []
    if 0 < comparison.n_pairs < MIN_LOGS_FOR_BOOTSTRAP and not exact:
        notes.append(
            f"with {format_count(comparison.n_pairs, 'log')} chance cannot be excluded; --exact gives the "
            "verdict on these logs alone"
        )
    for names, what in (
        (comparison.only_baseline, "only in the baseline"),
        (comparison.only_candidate, "only in the candidate"),
        (comparison.failed, "failed in the candidate"),
        (comparison.other_input, "made from another input than in the baseline"),
    ):
        if names:
            notes.append(f"{format_count(len(names), 'log')} {what}: {join_first_names(names)}")
    return notes


def comparison_document(compared: ComparedRuns, written: Sequence[str]) -> Document:
    """Make the content of `--json`."""
    comparison, differing = compared.comparison, compared.differing
    changes: Document = {}
    if differing is not None:
        listed = [{"change": each.change, "what": each.words, "address": each.address} for each in differing.listed]
        changes = {
            "warnings": {
                "listed": listed,
                "count": differing.n,
                "logs": differing.n_logs,
                "logs_unread": list(differing.unread),
                "logs_left_out": differing.n_left_out,
            }
        }
    if compared.messages is not None:
        changes["messages"] = differences_as_json(compared.messages, is_identical=compared.has_identical_messages)
    return {
        "baseline": compared.before.source,
        "candidate": compared.after.source,
        "written": list(written),
        "pairs": comparison.n_pairs,
        "only_baseline": list(comparison.only_baseline),
        "only_candidate": list(comparison.only_candidate),
        "failed_in_candidate": list(comparison.failed),
        "other_input": list(comparison.other_input),
        "metrics": {
            change.metric: {
                "verdict": change.verdict.value,
                "unit": change.unit,
                "baseline": finite_or_none(change.baseline),
                "candidate": finite_or_none(change.candidate),
                "change": finite_or_none(change.change),
                "low": finite_or_none(change.low),
                "high": finite_or_none(change.high),
                "is_relative": change.is_relative,
                "p": finite_or_none(change.p),
                "pairs": change.n_pairs,
                "changed": change.n_changed,
                "missing": change.n_missing,
            }
            for change in comparison.changes
        },
        "failed": list(compared.failed),
        **changes,
    }


def _unlisted_warning_notes(differing: WarningDifferences | None) -> list[str]:
    """Notes on differing warnings that are not listed, and on logs whose warnings were not compared."""
    if differing is None:
        return []
    notes = []
    if len(differing.listed) < differing.n:
        notes.append(f"{len(differing.listed)} of the {differing.n} warnings and conflicts that differ are listed")
    if differing.unread:
        notes.append(
            f"warnings are not compared of {format_count(len(differing.unread), 'log')} that failed or whose "
            "annotated log "
            f"can't be read: {join_first_names(differing.unread)}"
        )
    if differing.n_left_out:
        n_read = differing.n_logs + len(differing.unread)
        notes.append(f"warnings are compared of the first {n_read} of {n_read + differing.n_left_out} logs in both")
    return notes


def join_first_names(names: Sequence[str]) -> str:
    """Join the first names to a text, with "others" for the rest."""
    return join_names([*names[:MAX_LOGS_NAMED_IN_NOTE], *(["others"] if len(names) > MAX_LOGS_NAMED_IN_NOTE else [])])


def format_markdown_summary(compared: ComparedRuns) -> str:
    """Format the summary for a CI job's page: changed metrics first, the others folded."""
    comparison, differing = compared.comparison, compared.differing
    judged = _changes_with_verdict_or_all(comparison, everything=False)
    noteworthy = [change for change in judged if change.verdict.value not in {"same", "new"}]
    counts = {
        verdict: sum(c.verdict.value == verdict for c in judged)
        for verdict in dict.fromkeys(("worse", "improved", "missing", "unclear", "same"))
    }
    heading = ", ".join(f"{n} {verdict}" for verdict, n in counts.items() if n) or "nothing to compare"
    parts = [
        f"### cwcli compare: {heading}",
        f"{markdown.format_code(compared.before.source)} to {markdown.format_code(compared.after.source)}, "
        f"{format_count(comparison.n_pairs, 'log')} in both",
    ]
    if noteworthy:
        parts.append(_format_markdown_table_of_changes(noteworthy))
    rest = [change for change in judged if change not in noteworthy]
    if rest:
        summary = f"<details><summary>{format_count(len(rest), 'metric')} the same</summary>"
        parts += [summary, _format_markdown_table_of_changes(rest), "</details>"]
    if differing is not None and differing.listed:
        lines = [
            f"- {TEXT_BY_WARNING_CHANGE[each.change]}: "
            + (
                f"[{markdown.format_code(each.words)}]({each.address})"
                if each.address
                else markdown.format_code(each.words)
            )
            for each in differing.listed
        ]
        parts.append("\n".join(["Warnings and conflicts that differ:", "", *lines]))
    if compared.messages is not None:
        title, *lines = describe_differences(compared.messages, compared.uncompared_logs)
        items = [f"{'  ' * line.startswith(' ')}- {markdown.format_code(line.strip())}" for line in lines]
        parts.append("\n".join([f"{title}:", "", *items]))
    parts += [
        f"- {markdown.format_code(note)}"
        for note in [*_comparison_notes(comparison, exact=compared.is_exact), *_unlisted_warning_notes(differing)]
    ]
    if compared.failed:
        parts.append("\n".join(["Failed:", "", *(f"- {markdown.format_code(line)}" for line in compared.failed)]))
    return "\n\n".join(parts) + "\n"


def format_comment(compared: ComparedRuns, *, tolerance: float) -> str:
    """Format the comment for a pull request: the summary, then log by log."""
    from cwcli.cli.comment import format_comment as format_comment_of_logs
    from cwcli.metrics.log_changes import rank_log_changes

    logs = rank_log_changes(compared.before.logs, compared.after.logs, tolerance=tolerance)
    return format_comment_of_logs(format_markdown_summary(compared), logs, compared.comparison.n_pairs)


def _format_markdown_table_of_changes(changes: Sequence[MetricChange]) -> str:
    rows: list[tuple[Cell, ...]] = [
        (
            change.verdict.value,
            markdown.format_code(change.metric),
            format_number(change.baseline),
            format_number(change.candidate),
            *_metric_change_cells(change),
        )
        for change in changes
    ]
    return markdown.format_markdown_table(*_drop_empty_columns(METRIC_CHANGES_HEADINGS, rows))
