"""The study of zhang2011: the lanes on rendered drives, then the car's motion."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path

from cwcli.lazy_dataclass import dataclass
from cwcli.pipeline.result import SummaryTable
from cwcli.process_pool import process_pool
from cwcli.reproduction.findings import StudyPart
from cwcli.reproduction.findings_report import Reproduction, assemble_reproduction
from cwcli.reproduction.zhang2011.drives import DRIVE_BY_FIGURE, MAX_DRIVE_SEEDS, drive_part
from cwcli.reproduction.zhang2011.example import printed_tables_part, worked_example_part
from cwcli.reproduction.zhang2011.labelled import LABELLED_FRAMES_FIGURE as LABELLED
from cwcli.reproduction.zhang2011.labelled import labelled_frames_part
from cwcli.reproduction.zhang2011.lanes import run_lane_study
from cwcli.reproduction.zhang2011.motion import simulated_run_part
from cwcli.reproduction.zhang2011.pictures import RATES_BY_FIGURE, bend_and_straight_part, search_rates_part
from cwcli.simulation.single_track import PAPER_RUNS
from cwcli.vision.methods import DEFAULT_METHOD

DEFAULT_FRAMES_PER_SET = 500
"""Frames to judge in each set unless an option says otherwise. Chosen by hand; not fitted."""
FRAMES_PER_RENDERED_DRIVE = 250
"""Figures 17 to 19 render one drive for this many frames of a set, which is about as much work."""
LANE_FIGURES = ("conclusion 1", "table 4")
"""The parts of the paper that the lane study covers."""


@dataclass(frozen=True)
class ReproduceConfig:
    """Settings of the study.

    Attributes:
        seeds: Runs of each of the drives of figures 17 to 19.
        frames: To judge in each rendered set; with fewer, fewer of the drives are rendered too.
        jobs: Processes; the numbers don't depend on it.
        only: Figures that are wanted; none: all.
        labelled: A log with labelled frames, or None.
    """

    seeds: int = 20
    frames: int = DEFAULT_FRAMES_PER_SET
    jobs: int = 2
    only: Collection[str] = ()
    labelled: Path | None = None

    @property
    def n_rendered_drives(self) -> int:
        """Number of drives of each of figures 17 to 19 that are rendered for the default lane method."""
        return min(self.frames // FRAMES_PER_RENDERED_DRIVE, self.seeds)


def reproduce_zhang2011(config: ReproduceConfig, tick: Callable[[str], None] = lambda what: None) -> Reproduction:
    """Run the study. `tick` is called with the name of each part that is done."""
    parts: list[StudyPart] = []
    sections: list[SummaryTable] = []
    if config.labelled is not None and _is_any_figure_wanted(config, (LABELLED,)):
        # First and in this process: a file that is no log is told at once, and it is remembered as an input.
        parts.append(_report_part_done(LABELLED, labelled_frames_part(config.labelled), tick))
    note = f"{min(config.seeds, MAX_DRIVE_SEEDS)} seeds, {config.n_rendered_drives} of them rendered"
    if _is_any_figure_wanted(config, LANE_FIGURES):
        study = run_lane_study(config.frames, jobs=config.jobs, tick=tick)
        parts.append(study.shares_part)
        sections.append(study.times)
        note = f"{study.n_judged} frames of each set, {note}"
    parts += _run_other_parts(config, tick)
    notes = [] if config.labelled else ["labelled frames: not given (--labelled LOG)"]
    return assemble_reproduction("zhang2011", parts, note, sections=sections, notes=notes, only=config.only)


def _is_any_figure_wanted(config: ReproduceConfig, figures: Collection[str]) -> bool:
    """Whether any of the figures is wanted."""
    return not config.only or not set(config.only).isdisjoint(figures)


def _run_other_parts(config: ReproduceConfig, tick: Callable[[str], None]) -> list[StudyPart]:
    """Run all parts but the shares of frames, the longest first."""
    tasks: dict[str, tuple[tuple[str, ...], Callable[[], StudyPart]]] = {}
    for figure in DRIVE_BY_FIGURE:
        if config.n_rendered_drives:
            rendered = partial(drive_part, figure, config.n_rendered_drives, lane_method=DEFAULT_METHOD)
            tasks[f"{figure}, rendered"] = (figure,), rendered
        tasks[figure] = (figure,), partial(drive_part, figure, config.seeds)
    tasks["search"] = tuple(RATES_BY_FIGURE), search_rates_part
    tasks["roads"] = ("fig 9", "fig 10"), bend_and_straight_part
    tasks["tables"] = ("table 1", "table 2", "table 3", "table 4", "table 5", "eq 5"), printed_tables_part
    tasks["worked example"] = ("eq 13", "fig 13", "eq 17", "eq 22"), worked_example_part
    tasks |= {figure: ((figure,), partial(simulated_run_part, figure)) for figure in PAPER_RUNS}
    wanted = {name: task for name, (figures, task) in tasks.items() if _is_any_figure_wanted(config, figures)}
    if config.jobs == 1:
        return [_report_part_done(name, task(), tick) for name, task in wanted.items()]
    with process_pool(config.jobs) as pool:
        running = {name: pool.submit(task) for name, task in wanted.items()}
        return [_report_part_done(name, future.result(), tick) for name, future in running.items()]


def _report_part_done(name: str, part: StudyPart, tick: Callable[[str], None]) -> StudyPart:
    """Report that a part is done, and return it."""
    tick(name)
    return part
