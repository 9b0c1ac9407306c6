"""`cwcli reproduce`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cwcli.cli.console import Console
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import ForceOption, MetricsOption
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_stage_summary, print_written_files
from cwcli.errors import EXIT_DONE, EXIT_GATE_FAILED, UsageError, hint_at_closest_or_all_known_names
from cwcli.lazy_dataclass import dataclass
from cwcli.registry import import_module_attribute
from cwcli.reproduction.request import ReproductionRequest

if TYPE_CHECKING:
    from cwcli.output import AtomicGroup
    from cwcli.reproduction.findings_report import Reproduction

EXAMPLES = (
    "cwcli reproduce song2016",
    "cwcli reproduce song2016 --only fig9 --only table1",
    "cwcli reproduce song2016 --seeds 20 --plots figures/ --json",
    "cwcli reproduce xiang2019 --metrics xiang2019.parquet",
    "cwcli reproduce song2016 --report docs/papers --force",
    "cwcli reproduce zhang2011 --frames 100 --seeds 5 --labelled labelled.mcap",
)
"""Command lines at the end of the command's `--help`."""


@dataclass(frozen=True)
class PaperEntry:
    """The reproduction of one paper.

    Attributes:
        reproduce: `module:name` of the function that takes a `ReproductionRequest` and returns a `Reproduction`.
        seeds: Default number of seeds.
        frames: Default number of frames in each rendered set; 0 for a paper without frames.
    """

    reproduce: str
    seeds: int
    frames: int = 0
    has_labelled: bool = False


REPRODUCTION_BY_PAPER_NAME: dict[str, PaperEntry] = {
    "song2016": PaperEntry("cwcli.reproduction.song2016.reproduce:reproduce_song2016", 100),
    "xiang2019": PaperEntry("cwcli.reproduction.xiang2019.report:reproduce_xiang2019", 1000),
    "zhang2011": PaperEntry("cwcli.reproduction.zhang2011.reproduce:reproduce_zhang2011", 20, 500, has_labelled=True),
}
"""Name of a paper -> its reproduction."""


def _complete_papers(incomplete: str) -> list[str]:
    return [name for name in REPRODUCTION_BY_PAPER_NAME if name.startswith(incomplete)]


def _find_figures(paper: str, only: list[str]) -> tuple[str, ...]:
    """Find the figures and tables that `--only` names, as the expectations spell them.

    Raises:
        UsageError: There is no such figure.
    """
    if not only:
        return ()
    from cwcli.reproduction.expectations import load_expectations

    known = {_letters_and_digits(name): name for name in load_expectations(paper).figures}
    for text in only:
        if _letters_and_digits(text) not in known:
            raise UsageError(f"{paper} has no '{text}'", hint=hint_at_closest_or_all_known_names(text, known))
    return tuple(known[_letters_and_digits(text)] for text in only)


@dataclass(frozen=True)
class ReproductionOptions:
    """What is reproduced, and from how much."""

    seeds: Annotated[
        int | None,
        typer.Option(
            "--seeds",
            metavar="N",
            show_default=", ".join(f"{name}: {entry.seeds}" for name, entry in REPRODUCTION_BY_PAPER_NAME.items()),
            help="Seeds of each scenario; a note says where fewer are used.",
        ),
    ] = None
    jobs: Annotated[
        int, typer.Option("--jobs", metavar="N", help="Number of processes; results don't depend on it.")
    ] = 2
    frames: Annotated[
        int | None,
        typer.Option(
            "--frames",
            metavar="N",
            show_default=", ".join(
                f"{name}: {entry.frames}" for name, entry in REPRODUCTION_BY_PAPER_NAME.items() if entry.frames
            ),
            help="Frames to judge in each rendered set.",
        ),
    ] = None
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="FIGURE", help="Reproduce only this figure or table: fig9, table1. Repeatable."),
    ] = None
    labelled: Annotated[
        str | None,
        typer.Option(
            "--labelled", metavar="LOG", help="Log of real frames with lane labels in TuSimple's format, for zhang2011."
        ),
    ] = None


@dataclass(frozen=True)
class OutputTargets:
    """Files and folders to write."""

    plots: Annotated[
        str | None, typer.Option("--plots", metavar="DIR", help="Draw the figures into this folder (needs matplotlib).")
    ] = None
    plot_format: Annotated[str, typer.Option("--plot-format", metavar="NAME", help="png or svg.")] = "png"
    report: Annotated[
        str | None,
        typer.Option(
            "--report",
            metavar="DIR",
            help="Write PAPER.md into this folder: every figure and table next to ours (needs matplotlib).",
        ),
    ] = None
    metrics: MetricsOption = None
    force: ForceOption = False


def _check_options(paper: str, entry: PaperEntry, options: ReproductionOptions) -> None:
    """Check the options against what the paper takes.

    Raises:
        UsageError: A number is too small, or the paper has no frames or takes no labels.
    """
    if (options.seeds is not None and options.seeds < 2) or options.jobs < 1:
        raise UsageError("--seeds must be at least 2 and --jobs at least 1")
    if options.frames is not None and not entry.frames:
        raise UsageError(f"{paper} renders no frames", hint="leave out --frames")
    if options.frames is not None and options.frames < 1:
        raise UsageError("--frames must be at least 1")
    if options.labelled is not None and not entry.has_labelled:
        raise UsageError(f"{paper} looks at no frames", hint="leave out --labelled")


def _check_output_targets(paper: str, targets: OutputTargets, labelled: str | None) -> None:
    """Check before the work that all outputs can be written and drawn."""
    from cwcli.metrics.table import check_table_file_name
    from cwcli.output import refuse_unwritable_targets

    if targets.metrics is not None:
        check_table_file_name(targets.metrics)
    folder = targets.report
    page = None if folder is None or not Path(folder).is_dir() else str(Path(folder) / f"{paper}.md")
    inputs = () if labelled is None else (labelled,)
    refuse_unwritable_targets([targets.metrics, page], [targets.plots, folder], force=targets.force, inputs=inputs)
    if targets.plots is not None or targets.report is not None:
        from cwcli.reproduction.plots import check_plot_format, require_matplotlib

        check_plot_format(targets.plot_format)
        require_matplotlib()


def _write_outputs(reproduction: Reproduction, paper: str, targets: OutputTargets) -> list[str]:
    """Write all outputs or none; returns the names of the files."""
    from cwcli.metrics.table import write_table
    from cwcli.output import AtomicGroup, make_folder

    file_names: list[str] = []
    with AtomicGroup() as together:
        if targets.plots is not None:
            from cwcli.reproduction.plots import write_plots

            make_folder(targets.plots)
            file_names += write_plots(
                reproduction.plots,
                targets.plots,
                together,
                paper=paper,
                file_format=targets.plot_format,
                force=targets.force,
            )
        if targets.report is not None:
            file_names += _write_report_page(reproduction, targets.report, together, force=targets.force)
        if targets.metrics is not None:
            write_table(reproduction.table, targets.metrics, force=targets.force, together=together)
            file_names.append(targets.metrics)
    return file_names


def _write_report_page(reproduction: Reproduction, folder: str, together: AtomicGroup, *, force: bool) -> list[str]:
    """Write the page, and its pictures into a folder next to it; returns the names of the files."""
    from cwcli.output import make_folder, write_file
    from cwcli.reproduction.page import format_markdown_page, picture_folder_path
    from cwcli.reproduction.plots import write_plots

    paper = reproduction.expectations.paper
    target, pictures = Path(folder) / f"{paper}.md", Path(folder) / picture_folder_path(paper)
    make_folder(pictures, parents=True)
    picture_names = write_plots(
        reproduction.plots, str(pictures), together, paper=paper, file_format="png", force=force
    )
    write_file(target, format_markdown_page(reproduction).encode(), force=force, together=together)
    return [str(target), *picture_names]


def _finding_records(reproduction: Reproduction) -> list[dict[str, str | float | bool | None]]:
    """List the findings as records; numbers that are not finite are None."""
    return [
        {name: None if isinstance(cell, float) and not math.isfinite(cell) else cell for name, cell in record.items()}
        for record in reproduction.table.rows_as_dicts()
    ]


def _letters_and_digits(text: str) -> str:
    return "".join(letter for letter in text.casefold() if letter.isalnum())


def command(
    paper: Annotated[
        str,
        typer.Argument(
            metavar="PAPER",
            autocompletion=_complete_papers,
            help=f"The paper: {', '.join(REPRODUCTION_BY_PAPER_NAME)}.",
        ),
    ],
    talk: TalkOptions,
    options: ReproductionOptions,
    targets: OutputTargets,
) -> int:
    """Reproduce a paper's tables and figures, and compare the numbers with the paper's.

    Each number gets a class with the reason: reproduced, fitted, follows, within own bound, better, differs, not
    determinable or not in the paper. The exit code is 1 if a class that is claimed is not reached.
    """
    entry = REPRODUCTION_BY_PAPER_NAME.get(paper)
    if entry is None:
        raise UsageError(
            f"there is no reproduction of '{paper}'",
            hint=hint_at_closest_or_all_known_names(paper, REPRODUCTION_BY_PAPER_NAME),
        )
    n_seeds = entry.seeds if options.seeds is None else options.seeds
    n_frames = entry.frames if options.frames is None else options.frames
    _check_options(paper, entry, options)
    if targets.report is not None and options.only:
        raise UsageError("--report has every figure", hint="leave out --only, or take --plots")
    figures = _find_figures(paper, options.only or [])
    _check_output_targets(paper, targets, options.labelled)
    with Progress(quiet=talk.quiet) as progress:
        progress.begin_step(f"reproducing {paper}")
        where = None if options.labelled is None else Path(options.labelled)
        request = ReproductionRequest(n_seeds, options.jobs, n_frames, figures, where, progress.begin_step)
        reproduction: Reproduction = import_module_attribute(entry.reproduce)(request)
        file_names = _write_outputs(reproduction, paper, targets)
    console = Console(quiet=talk.quiet)
    if talk.json:
        document = {
            "paper": paper,
            "seeds": n_seeds,
            **({"frames": n_frames} if entry.frames else {}),
            "written": file_names,
            "failed": [f"{each.expected.figure}: {each.expected.what}" for each in reproduction.failed_findings],
            "findings": _finding_records(reproduction),
            **reproduction.summary.to_json(),
        }
        console.print_document("reproduce", document)
    else:
        print_stage_summary(console, reproduction.summary)
        print_written_files(console, file_names)
    return EXIT_GATE_FAILED if reproduction.failed_findings else EXIT_DONE
