"""The matrix exponential of a small matrix, and the exact discretisation of linear models with it."""

from __future__ import annotations

import math

import numpy as np

from cwcli.signals.columns import FloatArray

TAYLOR_ORDER = 14
"""Highest power in the Taylor series of the exponential. Chosen by hand: up to `MAX_UNSCALED_ROW_SUM_NORM` the
remainder is below 1e-17 of the result."""
MAX_UNSCALED_ROW_SUM_NORM = 0.5
"""Largest row-sum norm at which the series is summed without scaling: at order 14 its remainder is below 1e-17 of the
result."""


def matrix_exponential(matrix: FloatArray) -> FloatArray:
    """Compute exp(M) by scaling and squaring of the Taylor series.

    Args:
        matrix: Shape (n, n), finite.

    Returns:
        Shape (n, n).
    """
    norm = float(np.abs(matrix).sum(axis=1).max())
    squarings = max(0, math.ceil(math.log2(norm / MAX_UNSCALED_ROW_SUM_NORM))) if norm > 0.0 else 0
    scaled = matrix / 2.0**squarings
    identity = np.eye(len(matrix))
    result = identity.copy()
    for k in range(TAYLOR_ORDER, 0, -1):
        result = identity + scaled @ result / k
    for _ in range(squarings):
        result = result @ result
    return np.asarray(result)


def transition_and_input_matrices(a: FloatArray, b: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Discretise dx/dt = A x + B u exactly for an input u that is held for dt_s: x(t + dt) = Phi x + Gamma u.

    Args:
        a: Shape (n, n), 1/s.
        b: Shape (n, m).
        dt_s: Not negative.

    Returns:
        Phi of shape (n, n) and Gamma of shape (n, m).
    """
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a, b
    whole = matrix_exponential(block * dt_s)
    return whole[:n, :n], whole[:n, n:]


def discretise_noise_covariance(a: FloatArray, q: FloatArray, dt_s: float) -> FloatArray:
    """Covariance that white noise of intensity q adds over dt_s (Van Loan, 1978), shape (n, n)."""
    n = len(a)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -a, q, a.T
    whole = matrix_exponential(block * dt_s)
    covariance = whole[n:, n:].T @ whole[:n, n:]
    return 0.5 * (covariance + covariance.T)
