"""Chi-square distribution, without a 450 ms import of SciPy. Tests compare it with SciPy."""

from __future__ import annotations

import math
from functools import lru_cache

from cwcli.kernels import gamma
from cwcli.metrics.bounds import Bounds


@lru_cache(maxsize=256)
def chi_square_quantile(probability: float, dof: float) -> float:
    """Return the value that a chi-square variable exceeds with 1 - probability, by bisection on its distribution.

    Raises:
        ValueError: A probability outside (0, 1).
    """
    if not 0.0 < probability < 1.0:
        raise ValueError(f"probability {probability} is not between 0 and 1")
    return gamma.chi_square_quantile(probability, dof, math.lgamma(0.5 * dof))


def nis_gate_limit(probability: float, dof: int) -> float:
    """Return the limit of the innovation gate, a normalised innovation squared.

    Args:
        probability: Probability that a measurement that fits stays below the limit; 1: there is no gate.
        dof: Number of values of a measurement.

    Returns:
        The limit; 0 without a gate.
    """
    return chi_square_quantile(probability, dof) if probability < 1.0 else 0.0


def chi_square_mean_bounds(dof: float, count: float, level: float = 0.95) -> Bounds:
    """Return two-sided bounds of the mean of chi-square variables; NaN without any.

    Args:
        dof: Degrees of freedom of each variable.
        count: Number of independent variables; for a correlated series the effective number, which need not be whole.
        level: Share of the means that lie between the bounds.
    """
    if count <= 0:
        return Bounds(math.nan, math.nan)
    tail = 0.5 * (1.0 - level)
    total = dof * count
    return Bounds(chi_square_quantile(tail, total) / count, chi_square_quantile(1.0 - tail, total) / count)
