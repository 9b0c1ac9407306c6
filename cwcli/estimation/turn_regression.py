"""Ratio of the turns of two sources by a line through all steps, for logs with few clear turns.

`source_checks` takes the ratio in each step with a clear turn. A log with one long bend has too few of these. A line
y = r x + b through the turns of all steps needs a bend and a straight, and its constant is the bias of a gyroscope.
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.step_motion import StepMotion
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.signals.normal_distribution import SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION

MIN_REGRESSED_STEPS = 6
"""Least number of pairs of neighbouring time steps whose turns are regressed against those of another source. Chosen by
hand."""
MIN_STD_OF_TURNS_RAD = 0.15
"""Least standard deviation of the turns of the steps, rad: a bend and a straight in 4 s each. Chosen by hand."""
HALF_INTERVAL_OF_RATIO_IN_SIGMAS = 4.0
"""Half the width of the interval of the ratio in sigmas: neighbouring steps share a fix, and are not independent.
Chosen by hand; not fitted."""
MAX_TURN_RESIDUAL_IN_SCATTERS = 4.0
"""Largest residual, in scatters of the residuals, that the second pass of the regression uses; jumps of fixes lie
beyond. Chosen by hand."""
MIN_RESIDUAL_SCATTER_RAD = 0.01
"""Least scatter of the residuals of the regression line, rad. Chosen by hand: the bias of a gyroscope drifts by so much
in a step."""
KINDS_BY_INCREASING_TURN_NOISE = (Kind.YAW_RATE, Kind.HEADING, Kind.VELOCITY, Kind.POSITION)
"""Kinds from the least noise of a turn to the largest; the abscissa of a line must have little noise."""


@dataclass(frozen=True)
class TurnRatio:
    """Ratio of the turns of one source to those of another, with its interval; NaN where it is not known."""

    value: float = math.nan
    low: float = math.nan
    high: float = math.nan
    n: int = 0


def regressed_turn_ratio(one: StepMotion, other: StepMotion) -> TurnRatio:
    """Return the ratio of the turns of `one` to those of `other`."""
    if {one.kind, other.kind} - set(KINDS_BY_INCREASING_TURN_NOISE):
        return TurnRatio()
    is_one_quiet = KINDS_BY_INCREASING_TURN_NOISE.index(one.kind) < KINDS_BY_INCREASING_TURN_NOISE.index(other.kind)
    x, y = (one.turn_rad, other.turn_rad) if is_one_quiet else (other.turn_rad, one.turn_rad)
    rows = np.isfinite(x) & np.isfinite(y) & (np.abs(x) < math.pi / 2.0) & (np.abs(y) < math.pi / 2.0)
    for _ in range(2):
        n = int(rows.sum())
        if n < MIN_REGRESSED_STEPS:
            return TurnRatio()
        dx, dy = x[rows] - x[rows].mean(), y[rows] - y[rows].mean()
        power = float(np.einsum("i,i", dx, dx))
        if math.sqrt(power / n) < MIN_STD_OF_TURNS_RAD:
            noise_rad = float((other if is_one_quiet else one).turn_sigma_rad[rows].mean())
            return _turn_ratio_of_nearly_still_source(dx, dy, noise_rad, is_one_quiet=is_one_quiet)
        slope = float(np.einsum("i,i", dx, dy)) / power
        rest = np.full(len(x), np.inf)
        rest[rows] = np.abs(dy - slope * dx)
        scatter = max(
            MIN_RESIDUAL_SCATTER_RAD, SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION * median_of_finite_values(rest[rows])
        )
        sigma = math.sqrt(float(np.square(rest[rows]).sum()) / (n - 2) / power)
        rows &= rest < MAX_TURN_RESIDUAL_IN_SCATTERS * scatter
    low, high = slope - HALF_INTERVAL_OF_RATIO_IN_SIGMAS * sigma, slope + HALF_INTERVAL_OF_RATIO_IN_SIGMAS * sigma
    if not is_one_quiet:
        return TurnRatio(slope, low, high, n)
    if low * high <= 0.0:
        return TurnRatio()  # the inverse is not known
    return TurnRatio(1.0 / slope, 1.0 / high, 1.0 / low, n)


def _turn_ratio_of_nearly_still_source(
    still: FloatArray, turning: FloatArray, noise_rad: float, *, is_one_quiet: bool
) -> TurnRatio:
    """Return the ratio where the source of less noise hardly turns and the other one clearly does.

    Args:
        still, turning: Shape (n,): turns of both without their means.
        noise_rad: One sigma of the noise of the turning one.
        is_one_quiet: The ratio is that of the other one to the still one, else its inverse.
    """
    n, power = len(turning), float(np.einsum("i,i", turning, turning))
    if math.sqrt(power / n) < max(2.0 * MIN_STD_OF_TURNS_RAD, 3.0 * noise_rad):
        return TurnRatio()
    slope = float(np.einsum("i,i", still, turning)) / power
    sigma = float(np.sqrt(np.mean(np.square(still - slope * turning)))) / math.sqrt(power)
    low, high = slope - HALF_INTERVAL_OF_RATIO_IN_SIGMAS * sigma, slope + HALF_INTERVAL_OF_RATIO_IN_SIGMAS * sigma
    return TurnRatio(slope, low, high, n) if is_one_quiet else TurnRatio()
