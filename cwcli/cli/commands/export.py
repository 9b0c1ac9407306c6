"""`cwcli export`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cwcli.cli.console import Console, is_terminal, replace_stdout_path_by_dash
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import AsOneOption, ForceOption, LogArgument, source_of_logs
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written_files
from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.export.track_formats import TRACK_FORMATS
from cwcli.lazy_dataclass import dataclass
from cwcli.text import escape_control_characters, join_names
from cwcli.work_share import part_of_work, report_work_share_to

if TYPE_CHECKING:
    from cwcli.logs.read.reader import Log

EXAMPLES = (
    "cwcli export annotated.mcap --what ego --format tum -o ego.tum",
    "cwcli export annotated.mcap --what remote --format gpx -o others.gpx",
    "cwcli export annotated.mcap --what warnings --format csv | head",
    "cwcli export annotated.mcap --format osi -o trace.mcap",
    "cwcli export annotated.mcap --format ros2 -o ros.mcap",
)
"""Command lines at the end of the command's `--help`."""
CONTENT_NAMES_TEXT = (
    "ego, ego-online, remote, remote-online, targets, lanes, observer, paths, remote-paths, warnings, measures, "
    "rejected"
)
"""Names of all contents, for the help."""
TABLE_FORMATS = ("csv", "parquet")
"""Names of the formats of tables."""
ROS_FORMAT = "ros2"
"""Name of the format of ROS 2 logs."""
LOG_SUFFIX = ".mcap"
"""Suffix of the files of all formats that are logs."""
EXPORT_FORMATS = (*TABLE_FORMATS, *TRACK_FORMATS, ROS_FORMAT)
"""Names of all formats."""


@dataclass(frozen=True)
class ContentOptions:
    """What is exported, and in which format."""

    what: Annotated[
        str | None,
        typer.Option(
            "--what",
            metavar="WHAT",
            show_default="ego; osi: ego, remote and targets; ros2: the whole log",
            help=f"What is exported: {CONTENT_NAMES_TEXT}. Several tracks with commas.",
        ),
    ] = None
    form: Annotated[
        str | None,
        typer.Option(
            "--format",
            metavar="FORMAT",
            show_default="by the end of the file's name (logs: .osi.mcap, .ros2.mcap); without one csv",
            help=f"{', '.join(EXPORT_FORMATS[:-1])} or {EXPORT_FORMATS[-1]}. Tracks alone (ego, remote, targets) have "
            "all of them.",
        ),
    ] = None
    vehicle: Annotated[
        str | None,
        typer.Option(
            "--id", metavar="ID", show_default="all", help="Id of the vehicle; tum and kitti hold one vehicle per file."
        ),
    ] = None


def command(
    log: LogArgument,
    talk: TalkOptions,
    content: ContentOptions,
    output: Annotated[
        str | None,
        typer.Option("--output", "-o", metavar="FILE", show_default="-", help="Write it here; - is standard output."),
    ] = None,
    as_one: AsOneOption = False,
    force: ForceOption = False,
) -> None:
    """Write what cwcli added to a log as a file of another tool: a table, tracks, or a ROS 2 log.

    Tables have a column for each field of the channel, with its unit in the name. Tracks are positions over time: of
    each vehicle where the format allows it, else of the one that --id names. A ROS 2 log holds the ROS messages as they
    were recorded, and cwcli's as standard messages and cwcli_msgs below /cwcli/ros.
    """
    from cwcli.array_memory import bound_array_memory_and_get_old_handler
    from cwcli.export.content import content_names_of_ego_and_others, require_content_in_log
    from cwcli.logs.read.reader import Log
    from cwcli.output import refuse_unwritable_targets, write_file

    output = "-" if output is None else str(replace_stdout_path_by_dash(output))
    if output == "-" and talk.json:
        raise UsageError("--json and -o - both want standard output", hint="write the file with -o FILE")
    names = [] if content.what is None else content.what.split(",")
    form, vehicle = content.form or _format_of_file_name(output), content.vehicle
    _check_format_and_contents(names, form, vehicle)
    is_text = TRACK_FORMATS[form].is_text if form in TRACK_FORMATS else form == "csv"
    refuse_unwritable_targets([] if output == "-" and is_text else [output], force=force, inputs=log)
    bound_array_memory_and_get_old_handler()
    console = Console(quiet=talk.quiet)
    with Log.open(source_of_logs(log, as_one)) as opened:
        progress = Progress(quiet=talk.quiet)
        progress.begin_step(f"export {opened.name}")
        if form == ROS_FORMAT:
            said = _write_ros_log(opened, output, force, console, progress)
        else:
            if not names:
                of_all = form in TRACK_FORMATS and TRACK_FORMATS[form].holds_all_vehicles
                names = content_names_of_ego_and_others(opened) if of_all else ["ego"]
            for name in names:
                require_content_in_log(opened, name)
            with progress, report_work_share_to(progress.show_share), part_of_work(0.0, 0.9, "chunks"):
                encoded, n = _encode_contents_and_count_rows(opened, names, form, vehicle)
            said = {"what": ",".join(names), "rows": n}
            if output == "-" and is_text and is_terminal(sys.stdout):
                console.print_data(
                    "\n".join(map(escape_control_characters, bytes(encoded).decode().removesuffix("\n").split("\n")))
                )
            else:
                write_file(output, encoded, force=force)
    if talk.json:
        console.print_document("export", {"format": form, "output": output, **said})
    elif output != "-":
        print_written_files(console, [output])


def _write_ros_log(opened: Log, output: str, force: bool, console: Console, progress: Progress) -> dict[str, object]:
    """Write a ROS 2 log; returns the content of `--json`."""
    from cwcli.export.ros.convert import write_ros_log

    with progress, report_work_share_to(progress.show_share), part_of_work(0.0, 1.0, "items"):
        written = write_ros_log(opened, output, force=force)
    if written.left_out:
        console.print_note(f"left out, because no ROS message fits: {join_names(list(written.left_out))}")
    for topic, counts in written.left_messages.items():
        said = join_names([f"{n} whose {field} it can't hold" for field, n in counts.items()])
        console.print_note(f"{topic}: the ROS message does without messages: {said}")
    for topic, fields in written.left_fields.items():
        console.print_note(f"{topic}: the ROS message has no field {join_names(fields)}: left out")
    if written.replaced:
        console.print_note(f"{join_names(written.replaced)}: the recorded channel is replaced by the converted one")
    return {
        "what": "log",
        "rows": written.n_messages_made,
        "rows_copied": written.n_messages_kept,
        "left_out": written.left_out,
        "left_messages": written.left_messages,
        "left_fields": written.left_fields,
        "replaced": written.replaced,
    }


def _check_format_and_contents(names: Sequence[str], form: str, vehicle: str | None) -> None:
    """Check that the contents exist and that the format can hold them.

    Raises:
        UsageError: A content or the format does not exist, or the format can't hold the contents.
    """
    from cwcli.export.content import CHANNEL_BY_EXPORT_CONTENT_NAME

    for name in names:
        if name not in CHANNEL_BY_EXPORT_CONTENT_NAME:
            raise UsageError(
                f"--what {name!r}: there is no such thing to export",
                hint=hint_at_closest_or_all_known_names(name, CHANNEL_BY_EXPORT_CONTENT_NAME, "it is one of"),
            )
    if form not in EXPORT_FORMATS:
        raise UsageError(
            f"--format {form!r}: there is no such format",
            hint=hint_at_closest_or_all_known_names(form, EXPORT_FORMATS, "it is one of"),
        )
    if form == ROS_FORMAT and (names or vehicle is not None):
        option = "--what" if names else "--id"
        raise UsageError(f"{option}: --format ros2 writes the whole log", hint=f"leave {option} out")
    for name in names if form in TRACK_FORMATS else ():
        if not CHANNEL_BY_EXPORT_CONTENT_NAME[name].is_tracks:
            raise UsageError(
                f"--format {form} holds tracks, and `{name}` are not tracks", hint="export it as csv or parquet"
            )
    if form in TABLE_FORMATS and len(names) > 1:
        raise UsageError(f"--what {','.join(names)}: a table holds one of them", hint="export them one by one")


def format_of_each_suffix() -> dict[str, str]:
    """Suffix of a file's name -> the format that it selects."""
    of_tracks = {suffix: name for name, each in TRACK_FORMATS.items() for suffix in each.suffixes}
    return {f".{name}": name for name in TABLE_FORMATS} | of_tracks | {f".{ROS_FORMAT}{LOG_SUFFIX}": ROS_FORMAT}


def _format_of_file_name(output: str) -> str:
    """The format that a file's name selects; csv for a name without a suffix.

    Raises:
        UsageError: No format, or more than one, has files of that suffix.
    """
    name = Path(output).name.lower()
    known = format_of_each_suffix()
    for ending, form in known.items():
        if name.endswith(ending):
            return form
    suffix = Path(name).suffix
    if not suffix:
        return TABLE_FORMATS[0]
    if suffix == LOG_SUFFIX:
        forms = [(form, ending) for ending, form in known.items() if ending.endswith(LOG_SUFFIX)]
        raise UsageError(
            f"-o {output}: {join_names([form for form, _ in forms])} are both written as {LOG_SUFFIX}",
            hint=f"choose one with --format, or end the name in {' or '.join(ending for _, ending in forms)}",
        )
    endings = [f"{form} ({', '.join(each for each in known if known[each] == form)})" for form in EXPORT_FORMATS]
    raise UsageError(
        f"-o {output}: no format ends in {suffix}",
        hint=f"choose one with --format, or by the end of the name: {', '.join(endings)}",
    )


def _encode_contents_and_count_rows(
    opened: Log, names: list[str], form: str, vehicle: str | None
) -> tuple[bytes | memoryview, int]:
    """Encode contents of a log; returns the bytes of the file and the number of rows."""
    from cwcli.export.content import require_geographic_positions, table_to_export, tracks_to_export
    from cwcli.metrics.table import encode_table_to_bytes

    if form in TABLE_FORMATS:
        table = table_to_export(opened, names[0], vehicle)
        return encode_table_to_bytes(table, f".{form}"), len(table)
    tracks = [track for name in names for track in tracks_to_export(opened, name, vehicle)]
    track_format = TRACK_FORMATS[form]
    if track_format.is_geographic:
        require_geographic_positions(tracks, opened, form)
    if track_format.holds_one_track and len(tracks) > 1:
        known = ", ".join(track.id for track in tracks[:10])
        raise UsageError(
            f"--format {form} holds one track, and `{','.join(names)}` has {len(tracks)}", hint=f"--id one of {known}"
        )
    return track_format.encode(tracks), sum(len(track.stamp_ns) for track in tracks)
