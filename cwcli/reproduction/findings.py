"""One line of the reproduction: what the paper says, what we get, and whether that will do."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from cwcli.metrics.intervals import bootstrap_interval
from cwcli.signals.columns import FloatArray

NOT_PRINTED = math.nan
BOOTSTRAP_SEED = 2016


@dataclass(frozen=True)
class Finding:
    """One compared number.

    Attributes:
        figure: Where it stands in the paper: `table 1`, `fig 9`.
        what: Which quantity, of which method.
        unit: Its unit.
        paper: The paper's number, NaN where it prints none.
        ours: Ours: mean or median over the seeds, as `what` says.
        low, high: 95 % interval of `ours` over the seeds; NaN where there is nothing random in it.
        verdict: `reproduced` (or the bound that `what` tells is met), `better`, `worse`, `differs`, or `reported`
            where there is nothing to compare with.
        is_required: A `worse` or `differs` here makes the command fail.
    """

    figure: str
    what: str
    unit: str
    paper: float
    ours: float
    low: float
    high: float
    verdict: str
    is_required: bool = False

    @property
    def has_failed(self) -> bool:
        """Whether it is worse where it must not be."""
        return self.is_required and self.verdict in {"worse", "differs"}


@dataclass(frozen=True)
class Curve:
    """One line of a plot: shape (k,) each; a dot at `dot_x` if there is one (a warning)."""

    label: str
    x: FloatArray
    y: FloatArray
    dot_x: float = math.nan


@dataclass(frozen=True)
class Plot:
    """One figure of the paper, redrawn.

    Attributes:
        figure: `fig 9`.
        title, x_label, y_label: Text.
        curves: What is drawn.
        marks: Label -> x of a vertical line (an ideal moment).
        level: Label and y of a horizontal line (a threshold), or None.
        x_range, y_range: What is shown; None: everything.
    """

    figure: str
    title: str
    x_label: str
    y_label: str
    curves: Sequence[Curve]
    marks: Mapping[str, float] = field(default_factory=dict)
    level: tuple[str, float] | None = None
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None


@dataclass(frozen=True)
class Part:
    """The findings and plots of one group of figures."""

    findings: tuple[Finding, ...]
    plots: tuple[Plot, ...] = ()


def median_interval(values: FloatArray) -> tuple[float, float, float]:
    """Median and its 95 % bootstrap interval; all NaN without values."""
    known = values[np.isfinite(values)]
    if not len(known):
        return math.nan, math.nan, math.nan
    low, high = bootstrap_interval(known, lambda sample: float(np.median(sample)), seed=BOOTSTRAP_SEED, n_resamples=500)
    return float(np.median(known)), low, high


def within(ours: float, paper: float, tolerance: float) -> str:
    """`reproduced` if ours is within the tolerance of the paper's number, else `differs`."""
    return "reproduced" if abs(ours - paper) <= tolerance + 1e-9 else "differs"


def ordered(values: Sequence[float]) -> bool:
    """Whether the values rise strictly."""
    return all(a < b for a, b in pairwise(values))
