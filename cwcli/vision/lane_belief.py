"""How sure a found boundary is: a logistic function of its own evidence, of the other one's, and of the prior.

The coefficients were fitted on rendered frames (tests/studies/lane_reliability.py); docs/lanes.md shows how reliable
they are.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.vision.lane_detect import HALF, N_SEGMENTS, Evidence
from cwcli.vision.lane_model import MEAN, MIDDLE, SIGMA, WIDTH, LanePrior

COEFFICIENTS = np.array([-3.0, 16.0, 6.0, -0.3])
"""Constant, own support, the other boundary's support, squared distance from the prior in sigmas."""


def supports(evidence: Evidence, lane: FloatArray) -> FloatArray:
    """Shape (2,): how much of each boundary shows paint, 0 to 1, by stretches of the image's height."""
    from cwcli.kernels import lane_ridge

    values = np.empty((2, len(evidence.rows)))
    places = lane[MIDDLE] + np.array([-0.5, 0.5]) * lane[WIDTH]
    lane_ridge.along(evidence.sharp, evidence.rows, lane, places, evidence.min_h, values)
    segment = len(evidence.rows) // N_SEGMENTS
    n = len(evidence.rows) // segment
    parts = values[:, : n * segment].reshape(2, n, segment)
    seen = (parts >= 0.0).mean(axis=2)
    painted = np.maximum(parts, 0.0).sum(axis=2)
    part = painted / (painted + HALF * segment)
    return np.asarray((part * seen).sum(axis=1) / np.maximum(seen.sum(axis=1), 1.0))


def features(evidence: Evidence, lane: FloatArray, prior: LanePrior) -> FloatArray:
    """Shape (2, 4): what the probability of each boundary is made of."""
    own = supports(evidence, lane)
    z = (lane - prior.table[:, MEAN]) / prior.table[:, SIGMA]
    far = float(z[[MIDDLE, WIDTH]] @ z[[MIDDLE, WIDTH]])
    return np.array([[1.0, own[side], own[1 - side], far] for side in range(2)])


def boundary_probabilities(evidence: Evidence, lane: FloatArray, prior: LanePrior) -> FloatArray:
    """Shape (2,): probability that each boundary is where the lane has it."""
    exponent = features(evidence, lane, prior) @ COEFFICIENTS
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(exponent, -30.0, 30.0))))
