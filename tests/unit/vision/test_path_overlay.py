"""Where a path on the road lies in the image: held against the ground plane, closed forms and the rendered road."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cwcli.signals.normal_distribution import SIGMAS_HOLDING_90_PERCENT
from cwcli.simulation.road.camera import wide_camera
from cwcli.simulation.road.geometry import RoadAhead
from cwcli.simulation.road.render import render_frame
from cwcli.simulation.road.scene import Marking, RoadScene
from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.path_overlay import (
    N_PATH_POINTS,
    PATH_LINE_NAMES,
    BodyPath,
    draw_path,
    nearest_visible_ground_m,
    project_path_into_image,
)
from tests.set_frames import clothoid_curvature_1pm

MOUNTING = Mounting(height_m=1.4, pitch_rad=0.03)
CAMERA = Camera(640, 480, 600.0, 600.0, 319.5, 239.5, mounting=MOUNTING)
ATOL_PX = 1e-6


def arc(curvature_1pm: float, length_m: float = 50.0, sigma_m: float = 0.0) -> BodyPath:
    """A path of constant curvature; the same standard deviation across it everywhere."""
    heading = np.linspace(0.0, curvature_1pm * length_m, 101)
    s = np.linspace(0.0, length_m, 101)
    x, y = (s, np.zeros_like(s)) if curvature_1pm == 0.0 else (np.sin(heading), 1.0 - np.cos(heading))
    scale = 1.0 if curvature_1pm == 0.0 else 1.0 / curvature_1pm
    across = np.column_stack([np.sin(heading) ** 2, -np.sin(heading) * np.cos(heading), np.cos(heading) ** 2])
    return BodyPath(x * scale, y * scale, heading, across * sigma_m**2)


def test_path_straight_ahead_is_the_column_of_the_principal_point_up_to_its_end() -> None:
    lines = project_path_into_image(arc(0.0), CAMERA, width_m=1.8)
    u, v = lines.visible_points_of_line("centre").T
    assert len(u) == N_PATH_POINTS
    np.testing.assert_allclose(u, 319.5, atol=ATOL_PX)
    assert (np.diff(v) < 0.0).all()
    # By hand: a point x ahead is 1.4 m below the camera; the ray falls by atan(1.4 / x), of which 0.03 is the pitch.
    np.testing.assert_allclose(v[-1], 239.5 + 600.0 * math.tan(math.atan(1.4 / 50.0) - 0.03), atol=ATOL_PX)
    np.testing.assert_allclose(v[0], 479.5, atol=ATOL_PX)
    assert np.ptp(np.diff(v)) < 0.25 * np.abs(np.diff(v)).mean(), "evenly spaced in the image"


def test_lines_lie_on_the_path_and_beside_it_on_the_ground() -> None:
    """Back through the camera's other direction: half a car, and 1.645 sigma, from a circle of radius 200 m."""
    camera = replace(CAMERA, mounting=replace(MOUNTING, yaw_rad=0.02, roll_rad=0.01, lateral_offset_m=0.2))
    lines = project_path_into_image(arc(1 / 200.0, sigma_m=0.5), camera, width_m=1.8, camera_forward_m=0.7)
    for name, beside_m in zip(
        PATH_LINE_NAMES,
        (0.0, 0.9, -0.9, SIGMAS_HOLDING_90_PERCENT * 0.5, -SIGMAS_HOLDING_90_PERCENT * 0.5),
        strict=True,
    ):
        x, y = camera.ground_points_from_image(*lines.visible_points_of_line(name).T)
        np.testing.assert_allclose(200.0 - np.hypot(x + 0.7, y - 200.0), beside_m, atol=1e-3, err_msg=name)


def test_distorted_camera_bends_the_line() -> None:
    camera = replace(CAMERA, distortion_model="plumb_bob", distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))
    lines = project_path_into_image(arc(1 / 150.0), camera, width_m=1.8)
    x, y = camera.ground_points_from_image(*lines.visible_points_of_line("centre").T)
    np.testing.assert_allclose(np.hypot(x, y - 150.0), 150.0, atol=1e-3)
    straight = project_path_into_image(arc(1 / 150.0), CAMERA, width_m=1.8)
    assert np.abs(straight.points - lines.points)[0].max() > 1.0


def test_path_of_a_standing_car_or_an_unknown_one_draws_nothing() -> None:
    standing = BodyPath(np.zeros(41), np.zeros(41), np.zeros(41), np.zeros((41, 3)))
    short = arc(0.0, length_m=nearest_visible_ground_m(CAMERA) - 0.1)
    unknown = replace(arc(0.0), y_m=np.full(101, np.nan))
    image = np.full((480, 640, 3), 90, np.uint8)
    for path in (standing, short, unknown):
        lines = project_path_into_image(path, CAMERA, width_m=1.8)
        assert not lines.in_image_mask.any()
        assert len(lines.band_90_percent_polygon_uv_px()) == 0
        assert (draw_path(image, lines) == 90).all()


def test_car_that_slows_to_a_stop_is_drawn_to_where_it_stops() -> None:
    path = arc(0.0)
    stopped = replace(path, x_m=np.minimum(path.x_m, 20.0))
    _, v = project_path_into_image(stopped, CAMERA, width_m=1.8).visible_points_of_line("centre").T
    np.testing.assert_allclose(v[-1], 239.5 + 600.0 * math.tan(math.atan(1.4 / 20.0) - 0.03), atol=ATOL_PX)


def test_part_outside_the_image_is_left_out() -> None:
    lines = project_path_into_image(arc(1 / 30.0, length_m=40.0), CAMERA, width_m=1.8)
    assert 2 < len(lines.visible_points_of_line("centre")) < N_PATH_POINTS
    kept = np.concatenate(
        [lines.visible_points_of_line(name) for name in PATH_LINE_NAMES] + [lines.band_90_percent_polygon_uv_px()]
    )
    assert (kept >= -0.5).all() and (kept <= (639.5, 479.5)).all()


def test_painting_changes_pixels_on_the_path_only() -> None:
    image = np.full((480, 640, 3), 90, np.uint8)
    lines = project_path_into_image(arc(0.0, sigma_m=0.3), CAMERA, width_m=1.8)
    drawn = draw_path(image, lines)
    assert (image == 90).all()
    rows, columns = np.nonzero((drawn != 90).any(axis=2))
    x, y = CAMERA.ground_points_from_image(columns.astype(float), rows.astype(float))
    assert np.nanmax(np.abs(y[x < 40.0])) < 0.9 + 0.25
    at_band = drawn[450, round(float(CAMERA.image_points_from_ground(np.array([4.0]), np.array([0.3]))[0][0]))]
    assert 90 < at_band[0] < 255, "the band is filled lightly"


def test_corridor_as_wide_as_the_lane_lies_on_the_rendered_markings() -> None:
    """A frame of the renderer, which projects by formulas of its own: the corridor's edges are the paint's middle."""
    seen = wide_camera(640, 360)
    curvature, width_m = 0.002, 3.6
    scene = RoadScene(
        "clear", width_m, Marking(width_m / 2), Marking(-width_m / 2), texture=0.0, tracks=0.0, cracks=0.0
    )
    grey = render_frame(
        scene, seen, RoadAhead(clothoid_curvature_1pm(curvature), 0.0, 0.0), np.random.default_rng(1)
    ).grey.astype(float)
    mounting = Mounting(height_m=seen.height_m, pitch_rad=seen.pitch_rad)
    camera = Camera(640, 360, seen.fx, seen.fy, seen.cx, seen.cy, mounting=mounting)
    lines = project_path_into_image(arc(curvature, length_m=40.0), camera, width_m=width_m)
    for name in ("left", "right"):
        u, v = lines.visible_points_of_line(name).T
        order = np.argsort(v)
        for row in range(200, 300, 10):
            at = float(np.interp(row, v[order], u[order]))
            columns = np.arange(round(at) - 12, round(at) + 13)
            bright = np.maximum(grey[row, columns] - 140.0, 0.0)
            assert abs(np.average(columns, weights=bright) - at) < 0.5
