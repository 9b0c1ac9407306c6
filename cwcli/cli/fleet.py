"""Runs a pipeline over many logs, shows its progress, and prints its summary."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from cwcli.cli.console import Console, print_error
from cwcli.cli.digest import suggest_next_step
from cwcli.cli.options.configfile import RunTalkOptions
from cwcli.cli.progress import Progress
from cwcli.cli.tables import Cell, format_table
from cwcli.cli.text import DEFAULT_OUTPUT_WIDTH_COLUMNS, format_count, terminal_width
from cwcli.errors import CwcliError

if TYPE_CHECKING:
    from cwcli.fleet.plan import FleetPlan, LogTask
    from cwcli.fleet.run import FleetResult

REMOTE_STORE_RESULTS_HINT = "copy the folder to this machine for cwcli report, evaluate and compare"
"""Advice after a run into an object store, whose folders these commands do not read."""
MAX_PRINTED_ERRORS = 20
"""Largest number of errors that are printed; chosen by hand, the others are in the manifest."""


def run_on_many_logs(
    logs: Sequence[str],
    plan: FleetPlan,
    directory: str,
    jobs: int | None,
    ray: str | None,
    force: bool,
    talk: RunTalkOptions,
) -> int:
    """Run a pipeline on many logs and print the summary; returns the exit code.

    Raises:
        CwcliError: Nothing could be begun, or the output folder can't be written.
    """
    from cwcli.fleet.run import run_fleet

    console = Console(quiet=talk.quiet)
    with Progress(quiet=talk.quiet) as progress:
        progress.begin_step("looking for logs")
        unchanged: set[str] = set()

        def show_progress_of_log(task: LogTask | None, status: str, done: int, total: int) -> None:
            if task is None:
                progress.begin_step(f"running {format_count(total, 'log')}")
                return
            unchanged.update({task.id} if status == "unchanged" else ())
            progress.begin_step(f"{done} of {format_count(total, 'log')} done, the last {task.id} ({status})")
            progress(done, total, skipped=len(unchanged))

        fleet = run_fleet(logs, plan, directory, jobs=jobs, ray=ray, force=force, report=show_progress_of_log)
    if talk.json:
        console.print_document("run", fleet_document(fleet, directory))
    else:
        print_fleet_digest(console, fleet, directory)
        if talk.details:
            print_fleet_details(console, fleet)
    for gate in (each for each in fleet.earlier_gates if each not in plan.pipeline["gates"]):
        console.print_note(f"{shlex.join(('--gate', gate))} of the earlier run into this folder no longer holds")
    for error in distinct_errors(fleet.manifest["logs"]):
        print_error(error)
    return fleet.exit_code


def fleet_document(fleet: FleetResult, directory: str) -> dict[str, Any]:
    """Make the content of `--json`."""
    from cwcli.logs.read.remote import is_remote_url
    from cwcli.url import display_name_of_url

    statuses = list(fleet.statuses.values())
    return {
        "directory": display_name_of_url(directory) if is_remote_url(directory) else directory,
        "done": statuses.count("done"),
        "unchanged": statuses.count("unchanged"),
        "failed": statuses.count("failed"),
        "logs": [{**entry, "status": fleet.statuses[entry["id"]]} for entry in fleet.manifest["logs"]],
    }


def print_fleet_digest(console: Console, fleet: FleetResult, directory: str) -> None:
    """Print a line for each log, the worst first, and one on all of them."""
    from cwcli.digest.fleet import LogLine, format_fleet_lines
    from cwcli.logs.read.remote import is_remote_url
    from cwcli.url import display_name_of_url

    is_remote = is_remote_url(directory)
    folder = (display_name_of_url(directory) if is_remote else directory).rstrip("/")
    entries = fleet.manifest["logs"]
    logs = [LogLine.from_entry(entry, fleet.statuses[entry["id"]]) for entry in entries]
    next_step = REMOTE_STORE_RESULTS_HINT if is_remote else suggest_next_step("run", folder)
    console.print_heading(f"run: {format_count(len(entries), 'log')}; see {folder}/manifest.json")
    for line in format_fleet_lines(logs, next_step=next_step, width=terminal_width() or DEFAULT_OUTPUT_WIDTH_COLUMNS):
        console.print_summary(line)


def print_fleet_details(console: Console, fleet: FleetResult) -> None:
    """Print the table of logs, and notes on stages that were left out."""
    entries = fleet.manifest["logs"]
    rows: list[tuple[Cell, ...]] = [
        (
            entry["id"],
            fleet.statuses[entry["id"]],
            ", ".join(entry["stages"]) or "-",
            sum(each["read"] for each in entry["inputs"]),
            sum(sum(each["rejected"].values()) for each in entry["inputs"]),
            entry["tables"].get("events"),
        )
        for entry in entries
    ]
    console.print_summary("")
    console.print_summary(
        format_table(("log id", "status", "stages", "messages read", "messages rejected", "warnings"), rows)
    )
    console.print_summary("")
    for reason, ids in _log_ids_by_left_out_reason(entries).items():
        console.print_note(
            f"{reason} ({format_count(len(ids), 'log')}, {ids[0]}{' and others' if len(ids) > 1 else ''})"
        )


def distinct_errors(entries: Sequence[dict[str, Any]]) -> list[CwcliError]:
    """Collect the errors of failed logs: each error once, with the first log that has it."""
    failed: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for entry in entries:
        if error := entry["error"]:
            failed.setdefault((error["what"], error["hint"], *error["found"]), []).append(entry)
    errors_with_counts = []
    for (what, hint, *found), same in failed.items():
        source, where = same[0]["source"], same[0]["error"]["where"]
        place = where if where.startswith(source) else ": ".join(filter(None, (source, where)))
        others = f" (and {format_count(len(same) - 1, 'other log')})" if len(same) > 1 else ""
        errors_with_counts.append(CwcliError(f"{what}{others}", where=place, found=tuple(found), hint=hint))
    if len(errors_with_counts) > MAX_PRINTED_ERRORS:
        rest = CwcliError(f"{len(errors_with_counts) - MAX_PRINTED_ERRORS} more reasons are in the manifest")
        errors_with_counts = [*errors_with_counts[:MAX_PRINTED_ERRORS], rest]
    return errors_with_counts


def _log_ids_by_left_out_reason(entries: Sequence[dict[str, Any]]) -> dict[str, list[str]]:
    """Reason for which a stage was left out -> ids of the logs."""
    reasons: dict[str, list[str]] = {}
    for entry in entries:
        for stage, reason in entry["left_out"].items():
            reasons.setdefault(f"{stage} was left out: {reason}", []).append(entry["id"])
    return reasons
