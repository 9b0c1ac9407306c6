"""Innovation matching: the factor on a series' noise variance that agrees with the filter's innovations."""

from __future__ import annotations

import numpy as np

from cwcli.estimation.parameter import ParameterStatus
from cwcli.estimation.passes import SensorSeries
from cwcli.kernels.estimation import matching_factor
from cwcli.signals.columns import FloatArray

MIN_ROWS_FOR_NOISE = 50
"""Least number of rows from which noise is estimated. Chosen by hand; not fitted."""
MAX_NOISE_FACTOR_PER_CALL = 64.0
"""Greatest factor by which one call changes a noise variance. Chosen by hand; not fitted."""
N_NOISE_FACTOR_BISECTIONS = 16
"""Number of bisections for the factor: it is exact to 64^(2 / 2^16)."""
MAX_NIS_COUNTED_IN_NOISE = 9.0
"""Greatest squared normalised innovation that is counted: an outlier counts as three sigma."""


def noise_variance_factor(s: SensorSeries, nis: FloatArray, message_factor: float | None = None) -> float:
    """Return the factor on the noise variance that brings the innovations into agreement (innovation matching).

    The equation is mean(min(nu^2 / (h P h' + factor r), 9)) = 1 over all rows, gated ones too: an outlier counts, but
    no more than three sigma. One call moves the variance by at most a factor of 64, because the predicted
    covariance answers to it. A message's own covariance is only ever raised: errors that are slow look small
    from one innovation to the next, and are there all the same. Where they have a state of their own (`slow_state`)
    the noise is what is left of the message's, the white part, and free.

    White noise that was fitted together with an error of the stamps stays as it is: there the log is predicted best,
    and the innovations along the path, which depend little on it, would outweigh those across.

    Args:
        nis: Shape (n, 5): see `PassResult.nis`.
        message_factor: Factor on the noise of the message until now; None: not known, then one call at most halves it.
    """
    if len(nis) < MIN_ROWS_FOR_NOISE or s.is_exact or s.stamp_error.status is ParameterStatus.USED:
        return 1.0
    nu2, prior = nis[:, 1], nis[:, 2]
    r = s.noise[:, 0] if s.n_values_per_row == 1 else 0.5 * (s.noise[:, 0] + s.noise[:, 2])
    factor = matching_factor(
        nu2,
        prior,
        np.ascontiguousarray(r),
        most=MAX_NOISE_FACTOR_PER_CALL,
        n_steps=N_NOISE_FACTOR_BISECTIONS,
        limit=MAX_NIS_COUNTED_IN_NOISE,
    )
    if s.slow_state < 0:
        if s.noise_origin == "message":
            return factor if factor > 1.1 else 1.0
        if s.noise_origin == "message, scaled":
            return max(factor, 0.5 if message_factor is None else 1.0 / message_factor)
    return max(factor, s.floor**2 / float(r.mean()))
