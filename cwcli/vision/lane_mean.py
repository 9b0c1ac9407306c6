"""The mean of the lanes that a frame supports about as well as the best one.

Where two or three dots or one dash are all that shows of a boundary, the objective is flat: lanes half a metre apart
differ by less than any prior's sigma counts, and the best of them is best by chance. Their mean, each weighed by
exp(objective / 0.015), has the least squared error, and is moved by what little there is all along: a joint, a
neighbour's line. It is taken over points of a normal distribution that is fitted to the weights in a few rounds
(adaptive importance sampling; O. Cappé et al., Population Monte Carlo, J. Comput. Graph. Statist. 13 (2004) 907). The
points are those of a low-discrepancy sequence (the powers of the root of x^6 = x + 1), so nothing is random.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import NormalDist

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.vision.camera import WidthHeightPx
from cwcli.vision.lane_model import (
    BEND,
    HIGH,
    HORIZON,
    LOW,
    MIDDLE,
    SPIRAL,
    VANISHING,
    WIDTH,
    ImageLane,
    ImageLanes,
    LanePriorTable,
)

OBJECTIVE_DIFFERENCE_OF_WEIGHT_1_OVER_E = 0.015
"""Difference of objective at which a lane counts 37 % (1 / e); one sigma of the prior takes off 0.02. Chosen in sight
of 40 labelled and of rendered frames (docs/lanes.md)."""
N_SAMPLE_POINTS, N_FITTING_ROUNDS = 192, 3
"""Number of sample points, and of rounds in which their distribution is fitted. Chosen by hand; not fitted."""
NEAR_ROW_BELOW_HORIZON_SHARE, FAR_ROW_BELOW_HORIZON_SHARE = 0.6, 0.15
"""The near and the far row in which lanes are varied, as shares of the way from the horizon to the bottom. Chosen by
hand; not fitted."""
FIRST_ROUND_SIGMA_SHARES = np.array([0.012, 0.012, 0.008, 0.008, 0.008])
"""Sigmas of the first round: left and right column in the near row, middle and bend in the far row (over the image's
width), and the horizon (over its height). Chosen by hand; not fitted."""
MIN_SHARE_OF_FIRST_ROUND_SIGMAS = 0.05
"""Share of the first round's sigmas that no later round goes below. Chosen by hand; not fitted."""


def _evenly_spread_points_of_standard_normal_5d(n: int) -> FloatArray:
    """Shape (n, 5): points that fill a normal distribution evenly."""
    root = 1.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / 6.0)
    evenly = (0.5 + np.outer(np.arange(1, n + 1), root ** -np.arange(1.0, 6.0))) % 1.0
    inverse = NormalDist().inv_cdf
    return np.array([[inverse(min(max(each, 1e-4), 1.0 - 1e-4)) for each in row] for row in evenly.tolist()])


STANDARD_NORMAL_POINTS = _evenly_spread_points_of_standard_normal_5d(N_SAMPLE_POINTS)
"""Evenly spread points of the five-dimensional standard normal distribution, in sigmas, shape (192, 5), equal in every
run."""


def weighted_mean_lane(
    objectives_of_lanes: Callable[[FloatArray], FloatArray], lane: ImageLane, table: LanePriorTable, size: WidthHeightPx
) -> ImageLane:
    """The weighted mean of the lanes around one lane, all with its change of curvature.

    Args:
        objectives_of_lanes: Maps lanes (k, 6) to their objectives (k,).
        lane: Shape (6,): the lane around which the points lie at first.

    Returns:
        Shape (6,), within the prior's bounds.
    """
    width_px, height_px = size
    depth = height_px - lane[HORIZON]
    rows_px = (
        float(lane[HORIZON] + NEAR_ROW_BELOW_HORIZON_SHARE * depth),
        float(lane[HORIZON] + FAR_ROW_BELOW_HORIZON_SHARE * depth),
    )
    spiral = float(lane[SPIRAL])
    sigmas = FIRST_ROUND_SIGMA_SHARES * np.array([width_px] * 4 + [height_px])
    mean, covariance = _columns_bend_and_horizon_from_lane(lane, *rows_px), np.diag(sigmas**2)
    for _ in range(N_FITTING_ROUNDS):
        points = mean + STANDARD_NORMAL_POINTS @ np.linalg.cholesky(covariance).T
        value = objectives_of_lanes(_image_lanes_from_row_columns(points, *rows_px, spiral))
        if value.max() < -1e20:  # all beyond the bounds
            break
        # a point that lies where few do stands for more
        exponent = (value - value.max()) / OBJECTIVE_DIFFERENCE_OF_WEIGHT_1_OVER_E + 0.5 * (
            STANDARD_NORMAL_POINTS**2
        ).sum(axis=1)
        weight = np.exp(exponent - exponent.max())
        weight /= weight.sum()
        mean = weight @ points
        deviations = points - mean
        covariance = (deviations * weight[:, None]).T @ deviations + np.diag(
            (MIN_SHARE_OF_FIRST_ROUND_SIGMAS * sigmas) ** 2
        )
    return np.clip(_image_lanes_from_row_columns(mean, *rows_px, spiral), table[:, LOW], table[:, HIGH])


def _columns_bend_and_horizon_from_lane(lane: ImageLane, near_px: float, far_px: float) -> FloatArray:
    """A lane as places in the image, shape (5,): left and right column in a near row, middle and bend's share in a far
    row, horizon."""
    u0, middle, width, bend, horizon, _ = lane.tolist()
    near_h, far_h = near_px - horizon, far_px - horizon
    centre = u0 + middle * near_h + bend / near_h
    half = 0.5 * width * near_h
    return np.array([centre - half, centre + half, u0 + middle * far_h + bend / far_h, bend / far_h, horizon])


def _image_lanes_from_row_columns(places: FloatArray, near_px: float, far_px: float, spiral: float) -> ImageLanes:
    """The lanes (..., 6) that belong to such places (..., 5), with a given change of curvature."""
    left, right, far, share, horizon = np.moveaxis(places, -1, 0)
    near_h, far_h = np.maximum(near_px - horizon, 2.0), np.maximum(far_px - horizon, 1.0)
    centre, bend = 0.5 * (left + right), share * far_h
    lanes = np.empty((*places.shape[:-1], 6))
    lanes[..., MIDDLE] = (centre - far - bend * (1.0 / near_h - 1.0 / far_h)) / (near_h - far_h)
    lanes[..., VANISHING] = centre - lanes[..., MIDDLE] * near_h - bend / near_h
    lanes[..., WIDTH] = (right - left) / near_h
    lanes[..., BEND] = bend
    lanes[..., HORIZON], lanes[..., SPIRAL] = horizon, spiral
    return lanes
