"""`cwcli compare`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Annotated, Any

from cwcli.cli import markdown
from cwcli.cli.console import Console, normalise_stdout_name
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.runs import AllOption, GithubOption, MarkdownOption, TruthOption
from cwcli.cli.options.shared import ForceOption, MetricsOption
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written_files
from cwcli.cli.tables import Cell, format_table
from cwcli.cli.targets import check_output_files
from cwcli.cli.text import (
    escape_control_characters,
    finite_or_none,
    format_count,
    format_interval,
    format_number,
    join_names,
)
from cwcli.errors import EXIT_DONE, EXIT_GATE_FAILED, MissingSignalError, UsageError, names_hint
from cwcli.lazy_dataclass import dataclass

if TYPE_CHECKING:
    from cwcli.fleet.results import RunMetrics
    from cwcli.metrics.compare import MetricChange, RunComparison
    from cwcli.report.addresses import WarningDifferences

EXAMPLES = (
    "cwcli compare baseline/ out/",
    "cwcli compare baseline/ out/ --fail-on worse --markdown compare.md",
    "cwcli compare old.mcap new.mcap --exact",
)
"""Command lines at the end of the command's `--help`."""
FAILING_VERDICTS = ("worse", "missing", "unclear")
"""Verdicts that `--fail-on` takes."""
MAX_NAMED_LOGS = 5
"""Largest number of logs that a note names; chosen by hand."""
TABLE_HEADINGS = ("verdict", "metric", "before", "after", "change", "95 % interval", "logs")
"""Headings of the table of metrics."""

CHANGE_TEXT = {"new": "new", "other": "another verdict", "gone": "gone"}
"""Kind of change of a warning or conflict -> the word that the table shows."""
PageOption = Annotated[
    str | None,
    typer.Option(
        "--report-at",
        metavar="PAGE",
        show_default=False,
        help="Where the page that `cwcli report` makes of CANDIDATE will be found: with links to it the warnings and "
        "conflicts are listed that are new, gone or judged otherwise.",
    ),
]
Document = dict[str, Any]


@dataclass(frozen=True)
class JudgementOptions:
    """How the runs are compared, and what fails."""

    fail_on: Annotated[
        list[str],
        typer.Option(
            "--fail-on",
            metavar="VERDICT",
            show_default=False,
            help=f"Exit with 1 if a metric is this: {', '.join(FAILING_VERDICTS)}. Repeatable.",
        ),
    ] = field(default_factory=list)
    tolerance: Annotated[
        float,
        typer.Option("--tolerance", metavar="SHARE", help="Changes up to this count as the same, e.g. 0.01 for 1 %."),
    ] = 0.01
    exact: Annotated[
        bool,
        typer.Option(
            "--exact", help="No statistics: these logs are all that matters, and any change beyond --tolerance counts."
        ),
    ] = False
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Seed of the resampling.")] = 0
    truth: TruthOption = "auto"

    def check(self) -> None:
        """Check the values.

        Raises:
            UsageError: A verdict does not exist, or a number is out of its bounds.
        """
        for verdict in self.fail_on:
            if verdict not in FAILING_VERDICTS:
                raise UsageError(
                    f"--fail-on {verdict} is not a verdict to fail on", hint=names_hint(verdict, FAILING_VERDICTS)
                )
        if not 0.0 <= self.tolerance < 1.0:
            raise UsageError(f"--tolerance {self.tolerance:g} is not between 0 and 1")
        if self.seed < 0:
            raise UsageError(f"--seed {self.seed} is negative")


@dataclass(frozen=True)
class SummaryOptions:
    """What is written and printed."""

    markdown_file: MarkdownOption = None
    comment: Annotated[
        str | None,
        typer.Option(
            "--comment",
            metavar="FILE",
            show_default=False,
            help="Write a comment for a pull request here, the worst log first; - is standard output.",
        ),
    ] = None
    github: GithubOption = False
    report_at: PageOption = None
    metrics: MetricsOption = None
    everything: AllOption = False
    force: ForceOption = False


@dataclass(frozen=True)
class ComparedRuns:
    """Two runs and what differs between them.

    Attributes:
        before, after: The runs.
        comparison: Their metrics.
        failed: One line for each finding that `--fail-on` asks for.
        differing: Their warnings; None: they are not compared.
        is_exact: The differences are judged without statistics.
    """

    before: RunMetrics
    after: RunMetrics
    comparison: RunComparison
    failed: Sequence[str]
    differing: WarningDifferences | None
    is_exact: bool


def command(
    baseline: Annotated[
        str, typer.Argument(metavar="BASELINE", show_default=False, help="A run, as for `cwcli evaluate`.")
    ],
    candidate: Annotated[
        str, typer.Argument(metavar="CANDIDATE", show_default=False, help="The run that is compared with it.")
    ],
    talk: TalkOptions,
    judging: JudgementOptions,
    output: SummaryOptions,
) -> int:
    """Say what got better and what got worse between two runs over the same logs, and whether it could be chance.

    Logs are paired by their id. Each headline metric is called improved, worse, same, unclear or missing; the chance
    that any of them is called improved or worse without reason is at most 2 %. The exit code is 4 where no stage has
    run on a log, and 2 where no log is in both. See docs/evaluation.md.
    """
    from cwcli.fleet.results import read_run_metrics
    from cwcli.metrics.compare import compare_runs, comparison_table
    from cwcli.metrics.table import write_table
    from cwcli.output import AtomicGroup, write_file

    judging.check()
    pages = None
    if output.report_at is not None:
        from cwcli.report.addresses import PageAddresses, compare_warnings_of_runs

        pages = PageAddresses(baseline, output.report_at), PageAddresses(candidate, output.report_at)
    differing: WarningDifferences | None = None
    summary_file = normalise_stdout_name(output.markdown_file)
    comment_file = normalise_stdout_name(output.comment)
    targets = check_output_files(
        [baseline, candidate], talk, metrics=output.metrics, texts=(summary_file, comment_file), force=output.force
    )
    with Progress(quiet=talk.quiet) as progress:
        runs = []
        for source in (baseline, candidate):
            progress.begin_step(f"reading {source}")
            runs.append(read_run_metrics(source, truth=judging.truth, step=progress.begin_step))
        if pages is not None:
            progress.begin_step("comparing warnings")
            differing = compare_warnings_of_runs(*pages)
    for run in runs:
        _require_stage_results(run)
    before, after = _pair_single_logs(*runs)
    comparison = compare_runs(
        before.logs, after.logs, seed=judging.seed, tolerance=judging.tolerance, exact=judging.exact
    )
    if not comparison.n_pairs and not judging.fail_on:
        raise UsageError(
            f"{before.source} and {after.source} have no log in common, so nothing can be compared",
            hint=f"logs are paired by their id: {_scored_log_ids_text(before)} in the first, "
            f"{_scored_log_ids_text(after)} in the second",
        )
    failed = _failure_lines(comparison, judging.fail_on)
    compared = ComparedRuns(before, after, comparison, failed, differing, judging.exact)
    with AtomicGroup() as together:
        if output.metrics is not None:
            write_table(comparison_table(comparison), output.metrics, force=output.force, together=together)
        if summary_file is not None:
            text = _format_markdown_summary(compared)
            write_file(summary_file, text.encode(), force=output.force, together=together)
        if comment_file is not None:
            text = _format_comment(compared, tolerance=judging.tolerance)
            write_file(comment_file, text.encode(), force=output.force, together=together)
    console = Console(quiet=talk.quiet, summary_to_stderr="-" in (summary_file, comment_file))
    if talk.json:
        console.print_document("compare", _comparison_document(compared, targets))
    else:
        _print_comparison(console, compared, everything=output.everything)
        print_written_files(console, targets)
    if output.github:
        from cwcli.cli.github import annotations_of_changes

        console.print_annotations(annotations_of_changes(failed))
    return EXIT_GATE_FAILED if failed else EXIT_DONE


def _require_stage_results(run: RunMetrics) -> None:
    """Refuse a run of recorded logs that no stage has run on: only the quality of their data could be compared.

    Raises:
        MissingSignalError: No log of the run has a result of a stage.
    """
    from cwcli.metrics.pooling import QUALITY

    scored = [log for log in run.logs if not log.error]
    if not scored or any(not name.startswith(QUALITY) for log in scored for name in log.rows):
        return
    subject, target = ("it", "-o annotated.mcap") if run.is_one_log else ("any of its logs", "-d out/")
    logs = "LOG" if run.is_one_log else "logs/*.mcap"
    raise MissingSignalError(
        f"no stage of cwcli has run on {subject}, so there is nothing to compare",
        where=run.source,
        hint=f"run `cwcli run {logs} {target}` first, and compare what it writes",
    )


def _pair_single_logs(before: RunMetrics, after: RunMetrics) -> tuple[RunMetrics, RunMetrics]:
    """Give two single logs the same id, so that they are compared whatever their names."""
    from dataclasses import replace

    if before.is_one_log and after.is_one_log:
        return before, replace(after, logs=(replace(after.logs[0], id=before.logs[0].id),))
    return before, after


def _scored_log_ids_text(run: RunMetrics) -> str:
    """The first ids of the scored logs as text, or "none"."""
    return _join_first_names([log.id for log in run.logs if not log.error]) or "none"


def _failure_lines(comparison: RunComparison, fail_on: Sequence[str]) -> list[str]:
    """List one line for each finding that `--fail-on` asks for."""
    from cwcli.metrics.compare import ChangeVerdict

    found = [
        f"{verdict}: {change.metric}"
        for verdict in fail_on
        for change in comparison.changes_with_verdict(ChangeVerdict(verdict))
    ]
    if "missing" in fail_on:
        found += [
            f"missing: {change.metric} in {format_count(change.n_missing, 'log')}"
            for change in comparison.changes
            if change.n_missing and change.verdict not in (ChangeVerdict.MISSING, ChangeVerdict.NOT_JUDGED)
        ]
        found += [f"missing: log {name}" for name in (*comparison.only_baseline, *comparison.failed)]
    if not comparison.n_pairs:
        found.append("missing: no log is in both runs")
    return found if fail_on else []


def _judged_changes(comparison: RunComparison, *, everything: bool) -> list[MetricChange]:
    return [change for change in comparison.changes if everything or change.verdict.value != "-"]


def _print_comparison(console: Console, compared: ComparedRuns, *, everything: bool) -> None:
    comparison, differing = compared.comparison, compared.differing
    console.print_heading(
        f"{compared.before.source} -> {compared.after.source}: {format_count(comparison.n_pairs, 'log')} in both"
    )
    rows: list[tuple[Cell, ...]] = [
        (change.verdict.value, change.metric, change.baseline, change.candidate, *_change_cells(change))
        for change in _judged_changes(comparison, everything=everything)
    ]
    console.print_summary(
        format_table(*_drop_empty_columns(TABLE_HEADINGS, rows)) if rows else "  no metric is in both"
    )
    if differing is not None:
        console.print_summary("")
        console.print_summary("Warnings and conflicts that differ")
        rows = [
            (CHANGE_TEXT[each.change], escape_control_characters(each.words), escape_control_characters(each.address))
            for each in differing.listed
        ]
        console.print_summary(format_table(("what", "which", "where"), rows) if rows else "  none")
    for note in [*_comparison_notes(comparison, exact=compared.is_exact), *_unlisted_warning_notes(differing)]:
        console.print_note(note)
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
    kept = [k for k in range(len(columns)) if any(row[k] != "" for row in rows)]
    return [columns[k] for k in kept], [tuple(row[k] for k in kept) for row in rows]


def _change_cells(change: MetricChange) -> tuple[Cell, ...]:
    """Format the cells of change, interval and number of logs."""
    if not math.isfinite(change.change):
        return "", "", change.n_pairs
    scale, unit = (100.0, " %") if change.is_relative else (1.0, "")
    return (
        f"{scale * change.change:+.3g}{unit}",
        format_interval(scale * change.low, scale * change.high),
        change.n_pairs,
    )


def _comparison_notes(comparison: RunComparison, *, exact: bool) -> list[str]:
    """Notes on logs that are too few, missing, failed, or made from another input."""
    from cwcli.metrics.pooling import MIN_LOGS

    notes = []
    if 0 < comparison.n_pairs < MIN_LOGS and not exact:
        notes.append(
            f"with {format_count(comparison.n_pairs, 'log')} a change cannot be told from chance; --exact gives the "
            "verdict on these logs alone"
        )
    for names, what in (
        (comparison.only_baseline, "only in the baseline"),
        (comparison.only_candidate, "only in the candidate"),
        (comparison.failed, "failed in the candidate"),
        (comparison.other_input, "made from another input than in the baseline"),
    ):
        if names:
            notes.append(f"{format_count(len(names), 'log')} {what}: {_join_first_names(names)}")
    return notes


def _comparison_document(compared: ComparedRuns, written: Sequence[str]) -> Document:
    """Make the content of `--json`."""
    comparison, differing = compared.comparison, compared.differing
    told: Document = {}
    if differing is not None:
        listed = [{"change": each.change, "what": each.words, "address": each.address} for each in differing.listed]
        told = {
            "warnings": {
                "listed": listed,
                "count": differing.n,
                "logs": differing.n_logs,
                "logs_unread": list(differing.unread),
                "logs_left_out": differing.n_left_out,
            }
        }
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
        **told,
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
            f"can't be read: {_join_first_names(differing.unread)}"
        )
    if differing.n_left_out:
        n_read = differing.n_logs + len(differing.unread)
        notes.append(f"warnings are compared of the first {n_read} of {n_read + differing.n_left_out} logs in both")
    return notes


def _join_first_names(names: Sequence[str]) -> str:
    """Join the first names to a text, with "others" for the rest."""
    return join_names([*names[:MAX_NAMED_LOGS], *(["others"] if len(names) > MAX_NAMED_LOGS else [])])


def _format_markdown_summary(compared: ComparedRuns) -> str:
    """Format the summary for a CI job's page: changed metrics first, the others folded."""
    comparison, differing = compared.comparison, compared.differing
    judged = _judged_changes(comparison, everything=False)
    told = [change for change in judged if change.verdict.value not in {"same", "new"}]
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
    if told:
        parts.append(_format_markdown_table_of_changes(told))
    rest = [change for change in judged if change not in told]
    if rest:
        summary = f"<details><summary>{format_count(len(rest), 'metric')} the same</summary>"
        parts += [summary, _format_markdown_table_of_changes(rest), "</details>"]
    if differing is not None and differing.listed:
        lines = [
            f"- {CHANGE_TEXT[each.change]}: "
            + (
                f"[{markdown.format_code(each.words)}]({each.address})"
                if each.address
                else markdown.format_code(each.words)
            )
            for each in differing.listed
        ]
        parts.append("\n".join(["Warnings and conflicts that differ:", "", *lines]))
    parts += [
        f"- {markdown.format_code(note)}"
        for note in [*_comparison_notes(comparison, exact=compared.is_exact), *_unlisted_warning_notes(differing)]
    ]
    if compared.failed:
        parts.append("\n".join(["Failed:", "", *(f"- {markdown.format_code(line)}" for line in compared.failed)]))
    return "\n\n".join(parts) + "\n"


def _format_comment(compared: ComparedRuns, *, tolerance: float) -> str:
    """Format the comment for a pull request: the summary, then log by log."""
    from cwcli.cli.comment import format_comment
    from cwcli.metrics.log_changes import rank_log_changes

    logs = rank_log_changes(compared.before.logs, compared.after.logs, tolerance=tolerance)
    return format_comment(_format_markdown_summary(compared), logs, compared.comparison.n_pairs)


def _format_markdown_table_of_changes(changes: Sequence[MetricChange]) -> str:
    rows: list[tuple[Cell, ...]] = [
        (
            change.verdict.value,
            markdown.format_code(change.metric),
            format_number(change.baseline),
            format_number(change.candidate),
            *_change_cells(change),
        )
        for change in changes
    ]
    return markdown.format_markdown_table(*_drop_empty_columns(TABLE_HEADINGS, rows))
