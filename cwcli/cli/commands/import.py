"""`cwcli import`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from cwcli.cli.console import Console, replace_stdout_path_by_dash
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import ForceOption
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written_files
from cwcli.cli.tables import format_table
from cwcli.cli.text import escape_control_characters, join_names, shorten_and_escape
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass

if TYPE_CHECKING:
    from cwcli.importing.bounded_import import ImportReport
    from cwcli.importing.tables import Answers

EXAMPLES = (
    "cwcli import drive.csv -o log.mcap",
    "cwcli import gps.csv imu.csv --timezone Europe/Berlin -o log.mcap",
    "cwcli import drive.csv --column 'speed=v*kmh' --preview",
    "cwcli import trace.asc --dbc car.dbc -o log.mcap",
)
"""Command lines at the end of the command's `--help`."""
MAX_NAMED_UNUSED_COLUMNS = 8
"""Largest number of columns that a note names; chosen by hand."""


@dataclass(frozen=True)
class AnswerOptions:
    """What only the user knows."""

    heading = "Answers to what the files do not say"

    column: Annotated[
        list[str] | None,
        typer.Option(
            "--column",
            metavar="QUANTITY=COLUMN*UNIT",
            help="A column's meaning: speed='v*kmh', heading='yaw*deg-ccw-east'; `heading=` leaves a quantity out.",
        ),
    ] = None
    timezone: Annotated[
        str | None, typer.Option("--timezone", metavar="ZONE", help="Zone of local times: UTC, Europe/Berlin, +02:00.")
    ] = None
    date_order: Annotated[
        str | None, typer.Option("--date-order", metavar="ORDER", help="Order of dates: dmy, mdy or ymd.")
    ] = None
    start: Annotated[
        str | None,
        typer.Option("--start", metavar="TIME", help="Start time of a recording whose times count from its start."),
    ] = None
    decimal: Annotated[str | None, typer.Option("--decimal", metavar="MARK", help="Decimal mark: . or ,")] = None
    axes: Annotated[
        str | None,
        typer.Option(
            "--axes",
            metavar="FORWARD,UP",
            help="Axes of the inertial sensor or pose that point forward and up in the car: x,z or -y,z.",
        ),
    ] = None
    vehicle: Annotated[
        str | None, typer.Option("--id", metavar="ID", help="Id of the ego or of the track, in a file with several.")
    ] = None
    times: Annotated[
        str | None,
        typer.Option(
            "--times",
            metavar="SOURCE",
            help="Times of frames or poses: a file with one time per line, pts, or a rate such as 10Hz.",
        ),
    ] = None
    dbc: Annotated[
        list[str] | None,
        typer.Option("--dbc", metavar="FILE", help="DBC file that describes the messages of a CAN trace."),
    ] = None


def command(
    files: Annotated[list[str], typer.Argument(metavar="FILE", help="Files of one drive that are no logs.")],
    talk: TalkOptions,
    answers: AnswerOptions,
    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="FILE", help="Write the log here; - is standard output.")
    ] = None,
    mapping: Annotated[
        str | None,
        typer.Option(
            "--mapping",
            metavar="FILE",
            help="Mapping file that says how to read the files, written by an earlier import.",
        ),
    ] = None,
    preview: Annotated[
        bool, typer.Option("--preview", help="Show how the files would be read, and write nothing.")
    ] = False,
    force: ForceOption = False,
) -> None:
    """Make a log of files that are no logs: tables, tracks, trajectories, phone recordings, CAN traces, videos.

    Reads CSV, TSV, Parquet, GPX, KML, NMEA 0183, u-blox UBX, RTKLIB, VBOX, TUM, KITTI and EuRoC trajectories,
    recordings of Sensor Logger, phyphox and GNSSLogger, CAN traces (ASC, BLF, TRC, candump), SUMO's FCD and video.
    It guesses the columns, their units, times and axes, prints the guesses and writes them into a mapping file next to
    the log, which you can edit and pass with --mapping. It asks for what the files do not say.
    """
    from cwcli.importing.bounded_import import import_files
    from cwcli.importing.mapping import mapping_file_name
    from cwcli.logs.read.remote import is_remote_url
    from cwcli.output import refuse_unwritable_targets

    for each in files:
        if is_remote_url(each):
            raise UsageError("files are imported from this machine alone", where=each, hint="copy it to this machine")
    if output is None and not preview:
        raise UsageError("no output is named", hint="-o log.mcap, or --preview")
    target = str(replace_stdout_path_by_dash(output or "-"))
    if target == "-" and talk.json and not preview:
        raise UsageError("--json and -o - both want standard output", hint="write the log to a file")
    mapping_file = mapping_file_name(target) if target != "-" and not preview else None
    if mapping_file == mapping:
        mapping_file = None
    if not preview:
        refuse_unwritable_targets([target, mapping_file], force=force, inputs=files)
    console = Console(quiet=talk.quiet, summary_to_stderr=target == "-" and not preview)
    merged_answers = _merge_options_and_mapping_file(answers, mapping)
    with Progress(quiet=talk.quiet) as progress:
        progress.begin_step(f"import {', '.join(files)}")
        follow = progress if progress.is_shown else None
        report = import_files(
            files,
            merged_answers,
            None if preview else target,
            mapping_file=mapping_file,
            force=force,
            progress=follow,
        )
    if talk.json:
        console.print_document("import", _import_document(report, None if preview else target))
        return
    _print_report(console, report)
    if not preview and target != "-":
        print_written_files(console, [target, *([mapping_file] if mapping_file is not None else [])])


def _merge_options_and_mapping_file(options: AnswerOptions, mapping: str | None) -> Answers:
    """What the user decided, by options and by a mapping file.

    Raises:
        UsageError: An answer is none of its choices.
    """
    from cwcli.importing.mapping import (
        ALLOWED_VALUES_BY_ANSWER,
        merge_answers,
        parse_table_quantity_and_column_unit,
        read_mapping,
    )
    from cwcli.importing.tables import Answers

    for option, value, known in (
        ("--date-order", options.date_order, ALLOWED_VALUES_BY_ANSWER["date_order"]),
        ("--decimal", options.decimal, ALLOWED_VALUES_BY_ANSWER["decimal"]),
    ):
        if value is not None and value not in known:
            raise UsageError(f"{option} {value}: it must be one of {join_names(list(known))}")
    columns = dict(map(parse_table_quantity_and_column_unit, options.column or ()))
    answers_of_options = Answers(
        columns,
        timezone=options.timezone or "",
        date_order=options.date_order or "",
        start=options.start or "",
        decimal=options.decimal or "",
        axes=options.axes or "",
        vehicle=options.vehicle or "",
        frame_times=options.times or "",
        dbc=tuple(options.dbc or ()),
    )
    return answers_of_options if mapping is None else merge_answers(read_mapping(mapping), answers_of_options)


def _import_document(report: ImportReport, target: str | None) -> dict[str, Any]:
    """The content of `--json`."""
    return {
        "files": dict(report.kinds),
        "guesses": [
            {
                "table": table,
                "quantity": each.quantity,
                "column": each.column,
                "unit": each.unit,
                "confidence": each.confidence,
                "why": each.why,
            }
            for table, guesses in report.tables
            for each in guesses
        ],
        "channels": [
            {"topic": topic, "schema": schema, "messages": n, "table": table}
            for topic, schema, n, table in report.topics
        ],
        "notes": {name: list(notes) for name, notes in report.notes.items() if notes},
        "unused": {name: list(columns) for name, columns in report.unused.items() if columns},
        "written": target,
    }


def _print_report(console: Console, report: ImportReport) -> None:
    for table, guesses in report.tables:
        console.print_heading(table)
        headings = ("quantity", "column of the file", "unit", "confidence", "reason")
        texts = [(each.quantity, each.column, each.unit or "-", each.confidence, each.why) for each in guesses]
        console.print_summary(
            format_table(headings, [[escape_control_characters(text) for text in row] for row in texts])
        )
        console.print_summary("")
    topic_rows = [(topic, schema, n) for topic, schema, n, _ in report.topics]
    console.print_summary(format_table(("topic", "schema", "messages"), topic_rows))
    for table, notes in report.notes.items():
        for note in notes:
            console.print_note(f"{table}: {note}")
    for table, columns in report.unused.items():
        if columns:
            more = (
                f" and {len(columns) - MAX_NAMED_UNUSED_COLUMNS} more"
                if len(columns) > MAX_NAMED_UNUSED_COLUMNS
                else ""
            )
            console.print_note(
                f"{shorten_and_escape(table)}: not read: {', '.join(columns[:MAX_NAMED_UNUSED_COLUMNS])}{more}"
            )
