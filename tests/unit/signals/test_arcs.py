"""Circles in the image: by hand, concentric, against the renderer's truth, and how they differ from parabolas."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cwcli.signals.lane_geometry import (
    MAX_SINE_OF_DRAWN_LINE_DIRECTION,
    Pinhole,
    curvature_change_ratios_to_centre_line,
    distance_ahead_to_direction_sine_m,
    image_columns_of_arcs,
    lateral_positions_of_arcs_m,
    middle_line_of_parallel_arcs,
    y_direction_curvature_of_lane_centres_at_distance,
)
from cwcli.simulation.road.camera import wide_camera
from cwcli.simulation.road.geometry import ARC_LENGTH_GRID_M, RoadAhead
from cwcli.simulation.road.truth import compute_lane_truth
from cwcli.vision.lane_model import boundary_columns_in_rows_px

NOWHERE = np.array(math.nan)
ATOL_PX = 1.5
"""Of 480: the camera looks down a little, and is not quite above the point in which its rows begin."""


def test_a_circle_by_hand() -> None:
    # Radius 25 m to the left, tangent to the car's axis 2 m beside it: y = 2 + 25 - sqrt(25^2 - x^2); 7, 15, 20 and 24
    # are sides of right triangles with a hypotenuse of 25.
    places_m = lateral_positions_of_arcs_m(
        np.array([2.0, 0.0, 1.0 / 25.0]), np.array([7.0, 15.0, 20.0, 24.0, 24.5, 30.0])
    )
    np.testing.assert_allclose(places_m[:4], [3.0, 7.0, 12.0, 20.0])
    assert np.isnan(places_m[4:]).all()  # past 0.97 of the radius it is about to turn back
    # the other way round, pointed 3 in 4 aside: sin 0.6, so it begins 15 m before its top, which is 5 m farther out
    inward = np.array([0.0, 0.75, -1.0 / 25.0 * 1.25**3])
    np.testing.assert_allclose(lateral_positions_of_arcs_m(inward, np.array([15.0, 30.0])), [5.0, 0.0], atol=1e-9)


def test_columns_of_a_circle_by_hand() -> None:
    # 500 px of focal length, camera 1.2 m high: 600 / h metres ahead in row h. The circle above is 7 m to the left at
    # 15 m (h = 40): 500 * 7 / 15 columns. near = -2 / 1.2, bend = -500 * 500 * 1.2 / 25 / 2.
    road = np.array([319.5, -2.0 / 1.2, -6000.0, 0.0])
    centre, focal = np.array(319.5), np.array(500.0)
    h = np.array([40.0, 30.0, 24.0, 0.0])
    made = image_columns_of_arcs(road, h, centre, focal)
    np.testing.assert_allclose(made[:2], [319.5 - 500.0 * 7.0 / 15.0, 319.5 - 500.0 * 12.0 / 20.0])
    assert np.isnan(made[2:]).all()
    touching = image_columns_of_arcs(road, h, NOWHERE, NOWHERE)
    np.testing.assert_allclose(touching[:1], 319.5 - 2.0 / 1.2 * 40.0 - 6000.0 / 40.0)


@pytest.mark.parametrize("radius_m", [23.0, -40.0, 400.0])
@pytest.mark.parametrize("heading_rad", [0.0, 0.06, -0.06])
def test_both_boundaries_are_those_that_the_renderer_draws(radius_m: float, heading_rad: float) -> None:
    drawn = wide_camera(480, 270)
    road = RoadAhead(np.full(len(ARC_LENGTH_GRID_M), 1.0 / radius_m), offset_m=0.4, heading_rad=heading_rad)
    truth = compute_lane_truth(drawn, road, 3.6, (0.15, 0.15), "")
    rows_px = np.arange(270.0)
    horizon_px = drawn.cy - drawn.fy * math.tan(drawn.pitch_rad)
    # the circle through the camera's foot: the lane's direction there is -heading, its middle 0.4 m to the right
    curvature = -1.0 / (radius_m - 0.4) * math.cos(heading_rad) ** -3
    bend = curvature * drawn.fx * drawn.fy * drawn.height_m / 2.0
    places = 0.4 / drawn.height_m, 3.6 / drawn.height_m
    lane = np.array([drawn.cx + drawn.fx * math.tan(heading_rad), *places, bend, horizon_px, 0.0])
    lane[1:3] *= drawn.fx / drawn.fy / math.cos(heading_rad)
    made = boundary_columns_in_rows_px(lane, rows_px, Pinhole(drawn.cx, drawn.fx, drawn.fx / drawn.fy))
    for columns, true_px, is_visible in (
        (made[0], truth.left_u_px, truth.left_visible),
        (made[1], truth.right_u_px, truth.right_visible),
    ):
        both = is_visible & np.isfinite(columns)
        assert both.sum() > 60
        assert np.abs(columns - true_px)[both].max() < ATOL_PX
    h = rows_px - horizon_px
    is_far = truth.right_visible & (h < 45.0)
    parabola = lane[0] + (lane[1] + 0.5 * lane[2]) * h[is_far] + lane[3] / h[is_far]
    off_px = np.abs(parabola - truth.right_u_px[is_far]).max()
    assert (off_px > 9.0) == (abs(radius_m) < 100.0)


@pytest.mark.parametrize("change_1pm2", [0.0018, -0.0018, 0.0006])
def test_a_spiral_is_the_integral_of_its_direction(change_1pm2: float) -> None:
    # sin phi = 0.1 + 0.02 x + change x^2 / 2 ahead, 1.5 m aside: a ramp's beginning, end or middle
    x_m = np.linspace(0.0, 16.0, 16001)
    sine = 0.1 + 0.02 * x_m + 0.5 * change_1pm2 * x_m**2
    end = int(np.argmax(np.abs(sine) >= MAX_SINE_OF_DRAWN_LINE_DIRECTION)) or len(x_m)
    slope = sine[:end] / np.sqrt(1.0 - sine[:end] ** 2)
    y_m = 1.5 + np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * 0.001)])
    start = 0.1 / math.sqrt(0.99)
    touching = np.array([1.5, start, 0.02 / 0.99**1.5])
    beside = change_1pm2 / 0.99**1.5 / curvature_change_ratios_to_centre_line(touching)
    places_m = lateral_positions_of_arcs_m(touching, x_m[1:], beside)
    is_there = np.isfinite(places_m)
    assert is_there.sum() == end - 1
    apart_m = np.abs(places_m[: end - 1] - y_m[1:])
    assert (apart_m < 0.005 * x_m[1:end]).all()  # 0.3 degrees: 2 px at a focal length of 400
    assert apart_m[: min(end, 12001) - 1].max() < 0.01


def test_parallel_spirals_by_hand() -> None:
    # Along the axis curvature and change are 0.02 and 0.0017; 3 m to the inside the radius is 47 m instead of 50 m.
    assert curvature_change_ratios_to_centre_line(np.array([3.0, 0.0, 1.0 / 47.0])) == pytest.approx((50.0 / 47.0) ** 3)
    # A line that points 3 in 5 aside beside one whose sine is 0.6 (1 - 0.02 * 3): cosines 0.8 and sqrt(1 - 0.564^2)
    turned = curvature_change_ratios_to_centre_line(np.array([3.0, 0.75, 1.0 / 47.0 / 0.8**3]))
    assert turned == pytest.approx((50.0 / 47.0 * math.sqrt(1.0 - 0.564**2) / 0.8) ** 3)
    # and the middle between that line and the one 3 m to the outside is the axis
    lines = np.array([[[3.0, 0.0, 1.0 / 47.0], [-3.0, 0.0, 1.0 / 53.0]]])
    np.testing.assert_allclose(middle_line_of_parallel_arcs(lines), [[0.0, 0.0, 0.02]], atol=1e-15)


def test_a_line_begins_beside_the_camera() -> None:
    places_m = lateral_positions_of_arcs_m(np.array([1.5, 0.1, 0.02]), np.array([0.0, -3.0, 1e-9]), 0.001)
    np.testing.assert_allclose(places_m, [1.5, math.nan, 1.5])


def test_a_line_ends_where_it_first_turns_back() -> None:
    # sin phi = 0.2 x - 0.009 x^2 comes to 0.97 at x = 7.15 m, is 1.1 at its highest, and comes back.
    places_m = lateral_positions_of_arcs_m(np.array([0.0, 0.0, 0.2]), np.array([7.1, 7.2, 11.0, 15.1, 20.0]), -0.018)
    assert np.isfinite(places_m).tolist() == [True, False, False, False, False]


def test_how_far_ahead_a_line_has_turned_by_hand() -> None:
    # on a circle of 50 m the sine is x / 50; 3 in 5 is more than 0.4 at once; sin = 0.0017 x^2 / 2; never
    lines = np.array([[1.0, 0.0, 0.02], [1.0, 0.75, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    turned_m = distance_ahead_to_direction_sine_m(lines, 0.4, np.array([0.0, 0.0, 0.0017, 0.0]))
    np.testing.assert_allclose(turned_m, [20.0, 0.0, math.sqrt(0.8 / 0.0017), math.inf])


def test_the_lane_ahead_is_between_both_lines_or_the_one_that_is_known() -> None:
    # circles of 48.2 and 51.8 m about (0, 50): the middle is 50 - sqrt(50^2 - 20^2) to the left at 20 m
    both = np.array([[1.8, 0.0, 1.0 / 48.2], [-1.8, 0.0, 1.0 / 51.8]])
    alone = np.where([[True], [False]], both, math.nan)
    made = y_direction_curvature_of_lane_centres_at_distance(np.stack([both, alone]), np.full(2, 20.0), np.zeros(2))
    np.testing.assert_allclose(made[0], [50.0 - math.sqrt(2100.0), math.asin(0.4), 0.02])
    np.testing.assert_allclose(made[1], [math.nan, math.asin(20.0 / 48.2), 1.0 / 48.2])


def test_a_gentle_bend_is_a_parabola() -> None:
    pinhole, lane = Pinhole(319.5, 500.0, 1.0), np.array([315.0, 0.1, 2.9, 150.0, 100.0, 900.0])
    h = np.linspace(11.0, 200.0, 50)
    parabola = 315.0 + np.array([[0.1 - 1.45], [0.1 + 1.45]]) * h + 150.0 / h + 900.0 / h**2
    np.testing.assert_allclose(boundary_columns_in_rows_px(lane, h + 100.0, pinhole), parabola, atol=0.15)
    assert MAX_SINE_OF_DRAWN_LINE_DIRECTION < 1.0
