"""What is reproduced of a paper, and from how much."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path

from cwcli.lazy_dataclass import dataclass


@dataclass(frozen=True)
class ReproductionRequest:
    """What to reproduce of a paper.

    Attributes:
        seeds: Seeds per scenario, paired seeds, or runs of each drive; a note of the result says where fewer are used.
        jobs: Processes; the numbers do not depend on it.
        frames: Frames to judge in each rendered set; with fewer, fewer drives are rendered too. 0: none.
        only: Figures and tables that are wanted, as the expectations spell them; none: all.
        labelled: A log with labelled frames, or None.
        tick: Called with the name of each part that is done.
    """

    seeds: int
    jobs: int = 2
    frames: int = 0
    only: Collection[str] = ()
    labelled: Path | None = None
    tick: Callable[[str], None] = lambda name: None

    def wants_any_of(self, figures: Collection[str]) -> bool:
        """Whether any of the figures is wanted."""
        return not self.only or not set(self.only).isdisjoint(figures)
