"""The hypothesis that a manoeuvre that has begun goes on: warnings use it, it is not the likeliest path.

A driver who has just begun to brake hard or to turn in mostly means it, but on average over all driving neither
lasts: a predictor that always used it would be worse than constant velocity. So this model is not a predictor of
the mean. It says where the car will be if jerk and yaw acceleration go on as they are until the car's limits: full
braking (or full throttle, which is weaker but rarely matters) and the lateral acceleration of a brisk turn. The
covariance along its path takes the moments at which the limits are reached as given.

Rates that do not stand out of the filter's noise are left out: the positive-part James-Stein factor
g = max(0, 1 - k^2 P / d^2) is 0 where the derivative is below k of its own sigmas and near 1 where it is clear. k is 1
for the jerk, which moves a car by 2.6 m per m/s^3 in 2.5 s, and 2 for the yaw acceleration, which moves it sideways by
v t^3 / 6: 0.5 m per 0.01 rad/s^2 at 20 m/s, a lane within the noise of an ordinary gyroscope.
"""

from __future__ import annotations

import numpy as np

from cwcli.prediction.driver import DerivativeTrust, DriverPrior
from cwcli.prediction.models.base import Model, Responses
from cwcli.signals.columns import FloatArray, StateCovariances, StateRows
from cwcli.signals.vehicle_state import ACCEL, JERK, SPEED, YAW_ACCEL, YAW_RATE

MANOEUVRE_ACCEL_LIMIT_MPS2 = 5.0
"""Acceleration or braking at which a manoeuvre stops growing: UN Regulation 157 lets emergency braking begin there."""
MANOEUVRE_LATERAL_ACCEL_LIMIT_MPS2 = 4.0
"""Lateral acceleration at which a turn stops growing: that of a brisk turn. Chosen by hand; not fitted."""
MIN_YAW_LIMIT_SPEED_MPS = 1.0
"""Least speed in m/s from which the yaw rate's limit is computed; slower cars get the limit of this speed. Chosen by
hand; not fitted."""
MIN_JERK_NOT_COUNTED_AS_ZERO_SIGMAS = 1.0
"""Size of a jerk, in its sigmas, up to which it counts as 0. Chosen by hand; the module says why."""
MIN_YAW_ACCEL_NOT_COUNTED_AS_ZERO_SIGMAS = 2.0
"""Size of a yaw acceleration, in its sigmas, up to which it counts as 0. Chosen by hand; the module says why."""


def constant_jerk_responses(time_s: FloatArray, prior: DriverPrior) -> Responses:
    """The responses to constant jerk and yaw acceleration; `hold` limits how long they act."""
    half_square = 0.5 * time_s**2
    return Responses(time_s, half_square, time_s, half_square)


def trust_in_derivatives_above_noise(
    state: StateRows, covariance: StateCovariances | None, prior: DriverPrior
) -> DerivativeTrust:
    """Trust in acceleration and yaw rate by the prior, in their rates where they exceed their noise, (n, 4)."""
    out = prior.trust_in_derivatives(state, covariance)
    if covariance is None:
        return out
    for column, index, sigmas in (
        (1, JERK, MIN_JERK_NOT_COUNTED_AS_ZERO_SIGMAS),
        (3, YAW_ACCEL, MIN_YAW_ACCEL_NOT_COUNTED_AS_ZERO_SIGMAS),
    ):
        with np.errstate(divide="ignore", invalid="ignore"):
            clear = 1.0 - sigmas**2 * covariance[:, index, index] / state[:, index] ** 2
        out[:, column] = np.clip(np.nan_to_num(clear, nan=0.0, neginf=0.0), 0.0, 1.0)
    return out


def times_until_limits_s(state: StateRows, prior: DriverPrior) -> FloatArray:
    """Times at which acceleration and yaw rate reach their limits, s, shape (n, 2); their rates act until then."""
    yaw_rate_limit = MANOEUVRE_LATERAL_ACCEL_LIMIT_MPS2 / np.maximum(np.abs(state[:, SPEED]), MIN_YAW_LIMIT_SPEED_MPS)
    limits = (np.full(len(state), MANOEUVRE_ACCEL_LIMIT_MPS2), yaw_rate_limit)
    out = np.empty((len(state), 2))
    for column, (value, rate, limit) in enumerate(
        zip((state[:, ACCEL], state[:, YAW_RATE]), (state[:, JERK], state[:, YAW_ACCEL]), limits, strict=True)
    ):
        with np.errstate(divide="ignore", invalid="ignore"):
            until = (np.sign(rate) * limit - value) / rate
        out[:, column] = np.where(rate == 0.0, np.inf, np.maximum(until, 0.0))
    return out


MODEL = Model(
    summary="a manoeuvre that has begun goes on to the car's limits",
    uses=(True, True, True, True),
    responses=constant_jerk_responses,
    trust=trust_in_derivatives_above_noise,
    hold=times_until_limits_s,
)
