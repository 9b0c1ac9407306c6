"""`cwcli demo`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

from cwcli.cli.commands.run import add_all_stages, gather_default_options
from cwcli.cli.console import Console
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import ReadingOptions, WritingOptions
from cwcli.cli.pipeline import Job, job_document, print_outcome, run_and_write

EXAMPLES = ("cwcli demo", "cwcli demo -d /tmp/demo")
"""Command lines at the end of the command's `--help`."""
SAMPLE_LOG_NAMES = ("intersection", "rear-end")
"""Names of the bundled logs that hold another vehicle."""


def command(
    talk: TalkOptions,
    directory: Annotated[
        str, typer.Option("--directory", "-d", metavar="DIR", help="Write the files into this folder.")
    ] = "cwcli-demo",
) -> None:
    """Estimate, predict and warn on two bundled logs.

    Files of an earlier demo in the folder are overwritten.
    """
    from cwcli.output import make_folder

    console = Console(quiet=talk.quiet)
    make_folder(directory)
    documents = []
    for name in SAMPLE_LOG_NAMES:
        with open_sample_log(name) as source:
            annotated = Path(directory) / f"{name}.annotated.mcap"
            metrics = Path(directory) / f"{name}-metrics"
            job = Job(
                command="demo",
                source=str(source),
                stages={},
                reading=ReadingOptions(),
                writing=WritingOptions(output=str(annotated), force=True),
                talk=talk,
                metrics_dir=str(metrics),
            )
            outcome = run_and_write(add_all_stages(job, gather_default_options()))
        if talk.json:
            documents.append(job_document(job, outcome))
        else:
            console.print_heading(f"$ cwcli run {name}.mcap -o {annotated} \\")
            console.print_heading(f"      --metrics-dir {metrics}")
            console.print_summary("")
            print_outcome(job, console, outcome)
            console.print_summary("")
    if talk.json:
        console.print_document("demo", {"runs": documents})


@contextmanager
def open_sample_log(name: str) -> Iterator[Path]:
    """Give the path of a bundled log, from the installed package or else from the checkout."""
    from importlib.resources import as_file, files

    import cwcli

    checkout = Path(cwcli.__file__).parents[1] / "sample_logs" / f"{name}.mcap"
    try:
        resource = files("cwcli.sample_logs") / f"{name}.mcap"
    except ModuleNotFoundError:
        yield checkout
        return
    with as_file(resource) as path:
        yield path
