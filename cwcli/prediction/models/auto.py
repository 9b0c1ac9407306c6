"""The default model: acceleration and yaw rate act as far as their gain was measured.

How much of an acceleration or a yaw rate follows is measured, not taken from its covariance: by the outcomes of the
vehicle's own states, of the log's other vehicles and of the fleet (`prediction.outcome_history`). Each acts for the
time A(t) that its gain at each horizon needs (`prediction.fleet.acting_time_from_displacement_share_s`):

    v(t) = v0 + a0 A(t),    phi(t) = phi0 + w0 W(t).

Where the gains are 0, A = W = 0: constant velocity. The responses here are those without a history: the fleet's gain of
the lasting part, trusted as far as the derivative stands out of its noise. Jerk and yaw acceleration are left out:
measured in the same way they had no gain on any drive.
"""

from __future__ import annotations

import numpy as np

from cwcli.prediction.driver import DerivativeTrust, DriverPrior
from cwcli.prediction.fleet import (
    DERIVATIVE_PART_NAMES,
    acting_time_from_displacement_share_s,
    interpolate_acting_time_s,
    load_fleet_prior,
)
from cwcli.prediction.models.base import Model, Responses
from cwcli.prediction.outcome_history import accel_and_yaw_rate_clearness_0_to_1
from cwcli.signals.columns import FloatArray, StateCovariances, StateRows


def responses_of_fleet_prior(time_s: FloatArray, prior: DriverPrior) -> Responses:
    """The responses A, J, W, D of a vehicle without a history, each of the shape of `time_s`."""
    along, across = acting_time_from_displacement_share_s(
        load_fleet_prior().gain[:, :, DERIVATIVE_PART_NAMES.index("lasting")]
    )
    none = np.zeros_like(time_s)
    return Responses(interpolate_acting_time_s(along, time_s), none, interpolate_acting_time_s(across, time_s), none)


def trust_in_derivatives_by_clearness(
    state: StateRows, covariance: StateCovariances | None, prior: DriverPrior
) -> DerivativeTrust:
    """How far (accel, jerk, yaw rate, yaw accel) stand out of their noise, shape (n, 4); ones without a covariance."""
    clear = accel_and_yaw_rate_clearness_0_to_1(state, covariance)
    none = np.zeros(len(state))
    return np.stack([clear[:, 0], none, clear[:, 1], none], axis=1)


MODEL = Model(
    summary="acceleration and yaw rate as far as their gain was measured, else constant velocity",
    uses=(True, False, True, False),
    responses=responses_of_fleet_prior,
    trust=trust_in_derivatives_by_clearness,
    learns=True,
)
