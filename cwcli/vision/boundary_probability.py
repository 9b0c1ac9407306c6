"""Probability that a found boundary is right: from its own paint, the lane's objective and the clutter of the road.

The best of many lanes has some evidence on any picture: on noise, on a rough road, on grass. How much depends on how
much of the road looks like stripes without being a boundary, so that share is one of the features. It is what
separates few raised dots on smooth concrete from as much evidence on a rough road without paint.

p = (1 - lapse) / (1 + exp(-z)), z linear in the features. Without the lapse the few boundaries that are wrong though
well seen flatten the whole curve: what is hardly seen is then taken for more than it is, what is seen fairly for less.

The coefficients were fitted on rendered frames, on noise and on 20 labelled frames in many kinds of weather and damage
(tests/studies/lane_reliability.py); docs/lanes.md shows how reliable they are.
"""

from __future__ import annotations

import math
from operator import mul

import numpy as np

from cwcli.kernels import lane_ridge
from cwcli.signals.columns import FloatArray
from cwcli.vision.lane_detect import StripeEvidence
from cwcli.vision.lane_model import MIDDLE, WIDTH, ImageLane, LeftRightProbabilities

BOUNDARY_LOG_ODDS_WEIGHTS = np.array([9.64, 1.7, 3.18, -26.59])
"""Weights of the four features (1, root of support, logarithm of objective, root of clutter) in the log-odds. Fitted on
rendered frames, noise, and 20 labelled frames in 47 kinds of weather, damage and size, some of them upside down
(tests/studies/lane_reliability.py); the other 20 labelled frames were not used."""
PROBABILITY_OF_WELL_SEEN_OTHER_LINE = 0.03
"""Share of boundaries that are another line although they are seen as well as any. Fitted with the weights above."""
OBJECTIVE_OFFSET_BEFORE_LOGARITHM = 0.02
"""Objective that is added before the logarithm is taken, so that it stays finite. Chosen by hand; not fitted."""
CLEAR_VOTE_SHARE, LOG_ODDS_PER_VOTE_SHARE = 0.33, 22.0
"""Share of the votes of a frame's line segments for its vanishing point below which a lane is in doubt, and the
log-odds that one unit less takes off. A road has 0.35 to 0.6, stripes of shadow 0.1 to 0.3, a picture upside down 0.04
to 0.12. The share was chosen on 20 of 40 labelled frames in 15 kinds of weather and damage
(tests/studies/lane_variants.py); the log-odds were fitted with the weights above."""
_CANDIDATE_OFFSETS = np.linspace(-2.0, 2.0, 81)
"""Lateral offsets from the lane's middle, in lane widths, of which the clutter offsets are chosen."""
CLUTTER_OFFSETS = np.asarray(_CANDIDATE_OFFSETS[np.abs(np.abs(_CANDIDATE_OFFSETS) % 1.0 - 0.5) > 0.1])
"""Offsets from the lane's middle, in lane widths, at which clutter is measured: none within 0.1 of a boundary of the
lane or of a neighbouring lane. Chosen by hand; not fitted."""


def left_and_right_paint_shares(evidence: StripeEvidence, lane: ImageLane) -> FloatArray:
    """Share of each boundary that shows paint, shape (2,), 0 to 1, counted by stretches of the image's height."""
    return lane_ridge.supports(evidence.sharp, evidence.rows, lane, evidence.scoring_settings())


def road_clutter_share(evidence: StripeEvidence, lane: ImageLane) -> float:
    """Share of the road beside the boundaries, two lanes to each side, that looks like a bright stripe, 0 to 1."""
    places = lane[MIDDLE] + CLUTTER_OFFSETS * lane[WIDTH]
    return lane_ridge.crowd(evidence.sharp, evidence.rows, lane, places, evidence.scoring_settings())


def probability_features_of_left_and_right(
    evidence: StripeEvidence, lane: ImageLane, lane_objective: float, carried_side: int = -1
) -> list[tuple[float, float, float, float]]:
    """The features of each side: 1, root of its own support, logarithm of the objective, root of the clutter.

    The objective that counts for a carried side is at most twice its own support.
    """
    by_chance = math.sqrt(road_clutter_share(evidence, lane))
    rows = []
    for side, own in enumerate(left_and_right_paint_shares(evidence, lane).tolist()):
        counted_value = min(lane_objective, 2.0 * own) if side == carried_side else lane_objective
        rows.append(
            (
                1.0,
                math.sqrt(own),
                math.log(min(max(counted_value, 0.0), 1.0) + OBJECTIVE_OFFSET_BEFORE_LOGARITHM),
                by_chance,
            )
        )
    return rows


def boundary_probabilities(
    evidence: StripeEvidence, lane: ImageLane, lane_objective: float, carried_side: int = -1
) -> LeftRightProbabilities:
    """Probability of each boundary that it lies where the lane has it.

    Args:
        carried_side: The boundary whose place follows from the other line (`lane_sides`), if there is one. The lane's
            objective is that of the other line's paint, so for this one at most twice its own support counts.
    """
    coefficients: list[float] = BOUNDARY_LOG_ODDS_WEIGHTS.tolist()
    left, right = (
        (1.0 - PROBABILITY_OF_WELL_SEEN_OTHER_LINE)
        / (1.0 + math.exp(-min(max(sum(map(mul, each, coefficients)), -30.0), 30.0)))
        for each in probability_features_of_left_and_right(evidence, lane, lane_objective, carried_side)
    )
    return left, right


def lower_probabilities_if_vanishing_votes_scatter(
    probabilities: LeftRightProbabilities, vote_share: float
) -> LeftRightProbabilities:
    """The probabilities of both boundaries in a scene whose straight edges hardly meet in one point.

    Args:
        vote_share: Share of the votes for the vanishing point, 0 to 1 (`vanishing.VanishingPoint`).
    """
    factor = math.exp(LOG_ODDS_PER_VOTE_SHARE * min(vote_share - CLEAR_VOTE_SHARE, 0.0))
    left, right = (factor * each / (1.0 - each + factor * each) for each in probabilities)
    return left, right
