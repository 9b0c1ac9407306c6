"""How far a measure is off to first order, by the covariances of the two states.

sigma^2 = J_e P_e J_e' + J_o P_o J_o', the derivatives taken as central differences. A measure that one of the steps
makes undefined has no sigma: it is not smooth there.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.signals.columns import FloatArray

STEPS = np.array([1e-4, 1e-4, 1e-4, 1e-5, 1e-4, 1e-5, 1e-4])
"""Of x, y, speed, heading, acceleration, yaw rate and jerk, SI units."""


def sigma_of(
    pair: Pair, covariances: tuple[FloatArray, FloatArray], measures: Mapping[str, Measure]
) -> dict[str, FloatArray]:
    """Sigma of pointwise measures at each of the host's stamps.

    Args:
        pair: Both, r stamps.
        covariances: Of the host and of the other then, (r, 8, 8) each.
        measures: Which, by name.

    Returns:
        Name -> (r,); NaN where the covariances are not known, or the measure is not smooth.
    """
    n, rows = len(STEPS), len(pair.stamp_ns)
    total = {name: np.zeros(rows) for name in measures}
    for is_host, covariance in zip((True, False), covariances, strict=True):
        slopes = {name: np.zeros((rows, n)) for name in measures}
        for column in range(n):
            ends = [_nudged(pair, is_host, column, sign * STEPS[column]) for sign in (-1.0, 1.0)]
            for name, measure in measures.items():
                low, high = (end.value(measure) for end in ends)
                with np.errstate(invalid="ignore"):
                    slopes[name][:, column] = (high - low) / (2.0 * STEPS[column])
        for name, slope in slopes.items():
            total[name] += np.einsum("ri,rij,rj->r", slope, covariance[:, :n, :n], slope)
    return {name: np.where(value >= 0.0, np.sqrt(np.maximum(value, 0.0)), np.nan) for name, value in total.items()}


def _nudged(pair: Pair, is_host: bool, column: int, step: float) -> Pair:
    """The pair with one quantity of one vehicle moved."""
    host, others, own, theirs = pair.host.state, pair.others, pair.host_motion, pair.other_motion
    states, motions = ([host, others], [own, theirs])
    which = 0 if is_host else 1
    if column < 4:
        states[which] = _moved(states[which], column, step)
    else:
        motions[which] = _moved(motions[which], column - 4, step)
    track = ActualTrack(pair.stamp_ns, np.concatenate([states[0][:, :4], motions[0]], axis=1))
    return pair.given(track, states[1], motions[1])


def _moved(values: FloatArray, column: int, step: float) -> FloatArray:
    out = values.copy()
    out[:, column] += step
    return out
