"""The results of a part of a reproduction: numbers, and the figures of the paper redrawn."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.intervals import bootstrap_interval
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.signals.columns import FloatArray

BOOTSTRAP_SEED = 2016
"""Seed of the bootstrap intervals, the year of song2016; any seed would do."""


@dataclass(frozen=True)
class Curve:
    """One line of a plot, x and y of shape (k,).

    A dot at `dot_x` if that is finite (a warning), and an open diamond at `printed_x`, where the paper has the dot.
    """

    label: str
    x: FloatArray
    y: FloatArray
    dot_x: float = math.nan
    printed_x: float = math.nan
    is_points: bool = False


@dataclass(frozen=True)
class Plot:
    """One figure of the paper, redrawn.

    Attributes:
        figure: Its name: `fig 9`.
        title, x_label, y_label: Text.
        curves: What is drawn.
        marks: Label -> x of a vertical line (an ideal moment).
        level: Label and y of a horizontal line (a threshold), or None.
        x_range, y_range: What is shown; None: everything.
        image: A grey picture under the curves, shape (height, width); then x is its column and y its row from below.
        is_map: Both axes have the same scale.
        detail: x and y range that are drawn again, enlarged, where curves are near each other; None: nothing.
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
    image: npt.NDArray[np.uint8] | None = None
    is_map: bool = False
    detail: tuple[tuple[float, float], tuple[float, float]] | None = None


@dataclass(frozen=True)
class StudyPart:
    """The numbers and plots of one group of figures."""

    numbers: tuple[MeasuredNumber, ...]
    plots: tuple[Plot, ...] = ()


def median_and_interval_bounds(values: FloatArray) -> tuple[float, float, float]:
    """Return the median and its 95 % bootstrap interval; all NaN without values."""
    known = values[np.isfinite(values)]
    if not len(known):
        return math.nan, math.nan, math.nan
    low, high = bootstrap_interval(known, lambda sample: float(np.median(sample)), seed=BOOTSTRAP_SEED, n_resamples=500)
    return float(np.median(known)), low, high


def is_strictly_increasing(values: Sequence[float]) -> bool:
    """Whether the values rise strictly."""
    return all(a < b for a, b in pairwise(values))
