"""`cwcli layout`."""

from __future__ import annotations

import json
from typing import Annotated

from cwcli.cli.console import Console, replace_stdout_path_by_dash
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import ForceOption
from cwcli.cli.report import print_written_files
from cwcli.errors import UsageError

EXAMPLES = ("cwcli layout -o cwcli.foxglove.json", "cwcli layout drive.mcap -o drive.foxglove.json")
"""Command lines at the end of the command's `--help`."""


def command(
    talk: TalkOptions,
    log: Annotated[
        str | None,
        typer.Argument(
            metavar="LOG",
            help="Log whose fixes, cameras and truth are also shown: MCAP file, folder of a recording, or URL; - "
            "is standard input.",
        ),
    ] = None,
    output: Annotated[
        str | None,
        typer.Option(
            "--output", "-o", metavar="FILE", show_default="-", help="Write the layout here; - is standard output."
        ),
    ] = None,
    force: ForceOption = False,
) -> None:
    """Make a viewer layout that shows every channel of cwcli.

    The file is JSON, as Foxglove exports it: import it there, or in Lichtblick, with "Import from file".
    """
    output = "-" if output is None else str(replace_stdout_path_by_dash(output))
    if output == "-" and talk.json:
        raise UsageError("--json and -o - both want standard output", hint="write the layout to a file")
    from cwcli.output import refuse_unwritable_targets, write_file
    from cwcli.report.viewer_layout import LogTopics, build_viewer_layout, find_log_topics

    if output != "-":
        refuse_unwritable_targets([output], force=force, inputs=[] if log is None else [log])
    topics = LogTopics()
    if log is not None:
        from cwcli.logs.read.reader import Log

        with Log.open(log) as opened:
            topics = find_log_topics(opened)
    document = build_viewer_layout(topics)
    text = json.dumps(document, indent=2, allow_nan=False)
    console = Console(quiet=talk.quiet)
    if output == "-":
        console.print_data(text)
        return
    write_file(output, f"{text}\n".encode(), force=force)
    if talk.json:
        console.print_document("layout", {"output": output, "panels": len(document["configById"])})
    else:
        print_written_files(console, [output])
