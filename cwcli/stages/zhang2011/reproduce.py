"""Stage `reproduce zhang2011`: the lanes on rendered drives, then the car's motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cwcli.stages.findings_report import Reproduction, reproduction
from cwcli.stages.zhang2011.lanes import lane_study
from cwcli.stages.zhang2011.motion import motion_parts

FRAMES = 500
"""Of each set."""


@dataclass(frozen=True)
class ReproduceConfig:
    """Settings.

    Attributes:
        seeds: Runs of each of the drives of figures 17 to 19.
        frames: To judge in each rendered set.
        jobs: Processes; the numbers don't depend on it.
    """

    seeds: int = 20
    frames: int = FRAMES
    jobs: int = 2


def reproduce_zhang2011(config: ReproduceConfig, tick: Callable[[str], None] = lambda what: None) -> Reproduction:
    """Run the whole study. `tick` is called with the name of each part that is done."""
    study = lane_study(config.frames, jobs=config.jobs, tick=tick)
    parts = [study.part, *motion_parts(config.seeds, tick)]
    note = f"{study.n_judged} frames of each set, {config.seeds} seeds"
    return reproduction("zhang2011", parts, note, sections=(study.times,))
