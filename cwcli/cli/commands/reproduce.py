"""`cwcli reproduce`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cwcli.cli.console import Console
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import ForceOption, MetricsOption
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_result, print_written
from cwcli.errors import EXIT_DONE, EXIT_GATE_FAILED, UsageError, names_hint

if TYPE_CHECKING:
    from cwcli.output import Together
    from cwcli.reproduction.findings_report import Reproduction

EXAMPLES = (
    "cwcli reproduce song2016",
    "cwcli reproduce song2016 --only fig9 --only table1",
    "cwcli reproduce song2016 --seeds 20 --plots figures/ --json",
    "cwcli reproduce xiang2019 --metrics xiang2019.parquet",
    "cwcli reproduce song2016 --report docs/papers --force",
    "cwcli reproduce zhang2011 --frames 100 --seeds 5 --labelled labelled.mcap",
)


@dataclass(frozen=True)
class Request:
    """What the user wants.

    Attributes:
        seeds: Of each scenario.
        jobs: Processes.
        frames: To judge in each set of rendered frames; 0 for a paper without them.
        only: Figures and tables that are wanted; none: all.
        labelled: A log with labelled frames, or None.
        tick: To be called with the name of each part that is done.
    """

    seeds: int
    jobs: int
    frames: int
    only: tuple[str, ...]
    labelled: Path | None
    tick: Callable[[str], None]


Run = Callable[[Request], "Reproduction"]


def _song2016(request: Request) -> Reproduction:
    from cwcli.reproduction.song2016.reproduce import ReproduceConfig, reproduce_song2016

    return reproduce_song2016(ReproduceConfig(request.seeds, request.jobs, request.only), request.tick)


def _xiang2019(request: Request) -> Reproduction:
    from cwcli.reproduction.xiang2019.report import ReproduceConfig, report_xiang2019

    return report_xiang2019(ReproduceConfig(request.seeds, request.only), request.tick)


def _zhang2011(request: Request) -> Reproduction:
    from cwcli.reproduction.zhang2011.reproduce import ReproduceConfig, reproduce_zhang2011

    config = ReproduceConfig(request.seeds, request.frames, request.jobs, request.only, request.labelled)
    return reproduce_zhang2011(config, request.tick)


@dataclass(frozen=True)
class Paper:
    """One reproduction.

    Attributes:
        run: Makes it.
        seeds: How many, unless the user says.
        frames: How many rendered frames of each set, unless the user says; 0: it has none.
        has_labelled: It takes labelled frames.
    """

    run: Run
    seeds: int
    frames: int = 0
    has_labelled: bool = False


PAPERS: dict[str, Paper] = {
    "song2016": Paper(_song2016, 100),
    "xiang2019": Paper(_xiang2019, 1000),
    "zhang2011": Paper(_zhang2011, 20, frames=500, has_labelled=True),
}


def _papers(incomplete: str) -> list[str]:
    return [name for name in PAPERS if name.startswith(incomplete)]


def _figures(paper: str, only: list[str]) -> tuple[str, ...]:
    """The figures and tables that `--only` names, as the expectations write them.

    Raises:
        UsageError: There is no such figure.
    """
    if not only:
        return ()
    from cwcli.reproduction.expectations import load_expectations

    known = {_plain(name): name for name in load_expectations(paper).figures}
    for text in only:
        if _plain(text) not in known:
            raise UsageError(f"{paper} has no '{text}'", hint=names_hint(text, known))
    return tuple(known[_plain(text)] for text in only)


@dataclass(frozen=True)
class Targets:
    """What is to be written: see the options."""

    plots: str | None
    plot_format: str
    report: str | None
    metrics: str | None
    force: bool


def _check(paper: str, entry: Paper, seeds: int, jobs: int, *, frames: int | None, labelled: str | None) -> None:
    """Refuse numbers and inputs that a paper has no use for.

    Raises:
        UsageError: As it says.
    """
    if seeds < 2 or jobs < 1:
        raise UsageError("--seeds must be at least 2 and --jobs at least 1")
    if frames is not None and not entry.frames:
        raise UsageError(f"{paper} renders no frames", hint="leave out --frames")
    if frames is not None and frames < 1:
        raise UsageError("--frames must be at least 1")
    if labelled is not None and not entry.has_labelled:
        raise UsageError(f"{paper} looks at no frames", hint="leave out --labelled")


def _check_targets(paper: str, targets: Targets, labelled: str | None) -> None:
    """Refuse what can't be written or drawn, before any work is done."""
    from cwcli.metrics.table import check_table_name
    from cwcli.output import check_targets

    if targets.metrics is not None:
        check_table_name(targets.metrics)
    folder = targets.report
    page = None if folder is None or not Path(folder).is_dir() else str(Path(folder) / f"{paper}.md")
    inputs = () if labelled is None else (labelled,)
    check_targets([targets.metrics, page], [targets.plots, folder], force=targets.force, inputs=inputs)
    if targets.plots is not None or targets.report is not None:
        from cwcli.reproduction.plots import check_format, check_matplotlib

        check_format(targets.plot_format)
        check_matplotlib()


def _write(made: Reproduction, paper: str, targets: Targets) -> list[str]:
    """All that is asked for, or nothing; the names of the files."""
    from cwcli.metrics.table import write_table
    from cwcli.output import Together, make_folder

    written: list[str] = []
    with Together() as together:
        if targets.plots is not None:
            from cwcli.reproduction.plots import write_plots

            make_folder(targets.plots)
            written += write_plots(
                made.plots, targets.plots, together, paper=paper, file_format=targets.plot_format, force=targets.force
            )
        if targets.report is not None:
            written += _write_report(made, targets.report, together, force=targets.force)
        if targets.metrics is not None:
            write_table(made.table, targets.metrics, force=targets.force, together=together)
            written.append(targets.metrics)
    return written


def _write_report(made: Reproduction, folder: str, together: Together, *, force: bool) -> list[str]:
    """The page and its pictures, in a folder beside it; the names of the files."""
    from cwcli.output import make_folder, write_file
    from cwcli.reproduction.page import page, picture_folder
    from cwcli.reproduction.plots import write_plots

    paper = made.expectations.paper
    target, pictures = Path(folder) / f"{paper}.md", Path(folder) / picture_folder(paper)
    make_folder(pictures, parents=True)
    written = write_plots(made.plots, str(pictures), together, paper=paper, file_format="png", force=force)
    write_file(target, page(made).encode(), force=force, together=together)
    return [str(target), *written]


def _findings(made: Reproduction) -> list[dict[str, str | float | bool | None]]:
    """The findings with their numbers; what there is not is null."""
    return [
        {name: None if isinstance(cell, float) and not math.isfinite(cell) else cell for name, cell in record.items()}
        for record in made.table.records()
    ]


def _plain(text: str) -> str:
    return "".join(letter for letter in text.casefold() if letter.isalnum())


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
            help="Seeds of each scenario; a note tells where fewer are taken.",
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
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only", metavar="FIGURE", show_default=False, help="This figure or table alone: fig9, table1; repeatable."
        ),
    ] = None,
    labelled: Annotated[
        str | None,
        typer.Option(
            "--labelled",
            metavar="LOG",
            show_default=False,
            help="Real frames with labels of lanes in TuSimple's form, for zhang2011.",
        ),
    ] = None,
    report: Annotated[
        str | None,
        typer.Option(
            "--report",
            metavar="DIR",
            show_default=False,
            help="Write PAPER.md into this folder: every figure and table beside ours (needs matplotlib).",
        ),
    ] = None,
    metrics: MetricsOption = None,
    force: ForceOption = False,
) -> int:
    """Make a paper's tables and figures again and set ours beside the paper's.

    Each number gets a class: reproduced, fitted, within own bound, better, differs or not determinable, with the
    reason. The exit code is 1 if a class that is claimed is not reached.
    """
    entry = PAPERS.get(paper)
    if entry is None:
        raise UsageError(f"there is no reproduction of '{paper}'", hint=names_hint(paper, PAPERS))
    n_seeds = entry.seeds if seeds is None else seeds
    n_frames = entry.frames if frames is None else frames
    _check(paper, entry, n_seeds, jobs, frames=frames, labelled=labelled)
    if report is not None and only:
        raise UsageError("--report has every figure", hint="leave out --only, or take --plots")
    wanted = _figures(paper, only or [])
    targets = Targets(plots, plot_format, report, metrics, force)
    _check_targets(paper, targets, labelled)
    with Progress(quiet=talk.quiet) as progress:
        progress.step(f"reproducing {paper}")
        where = None if labelled is None else Path(labelled)
        made = entry.run(Request(n_seeds, jobs, n_frames, wanted, where, progress.step))
        written = _write(made, paper, targets)
    console = Console(quiet=talk.quiet)
    if talk.json:
        document = {
            "paper": paper,
            "seeds": n_seeds,
            **({"frames": n_frames} if entry.frames else {}),
            "written": written,
            "failed": [f"{each.expected.figure}: {each.expected.what}" for each in made.failed],
            "findings": _findings(made),
            **made.summary.to_json(),
        }
        console.document("reproduce", document)
    else:
        print_result(console, made.summary)
        print_written(console, written)
    return EXIT_GATE_FAILED if made.failed else EXIT_DONE
