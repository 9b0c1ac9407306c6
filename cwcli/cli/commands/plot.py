"""`cwcli plot`."""

from __future__ import annotations

from typing import Annotated

from cwcli.cli.console import Console, closest_names_hint
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import AsOneOption, ForceOption, LogArgument, source_of_logs
from cwcli.cli.report import print_written_files
from cwcli.cli.targets import check_file_suffix
from cwcli.errors import UsageError

EXAMPLES = ("cwcli plot annotated.mcap --what error -o error.png", "cwcli plot annotated.mcap --what ape -o ape.svg")
"""Command lines at the end of the command's `--help`."""
PLOT_NAMES_TEXT = "motion, error, ape, rpe, lane, speed, heading, yaw-rate, acceleration, map"
"""Names of all plots, for the help."""


def command(
    log: LogArgument,
    talk: TalkOptions,
    output: Annotated[str, typer.Option("--output", "-o", metavar="FILE", help="Draw it here: .png or .svg.")],
    what: Annotated[str, typer.Option("--what", metavar="WHAT", help=f"What is drawn: {PLOT_NAMES_TEXT}.")] = "motion",
    as_one: AsOneOption = False,
    force: ForceOption = False,
) -> None:
    """Draw one plot of an annotated log as an image.

    motion, speed, heading, yaw-rate and acceleration show the estimate with its 1-sigma band over the measurements;
    heading is counter-clockwise from east. error shows the errors against the truth with their 95 % band, that of the
    position as a distance, with the band in the direction of the error; ape is the absolute position error, rpe the
    relative one over a second (translation only). Needs matplotlib.
    """
    from cwcli.digest.drive import read_drive
    from cwcli.logs.read.reader import Log
    from cwcli.output import PLOT_FILE_FORMATS, refuse_unwritable_targets, write_file
    from cwcli.report.plots import PLOT_NAMES as KNOWN
    from cwcli.report.plots import draw_plot

    refuse_unwritable_targets([output], force=force, inputs=log)
    if what not in KNOWN:
        raise UsageError(f"--what {what!r}: there is no such plot", hint=closest_names_hint(what, list(KNOWN)))
    form = check_file_suffix(output, [f".{name}" for name in PLOT_FILE_FORMATS], what="an image").removeprefix(".")
    with Log.open(source_of_logs(log, as_one)) as opened:
        drive = read_drive(opened)
    write_file(output, draw_plot(drive, what, form), force=force)
    console = Console(quiet=talk.quiet)
    if talk.json:
        console.print_document("plot", {"what": what, "format": form, "output": output})
    else:
        print_written_files(console, [output])
