"""`cwcli evaluate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cwcli.cli import markdown
from cwcli.cli.console import Console, stdout_or_file
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.runs import AllOption, GatesOption, MarkdownOption, PageAddressOption, SystemOption, TruthOption
from cwcli.cli.options.shared import ForceOption, MetricsOption
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written
from cwcli.cli.tables import Cell, table
from cwcli.cli.targets import check_outputs
from cwcli.cli.text import count, finite, interval, paragraph, printable
from cwcli.errors import EXIT_DONE, EXIT_GATE_FAILED, MissingSignalError

if TYPE_CHECKING:
    from cwcli.fleet.results import RunMetrics
    from cwcli.metrics.gates import Check, GateResult
    from cwcli.metrics.pooling import MetricRow
    from cwcli.report.addresses import Addresses

EXAMPLES = (
    "cwcli evaluate annotated.mcap",
    "cwcli evaluate out/ --gate 'ego.position_rmse_m < 0.5' --junit report.xml",
    "cwcli evaluate out/ --gate 'pooled(warnings.recall) >= 0.9' --markdown -",
    "cwcli evaluate annotated.mcap --topic warning=/adas/fcw:data==true",
)
"""Command lines at the end of the command's `--help`."""
BESIDE = ("metric", "the system", "cwcli", "states", "n")
"""Headings of the table of another system's metrics."""
MAX_SHOWN = 20
"""Failed logs, and failed checks of a gate, that the terminal shows; chosen by hand."""
MAX_IN_MARKDOWN = 200
"""Failed checks that the Markdown summary shows; chosen by hand."""

Document = dict[str, Any]

RunArgument = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE",
        show_default=False,
        help="Output folder of `cwcli run -d`, folder of annotated logs, or one annotated log; - is standard input.",
    ),
]


def command(
    source: RunArgument,
    talk: TalkOptions,
    truth: TruthOption = "auto",
    topics: SystemOption = None,
    gates: GatesOption = None,
    allow_missing: Annotated[
        bool,
        typer.Option("--allow-missing", help="A gate on a metric that a log does not have is skipped, not failed."),
    ] = False,
    junit: Annotated[
        str | None,
        typer.Option("--junit", metavar="FILE", show_default=False, help="Write the gates as JUnit XML here."),
    ] = None,
    markdown_file: MarkdownOption = None,
    report_at: PageAddressOption = None,
    metrics: MetricsOption = None,
    everything: AllOption = False,
    force: ForceOption = False,
) -> int:
    """Score what the stages made of one log or of many, and check gates.

    Errors against the truth where the log has one, consistency, prediction errors, warnings against the conflicts that
    really happened, lanes, tracks, and the quality of the data. --topic names another system's warnings, path or state
    in the log, which are scored in the same way and compared with cwcli's. Gates are those of --gate and those in the
    run's manifest. The exit code is 1 if a gate failed, and 4 where no stage has run and no gate asks for the data
    alone.
    """
    from cwcli.evaluation.system.topics import parse_system
    from cwcli.fleet.results import read_metrics
    from cwcli.metrics.gate_syntax import parse
    from cwcli.metrics.gates import check_gates
    from cwcli.metrics.pooling import QUALITY, pooled_rows, run_table
    from cwcli.metrics.table import write_table
    from cwcli.output import Together, write_file

    for gate in gates or ():
        parse(gate)
    system = parse_system(topics) if topics else None
    summary_file = stdout_or_file(markdown_file)
    addresses = None
    if report_at is not None:
        from cwcli.report.addresses import Addresses

        addresses = Addresses(source, report_at)
    targets = check_outputs([source], talk, metrics=metrics, texts=(junit, summary_file), force=force)
    with Progress(quiet=talk.quiet) as progress:
        progress.step(f"reading {source}")
        run = read_metrics(source, truth=truth, system=system, step=progress.step)
    results = check_gates(list(dict.fromkeys((*run.gates, *(gates or ())))), run.logs, allow_missing=allow_missing)
    pooled = pooled_rows([log for log in run.logs if not log.error])
    with Together() as together:
        if metrics is not None:
            write_table(run_table(run.logs), metrics, force=force, together=together)
        if junit is not None:
            from cwcli.cli.junit import junit_xml

            write_file(junit, junit_xml(results, addresses), force=force, together=together)
        if summary_file is not None:
            text = _markdown(run, pooled, results, addresses)
            write_file(summary_file, text.encode(), force=force, together=together)
    console = Console(quiet=talk.quiet, summary_to_stderr=summary_file == "-")
    if talk.json:
        console.document("evaluate", _document(run, truth, pooled, results, targets))
    else:
        _show(console, run, pooled, results, everything=everything)
        print_written(console, targets)
    if not results and pooled and all(name.startswith(QUALITY) for name in pooled):
        raise MissingSignalError(
            "no stage of cwcli has run on it, so there is nothing to score but the quality of its data",
            where=run.source,
            hint="run `cwcli run` first, or give gates on the data (--gate 'data.faults_count < 1')",
        )
    failed = [result for result in results if result.failed]
    for result in failed if talk.quiet else ():
        console.failure(f"gate failed: {result.gate} ({len(result.failed)} of {count(len(result.checks), 'check')})")
    return EXIT_GATE_FAILED if failed else EXIT_DONE


def _is_telling(name: str) -> bool:
    from cwcli.metrics.headline import metric_of

    metric = metric_of(name)
    return metric is not None and metric.is_compared


def _show(
    console: Console,
    run: RunMetrics,
    pooled: dict[str, MetricRow],
    results: Sequence[GateResult],
    *,
    everything: bool,
) -> None:
    done = [log for log in run.logs if not log.error]
    what = "Headline metrics" if run.is_one_log else f"Headline metrics, {count(len(done), 'log')} pooled"
    console.heading(f"{run.source}: {what}")
    shown = [row for name, row in pooled.items() if everything or _is_telling(name)]
    own = [row for row in shown if row.stage != "system"]
    console.summary(table(("metric", "value", "states", "95 % interval", "n"), [_metric_cells(row) for row in own]))
    if len(shown) < len(pooled):
        console.summary(f"and {len(pooled) - len(shown)} more with --all, --json or --metrics")
    beside = _beside(pooled)
    if beside:
        console.summary("")
        console.summary("The other system beside cwcli")
        console.summary(table(BESIDE, beside))
    for log in [log for log in run.logs if log.error][:MAX_SHOWN]:
        console.note(f"{log.id} failed: {log.error}")
    for note, ids in _notes(run).items():
        console.note(f"{ids[0] if len(ids) == 1 else count(len(ids), 'log')}: {note}")
    if not results:
        return
    console.summary("")
    console.summary("Gates")
    console.summary(table(("result", "gate", "checks", "failed"), [_gate_cells(result) for result in results]))
    for result in results:
        _show_failed(console, result)
    console.summary("")


def _beside(pooled: dict[str, MetricRow]) -> list[tuple[Cell, ...]]:
    """Table rows of another system's metrics, each with cwcli's own value."""
    from cwcli.metrics.beside import beside

    return [
        (name, row.value, "" if own is None else own.value, _short(row.states), row.n)
        for name, row, own in beside(pooled)
    ]


def _notes(run: RunMetrics) -> dict[str, list[str]]:
    """Collect the notes of all logs: note -> ids of the logs that have it."""
    notes: dict[str, list[str]] = {}
    for log in run.logs:
        for note in log.notes:
            notes.setdefault(note, []).append(log.id)
    return notes


def _metric_cells(row: MetricRow) -> tuple[Cell, ...]:
    return row.metric, row.value, _short(row.states), interval(row.low, row.high, 2), row.n


def _short(states: str) -> str:
    """Shorten `online vs truth` to `online/truth`, so that names of metrics are not wrapped."""
    return states.replace(" vs ", "/")


def _gate_cells(result: GateResult) -> tuple[Cell, ...]:
    return result.status.value, result.gate, len(result.checks), len(result.failed)


def _show_failed(console: Console, result: GateResult) -> None:
    if not result.failed:
        return
    console.summary("")
    console.summary(paragraph(printable(f"failed: {result.gate}"), rest="  "))
    for check in result.failed[:MAX_SHOWN]:
        console.summary(paragraph(printable(_words(check)), first="  ", rest="    "))
    if len(result.failed) > MAX_SHOWN:
        console.summary(f"  and {len(result.failed) - MAX_SHOWN} more")


def _words(check: Check) -> str:
    return f"{check.log}: {check.detail}" if check.log else check.detail


def _document(
    run: RunMetrics, truth: str, pooled: dict[str, MetricRow], results: Sequence[GateResult], written: Sequence[str]
) -> Document:
    """Make the content of `--json`."""
    return {
        "source": run.source,
        "truth": truth,
        "written": list(written),
        "logs": [
            {"id": log.id, "error": log.error or None, "metrics": _numbers(log.rows), "notes": list(log.notes)}
            for log in run.logs
        ],
        "pooled": _numbers(pooled),
        "gates": [
            {
                "gate": result.gate,
                "status": result.status.value,
                "checks": [{**asdict(check), "status": check.status.value} for check in result.checks],
            }
            for result in results
        ],
        "failed": sum(bool(result.failed) for result in results),
    }


def _numbers(rows: Any) -> Document:
    return {
        name: {
            "value": finite(row.value),
            "unit": row.unit,
            "states": row.states,
            "n": row.n,
            "low": finite(row.low),
            "high": finite(row.high),
        }
        for name, row in rows.items()
    }


def _markdown(
    run: RunMetrics, pooled: dict[str, MetricRow], results: Sequence[GateResult], addresses: Addresses | None
) -> str:
    """Format the summary for a CI job's page."""
    failed = [result for result in results if result.failed]
    n_failed_logs = sum(bool(log.error) for log in run.logs)
    verdict = "no gates" if not results else f"{len(failed)} of {count(len(results), 'gate')} failed"
    parts = [
        f"### cwcli evaluate: {verdict}",
        f"{markdown.code(run.source)}: {count(len(run.logs), 'log')}, {n_failed_logs} failed",
    ]
    if results:
        rows = [
            (
                result.status.value,
                markdown.code(result.gate),
                len(result.checks),
                len(result.failed),
            )
            for result in results
        ]
        parts.append(markdown.table(("result", "gate", "checks", "failed"), rows))
    checks = [(result, check) for result in failed for check in result.failed]
    if checks:
        cells = [
            (
                markdown.code(result.gate),
                markdown.code(check.log) if check.log else "all",
                "<br>".join((markdown.code(check.detail), *_links(addresses, result.gate, check))),
            )
            for result, check in checks[:MAX_IN_MARKDOWN]
        ]
        parts.append(markdown.table(("failed gate", "log", "because"), cells))
        if len(checks) > MAX_IN_MARKDOWN:
            parts.append(f"and {len(checks) - MAX_IN_MARKDOWN} more")
    shown = [row for name, row in pooled.items() if _is_telling(name)]
    metric_rows = [
        (
            markdown.code(row.metric),
            row.value,
            markdown.code(row.unit) if row.unit else "",
            row.states,
            interval(row.low, row.high),
            row.n,
        )
        for row in shown
    ]
    parts.append(
        markdown.table(("metric, all logs pooled", "value", "unit", "states", "95 % interval", "n"), metric_rows)
    )
    beside = [(markdown.code(str(name)), *cells) for name, *cells in _beside(pooled)]
    if beside:
        parts.append(markdown.table(BESIDE, beside))
    return "\n\n".join(parts) + "\n"


def _links(addresses: Addresses | None, gate: str, check: Check) -> list[str]:
    links = [] if addresses is None else addresses.of_check(gate, check)
    return [f"[{markdown.code(link.words)}]({link.address})" for link in links]
