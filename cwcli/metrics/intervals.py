"""Confidence intervals: bootstrap, normal, proportion and Poisson. No SciPy: it costs 450 ms to import.

Every function returns the bounds of a two-sided interval; level 0.95 unless told.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import NormalDist

import numpy as np

from cwcli.metrics.bounds import Bounds
from cwcli.signals.columns import FloatArray

Statistic = Callable[[FloatArray], float]
UNKNOWN_INTERVAL = Bounds(float("nan"), float("nan"))
"""The interval of a value for which none can be computed: NaN at both ends."""


MAX_COUNT_FOR_SUMMED_POISSON_INTERVAL = 1000
"""Greatest count up to which Poisson probabilities are summed, which takes time in proportion; chosen by hand."""


def normal_interval(values: FloatArray, level: float = 0.95) -> Bounds:
    """Return the normal interval of the mean of independent values (n,); NaN with fewer than two."""
    _require_level_between_0_and_1(level)
    if len(values) < 2:
        return UNKNOWN_INTERVAL
    mean = float(np.mean(values))
    half = _two_sided_normal_quantile(level) * float(np.std(values, ddof=1)) / math.sqrt(len(values))
    return Bounds(mean - half, mean + half)


def bootstrap_interval(
    values: FloatArray,
    statistic: Statistic = lambda sample: float(np.mean(sample)),
    level: float = 0.95,
    *,
    seed: int,
    n_resamples: int = 2000,
    block: int = 1,
) -> Bounds:
    """Return the percentile bootstrap interval of a statistic (Efron & Tibshirani 1993, ch. 13).

    Args:
        values: Shape (n,).
        statistic: Sample (n,) -> number.
        level: Coverage.
        seed: The same seed gives the same interval.
        n_resamples: Number of resamples.
        block: Neighbours within a time series are alike: resample in runs of this many (circular block bootstrap,
            Politis & Romano 1992); 1 takes the values as independent.

    Raises:
        ValueError: A level outside (0, 1) or a block shorter than 1.
    """
    _require_level_between_0_and_1(level)
    if block < 1:
        raise ValueError(f"a block of {block} values is not positive")
    n = len(values)
    if n < 2:
        return UNKNOWN_INTERVAL
    rng = np.random.default_rng(seed)
    n_blocks = -(-n // block)
    offsets = np.arange(block)
    found = np.empty(n_resamples)
    for index in range(n_resamples):
        starts = rng.integers(0, n, n_blocks)
        rows = ((starts[:, None] + offsets) % n).ravel()[:n]
        found[index] = statistic(values[rows])
    low, high = np.quantile(found, [(1.0 - level) / 2.0, (1.0 + level) / 2.0])
    return Bounds(float(low), float(high))


def clustered_proportion_interval(successes: Sequence[int], trials: Sequence[int], level: float = 0.95) -> Bounds:
    """Return the interval of a share whose trials are correlated within clusters (the frames of one drive).

    Wilson's score with the effective number of trials (Korn & Graubard 1998): n over the design effect, which is the
    ratio of the variance of the clusters' sums to that of independent trials; between the number of clusters and n. If
    all trials agree, nothing tells how alike they are, and each cluster counts as one trial.

    Raises:
        ValueError: Lists of different lengths, or more successes than trials in a cluster.
    """
    if len(successes) != len(trials) or any(not 0 <= k <= n for k, n in zip(successes, trials, strict=False)):
        raise ValueError("each cluster needs its successes and its trials")
    n, n_clusters = sum(trials), sum(count > 0 for count in trials)
    if n == 0:
        return UNKNOWN_INTERVAL
    share = sum(successes) / n
    effective = float(n_clusters)
    if 0.0 < share < 1.0 and n_clusters > 1:
        residuals = [k - share * count for k, count in zip(successes, trials, strict=True)]
        variance = n_clusters / (n_clusters - 1) * sum(r * r for r in residuals)
        design_effect = variance / (n * share * (1.0 - share))
        effective = n / min(max(design_effect, 1.0), n / n_clusters)
    return _wilson_interval(share, effective, level)


def proportion_interval(successes: int, n: int, level: float = 0.95) -> Bounds:
    """Return the interval of a share of n independent trials by Wilson's score (1927); NaN with n = 0.

    Raises:
        ValueError: More successes than trials, or a negative count.
    """
    _require_level_between_0_and_1(level)
    if not 0 <= successes <= n:
        raise ValueError(f"{successes} of {n} is not a share")
    if n == 0:
        return UNKNOWN_INTERVAL
    return _wilson_interval(successes / n, n, level)


def _wilson_interval(share: float, n: float, level: float) -> Bounds:
    """Return Wilson's score interval of a share of n trials; n need not be whole."""
    _require_level_between_0_and_1(level)
    z2 = _two_sided_normal_quantile(level) ** 2
    centre = (share + z2 / (2 * n)) / (1.0 + z2 / n)
    half = math.sqrt(z2 * (share * (1.0 - share) / n + z2 / (4 * n * n))) / (1.0 + z2 / n)
    low = 0.0 if share == 0.0 else centre - half
    high = 1.0 if share == 1.0 else centre + half
    return Bounds(low, high)


def poisson_interval(count: int, level: float = 0.95) -> Bounds:
    """Return the exact interval of the mean of a Poisson count (Garwood 1936); divided by hours it is that of a rate.

    Low solves P(N >= count) = (1 - level)/2, high solves P(N <= count) = (1 - level)/2; with a count of 0 low is 0.

    Raises:
        ValueError: A negative count.
    """
    _require_level_between_0_and_1(level)
    if count < 0:
        raise ValueError(f"a count of {count} is negative")
    tail = (1.0 - level) / 2.0
    if count > MAX_COUNT_FOR_SUMMED_POISSON_INTERVAL:
        return Bounds(_gamma_quantile(float(count), tail), _gamma_quantile(count + 1.0, 1.0 - tail))
    high = _poisson_mean_at_probability(count, tail)
    low = 0.0 if count == 0 else _poisson_mean_at_probability(count - 1, 1.0 - tail)
    return Bounds(low, high)


def _poisson_mean_at_probability(count: int, probability: float) -> float:
    """Return the mean with P(N <= count) = probability, by bisection: that probability falls as the mean grows."""
    low, high = 0.0, count + 10.0
    while _poisson_cdf(count, high) > probability:
        high *= 2.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        if _poisson_cdf(count, middle) > probability:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def _gamma_quantile(shape: float, probability: float) -> float:
    """Return a quantile of the gamma distribution of a large shape (Wilson and Hilferty 1931), to 1e-6 from 1000 on."""
    z = NormalDist().inv_cdf(probability)
    root: float = 1.0 - 1.0 / (9.0 * shape) + z / (3.0 * math.sqrt(shape))
    return shape * root**3


def _poisson_cdf(count: int, mean: float) -> float:
    """Return P(N <= count) for a Poisson variable N."""
    if mean == 0.0:
        return 1.0
    log_mean = math.log(mean)
    return math.fsum(math.exp(k * log_mean - mean - math.lgamma(k + 1.0)) for k in range(count + 1))


def _two_sided_normal_quantile(level: float) -> float:
    """Return the z that a standard normal variable stays within with probability `level`."""
    return NormalDist().inv_cdf(0.5 + level / 2.0)


def _require_level_between_0_and_1(level: float) -> None:
    """Raise `ValueError` unless the level lies between 0 and 1."""
    if not 0.0 < level < 1.0:
        raise ValueError(f"a level of {level} is not between 0 and 1")
