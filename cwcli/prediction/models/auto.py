"""Derivatives as far as their gain was measured: the default.

How much of an acceleration or a yaw rate follows is not what its covariance says, but what followed before: by the
vehicle's own record, that of the log's other vehicles and the fleet's prior (`prediction.record`). Each acts for
the time A(t) that its gain at each horizon asks for (`prediction.fleet.acted_s`):

    v(t) = v0 + a0 A(t),    phi(t) = phi0 + w0 W(t).

Where derivatives carry nothing, A = W = 0: constant velocity. The responses here are those without a record: the
fleet's gain of what lasts, trusted as far as the derivative stands out of its noise. Jerk and yaw acceleration are
left out: measured in the same way they had no gain on any drive.
"""

from __future__ import annotations

import numpy as np

from cwcli.prediction.driver import DriverPrior
from cwcli.prediction.fleet import PARTS, acted_at, acted_s, fleet_prior
from cwcli.prediction.models.base import Model, Responses
from cwcli.prediction.record import clearness
from cwcli.signals.columns import FloatArray


def responses(time_s: FloatArray, prior: DriverPrior) -> Responses:
    """A, J, W, D without a record, each of the shape of `time_s`."""
    along, across = acted_s(fleet_prior().gain[:, :, PARTS.index("lasting")])
    none = np.zeros_like(time_s)
    return Responses(acted_at(along, time_s), none, acted_at(across, time_s), none)


def trust(state: FloatArray, covariance: FloatArray | None, prior: DriverPrior) -> FloatArray:
    """How far (accel, jerk, yaw rate, yaw accel) stand out of their noise, shape (n, 4); ones without a covariance."""
    clear = clearness(state, covariance)
    none = np.zeros(len(state))
    return np.stack([clear[:, 0], none, clear[:, 1], none], axis=1)


MODEL = Model(
    summary="acceleration and yaw rate as far as their gain was measured, else constant velocity",
    uses=(True, False, True, False),
    responses=responses,
    trust=trust,
    learns=True,
)
