"""`cwcli plot`."""

from __future__ import annotations

from typing import Annotated

import typer

from cwcli.cli.console import Console, closest
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import AsOneOption, ForceOption, LogArgument, one_log
from cwcli.cli.report import print_written
from cwcli.cli.targets import check_suffix
from cwcli.errors import UsageError

EXAMPLES = ("cwcli plot annotated.mcap --what error -o error.png", "cwcli plot annotated.mcap --what ape -o ape.svg")
"""Command lines at the end of the command's `--help`."""
WHAT = "motion, error, ape, rpe, lane, speed, heading, yaw-rate, acceleration, map"
"""Names of all plots, for the help."""


def command(
    log: LogArgument,
    talk: TalkOptions,
    output: Annotated[str, typer.Option("--output", "-o", metavar="FILE", help="Draw it here: .png or .svg.")],
    what: Annotated[str, typer.Option("--what", metavar="WHAT", help=f"What is drawn: {WHAT}.")] = "motion",
    as_one: AsOneOption = False,
    force: ForceOption = False,
) -> None:
    """Draw one plot of an annotated log as an image.

    motion and its parts show the estimate with its 1-sigma band over what was measured; error shows it against the
    truth with the 95 % band; ape and rpe are the absolute and the relative position error, translation part, the
    latter over a second. Needs matplotlib.
    """
    from cwcli.logs.read.reader import Log
    from cwcli.output import check_targets, write_file
    from cwcli.report.drive import read_drive
    from cwcli.report.plots import FORMATS, draw
    from cwcli.report.plots import WHAT as KNOWN

    check_targets([output], force=force, inputs=log)
    if what not in KNOWN:
        raise UsageError(f"--what {what!r}: there is no such plot", hint=closest(what, list(KNOWN)))
    form = check_suffix(output, [f".{name}" for name in FORMATS], what="an image").removeprefix(".")
    with Log.open(one_log(log, as_one)) as opened:
        drive = read_drive(opened)
    write_file(output, draw(drive, what, form), force=force)
    console = Console(quiet=talk.quiet)
    if talk.json:
        console.document("plot", {"what": what, "format": form, "output": output})
    else:
        print_written(console, [output])
