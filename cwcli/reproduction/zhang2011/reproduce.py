"""Stage `reproduce zhang2011`: the lanes on rendered drives, then the car's motion."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

from cwcli.reproduction.findings import Part
from cwcli.reproduction.findings_report import Reproduction, reproduction
from cwcli.reproduction.zhang2011.drives import DRIVES, drive_part
from cwcli.reproduction.zhang2011.lanes import lane_study
from cwcli.reproduction.zhang2011.motion import example_part, run_part
from cwcli.simulation.single_track import PAPER_RUNS
from cwcli.vision.methods import DEFAULT_METHOD

FRAMES = 500
"""Of each set."""
FRAMES_PER_DRIVE = 250
"""Figures 17 to 19 are also rendered: one drive each for so many frames of a set, about as much work."""


@dataclass(frozen=True)
class ReproduceConfig:
    """Settings.

    Attributes:
        seeds: Runs of each of the drives of figures 17 to 19.
        frames: To judge in each rendered set; with fewer, fewer of the drives are rendered too.
        jobs: Processes; the numbers don't depend on it.
    """

    seeds: int = 20
    frames: int = FRAMES
    jobs: int = 2

    @property
    def n_rendered(self) -> int:
        """Drives of each of figures 17 to 19 that are rendered and seen by the default lane method."""
        return min(self.frames // FRAMES_PER_DRIVE, self.seeds)


def reproduce_zhang2011(config: ReproduceConfig, tick: Callable[[str], None] = lambda what: None) -> Reproduction:
    """Run the whole study. `tick` is called with the name of each part that is done."""
    study = lane_study(config.frames, jobs=config.jobs, tick=tick)
    parts = [study.part, *_motion(config, tick)]
    note = f"{study.n_judged} frames of each set, {config.seeds} seeds, {config.n_rendered} of them rendered"
    return reproduction("zhang2011", parts, note, sections=(study.times,))


def _motion(config: ReproduceConfig, tick: Callable[[str], None]) -> list[Part]:
    tasks: dict[str, Callable[[], Part]] = {"worked example": example_part}
    tasks |= {figure: partial(run_part, figure) for figure in PAPER_RUNS}
    for figure in DRIVES:
        tasks[figure] = partial(drive_part, figure, config.seeds)
        if config.n_rendered:
            rendered = partial(drive_part, figure, config.n_rendered, lane_method=DEFAULT_METHOD)
            tasks[f"{figure}, rendered"] = rendered
    if config.jobs == 1:
        return [_done(name, task(), tick) for name, task in tasks.items()]
    with ProcessPoolExecutor(config.jobs) as pool:
        running = {name: pool.submit(task) for name, task in tasks.items()}
        return [_done(name, future.result(), tick) for name, future in running.items()]


def _done(name: str, part: Part, tick: Callable[[str], None]) -> Part:
    tick(name)
    return part
