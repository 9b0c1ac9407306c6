"""`cwcli reproduce`."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cwcli import __version__
from cwcli.cli.console import Console
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import ForceOption, MetricsOption
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_result, print_written
from cwcli.errors import EXIT_DONE, EXIT_GATE_FAILED, UsageError

if TYPE_CHECKING:
    from cwcli.metrics.table import Table
    from cwcli.pipeline.result import Summary
    from cwcli.reproduction.findings_report import Reproduction

EXAMPLES = (
    "cwcli reproduce song2016",
    "cwcli reproduce song2016 --seeds 20 --plots figures/ --json",
    "cwcli reproduce xiang2019 --metrics xiang2019.parquet",
    "cwcli reproduce zhang2011 --frames 100 --seeds 5",
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


@dataclass(frozen=True)
class Request:
    """What the user wants.

    Attributes:
        seeds: Of each scenario.
        jobs: Processes.
        frames: To judge in each set of rendered frames; 0 for a paper without them.
        tick: To be called with the name of each part that is done.
    """

    seeds: int
    jobs: int
    frames: int
    tick: Callable[[str], None]


Run = Callable[[Request], Outcome]


def _song2016(request: Request) -> Outcome:
    from cwcli.reproduction.song2016.reproduce import ReproduceConfig, reproduce_song2016

    return _outcome(reproduce_song2016(ReproduceConfig(request.seeds, request.jobs), request.tick))


def _xiang2019(request: Request) -> Outcome:
    from cwcli.reproduction.xiang2019.report import report_xiang2019

    result = report_xiang2019(request.seeds, request.tick)
    return Outcome(result.summary, result.table, result.failed)


def _zhang2011(request: Request) -> Outcome:
    from cwcli.reproduction.zhang2011.reproduce import ReproduceConfig, reproduce_zhang2011

    return _outcome(reproduce_zhang2011(ReproduceConfig(request.seeds, request.frames, request.jobs), request.tick))


def _outcome(result: Reproduction) -> Outcome:
    failed = [f"{finding.figure}: {finding.what}" for finding in result.failed]
    return Outcome(result.summary, result.table, failed, result.plots)


@dataclass(frozen=True)
class Paper:
    """One reproduction.

    Attributes:
        run: Makes it.
        seeds: How many, unless the user says.
        has_plots: It draws figures.
        frames: How many rendered frames of each set, unless the user says; 0: it has none.
    """

    run: Run
    seeds: int
    has_plots: bool = False
    frames: int = 0


PAPERS: dict[str, Paper] = {
    "song2016": Paper(_song2016, 100, has_plots=True),
    "xiang2019": Paper(_xiang2019, 1000),
    "zhang2011": Paper(_zhang2011, 20, has_plots=True, frames=500),
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
    frames: Annotated[
        int | None,
        typer.Option(
            "--frames",
            metavar="N",
            show_default=", ".join(f"{name}: {entry.frames}" for name, entry in PAPERS.items() if entry.frames),
            help="Frames to judge in each rendered set.",
        ),
    ] = None,
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
    n_frames = entry.frames if frames is None else frames
    if frames is not None and not entry.frames:
        raise UsageError(f"{paper} renders no frames", hint="leave out --frames")
    if frames is not None and frames < 1:
        raise UsageError("--frames must be at least 1")
    if plots is not None and not entry.has_plots:
        raise UsageError(f"{paper} draws no figures", hint="leave out --plots; --metrics writes every number")
    from cwcli.metrics.table import check_table_name, write_table
    from cwcli.output import Together, check_targets, make_folder

    if metrics is not None:
        check_table_name(metrics)
    check_targets([metrics], [plots], force=force)
    if plots is not None:
        from cwcli.reproduction.plots import check_format

        check_format(plot_format)
    written: list[str] = []
    with Progress(quiet=talk.quiet) as progress:
        progress.step(f"reproducing {paper}")
        outcome = entry.run(Request(n_seeds, jobs, n_frames, progress.step))
        with Together() as together:
            if plots is not None:
                from cwcli.reproduction.plots import write_plots

                make_folder(plots)
                written += write_plots(
                    outcome.plots, plots, together, paper=paper, file_format=plot_format, force=force
                )
            if metrics is not None:
                write_table(outcome.table, metrics, force=force, together=together)
                written.append(metrics)
    console = Console(quiet=talk.quiet)
    if talk.json:
        document = {
            "cwcli": __version__,
            "command": "reproduce",
            "paper": paper,
            "seeds": n_seeds,
            **({"frames": n_frames} if entry.frames else {}),
            "written": written,
            "failed": list(outcome.failed),
            **outcome.summary.to_json(),
        }
        console.data(json.dumps(document, indent=2, allow_nan=False))
    else:
        print_result(console, outcome.summary)
        print_written(console, written)
    return EXIT_GATE_FAILED if outcome.failed else EXIT_DONE
