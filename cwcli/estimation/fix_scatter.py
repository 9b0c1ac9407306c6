"""Scatter of rows about their neighbours: their white noise without any other source.

The estimator finds the noise of a source from its innovations. If another source is wrong, the innovations grow, and
the noise with them; then everything looks consistent. The scatter does not know the other sources, so it shows it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from cwcli.estimation.measurements import QUANTITY_BY_KIND, Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.parameter import ParameterStatus
from cwcli.estimation.passes import N_MOTION_STATES, SensorSeries
from cwcli.estimation.result import SourceReport
from cwcli.signals.columns import FloatArray, StateCovariance
from cwcli.signals.normal_distribution import SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION
from cwcli.signals.vehicle_state import X, Y

MAX_NOISE_TO_SCATTER_RATIO = 2.0
"""Greatest ratio of the noise by the estimator to the scatter. Chosen by hand: it is 0.9 to 1.1 in simulated drives
without a fault."""
MAX_NOISE_TO_SCATTER_RATIO_WITH_ONE_SOURCE_LEFT_OUT = 1.5
"""Greatest such ratio of sources that agree after one was left out. Chosen by hand, between that without a fault and
the greatest one."""
MIN_NOISE_EXCESS_SHARE_OVER_SCATTER, MIN_NOISE_EXCESS_OVER_SCATTER_SIGMAS = 0.15, 4.0
"""Least share by which noise is clearly larger than the scatter, and least excess in sigmas of the ratio, which is
1 / sqrt(n) for n rows. Chosen by hand: the greatest ratio in simulated drives without a fault is 1.1, of 181 rows."""
ROUNDING_ERROR_SIGMA_IN_STEPS = 12.0**-0.5
"""One sigma of the error of a rounded value, in steps: that of a uniform distribution."""
MIN_NOISE_COMPARED_WITH_SCATTER_BY_KIND: Mapping[Kind, float] = {
    Kind.POSITION: 1.5,
    Kind.VELOCITY: 0.7,
    Kind.SPEED: 0.7,
    Kind.HEADING: 0.07,
}
"""Least noise of each kind that is compared with its scatter, in m, m/s and rad. Chosen by hand: the errors of a
receiver under open sky last for minutes and are 1.5 m; 0.7 m/s is twice, and 0.07 rad (4 degrees) is twice the default
noise of the kind in `QUANTITY_BY_KIND`."""


MIN_LASTING_ERROR_RAISING_DOUBT_SHARE = 0.25
"""Least lasting error that raises a doubt, as a share of those of `MIN_NOISE_COMPARED_WITH_SCATTER_BY_KIND`.
Chosen by hand: as much as a car's place is off by half a degree of heading in 4 s."""
MAX_SLOW_FIX_ERROR_ALONG_TO_ACROSS_PATH_RATIO = 1.4
"""Greatest ratio of the changes of a slow error of fixes along the way to those across it that raises no doubt. Chosen
by hand: it is 0.9 to 1.0 in the scenario `phone`, and 1.5 to 8 where a speed waves or slips."""
MAX_SLOW_ERROR_TO_SCATTER_RATIO_OF_BLAMELESS_FIXES = 10.0
"""Greatest ratio of a slow error of fixes to their scatter from which another source is blamed. Chosen by hand: it is 1
to 5 where a speed is wrong, and above 20 where the receiver smooths its fixes, which then lag along the way, too."""
KINDS_WITH_LASTING_ERROR_DOUBT = (Kind.POSITION, Kind.SPEED, Kind.HEADING)
"""Kinds whose lasting errors raise a doubt. The velocity of a receiver is smoothed, so its errors always last."""


def noise_sigma_from_scatter_about_neighbours(s: SensorSeries) -> float:
    """Return one sigma of the white noise of a series on each axis, in its unit, or NaN for fewer than three rows.

    For white noise, x[i-1] - 2 x[i] + x[i+1] has six times the variance of a row. An acceleration adds to it, so the
    scatter of slow sources comes out too large, never too small.
    """
    if len(s) < 3:
        return math.nan
    x = np.unwrap(s.values[:, :1], axis=0) if s.kind is Kind.HEADING else s.values[:, : s.n_values_per_row]
    return max(scatter_about_neighbours(x), ROUNDING_ERROR_SIGMA_IN_STEPS * max(s.coarse_steps_m))


def scatter_about_neighbours(values: FloatArray) -> float:
    """Return one sigma of the white noise of three or more rows (n, d) on each axis, by their second differences."""
    second_difference = values[2:] - 2.0 * values[1:-1] + values[:-2]
    return (
        SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION
        * median_of_finite_values(np.abs(second_difference).ravel())
        / math.sqrt(6.0)
    )


def is_sigma_a_lasting_error(kind: Kind, sigma: float, scatter: float) -> bool:
    """Whether the noise that the estimator found is no noise of the source but an error that lasts."""
    return kind in MIN_NOISE_COMPARED_WITH_SCATTER_BY_KIND and sigma > max(
        MAX_NOISE_TO_SCATTER_RATIO * scatter, MIN_NOISE_COMPARED_WITH_SCATTER_BY_KIND[kind]
    )


def is_sigma_clearly_above_scatter(sigma: float, scatter: float, n_rows: int) -> bool:
    """Whether the noise that the estimator found of n rows is larger than their scatter, beyond chance."""
    excess = max(MIN_NOISE_EXCESS_SHARE_OVER_SCATTER, MIN_NOISE_EXCESS_OVER_SCATTER_SIGMAS / math.sqrt(max(n_rows, 1)))
    return sigma > (1.0 + excess) * scatter


def lasting_error_sigma(report: SourceReport) -> float:
    """Return one sigma of the errors of a source that last, in its unit; 0 where its scatter explains its noise.

    It is 0, too, where messages state the noise.
    """
    if report.kind not in QUANTITY_BY_KIND or report.noise_origin not in ("log", "message, scaled"):
        return 0.0
    scatter = max(report.scatter, QUANTITY_BY_KIND[report.kind].floor_sigma)  # NaN stays, and no noise is beyond it
    if not is_sigma_clearly_above_scatter(report.sigma, scatter, report.n_used):
        return 0.0
    return math.sqrt(report.sigma**2 - scatter**2)


def is_lasting_error_large(report: SourceReport) -> bool:
    """Whether errors of a source that last are large enough to doubt that all sources are right."""
    return report.kind in KINDS_WITH_LASTING_ERROR_DOUBT and lasting_error_sigma(report) > (
        MIN_LASTING_ERROR_RAISING_DOUBT_SHARE * MIN_NOISE_COMPARED_WITH_SCATTER_BY_KIND[report.kind]
    )


def is_slow_error_one_of_speed(report: SourceReport) -> bool:
    """Whether a slow error of fixes lies along the way, as only one that another source causes does."""
    slow = report.slow_error
    return slow.status is ParameterStatus.USED and slow.along_to_across > MAX_SLOW_FIX_ERROR_ALONG_TO_ACROSS_PATH_RATIO


def may_speed_be_blamed_for_slow_error(report: SourceReport) -> bool:
    """Whether a slow error of fixes lies along the way, and they are not so smooth that they may lag themselves."""
    return (
        is_slow_error_one_of_speed(report)
        and report.slow_error.sigma < MAX_SLOW_ERROR_TO_SCATTER_RATIO_OF_BLAMELESS_FIXES * report.scatter
    )


def is_sigma_explained_by_scatter(kind: Kind, sigma: float, scatter: float) -> bool:
    """Whether the noise is clearly that of the source alone: half of what would be an error that lasts, or less."""
    if kind not in MIN_NOISE_COMPARED_WITH_SCATTER_BY_KIND:
        return True
    return not sigma > max(
        MAX_NOISE_TO_SCATTER_RATIO_WITH_ONE_SOURCE_LEFT_OUT * scatter,
        0.5 * MIN_NOISE_COMPARED_WITH_SCATTER_BY_KIND[kind],
    )


def covariance_from_lasting_errors(reports: Sequence[SourceReport]) -> StateCovariance:
    """Return the covariance (8, 8) that fixes add whose noise is larger than their scatter.

    What neighbouring rows do not scatter lasts, and no filter averages it out. It is that of the position source with
    the least of it; 0 where one has no more noise than scatter, states its noise, or has a slow error in the model.
    """
    added = np.zeros((N_MOTION_STATES, N_MOTION_STATES))
    variances_m2 = [
        lasting_error_sigma(r) ** 2 if r.slow_error.status is not ParameterStatus.USED else 0.0
        for r in reports
        if r.kind is Kind.POSITION and r.n_used
    ]
    added[X, X] = added[Y, Y] = min(variances_m2, default=0.0)
    return added
