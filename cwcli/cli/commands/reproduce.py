"""`cwcli reproduce`."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cwcli import __version__
from cwcli.cli.console import Console
from cwcli.cli.options.shared import ForceOption, MetricsOption, TalkOptions
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_result, print_written
from cwcli.errors import EXIT_DONE, EXIT_GATE_FAILED, UsageError

if TYPE_CHECKING:
    from cwcli.metrics.table import Table
    from cwcli.stages.result import Summary

EXAMPLES = (
    "cwcli reproduce song2016",
    "cwcli reproduce song2016 --seeds 20 --plots figures/ --json",
    "cwcli reproduce xiang2019 --metrics xiang2019.parquet",
)


@dataclass(frozen=True)
class Outcome:
    """What a reproduction made.

    Attributes:
        summary: For people and `--json`.
        table: Every number.
        failed: What is worse than the paper's where it must not be.
        plots: The redrawn figures, for `--plots`.
    """

    summary: Summary
    table: Table
    failed: Sequence[str]
    plots: Sequence[Any] = ()


Run = Callable[[int, int, Callable[[str], None]], Outcome]


def _song2016(seeds: int, jobs: int, tick: Callable[[str], None]) -> Outcome:
    from cwcli.stages.song2016.reproduce import ReproduceConfig, reproduce_song2016

    result = reproduce_song2016(ReproduceConfig(seeds, jobs), tick)
    failed = [f"{finding.figure}: {finding.what}" for finding in result.failed]
    return Outcome(result.summary, result.table, failed, result.plots)


def _xiang2019(seeds: int, jobs: int, tick: Callable[[str], None]) -> Outcome:
    from cwcli.stages.xiang2019_report import report_xiang2019

    result = report_xiang2019(seeds, tick)
    return Outcome(result.summary, result.table, result.failed)


@dataclass(frozen=True)
class Paper:
    """One reproduction.

    Attributes:
        run: Takes seeds, processes and a callback for progress.
        seeds: How many, unless the user says.
        has_plots: It draws figures.
    """

    run: Run
    seeds: int
    has_plots: bool = False


PAPERS: dict[str, Paper] = {
    "song2016": Paper(_song2016, 100, has_plots=True),
    "xiang2019": Paper(_xiang2019, 1000),
}


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
    seeds: Annotated[
        int | None,
        typer.Option(
            "--seeds",
            metavar="N",
            show_default=", ".join(f"{name}: {entry.seeds}" for name, entry in PAPERS.items()),
            help="Seeds of each scenario.",
        ),
    ] = None,
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
    entry = PAPERS.get(paper)
    if entry is None:
        raise UsageError(f"there is no reproduction of '{paper}'", hint=f"one of: {', '.join(PAPERS)}")
    n_seeds = entry.seeds if seeds is None else seeds
    if n_seeds < 2 or jobs < 1:
        raise UsageError("--seeds must be at least 2 and --jobs at least 1")
    if plots is not None and not entry.has_plots:
        raise UsageError(f"{paper} draws no figures", hint="leave out --plots; --metrics writes every number")
    from cwcli.metrics.table import check_table_target, write_table

    if metrics is not None:
        check_table_target(metrics, force=force)
    if plots is not None:
        from cwcli.cli.pipeline import check_folder
        from cwcli.stages.song2016.plots import check_format

        check_folder(plots, "--plots")
        check_format(plot_format)
    written: list[str] = []
    with Progress(quiet=talk.quiet) as progress:
        progress.step(f"reproducing {paper}")
        outcome = entry.run(n_seeds, jobs, progress.step)
        if plots is not None:
            from cwcli.cli.pipeline import make_folder
            from cwcli.stages.song2016.plots import write_plots

            make_folder(plots)
            written += write_plots(outcome.plots, plots, file_format=plot_format, force=force)
        if metrics is not None:
            write_table(outcome.table, metrics, force=force)
            written.append(metrics)
    console = Console(quiet=talk.quiet)
    if talk.json:
        document = {
            "cwcli": __version__,
            "command": "reproduce",
            "paper": paper,
            "seeds": n_seeds,
            "written": written,
            "failed": list(outcome.failed),
            **outcome.summary.to_json(),
        }
        console.data(json.dumps(document, indent=2, allow_nan=False))
    else:
        print_result(console, outcome.summary)
        print_written(console, written)
    return EXIT_GATE_FAILED if outcome.failed else EXIT_DONE
