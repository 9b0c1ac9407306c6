"""How sure a found boundary is: by its own evidence, the whole lane's, and what there is by chance.

The best of many lanes has some evidence on any picture: on noise, on a rough road, on grass. How much depends on how
much of the road looks like stripes without being a boundary, so that share is one of the features. It is what
separates few raised dots on smooth concrete from as much evidence on a rough road without paint.

p = (1 - lapse) / (1 + exp(-z)), z linear in the features. Without the lapse the few boundaries that are wrong though
well seen flatten the whole curve: what is hardly seen is then taken for more than it is, what is seen fairly for less.

The coefficients were fitted on rendered frames, on noise and on 40 labelled frames
(tests/studies/lane_reliability.py); docs/lanes.md shows how reliable they are.
"""

from __future__ import annotations

import math
from operator import mul

import numpy as np

from cwcli.kernels import lane_ridge
from cwcli.signals.columns import FloatArray
from cwcli.vision.lane_detect import Evidence
from cwcli.vision.lane_model import MIDDLE, WIDTH

COEFFICIENTS = np.array([20.09, 0.22, 7.47, -44.19])
LAPSE = 0.04
"""Of the boundaries that are seen as well as any, so many are another line: what no evidence of its own tells."""
LEAST_VALUE = 0.02
_OFFSETS = np.linspace(-2.0, 2.0, 81)
BESIDE_OFFSETS = np.asarray(_OFFSETS[np.abs(np.abs(_OFFSETS) % 1.0 - 0.5) > 0.1])
"""Lines on which the crowd is counted, from the lane's middle over its width: none near a boundary or a neighbour's."""


def supports(evidence: Evidence, lane: FloatArray) -> FloatArray:
    """Shape (2,): how much of each boundary shows paint, 0 to 1, by stretches of the image's height."""
    return lane_ridge.supports(evidence.sharp, evidence.rows, lane, evidence.scoring())


def crowd(evidence: Evidence, lane: FloatArray) -> float:
    """Share of the road beside the boundaries, two lanes to each side, that looks like a bright stripe, 0 to 1."""
    places = lane[MIDDLE] + BESIDE_OFFSETS * lane[WIDTH]
    return lane_ridge.crowd(evidence.sharp, evidence.rows, lane, places, evidence.scoring())


def features(evidence: Evidence, lane: FloatArray, value: float) -> FloatArray:
    """What the probability of each boundary is made of (z above).

    Args:
        evidence, lane: The lane (6,) and where the frame shows stripes.
        value: The lane's objective in this frame.

    Returns:
        Shape (2, 4): 1, square root of the own support, logarithm of the objective, square root of the crowd.
    """
    return np.array(_features(evidence, lane, value))


def _features(
    evidence: Evidence, lane: FloatArray, value: float, carried: int = -1
) -> list[tuple[float, float, float, float]]:
    by_chance = math.sqrt(crowd(evidence, lane))
    made = []
    for side, own in enumerate(supports(evidence, lane).tolist()):
        told = min(value, 2.0 * own) if side == carried else value
        made.append((1.0, math.sqrt(own), math.log(min(max(told, 0.0), 1.0) + LEAST_VALUE), by_chance))
    return made


def boundary_probabilities(
    evidence: Evidence, lane: FloatArray, value: float, carried: int = -1
) -> tuple[float, float]:
    """Probability that each boundary is where the lane has it.

    Args:
        evidence, lane, value: `features`.
        carried: The boundary that has its place from the other one (`lane_sides`), if there is one. The lane's
            objective is that of the other one's paint; its own is that of a lane both of whose lines show as much
            as it does: twice its support.
    """
    coefficients: list[float] = COEFFICIENTS.tolist()
    left, right = (
        (1.0 - LAPSE) / (1.0 + math.exp(-min(max(sum(map(mul, each, coefficients)), -30.0), 30.0)))
        for each in _features(evidence, lane, value, carried)
    )
    return left, right
