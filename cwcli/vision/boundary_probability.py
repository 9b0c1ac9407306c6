"""Probability that a found boundary is right: from its own paint, the lane's objective and the clutter of the road.

The best of many lanes has some evidence on any picture: on noise, on a rough road, on grass. How much depends on how
much of the road looks like stripes without being a boundary, so that share is one of the features. It is what
separates few raised dots on smooth concrete from as much evidence on a rough road without paint.

p = (1 - lapse) / (1 + exp(-z)), z linear in the features. Without the lapse the few boundaries that are wrong though
well seen flatten the whole curve: what is hardly seen is then taken for more than it is, what is seen fairly for less.

A frame that is searched alone, without a known mounting, knows more of its doubts: the other lanes that it supports
nearly as well, which are many in shadow and rain, and how many of its straight edges meet. Its probabilities have
coefficients of their own, and the boundary's own paint is none of their features: beside the lane's objective it tells
nothing.

The coefficients were fitted on rendered frames, on noise and on 20 labelled frames in many kinds of weather and damage;
docs/lanes.md shows how reliable they are.
"""

from __future__ import annotations

import math
from operator import mul

import numpy as np

from cwcli.kernels import lane_ridge
from cwcli.signals.columns import FloatArray
from cwcli.vision.lane_detect import StripeEvidence
from cwcli.vision.lane_following import has_lines_at_boundaries
from cwcli.vision.lane_model import MIDDLE, WIDTH, ImageLane, ImageLanes, LeftRightProbabilities
from cwcli.vision.vanishing import MIN_CLEAR_VANISHING_POINT_VOTE_SHARE

BOUNDARY_LOG_ODDS_WEIGHTS = np.array([9.64, 1.7, 3.18, -26.59])
"""Weights of the four features (1, root of support, logarithm of objective, root of clutter) of a followed lane in the
log-odds. Fitted on rendered frames, noise, and 20 labelled frames in 47 kinds of weather, damage and size, some of them
upside down, all searched alone from the point with the most votes; the other 20 labelled frames were not used."""
PROBABILITY_OF_WELL_SEEN_OTHER_LINE = 0.03
"""Share of boundaries that are another line although they are seen as well as any. Fitted with the weights above."""
OBJECTIVE_OFFSET_BEFORE_LOGARITHM = 0.02
"""Objective that is added before the logarithm is taken, so that it stays finite. Chosen by hand; not fitted."""
LOG_ODDS_LOSS_PER_MISSING_VOTE_SHARE = 22.0
"""Log-odds that one unit of the vote share less than `MIN_CLEAR_VANISHING_POINT_VOTE_SHARE` takes off. Fitted with
the weights above."""
FIRST_FRAME_LOG_ODDS_WEIGHTS = np.array([10.07, 2.77, -22.2, 15.5, 1.0])
"""Weights of the features of a frame that is searched alone (`first_frame_probability_features`) in the log-odds; the
last is 1 by choice. Fitted on rendered frames, noise, and 20 labelled frames in 7 kinds of weather and 40 other kinds
(tests/studies/lane_reliability.py); the other 20 labelled frames were not used."""
PROBABILITY_OF_OTHER_LINE_IN_FIRST_FRAME = 0.034
"""`PROBABILITY_OF_WELL_SEEN_OTHER_LINE` of a frame that is searched alone. Fitted with the weights above."""
RIVAL_OBJECTIVE_DEFICIT_OF_WEIGHT_1_OVER_E = 0.12
"""Deficit of objective with which another lane counts 37 % (1 / e) against a boundary that it has no line at. Chosen of
0.015, 0.03, 0.06 and 0.12 by the likelihood on the frames of the fit."""
MAX_RIVAL_OBJECTIVE_GAIN = 0.3
"""Greatest gain of objective that counts for a rival. Chosen by hand; not fitted."""
_CANDIDATE_CLUTTER_OFFSETS_IN_LANE_WIDTHS = np.linspace(-2.0, 2.0, 81)
"""Lateral offsets from the lane's middle, in lane widths, of which the clutter offsets are chosen."""
OFFSETS_OF_CLUTTER_MEASUREMENT_IN_LANE_WIDTHS = np.asarray(
    _CANDIDATE_CLUTTER_OFFSETS_IN_LANE_WIDTHS[
        np.abs(np.abs(_CANDIDATE_CLUTTER_OFFSETS_IN_LANE_WIDTHS) % 1.0 - 0.5) > 0.1
    ]
)
"""Offsets from the lane's middle, in lane widths, at which clutter is measured: none within 0.1 of a boundary of the
lane or of a neighbouring lane. Chosen by hand; not fitted."""


def left_and_right_paint_shares(evidence: StripeEvidence, lane: ImageLane) -> FloatArray:
    """Share of each boundary that shows paint, shape (2,), 0 to 1, counted by stretches of the image's height."""
    return lane_ridge.supports(evidence.sharp, evidence.rows, lane, evidence.scoring_settings())


def road_clutter_share(evidence: StripeEvidence, lane: ImageLane) -> float:
    """Share of the road beside the boundaries, two lanes to each side, that looks like a bright stripe, 0 to 1."""
    places = lane[MIDDLE] + OFFSETS_OF_CLUTTER_MEASUREMENT_IN_LANE_WIDTHS * lane[WIDTH]
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
    evidence: StripeEvidence, lane: ImageLane, lane_objective: float, carried_side: int = -1, *, vote_share: float = 1.0
) -> LeftRightProbabilities:
    """Probability of each boundary that it lies where the lane has it.

    Args:
        vote_share: Share of the votes for the vanishing point, 0 to 1 (`vanishing.VanishingPoint`).
        carried_side: The boundary whose place follows from the other line (`lane_sides`), if there is one. The lane's
            objective is that of the other line's paint, so for this one at most twice its own support counts.
    """
    coefficients: list[float] = BOUNDARY_LOG_ODDS_WEIGHTS.tolist()
    by_votes = LOG_ODDS_LOSS_PER_MISSING_VOTE_SHARE * vote_share_shortfall(vote_share)
    left, right = (
        (1.0 - PROBABILITY_OF_WELL_SEEN_OTHER_LINE)
        / (1.0 + math.exp(-min(max(sum(map(mul, each, coefficients)) + by_votes, -30.0), 30.0)))
        for each in probability_features_of_left_and_right(evidence, lane, lane_objective, carried_side)
    )
    return left, right


def vote_share_shortfall(vote_share: float) -> float:
    """How far the share of the votes for the vanishing point is below that of a clear road, at most 0."""
    return min(vote_share - MIN_CLEAR_VANISHING_POINT_VOTE_SHARE, 0.0)


def rival_weights_of_left_and_right(lanes: ImageLanes, objectives: FloatArray, height_px: int) -> tuple[float, float]:
    """Sum of exp(-deficit / 0.12) over the rivals of the first of some lanes that have no line at its left, and at its
    right, boundary; arguments as in `first_frame_probability_features`."""
    weights = [0.0, 0.0]
    for rival, value in zip(lanes[1:], objectives[1:].tolist(), strict=True):
        gain = min(value - float(objectives[0]), MAX_RIVAL_OBJECTIVE_GAIN)
        weight = math.exp(gain / RIVAL_OBJECTIVE_DEFICIT_OF_WEIGHT_1_OVER_E)
        for side, has_line in enumerate(has_lines_at_boundaries(rival, lanes[0], height_px)):
            weights[side] += 0.0 if has_line else weight
    return weights[0], weights[1]


def first_frame_probability_features(
    evidence: StripeEvidence, lanes: ImageLanes, objectives: FloatArray, vote_share: float, height_px: int
) -> list[tuple[float, float, float, float, float]]:
    """The features of each side of the best lane of a frame that is searched alone.

    Args:
        lanes: All lanes that the search returns, best first, shape (k, 6).
        objectives: Their objectives, shape (k,).
        vote_share: Share of the votes for the vanishing point, 0 to 1; 1 where the mounting is known.

    Returns:
        1, logarithm of the objective, root of the clutter, shortfall of votes, and logarithm of the lane's share beside
        its rivals.
    """
    objective = min(max(float(objectives[0]), 0.0), 1.0)
    by_chance = math.sqrt(road_clutter_share(evidence, lanes[0]))
    return [
        (
            1.0,
            math.log(objective + OBJECTIVE_OFFSET_BEFORE_LOGARITHM),
            by_chance,
            vote_share_shortfall(vote_share),
            -math.log1p(weight),
        )
        for weight in rival_weights_of_left_and_right(lanes, objectives, height_px)
    ]


def first_frame_boundary_probabilities(
    evidence: StripeEvidence, lanes: ImageLanes, objectives: FloatArray, vote_share: float, height_px: int
) -> LeftRightProbabilities:
    """Probability of both boundaries of the best lane of a frame that is searched alone; arguments as in
    `first_frame_probability_features`."""
    coefficients: list[float] = FIRST_FRAME_LOG_ODDS_WEIGHTS.tolist()
    left, right = (
        (1.0 - PROBABILITY_OF_OTHER_LINE_IN_FIRST_FRAME)
        / (1.0 + math.exp(-min(max(sum(map(mul, each, coefficients)), -30.0), 30.0)))
        for each in first_frame_probability_features(evidence, lanes, objectives, vote_share, height_px)
    )
    return left, right
