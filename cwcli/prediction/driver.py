"""The prior on what a driver does: how large accelerations are, and how long they last.

Longitudinal and lateral acceleration are taken as first-order Gauss-Markov processes (Singer 1970, "Estimating
optimal tracking filter performance for manned maneuvering targets", IEEE Trans. AES-6(4)): zero mean, a stated
sigma, correlation exp(-|t|/tau). From that one assumption follow the growth of the position covariance of every
model (whatever a model leaves out is the driver's noise) and the trust of the adaptive model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwcli.signals.columns import FloatArray


@dataclass(frozen=True)
class DriverPrior:
    """Prior sigmas and correlation times of a car in traffic.

    Attributes:
        accel_sigma_mps2, accel_time_s: Longitudinal acceleration.
        jerk_sigma_mps3, jerk_time_s: Its rate of change.
        lateral_sigma_mps2, yaw_time_s: Lateral acceleration, speed times yaw rate, that the driver adds.
        curvature_sigma_1pm: Caps yaw rate and lateral noise at low speed, where the steering lock rules.
        yaw_rate_sigma_radps: Prior of the yaw rate at crossing speed; with curvature and lateral limits below it.
        yaw_accel_sigma_radps2, yaw_accel_time_s: Rate of change of the yaw rate.
        creep_speed_mps: Below it the longitudinal noise falls in proportion to speed: a standing car mostly stays.
    """

    accel_sigma_mps2: float = 1.0
    accel_time_s: float = 4.0
    jerk_sigma_mps3: float = 1.0
    jerk_time_s: float = 0.6
    lateral_sigma_mps2: float = 0.6
    yaw_time_s: float = 3.0
    curvature_sigma_1pm: float = 0.05
    yaw_rate_sigma_radps: float = 0.3
    yaw_accel_sigma_radps2: float = 0.2
    yaw_accel_time_s: float = 0.5
    creep_speed_mps: float = 2.0

    def along_sigma_mps2(self, speed_mps: FloatArray) -> FloatArray:
        """Sigma of the longitudinal acceleration noise at a start speed, shape of `speed_mps`."""
        share = np.minimum(np.abs(speed_mps) / self.creep_speed_mps, 1.0)
        return np.asarray(self.accel_sigma_mps2 * share)

    def cross_sigma_mps2(self, speed_mps: FloatArray) -> FloatArray:
        """Sigma of the lateral acceleration noise at a start speed, shape of `speed_mps`."""
        return np.minimum(self.lateral_sigma_mps2, speed_mps**2 * self.curvature_sigma_1pm)


def displacement_variance(time_s: FloatArray, response_s2: FloatArray, tau_s: float) -> FloatArray:
    """Variance of the displacement that a unit Gauss-Markov acceleration causes beyond a model's own share.

    The displacement is X(t) = int int a. The model already accounts for r(t) a(0), with r its response to the
    acceleration at the start (0: ignores it; t^2/2: holds it). What is left has the variance
    var[X] - 2 r cov[X, a(0)] + r^2 var[a], all for unit sigma.

    Args:
        time_s: Shape (k,).
        response_s2: Shape (k,): r(t).
        tau_s: Correlation time.

    Returns:
        Shape (k,), s^4: multiply by the acceleration's variance.
    """
    decay = np.exp(-time_s / tau_s)
    own = 2.0 * (tau_s * time_s**3 / 3.0 - tau_s**2 * time_s**2 / 2.0 + tau_s**4 - tau_s**3 * decay * (time_s + tau_s))
    shared = tau_s * time_s - tau_s**2 * (1.0 - decay)
    return np.maximum(own - 2.0 * response_s2 * shared + response_s2**2, 0.0)
