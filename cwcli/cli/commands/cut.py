"""`cwcli cut`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from cwcli.cli.console import Console, replace_stdout_path_by_dash
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import (
    AsOneOption,
    EndOption,
    ForceOption,
    LimitOptions,
    LogArgument,
    StartOption,
    source_names,
    source_of_logs,
)
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written_files
from cwcli.cli.text import shorten_and_escape
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass

if TYPE_CHECKING:
    from cwcli.logs.read.reader import Log
    from cwcli.logs.write.cut import CutReport, CutSpan

EXAMPLES = (
    "cwcli cut drive.mcap --start 60 --end 75 -o clip.mcap",
    "cwcli cut drive.mcap --topics '/gps/*,/imu' -o small.mcap",
)
"""Command lines at the end of the command's `--help`."""


@dataclass(frozen=True)
class SpanOptions:
    """What the new log holds."""

    start: StartOption = None
    end: EndOption = None
    topics: Annotated[
        str | None,
        typer.Option(
            "--topics",
            metavar="/NAME,...",
            show_default="all",
            help="Copy only these topics, separated by commas; * stands for any characters.",
        ),
    ] = None
    last_of: Annotated[
        str | None,
        typer.Option(
            "--last-of", metavar="/NAME,...", help="Also copy the last message of these topics from before --start."
        ),
    ] = None
    latched: Annotated[
        bool,
        typer.Option(
            "--latched/--no-latched",
            help="Also write latched messages from before --start: static transforms, maps and other states.",
        ),
    ] = True

    def resolve_span(self, log: Log) -> CutSpan:
        """Return the span of a log that these options name.

        Raises:
            UsageError: A time or a topic is not in the log, or the options name nothing.
        """
        from cwcli.logs.write.cut import MAX_LOG_TIME_NS, CutSpan, topics_matching_patterns
        from cwcli.pipeline.selection import resolve_selection

        if self.start is None and self.end is None and self.topics is None:
            raise UsageError("nothing is cut", hint="name --start, --end or --topics")
        chosen = resolve_selection(log, (), self.start, self.end)
        known = sorted({channel.topic for channel in log.channels})
        return CutSpan(
            first_ns=chosen.start_ns or 0,
            last_ns=MAX_LOG_TIME_NS if chosen.end_ns is None else chosen.end_ns - 1,
            topics=None if self.topics is None else topics_matching_patterns(self.topics, known, log.name),
            last_of=frozenset() if self.last_of is None else topics_matching_patterns(self.last_of, known, log.name),
            keeps_latched=self.latched,
        )


def command(
    log: LogArgument,
    talk: TalkOptions,
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="FILE", help="Write the part here; - is standard output.")
    ],
    span: SpanOptions,
    limits: LimitOptions,
    as_one: AsOneOption = False,
    force: ForceOption = False,
) -> None:
    """Write a part of a log: a span of time, some topics, or both.

    Every message keeps its bytes, its times and its sequence number. Latched messages
    from before the span (static transforms, maps) come first, with their own times. Metadata is kept, and so are
    attachments that were logged before the span ends.
    """
    from cwcli.logs.write.cut import cut_log
    from cwcli.output import refuse_unwritable_targets

    target = str(replace_stdout_path_by_dash(output))
    if target == "-" and talk.json:
        raise UsageError("--json and -o - both want standard output", hint="write the log to a file")
    source = source_of_logs(log, as_one)
    refuse_unwritable_targets([target], force=force, inputs=source_names(source))
    console = Console(quiet=talk.quiet, summary_to_stderr=target == "-")
    with Progress(quiet=talk.quiet) as progress, limits.open_log(source) as opened:
        progress.begin_step(f"cutting {opened.name}")
        report = cut_log(opened, span.resolve_span(opened), target, force=force)
        faults = {**opened.faults.counts_by_reason(), **report.faults}
    if talk.json:
        console.print_document("cut", _report_as_json(report, faults))
        return
    n_messages = sum(report.n_messages.values())
    console.print_summary(
        f"{n_messages:,} messages of {len(report.n_messages)} topics: {report.n_chunks_copied:,} chunks copied, "
        f"{report.n_chunks_rewritten:,} rewritten"
    )
    for topic, n in report.n_earlier.items():
        console.print_summary(f"{shorten_and_escape(topic)}: {n} from before the span")
    if report.n_attachments_left_out:
        console.print_note(f"attachments logged after the span, left out: {report.n_attachments_left_out}")
    for reason, count in faults.items():
        console.print_note(f"{reason}: {count}")
    if target != "-":
        print_written_files(console, [target])


def _report_as_json(report: CutReport, faults: dict[str, int]) -> dict[str, object]:
    """The counts of a cut for `--json`."""
    return {
        "messages": dict(report.n_messages),
        "earlier_messages": dict(report.n_earlier),
        "chunks_copied": report.n_chunks_copied,
        "chunks_rewritten": report.n_chunks_rewritten,
        "attachments": report.n_attachments,
        "attachments_left_out": report.n_attachments_left_out,
        "faults": faults,
        "bytes": report.n_bytes,
        "written": report.target,
    }
