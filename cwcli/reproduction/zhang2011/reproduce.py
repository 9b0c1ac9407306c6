"""The study of zhang2011: the lanes on rendered drives, then the car's motion."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from cwcli.pipeline.result import SummaryTable
from cwcli.process_pool import process_pool_killed_on_error
from cwcli.reproduction.findings import StudyPart
from cwcli.reproduction.findings_report import Reproduction, assemble_reproduction
from cwcli.reproduction.request import ReproductionRequest
from cwcli.reproduction.zhang2011.drives import DRIVE_BY_FIGURE, MAX_DRIVE_SEEDS, drive_errors_part
from cwcli.reproduction.zhang2011.example import printed_tables_part, worked_example_part
from cwcli.reproduction.zhang2011.labelled import LABELLED_FRAMES_FIGURE as LABELLED
from cwcli.reproduction.zhang2011.labelled import labelled_frames_part
from cwcli.reproduction.zhang2011.lanes import run_lane_study
from cwcli.reproduction.zhang2011.motion import simulated_run_part
from cwcli.reproduction.zhang2011.pictures import (
    CROSSOVER_AND_MUTATION_RATES_BY_FIGURE,
    bend_and_straight_part,
    crossover_and_mutation_rates_part,
)
from cwcli.simulation.single_track import PAPER_RUNS
from cwcli.vision.methods import DEFAULT_METHOD

ROAD_SET_FRAMES_FOR_EACH_RENDERED_DRIVE = 250
"""Figures 17 to 19 render one drive for this many frames of a set, which is about as much work."""
PAPER_PARTS_COVERED_BY_LANE_STUDY = ("conclusion 1", "table 4")
"""The parts of the paper that the lane study covers."""


def reproduce_zhang2011(request: ReproductionRequest) -> Reproduction:
    """Run the study."""
    n_rendered_drives = min(request.frames // ROAD_SET_FRAMES_FOR_EACH_RENDERED_DRIVE, request.seeds)
    parts: list[StudyPart] = []
    sections: list[SummaryTable] = []
    if request.labelled is not None and request.wants_any_of((LABELLED,)):
        # First and in this process: a file that is no log is told at once, and it is remembered as an input.
        parts.append(_report_part_done(LABELLED, labelled_frames_part(request.labelled), request.tick))
    note = f"{min(request.seeds, MAX_DRIVE_SEEDS)} seeds, {n_rendered_drives} of them rendered"
    if request.wants_any_of(PAPER_PARTS_COVERED_BY_LANE_STUDY):
        study = run_lane_study(request.frames, jobs=request.jobs, tick=request.tick)
        parts.append(study.shares_part)
        sections.append(study.times)
        note = f"{study.n_judged} frames of each set, {note}"
    parts += _run_other_parts(request, n_rendered_drives)
    notes = [] if request.labelled else ["labelled frames: not given (--labelled LOG)"]
    return assemble_reproduction("zhang2011", parts, note, sections=sections, notes=notes, only=request.only)


def _run_other_parts(request: ReproductionRequest, n_rendered_drives: int) -> list[StudyPart]:
    """Run all parts but the shares of frames, the longest first."""
    tasks: dict[str, tuple[tuple[str, ...], Callable[[], StudyPart]]] = {}
    for figure in DRIVE_BY_FIGURE:
        if n_rendered_drives:
            rendered = partial(drive_errors_part, figure, n_rendered_drives, lane_method=DEFAULT_METHOD)
            tasks[f"{figure}, rendered"] = (figure,), rendered
        tasks[figure] = (figure,), partial(drive_errors_part, figure, request.seeds)
    tasks["search"] = tuple(CROSSOVER_AND_MUTATION_RATES_BY_FIGURE), crossover_and_mutation_rates_part
    tasks["roads"] = ("fig 9", "fig 10"), bend_and_straight_part
    tasks["tables"] = ("table 1", "table 2", "table 3", "table 4", "table 5", "eq 5"), printed_tables_part
    tasks["worked example"] = ("eq 13", "fig 13", "eq 17", "eq 22"), worked_example_part
    tasks |= {figure: ((figure,), partial(simulated_run_part, figure)) for figure in PAPER_RUNS}
    tasks_of_figures = {name: task for name, (figures, task) in tasks.items() if request.wants_any_of(figures)}
    if request.jobs == 1:
        return [_report_part_done(name, task(), request.tick) for name, task in tasks_of_figures.items()]
    with process_pool_killed_on_error(request.jobs) as pool:
        running = {name: pool.submit(task) for name, task in tasks_of_figures.items()}
        return [_report_part_done(name, future.result(), request.tick) for name, future in running.items()]


def _report_part_done(name: str, part: StudyPart, tick: Callable[[str], None]) -> StudyPart:
    """Report that a part is done, and return it."""
    tick(name)
    return part
