"""Derivatives trusted as far as the filter's covariance allows, fading with time: the default.

Each derivative d of the state comes from the filter with a variance P. Under the driver prior N(0, s^2) its
posterior mean is g d with g = s^2 / (s^2 + P): a jerk that drowns in noise is left out, a clear one is used.
It then fades as a Gauss-Markov process does: with the jerk's time constant tj and the acceleration's ta,

    j(t) = j0 exp(-t/tj),    da/dt = -a/ta + j    =>    A(t) = ta (1 - exp(-t/ta)),
    J(t) = [ta (1 - exp(-t/ta)) - tj (1 - exp(-t/tj))] / (1/tj - 1/ta),

and likewise for yaw rate and yaw acceleration. With P = 0 and long time constants it is `cj-cya`; with P large, `cv`.
"""

from __future__ import annotations

import numpy as np

from cwcli.prediction.driver import DriverPrior
from cwcli.prediction.models.base import Model, Responses
from cwcli.signals.columns import FloatArray


def responses(time_s: FloatArray, prior: DriverPrior) -> Responses:
    """A, J, W, D of the fading derivatives, each of the shape of `time_s`."""
    accel, jerk = _fading(time_s, prior.accel_time_s, prior.jerk_time_s)
    yaw_rate, yaw_accel = _fading(time_s, prior.yaw_time_s, prior.yaw_accel_time_s)
    return Responses(accel, jerk, yaw_rate, yaw_accel)


def _fading(time_s: FloatArray, tau_s: float, rate_tau_s: float) -> tuple[FloatArray, FloatArray]:
    """Integrated response of a fading quantity to its own start value (s) and to that of its rate (s^2)."""
    own = -tau_s * np.expm1(-time_s / tau_s)
    rate = -rate_tau_s * np.expm1(-time_s / rate_tau_s)
    return own, (own - rate) / (1.0 / rate_tau_s - 1.0 / tau_s)


def trust(state: FloatArray, covariance: FloatArray | None, prior: DriverPrior) -> FloatArray:
    """g for (accel, jerk, yaw rate, yaw accel), shape (n, 4); ones without a covariance."""
    return prior.trust(state, covariance)


MODEL = Model(
    summary="derivatives trusted as far as the filter's covariance allows, fading with time",
    uses=(True, True, True, True),
    responses=responses,
    trust=trust,
)
