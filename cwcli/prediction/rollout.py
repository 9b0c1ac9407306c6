"""Predict paths from states: n starts at once, with the covariance of the position along each path."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from cwcli.errors import UsageError
from cwcli.kernels import paths as kernel
from cwcli.lazy_dataclass import dataclass
from cwcli.prediction.driver import DerivativeTrust, DriverPrior, displacement_variance_s4, fading_accel_displacement_s2
from cwcli.prediction.integrate import integrate_paths
from cwcli.prediction.models import HYPOTHETICAL_MODELS, MODELS
from cwcli.prediction.models.base import Model
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import FloatArray, StateCovariances, StateRows
from cwcli.signals.packed_covariances import Covariances
from cwcli.signals.vehicle_state import ACCEL, SPEED, STATE_COLUMNS_OF_MOTION_MODEL_RESPONSES, YAW_RATE

Discretisation = Literal["exact", "paper"]
"""How a model is integrated: exactly, or by song2016's recursion."""

ROWS_PER_BATCH = 1024
"""Number of starts in a batch: a call costs as much as some hundred paths of few points. Chosen by measurement."""
N_DRIVER_VARIANCE_POINTS = 501
"""Number of times at which the driver's variance over the horizon is tabulated. Chosen by hand."""


@dataclass(frozen=True)
class RolloutSettings:
    """How far, how finely and how paths are predicted.

    Attributes:
        horizon_s, step_s: The last point is the first that reaches the horizon.
        discretisation: "exact" integrates the model; "paper" is song2016's recursion (eq. 2, 9, 10) with its step.
        prior: What drivers do; None: the default.
    """

    horizon_s: float = 2.5
    step_s: float = 0.05
    discretisation: Discretisation = "exact"
    prior: DriverPrior | None = None

    @property
    def time_s(self) -> FloatArray:
        """The times of a path's points, see `path_time_grid_s`."""
        return path_time_grid_s(self.horizon_s, self.step_s)

    @property
    def driver_prior_of_settings(self) -> DriverPrior:
        """What drivers do."""
        return self.prior or DriverPrior()


DEFAULT_ROLLOUT_SETTINGS = RolloutSettings()
"""The settings of paths where none are given."""


def path_time_grid_s(horizon_s: float, step_s: float) -> FloatArray:
    """0, step, 2 step, ... up to the first point that reaches the horizon, shape (k,).

    Raises:
        UsageError: Horizon or step is not positive and finite, or they give more than 100,000 points.
    """
    if not (np.isfinite(step_s) and step_s > 0.0):
        raise UsageError(f"a step of {step_s:g} s is not a positive number of seconds")
    if not (np.isfinite(horizon_s) and horizon_s > 0.0):
        raise UsageError(f"a horizon of {horizon_s:g} s is not a positive number of seconds")
    steps = int(np.ceil(horizon_s / step_s - 1e-9))
    if steps > 100_000:
        raise UsageError(
            f"a horizon of {horizon_s:g} s in steps of {step_s:g} s is {steps} points", hint="take a longer step"
        )
    return np.arange(max(steps, 1) + 1, dtype=np.float64) * step_s


def roll_out_paths(
    model: str,
    state: StateRows,
    covariance: Covariances | None,
    settings: RolloutSettings = DEFAULT_ROLLOUT_SETTINGS,
    *,
    points: npt.NDArray[np.intp] | None = None,
    acting_s: FloatArray | None = None,
) -> Paths:
    """Predict the paths of n starts.

    A car that stops on its path stays where it is and turns no further; a braking car doesn't reverse, a reversing
    one doesn't go forward. The covariance at a point is J P J' (J: Jacobian of the point to the start state, P: the
    start's covariance) plus what the driver may do beyond the model (`DriverPrior`), along and across the heading.

    Args:
        model: A key of `MODELS` or `HYPOTHETICAL_MODELS`.
        state: Shape (n, 8): x_m, y_m, speed_mps, heading_rad, accel_mps2, yaw_rate_radps, jerk_mps3, yaw_accel_radps2.
        covariance: Shape (n, 8, 8), same order; None: the start is taken as known, only the driver's noise grows.
        points: Shape (p,), increasing: which points of `path_time_grid_s` are wanted; None: all. They are the same
            numbers, and come sooner.
        acting_s: Shape (n, 2, k): for how long acceleration and yaw rate act, by
            `outcome_history.measure_acting_time_s`; for a model that learns, others ignore it. None: no record.

    Returns:
        Paths of shape (n, k). A row that is not finite in its state gives a row of NaN.

    Raises:
        UsageError: Unknown model, a bad horizon or step, or "paper" for a model that the paper doesn't have.
        ValueError: Shapes that don't fit.
    """
    chosen = _require_model(model, settings.discretisation)
    prior, time_s = settings.driver_prior_of_settings, settings.time_s
    _require_8_states_and_matching_covariances(state, covariance)
    kept_s = time_s if points is None else time_s[points]
    n, k = len(state), len(kept_s)
    x, y, heading, speed = (np.empty((n, k)) for _ in range(4))
    position_covariance = np.empty((n, k, 3))
    driver = _tabulate_driver_variance(chosen, float(time_s[-1]), prior)
    for first in range(0, n, ROWS_PER_BATCH):
        rows = slice(first, first + ROWS_PER_BATCH)
        start = state[rows]
        start_covariance = None if covariance is None else covariance[rows]
        own = acting_s[rows] if acting_s is not None and chosen.learns else None
        trust = np.ones((len(start), 4)) if own is not None else chosen.trust(start, start_covariance, prior)
        trust = trust * np.array(chosen.uses)
        path = integrate_paths(
            chosen, _scale_derivatives_by_trust(start, trust), time_s, prior, settings.discretisation, points, own
        )
        x[rows], y[rows], heading[rows], speed[rows] = path.x_m, path.y_m, path.heading_rad, path.speed_mps
        kernel.position_covariance(
            path.jacobian,
            path.heading_rad,
            covariance=start_covariance,
            trust=trust,
            variance=np.stack([_interpolate_variance_s4(path.moving_s, driver.time_s, each) for each in driver.tables]),
            sigma=_driver_accel_sigmas_mps2(start, start_covariance, prior),
            out=position_covariance[rows],
        )
    return Paths(kept_s, x, y, heading, speed, position_covariance)


def check_rollout_options(model: str, discretisation: Discretisation, horizon_s: float, step_s: float) -> None:
    """Check what can be checked without a state.

    Raises:
        UsageError: As `roll_out_paths`.
    """
    _require_model(model, discretisation)
    path_time_grid_s(horizon_s, step_s)


def _require_model(name: str, discretisation: Discretisation) -> Model:
    """The model of this name; a `UsageError` if it is unknown or has no form in this discretisation."""
    model = HYPOTHETICAL_MODELS[name] if name in HYPOTHETICAL_MODELS else MODELS.require(name)
    if discretisation == "paper" and not model.in_paper:
        raise UsageError(f"model '{name}' has no form in song2016", hint="use --discretisation exact")
    return model


def _require_8_states_and_matching_covariances(state: StateRows, covariance: Covariances | None) -> None:
    """Raise a `ValueError` unless states are (n, 8) and covariances (n, 8, 8)."""
    if state.ndim != 2 or state.shape[1] != 8:
        raise ValueError(f"state has shape {state.shape}, not (n, 8)")
    if covariance is not None and covariance.shape != (len(state), 8, 8):
        raise ValueError(f"covariance has shape {covariance.shape}, not ({len(state)}, 8, 8)")


def _scale_derivatives_by_trust(state: StateRows, trust: DerivativeTrust) -> FloatArray:
    """Multiply each derivative of the states by its trust (n, 4); one with trust 0 becomes 0, even if it is NaN."""
    out = state.copy()
    out[:, STATE_COLUMNS_OF_MOTION_MODEL_RESPONSES] = np.where(
        trust == 0.0, 0.0, state[:, STATE_COLUMNS_OF_MOTION_MODEL_RESPONSES] * trust
    )
    return out


@dataclass(frozen=True)
class _DriverDisplacementVariance:
    """Displacement variance per unit acceleration variance on a fine grid of times, s^4.

    Attributes:
        time_s: Shape (p,).
        along_added, cross_added: What the driver adds after the start.
        along_ignored, cross_ignored: Error of the model in the effect of the acceleration at the start.
    """

    time_s: FloatArray
    along_added: FloatArray
    cross_added: FloatArray
    along_ignored: FloatArray
    cross_ignored: FloatArray

    @property
    def tables(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The tables in the order of `_driver_accel_sigmas_mps2`."""
        return self.along_added, self.along_ignored, self.cross_added, self.cross_ignored


@lru_cache(maxsize=64)
def _tabulate_driver_variance(model: Model, horizon_s: float, prior: DriverPrior) -> _DriverDisplacementVariance:
    """Tabulate the driver's displacement variance of a model over the horizon."""
    time_s = np.linspace(0.0, horizon_s, N_DRIVER_VARIANCE_POINTS)
    out = model.responses(time_s, prior)
    along, cross = (_running_integral_by_trapezoids(r, time_s) for r in (out.speed_to_accel, out.heading_to_yaw_rate))
    if model.learns:  # the part that its gains leave out did not follow on earlier drives
        along, cross = (
            fading_accel_displacement_s2(time_s, prior.accel_time_s),
            fading_accel_displacement_s2(time_s, prior.yaw_time_s),
        )
    return _DriverDisplacementVariance(
        time_s,
        along_added=displacement_variance_s4(time_s, prior.accel_time_s),
        cross_added=displacement_variance_s4(time_s, prior.yaw_time_s),
        along_ignored=(fading_accel_displacement_s2(time_s, prior.accel_time_s) - along) ** 2,
        cross_ignored=(fading_accel_displacement_s2(time_s, prior.yaw_time_s) - cross) ** 2,
    )


def _running_integral_by_trapezoids(values: FloatArray, time_s: FloatArray) -> FloatArray:
    """Trapezoidal running integral from 0, shape (k,)."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time_s)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _driver_accel_sigmas_mps2(start: FloatArray, covariance: StateCovariances | None, prior: DriverPrior) -> FloatArray:
    """The accelerations' sigmas that the tables of `_DriverDisplacementVariance` are scaled with, (m, 4).

    Args:
        start, covariance: Shapes (m, 8) and (m, 8, 8) or None.
    """
    trust = prior.trust_in_derivatives(start, covariance)  # the prior's, whatever the model's
    # what a model ignores is not unknown: its second moment is that of the filter's own estimate
    accel, yaw_rate = trust[:, 0] * start[:, ACCEL], trust[:, 2] * start[:, YAW_RATE]
    accel_m2ps4, yaw_rate_rad2ps2 = accel**2, yaw_rate**2
    if covariance is not None:
        accel_m2ps4 += trust[:, 0] * covariance[:, ACCEL, ACCEL]
        yaw_rate_rad2ps2 += trust[:, 2] * covariance[:, YAW_RATE, YAW_RATE]
    return np.stack(
        [
            prior.along_accel_sigma_mps2(start, trust),
            np.sqrt(accel_m2ps4),
            prior.cross_accel_sigma_mps2(start, trust),
            np.abs(start[:, SPEED]) * np.sqrt(yaw_rate_rad2ps2),
        ],
        axis=1,
    )


def _interpolate_variance_s4(moving_s: FloatArray, time_s: FloatArray, variance_s4: FloatArray) -> FloatArray:
    """Interpolate tabulated variances at the moving times (m, k): (1, k) where all cars have the same, else (m, k)."""
    rows = moving_s[:1] if moving_s.strides[0] == 0 else moving_s  # one row for all cars that do not stop
    return np.asarray(np.interp(rows, time_s, variance_s4))
