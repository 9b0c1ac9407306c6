"""What is known of a lane from one frame to the next: where the car's motion takes it, and what it can't do.

A lane that is followed is judged under another prior than one that is looked for: a car that changes lanes may be
anywhere between them, and one on a ramp turns in a bend that no motorway has. What it can't do is jump: its boundaries
move by no more than a car can move sideways.
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.vision.camera import Camera
from cwcli.vision.lane_model import (
    BEND,
    CAMERA_PITCH_SIGMA_RAD,
    HIGH,
    HORIZON,
    LOW,
    MEAN,
    MIDDLE,
    SIGMA,
    SPIRAL,
    VANISHING,
    WIDTH,
    ImageLane,
    ImageLanes,
    LanePrior,
    LanePriorTable,
    bend_px2_per_curvature,
    spiral_px3_per_curvature_change,
)

MIN_OFFSET_OF_LANE_CHANGE_IN_WIDTHS = 0.55
"""Offset of the camera from the lane's middle, in lane widths, above which the car is in the next lane. Chosen by hand;
not fitted."""
MAX_FOLLOWED_OFFSET_IN_WIDTHS = 0.65
"""Greatest offset of the camera from the middle of a followed lane, in lane widths. Chosen by hand; not fitted."""
MIN_CAMERA_OFFSET_TO_CONSIDER_NEXT_LANE_IN_WIDTHS = 0.35
"""Offset of the camera from the lane's middle, in lane widths, above which the next lane may take this one's place.
Chosen by hand; not fitted."""
NEXT_LANE_TOLERANCE_IN_WIDTHS = 0.2
"""Tolerance of the next lane's place, in lane widths. Chosen by hand; not fitted."""
FOLLOWED_OFFSET_SIGMA_M = 0.6
"""Sigma of the camera's offset from the middle of a followed lane, in metres. Chosen on lane changes and mountain bends
0 and 1 of `tests.studies.lane_drives`; drives 200 and 201 of both were not looked at."""
FOLLOWED_HEADING_SIGMA_RAD = 0.05
"""Sigma of the heading in a followed lane, in radians: a car that changes lanes or slides outwards in a tight bend
points aside. Chosen on the same drives as the sigma of the offset."""
FOLLOWED_CURVATURE_SIGMA_1PM = 0.02
"""Sigma of the curvature of a followed lane, in 1/m. Chosen by hand; not fitted."""
MAX_BOUNDARY_SPEED_FROM_PREDICTION_KNOWN_MOTION_MPS = 0.8
"""Greatest lateral speed of a boundary relative to its prediction where speed and heading are known, in m/s: 0.03 rad
at 25 m/s."""
MAX_BOUNDARY_LATERAL_SPEED_UNKNOWN_CAR_MOTION_MPS = 1.5
"""Greatest lateral speed of a boundary where the car's motion is not known, in m/s: that of a swift lane change."""
MAX_WIDENING_SPEED_MPS = 0.6
"""Greatest rate at which a lane's width changes, in m/s: a taper of 1 : 40 at 25 m/s."""
MARGIN_OF_BOUNDARY_MOVEMENT_M = 0.02
"""Distance that a boundary may move in addition, in metres: the grain of the paint. Chosen by hand; not fitted."""
MIN_ASSUMED_FRAME_INTERVAL_S = 0.02
"""Least time step that the limits of a boundary's movement assume, in seconds. Chosen by hand; not fitted."""
COMPARED_ROWS_FROM_HORIZON_TO_BOTTOM = (0.25, 0.6)
"""Rows in which two lanes are compared, as shares of the way from the horizon to the image's bottom. Chosen by hand;
not fitted."""
LINE_OFFSETS_IN_WIDTHS = np.array([-1.5, -0.5, 0.5, 1.5])
"""Lateral places of the lines of a lane and of its two neighbours, from the lane's middle, in lane widths."""
SAME_LINE_TOLERANCE_IN_CAMERA_HEIGHTS = 0.15
"""Distance below which two lines count as one, over the camera's height. Chosen by hand; not fitted."""
LATERAL_JERK_SIGMA_MPS3 = 1.0
"""Sigma of the lateral jerk in a road's bends, in m/s^3. Chosen by hand: the upper end of what clothoids are designed
for, 0.5 to 1; ramps have more."""
MAX_CURVATURE_CHANGE_IN_PRIOR_SIGMAS = 4.0
"""Greatest change of curvature that is searched, in sigmas of its prior. Chosen by hand; not fitted."""
DISTANCE_OVER_WHICH_NEW_BEND_TURNS_LANE_UNPREDICTED_M = 10.0
"""Distance over which a bend that begins turns the lane without being predicted, in metres. Chosen on ramp 200 of
`tests.studies.lane_drives`."""
MIN_SPEED_WITHOUT_NEW_BENDS_MPS = 20.0
"""Speed in m/s from which lanes have no change of curvature and new bends are not searched: a change of one sigma moves
a boundary 20 m ahead by less than 0.17 m, and with few raised dots that freedom finds lanes that are not there."""
BEND_PIVOT_ROW_SHARE = 0.6
"""Row in which bends are varied without moving the lane, as a share of the way from the horizon to the image's bottom:
7 m ahead of a wide camera. Chosen by hand; not fitted."""
PITCH_CANDIDATES_SIGMAS = np.array([0.0, -1.0, 1.0, -2.0, 2.0, -3.0, 3.0, -4.5, 4.5])
"""Pitch candidates in sigmas of the pitch prediction: a bump moves the whole lane up or down. Chosen by hand; not
fitted."""
SPIRAL_CANDIDATES_SIGMAS, BEND_CANDIDATES_SIGMAS = (
    each.ravel() for each in np.meshgrid(np.linspace(-2.0, 2.0, 9), np.linspace(-6.0, 6.0, 9))
)
"""Grid of candidates: changes of curvature in sigmas, and bends in sigmas of that change times the distance of the
pivot row. Chosen on ramp 200 of `tests.studies.lane_drives`."""
MAX_LATERAL_ACCEL_MPS2 = 6.0
"""Greatest lateral acceleration of a car, in m/s^2: bends at a known speed are not tighter. Chosen by hand; not
fitted."""
MAX_CURVATURE_1PM = 0.06
"""Greatest curvature of a lane at any known speed, in 1/m: a radius of 17 m. Chosen by hand; not fitted."""
MAX_CURVATURE_UNKNOWN_SPEED_1PM = 0.02
"""Greatest curvature of a lane where the speed is not known, in 1/m: a radius of 50 m. Chosen by hand; not fitted."""
MIN_SPEED_FOR_CURVATURE_MPS = 3.0
"""Least speed in m/s at which yaw rate over speed gives a curvature. Chosen by hand; not fitted."""
DRIVEN_CURVATURE_SIGMA_SHARE = 0.25
"""Sigma of the curvature ahead relative to the curvature in which the car drives. Chosen by hand; not fitted."""


def max_drivable_curvature_1pm(speed_mps: float) -> float:
    """The greatest curvature in which a car can drive at a speed, in 1/m."""
    if not math.isfinite(speed_mps):
        return MAX_CURVATURE_UNKNOWN_SPEED_1PM
    return min(MAX_LATERAL_ACCEL_MPS2 / max(speed_mps, MIN_SPEED_FOR_CURVATURE_MPS) ** 2, MAX_CURVATURE_1PM)


def driven_rightward_curvature_or_nan_1pm(speed_mps: float, yaw_rate_radps: float) -> float:
    """The curvature in which the car drives, in 1/m, right positive; NaN where speed or yaw rate is not known."""
    if not (speed_mps >= MIN_SPEED_FOR_CURVATURE_MPS and math.isfinite(yaw_rate_radps)):
        return math.nan
    return -yaw_rate_radps / speed_mps


def prior_of_followed_lane(prior: LanePrior, camera: Camera, speed_mps: float) -> LanePrior:
    """The prior of a lane that is followed: wider in offset, heading and curvature than that of a first frame."""
    rows: list[list[float]] = prior.table.tolist()
    place, ahead, bend = rows[MIDDLE], rows[VANISHING], rows[BEND]
    reach = MAX_FOLLOWED_OFFSET_IN_WIDTHS * rows[WIDTH][HIGH]
    place[SIGMA] = FOLLOWED_OFFSET_SIGMA_M * prior.place_units_per_m
    place[LOW], place[HIGH] = min(place[LOW], -reach), max(place[HIGH], reach)
    heading = camera.fx * FOLLOWED_HEADING_SIGMA_RAD
    ahead[SIGMA] = max(ahead[SIGMA], heading)
    ahead[LOW] -= 3.0 * heading
    ahead[HIGH] += 3.0 * heading
    unit = bend_px2_per_curvature(camera)
    tightest = max(bend[HIGH], unit * max_drivable_curvature_1pm(speed_mps))
    bend[SIGMA], bend[LOW], bend[HIGH] = unit * FOLLOWED_CURVATURE_SIGMA_1PM, -tightest, tightest
    drift = prior.drift_sigmas
    if math.isfinite(speed_mps):
        drift = drift.copy()
        speed_mps = max(speed_mps, MIN_SPEED_FOR_CURVATURE_MPS)
        drift[BEND] = max(drift[BEND], 2.0 * unit * LATERAL_JERK_SIGMA_MPS3 / speed_mps**2)
        spiral = spiral_px3_per_curvature_change(camera) * LATERAL_JERK_SIGMA_MPS3 / speed_mps**3
        drift[SPIRAL] = spiral
        if speed_mps < MIN_SPEED_WITHOUT_NEW_BENDS_MPS:
            drift[VANISHING] = math.hypot(
                drift[VANISHING],
                camera.fx
                * DISTANCE_OVER_WHICH_NEW_BEND_TURNS_LANE_UNPREDICTED_M
                * LATERAL_JERK_SIGMA_MPS3
                / speed_mps**2,
            )
            rows[SPIRAL] = [
                0.0,
                spiral,
                -MAX_CURVATURE_CHANGE_IN_PRIOR_SIGMAS * spiral,
                MAX_CURVATURE_CHANGE_IN_PRIOR_SIGMAS * spiral,
            ]
    return prior.with_table(np.array(rows), drift)


def pitch_candidates(lane: ImageLane, prior: LanePrior, table: LanePriorTable, dt_s: float) -> ImageLanes:
    """Candidates of a predicted lane with other pitches, shape (k, 6); the first is the prediction itself.

    A search that moves one number after the other takes a bump for a bend, or stays where it is.

    Args:
        table: The prior's table around the prediction; candidates stay within its limits.
    """
    candidates = np.empty((len(PITCH_CANDIDATES_SIGMAS), len(lane)))
    candidates[:] = lane
    moved = lane[HORIZON] + PITCH_CANDIDATES_SIGMAS * (
        prior.drift_sigmas[HORIZON] * math.sqrt(max(dt_s, MIN_ASSUMED_FRAME_INTERVAL_S))
    )
    candidates[:, HORIZON] = np.minimum(np.maximum(moved, table[HORIZON, LOW]), table[HORIZON, HIGH])
    return candidates


def curvature_candidates(lane: ImageLane, prior: LanePrior, table: LanePriorTable, height_px: int) -> ImageLanes:
    """Candidates of a predicted lane with other bends and changes of curvature, shape (k, 6).

    All keep the lane's place and direction in a near row. Where a road begins to bend, place and direction beside the
    camera, bend and change of curvature are wrong together, and a search that moves one after the other does not leave
    the old bend. With t = 1 / h in the near row, all that leaves the line as it is there is
    dk (1 / h - t)^2 h + dq (1 / h - t)^3 h.

    Args:
        prior: The prior of a followed lane; the sigma of its change of curvature is the grid's unit.
        table: The prior's table around the prediction; candidates stay within its limits.
    """
    t, sigma = 1.0 / (BEND_PIVOT_ROW_SHARE * (height_px - float(lane[HORIZON]))), float(prior.table[SPIRAL, SIGMA])
    spirals, bends = sigma * SPIRAL_CANDIDATES_SIGMAS, sigma * t * BEND_CANDIDATES_SIGMAS
    candidates = np.empty((len(bends), len(lane)))
    candidates[:] = lane
    dq = spirals - lane[SPIRAL]
    candidates[:, VANISHING] += (3.0 * dq * t - 2.0 * bends) * t
    candidates[:, MIDDLE] += (bends - dq * t) * t * t
    candidates[:, BEND] += bends - 3.0 * dq * t
    candidates[:, SPIRAL] = spirals
    return np.minimum(np.maximum(candidates, table[:, LOW]), table[:, HIGH])


def prior_with_driven_curvature(prior: LanePrior, camera: Camera, speed_mps: float, yaw_rate_radps: float) -> LanePrior:
    """The prior of a first frame with the curvature in which the car drives; unchanged where that is not known."""
    driven = driven_rightward_curvature_or_nan_1pm(speed_mps, yaw_rate_radps)
    if math.isnan(driven):
        return prior
    table = prior.table.copy()
    unit = bend_px2_per_curvature(camera)
    table[BEND, MEAN] = unit * driven
    table[BEND, SIGMA] = math.hypot(table[BEND, SIGMA], unit * DRIVEN_CURVATURE_SIGMA_SHARE * driven)
    tightest = max(table[BEND, HIGH], unit * max_drivable_curvature_1pm(speed_mps))
    table[BEND, LOW], table[BEND, HIGH] = -tightest, tightest
    return prior.with_table(table)


def prior_with_seen_horizon(prior: LanePrior, horizon_px: float, camera: Camera) -> LanePrior:
    """The prior with the horizon that the frames have shown so far."""
    table = prior.table.copy()
    sigma = max(camera.fy * CAMERA_PITCH_SIGMA_RAD, 1.0)
    table[HORIZON] = horizon_px, sigma, horizon_px - 6.0 * sigma, horizon_px + 6.0 * sigma
    return prior.with_table(table)


def prior_at_lane_horizon(prior: LanePrior, lane: ImageLane, camera: Camera) -> LanePrior:
    """The prior for a lane whose horizon differs from that of the frames so far; else the prior itself."""
    row = prior.table[HORIZON]
    if prior.is_mounting_known or row[LOW] <= lane[HORIZON] <= row[HIGH]:
        return prior
    return prior_with_seen_horizon(prior, float(lane[HORIZON]), camera)


def predict_lane_at_next_frame(
    lane: ImageLane, camera: Camera, speed_mps: float, yaw_rate_radps: float, dt_s: float, prior: LanePrior
) -> ImageLane:
    """The lane in the next frame, predicted from the car's motion; shape (6,). Unknown motion changes nothing.

    With places and curvatures K to the right, the lane's direction seen from the car turns by (K v + yaw rate) dt, its
    middle moves sideways by that direction times v dt, and the bend changes as it does ahead.

    Args:
        camera: The camera in the pixels of the search image.
        speed_mps, yaw_rate_radps: The car's motion; NaN where it is not known.
    """
    next_lane = np.array(lane)
    height_m = camera.mounting.height_m
    if math.isfinite(speed_mps):
        distance_m = speed_mps * dt_s
        bend_1pm, change_1pm2 = (
            lane[BEND] / bend_px2_per_curvature(camera),
            lane[SPIRAL] / spiral_px3_per_curvature_change(camera),
        )
        if math.isfinite(yaw_rate_radps):
            turned_rad = (bend_1pm + 0.5 * change_1pm2 * distance_m) * distance_m + yaw_rate_radps * dt_s
            next_lane[VANISHING] += camera.fx * turned_rad
        next_lane[BEND] += bend_px2_per_curvature(camera) * change_1pm2 * distance_m
        if prior.is_mounting_known:
            straight = camera.cx + camera.fx * math.tan(camera.mounting.yaw_rad)
            next_lane[MIDDLE] += (
                (lane[VANISHING] - straight) / camera.fx * distance_m * prior.pinhole.focal_length_ratio / height_m
            )
    return next_lane


def lane_change_left_1_right_minus_1(lane: ImageLane) -> int:
    """The lane change that a lane's place shows: 1 to the left, -1 to the right, 0 for none."""
    if abs(lane[MIDDLE]) <= MIN_OFFSET_OF_LANE_CHANGE_IN_WIDTHS * lane[WIDTH]:
        return 0
    return 1 if lane[MIDDLE] > 0.0 else -1


def shift_to_adjacent_lane(lane: ImageLane, left_1_right_minus_1: int) -> ImageLane:
    """The adjacent lane on the left (1) or on the right (-1), or the same lane (0); shape (6,)."""
    adjacent = np.array(lane)
    adjacent[MIDDLE] -= left_1_right_minus_1 * adjacent[WIDTH]
    return adjacent


def narrow_prior_table(
    prior: LanePrior,
    lane: ImageLane,
    dt_s: float,
    sideways_mps: float = MAX_BOUNDARY_LATERAL_SPEED_UNKNOWN_CAR_MOTION_MPS,
) -> FloatArray:
    """The table of a prior narrowed around a predicted lane, shape (6, 4).

    Place, width and horizon get the product of the prior and a normal distribution around the prediction; direction and
    bend get the latter alone. The lane's place and width stay within what a car and a taper can do.

    Args:
        sideways_mps: Greatest lateral speed at which the prediction of the place may be wrong.
    """
    dt_s = max(dt_s, MIN_ASSUMED_FRAME_INTERVAL_S)
    predicted_at: list[float] = lane.tolist()
    sigma: list[float] = (prior.drift_sigmas * math.sqrt(dt_s)).tolist()
    rows: list[list[float]] = prior.table.tolist()
    for k in (MIDDLE, WIDTH, HORIZON):  # a spiral begins and ends at once: it keeps its prior
        before, now = 1.0 / rows[k][SIGMA] ** 2, 1.0 / sigma[k] ** 2
        rows[k][MEAN] = (rows[k][MEAN] * before + predicted_at[k] * now) / (before + now)
        rows[k][SIGMA] = 1.0 / math.sqrt(before + now)
    for k in (VANISHING, BEND):  # the prior of a first frame, anew in every frame, would flatten every bend
        rows[k][MEAN], rows[k][SIGMA] = predicted_at[k], sigma[k]
    for k, rate_mps in ((MIDDLE, sideways_mps), (WIDTH, MAX_WIDENING_SPEED_MPS)):
        reach = (rate_mps * dt_s + MARGIN_OF_BOUNDARY_MOVEMENT_M) * prior.place_units_per_m
        _, _, low, high = rows[k]
        place = min(max(predicted_at[k], low), high)
        rows[k][LOW], rows[k][HIGH] = max(place - reach, low), min(place + reach, high)
    return np.array(rows)


def boundary_difference_beside_camera_m(lane: ImageLane, other: ImageLane, prior: LanePrior) -> float:
    """Distance beside the camera between the boundaries of two lanes, of the side that differs more, in metres."""
    difference_m = abs(float(lane[MIDDLE] - other[MIDDLE])) + 0.5 * abs(float(lane[WIDTH] - other[WIDTH]))
    return difference_m / prior.place_units_per_m


def max_boundary_difference_m(lane: ImageLane, other: ImageLane, prior: LanePrior, height_px: int) -> float:
    """Distance between the boundaries of two lanes, of the side that differs more, near the car and 20 m ahead of a
    wide camera, in metres."""
    most = 0.0
    for share in COMPARED_ROWS_FROM_HORIZON_TO_BOTTOM:
        h = share * (height_px - float(lane[HORIZON]))
        other_h = h + float(lane[HORIZON] - other[HORIZON])
        if other_h <= 0.0:
            return math.inf
        moved = boundary_columns_at_depth_px(lane, h) - boundary_columns_at_depth_px(other, other_h)
        most = max(most, float(np.abs(moved).max()) / h)
    return most / prior.place_units_per_m


def boundary_columns_at_depth_px(lane: ImageLane, depth_px: float) -> FloatArray:
    """Columns of both boundaries h rows below the lane's horizon, shape (2,), by the polynomial also in tight bends."""
    u0, middle, width, bend, _, spiral = lane.tolist()
    return np.asarray(
        u0 + np.array([middle - 0.5 * width, middle + 0.5 * width]) * depth_px + (bend + spiral / depth_px) / depth_px
    )


def has_lines_at_boundaries(lane: ImageLane, other: ImageLane, height_px: int) -> tuple[bool, bool]:
    """Whether a lane or one of its neighbours has a line at the left and at the right boundary of another lane."""
    found = np.ones((2, len(LINE_OFFSETS_IN_WIDTHS)), np.bool_)
    for share in COMPARED_ROWS_FROM_HORIZON_TO_BOTTOM:
        h = share * (height_px - float(other[HORIZON]))
        own_h = h + float(other[HORIZON] - lane[HORIZON])
        if own_h <= 0.0:
            return False, False
        middle = float(boundary_columns_at_depth_px(lane, own_h).mean())
        lines = middle + LINE_OFFSETS_IN_WIDTHS * float(lane[WIDTH]) * own_h
        found &= (
            np.abs(lines - boundary_columns_at_depth_px(other, h)[:, None]) <= SAME_LINE_TOLERANCE_IN_CAMERA_HEIGHTS * h
        )
    return bool(found[0].any()), bool(found[1].any())


def lane_change_between_left_1_right_minus_1(lane: ImageLane, other: ImageLane) -> int:
    """The lane change from one lane to another: 1 to the left, -1 to the right; 0 unless they are adjacent and the car
    is between them."""
    width = 0.5 * float(lane[WIDTH] + other[WIDTH])
    change = 1 if lane[MIDDLE] > other[MIDDLE] else -1
    difference_m = abs(float(lane[MIDDLE] - other[MIDDLE]))
    is_between = change * float(lane[MIDDLE]) > MIN_CAMERA_OFFSET_TO_CONSIDER_NEXT_LANE_IN_WIDTHS * width
    return change if is_between and abs(difference_m - width) < NEXT_LANE_TOLERANCE_IN_WIDTHS * width else 0
