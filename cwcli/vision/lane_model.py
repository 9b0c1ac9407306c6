"""The lane in the image as six numbers, what is known of them beforehand, and the parabolas that they become.

A flat road of constant curvature, seen by a camera without roll: h = v - v0 rows below the horizon v0, a boundary is in
column u = u0 + m h + k / h + q / h^2 as long as the bend is gentle, else on a curve (`arcs`) that it touches, where

- u0 is the column in which a straight lane would vanish: the camera's yaw and the car's heading,
- m = lateral place / camera height, to the right, times fx / fy: `middle` - `width` / 2 for the left boundary,
  `middle` + `width` / 2 for the right one,
- k = curvature (to the right) fx fy H / 2,
- q = the curvature's change in a metre ahead, fx fy^2 H^2 / 6: 0 but for lanes that are followed.

So both boundaries have six numbers in common, and no calibration is needed to find them: it enters through the prior,
and through fx where a bend is tight.
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.kernels import lane_ridge
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.signals.lane_geometry import (
    FarNearBendSpiral,
    Pinhole,
    far_near_bend_spiral_of_parallel_line,
    image_columns_of_arcs,
)
from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.ground import (
    MAX_SAMPLE_DISTANCE_M,
    MAX_SAMPLE_HEIGHT_SHARE,
    MIN_DEPTH_BELOW_HORIZON_SHARE,
    MIN_TOP_HEIGHT_OF_BOUNDARY_SAMPLES_PX,
)

ImageLane = FloatArray
"""One lane in the image, shape (6,): vanishing column, middle, width, bend, horizon row and spiral."""
ImageLanes = FloatArray
"""Lanes in the image, shape (k, 6), each an `ImageLane`."""
LanePriorTable = FloatArray
"""Mean, sigma, lowest and highest value of the six numbers of a lane, shape (6, 4)."""
LeftRightParabolas = FloatArray
"""Parabolas of the left and the right boundary, shape (..., 2, 3): a, b, c in pixels."""
LeftRightProbabilities = tuple[float, float]
"""Probabilities of the left and of the right boundary, 0 to 1."""

VANISHING, MIDDLE, WIDTH = lane_ridge.VANISHING, lane_ridge.MIDDLE, lane_ridge.WIDTH
"""Indices of the first three numbers of a lane: u0 (px), and middle and width over the camera's height times fx /
fy."""
BEND, HORIZON, SPIRAL = lane_ridge.BEND, lane_ridge.HORIZON, lane_ridge.SPIRAL
"""Indices of the last three numbers of a lane: k (px^2), v0 (px) and q (px^3)."""
MEAN, SIGMA, LOW, HIGH = lane_ridge.MEAN, lane_ridge.SIGMA, lane_ridge.LOW, lane_ridge.HIGH
"""Indices of the columns of a prior's table: mean, sigma, lowest and highest value."""

LANE_WIDTH_MEAN_AND_SIGMA_M = (3.6, 0.22)
"""Mean and sigma of the lane width in metres: 3.25 m on main roads to 3.75 m on motorways; 3.66 m (12 ft) in the US."""
LANE_WIDTH_LIMITS_M = (2.6, 4.6)
"""Least and greatest lane width that is searched, in metres. Chosen by hand; not fitted."""
CAR_OFFSET_IN_LANE_SIGMA_M = 0.35
"""Sigma of the car's offset from the lane's middle, in metres. Chosen by hand; not fitted."""
MAX_FIRST_FRAME_OFFSET_M = 1.6
"""Greatest offset of the car from the lane's middle in a first frame, in metres. Chosen by hand; not fitted."""
FIRST_FRAME_HEADING_SIGMA_RAD = 0.012
"""Sigma of the angle between car and lane in a first frame, in radians. Chosen by hand; not fitted."""
FIRST_FRAME_CURVATURE_SIGMA_1PM = 0.001
"""Sigma of the lane's curvature in a first frame, in 1/m. Chosen by hand; not fitted."""
MAX_FIRST_FRAME_CURVATURE_1PM = 0.006
"""Greatest curvature in a first frame, in 1/m: a radius of 167 m. Chosen by hand; not fitted."""
CAMERA_PITCH_SIGMA_RAD = 0.004
"""Sigma of the camera's pitch in radians: the body moves on its springs, and the road's slope changes. Chosen by hand;
not fitted."""
LANE_WIDTH_FACTOR_OF_UNKNOWN_HEIGHT = 0.88
"""Factor (1) on lane widths in camera heights where the mounting is not known: 1.3 m, the height in which they are
counted, over 1.48 m, the mean height of cameras behind windscreens (1.2 to 1.7 m)."""
CAMERA_HEIGHT_SIGMA_OF_UNKNOWN_MOUNTING_SHARE = 0.1
"""Sigma of the camera's height over its mean where the mounting is not known. Chosen by hand; not fitted."""
CAMERA_YAW_SIGMA_OF_UNKNOWN_MOUNTING_RAD = 0.035
"""Sigma of the camera's yaw where the mounting is not known, in radians. Chosen by hand; not fitted."""
UNKNOWN_HORIZON_MEAN_SIGMA_LOW_HIGH_SHARES = (0.45, 0.12, 0.25, 0.66)
"""Mean, sigma, lowest and highest row of the horizon over the image's height, where the mounting is not known. Chosen
by hand; not fitted."""
MAX_DISTANCE_OF_BOUNDARIES_ON_SAME_PIXELS_SHARE = 0.006
"""Distance up to which boundaries lie on the same pixels, over the image's width. Chosen by hand; not fitted."""
COMPARED_ROWS_OF_WAY_FROM_HORIZON_TO_BOTTOM_SHARES = (0.15, 0.6)
"""Rows in which lanes are compared, as shares of the way from the horizon to the bottom. There are two because lanes
that bend to different sides may have the same place and width."""

PREDICTION_DRIFT_SIGMAS = np.array([0.02, 0.25, 0.08, 0.0015, 0.012, 1e-6])
"""Sigmas of a prediction's error after one second, growing with the root of time: heading (rad), place (m), width (m),
curvature (1/m), pitch (rad), change of curvature (1/m^2). Chosen by hand; not fitted."""


@dataclass(frozen=True)
class LanePrior:
    """Prior of a lane: its numbers before the frame is seen.

    Attributes:
        table: Shape (6, 4): mean, sigma, lowest and highest of the six numbers.
        is_mounting_known: The horizon is known from the camera's mounting.
        pinhole: Intrinsics of the camera.
        drift_sigmas: Shape (6,): sigmas of the prediction's error of a followed lane after one second.
        place_units_per_m: One metre in the unit of `middle` and `width`.
    """

    table: FloatArray
    is_mounting_known: bool
    pinhole: Pinhole
    drift_sigmas: FloatArray
    place_units_per_m: float

    def with_table(self, table: LanePriorTable, drift: FloatArray | None = None) -> LanePrior:
        """The same prior with another table, and another drift if one is given."""
        return LanePrior(
            table,
            self.is_mounting_known,
            self.pinhole,
            self.drift_sigmas if drift is None else drift,
            self.place_units_per_m,
        )


def first_frame_prior(camera: Camera) -> LanePrior:
    """The prior for the first frame of a camera.

    A mounting that equals the stated default counts as unknown.
    """
    mounting = camera.mounting
    is_mounted = not camera.is_default and mounting != Mounting()
    height_m, stretch = mounting.height_m, camera.fx / camera.fy
    table = np.empty((6, 4))
    yaw_sigma = math.hypot(
        FIRST_FRAME_HEADING_SIGMA_RAD, 0.005 if is_mounted else CAMERA_YAW_SIGMA_OF_UNKNOWN_MOUNTING_RAD
    )
    u0 = camera.cx + camera.fx * math.tan(mounting.yaw_rad)
    table[VANISHING] = u0, camera.fx * yaw_sigma, u0 - 4.0 * camera.fx * yaw_sigma, u0 + 4.0 * camera.fx * yaw_sigma
    middle = stretch * mounting.lateral_offset_m / height_m
    per_m = stretch / height_m
    spread = CAR_OFFSET_IN_LANE_SIGMA_M if is_mounted else math.hypot(CAR_OFFSET_IN_LANE_SIGMA_M, 0.4)
    table[MIDDLE] = (
        middle,
        spread * per_m,
        middle - MAX_FIRST_FRAME_OFFSET_M * per_m,
        middle + MAX_FIRST_FRAME_OFFSET_M * per_m,
    )
    width_m, width_sigma_m = LANE_WIDTH_MEAN_AND_SIGMA_M
    if not is_mounted:
        width_sigma_m = math.hypot(width_sigma_m, CAMERA_HEIGHT_SIGMA_OF_UNKNOWN_MOUNTING_SHARE * width_m)
        width_m *= LANE_WIDTH_FACTOR_OF_UNKNOWN_HEIGHT
    low, high = (each * per_m for each in LANE_WIDTH_LIMITS_M)
    table[WIDTH] = width_m * per_m, width_sigma_m * per_m, low if is_mounted else 0.65 * low, high
    bend = bend_px2_per_curvature(camera)
    bend *= 1.0 if is_mounted else 2.0
    table[BEND] = (
        0.0,
        FIRST_FRAME_CURVATURE_SIGMA_1PM * bend,
        -MAX_FIRST_FRAME_CURVATURE_1PM * bend,
        MAX_FIRST_FRAME_CURVATURE_1PM * bend,
    )
    if is_mounted:
        v0 = float(camera.horizon_row_px())
        reach = camera.fy * CAMERA_PITCH_SIGMA_RAD
        table[HORIZON] = v0, reach, v0 - 5.0 * reach, v0 + 5.0 * reach
    else:
        table[HORIZON] = np.array(UNKNOWN_HORIZON_MEAN_SIGMA_LOW_HIGH_SHARES) * camera.height_px
    table[SPIRAL] = 0.0, 1.0, 0.0, 0.0
    unit = np.array(
        [camera.fx, per_m, per_m, bend_px2_per_curvature(camera), camera.fy, spiral_px3_per_curvature_change(camera)]
    )
    return LanePrior(table, is_mounted, pinhole_of_camera(camera), PREDICTION_DRIFT_SIGMAS * unit, per_m)


def pinhole_of_camera(camera: Camera) -> Pinhole:
    """The intrinsics that the shape of a road in the image depends on."""
    return Pinhole(camera.cx, camera.fx, camera.fx / camera.fy)


def bend_px2_per_curvature(camera: Camera) -> float:
    """The bend (px^2) of a road of curvature 1 1/m."""
    return camera.fx * camera.fy * camera.mounting.height_m / 2.0


def spiral_px3_per_curvature_change(camera: Camera) -> float:
    """The spiral (px^3) of a road whose curvature changes by 1 1/m in a metre."""
    return camera.fx * (camera.fy * camera.mounting.height_m) ** 2 / 6.0


def pitch_from_horizon_rad(lane: ImageLane, camera: Camera) -> float:
    """The camera's pitch that follows from the lane's horizon, in radians, nose down positive."""
    return math.atan((camera.cy - float(lane[HORIZON])) / camera.fy)


def boundary_columns_in_rows_px(image_lane: ImageLane, v_px: FloatArray, pinhole: Pinhole) -> FloatArray:
    """Columns of both boundaries in n rows, shape (2, n); NaN at and above the horizon, and where they have turned
    back."""
    centre, focal = np.array(pinhole.centre_px + 1.0), np.array(pinhole.focal_px)
    return (
        image_columns_of_arcs(
            boundary_road_curves(image_lane, pinhole)[:, None], v_px - image_lane[HORIZON], centre, focal
        )
        - 1.0
    )


def boundary_road_curves(lane: ImageLane, pinhole: Pinhole) -> FarNearBendSpiral:
    """Curves of both boundaries, shape (2, 4): far (px), near, bend (px^2), spiral (px^3)
    (`lane_geometry.image_columns_of_arcs`), columns counted from 1."""
    u0, middle, width, bend, _, spiral = lane.tolist()
    curves = np.array(
        [
            far_near_bend_spiral_of_parallel_line(u0, middle + sign * 0.5 * width, bend, spiral, pinhole)
            for sign in (-1.0, 1.0)
        ]
    )
    curves[:, 0] += 1.0
    return curves


def is_same_lane_in_image(lane: ImageLane, other: ImageLane, width_px: int, height_px: int) -> bool:
    """Whether the boundaries of two lanes lie on the same pixels, near and far."""
    u0, middle, width, bend, horizon, spiral = lane.tolist()
    other_u0, other_middle, other_width, other_bend, other_horizon, other_spiral = other.tolist()
    depth = height_px - 0.5 * (horizon + other_horizon)
    for share in COMPARED_ROWS_OF_WAY_FROM_HORIZON_TO_BOTTOM_SHARES:
        h = height_px - (1.0 - share) * depth - horizon
        other_h = h + horizon - other_horizon
        if h <= 0.0 or other_h <= 0.0:
            return False
        column = u0 + middle * h + (bend + spiral / h) / h
        difference_px = column - (other_u0 + other_middle * other_h + (other_bend + other_spiral / other_h) / other_h)
        wider = 0.5 * (width * h - other_width * other_h)
        if abs(difference_px) + abs(wider) > MAX_DISTANCE_OF_BOUNDARIES_ON_SAME_PIXELS_SHARE * width_px:
            return False
    return True


def max_fit_height_px(lane: ImageLane, camera: Camera) -> float:
    """Height above the image's bottom up to which parabolas are fitted: the road 60 m ahead, at most the paper's
    rows."""
    below_rad = math.atan(camera.mounting.height_m / MAX_SAMPLE_DISTANCE_M) - pitch_from_horizon_rad(lane, camera)
    y_px = camera.height_px - (camera.cy + camera.fy * math.tan(below_rad))
    return min(max(y_px, MIN_TOP_HEIGHT_OF_BOUNDARY_SAMPLES_PX), MAX_SAMPLE_HEIGHT_SHARE * camera.height_px)


def fit_boundary_parabolas(lane: ImageLane, camera: Camera) -> LeftRightParabolas:
    """Shape (2, 3): a, b, c of the best parabola of each boundary; NaN where the road is out of sight.

    It is fitted at the samples from which `ground` takes the road back.
    """
    top_px = max_fit_height_px(lane, camera)
    return lane_ridge.parabolas(
        lane,
        top_y=top_px,
        height=camera.height_px,
        width=camera.width_px,
        min_h=MIN_DEPTH_BELOW_HORIZON_SHARE * camera.height_px,
        centre=camera.cx,
        focal=camera.fx,
    )
