"""`cwcli find`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from cwcli.cli.console import Console
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.complete import complete_events
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import ForceOption, LimitOptions
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written_files
from cwcli.cli.tables import format_table
from cwcli.cli.targets import check_file_suffix, check_outputs_and_list_file_names
from cwcli.cli.text import format_count, join_names, shorten_and_escape, terminal_width
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.text import format_first_names, map_to_distinct_endings

if TYPE_CHECKING:
    from cwcli.events.search import FoundEvent
    from cwcli.fleet.search import FleetSearch

EXAMPLES = (
    "cwcli find runs/ cut-in",
    "cwcli find annotated.mcap 'min(ttc_s) over 3 s < 1.5 and ego.speed_mps > 8'",
    "cwcli find runs/ cut-in --clips clips/ --report found.html",
)
"""Command lines at the end of the command's `--help`."""
MAX_SHOWN_EVENTS = 50
"""Largest number of events that the terminal shows; chosen by hand, the others are in the table and in --json."""
MIN_TERMINAL_WIDTH_FOR_ONE_LINE_EVENTS_COLUMNS = 130
"""Least width of a terminal, in columns, that shows severity and id of an event in the line of what happened. Chosen by
hand, so that the sentence keeps half a line."""
MAX_CLIP_MARGIN_S = 3600.0
"""Largest `--margin`, s; chosen by hand."""


@dataclass(frozen=True)
class ResultOptions:
    """Where the results go."""

    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="FILE", help="Write the events as a table (.parquet, .csv).")
    ] = None
    clips: Annotated[
        str | None, typer.Option("--clips", metavar="DIR", help="Write a log of each event into this folder.")
    ] = None
    report: Annotated[
        str | None,
        typer.Option(
            "--report", metavar="FILE", help="Write a page (.html) with a card of each event; --clips adds its link."
        ),
    ] = None
    margin: Annotated[
        float,
        typer.Option(
            "--margin",
            metavar="S",
            min=0.0,
            max=MAX_CLIP_MARGIN_S,
            help="Seconds before and after the event in a clip and in the figures of the report.",
        ),
    ] = 5.0
    limit: Annotated[
        int | None,
        typer.Option(
            "--limit", metavar="N", min=1, show_default="all", help="Keep the N most severe events; make clips of them."
        ),
    ] = None
    force: ForceOption = False


def command(
    logs: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG",
            help="Logs, folders of them, patterns, URLs, or the output folder of a run; - is standard input.",
        ),
    ],
    expression: Annotated[
        str,
        typer.Argument(
            metavar="EXPR",
            autocompletion=complete_events,
            help="An event, several with `or` between, `all`, or an expression over quantities and events.",
        ),
    ],
    talk: TalkOptions,
    results: ResultOptions,
    limits: LimitOptions,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            "--topic",
            metavar="ROLE=/NAME",
            help="Another system in the log, e.g. warning=/adas/fcw:data==true; for the event `disagreement`.",
        ),
    ] = None,
) -> None:
    """Find moments in logs: named events, or expressions over channels and measures, the most severe first.

    Events are those of the table in docs/find.md. An expression compares quantities: states (ego.speed_mps,
    other.speed_mps), measures (ttc_s), fields (/status:speed); `min`, `max` and `mean` of one `over 3 s`; `and`, `or`,
    `not`; `for 0.5 s`; `within 2 s after`, `before` or `of` another condition. Numbers may have a unit: 30 km/h.
    Most events need annotated logs; outages and gaps are found in any log.
    """
    from cwcli.array_memory import bound_array_memory_and_get_old_handler
    from cwcli.evaluation.system_topics import parse_other_system_options
    from cwcli.events.search import parse_query, table_of_events
    from cwcli.fleet.clips import write_clips
    from cwcli.fleet.search import find_in_logs, logs_to_search
    from cwcli.input import is_file
    from cwcli.metrics.table import write_table
    from cwcli.output import refuse_unwritable_targets, write_file
    from cwcli.report.event_page import addresses_of_clips, build_event_page

    if is_file(expression):
        raise UsageError(
            f"the last argument, {shorten_and_escape(expression)}, is a file where the expression belongs",
            hint="name the logs first: cwcli find LOG... EXPR; `all` finds every event",
        )
    query = parse_query(expression)
    other_system = parse_other_system_options(topic or [])
    output_names = check_outputs_and_list_file_names(
        logs, talk, metrics=results.output, texts=(results.report,), force=results.force
    )
    refuse_unwritable_targets([], [results.clips], force=results.force)
    bound_array_memory_and_get_old_handler()
    if results.report is not None:
        check_file_suffix(results.report, (".html", ".htm"), what="a page", required=False)
    console = Console(quiet=talk.quiet, summary_to_stderr=results.report == "-")
    with Progress(quiet=talk.quiet) as progress:
        progress.begin_step("looking for logs")
        sources = logs_to_search(logs)
        for option, value in (("--clips", results.clips), ("--report", results.report)):
            if value is not None and any(each.path == "-" for each in sources):
                raise UsageError(f"{option} reads a log twice, and standard input can be read once", hint="name a file")
        search = find_in_logs(
            sources,
            query,
            limits.open_log,
            other_system=other_system,
            step=lambda k, name: progress.begin_step(f"searching {name} ({k + 1} of {len(sources)})"),
        )
        listed = search.found[: results.limit]
        clips: dict[tuple[str, str], str] = {}
        if results.clips is not None:
            clips = write_clips(
                listed,
                search.paths,
                results.clips,
                limits.open_log,
                margin_s=results.margin,
                force=results.force,
                step=lambda k, name: progress.begin_step(f"cutting {name} ({k + 1} of {len(listed)})"),
            )
        if results.report is not None:
            page = build_event_page(
                f"find {query.text}",
                listed,
                search.paths,
                limits.open_log,
                margin_s=results.margin,
                clip_addresses=addresses_of_clips(clips, results.report),
                step=lambda k, name: progress.begin_step(f"drawing {name} ({k} of {len(listed)} events)"),
            )
            write_file(results.report, page, force=results.force)
        if results.output is not None:
            write_table(table_of_events(listed), results.output, force=results.force)
    if talk.json:
        console.print_document("find", _search_as_json(search, listed, clips))
        return
    _print_search(console, search, listed, query.text)
    print_written_files(console, output_names)
    if results.clips is not None:
        console.print_summary(f"wrote {format_count(len(clips), 'clip')} into {shorten_and_escape(str(results.clips))}")


def _print_search(console: Console, search: FleetSearch, listed: tuple[FoundEvent, ...], text: str) -> None:
    """Print the events, the most severe first, and what could not be searched."""
    n_logs, n_failed = len(search.paths), len(search.failed)
    logs = (f"{n_logs - n_failed} of " if n_failed else "") + format_count(n_logs, "log")
    console.print_heading(
        f"find {text}: {format_count(len(search.found), 'event')} in {logs}"
        + (f", the {len(listed)} most severe" if len(listed) < len(search.found) else "")
    )
    if listed:
        log_names = map_to_distinct_endings(search.paths)
        rows = [
            (
                shorten_and_escape(log_names[each.log]),
                each.event,
                each.start_s,
                each.duration_s,
                shorten_and_escape(" ".join(each.moment.actors)),
                shorten_and_escape(each.words),
                each.moment.severity,
                each.id,
            )
            for each in listed[:MAX_SHOWN_EVENTS]
        ]
        head = (
            "log file",
            "kind of event",
            "start [s]",
            "duration [s]",
            "vehicles",
            "what happened",
            "severity (1: at threshold)",
            "event id",
        )
        if (terminal_width() or 0) >= MIN_TERMINAL_WIDTH_FOR_ONE_LINE_EVENTS_COLUMNS:
            console.print_summary(format_table(head, rows))
        else:
            console.print_summary(format_table(head[:6], [row[:6] for row in rows]) + "\n")
            console.print_summary(format_table(head[:3] + head[6:], [row[:3] + row[6:] for row in rows]))
    if len(listed) > MAX_SHOWN_EVENTS:
        console.print_note(f"{len(listed) - MAX_SHOWN_EVENTS} more events are in -o and --json")
    for n, events in _events_by_number_of_logs_that_lack_channels(search.missing).items():
        console.print_note(
            f"{join_names(events)}: not searched in {format_count(n, 'log')} without the channels that this needs"
        )
    names_by_reason: dict[str, list[str]] = {}
    for name, error in search.failed:
        names_by_reason.setdefault(error.what, []).append(name)
    for reason, names in names_by_reason.items():
        verb = "was" if len(names) == 1 else "were"
        console.print_note(f"{shorten_and_escape(format_first_names(names))} {verb} not searched: {reason}")


def _events_by_number_of_logs_that_lack_channels(n_logs_by_event: Mapping[str, int]) -> dict[int, list[str]]:
    events: dict[int, list[str]] = {}
    for event, n in n_logs_by_event.items():
        events.setdefault(n, []).append(event)
    return events


def _search_as_json(
    search: FleetSearch, listed: tuple[FoundEvent, ...], clips: dict[tuple[str, str], str]
) -> dict[str, Any]:
    """The content of `--json`."""
    return {
        "logs": len(search.paths),
        "found": len(search.found),
        "events": [
            {
                "id": each.id,
                "log": each.log,
                "event": each.event,
                "start_ns": each.moment.start_ns,
                "end_ns": each.moment.end_ns,
                "start_s": each.start_s,
                "duration_s": each.duration_s,
                "actors": list(each.moment.actors),
                "value": None if math.isnan(each.moment.value) else each.moment.value,
                "value_name": each.value_name,
                "severity": each.moment.severity,
                "detail": each.moment.detail,
                "words": each.words,
                "clip": clips.get(each.key),
            }
            for each in listed
        ],
        "missing": dict(search.missing),
        "failed": [{"log": name, "error": str(error)} for name, error in search.failed],
    }
