"""`cwcli view`."""

from __future__ import annotations

from typing import Annotated

from cwcli.cli.console import Console
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import ForceOption, LogArgument
from cwcli.cli.report import print_written_files
from cwcli.cli.targets import check_file_suffix
from cwcli.errors import InputError, UsageError

EXAMPLES = ("cwcli view annotated.mcap", "cwcli view annotated.mcap -o annotated.rrd")
"""Command lines at the end of the command's `--help`."""


def command(
    log: LogArgument,
    talk: TalkOptions,
    output: Annotated[
        str | None,
        typer.Option(
            "--output", "-o", metavar="FILE", show_default="open the viewer", help="Write a recording (.rrd) instead."
        ),
    ] = None,
    force: ForceOption = False,
) -> None:
    """Show an annotated log in Rerun: paths from above, speeds, warnings, the map, and all that Rerun knows of the log.

    Needs rerun-sdk, the extra `view`.
    """
    from cwcli.export.recording import encode_recording, require_rerun, show_in_viewer
    from cwcli.input import exists, is_file, is_folder
    from cwcli.logs.read.reader import Log
    from cwcli.logs.read.remote import is_remote_url
    from cwcli.output import refuse_unwritable_targets, write_file

    if output is not None:
        refuse_unwritable_targets([output], force=force, inputs=log)
        check_file_suffix(output, [".rrd"], what="a recording")
    (path, *more) = log
    if not more and path != "-" and not is_remote_url(path) and not is_file(path) and not is_folder(path):
        what = "it is no file that can be read" if exists(path) else "there is no such file"
        raise InputError(what, where=path)
    if more or not is_file(path):
        raise UsageError(f"{path} can't be shown: Rerun opens the file by itself", hint="give one file on this machine")
    require_rerun()
    with Log.open(path) as opened:
        if output is None:
            show_in_viewer(opened, path)
            return
        write_file(output, encode_recording(opened, path), force=force)
    console = Console(quiet=talk.quiet)
    if talk.json:
        console.print_document("view", {"output": output})
    else:
        print_written_files(console, [output])
