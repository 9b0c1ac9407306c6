"""`cwcli evaluate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

from cwcli.cli import markdown
from cwcli.cli.console import Console, replace_stdout_path_by_dash
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.runs import (
    AllOption,
    GatesOption,
    GithubOption,
    MarkdownOption,
    PageAddressOption,
    SystemOption,
    TruthOption,
)
from cwcli.cli.options.shared import ForceOption, MetricsOption
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written_files
from cwcli.cli.tables import Cell, format_table
from cwcli.cli.targets import check_outputs_and_list_file_names
from cwcli.cli.text import escape_control_characters, finite_or_none, format_count, format_interval, wrap_paragraph
from cwcli.errors import EXIT_DONE, EXIT_GATE_FAILED, MissingSignalError
from cwcli.lazy_dataclass import dataclass

if TYPE_CHECKING:
    from cwcli.fleet.results import RunMetrics
    from cwcli.metrics.gates import GateCheck, GateResult
    from cwcli.metrics.pooling import MetricRow
    from cwcli.report.addresses import PageAddresses

EXAMPLES = (
    "cwcli evaluate annotated.mcap",
    "cwcli evaluate out/ --gate 'ego.position_rmse_m < 0.5' --junit report.xml",
    "cwcli evaluate out/ --gate 'pooled(warnings.recall) >= 0.9' --markdown -",
    "cwcli evaluate annotated.mcap --topic warning=/adas/fcw:data==true",
)
"""Command lines at the end of the command's `--help`."""
GATE_TABLE_HEADINGS = ("result", "gate", "number of checks", "failed checks")
"""Headings of the table of gates."""
OTHER_SYSTEM_METRICS_TABLE_HEADINGS = (
    "metric",
    "the other system",
    "cwcli",
    "states/reference",
    "samples of the other system",
)
"""Headings of the table of another system's metrics."""
MAX_SHOWN_FAILURES = 20
"""Greatest number of failed logs, and of failed checks of a gate, that the terminal shows. Chosen by hand."""
MAX_FAILED_CHECKS_IN_MARKDOWN_SUMMARY = 200
"""Greatest number of failed checks that the Markdown summary shows. Chosen by hand."""

Document = dict[str, Any]

RunArgument = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE",
        help="Output folder of `cwcli run -d`, annotated log or a folder of them, or a URL; - is standard input.",
    ),
]


@dataclass(frozen=True)
class JudgementOptions:
    """What the run is compared with, and the gates."""

    truth: TruthOption = "auto"
    topics: SystemOption = None
    gates: GatesOption = None
    allow_missing: Annotated[
        bool,
        typer.Option(
            "--allow-missing", help="Skip a gate on a metric that a log does not have, instead of failing it."
        ),
    ] = False


@dataclass(frozen=True)
class SummaryOptions:
    """What is written and printed."""

    junit: Annotated[str | None, typer.Option("--junit", metavar="FILE", help="Write the gates as JUnit XML here.")] = (
        None
    )
    markdown_file: MarkdownOption = None
    github: GithubOption = False
    report_at: PageAddressOption = None
    metrics: MetricsOption = None
    everything: AllOption = False
    force: ForceOption = False


def command(source: RunArgument, talk: TalkOptions, judging: JudgementOptions, output: SummaryOptions) -> int:
    """Score the results of the stages on one log or many, and check gates.

    The scores are errors against the truth (where the log has one), consistency, prediction errors, warnings against
    the conflicts that really happened, lanes, tracks, and the quality of the data. --topic names another system's
    warnings, path or state in the log, which are scored in the same way and compared with cwcli's. Gates are those of
    --gate and those in the run's manifest. The exit code is 1 if a gate failed, and 4 where no stage has run and no
    gate asks for the data alone.
    """
    from cwcli.evaluation.system_topics import parse_other_system_options
    from cwcli.fleet.results import read_run_metrics
    from cwcli.metrics.gate_syntax import parse_gate
    from cwcli.metrics.gates import check_gates
    from cwcli.metrics.pooling import DATA_METRIC_PREFIX, metrics_table_of_run, pool_all_metrics
    from cwcli.metrics.table import write_table
    from cwcli.output import AtomicGroup, write_file

    for gate in judging.gates or ():
        parse_gate(gate)
    system = parse_other_system_options(judging.topics) if judging.topics else None
    summary_file = replace_stdout_path_by_dash(output.markdown_file)
    addresses = None
    if output.report_at is not None:
        from cwcli.report.addresses import PageAddresses

        addresses = PageAddresses(source, output.report_at)
    targets = check_outputs_and_list_file_names(
        [source], talk, metrics=output.metrics, texts=(output.junit, summary_file), force=output.force
    )
    with Progress(quiet=talk.quiet) as progress:
        progress.begin_step(f"reading {source}")
        run = read_run_metrics(source, truth=judging.truth, system=system, step=progress.begin_step)
    gates = list(dict.fromkeys((*run.gates, *(judging.gates or ()))))
    results = check_gates(gates, run.logs, allow_missing=judging.allow_missing)
    pooled = pool_all_metrics([log for log in run.logs if not log.error])
    with AtomicGroup() as together:
        if output.metrics is not None:
            write_table(metrics_table_of_run(run.logs), output.metrics, force=output.force, together=together)
        if output.junit is not None:
            from cwcli.cli.junit import format_junit_xml

            run_s = {log.id: log.run_s for log in run.logs}
            write_file(output.junit, format_junit_xml(results, addresses, run_s), force=output.force, together=together)
        if summary_file is not None:
            text = _format_markdown_summary(run, pooled, results, addresses)
            write_file(summary_file, text.encode(), force=output.force, together=together)
    console = Console(quiet=talk.quiet, summary_to_stderr=summary_file == "-")
    if talk.json:
        console.print_document("evaluate", _evaluation_document(run, judging.truth, pooled, results, targets))
    else:
        _print_evaluation(console, run, pooled, results, everything=output.everything)
        print_written_files(console, targets)
    if not results and pooled and all(name.startswith(DATA_METRIC_PREFIX) for name in pooled):
        raise MissingSignalError(
            "no stage of cwcli has run on it, so there is nothing to score but the quality of its data",
            where=run.source,
            hint="run `cwcli run` first, or give gates on the data (--gate 'data.faults_count < 1')",
        )
    failed = [result for result in results if result.failed_checks]
    for result in failed if talk.quiet else ():
        console.print_failure(
            f"gate failed: {result.gate} ({len(result.failed_checks)} of {format_count(len(result.checks), 'check')})"
        )
    if output.github:
        from cwcli.cli.github import annotations_of_gates

        console.print_annotations(annotations_of_gates(run, results))
    return EXIT_GATE_FAILED if failed else EXIT_DONE


def _is_shown_by_default(name: str) -> bool:
    from cwcli.metrics.headline import find_metric

    metric = find_metric(name)
    return metric is not None and metric.is_compared


def _print_evaluation(
    console: Console,
    run: RunMetrics,
    pooled: dict[str, MetricRow],
    results: Sequence[GateResult],
    *,
    everything: bool,
) -> None:
    scored_logs = [log for log in run.logs if not log.error]
    what = "Headline metrics" if run.is_one_log else f"Headline metrics, {format_count(len(scored_logs), 'log')} pooled"
    console.print_heading(f"{run.source}: {what}")
    shown = [row for name, row in pooled.items() if everything or _is_shown_by_default(name)]
    own = [row for row in shown if row.stage != "system"]
    headings = ("metric", "value", "states/reference", "95 % interval", "samples")
    console.print_summary(format_table(headings, [_metric_cells(row) for row in own]))
    if len(shown) < len(pooled):
        console.print_summary(f"and {len(pooled) - len(shown)} more with --all, --json or --metrics")
    system_rows = _system_metric_rows(pooled)
    if system_rows:
        console.print_summary("")
        console.print_summary("The other system and cwcli")
        console.print_summary(format_table(OTHER_SYSTEM_METRICS_TABLE_HEADINGS, system_rows))
    for log in [log for log in run.logs if log.error][:MAX_SHOWN_FAILURES]:
        console.print_note(f"{log.id} failed: {log.error}")
    for note, ids in _log_ids_by_note(run).items():
        console.print_note(f"{ids[0] if len(ids) == 1 else format_count(len(ids), 'log')}: {note}")
    if not results:
        return
    console.print_summary("")
    console.print_summary("Gates")
    console.print_summary(format_table(GATE_TABLE_HEADINGS, [_gate_cells(result) for result in results]))
    for result in results:
        _print_failed_gate(console, result)
    console.print_summary("")


def _system_metric_rows(pooled: dict[str, MetricRow]) -> list[tuple[Cell, ...]]:
    """Table rows of another system's metrics, each with cwcli's own value."""
    from cwcli.metrics.system_pairs import pair_other_system_metrics_with_own

    return [
        (name, row.value, "" if own is None else own.value, _replace_vs_by_slash(row.states), row.n)
        for name, row, own in pair_other_system_metrics_with_own(pooled)
    ]


def _log_ids_by_note(run: RunMetrics) -> dict[str, list[str]]:
    """Collect the notes of all logs: note -> ids of the logs that have it."""
    notes: dict[str, list[str]] = {}
    for log in run.logs:
        for note in log.notes:
            notes.setdefault(note, []).append(log.id)
    return notes


def _metric_cells(row: MetricRow) -> tuple[Cell, ...]:
    return row.metric, row.value, _replace_vs_by_slash(row.states), format_interval(row.low, row.high, 2), row.n


def _replace_vs_by_slash(states: str) -> str:
    """Shorten `online vs truth` to `online/truth`, so that names of metrics are not wrapped."""
    return states.replace(" vs ", "/")


def _gate_cells(result: GateResult) -> tuple[Cell, ...]:
    return result.status.value, result.gate, len(result.checks), len(result.failed_checks)


def _print_failed_gate(console: Console, result: GateResult) -> None:
    if not result.failed_checks:
        return
    console.print_summary("")
    console.print_summary(wrap_paragraph(escape_control_characters(f"failed: {result.gate}"), rest="  "))
    for check in result.failed_checks[:MAX_SHOWN_FAILURES]:
        console.print_summary(
            wrap_paragraph(escape_control_characters(_format_gate_check(check)), first="  ", rest="    ")
        )
    if len(result.failed_checks) > MAX_SHOWN_FAILURES:
        console.print_summary(f"  and {len(result.failed_checks) - MAX_SHOWN_FAILURES} more")


def _format_gate_check(check: GateCheck) -> str:
    return f"{check.log}: {check.detail}" if check.log else check.detail


def _evaluation_document(
    run: RunMetrics, truth: str, pooled: dict[str, MetricRow], results: Sequence[GateResult], written: Sequence[str]
) -> Document:
    """Make the content of `--json`."""
    return {
        "source": run.source,
        "truth": truth,
        "written": list(written),
        "logs": [
            {"id": log.id, "error": log.error or None, "metrics": _metric_documents(log.rows), "notes": list(log.notes)}
            for log in run.logs
        ],
        "pooled": _metric_documents(pooled),
        "gates": [
            {
                "gate": result.gate,
                "status": result.status.value,
                "checks": [{**asdict(check), "status": check.status.value} for check in result.checks],
            }
            for result in results
        ],
        "failed": sum(bool(result.failed_checks) for result in results),
    }


def _metric_documents(rows: Any) -> Document:
    return {
        name: {
            "value": finite_or_none(row.value),
            "unit": row.unit,
            "states": row.states,
            "n": row.n,
            "low": finite_or_none(row.low),
            "high": finite_or_none(row.high),
        }
        for name, row in rows.items()
    }


def _format_markdown_summary(
    run: RunMetrics, pooled: dict[str, MetricRow], results: Sequence[GateResult], addresses: PageAddresses | None
) -> str:
    """Format the summary for a CI job's page."""
    failed = [result for result in results if result.failed_checks]
    n_failed_logs = sum(bool(log.error) for log in run.logs)
    verdict = "no gates" if not results else f"{len(failed)} of {format_count(len(results), 'gate')} failed"
    parts = [
        f"### cwcli evaluate: {verdict}",
        f"{markdown.format_code(run.source)}: {format_count(len(run.logs), 'log')}, {n_failed_logs} failed",
    ]
    if results:
        rows = [
            (
                result.status.value,
                markdown.format_code(result.gate),
                len(result.checks),
                len(result.failed_checks),
            )
            for result in results
        ]
        parts.append(markdown.format_markdown_table(GATE_TABLE_HEADINGS, rows))
    checks = [(result, check) for result in failed for check in result.failed_checks]
    if checks:
        cells = [
            (
                markdown.format_code(result.gate),
                markdown.format_code(check.log) if check.log else "all",
                "<br>".join((markdown.format_code(check.detail), *_warning_links(addresses, result.gate, check))),
            )
            for result, check in checks[:MAX_FAILED_CHECKS_IN_MARKDOWN_SUMMARY]
        ]
        parts.append(markdown.format_markdown_table(("failed gate", "log", "because"), cells))
        if len(checks) > MAX_FAILED_CHECKS_IN_MARKDOWN_SUMMARY:
            parts.append(f"and {len(checks) - MAX_FAILED_CHECKS_IN_MARKDOWN_SUMMARY} more")
    shown = [row for name, row in pooled.items() if _is_shown_by_default(name)]
    metric_rows = [
        (
            markdown.format_code(row.metric),
            row.value,
            markdown.format_code(row.unit) if row.unit else "",
            row.states,
            format_interval(row.low, row.high),
            row.n,
        )
        for row in shown
    ]
    parts.append(
        markdown.format_markdown_table(
            (
                "metric, all logs pooled",
                "value",
                "unit",
                "comparison",
                "95 % interval",
                "samples",
            ),
            metric_rows,
        )
    )
    system_rows = [(markdown.format_code(str(name)), *cells) for name, *cells in _system_metric_rows(pooled)]
    if system_rows:
        parts.append(markdown.format_markdown_table(OTHER_SYSTEM_METRICS_TABLE_HEADINGS, system_rows))
    return "\n\n".join(parts) + "\n"


def _warning_links(addresses: PageAddresses | None, gate: str, check: GateCheck) -> list[str]:
    links = [] if addresses is None else addresses.warning_and_conflict_links_of_check(gate, check)
    return [f"[{markdown.format_code(link.words)}]({link.address})" for link in links]
