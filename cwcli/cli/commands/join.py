"""`cwcli join`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cwcli.cli.console import Console, replace_stdout_path_by_dash
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import (
    ForceOption,
    LimitOptions,
)
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written_files
from cwcli.cli.text import shorten_and_escape
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.work_share import part_of_work, report_work_share_to

EXAMPLES = (
    "cwcli join ego.mcap other.mcap --role remote -o both.mcap",
    "cwcli run both.mcap --stage predict,warn,measure -o annotated.mcap",
)
"""Command lines at the end of the command's `--help`."""


@dataclass(frozen=True)
class OtherCarOptions:
    """What the other car is in the ego's log."""

    role: Annotated[Literal["remote"], typer.Option("--role", help="Role of the other car in the ego's log.")] = (
        "remote"
    )
    name: Annotated[
        str | None,
        typer.Option(
            "--id", metavar="ID", show_default="its file's name", help="Id of the other car in the ego's log."
        ),
    ] = None
    late: Annotated[
        float, typer.Option("--late", metavar="S", help="Seconds by which the other log's stamps are late.")
    ] = 0.0


@dataclass(frozen=True)
class OverwriteOptions:
    """What may be overwritten."""

    replace: Annotated[bool, typer.Option("--replace", help="Replace the channels that an earlier run wrote.")] = False
    force: ForceOption = False


def command(
    log: Annotated[str, typer.Argument(metavar="LOG", help="Log of the ego; - is standard input.")],
    other: Annotated[str, typer.Argument(metavar="OTHER", help="Log of the other car.")],
    talk: TalkOptions,
    output: Annotated[
        str,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Write the ego's log with the states of both cars here; - is standard output.",
        ),
    ],
    other_car: OtherCarOptions,
    limits: LimitOptions,
    overwriting: OverwriteOptions,
) -> None:
    """Make one log of two cars' logs: the second car becomes a remote vehicle, with its own covariance.

    Each car is estimated from its own sensors, unless its log holds its states already. The stamps of both logs are
    taken as GNSS time; the offset between the recorders' clocks is estimated from the positions and printed. The new
    log is the ego's with the states of both cars, on which predict, warn and measure can run.
    """
    from cwcli.array_memory import bound_array_memory_and_get_old_handler
    from cwcli.cli.options.shared import SensorOptions
    from cwcli.cli.options.stage import make_stage_options_class, stage_call_from_options
    from cwcli.logs.write.annotate import annotate_log
    from cwcli.output import refuse_unwritable_targets
    from cwcli.pipeline.join import join_logs

    target = str(replace_stdout_path_by_dash(output))
    if target == "-" and talk.json:
        raise UsageError("--json and -o - both want standard output", hint="write the log to a file")
    refuse_unwritable_targets([target], force=overwriting.force, inputs=[log, other])
    bound_array_memory_and_get_old_handler()
    estimate = stage_call_from_options(make_stage_options_class("estimate")(), SensorOptions())
    console = Console(quiet=talk.quiet, summary_to_stderr=target == "-")
    with Progress(quiet=talk.quiet) as progress, report_work_share_to(progress.show_share), limits.open_log(log) as ego:
        with limits.open_log(other) as second:
            progress.begin_step(f"estimating {ego.name} and {second.name}")
            name = other_car.name or Path(second.name.rstrip("/")).name.split(".")[0] or "other"
            joined_log = join_logs(ego, second, estimate, name=name, late_s=other_car.late)
            faults = {each.name: each.faults.counts_by_reason() for each in (ego, second)}
        progress.begin_step(f"writing {target}")
        with part_of_work(0.9, 1.0, "items"):
            annotate_log(joined_log.log, (), {}, target, replace=overwriting.replace, force=overwriting.force)
    if talk.json:
        said = {
            "role": other_car.role,
            "id": name,
            "clock_offset_s": joined_log.offset_ns / 1e9,
            "states": dict(joined_log.n_states),
            "outside": joined_log.n_outside,
            "notes": list(joined_log.notes),
            "faults": faults,
            "written": target,
        }
        console.print_document("join", said)
        return
    for topic, n in joined_log.n_states.items():
        console.print_summary(f"{shorten_and_escape(topic)}: {n} states of {shorten_and_escape(name)}")
    for note in joined_log.notes:
        console.print_note(note)
    for where, counts in faults.items():
        for reason, count in counts.items():
            console.print_note(f"{where}: {reason}: {count}")
    if target != "-":
        print_written_files(console, [target])
