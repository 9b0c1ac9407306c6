"""Student's distribution: how much wider an interval is where the scatter itself comes from few values."""

from __future__ import annotations

import math


def student_to_normal_quantile_ratio(dof: int) -> float:
    """Return the ratio of Student's 97.5 % quantile to that of the normal distribution.

    Exact for one and two degrees of freedom, else Abramowitz and Stegun 26.7.5, within 1 %.

    Args:
        dof: Degrees of freedom, at least 1.
    """
    if dof == 1:
        return math.tan(0.475 * math.pi) / 1.959964
    if dof == 2:
        return 0.95 * math.sqrt(2.0 / (1.0 - 0.95**2)) / 1.959964
    return 1.0 + (1.210 + (1.440 + 1.304 / dof) / dof) / dof
