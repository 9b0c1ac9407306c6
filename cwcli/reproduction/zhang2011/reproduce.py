"""The study of zhang2011: the lanes on rendered drives, then the car's motion."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from cwcli.reproduction.findings import Part
from cwcli.reproduction.findings_report import Reproduction, reproduction
from cwcli.reproduction.processes import processes
from cwcli.reproduction.zhang2011.drives import DRIVES, MAX_SEEDS, drive_part
from cwcli.reproduction.zhang2011.example import example_part, tables_part
from cwcli.reproduction.zhang2011.labelled import FIGURE as LABELLED
from cwcli.reproduction.zhang2011.labelled import labelled_part
from cwcli.reproduction.zhang2011.lanes import lane_study
from cwcli.reproduction.zhang2011.motion import run_part
from cwcli.reproduction.zhang2011.pictures import RATES, rates_part, roads_part
from cwcli.simulation.single_track import PAPER_RUNS
from cwcli.vision.methods import DEFAULT_METHOD

FRAMES = 500
"""Frames to judge in each set unless an option says otherwise. Chosen by hand; not fitted."""
FRAMES_PER_DRIVE = 250
"""Figures 17 to 19 render one drive for this many frames of a set, which is about as much work."""
LANES = ("conclusion 1", "table 4")
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
    frames: int = FRAMES
    jobs: int = 2
    only: Collection[str] = ()
    labelled: Path | None = None

    @property
    def n_rendered(self) -> int:
        """Number of drives of each of figures 17 to 19 that are rendered for the default lane method."""
        return min(self.frames // FRAMES_PER_DRIVE, self.seeds)


def reproduce_zhang2011(config: ReproduceConfig, tick: Callable[[str], None] = lambda what: None) -> Reproduction:
    """Run the study. `tick` is called with the name of each part that is done."""
    parts: list[Part] = []
    if config.labelled is not None and _is_wanted(config, (LABELLED,)):
        # First and in this process: a file that is no log is told at once, and it is remembered as an input.
        parts.append(_done(LABELLED, labelled_part(config.labelled), tick))
    note = f"{min(config.seeds, MAX_SEEDS)} seeds, {config.n_rendered} of them rendered"
    if _is_wanted(config, LANES):
        study = lane_study(config.frames, jobs=config.jobs, tick=tick)
        parts += [study.part, study.times]
        note = f"{study.n_judged} frames of each set, {note}"
    parts += _others(config, tick)
    notes = [] if config.labelled else ["labelled frames: not given (--labelled LOG)"]
    return reproduction("zhang2011", parts, note, notes=notes, only=config.only)


def _is_wanted(config: ReproduceConfig, figures: Collection[str]) -> bool:
    """Whether any of the figures is wanted."""
    return not config.only or not set(config.only).isdisjoint(figures)


def _others(config: ReproduceConfig, tick: Callable[[str], None]) -> list[Part]:
    """Run all parts but the shares of frames, the longest first."""
    tasks: dict[str, tuple[tuple[str, ...], Callable[[], Part]]] = {}
    for figure in DRIVES:
        if config.n_rendered:
            rendered = partial(drive_part, figure, config.n_rendered, lane_method=DEFAULT_METHOD)
            tasks[f"{figure}, rendered"] = (figure,), rendered
        tasks[figure] = (figure,), partial(drive_part, figure, config.seeds)
    tasks["search"] = tuple(RATES), rates_part
    tasks["roads"] = ("fig 9", "fig 10"), roads_part
    tasks["tables"] = ("table 1", "table 2", "table 3", "table 4", "table 5", "eq 5"), tables_part
    tasks["worked example"] = ("eq 13", "fig 13", "eq 17", "eq 22"), example_part
    tasks |= {figure: ((figure,), partial(run_part, figure)) for figure in PAPER_RUNS}
    wanted = {name: task for name, (figures, task) in tasks.items() if _is_wanted(config, figures)}
    if config.jobs == 1:
        return [_done(name, task(), tick) for name, task in wanted.items()]
    with processes(config.jobs) as pool:
        running = {name: pool.submit(task) for name, task in wanted.items()}
        return [_done(name, future.result(), tick) for name, future in running.items()]


def _done(name: str, part: Part, tick: Callable[[str], None]) -> Part:
    """Report that a part is done, and return it."""
    tick(name)
    return part
