"""Both boundaries on the road, and the deviations at the preview point (zhang2011, 1.2.3, fig. 11).

Each boundary is sampled at image rows and mapped to the ground plane. There it becomes y = y0 + s x + k x^2 / 2 in the
body frame (x forward from below the camera, y left of the car's centre line). A road of constant curvature is a
hyperbola in the image, not a parabola, and a search that fits a parabola to it finds the best one. So the road is
sought whose best parabola is the given one: with the parabolas' basis P and the road's basis Q at the samples, and
weights w that make a pixel count the same everywhere, P' w Q (y0, s, k) = P' w y. (The plain fit of a road to the
parabola would find half the curvature.)

At the preview distance D the centre between both boundaries gives, in the paper's signs,

    y_L = -y(D)            the lane's centre lies to the right of the car's axis: positive
    e_L = -atan(y'(D))     the car points counter-clockwise from the lane: positive
    K_L = -y'' / (1 + y'^2)^(3/2)    the lane bends to the right: positive

With these signs eq. 8, 9 and 20 hold (dy_L/dt = v e_L - ..., de_L/dt = v K_L - ...). If one boundary alone is found,
the heading and the curvature are its own, and there is no lateral deviation.

The sigmas follow from first-order propagation: the covariance of (a, b, c) of each side, and the mounting's sigmas,
which are common to both sides.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.signals.lane_geometry import (
    FarNearBendSpiral,
    curvature_change_ratios_to_centre_line,
    lateral_positions_of_arcs_m,
    y_direction_curvature_of_lane_centres_at_distance,
)
from cwcli.vision.camera import Camera, rotation_from_yaw_pitch_roll
from cwcli.vision.fit_columns import FitColumns

N_BOUNDARY_SAMPLES = 16
"""Number of heights at which a boundary is sampled. Chosen by hand; not fitted."""
MAX_SAMPLE_DISTANCE_M = 60.0
"""Greatest distance at which boundaries are sampled, in metres: beyond it a pixel of the search image is metres of
road."""
MAX_SAMPLE_HEIGHT_SHARE = 0.625
"""Greatest height at which boundaries are sampled, over the image's height: the paper's 150 of 240 rows."""
MIN_DEPTH_BELOW_HORIZON_SHARE = 0.03
"""Least distance below the horizon at which evidence is looked for and boundaries are drawn, over the image's height:
nearer to it a marking is narrower than a pixel (12 cm, 1.3 m below a camera with 360 rows)."""
MIN_TOP_HEIGHT_OF_BOUNDARY_SAMPLES_PX = 8.0
"""Least height up to which boundaries are sampled, in pixels above the image's bottom. Chosen by hand; not fitted."""
MIN_DRAWN_BOUNDARY_TOP_HEIGHT_PX = 2.0
"""Least height at which a drawn boundary ends, in pixels above the image's bottom. Chosen by hand; not fitted."""
N_PARAMETERS_OF_BOTH_BOUNDARIES_AND_PITCH = 7
"""Number of parameters of the joint covariance (`LaneFit.covariance`): a, b, c of both boundaries, and the pitch."""
MIN_SAMPLE_DISTANCE_M = 2.0
"""Least distance at which boundaries are sampled, in metres. Chosen by hand; not fitted."""
LANE_WIDTH_DISTANCE_AHEAD_M = 10.0
"""Distance ahead at which the lane's width is measured, in metres. Chosen by hand; not fitted."""
MIN_FIT_SAMPLES = 5
"""Least number of samples from which a road follows. Chosen by hand; not fitted."""
N_HEIGHTS_WITH_INDEPENDENT_ERRORS = 10
"""Number of heights at which a boundary's errors are taken as independent where a method gives no covariance. Chosen by
hand; not fitted."""
PARABOLA_DERIVATIVE_STEPS = np.array([1e-6, 1e-4, 1e-2])
"""Steps of a (1/px), b and c (px) for numerical derivatives. Chosen by hand; not fitted."""
MOUNTING_DERIVATIVE_STEP = 1e-4
"""Step of pitch, yaw (rad) and height (m) for numerical derivatives. Chosen by hand; not fitted."""
FRAMES_PER_BLOCK = 2048
"""Number of frames that are computed at a time. Chosen by hand: it bounds the memory."""


@dataclass(frozen=True)
class GeometrySigmas:
    """Sigmas of the error propagation where a method gives no covariance of its own.

    Attributes:
        pixel_px: Sigma of a boundary's place in the search image, at each of ten independent heights.
        pitch_rad, yaw_rad, height_m: Sigmas of the mounting; that of the pitch includes the car's own pitching.
    """

    pixel_px: float = 1.0
    pitch_rad: float = 0.005
    yaw_rad: float = 0.005
    height_m: float = 0.03


@dataclass(frozen=True)
class LaneGeometry:
    """Lane geometry of n frames; NaN where a boundary that is needed was not found.

    Attributes:
        left_body, right_body: Shape (n, 3): y0 (m), slope s (rad for small ones), curvature k (1/m) of each boundary in
            the body frame: y = y0 + s x + k x^2 / 2, left positive.
        lateral_deviation_m, heading_deviation_rad, curvature_1pm: Shape (n,): y_L, e_L, K_L in the paper's signs.
        lateral_deviation_sigma_m, heading_deviation_sigma_rad, curvature_sigma_1pm: Shape (n,).
        lane_width_m: Shape (n,), 10 m ahead, across the lane.
        curvature_change_1pm2: Shape (n,): how the curvature changes in a metre ahead, right positive as K_L; 0 where
            the method knows none.
    """

    left_body: FloatArray
    right_body: FloatArray
    lateral_deviation_m: FloatArray
    heading_deviation_rad: FloatArray
    curvature_1pm: FloatArray
    lateral_deviation_sigma_m: FloatArray
    heading_deviation_sigma_rad: FloatArray
    curvature_sigma_1pm: FloatArray
    lane_width_m: FloatArray
    curvature_change_1pm2: FloatArray


def compute_lane_geometry(
    fits: FitColumns, camera: Camera, *, preview_m: float, sigmas: GeometrySigmas | None = None
) -> LaneGeometry:
    """Map the boundaries of frames of one image size to the ground.

    Args:
        fits: n fits; their pitch and yaw replace the mounting's where they are not NaN.
        camera: The camera in the pixels of the search image.
    """
    blocks = [fits[slice(i, i + FRAMES_PER_BLOCK)] for i in range(0, len(fits), FRAMES_PER_BLOCK)] or [fits]
    geometries = [_lane_geometry_of_block(block, camera, preview_m, sigmas or GeometrySigmas()) for block in blocks]
    return LaneGeometry(*(np.concatenate([getattr(each, f.name) for each in geometries]) for f in fields(LaneGeometry)))


def image_hyperbolas_of_flat_road(fits: FitColumns, camera: Camera) -> FarNearBendSpiral:
    """The boundaries as images of a flat road, x = far + near h + bend / h + spiral / h^2.

    h is in rows below the horizon; in a tight bend that curve touches the road beside the camera (`arcs`). A method's
    own road is taken as it is. Else, as on the ground, the road is fitted whose best parabola is the given one. It
    holds near the horizon too, where a parabola is off by lanes.

    Args:
        camera: The camera in the pixels of the search image.

    Returns:
        Shape (n, 2, 4): far (px), near, bend (px^2), spiral (px^3) of each boundary; NaN where none was found, or where
        the method found no horizon (`fits.pitch_rad` is NaN). The spiral is 0 where the method has no road.
    """
    has_road = np.isfinite(fits.roads)
    rest = np.flatnonzero(~has_road.all(axis=(1, 2)))
    if not len(rest):
        return fits.roads
    roads = fits.roads.copy()
    roads[rest] = np.where(has_road[rest], fits.roads[rest], _fit_flat_road_curves_to_parabolas(fits[rest], camera))
    return roads


def _fit_flat_road_curves_to_parabolas(fits: FitColumns, camera: Camera) -> FarNearBendSpiral:
    """Road curves whose best parabolas are those of the fits, shape (n, 2, 4)."""
    y_px = _boundary_sample_heights_px(camera, fits.pitch_rad)
    x_px = _parabola_columns_px(fits.parabolas, y_px)
    h = ((camera.height_px - y_px - camera.horizon_row_px(fits.pitch_rad)[:, None]) / camera.height_px)[:, None]
    is_there = np.isfinite(x_px) & (h > 0.0)
    h = np.where(h > 0.0, h, 1.0)
    terms = np.stack([np.ones_like(h), h, 1.0 / h], axis=-1)
    seen_px = x_px
    for _ in range(2):  # the parabola was fitted to samples of which the road, not the parabola, is in the image
        use = is_there & _usable_sample_mask(seen_px, is_there, camera)
        part = np.where(use, 1.0, 0.0)
        normal, right = np.empty((*x_px.shape[:2], 3, 3)), np.empty((*x_px.shape[:2], 3))
        for i in range(3):
            normal[..., i, :] = (part[..., None] * terms).sum(axis=2)
            right[..., i] = (part * np.where(use, x_px, 0.0)).sum(axis=2)
            part = part * (y_px / camera.height_px)[:, None]
        roads = _solve_normal_equations_or_nan(normal, right, use)
        seen_px = (roads[:, :, None] * terms).sum(axis=-1)
    roads = roads * np.array([1.0, 1.0 / camera.height_px, camera.height_px])
    return np.concatenate([roads, 0.0 * roads[..., :1]], axis=-1)


def repeat_pinhole_per_frame(camera: Camera, n: int) -> FloatArray:
    """Principal column and focal length for each of n frames of one camera, shape (n, 2) (`BoundaryLines.pinhole`)."""
    return np.tile([camera.cx + 1.0, camera.fx], (n, 1))


def boundary_top_rows_px(fits: FitColumns, camera: Camera, horizon_px: FloatArray) -> FloatArray:
    """Row from the image's top at which the boundaries of each frame end, shape (n,).

    Where the method found the horizon they end with the road 60 m ahead, but below the rows in which evidence is looked
    for. Else nothing is known of what lies above the paper's rows.

    Args:
        camera: The camera in the pixels of the search image.
        horizon_px: Shape (n,): row of the horizon; NaN where it is not known.
    """
    is_found = np.isfinite(fits.pitch_rad)
    paper_px = np.full(len(fits), (1.0 - MAX_SAMPLE_HEIGHT_SHARE) * camera.height_px)
    far_px = np.where(is_found, camera.height_px - _height_of_road_60_m_ahead_px(camera, fits.pitch_rad), paper_px)
    top_px = np.fmax(far_px, horizon_px + MIN_DEPTH_BELOW_HORIZON_SHARE * camera.height_px)
    return np.asarray(np.clip(top_px, 0.0, camera.height_px - MIN_DRAWN_BOUNDARY_TOP_HEIGHT_PX))


def parabola_covariance_from_pixel_sigma(camera: Camera, pixel_px: float) -> FloatArray:
    """Covariance of (a, b, c), shape (3, 3), if places at independent heights have errors of `pixel_px`."""
    y_px = np.linspace(
        1.0,
        float(_height_of_highest_sample_px(camera, np.array(camera.mounting.pitch_rad))),
        N_HEIGHTS_WITH_INDEPENDENT_ERRORS,
    )
    design = np.column_stack([y_px**2, y_px, np.ones_like(y_px)])
    return np.asarray(np.linalg.inv(design.T @ design) * pixel_px**2)


def _height_of_highest_sample_px(camera: Camera, pitch_rad: FloatArray) -> FloatArray:
    """Height in the image up to which boundaries are sampled: the road 60 m ahead, at most the paper's rows; distortion
    left out."""
    return np.asarray(
        np.clip(
            _height_of_road_60_m_ahead_px(camera, pitch_rad),
            MIN_TOP_HEIGHT_OF_BOUNDARY_SAMPLES_PX,
            MAX_SAMPLE_HEIGHT_SHARE * camera.height_px,
        )
    )


def _height_of_road_60_m_ahead_px(camera: Camera, pitch_rad: FloatArray) -> FloatArray:
    """Height in the image of the road 60 m ahead, distortion left out."""
    below_rad = np.arctan(camera.mounting.height_m / MAX_SAMPLE_DISTANCE_M) - pitch_rad
    return np.asarray(camera.height_px - (camera.cy + camera.fy * np.tan(below_rad)))


def _lane_geometry_of_block(fits: FitColumns, camera: Camera, preview_m: float, sigmas: GeometrySigmas) -> LaneGeometry:
    """The lane geometry of one block of frames."""
    n = len(fits)
    parabolas = fits.parabolas
    mount = np.empty((n, 3))
    mount[:, 0] = np.where(np.isnan(fits.pitch_rad), camera.mounting.pitch_rad, fits.pitch_rad)
    mount[:, 1] = np.where(np.isnan(fits.yaw_rad), camera.mounting.yaw_rad, fits.yaw_rad)
    mount[:, 2] = camera.mounting.height_m
    beside_px = _road_curve_minus_parabola_at_samples_px(fits, camera)
    body, use = _ground_place_slope_curvature_and_used_samples(parabolas, mount, camera, beside_px)
    change = _centre_line_curvature_change_or_0_1pm2(fits, body, camera)
    is_curve = np.asarray(np.isfinite(fits.roads).any(axis=(1, 2)), np.bool_)
    values = _lateral_heading_deviation_and_curvature_at_preview(body, change, is_curve, preview_m)
    assumed = parabola_covariance_from_pixel_sigma(camera, sigmas.pixel_px)
    variance = np.zeros_like(values)
    # With the same samples: one that enters or leaves within a step would look like an infinite slope.
    moved_bodies = [
        _ground_place_slope_curvature_and_used_samples(parabolas + step, mount, camera, beside_px, use)[0]
        for step in np.diag(PARABOLA_DERIVATIVE_STEPS)
    ]
    of_fit = np.zeros((n, 3, N_PARAMETERS_OF_BOTH_BOUNDARIES_AND_PITCH))
    for side in range(2):
        jacobian = np.empty((n, 3, 3))
        for k, moved_body in enumerate(moved_bodies):
            one_moved = body.copy()
            one_moved[:, side] = moved_body[:, side]
            jacobian[:, :, k] = (
                _lateral_heading_deviation_and_curvature_at_preview(one_moved, change, is_curve, preview_m) - values
            ) / PARABOLA_DERIVATIVE_STEPS[k]
        own_covariance = fits.covariance[:, side]
        covariance = np.where(np.isnan(own_covariance), assumed, own_covariance)
        part = np.einsum("nij,njk,nik->ni", jacobian, covariance, jacobian)
        variance += np.where(np.isnan(parabolas[:, side, :1]), 0.0, part)
        of_fit[:, :, 3 * side : 3 * side + 3] = jacobian
    for k, sigma in enumerate((sigmas.pitch_rad, sigmas.yaw_rad, sigmas.height_m)):
        moved_mount = mount.copy()
        moved_mount[:, k] += MOUNTING_DERIVATIVE_STEP
        moved_body, _ = _ground_place_slope_curvature_and_used_samples(parabolas, moved_mount, camera, beside_px, use)
        slope = (
            _lateral_heading_deviation_and_curvature_at_preview(moved_body, change, is_curve, preview_m) - values
        ) / MOUNTING_DERIVATIVE_STEP
        variance += (slope * sigma) ** 2
        if k == 0:
            of_fit[:, :, -1] = slope
            own = np.einsum("nij,njk,nik->ni", of_fit, fits.joint_covariance, of_fit)
            variance = np.where(np.isnan(own), variance, own)  # the fit's own pitch is part of it
    values = np.where(np.isnan(variance), np.nan, values)  # a step from the end of a curve
    sigma_of = np.where(np.isnan(values), np.nan, np.sqrt(variance))
    return LaneGeometry(
        left_body=body[:, 0],
        right_body=body[:, 1],
        lateral_deviation_m=values[:, 0],
        heading_deviation_rad=values[:, 1],
        curvature_1pm=values[:, 2],
        lateral_deviation_sigma_m=sigma_of[:, 0],
        heading_deviation_sigma_rad=sigma_of[:, 1],
        curvature_sigma_1pm=sigma_of[:, 2],
        lane_width_m=_lane_width_10_m_ahead_m(body, change, is_curve),
        curvature_change_1pm2=-change,
    )


def _centre_line_curvature_change_or_0_1pm2(
    fits: FitColumns, left_and_right_arcs: FloatArray, camera: Camera
) -> FloatArray:
    """Change of the lane's curvature per metre ahead, on the car's centre line, left positive, shape (n,); 0 without a
    road."""
    own = -6.0 * fits.roads[..., 3] / (camera.fx * (camera.fy * camera.mounting.height_m) ** 2)
    change = own / curvature_change_ratios_to_centre_line(left_and_right_arcs)
    is_known = np.isfinite(change)
    return np.asarray(np.where(is_known, change, 0.0).sum(axis=1) / np.maximum(is_known.sum(axis=1), 1))


def _road_curve_minus_parabola_at_samples_px(fits: FitColumns, camera: Camera) -> FloatArray:
    """Offset of the method's own road from its parabola at each sample, shape (n, 2, samples); 0 without a road."""
    y_px = _boundary_sample_heights_px(
        camera, np.where(np.isnan(fits.pitch_rad), camera.mounting.pitch_rad, fits.pitch_rad)
    )
    h = (camera.height_px - y_px - camera.horizon_row_px(fits.pitch_rad)[:, None])[:, None]
    far, near, bend = np.moveaxis(fits.roads[..., :3, None], 2, 0)  # the spiral is added on the ground
    with np.errstate(invalid="ignore"):
        x_px = far + near * h + bend / np.where(h > 0.0, h, np.nan)
    return np.asarray(np.nan_to_num(x_px - _parabola_columns_px(fits.parabolas, y_px)))


def _ground_place_slope_curvature_and_used_samples(
    parabolas: FloatArray,
    pitch_yaw_height: FloatArray,
    camera: Camera,
    road_minus_parabola_px: FloatArray,
    is_sample_used: BoolArray | None = None,
) -> tuple[FloatArray, BoolArray]:
    """Place, slope and curvature of each boundary on the ground, shape (n, 2, 3), and the samples that were used.

    Args:
        parabolas: Shape (n, 2, 3): a, b, c.
        pitch_yaw_height: Shape (n, 3): pitch, yaw, height.
        road_minus_parabola_px: Shape (n, 2, samples): offset of the road from the parabolas.
        is_sample_used: Shape (n, 2, samples): the samples to use; None: those in the image and at a fair distance.
    """
    n = len(parabolas)
    y_px = _boundary_sample_heights_px(camera, pitch_yaw_height[:, 0])
    x_px = _parabola_columns_px(parabolas, y_px) + road_minus_parabola_px
    v_px = np.broadcast_to(camera.height_px - y_px[:, None], x_px.shape)
    is_there = np.isfinite(x_px)
    rays = camera.viewing_rays_from_image(np.where(is_there, x_px - 1.0, 0.0).ravel(), v_px.ravel()).reshape(
        n, 2, N_BOUNDARY_SAMPLES, 3
    )
    turns = _body_from_optical_rotations(pitch_yaw_height[:, :2], camera)
    forward, left, up = (
        turns[:, i, 0, None, None] * rays[..., 0]
        + turns[:, i, 1, None, None] * rays[..., 1]
        + turns[:, i, 2, None, None] * rays[..., 2]
        for i in range(3)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(up < 0.0, -pitch_yaw_height[:, 2, None, None] / up, np.nan)
    x_m = scale * forward
    y_m = scale * left + camera.mounting.lateral_offset_m
    if is_sample_used is None:
        is_sample_used = (
            is_there
            & _usable_sample_mask(x_px, is_there, camera)
            & (x_m > MIN_SAMPLE_DISTANCE_M)
            & (x_m < 2.0 * MAX_SAMPLE_DISTANCE_M)
        )
    return _fit_roads_on_ground(x_m, y_m, y_px / camera.height_px, is_sample_used), is_sample_used


def _boundary_sample_heights_px(camera: Camera, pitch_rad: FloatArray) -> FloatArray:
    """Heights in the image at which boundaries are sampled, shape (n, samples)."""
    return (
        0.5
        + (np.arange(N_BOUNDARY_SAMPLES) + 0.5)
        / N_BOUNDARY_SAMPLES
        * _height_of_highest_sample_px(camera, pitch_rad)[:, None]
    )


def _parabola_columns_px(parabolas: FloatArray, y_px: FloatArray) -> FloatArray:
    """Columns x of the parabolas (n, 2, 3) at heights (n, k), shape (n, 2, k)."""
    return (parabolas[..., :1] * y_px[:, None] + parabolas[..., 1:2]) * y_px[:, None] + parabolas[..., 2:]


def _usable_sample_mask(x_px: FloatArray, is_there: BoolArray, camera: Camera) -> BoolArray:
    """Mask of the usable samples: those in the image; where hardly any of a boundary are, also those outside."""
    in_image = is_there & (x_px >= 1.0) & (x_px <= camera.width_px)
    return np.asarray(in_image | (in_image.sum(axis=-1, keepdims=True) < MIN_FIT_SAMPLES))


def _body_from_optical_rotations(pitch_and_yaw: FloatArray, camera: Camera) -> FloatArray:
    """Rotations from the optical to the body frame for each pitch and yaw, shape (n, 3, 3)."""
    mounting = camera.mounting
    old = rotation_from_yaw_pitch_roll(mounting.yaw_rad, mounting.pitch_rad, mounting.roll_rad)
    axes = rotation_from_yaw_pitch_roll(0.0, 0.0, mounting.roll_rad) @ old.T @ camera.body_from_optical_rotation()
    cosine, sine = np.cos(pitch_and_yaw)[..., None], np.sin(pitch_and_yaw)[..., None]
    ahead = cosine[:, 0] * axes[0] + sine[:, 0] * axes[2]
    rotations = np.empty((len(pitch_and_yaw), 3, 3))
    rotations[:, 0] = cosine[:, 1] * ahead - sine[:, 1] * axes[1]
    rotations[:, 1] = sine[:, 1] * ahead + cosine[:, 1] * axes[1]
    rotations[:, 2] = cosine[:, 0] * axes[2] - sine[:, 0] * axes[0]
    return rotations


def _fit_roads_on_ground(x_m: FloatArray, y_m: FloatArray, height: FloatArray, is_sample_used: BoolArray) -> FloatArray:
    """Place, slope and curvature of the road whose best parabola goes through the points, shape (n, 2, 3); NaN with too
    few samples.

    Args:
        x_m, y_m: Shape (n, 2, k): points of the parabola on the ground.
        height: Shape (n, k): of the points in the image, in any unit.
        is_sample_used: Shape (n, 2, k).
    """
    x = np.where(is_sample_used, x_m, 1.0) / MAX_SAMPLE_DISTANCE_M
    weight = np.where(is_sample_used, 1.0 / x**2, 0.0)
    height = height[:, None]
    part = weight * x  # a pixel is as many metres sideways as the point is far
    y = np.where(is_sample_used, y_m, 0.0)
    normal, right = np.empty((*x.shape[:2], 3, 3)), np.empty((*x.shape[:2], 3))
    for i in range(3):
        normal[..., i, 0] = part.sum(axis=-1)
        normal[..., i, 1] = (part * x).sum(axis=-1)
        normal[..., i, 2] = (0.5 * part * x**2).sum(axis=-1)
        right[..., i] = (part * y).sum(axis=-1)
        part = part * height
    return np.asarray(
        _solve_normal_equations_or_nan(normal, right, is_sample_used)
        / np.array([1.0, MAX_SAMPLE_DISTANCE_M, MAX_SAMPLE_DISTANCE_M**2])
    )


def _solve_normal_equations_or_nan(
    normal_matrices: FloatArray, right_sides: FloatArray, is_sample_used: BoolArray
) -> FloatArray:
    """Solutions of the normal equations, shape (n, 2, 3); NaN where too few samples are used."""
    enough = is_sample_used.sum(axis=-1, keepdims=True) >= MIN_FIT_SAMPLES
    normal_matrices = np.where(enough[..., None], normal_matrices, np.eye(3))
    return np.asarray(np.where(enough, np.linalg.solve(normal_matrices, right_sides[..., None])[..., 0], np.nan))


def _lateral_heading_deviation_and_curvature_at_preview(
    left_and_right_arcs: FloatArray, change_1pm2: FloatArray, is_curve: BoolArray, preview_m: float
) -> FloatArray:
    """Lateral deviation, heading deviation and curvature at the preview point, shape (n, 3), of the curve or else of
    the parabola."""
    centre, only = (
        left_and_right_arcs.mean(axis=1),
        np.where(np.isnan(left_and_right_arcs[:, 0]), left_and_right_arcs[:, 1], left_and_right_arcs[:, 0]),
    )
    is_alone = np.isnan(centre).any(axis=1)
    either = np.where(is_alone[:, None], only, centre)
    slope = either[:, 1] + either[:, 2] * preview_m
    lateral = either[:, 0] + (either[:, 1] + 0.5 * either[:, 2] * preview_m) * preview_m
    parabola = np.column_stack([lateral, np.arctan(slope), either[:, 2] / (1.0 + slope**2) ** 1.5])
    parabola[is_alone, 0] = np.nan
    return -np.where(
        is_curve[:, None],
        y_direction_curvature_of_lane_centres_at_distance(
            left_and_right_arcs, np.full(len(left_and_right_arcs), preview_m), change_1pm2
        ),
        parabola,
    )


def _lane_width_10_m_ahead_m(
    left_and_right_arcs: FloatArray, change_1pm2: FloatArray, is_curve: BoolArray
) -> FloatArray:
    """Lane width 10 m ahead, square to the lane; beside the camera where a boundary has turned back; shape (n,)."""
    y_m = (
        left_and_right_arcs[..., 0]
        + (left_and_right_arcs[..., 1] + 0.5 * left_and_right_arcs[..., 2] * LANE_WIDTH_DISTANCE_AHEAD_M)
        * LANE_WIDTH_DISTANCE_AHEAD_M
    )
    slope = (left_and_right_arcs[..., 1] + left_and_right_arcs[..., 2] * LANE_WIDTH_DISTANCE_AHEAD_M).mean(axis=1)
    curves_m = lateral_positions_of_arcs_m(
        left_and_right_arcs, np.array(LANE_WIDTH_DISTANCE_AHEAD_M), change_1pm2[:, None]
    )
    direction = y_direction_curvature_of_lane_centres_at_distance(
        left_and_right_arcs, np.full(len(left_and_right_arcs), LANE_WIDTH_DISTANCE_AHEAD_M), change_1pm2
    )[:, 1]
    has_turned = is_curve & np.isnan(curves_m).any(axis=1)
    y_m = np.where(is_curve[:, None], np.where(has_turned[:, None], left_and_right_arcs[..., 0], curves_m), y_m)
    slope = np.where(is_curve, np.where(has_turned, left_and_right_arcs[..., 1].mean(axis=1), np.tan(direction)), slope)
    return np.asarray((y_m[:, 0] - y_m[:, 1]) / np.sqrt(1.0 + slope**2))
