"""Scatter of fixes about their neighbours: their white noise without any other source.

The estimator finds the noise of fixes from their innovations. If another source is wrong, the innovations grow, and the
noise with them; then everything looks consistent. The scatter does not know the other sources, so it shows it.
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.estimation.median import MEDIAN_ABSOLUTE_TO_SIGMA, median
from cwcli.estimation.passes import SensorSeries

MAX_NOISE_TO_SCATTER_RATIO = 3.0
"""Greatest ratio of the noise of fixes by the estimator to their scatter. Chosen by hand: it is 0.9 to 1.1 in simulated
drives without a fault."""
MIN_LASTING_ERROR_M = 1.5
"""Least noise of fixes that is compared with their scatter, m. Chosen by hand: the errors of a receiver under open sky
last for minutes, and are that large."""


def scatter_about_neighbours_m(fixes: SensorSeries) -> float:
    """Return one sigma of the white noise of fixes on each axis, m, or NaN for fewer than three.

    For white noise, x[i-1] - 2 x[i] + x[i+1] has six times the variance of a fix. An acceleration adds to it, so the
    scatter of slow fixes comes out too large, never too small.
    """
    if len(fixes) < 3:
        return math.nan
    x = fixes.values
    second_difference = x[2:] - 2.0 * x[1:-1] + x[:-2]
    return MEDIAN_ABSOLUTE_TO_SIGMA * median(np.abs(second_difference).ravel()) / math.sqrt(6.0)


def is_noise_beyond_scatter(sigma_m: float, scatter_m: float) -> bool:
    """Whether the noise that the estimator found is no noise of the fixes but an error that lasts."""
    return sigma_m > max(MAX_NOISE_TO_SCATTER_RATIO * scatter_m, MIN_LASTING_ERROR_M)
