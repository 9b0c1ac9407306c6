"""The prior on what a driver does: how large accelerations are, how long they last, how much they change.

Longitudinal and lateral acceleration are taken as first-order Gauss-Markov processes (Singer 1970, "Estimating
optimal tracking filter performance for manned maneuvering targets", IEEE Trans. AES-6(4)): zero mean, correlation
exp(-|t|/tau). Two things follow: how far the onset hypothesis trusts a measured acceleration and yaw rate, and how the
position covariance of every model grows, since whatever a model leaves out is the driver's noise.

One number can't hold for every drive: a platoon on a motorway changes its speed far less than a car in a town. What
tells them apart is in the state itself. On real drives the error 2.5 s ahead grows in proportion to the acceleration at
the start, along and across (docs/prediction.md), so the noise has a floor and a share of the present acceleration.
"""

from __future__ import annotations

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, StateCovariances, StateRows
from cwcli.signals.vehicle_state import ACCEL, JERK, SPEED, YAW_ACCEL, YAW_RATE

DerivativeTrust = FloatArray
"""Trust in acceleration, jerk, yaw rate and yaw acceleration, 0 to 1, shape (n, 4)."""


@dataclass(frozen=True)
class DriverPrior:
    """Prior on the manoeuvres of cars in traffic. Sigmas are one standard deviation; times are correlation times.

    Attributes:
        accel_sigma_mps2, accel_time_s: Longitudinal acceleration; a pedal is held for some seconds. The sigma is that
            of steady traffic, below the 0.35 to 1.1 m/s^2 of the development drives: a filter that sees positions
            only is too sure of its acceleration after outages and resets.
        jerk_sigma_mps3, jerk_time_s: Its rate of change; a pedal moves for about half a second.
        yaw_rate_sigma_radps, yaw_time_s: Yaw rate; a bend takes some seconds.
        yaw_accel_sigma_radps2, yaw_accel_time_s: Its rate of change; the wheel turns in for about half a second.
        curvature_sigma_1pm: Caps yaw rate and lateral noise at low speed, where the steering lock rules.
        along_floor_mps2, along_share: Longitudinal noise: floor, and share of the present acceleration.
        cross_floor_mps2, cross_share: Lateral noise: floor, and share of the present lateral acceleration.
        creep_speed_mps: Below it the longitudinal noise falls in proportion to speed: a standing car mostly stays.
    """

    accel_sigma_mps2: float = 0.3
    accel_time_s: float = 2.0
    jerk_sigma_mps3: float = 1.0
    jerk_time_s: float = 0.8
    yaw_rate_sigma_radps: float = 0.3
    yaw_time_s: float = 6.0
    yaw_accel_sigma_radps2: float = 0.2
    yaw_accel_time_s: float = 0.5
    curvature_sigma_1pm: float = 0.05
    along_floor_mps2: float = 0.25
    along_share: float = 0.5
    cross_floor_mps2: float = 0.15
    cross_share: float = 0.7
    creep_speed_mps: float = 1.0

    def trust_in_derivatives(self, state: StateRows, covariance: StateCovariances | None) -> DerivativeTrust:
        """g = s^2 / (s^2 + P), the posterior mean's share of a measured derivative under the prior N(0, s^2).

        Args:
            state: Shape (n, 8).
            covariance: Shape (n, 8, 8); None: full trust.
        """
        n = len(state)
        if covariance is None:
            return np.ones((n, 4))
        speed = np.maximum(np.abs(state[:, SPEED]), MIN_YAW_RATE_PRIOR_SPEED_MPS)
        sigma = np.empty((n, 4))
        sigma[:, 0] = self.accel_sigma_mps2
        sigma[:, 1] = self.jerk_sigma_mps3
        sigma[:, 2] = np.minimum(self.yaw_rate_sigma_radps, speed * self.curvature_sigma_1pm)
        sigma[:, 3] = self.yaw_accel_sigma_radps2
        columns = [ACCEL, JERK, YAW_RATE, YAW_ACCEL]
        noise = np.maximum(covariance[:, columns, columns], 0.0)
        return np.asarray(sigma**2 / (sigma**2 + noise), dtype=np.float64)

    def along_accel_sigma_mps2(self, state: StateRows, trust: DerivativeTrust) -> FloatArray:
        """Sigma of the longitudinal acceleration that the driver adds, shape (n,)."""
        accel = trust[:, 0] * state[:, ACCEL]
        coming = trust[:, 1] * state[:, JERK] * self.jerk_time_s
        creep = np.minimum(np.abs(state[:, SPEED]) / self.creep_speed_mps, 1.0)
        return np.asarray(np.sqrt(self.along_floor_mps2**2 + self.along_share**2 * (accel**2 + coming**2)) * creep)

    def cross_accel_sigma_mps2(self, state: StateRows, trust: DerivativeTrust) -> FloatArray:
        """Sigma of the lateral acceleration that the driver adds, shape (n,)."""
        speed = np.abs(state[:, SPEED])
        lateral = speed * trust[:, 2] * state[:, YAW_RATE]
        coming = speed * trust[:, 3] * state[:, YAW_ACCEL] * self.yaw_accel_time_s
        sigma = np.sqrt(self.cross_floor_mps2**2 + self.cross_share**2 * (lateral**2 + coming**2))
        return np.asarray(np.minimum(sigma, speed**2 * self.curvature_sigma_1pm))


MIN_YAW_RATE_PRIOR_SPEED_MPS = 0.5
"""Least speed in m/s of the yaw-rate prior: slower cars get that of this speed, since it would vanish at standstill.
Chosen by hand; not fitted."""


def displacement_variance_s4(time_s: FloatArray, tau_s: float) -> FloatArray:
    """Variance of the displacement that a unit Gauss-Markov acceleration adds, its start value being known.

    var[int int a] - (int int E[a | a(0)])^2, in s^4, shape of `time_s`; grows as t^5 / (10 tau) at first.
    """
    decay = np.exp(-time_s / tau_s)
    whole = 2.0 * (
        tau_s * time_s**3 / 3.0 - tau_s**2 * time_s**2 / 2.0 + tau_s**4 - tau_s**3 * decay * (time_s + tau_s)
    )
    return np.asarray(np.maximum(whole - fading_accel_displacement_s2(time_s, tau_s) ** 2, 0.0))


def fading_accel_displacement_s2(time_s: FloatArray, tau_s: float) -> FloatArray:
    """Displacement that a unit acceleration at the start causes while it fades, s^2: int int exp(-t/tau)."""
    return np.asarray(tau_s * time_s + tau_s**2 * np.expm1(-time_s / tau_s))
