"""Chi-square distribution, without a 450 ms import of SciPy. Tests compare it with SciPy."""

from __future__ import annotations

import math
from functools import lru_cache

from cwcli.kernels.gamma import lower_gamma_series, upper_gamma_fraction


def chi_square_cdf(x: float, dof: float) -> float:
    """Return the probability that a chi-square variable with `dof` degrees of freedom is at most x.

    Regularised incomplete gamma function: its series below the mean, its continued fraction above (Abramowitz and
    Stegun 6.5.29, 6.5.31).
    """
    if x <= 0.0:
        return 0.0
    a, h = 0.5 * dof, 0.5 * x
    front = math.exp(a * math.log(h) - h - math.lgamma(a))
    if h < a + 1.0:
        return front * lower_gamma_series(a, h)
    return 1.0 - front * upper_gamma_fraction(a, h)


@lru_cache(maxsize=256)
def chi_square_quantile(probability: float, dof: float) -> float:
    """Return the value that a chi-square variable exceeds with 1 - probability, by bisection on its distribution.

    Raises:
        ValueError: A probability outside (0, 1).
    """
    if not 0.0 < probability < 1.0:
        raise ValueError(f"probability {probability} is not between 0 and 1")
    low, high = 0.0, dof + 10.0
    while chi_square_cdf(high, dof) < probability:
        high *= 2.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        if chi_square_cdf(middle, dof) < probability:
            low = middle
        else:
            high = middle
        if high - low <= 1e-12 * high:
            break
    return 0.5 * (low + high)


def nis_gate_limit(probability: float, dof: int) -> float:
    """Return the limit of the innovation gate, a normalised innovation squared.

    Args:
        probability: Probability that a measurement that fits stays below the limit; 1: there is no gate.
        dof: Number of values of a measurement.

    Returns:
        The limit; 0 without a gate.
    """
    return chi_square_quantile(probability, dof) if probability < 1.0 else 0.0


def chi_square_mean_bounds(dof: float, count: float, level: float = 0.95) -> tuple[float, float]:
    """Return two-sided bounds of the mean of chi-square variables; NaN without any.

    Args:
        dof: Degrees of freedom of each variable.
        count: Number of independent variables; for a correlated series the effective number, which need not be whole.
        level: Share of the means that lie between the bounds.
    """
    if count <= 0:
        return math.nan, math.nan
    tail = 0.5 * (1.0 - level)
    total = dof * count
    return chi_square_quantile(tail, total) / count, chi_square_quantile(1.0 - tail, total) / count
