"""How exact a found lane is: the curvature of its objective at the optimum, and what follows for the boundaries.

Near its optimum the objective falls as a parabola in the lane's numbers (but its spiral, see below), and the faster the
more exactly the frame shows them: covariance = COVARIANCE_PER_INVERSE_OBJECTIVE_CURVATURE x inverse of the negative
second derivatives. These are differences over steps of half a marking's width, because on a smaller scale the objective
is as rough as the pixels.
They are taken in places that the image shows (both boundaries near the car, the middle and the bend far away, the
horizon), in which the five depend little on each other. What no step makes worse is not seen: its sigma is the greatest
that is published, one step.

A road does not bend evenly, and by how much its bend changes up to the far rows the objective hardly shows: the fit is
exact near by and far away, and between them the road is beside it. So there is a second part: of the bend with those
places held, c L for a way of L to the far rows, and of the direction, c L^2 / 12, which is that of the cubic
c x^3 / 6 - c L^2 x / 24 (zero at both ends and in the middle) at its ends. A camera that sees far is not as exact as
its pixels.

COVARIANCE_PER_INVERSE_OBJECTIVE_CURVATURE and CURVATURE_CHANGE_SIGMA_1PM2 are fitted on rendered drives of the sets
`good` and `complex`: squared errors 20 m ahead over their variances (tests/studies/lane_nees.py). docs/lanes.md has
those of other drives.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.vision.camera import Camera
from cwcli.vision.lane_detect import StripeEvidence, lane_objectives
from cwcli.vision.lane_model import (
    BEND,
    HORIZON,
    MIDDLE,
    VANISHING,
    WIDTH,
    ImageLane,
    LanePriorTable,
    bend_px2_per_curvature,
    fit_boundary_parabolas,
    pitch_from_horizon_rad,
)

COVARIANCE_PER_INVERSE_OBJECTIVE_CURVATURE = 0.002
"""Factor between the inverse curvature of the objective and the covariance. Fitted on 16 rendered drives of each camera
(tests/studies/lane_nees.py, seed 3)."""
CURVATURE_CHANGE_SIGMA_1PM2 = 4e-6
"""Sigma of the change of a road's curvature per metre, in 1/m^2. Fitted on the same rendered drives."""
NEAR_ROW_BELOW_HORIZON_SHARE, FAR_ROW_BELOW_HORIZON_SHARE = 0.6, 0.15
"""The near and the far row, as shares of the way from the horizon to the bottom. Chosen by hand; not fitted."""
NEAR_ROW_LATERAL_STEP_IN_SCALED_CAMERA_HEIGHTS, FAR_ROW_LATERAL_STEP_IN_SCALED_CAMERA_HEIGHTS = 0.04, 0.06
"""Steps of the places in the near and in the far row, over the camera's height times fx / fy: about half a marking's
width."""
HORIZON_DERIVATIVE_STEP_SHARE = 0.006
"""Step of the horizon, over the image's height. Chosen by hand; not fitted."""
SIGMA_CAP_IN_DERIVATIVE_STEPS = 1.0
"""Greatest sigma in steps: that of what no step makes worse. Chosen by hand; not fitted."""
N_LANE_PARAMETERS = 5
"""Number of a lane's numbers that have a covariance: all but the change of curvature."""
_ROWS_OF_UPPER_TRIANGLE, _COLUMNS_OF_UPPER_TRIANGLE = np.triu_indices(N_LANE_PARAMETERS, 1)
"""Rows and columns of the elements above the diagonal of the information matrix of a lane's numbers."""
_STENCIL_STEPS = np.concatenate(
    [
        np.zeros((1, N_LANE_PARAMETERS)),
        np.eye(N_LANE_PARAMETERS),
        -np.eye(N_LANE_PARAMETERS),
        np.eye(N_LANE_PARAMETERS)[_ROWS_OF_UPPER_TRIANGLE] + np.eye(N_LANE_PARAMETERS)[_COLUMNS_OF_UPPER_TRIANGLE],
        -np.eye(N_LANE_PARAMETERS)[_ROWS_OF_UPPER_TRIANGLE] - np.eye(N_LANE_PARAMETERS)[_COLUMNS_OF_UPPER_TRIANGLE],
    ]
)
"""Places at which the objective is evaluated, shape (31, 5), in steps."""


def covariance_of_first_five_lane_numbers(
    evidence: StripeEvidence, lane: ImageLane, table: LanePriorTable, camera: Camera
) -> FloatArray:
    """The covariance of a lane's first five numbers, shape (5, 5).

    Args:
        evidence, lane: The stripes of the frame, and the lane, shape (6,), at its optimum.
        table: Table of the prior, shape (6, 4), under which it was found.
        camera: The camera in the pixels of the image that was searched.
    """
    places, steps = _lane_derivatives_by_place_and_place_steps_px(
        float(lane[HORIZON]), camera.height_px, evidence.pinhole.focal_length_ratio
    )
    places = places * steps
    lanes = np.empty((len(_STENCIL_STEPS), len(lane)))
    lanes[:] = lane
    lanes[:, :N_LANE_PARAMETERS] += _STENCIL_STEPS @ places.T
    values = lane_objectives(evidence, lanes, table)
    values = np.maximum(values, values[0] - 1.0)  # beyond a limit of the prior there is no value
    fall = (
        2.0 * values[0] - values[1 : 1 + N_LANE_PARAMETERS] - values[1 + N_LANE_PARAMETERS : 1 + 2 * N_LANE_PARAMETERS]
    )
    pairs = (
        2.0 * values[0]
        - values[1 + 2 * N_LANE_PARAMETERS : 1 + 2 * N_LANE_PARAMETERS + len(_ROWS_OF_UPPER_TRIANGLE)]
        - values[1 + 2 * N_LANE_PARAMETERS + len(_ROWS_OF_UPPER_TRIANGLE) :]
    )
    information = np.diag(fall)
    information[_ROWS_OF_UPPER_TRIANGLE, _COLUMNS_OF_UPPER_TRIANGLE] = information[
        _COLUMNS_OF_UPPER_TRIANGLE, _ROWS_OF_UPPER_TRIANGLE
    ] = 0.5 * (pairs - fall[_ROWS_OF_UPPER_TRIANGLE] - fall[_COLUMNS_OF_UPPER_TRIANGLE])
    value, vector = np.linalg.eigh(information)
    axes = places @ vector
    covariance: FloatArray = (
        axes
        * (
            COVARIANCE_PER_INVERSE_OBJECTIVE_CURVATURE
            / np.maximum(value, COVARIANCE_PER_INVERSE_OBJECTIVE_CURVATURE / SIGMA_CAP_IN_DERIVATIVE_STEPS**2)
        )
    ) @ axes.T
    far_m = camera.fy * camera.mounting.height_m / _near_and_far_depth_px(float(lane[HORIZON]), camera.height_px)[1]
    bend = places[:, 3] * (bend_px2_per_curvature(camera) * CURVATURE_CHANGE_SIGMA_1PM2 * far_m / places[BEND, 3])
    turn = places[:, 2] * (camera.fx * CURVATURE_CHANGE_SIGMA_1PM2 * far_m**2 / 12.0 / places[VANISHING, 2])
    covariance += bend[:, None] * bend + turn[:, None] * turn
    return covariance


def _near_and_far_depth_px(horizon_px: float, height_px: int) -> tuple[float, float]:
    """Rows below the horizon of the places near by and far away."""
    depth = max(height_px - horizon_px, 8.0)
    return NEAR_ROW_BELOW_HORIZON_SHARE * depth, FAR_ROW_BELOW_HORIZON_SHARE * depth


def _lane_derivatives_by_place_and_place_steps_px(
    horizon_px: float, height_px: int, stretch: float
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the five numbers with respect to the places, shape (5, 5), a column for each place; and the steps
    in pixels.

    With u = u0 + m h + k / h: the places are the columns of the left and of the right boundary in the row h1, that of
    the middle in the row h2, the bend's part of it, k / h2, and the horizon. Solved for the five numbers.
    """
    near, far = _near_and_far_depth_px(horizon_px, height_px)
    half, share = 0.5 / (near - far), 1.0 / near  # of the middle, and of the bend
    middle = (half, half, -2.0 * half, share, 0.0)
    numbers: list[tuple[float, ...]] = [()] * N_LANE_PARAMETERS
    numbers[VANISHING] = (-far * half, -far * half, 1.0 + 2.0 * far * half, -1.0 - far * share, 0.0)
    numbers[MIDDLE], numbers[WIDTH] = middle, (-share, share, 0.0, 0.0, 0.0)
    numbers[BEND], numbers[HORIZON] = (0.0, 0.0, 0.0, far, 0.0), (0.0, 0.0, 0.0, 0.0, 1.0)
    near_px, far_px = (
        NEAR_ROW_LATERAL_STEP_IN_SCALED_CAMERA_HEIGHTS * stretch * near,
        max(FAR_ROW_LATERAL_STEP_IN_SCALED_CAMERA_HEIGHTS * stretch * far, 1.0),
    )
    steps = np.array([near_px, near_px, far_px, far_px, max(HORIZON_DERIVATIVE_STEP_SHARE * height_px, 1.0)])
    return np.array(numbers), steps


def propagate_covariance_to_fit(lane: ImageLane, covariance: FloatArray, camera: Camera) -> FloatArray:
    """The covariance of a published fit, shape (7, 7): a, b, c of both sides, and the pitch.

    Args:
        lane, covariance: The lane, shape (6,), and its covariance, shape (5, 5).
        camera: The camera in the pixels of the image that was searched.
    """
    sigma = np.sqrt(np.diagonal(covariance))
    steps = np.eye(N_LANE_PARAMETERS, len(lane)) * sigma[:, None]
    published = np.array(
        [
            [*fit_boundary_parabolas(each, camera).ravel().tolist(), pitch_from_horizon_rad(each, camera)]
            for each in (lane, *(lane + steps))
        ]
    )
    jacobian = (published[1:] - published[0]).T / sigma
    propagated: FloatArray = jacobian @ covariance @ jacobian.T
    return propagated
