"""The lane at a preview point that the linear model of the default observer can follow.

Roads are built for the speed at which they are driven. Their design limits the lateral jerk, v^3 times the change of
the curvature per metre, so at half the speed the curvature may change eight times as quickly. The distance D of the
preview point therefore falls as v^(3/2): an unknown change K' of the curvature then turns the lane's direction there by
the same K' D^2 / 2 at all speeds. D is also smaller where the lane turns: in a bend of 23 m there is no lane 33.5 m
ahead.

With the sine of the lane's direction for e_L, eq. 20 holds for a car that follows a circle however far it turns: with
y = R (1 - cos phi) and D = R sin phi the lane's place at D changes by tan phi (v - gamma y) - gamma D = v sin phi -
gamma D = 0, and sin phi by cos phi (v K - gamma). A car that leaves the circle moves y by 1 + tan phi tan(phi / 2)
times as much as the model says: 10 % more at a sine of 0.4.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cwcli.dynamics.samples import LaneSamples
from cwcli.signals.columns import FloatArray
from cwcli.signals.lane_geometry import (
    MAX_SINE_OF_DRAWN_LINE_DIRECTION,
    centre_arcs_of_lanes,
    distance_ahead_to_direction_sine_m,
    y_direction_curvature_of_lane_centres_at_distance,
)

TUNING_DRIVE_SPEED_MPS = 25.0
"""Speed of the simulated drives on which the filter's walks and the preview distance were chosen, m/s."""
MIN_SPEED_OF_PREVIEW_SCALING_MPS = 5.0
"""Speed below which the preview distance and the walks no longer change with the speed, m/s. Chosen by hand; not
fitted."""
MAX_LANE_DIRECTION_SINE_AT_PREVIEW = 0.4
"""Largest sine of the lane's direction at the preview point: there the linear model moves y_L by 10 % too little (see
above)."""
MIN_PREVIEW_DISTANCE_M = 2.0
"""Smallest distance of the preview point ahead of the camera and of the centre of gravity, m. Chosen by hand; not
fitted."""


def reference_to_actual_speed_ratio(speed_mps: FloatArray) -> FloatArray:
    """Ratio of the reference speed (25 m/s) to the car's, shape (n,), at least 1; 1 where the speed is not known."""
    return np.fmax(1.0, TUNING_DRIVE_SPEED_MPS / np.maximum(np.abs(speed_mps), MIN_SPEED_OF_PREVIEW_SCALING_MPS))


def convert_sine_states_to_angles(state: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Replace the sine of e_L by its angle in states (n, 4) and, to first order, in covariances (n, 4, 4)."""
    sine = np.clip(state[:, 3], -MAX_SINE_OF_DRAWN_LINE_DIRECTION, MAX_SINE_OF_DRAWN_LINE_DIRECTION)
    size = np.ones_like(state)
    size[:, 3] = (1.0 - sine * sine) ** -0.5
    angles = np.column_stack([state[:, :3], np.arcsin(sine)])
    return angles, covariance * size[:, :, None] * size[:, None, :]


def move_lanes_to_nearer_preview(
    lanes: LaneSamples, speed_mps: FloatArray, preview_m: float, camera_forward_m: float
) -> tuple[LaneSamples, FloatArray, FloatArray]:
    """Move each frame's lane to a preview point that is near enough for the speed and the bend.

    Args:
        lanes: n frames; where `lines` holds the lane's shape, values are taken from it, e_L as the sine.
        speed_mps: Shape (n,); NaN where it is not known.
        preview_m: Distance of the preview point of `lanes`, which is the farthest.
        camera_forward_m: Distance of the camera ahead of the centre of gravity.

    Returns:
        The frames, their sigmas still those of the farthest point; the point's distance ahead of the camera, shape
        (n,); and how K_L changes in a metre, shape (n,), 0 where it is not known.
    """
    whole_m = np.full(len(lanes), preview_m)
    if lanes.lines is None or lanes.curvature_change_1pm2 is None:
        return lanes, whole_m, np.zeros(len(lanes))
    change_1pm2 = -np.nan_to_num(lanes.curvature_change_1pm2)
    turned_m = distance_ahead_to_direction_sine_m(
        centre_arcs_of_lanes(lanes.lines), MAX_LANE_DIRECTION_SINE_AT_PREVIEW, change_1pm2
    )
    nearest_m = MIN_PREVIEW_DISTANCE_M + max(-camera_forward_m, 0.0)
    nearer_m = np.fmax(np.fmin(preview_m * reference_to_actual_speed_ratio(speed_mps) ** -1.5, turned_m), nearest_m)
    at_m = np.minimum(nearer_m, preview_m)
    y_m, direction_rad, curvature_1pm = y_direction_curvature_of_lane_centres_at_distance(
        lanes.lines, at_m, change_1pm2
    ).T
    is_known = np.isfinite(direction_rad)
    near = replace(
        lanes,
        lateral_deviation_m=np.where(is_known, -y_m, lanes.lateral_deviation_m),
        heading_deviation_rad=np.where(is_known, -np.sin(direction_rad), lanes.heading_deviation_rad),
        curvature_1pm=np.where(is_known, -curvature_1pm, lanes.curvature_1pm),
    )
    return near, np.where(is_known, at_m, whole_m), np.where(is_known, -change_1pm2, 0.0)
