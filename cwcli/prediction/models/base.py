"""The interface of a motion model.

Every model here moves a car along its heading with a speed and a heading that respond linearly to the four
derivatives of its state:

    v(t)   = v0   + a0 A(t) + j0 J(t)            A, J: response to acceleration and jerk
    phi(t) = phi0 + w0 W(t) + dw0 D(t)           W, D: response to yaw rate and yaw acceleration

A model is these four functions of time, and how far it trusts the derivatives that the filter gives.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.prediction.driver import DerivativeTrust, DriverPrior
from cwcli.signals.columns import FloatArray, StateCovariances, StateRows


class Responses(NamedTuple):
    """Responses at the times asked for, each of the shape of the times.

    Attributes:
        speed_to_accel (s), speed_to_jerk (s^2): A(t), J(t).
        heading_to_yaw_rate (s), heading_to_yaw_accel (s^2): W(t), D(t).
    """

    speed_to_accel: FloatArray
    speed_to_jerk: FloatArray
    heading_to_yaw_rate: FloatArray
    heading_to_yaw_accel: FloatArray


HoldFunction = Callable[[FloatArray, DriverPrior], FloatArray]
"""The type of `Model.hold`."""
TrustFunction = Callable[[FloatArray, FloatArray | None, DriverPrior], FloatArray]
"""The type of `Model.trust`."""


@dataclass(frozen=True)
class Model:
    """A motion model.

    Attributes:
        summary: One line for `--help`.
        uses: Which of (accel, jerk, yaw rate, yaw accel) move it.
        responses: Times (any shape), prior -> `Responses`.
        trust: State (n, 8), covariance (n, 8, 8) or None, prior -> shape (n, 4): the factor in [0, 1] put on each
            of (accel, jerk, yaw rate, yaw accel).
        hold: None: the responses are the same for all starts. Else: trusted state (n, 8), prior -> shape (n, 2): until
            when jerk and yaw acceleration act; they then stop, and acceleration and yaw rate stay as they are. Only
            for hypotheses: the Jacobian takes these times as given.
        in_paper: Whether song2016's recursion (eq. 2, 9, 10) covers it.
        learns: Whether a record of the vehicle's states says for how long its derivatives act
            (`prediction.outcome_history`); the responses and the trust then hold where there is no record.
    """

    summary: str
    uses: tuple[bool, bool, bool, bool]
    responses: Callable[[FloatArray, DriverPrior], Responses]
    trust: TrustFunction
    hold: HoldFunction | None = None
    in_paper: bool = False
    learns: bool = False


def full_trust(state: StateRows, covariance: StateCovariances | None, prior: DriverPrior) -> DerivativeTrust:
    """Trust in the derivatives as the filter gives them, shape (n, 4) of ones."""
    return np.ones((len(state), 4))


def constant_derivatives_model(summary: str, uses: tuple[bool, bool, bool, bool]) -> Model:
    """Build a model in which the derivatives that it uses stay constant: A = t, J = t^2/2, W = t, D = t^2/2, or 0.

    song2016's recursion covers each of them (`in_paper`): it sets the derivatives that are not used to 0.

    Args:
        uses: Whether acceleration, jerk, yaw rate and yaw acceleration are used.
    """

    def driver_responses(time_s: FloatArray, prior: DriverPrior) -> Responses:
        none = np.zeros_like(time_s)
        half_square = 0.5 * time_s**2
        accel, jerk, yaw_rate, yaw_accel = uses
        return Responses(
            time_s if accel else none,
            half_square if jerk else none,
            time_s if yaw_rate else none,
            half_square if yaw_accel else none,
        )

    return Model(summary=summary, uses=uses, responses=driver_responses, trust=full_trust, in_paper=True)


def check_responses(responses: Responses, time_s: FloatArray, *others: object) -> Responses:
    """Check a plug-in's responses against the times that they are for, and return them.

    Raises:
        TypeError: They are no `Responses`.
        ValueError: One has another shape.
    """
    if not isinstance(responses, Responses):
        raise TypeError(f"a {type(responses).__name__}, no Responses")
    for name, values in responses._asdict().items():
        if np.shape(values) != np.shape(time_s):
            raise ValueError(f"{name} has shape {np.shape(values)}, not {np.shape(time_s)}")
    return responses


def check_trust_in_derivatives(trust: DerivativeTrust, state: StateRows, *others: object) -> DerivativeTrust:
    """Check a plug-in's trust against the states that it is for, and return it.

    Raises:
        ValueError: It has not the shape (n, 4), or is not between 0 and 1.
    """
    if np.shape(trust) != (len(state), 4):
        raise ValueError(f"shape {np.shape(trust)}, not ({len(state)}, 4)")
    known = trust[np.isfinite(state).all(axis=1)]
    if not ((known >= 0.0) & (known <= 1.0)).all():
        raise ValueError("a factor that is not between 0 and 1")
    return trust
