"""How well a log is predicted: what decides whether an error of a sensor is believed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.measurements import RATES
from cwcli.estimation.passes import PassResult, Series
from cwcli.metrics.chi_square import gate_nis

GATE_PROBABILITY = 1.0 - 1e-5
GAIN = 4.5  # of the log-likelihood, by each number that is fitted: three sigma


def prediction_score(series: Sequence[Series], result: PassResult) -> float:
    """Log-likelihood of the rows that are not an inertial sensor's; an outlier counts, but no more than as one."""
    if not np.isfinite(result.last_state).all():
        return -np.inf
    total = 0.0
    for s, nis in zip(series, result.nis, strict=True):
        if s.kind not in RATES and len(s):
            limit = gate_nis(GATE_PROBABILITY, s.width)
            total -= 0.5 * float(np.nansum(np.minimum(nis[:, 0], limit) + np.log(nis[:, 3])))
    return total
