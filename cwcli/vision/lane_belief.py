"""How sure a found boundary is: a logistic function of its own evidence and of the objective of the whole lane.

The coefficients were fitted on rendered frames (tests/studies/lane_reliability.py); docs/lanes.md shows how reliable
they are.
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.vision.lane_detect import HALF, N_SEGMENTS, Evidence, judged
from cwcli.vision.lane_model import LanePrior

COEFFICIENTS = np.array([-3.25, 5.52, 6.75, -3.56])
"""Of: constant, square root of the own support, objective of the lane and its square."""
MOST = 1.0
"""A greater objective counts as this."""


def supports(evidence: Evidence, lane: FloatArray) -> FloatArray:
    """Shape (2,): how much of each boundary shows paint, 0 to 1, by stretches of the image's height."""
    from cwcli.kernels import lane_ridge

    made = np.empty(2)
    segment = len(evidence.rows) // N_SEGMENTS
    lane_ridge.supports(evidence.sharp, evidence.rows, lane, evidence.min_h, HALF * segment, segment, made)
    return made


def features(evidence: Evidence, lane: FloatArray, prior: LanePrior) -> FloatArray:
    """Shape (2, 4): what the probability of each boundary is made of."""
    value = min(max(float(judged(evidence, lane[None], prior)[0]), 0.0), MOST)
    return np.array([[1.0, math.sqrt(own), value, value * value] for own in supports(evidence, lane).tolist()])


def boundary_probabilities(evidence: Evidence, lane: FloatArray, prior: LanePrior) -> FloatArray:
    """Shape (2,): probability that each boundary is where the lane has it."""
    exponents = (features(evidence, lane, prior) @ COEFFICIENTS).tolist()
    return np.array([1.0 / (1.0 + math.exp(-min(max(each, -30.0), 30.0))) for each in exponents])
