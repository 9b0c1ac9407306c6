"""Roads of known shape, projected and fitted as a search fits them, come back from the ground geometry."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cwcli.signals.columns import FloatArray
from cwcli.signals.lane_geometry import lateral_positions_of_arcs_m
from cwcli.vision.boundary import BOUNDARY_NOT_FOUND, Boundary
from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.ground import MAX_SAMPLE_DISTANCE_M, GeometrySigmas, compute_lane_geometry
from cwcli.vision.lane_model import (
    bend_px2_per_curvature,
    boundary_columns_in_rows_px,
    boundary_road_curves,
    fit_boundary_parabolas,
    pinhole_of_camera,
    spiral_px3_per_curvature_change,
)
from cwcli.vision.method import LaneFit
from tests.unit.vision.fit_lists import columns_of

PREVIEW_M = 33.5
MOUNTING = Mounting(height_m=1.4, pitch_rad=0.03)
CAMERA = Camera(640, 480, 600.0, 600.0, 319.5, 239.5, mounting=MOUNTING).with_image_size(320, 240)
LEVEL = replace(CAMERA, mounting=Mounting(height_m=1.3))


def seen(camera: Camera, y0_m: float, slope: float, curvature_1pm: float) -> Boundary:
    """The best parabola, over the rows, of the road y = y0 + slope x + curvature x^2 / 2."""
    x_m = np.geomspace(2.0, MAX_SAMPLE_DISTANCE_M, 4000)
    u, v = camera.image_points_from_ground(x_m, y0_m + slope * x_m + 0.5 * curvature_1pm * x_m**2)
    order = np.argsort(camera.height_px - v)
    y_px = np.arange(1.0, (camera.height_px - v).max())
    x_px = np.interp(y_px, (camera.height_px - v)[order], (u + 1.0)[order])
    inside = (x_px >= 1.0) & (x_px <= camera.width_px)
    a, b, c = np.polyfit(y_px[inside], x_px[inside], 2)
    return Boundary(float(a), float(b), float(c), 50.0, 1.0, True)


def lane(camera: Camera, centre_m: float, slope: float, curvature_1pm: float, width_m: float = 3.5) -> LaneFit:
    return LaneFit(
        seen(camera, centre_m + width_m / 2, slope, curvature_1pm),
        seen(camera, centre_m - width_m / 2, slope, curvature_1pm),
    )


@pytest.mark.parametrize("slope", [0.0, 0.03, -0.02])
@pytest.mark.parametrize("centre_m", [0.0, 0.4, -0.7])
def test_straight_road_by_hand(slope: float, centre_m: float) -> None:
    geometry = compute_lane_geometry(columns_of([lane(CAMERA, centre_m, slope, 0.0)]), CAMERA, preview_m=PREVIEW_M)
    assert geometry.lateral_deviation_m[0] == pytest.approx(-(centre_m + slope * PREVIEW_M), abs=1e-3)
    assert geometry.heading_deviation_rad[0] == pytest.approx(-math.atan(slope), abs=1e-5)
    assert geometry.curvature_1pm[0] == pytest.approx(0.0, abs=1e-6)
    assert geometry.lane_width_m[0] == pytest.approx(3.5 * math.cos(math.atan(slope)), abs=1e-3)


@pytest.mark.parametrize("curvature_1pm", [0.001, -0.002, 0.003])
def test_bend_comes_back_within_a_tenth(curvature_1pm: float) -> None:
    geometry = compute_lane_geometry(columns_of([lane(CAMERA, 0.1, 0.0, curvature_1pm)]), CAMERA, preview_m=PREVIEW_M)
    slope = curvature_1pm * PREVIEW_M
    y_l = -(0.1 + 0.5 * curvature_1pm * PREVIEW_M**2)
    assert geometry.curvature_1pm[0] == pytest.approx(-curvature_1pm, rel=0.1)
    assert geometry.heading_deviation_rad[0] == pytest.approx(-slope, rel=0.1)
    assert geometry.lateral_deviation_m[0] == pytest.approx(y_l, rel=0.1)


def curved(
    curvature_1pm: float, change_1pm2: float, heading_rad: float, *, width_m: float = 3.6
) -> tuple[LaneFit, FloatArray]:
    """A lane whose method tells its curves, right positive, and shape (6,) as `lane_model` has it."""
    camera = LEVEL
    cosine = math.cos(heading_rad)
    bend, spiral = curvature_1pm * bend_px2_per_curvature(camera), change_1pm2 * spiral_px3_per_curvature_change(camera)
    u0 = camera.cx + camera.fx * math.tan(heading_rad)
    horizon = float(camera.horizon_row_px())
    lane = np.array([u0, 0.0, width_m / 1.3, bend / cosine**3, horizon, spiral / cosine**3])
    left, right = (Boundary(a, b, c, 1.0, 0.9, True) for a, b, c in fit_boundary_parabolas(lane, camera).tolist())
    return LaneFit(left, right, pitch_rad=0.0, roads=boundary_road_curves(lane, pinhole_of_camera(camera))), lane


@pytest.mark.parametrize("preview_m", [10.0, 15.0, 20.0])
def test_preview_in_a_tight_bend_is_on_the_circle(preview_m: float) -> None:
    # 23 m to the right: y = R - sqrt(R^2 - D^2) to the right, the lane's direction there is asin(D / R) to the right.
    fit, _ = curved(1.0 / 23.0, 0.0, 0.0)
    alone = replace(fit, right=BOUNDARY_NOT_FOUND)
    made = compute_lane_geometry(columns_of([fit, alone]), LEVEL, preview_m=preview_m)
    assert made.lateral_deviation_m[0] == pytest.approx(23.0 - math.sqrt(23.0**2 - preview_m**2), rel=1e-3)
    assert made.heading_deviation_rad[0] == pytest.approx(math.asin(preview_m / 23.0), rel=1e-3)
    assert made.curvature_1pm[0] == pytest.approx(1.0 / 23.0, rel=1e-3)
    # the left boundary alone is 1.8 m farther out, and gives no place
    assert made.curvature_1pm[1] == pytest.approx(1.0 / 24.8, rel=1e-3)
    assert np.isnan(made.lateral_deviation_m).tolist() == [False, True]
    assert np.isfinite(made.heading_deviation_sigma_rad).all()


def test_preview_beyond_the_end_of_a_bend_is_not_known() -> None:
    fit, _ = curved(1.0 / 23.0, 0.0, 0.0)
    made = compute_lane_geometry(columns_of([fit]), LEVEL, preview_m=23.0)
    for values in (made.lateral_deviation_m, made.heading_deviation_rad, made.curvature_1pm, made.curvature_sigma_1pm):
        assert np.isnan(values).all()
    assert np.isfinite(made.left_body).all()


def test_the_width_of_a_tight_bend_is_that_between_the_circles() -> None:
    # 10 m ahead a bend of 23 m has turned by 26 degrees; one of 8 m has turned back: there it is that beside the camera
    fits = [curved(1.0 / radius_m, 0.0, 0.0)[0] for radius_m in (23.0, 8.0)]
    made = compute_lane_geometry(columns_of(fits), LEVEL, preview_m=15.0)
    np.testing.assert_allclose(made.lane_width_m, 3.6, atol=0.03)


def test_sigma_of_the_height_in_a_tight_bend() -> None:
    # Of an error of the camera's height alone: a place y at x is in truth y (1 + e) at x (1 + e), so the bend is
    # 23 (1 + e) m, and y_L at D is 23 (1 + e) - sqrt(23^2 (1 + e)^2 - D^2).
    fit, _ = curved(1.0 / 23.0, 0.0, 0.0)
    sure = [replace(side, covariance=1e-18 * np.eye(3)) for side in (fit.left, fit.right)]
    sigmas = GeometrySigmas(pitch_rad=0.0, yaw_rad=0.0, height_m=0.013)
    made = compute_lane_geometry(
        columns_of([replace(fit, left=sure[0], right=sure[1])]), LEVEL, preview_m=15.0, sigmas=sigmas
    )
    slope_m = 23.0 - 23.0**2 / math.sqrt(23.0**2 - 15.0**2)
    assert made.lateral_deviation_sigma_m[0] == pytest.approx(0.01 * abs(slope_m), rel=0.01)
    assert made.curvature_sigma_1pm[0] == pytest.approx(0.01 / 23.0, rel=0.01)


@pytest.mark.parametrize(
    ("curvature_1pm", "change_1pm2"), [(0.02, 0.0017), (0.0, 0.0017), (0.03, -0.001), (-0.02, -0.0017)]
)
def test_the_published_line_is_the_drawn_one(curvature_1pm: float, change_1pm2: float) -> None:
    fit, lane = curved(curvature_1pm, change_1pm2, 0.03)
    made = compute_lane_geometry(columns_of([fit]), LEVEL, preview_m=10.0)
    assert made.curvature_change_1pm2[0] == pytest.approx(change_1pm2 / math.cos(0.03) ** 3, rel=1e-4)
    x_m = np.array([5.0, 10.0, 15.0, 20.0])
    columns = boundary_columns_in_rows_px(lane, lane[4] + LEVEL.fy * 1.3 / x_m, pinhole_of_camera(LEVEL))
    for k, body in enumerate((made.left_body, made.right_body)):
        published_m = lateral_positions_of_arcs_m(body[0], x_m, -made.curvature_change_1pm2[0])
        np.testing.assert_allclose(published_m, -(columns[k] - LEVEL.cx) / LEVEL.fx * x_m, atol=0.005)


def test_signs_are_the_papers() -> None:
    # A road that bends to the right, seen from a car that points to its left and drives left of the lane's centre.
    geometry = compute_lane_geometry(columns_of([lane(CAMERA, -0.5, -0.02, -0.001)]), CAMERA, preview_m=PREVIEW_M)
    assert geometry.lateral_deviation_m[0] > 0.0
    assert geometry.heading_deviation_rad[0] > 0.0
    assert geometry.curvature_1pm[0] > 0.0
    assert geometry.left_body[0, 0] > 0.0 > geometry.right_body[0, 0]


def test_pitch_and_yaw_of_a_fit_replace_the_mountings() -> None:
    turned = CAMERA.with_pitch_and_yaw(pitch_rad=0.05, yaw_rad=0.01)
    fit = lane(turned, 0.2, 0.01, 0.0)
    told = compute_lane_geometry(columns_of([replace(fit, pitch_rad=0.05, yaw_rad=0.01)]), CAMERA, preview_m=PREVIEW_M)
    known = compute_lane_geometry(columns_of([fit]), turned, preview_m=PREVIEW_M)
    np.testing.assert_allclose(told.left_body, known.left_body, rtol=1e-9)
    assert told.lateral_deviation_m[0] == pytest.approx(-(0.2 + 0.01 * PREVIEW_M), abs=2e-3)


def test_distorted_camera_gives_the_same_road() -> None:
    bent = replace(CAMERA, distortion_model="plumb_bob", distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))
    geometry = compute_lane_geometry(columns_of([lane(bent, 0.0, 0.0, 0.0)]), bent, preview_m=PREVIEW_M)
    assert geometry.lateral_deviation_m[0] == pytest.approx(0.0, abs=0.02)
    assert geometry.lane_width_m[0] == pytest.approx(3.5, abs=0.1)


def test_one_boundary_gives_direction_but_no_place() -> None:
    fit = lane(CAMERA, 0.0, 0.02, 0.0)
    alone = LaneFit(fit.left, BOUNDARY_NOT_FOUND)
    geometry = compute_lane_geometry(
        columns_of([alone, LaneFit(BOUNDARY_NOT_FOUND, BOUNDARY_NOT_FOUND)]), CAMERA, preview_m=PREVIEW_M
    )
    assert np.isnan(geometry.lateral_deviation_m[0])
    assert np.isnan(geometry.lateral_deviation_sigma_m[0])
    assert geometry.heading_deviation_rad[0] == pytest.approx(-0.02, abs=1e-4)
    assert np.isfinite(geometry.heading_deviation_sigma_rad[0])
    assert np.isnan(geometry.lane_width_m[0])
    assert np.isnan(geometry.heading_deviation_rad[1])


def test_sigmas_are_those_of_a_monte_carlo_run() -> None:
    rng = np.random.default_rng(8)
    sigmas = GeometrySigmas(pitch_rad=0.003, yaw_rad=0.002, height_m=0.02)
    covariance = np.diag([3e-5, 4e-3, 0.4]) ** 2
    fit = lane(CAMERA, 0.3, 0.0, 0.0005)
    exact = LaneFit(replace(fit.left, covariance=covariance), replace(fit.right, covariance=covariance))
    told = compute_lane_geometry(columns_of([exact]), CAMERA, preview_m=PREVIEW_M, sigmas=sigmas)
    drawn = []
    for _ in range(600):
        left, right = [
            replace(side, a=side.a + d[0], b=side.b + d[1], c=side.c + d[2])
            for side, d in zip((fit.left, fit.right), rng.multivariate_normal(np.zeros(3), covariance, 2), strict=True)
        ]
        mounting = replace(
            MOUNTING,
            pitch_rad=MOUNTING.pitch_rad + rng.normal(0, sigmas.pitch_rad),
            yaw_rad=rng.normal(0, sigmas.yaw_rad),
            height_m=MOUNTING.height_m + rng.normal(0, sigmas.height_m),
        )
        made = compute_lane_geometry(
            columns_of([LaneFit(left, right)]), replace(CAMERA, mounting=mounting), preview_m=PREVIEW_M
        )
        drawn.append((made.lateral_deviation_m[0], made.heading_deviation_rad[0], made.curvature_1pm[0]))
    spread = np.std(drawn, axis=0)
    expected = (told.lateral_deviation_sigma_m[0], told.heading_deviation_sigma_rad[0], told.curvature_sigma_1pm[0])
    np.testing.assert_allclose(expected, spread, rtol=0.15)


def test_sigmas_do_not_jump_where_a_sample_leaves_the_image() -> None:
    # The boundary moves sideways in steps of 0.02 pixels, less than the steps of the finite differences.
    camera = replace(CAMERA, mounting=Mounting(height_m=1.3, pitch_rad=0.02))
    fits = [
        LaneFit(
            Boundary(0.001, 1.2, -30.0 + shift, 1.0, 0.9, True), Boundary(0.001, -1.2, 350.0 - shift, 1.0, 0.9, True)
        )
        for shift in np.arange(0.0, 30.0, 0.02)
    ]
    made = compute_lane_geometry(columns_of(fits), camera, preview_m=33.5)
    for sigma in (made.lateral_deviation_sigma_m, made.heading_deviation_sigma_rad, made.curvature_sigma_1pm):
        assert sigma.max() < 1.5 * np.median(sigma)


def test_no_frames_give_no_rows() -> None:
    assert len(compute_lane_geometry(columns_of([]), CAMERA, preview_m=PREVIEW_M).lane_width_m) == 0
