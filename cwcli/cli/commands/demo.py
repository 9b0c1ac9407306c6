"""`cwcli demo`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

from cwcli.cli.commands.run import add_all_stages, gather_default_options
from cwcli.cli.console import Console
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import RunTalkOptions
from cwcli.cli.options.shared import ReadingOptions, WritingOptions
from cwcli.cli.pipeline import Job, job_document, print_outcome, run_and_write

EXAMPLES = ("cwcli demo", "cwcli demo -d /tmp/demo")
"""Command lines at the end of the command's `--help`."""
SAMPLE_LOG_NAME = "intersection"
"""Name of the bundled log that the demo runs on: a car from the right turns into the ego's path."""
PACKAGES_NEEDED_FOR_HTML_PAGE = ("jinja2", "plotly")
"""Packages that the page needs."""
NEXT_COMMAND_HINT = "cwcli run YOUR.mcap"
"""The command that the demo suggests at its end."""


def command(
    talk: RunTalkOptions,
    directory: Annotated[
        str, typer.Option("--directory", "-d", metavar="DIR", help="Write the files into this folder.")
    ] = "cwcli-demo",
) -> None:
    """Estimate, predict and warn on a bundled log, and make the page of it.

    Files of an earlier demo in the folder are overwritten. The page needs the extra `cwcli-drive[report]`.
    """
    from cwcli.output import make_folder

    console = Console(quiet=talk.quiet)
    make_folder(directory)
    annotated = Path(directory) / f"{SAMPLE_LOG_NAME}.annotated.mcap"
    with open_sample_log(SAMPLE_LOG_NAME) as source:
        job = Job(
            command="demo",
            source=str(source),
            stages={},
            reading=ReadingOptions(),
            writing=WritingOptions(output=str(annotated), force=True),
            talk=talk,
            metrics_dir=str(Path(directory) / f"{SAMPLE_LOG_NAME}-metrics"),
        )
        outcome = run_and_write(add_all_stages(job, gather_default_options()))
    page = Path(directory) / f"{SAMPLE_LOG_NAME}.html"
    if _write_page_unless_packages_missing(annotated, page):
        outcome.run.written.insert(0, str(page))
    if talk.json:
        console.print_document("demo", {"runs": [job_document(job, outcome)]})
    else:
        print_outcome(job, console, outcome, NEXT_COMMAND_HINT)


def _write_page_unless_packages_missing(annotated: Path, page: Path) -> bool:
    """Write the page of the annotated log; False where the packages that it needs are not installed."""
    from importlib.util import find_spec

    if any(find_spec(name) is None for name in PACKAGES_NEEDED_FOR_HTML_PAGE):
        return False
    from cwcli.output import write_file
    from cwcli.report.build import build_report

    write_file(str(page), build_report(str(annotated)).html, force=True)
    return True


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
