"""`cwcli reproduce`."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from cwcli import __version__
from cwcli.cli.console import Console
from cwcli.cli.options.shared import ForceOption, MetricsOption, TalkOptions
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_result, print_written
from cwcli.errors import EXIT_DONE, EXIT_GATE_FAILED, UsageError

EXAMPLES = (
    "cwcli reproduce song2016",
    "cwcli reproduce song2016 --seeds 20 --plots figures/ --json",
)
PAPERS = ("song2016",)


def _papers(incomplete: str) -> list[str]:
    return [name for name in PAPERS if name.startswith(incomplete)]


def command(
    paper: Annotated[
        str,
        typer.Argument(
            metavar="PAPER", show_default=False, autocompletion=_papers, help=f"The paper: {', '.join(PAPERS)}."
        ),
    ],
    talk: TalkOptions,
    seeds: Annotated[int, typer.Option("--seeds", metavar="N", help="Seeds of each scenario.")] = 100,
    jobs: Annotated[int, typer.Option("--jobs", metavar="N", help="Processes; the numbers don't depend on it.")] = 2,
    plots: Annotated[
        str | None,
        typer.Option(
            "--plots", metavar="DIR", show_default=False, help="Draw the figures into this folder (needs matplotlib)."
        ),
    ] = None,
    plot_format: Annotated[str, typer.Option("--plot-format", metavar="NAME", help="png or svg.")] = "png",
    metrics: MetricsOption = None,
    force: ForceOption = False,
) -> int:
    """Make a paper's tables and figures again and set ours beside the paper's.

    The exit code is 1 if a number is worse than the paper's where it must not be.
    """
    if paper not in PAPERS:
        raise UsageError(f"there is no reproduction of '{paper}'", hint=f"one of: {', '.join(PAPERS)}")
    if seeds < 2 or jobs < 1:
        raise UsageError("--seeds must be at least 2 and --jobs at least 1")
    from cwcli.metrics.table import check_table_target, write_table
    from cwcli.stages.song2016.plots import write_plots
    from cwcli.stages.song2016.reproduce import ReproduceConfig, reproduce_song2016

    if metrics is not None:
        check_table_target(metrics, force=force)
    written: list[str] = []
    with Progress(quiet=talk.quiet) as progress:
        progress.step(f"reproducing {paper}")
        result = reproduce_song2016(ReproduceConfig(seeds, jobs), progress.step)
        if plots is not None:
            from cwcli.cli.pipeline import make_folder

            make_folder(plots)
            written += write_plots(result.plots, plots, file_format=plot_format, force=force)
        if metrics is not None:
            write_table(result.table, metrics, force=force)
            written.append(metrics)
    console = Console(quiet=talk.quiet)
    if talk.json:
        document = {
            "cwcli": __version__,
            "command": "reproduce",
            "paper": paper,
            "written": written,
            "failed": [f"{finding.figure}: {finding.what}" for finding in result.failed],
            **result.summary.to_json(),
        }
        console.data(json.dumps(document, indent=2, allow_nan=False))
    else:
        print_result(console, result.summary)
        print_written(console, written)
    return EXIT_GATE_FAILED if result.failed else EXIT_DONE
