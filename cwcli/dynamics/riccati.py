"""The steady-state Kalman gain: the discrete Riccati equation by structure-preserving doubling."""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray

MAX_DOUBLING_PASSES = 60
"""Largest number of passes of the doubling algorithm: 60 stand for 2^60 steps of the plain iteration."""
MAX_RELATIVE_COVARIANCE_CHANGE = 1e-13
"""Largest relative change of the covariance in a pass at which the iteration has converged. Chosen by hand near double
precision."""


def steady_predicted_covariance(phi: FloatArray, h: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
    """The predicted covariance P to which a Kalman filter converges, shape (n, n).

    P = Phi P Phi' + Q - Phi P H' (H P H' + R)^-1 H P Phi' (zhang2011, eq. 16, 17, 19 at rest). Each pass of the
    doubling algorithm (Chu, Fan, Lin, Wang 2004) does as many steps of the plain iteration as all passes before it
    together.

    Args:
        phi: Shape (n, n).
        h: Shape (m, n).
        q: Shape (n, n), symmetric, not negative.
        r: Shape (m, m), symmetric positive.

    Raises:
        ValueError: It does not converge: an unstable part of the model is not observed.
    """
    a = phi.T.copy()
    g = h.T @ np.linalg.solve(r, h)
    p = q.copy()
    identity = np.eye(len(phi))
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(MAX_DOUBLING_PASSES):
            w = np.linalg.inv(identity + g @ p)
            aw = a @ w
            step = a.T @ p @ w @ a
            g = g + aw @ g @ a.T
            a = aw @ a
            p = p + 0.5 * (step + step.T)
            if not np.all(np.isfinite(p)):
                break
            if np.abs(step).max() <= MAX_RELATIVE_COVARIANCE_CHANGE * np.abs(p).max():
                return np.asarray(p)
    raise ValueError("the filter does not converge: an unstable or undamped part of the model is not observed")


def steady_kalman_gain(phi: FloatArray, h: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
    """The Kalman gain K = P H' (H P H' + R)^-1 (eq. 17) of the converged filter, shape (n, m)."""
    p = steady_predicted_covariance(phi, h, q, r)
    return np.asarray(np.linalg.solve(h @ p @ h.T + r, h @ p).T)
