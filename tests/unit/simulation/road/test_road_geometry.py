"""The road's geometry and truth: closed forms, fine integration, and the camera model of the vision room."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cwcli.errors import UsageError
from cwcli.simulation.road.camera import PAPER_PREVIEW_M, RoadCamera, camera_of_zhang2011, wide_camera
from cwcli.simulation.road.geometry import ARC_LENGTH_GRID_M, RoadAhead
from cwcli.simulation.road.truth import MAX_VISIBLE_BOUNDARY_DISTANCE_M, compute_lane_truth
from cwcli.vision.camera import Camera, Mounting
from tests.set_frames import clothoid_curvature_1pm

ATOL_PX = 0.02
ATOL_M = 1e-3
CAMERA = camera_of_zhang2011()
ROWS = np.arange(240.0)


def straight(offset_m: float = 0.0, heading_rad: float = 0.0, **more: float) -> RoadAhead:
    return RoadAhead(clothoid_curvature_1pm(0.0), offset_m, heading_rad, **more)


def test_paper_camera_sees_the_preview_point_on_its_axis_and_the_road_on_two_thirds() -> None:
    x_m = straight().distance_of_rows_m(CAMERA, np.array([CAMERA.cy]))
    assert x_m[0] == pytest.approx(PAPER_PREVIEW_M, abs=1e-9)
    horizon_v = CAMERA.cy - CAMERA.fy * math.tan(CAMERA.pitch_rad)
    assert 240 - horizon_v == pytest.approx(160, abs=0.5)


def test_paper_camera_puts_boundaries_into_the_papers_first_search_regions() -> None:
    for width_m in (3.25, 3.5, 3.75, 3.9):
        for offset_m in (-0.5, 0.0, 0.5):
            truth = compute_lane_truth(CAMERA, straight(offset_m), width_m, (0.15, 0.15), "clear")
            (a, b, c), (a2, b2, c2) = truth.fit_boundary_parabola_px("left"), truth.fit_boundary_parabola_px("right")
            assert abs(a) < 0.005
            assert 0.3 < b < 2.3
            assert -100 < c < 150
            assert abs(a2) < 0.005
            assert -2.3 < b2 < -0.3
            assert 200 < c2 < 450


def test_straight_flat_road_by_hand() -> None:
    # A level camera 1.5 m high with f = 300: row cy + 30 shows 15 m; a line 1.75 m to the left lies 35 px left of cx.
    camera = replace(CAMERA, fx=300.0, fy=300.0, height_m=1.5, pitch_rad=0.0)
    road = straight()
    x_m = road.distance_of_rows_m(camera, np.array([camera.cy + 30.0, camera.cy - 1.0]))
    assert x_m[0] == pytest.approx(15.0)
    assert math.isnan(x_m[1])
    assert road.line_column_at_distance_px(camera, 1.75, np.array([15.0]))[0] == pytest.approx(camera.cx - 35.0)


def test_offset_and_heading_move_the_lane_the_right_way() -> None:
    # The car 0.3 m left of the centre, pointing 0.01 rad to the left: the lane lies and runs off to the right.
    road = straight(0.3, 0.01)
    np.testing.assert_allclose(
        road.line_y_at_distance_m(0.0, np.array([0.0, 30.0])), [-0.3, -0.3 - 30 * math.tan(0.01)], atol=4e-5
    )


def test_curve_is_a_circle() -> None:
    # Left, radius 500 m: the centre of the circle is (0, 500), lines beside it have the radius 500 - offset.
    road = RoadAhead(clothoid_curvature_1pm(0.002), 0.0, 0.0)
    for offset_m in (-1.8, 0.0, 1.8):
        x, y = road.line_at_offset_m(offset_m)
        np.testing.assert_allclose(np.hypot(x, y - 500.0), 500.0 - offset_m, atol=1e-9)


def test_clothoid_against_fine_integration() -> None:
    road = RoadAhead(clothoid_curvature_1pm(0.001, 1e-5), 0.4, -0.02)
    made = solve_ivp(
        lambda s, q: [math.cos(q[2]), math.sin(q[2]), 0.001 + 1e-5 * s],
        (0.0, 120.0),
        [0.4 * math.sin(0.02), -0.4 * math.cos(0.02), 0.02],
        t_eval=[30.0, 60.0, 120.0],
        rtol=1e-10,
        atol=1e-10,
    )
    x, y = road.centre_line_m
    at = np.searchsorted(ARC_LENGTH_GRID_M, made.t)
    np.testing.assert_allclose(x[at], made.y[0], atol=ATOL_M)
    np.testing.assert_allclose(y[at], made.y[1], atol=ATOL_M)


@pytest.mark.parametrize("vertical_1pm", [-3e-4, 0.0, 3e-4])
def test_rows_and_distances_agree_over_crest_and_sag(vertical_1pm: float) -> None:
    road = straight(vertical_1pm=vertical_1pm)
    x_m = road.distance_of_rows_m(CAMERA, ROWS)
    seen = np.isfinite(x_m)
    _, v = CAMERA.project_to_image_px(x_m[seen], np.zeros(seen.sum()), road.surface_height_at_distance_m(x_m[seen]))
    np.testing.assert_allclose(v, ROWS[seen], atol=1e-8)
    assert (np.diff(x_m[seen]) < 0).all()


def test_crest_hides_what_is_beyond_it() -> None:
    # The ray that grazes the crest touches it at x = sqrt(2 h / g) = 90.8 m (m^2 = 2 g h).
    x_m = straight(vertical_1pm=-4e-4).distance_of_rows_m(CAMERA, np.arange(80.0, 140.0, 0.001))
    assert np.nanmax(x_m) == pytest.approx(math.sqrt(2 * CAMERA.height_m / 4e-4), rel=0.01)


@pytest.mark.parametrize(
    "camera", [camera_of_zhang2011(), camera_of_zhang2011(640, 480), wide_camera()], ids=["320", "640", "wide"]
)
def test_truth_agrees_with_the_vision_rooms_camera(camera: RoadCamera) -> None:
    made = camera  # the two rooms share no code
    mounting = Mounting(height_m=made.height_m, pitch_rad=made.pitch_rad)
    vision = Camera(made.width_px, made.height_px, made.fx, made.fy, made.cx, made.cy, mounting=mounting)
    road = RoadAhead(clothoid_curvature_1pm(-0.0012, 4e-6), 0.25, 0.008)
    truth = compute_lane_truth(made, road, 3.6, (0.15, 0.15), "clear")
    x_m = np.linspace(10.0, 60.0, 40)
    for side, columns in (("left", truth.left_u_px), ("right", truth.right_u_px)):
        u, v = vision.image_points_from_ground(x_m, truth.boundary_y_m(side, x_m))
        rows = np.arange(made.height_px)
        known = np.isfinite(columns)
        # Between rows the column is smooth: cubic neighbours are not needed where rows are dense.
        np.testing.assert_allclose(np.interp(v, rows[known], columns[known]), u, atol=0.5)
        ground_x, ground_y = vision.ground_points_from_image(columns[known], rows[known].astype(float))
        np.testing.assert_allclose(ground_x, truth.x_m[known], rtol=1e-6)
        near = ground_x < MAX_VISIBLE_BOUNDARY_DISTANCE_M
        np.testing.assert_allclose(ground_y[near], truth.boundary_y_m(side, ground_x[near]), atol=1e-6)


def test_preview_of_a_circle_by_hand() -> None:
    # Right bend of 500 m seen from the lane's centre: y = -(500 - sqrt(500^2 - x^2)), direction -asin(x / 500).
    truth = compute_lane_truth(CAMERA, RoadAhead(clothoid_curvature_1pm(-0.002), 0.0, 0.0), 3.6, (0.15, 0.15), "clear")
    y_m, direction, curvature = truth.lane_centre_at_preview(33.5)
    assert y_m == pytest.approx(-(500 - math.sqrt(500**2 - 33.5**2)), abs=ATOL_M)
    assert direction == pytest.approx(-math.asin(33.5 / 500), abs=1e-5)
    assert curvature == pytest.approx(-0.002)


def test_a_lane_that_turns_back_has_no_place_beyond() -> None:
    # Left bend of 23 m: at 20 m it has turned by asin(20 / 23) = 60.4 degrees; 33.5 m ahead there is none of it.
    truth = compute_lane_truth(
        CAMERA, RoadAhead(clothoid_curvature_1pm(1.0 / 23.0), 0.0, 0.0), 3.6, (0.15, 0.15), "clear"
    )
    assert np.isnan(truth.lane_centre_at_preview(33.5)).all()
    assert np.isfinite(truth.lane_centre_at_preview(20.0)).all()
    assert (
        np.isnan(truth.lane_centre_y_direction_curvature(np.array([5.0, 20.0, 22.9, 33.5]))).tolist()
        == [[False, False, True, True]] * 3
    )


def test_tusimple_form_marks_what_is_not_visible() -> None:
    truth = compute_lane_truth(CAMERA, straight(), 3.6, (0.15, 0.15), "clear")
    h_samples = np.array([50, 100, 150, 200, 239, 300])
    left, right = truth.tusimple_lane_columns(h_samples)
    assert left[0] == right[0] == -2  # the sky
    assert left[-1] == right[-1] == -2  # below the image
    assert left[2] == round(float(truth.left_u_px[150]))
    assert right[3] == round(float(truth.right_u_px[200]))


def test_hidden_pixels_are_not_visible() -> None:
    occluded = np.zeros((240, 320), bool)
    occluded[120:140] = True
    free = compute_lane_truth(CAMERA, straight(), 3.6, (0.15, 0.15), "clear")
    truth = compute_lane_truth(CAMERA, straight(), 3.6, (0.15, 0.15), "clear", occluded)
    assert free.left_visible[120:140].all()
    assert not truth.left_visible[120:140].any()
    assert (truth.left_visible[140:] == free.left_visible[140:]).all()


def test_sizes_that_cannot_be_rendered_are_refused() -> None:
    for size in ((10, 10), (20000, 240)):
        with pytest.raises(UsageError, match="can't be rendered"):
            camera_of_zhang2011(*size)
