"""Standard errors of measures to first order, from the covariances of the two states.

sigma^2 = J_e P_e J_e' + J_o P_o J_o', with the derivatives as central differences. A measure that is undefined after
one of the steps has no sigma: it is not smooth there.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.signals.columns import FloatArray

DIFFERENCE_STEPS = np.array([1e-4, 1e-4, 1e-4, 1e-5, 1e-4, 1e-5, 1e-4])
"""Steps of the differences in x, y, speed, heading, acceleration, yaw rate and jerk, SI units. Chosen by hand."""


def sigmas_of_measures(
    pair: Pair, covariances: tuple[FloatArray, FloatArray], measures: Mapping[str, Measure]
) -> dict[str, FloatArray]:
    """Compute the sigmas of pointwise measures at each of the host's stamps.

    Args:
        pair: Both vehicles at r stamps.
        covariances: Covariances of the host's and the other's states then, (r, 8, 8) each.
        measures: The measures by name.

    Returns:
        Name -> (r,); NaN where the covariances are not known, or the measure is not smooth.
    """
    n, rows = len(DIFFERENCE_STEPS), len(pair.stamp_ns)
    total = {name: np.zeros(rows) for name in measures}
    for is_host, covariance in zip((True, False), covariances, strict=True):
        slopes = {name: np.zeros((rows, n)) for name in measures}
        for column in range(n):
            ends = [
                _pair_with_shifted_state(pair, is_host, column, sign * DIFFERENCE_STEPS[column]) for sign in (-1.0, 1.0)
            ]
            for name, measure in measures.items():
                low, high = (end.evaluate_measure(measure) for end in ends)
                with np.errstate(invalid="ignore"):
                    slopes[name][:, column] = (high - low) / (2.0 * DIFFERENCE_STEPS[column])
        for name, slope in slopes.items():
            total[name] += np.einsum("ri,rij,rj->r", slope, covariance[:, :n, :n], slope)
    return {name: np.where(value >= 0.0, np.sqrt(np.maximum(value, 0.0)), np.nan) for name, value in total.items()}


def _pair_with_shifted_state(pair: Pair, is_host: bool, column: int, step: float) -> Pair:
    """The pair with one quantity of one vehicle's states changed by a step."""
    host, others, own, theirs = (
        pair.host.state,
        pair.other_states,
        pair.host_accel_yaw_rate_jerk,
        pair.other_derivatives,
    )
    states, motions = ([host, others], [own, theirs])
    which = 0 if is_host else 1
    if column < 4:
        states[which] = _copy_with_shifted_column(states[which], column, step)
    else:
        motions[which] = _copy_with_shifted_column(motions[which], column - 4, step)
    track = ActualTrack(pair.stamp_ns, np.concatenate([states[0][:, :4], motions[0]], axis=1))
    return pair.with_states(track, states[1], motions[1])


def _copy_with_shifted_column(values: FloatArray, column: int, step: float) -> FloatArray:
    """A copy of the values with a step added to one column."""
    out = values.copy()
    out[:, column] += step
    return out
