"""`cwcli compare`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Annotated

from cwcli.cli.comparison_texts import (
    ComparedRuns,
    comparison_document,
    format_comment,
    format_markdown_summary,
    join_first_names,
    print_comparison,
)
from cwcli.cli.console import Console, replace_stdout_path_by_dash
from cwcli.cli.message_texts import describe_difference_of_log, describe_identical
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.runs import AllOption, GithubOption, MarkdownOption, TruthOption
from cwcli.cli.options.shared import ForceOption, MetricsOption
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written_files
from cwcli.cli.targets import check_outputs_and_list_file_names
from cwcli.cli.text import (
    format_count,
)
from cwcli.errors import EXIT_DONE, EXIT_GATE_FAILED, MissingSignalError, UsageError, hint_at_closest_or_all_known_names
from cwcli.lazy_dataclass import dataclass

if TYPE_CHECKING:
    from cwcli.fleet.message_changes import RunDifference
    from cwcli.fleet.results import RunMetrics
    from cwcli.metrics.compare import RunComparison
    from cwcli.report.addresses import WarningDifferences

EXAMPLES = (
    "cwcli compare baseline/ out/",
    "cwcli compare baseline/ out/ --fail-on worse --markdown compare.md",
    "cwcli compare old.mcap new.mcap --exact",
)
"""Command lines at the end of the command's `--help`."""
FAILING_VERDICTS = ("worse", "missing", "unclear")
"""Verdicts that `--fail-on` takes."""
PageOption = Annotated[
    str | None,
    typer.Option(
        "--report-at",
        metavar="PAGE",
        help="Address of the page that `cwcli report` writes for CANDIDATE: warnings and conflicts that are new, "
        "gone or judged differently are listed with links to it.",
    ),
]


@dataclass(frozen=True)
class JudgementOptions:
    """How the runs are compared, and what fails."""

    fail_on: Annotated[
        list[str],
        typer.Option(
            "--fail-on",
            metavar="VERDICT",
            help=f"Exit with 1 if a metric is this: {', '.join(FAILING_VERDICTS)}. Repeatable.",
        ),
    ] = field(default_factory=list)
    tolerance: Annotated[
        float,
        typer.Option("--tolerance", metavar="SHARE", help="Changes up to this count as the same, e.g. 0.01 for 1 %."),
    ] = 0.01
    exact: Annotated[
        bool,
        typer.Option("--exact", help="Use no statistics: any change on these logs beyond --tolerance counts."),
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
                    f"--fail-on {verdict} is not a verdict to fail on",
                    hint=hint_at_closest_or_all_known_names(verdict, FAILING_VERDICTS),
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
            help="Write a comment for a pull request here, the worst log first; - is standard output.",
        ),
    ] = None
    github: GithubOption = False
    report_at: PageOption = None
    metrics: MetricsOption = None
    everything: AllOption = False
    messages: Annotated[
        bool,
        typer.Option(
            "--messages",
            help="Compare the annotated logs message by message: which setting changed, the first channel that "
            "differs, and the warnings that appeared, vanished or moved.",
        ),
    ] = False
    report: Annotated[
        str | None,
        typer.Option(
            "--report",
            metavar="FILE",
            help="With --messages: write a page of the logs that differ, with both tracks and speeds overlaid.",
        ),
    ] = None
    fields: Annotated[
        str | None,
        typer.Option(
            "--fields",
            metavar="NAME=TOL,...",
            help="With --messages: differences of these fields up to the tolerance do not count, e.g. speed_mps=0.01.",
        ),
    ] = None
    force: ForceOption = False

    @property
    def tolerances(self) -> dict[str, float]:
        """The values of `--fields`.

        Raises:
            UsageError: One is malformed, or --messages is not asked for.
        """
        if self.fields is None:
            return {}
        if not self.messages:
            raise UsageError("--fields needs --messages")
        found: dict[str, float] = {}
        for entry in self.fields.split(","):
            name, sign, text = entry.strip().partition("=")
            try:
                tolerance = float(text)
            except ValueError:
                tolerance = math.nan
            if not (name and sign and 0.0 <= tolerance < math.inf):
                raise UsageError(f"--fields {entry.strip()}: expected NAME=TOLERANCE, for example speed_mps=0.01")
            found[name] = tolerance
        return found


def command(
    baseline: Annotated[str, typer.Argument(metavar="BASELINE", help="A run, as for `cwcli evaluate`.")],
    candidate: Annotated[str, typer.Argument(metavar="CANDIDATE", help="The run that is compared with it.")],
    talk: TalkOptions,
    judging: JudgementOptions,
    output: SummaryOptions,
) -> int:
    """Say what got better and what got worse between two runs over the same logs, and whether it could be chance.

    Logs are paired by their id. Each headline metric gets a verdict: improved, worse, same, unclear or missing. The
    probability that any metric is called improved or worse by chance is at most 2 %. The exit code is 4 where no stage
    has run on a log, and 2 where no log is in both. See docs/evaluation.md.
    """
    from cwcli.fleet.results import read_run_metrics
    from cwcli.metrics.compare import compare_runs

    judging.check()
    tolerances = output.tolerances
    pages = None
    if output.report_at is not None:
        from cwcli.report.addresses import PageAddresses, compare_warnings_of_runs

        pages = PageAddresses(baseline, output.report_at), PageAddresses(candidate, output.report_at)
    differing: WarningDifferences | None = None
    if output.report is not None and not output.messages:
        raise UsageError("--report needs --messages", hint="--report-at links to a page of `cwcli report`")
    summary_file = replace_stdout_path_by_dash(output.markdown_file)
    comment_file = replace_stdout_path_by_dash(output.comment)
    targets = check_outputs_and_list_file_names(
        [baseline, candidate],
        talk,
        metrics=output.metrics,
        texts=(summary_file, comment_file, output.report),
        force=output.force,
    )
    with Progress(quiet=talk.quiet) as progress:
        runs = []
        for source in (baseline, candidate):
            progress.begin_step(f"reading {source}")
            runs.append(read_run_metrics(source, truth=judging.truth, step=progress.begin_step))
        if pages is not None:
            progress.begin_step("comparing warnings")
            differing = compare_warnings_of_runs(*pages)
        found: RunDifference | None = None
        if output.messages:
            from cwcli.fleet.message_changes import compare_logs_of_runs

            found = compare_logs_of_runs(baseline, candidate, tolerances, progress.begin_step)
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
    compared = ComparedRuns(before, after, comparison, failed, differing, judging.exact, found)
    page = None if found is None or output.report is None else _comparison_page(baseline, candidate, found)
    _write_files(compared, output, (summary_file, comment_file), page, tolerance=judging.tolerance)
    console = Console(quiet=talk.quiet, summary_to_stderr="-" in (summary_file, comment_file))
    if talk.json:
        console.print_document("compare", comparison_document(compared, targets))
    else:
        if found is not None and compared.has_identical_messages and not failed:
            console.print_heading(describe_identical(found))
        else:
            print_comparison(console, compared, everything=output.everything)
        print_written_files(console, targets)
    if output.github:
        from cwcli.cli.github import annotations_of_changes

        console.print_annotations(annotations_of_changes(failed))
    return EXIT_GATE_FAILED if failed else EXIT_DONE


def _write_files(
    compared: ComparedRuns,
    output: SummaryOptions,
    texts: tuple[str | None, str | None],
    page: bytes | None,
    *,
    tolerance: float,
) -> None:
    """Write the table, the summary, the comment and the page that were asked for, together."""
    from cwcli.metrics.compare import comparison_table
    from cwcli.metrics.table import write_table
    from cwcli.output import AtomicGroup, write_file

    summary_file, comment_file = texts
    with AtomicGroup() as together:
        if output.metrics is not None:
            write_table(comparison_table(compared.comparison), output.metrics, force=output.force, together=together)
        if summary_file is not None:
            text = format_markdown_summary(compared)
            write_file(summary_file, text.encode(), force=output.force, together=together)
        if comment_file is not None:
            text = format_comment(compared, tolerance=tolerance)
            write_file(comment_file, text.encode(), force=output.force, together=together)
        if page is not None and output.report is not None:
            write_file(output.report, page, force=output.force, together=together)


def _comparison_page(baseline: str, candidate: str, found: RunDifference) -> bytes:
    """Build the page of the logs that differ."""
    from cwcli.logs.read.reader import Log
    from cwcli.report.comparison_page import DifferingLog, build_comparison_page

    logs = [
        DifferingLog(name, *found.paths[name], difference, describe_difference_of_log(difference))
        for name, difference in found.differing.items()
    ]
    return build_comparison_page(f"{baseline} and {candidate}", logs, found.n_logs, Log.open)


def _require_stage_results(run: RunMetrics) -> None:
    """Refuse a run of recorded logs that no stage has run on: only the quality of their data could be compared.

    Raises:
        MissingSignalError: No log of the run has a result of a stage.
    """
    from cwcli.metrics.pooling import DATA_METRIC_PREFIX

    scored = [log for log in run.logs if not log.error]
    if not scored or any(not name.startswith(DATA_METRIC_PREFIX) for log in scored for name in log.rows):
        return
    subject, target = ("it", "-o annotated.mcap") if run.is_one_log else ("any of its logs", "-d out/")
    logs = "LOG" if run.is_one_log else "logs/*.mcap"
    raise MissingSignalError(
        f"no stage of cwcli has run on {subject}, so there is nothing to compare",
        where=run.source,
        hint=f"run `cwcli run {logs} {target}` first, and compare its output",
    )


def _pair_single_logs(before: RunMetrics, after: RunMetrics) -> tuple[RunMetrics, RunMetrics]:
    """Give two single logs the same id, so that they are compared whatever their names."""
    from dataclasses import replace

    if before.is_one_log and after.is_one_log:
        return before, replace(after, logs=(replace(after.logs[0], id=before.logs[0].id),))
    return before, after


def _scored_log_ids_text(run: RunMetrics) -> str:
    """The first ids of the scored logs as text, or "none"."""
    return join_first_names([log.id for log in run.logs if not log.error]) or "none"


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
