"""`cwcli merge`."""

from __future__ import annotations

from typing import Annotated

from cwcli.cli.console import Console
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.progress import Progress
from cwcli.cli.text import format_count

EXAMPLES = (
    "cwcli run logs/ --shard 1/8 -d shards/1",
    "cwcli merge shards/* -d out/",
)
"""Command lines at the end of the command's `--help`."""


def command(
    shards: Annotated[
        list[str], typer.Argument(metavar="SHARD", help="Output folders or s3:// URLs of all shards of one run.")
    ],
    talk: TalkOptions,
    directory: Annotated[
        str,
        typer.Option("--directory", "-d", metavar="DIR", help="Write the whole run here: a folder or an s3:// URL."),
    ],
) -> None:
    """Merge the output folders of a run's shards into the one that a single run would have written.

    The shards must be all parts of one run, with one pipeline and one version, and every log must be done or failed.
    The same command continues a merge that was killed.
    """
    from cwcli.fleet.merge import merge_shards
    from cwcli.logs.read.remote import is_remote_url
    from cwcli.output import refuse_unwritable_targets
    from cwcli.url import display_name_of_url

    if not is_remote_url(directory):
        refuse_unwritable_targets([], [directory])
    console = Console(quiet=talk.quiet)
    shown_directory = display_name_of_url(directory) if is_remote_url(directory) else directory
    with Progress(quiet=talk.quiet) as progress:
        progress.begin_step(f"merging into {shown_directory}")
        result = merge_shards(shards, directory, progress)
    if talk.json:
        said = {
            "directory": shown_directory,
            "shards": result.n_shards,
            "logs": result.n_logs,
            "failed": result.n_failed,
            "copied": result.n_copied,
        }
        console.print_document("merge", said)
        return
    failed = f", {result.n_failed} failed" if result.n_failed else ""
    shown = f"{format_count(result.n_logs, 'log')} of {format_count(result.n_shards, 'shard')}"
    console.print_summary(f"merged {shown} into {shown_directory}{failed}")
