"""Headings that are rounded to coarse steps, such as the sixteen points of a compass.

On a straight road such a heading errs by the same angle for minutes, which no filter averages out. Only where it
changes by one step is the true heading known: it is halfway.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cwcli.estimation.repeated_rows import quantisation_step_or_zero_or_infinity
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray

MIN_COARSE_HEADING_STEP_RAD = math.radians(3.0)
"""Least step of a heading that counts as coarse, rad. Chosen by hand: finer ones err by less than a compass does."""
MAX_DIFFERENCE_OF_SAME_HEADING_RAD = 1e-6
"""Greatest difference of two headings that are the same, rad: rounding of numbers."""
MAX_HEADING_CHANGE_DURATION_S = 1.0
"""Longest time between the two rows of a change, s: a car turns by 30 degrees in it. Chosen by hand."""


@dataclass(frozen=True)
class CoarseHeadings:
    """Where headings change by one step.

    Attributes:
        step_rad: The step.
        time_s, heading_rad: Shape (k,): time and heading halfway through each change.
        rows: Shape (k,): the row behind each change.
    """

    step_rad: float
    time_s: FloatArray
    heading_rad: FloatArray
    rows: npt.NDArray[np.intp]

    def note_for_user(self, source: str) -> str:
        """Return what the user is told."""
        return (
            f"{source}: its headings are rounded to steps of {math.degrees(self.step_rad):.3g} degrees: only the "
            f"{len(self.time_s)} changes from one step to the next are used"
        )


def find_coarse_headings(time_s: FloatArray, heading_rad: FloatArray) -> CoarseHeadings | None:
    """Return the changes of headings (n,) at times (n,) that are rounded to coarse steps; None where they are fine."""
    change_rad = np.diff(heading_rad)
    change_rad = (change_rad + math.pi) % (2.0 * math.pi) - math.pi
    step_rad = quantisation_step_or_zero_or_infinity(np.abs(change_rad), MAX_DIFFERENCE_OF_SAME_HEADING_RAD)
    if not math.isfinite(step_rad) or step_rad < MIN_COARSE_HEADING_STEP_RAD:
        return None
    duration_s = np.diff(time_s)
    is_one_step = (np.abs(change_rad) > MAX_DIFFERENCE_OF_SAME_HEADING_RAD) & (np.abs(change_rad) < 1.5 * step_rad)
    rows = np.flatnonzero(is_one_step & (duration_s <= MAX_HEADING_CHANGE_DURATION_S))
    return CoarseHeadings(
        step_rad,
        time_s[rows] + 0.5 * duration_s[rows],
        heading_rad[rows] + 0.5 * change_rad[rows],
        rows + 1,
    )
