"""Log-likelihood of a prediction, by which the search decides whether to model an error of a sensor."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO
from cwcli.estimation.passes import PassResult, SensorSeries
from cwcli.metrics.chi_square import nis_gate_limit
from cwcli.signals.columns import FloatArray

INNOVATION_CAP_PROBABILITY = 1.0 - 1e-5
"""Probability of the chi-square quantile to which a larger squared innovation is reduced. Chosen by hand."""
MIN_LIKELIHOOD_GAIN_PER_PARAMETER = 4.5
"""Least gain of log-likelihood per fitted parameter: three sigma of a parabola."""
MIN_LIKELIHOOD_GAIN_SIGMAS = 3.0
"""Least gain in sigmas of the scatter between rows. Chosen as for other significance tests; not fitted."""


def bounded_log_likelihood_without_inertial_sensors(series: Sequence[SensorSeries], result: PassResult) -> float:
    """Return the log-likelihood of all rows but those of inertial sensors; the loss of an outlier is bounded."""
    if not np.isfinite(result.last_state).all():
        return -np.inf
    total = 0.0
    for s, nis in zip(series, result.nis, strict=True):
        if s.kind not in KINDS_THAT_IMU_MEASURES_TOO and len(s):
            total += float(np.nansum(row_log_likelihoods(s, nis)))
    return total


def row_log_likelihoods(s: SensorSeries, nis: FloatArray) -> FloatArray:
    """Return the log-likelihood (n,) of each row of a series, without constants; NaN before the start."""
    limit = nis_gate_limit(INNOVATION_CAP_PROBABILITY, s.n_values_per_row)
    return np.asarray(-0.5 * (np.minimum(nis[:, 0], limit) + np.log(nis[:, 3])))


def is_prediction_clearly_better(gains: FloatArray, min_gain: float) -> bool:
    """Whether rows are predicted better by more than `min_gain` in both halves, and in the whole by three sigma more.

    The sigma is that of the scatter between rows, because with errors that last a few rows may prefer a wrong model by
    chance. A real gain shows in both halves.

    Args:
        gains: Shape (n,): gain of each row of one source in `row_log_likelihoods`; NaN is ignored.
        min_gain: Least gain of each half.
    """
    gains = gains[np.isfinite(gains)]
    if not len(gains) or min(float(half.sum()) for half in np.array_split(gains, 2)) <= min_gain:
        return False
    return float(gains.sum()) > min_gain + MIN_LIKELIHOOD_GAIN_SIGMAS * float(gains.std()) * math.sqrt(len(gains))
