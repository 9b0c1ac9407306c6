"""A map that stretches the way to the east more than that to the north, or less, as the accelerations of an IMU show.

Degrees of longitude that were taken for as long as those of latitude stretch it by 1.5 at 48 degrees north. A turn rate
and the accelerations do not know the map: with each stretch taken off the fixes, the accelerations by their speed and
by the turn rate are compared with those measured. The likeliest stretch has to be clearly likelier than none.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.source_hypotheses import MIN_LOG_LIKELIHOOD_GAIN_OF_HYPOTHESIS
from cwcli.lazy_dataclass import replace
from cwcli.signals.columns import FloatArray

MAP_STEP_S = 4.0
"""Length of the time steps, s: the noise of a receiver hardly shows, and a car brakes for as long. Chosen by hand."""
TRIED_STRETCHES = tuple(np.exp(np.linspace(-1.1, 1.1, 23)).tolist())
"""Stretches that are tried, in steps of a tenth from a third to three: 1 / cos(70 degrees). Chosen by hand."""
MIN_STRETCH = 1.18
"""Least stretch that is told: beyond what ACCEL_RATIO_RANGE leaves to banked roads. Chosen by hand."""
MIN_SHARE_OF_COMPARED_STEPS = 0.8
"""Least share of the steps that have to be known with a stretch taken off, too. Chosen by hand; not fitted."""
SMALLEST_POWER = 1e-6
"""Least product of powers, (m/s^2)^4, and least share of a variance, from which a logarithm is taken."""
MeasuredAndReference = tuple[FloatArray, FloatArray]
"""Accelerations (n, 2) by an IMU and by the fixes with its turn rate, without their medians, m/s^2."""


def stretch_of_map_or_nan(
    fixes: SensorSeries, accelerations_by_fixes: Callable[[SensorSeries], MeasuredAndReference | None]
) -> float:
    """Return how many times as far to the east as to the north the fixes move; NaN where no stretch is clear.

    Args:
        fixes: Positions.
        accelerations_by_fixes: Compares them with an IMU; None: with too few manoeuvres.
    """
    if (plain := accelerations_by_fixes(fixes)) is None:
        return math.nan
    n = len(plain[0])
    gains = []
    for stretch in TRIED_STRETCHES:
        found = accelerations_by_fixes(replace(fixes, values=fixes.values / np.array([stretch, 1.0])))
        is_enough = found is not None and len(found[0]) >= MIN_SHARE_OF_COMPARED_STEPS * n
        gains.append(_log_likelihood(n, found) - _log_likelihood(n, plain) if found and is_enough else -math.inf)
    best = int(np.argmax(gains))
    stretch = TRIED_STRETCHES[best]
    is_clear = gains[best] > MIN_LOG_LIKELIHOOD_GAIN_OF_HYPOTHESIS and abs(math.log(stretch)) > math.log(MIN_STRETCH)
    return stretch if is_clear and 0 < best < len(TRIED_STRETCHES) - 1 else math.nan


def _log_likelihood(n: int, accelerations: MeasuredAndReference) -> float:
    """Return the log-likelihood of accelerations in n steps, each of both with its own scale and noise."""
    total = 0.0
    for own, other in zip(*(column.T for column in accelerations), strict=True):
        power = float(own @ own) * float(other @ other)
        unexplained = 1.0 - max(float(own @ other), 0.0) ** 2 / max(power, SMALLEST_POWER)
        total -= 0.5 * n * math.log(max(unexplained, SMALLEST_POWER))
    return total
