"""How well a log is predicted: what decides whether an error of a sensor is believed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cwcli.estimation.measurements import RATES
from cwcli.estimation.passes import PassResult, Series
from cwcli.metrics.chi_square import gate_nis
from cwcli.signals.columns import FloatArray

GATE_PROBABILITY = 1.0 - 1e-5
GAIN = 4.5  # of the log-likelihood, by each number that is fitted: three sigma
CLEAR_SIGMAS = 3.0


def prediction_score(series: Sequence[Series], result: PassResult) -> float:
    """Log-likelihood of the rows that are not an inertial sensor's; an outlier counts, but no more than as one."""
    if not np.isfinite(result.last_state).all():
        return -np.inf
    total = 0.0
    for s, nis in zip(series, result.nis, strict=True):
        if s.kind not in RATES and len(s):
            total += float(np.nansum(row_scores(s, nis)))
    return total


def row_scores(s: Series, nis: FloatArray) -> FloatArray:
    """Shape (n,): what each row of a series adds to `prediction_score`; NaN before the start."""
    limit = gate_nis(GATE_PROBABILITY, s.width)
    return np.asarray(-0.5 * (np.minimum(nis[:, 0], limit) + np.log(nis[:, 3])))


def clearly_better(gain: FloatArray, least: float) -> bool:
    """Whether rows are predicted better by more than `least`, in both halves, and in the whole that by three sigma.

    Where a model is wrong, as with errors that last, a few rows make another wrong one look better by chance: the sigma
    is that of the rows' own scatter. What all rows share shows in both halves.

    Args:
        gain: Shape (n,): of the `row_scores` of one source; NaN counts for nothing.
        least: Of the sum.
    """
    gain = gain[np.isfinite(gain)]
    if not len(gain) or min(float(half.sum()) for half in np.array_split(gain, 2)) <= least:
        return False
    return float(gain.sum()) > least + CLEAR_SIGMAS * float(gain.std()) * math.sqrt(len(gain))
