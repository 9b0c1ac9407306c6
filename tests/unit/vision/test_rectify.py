"""Rectified frames: the map against OpenCV's own, points there and back, and which cameras need it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, cast

import cv2
import numpy as np
import pytest

from cwcli.vision.camera import Camera, Mounting, pad_distortion_coefficients
from cwcli.vision.rectify import (
    MAX_CACHED_MAPS,
    Rectifier,
    in_image_mask,
    lowest_visible_row_px,
    map_rectified_to_camera_px,
    needs_rectifying,
    rectification_pixel_maps,
    rectified_camera,
)
from tests.unit.vision.lens_frames import RATIONAL

ATOL_PX = 1e-3
"""OpenCV's maps are of single precision."""
FIXED_ATOL_PX = 1 / 32
ROLL_RAD = math.radians(3.0)
LENSES = {
    "plumb_bob": (-0.3, 0.1, 0.001, -0.0005, 0.01),
    "rational_polynomial": RATIONAL,
    "equidistant": (-0.02, 0.004, -0.001, 0.0002),
}


def camera(model: str, coefficients: tuple[float, ...], roll_rad: float = 0.0) -> Camera:
    mounting = Mounting(1.3, pitch_rad=0.06, yaw_rad=0.02, roll_rad=roll_rad, lateral_offset_m=0.1)
    return Camera(320, 180, 200.0, 202.0, 161.0, 88.0, model, coefficients, mounting)


@pytest.mark.parametrize("model", LENSES)
def test_map_equals_opencvs(model: str) -> None:
    coefficients, size = np.array(LENSES[model]), (320, 180)
    # A camera rolled with its right side down sees the level world turned counter-clockwise: R turns it back.
    cosine, sine = math.cos(ROLL_RAD), math.sin(ROLL_RAD)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    rolled = camera(model, LENSES[model], ROLL_RAD)
    make = cv2.fisheye.initUndistortRectifyMap if model == "equidistant" else cv2.initUndistortRectifyMap
    expected = np.stack(
        make(rolled.intrinsic_matrix(), coefficients, turn, rolled.intrinsic_matrix(), size, cv2.CV_32FC1), axis=-1
    )
    v, u = np.mgrid[:180, :320].astype(np.float64)
    np.testing.assert_allclose(map_rectified_to_camera_px(np.stack([u, v], axis=-1), rolled), expected, atol=ATOL_PX)
    whole, parts = rectification_pixel_maps(rolled)
    table = cv2.INTER_TAB_SIZE
    read = whole + np.stack([parts % table, parts // table], axis=-1) / table
    np.testing.assert_allclose(read, expected, atol=FIXED_ATOL_PX)


@pytest.mark.parametrize("model", ["", *LENSES])
def test_rectified_camera_puts_points_on_the_same_ground(model: str) -> None:
    rolled = camera(model, LENSES.get(model, ()), ROLL_RAD)
    x_m, y_m = np.array([4.0, 6.0, 12.0, 30.0]), np.array([1.0, -1.5, 2.0, -3.0])
    level = np.stack(rectified_camera(rolled).image_points_from_ground(x_m, y_m), axis=-1)
    own = np.stack(rolled.image_points_from_ground(x_m, y_m), axis=-1)
    np.testing.assert_allclose(map_rectified_to_camera_px(level, rolled), own, atol=1e-6)


def test_roll_by_hand() -> None:
    # Right side down: the world turns counter-clockwise in the image, so what is right of the axis goes up.
    rolled = replace(camera("", (), math.radians(90.0)), fy=200.0)
    np.testing.assert_allclose(map_rectified_to_camera_px(np.array([261.0, 88.0]), rolled), [161.0, -12.0], atol=1e-9)


def test_fisheye_without_coefficients_by_hand() -> None:
    """r = f theta: still a fisheye, where a polynomial of zeros is a pinhole."""
    fisheye = camera("equidistant", pad_distortion_coefficients("equidistant", [0.0] * 4))
    assert fisheye.differs_from_pinhole()
    assert needs_rectifying(fisheye)
    assert pad_distortion_coefficients("equidistant", []) == (0.0,) * 4
    assert needs_rectifying(camera("equidistant", ()))
    angle_rad = math.radians(40.0)
    for each in (fisheye, camera("equidistant", ())):
        at = map_rectified_to_camera_px(np.array([161.0 + 200.0 * math.tan(angle_rad), 88.0]), each)
        np.testing.assert_allclose(at, [161.0 + 200.0 * angle_rad, 88.0], atol=1e-9)
        ray = each.viewing_rays_from_image(np.array([161.0 + 200.0 * angle_rad]), np.array([88.0]))[0]
        np.testing.assert_allclose(ray, [math.tan(angle_rad), 0.0, 1.0], atol=1e-9)


@pytest.mark.parametrize("model", ["", "plumb_bob", "rational_polynomial"])
def test_coefficients_of_zero_are_no_distortion(model: str) -> None:
    for given in ((), pad_distortion_coefficients(model, [0.0] * 5), (0.0,) * 5):
        assert not needs_rectifying(camera(model, given))
    assert not needs_rectifying(camera(model, (), ROLL_RAD))  # lines stay straight
    assert needs_rectifying(camera("plumb_bob", (0.0, 1e-3, 0.0, 0.0)))


def test_scene_is_not_shown_twice_where_the_polynomial_turns_back() -> None:
    # r - 0.3 r^3 is greatest at r = 1 / sqrt(0.9)
    folded = camera("plumb_bob", (-0.3, 0.0, 0.0, 0.0))
    assert folded.max_undistorted_radius_over_depth == pytest.approx(1.0 / math.sqrt(0.9), rel=0.01)
    near, beyond = (
        map_rectified_to_camera_px(np.array([161.0 + 200.0 * radius, 88.0]), folded) for radius in (1.0, 1.1)
    )
    assert near[0] == pytest.approx(161.0 + 200.0 * 0.7)
    assert np.isnan(beyond).all()
    assert camera("", ()).max_undistorted_radius_over_depth == math.inf
    wide = replace(folded, width_px=600, cx=300.0)
    white = Rectifier(wide.with_image_size).rectify_image(np.full((180, 600), 255, np.uint8), (600, 180))
    assert white[88, 300] == white[88, 300 + 200] == 255
    assert white[88, 300 + 220] == 0


def test_images_of_every_size_have_their_own_map() -> None:
    fisheye = camera("equidistant", LENSES["equidistant"])
    rectifier = Rectifier(fisheye.with_image_size)
    rng = np.random.default_rng(1)
    for image_size, search_size in (((320, 180), (320, 180)), ((640, 360), (320, 180)), ((640, 480), (160, 120))):
        grey = rng.integers(0, 256, search_size[::-1], np.uint8)
        seen_by = fisheye.with_image_size(*image_size).with_image_size(*search_size)
        v, u = np.mgrid[: search_size[1], : search_size[0]].astype(np.float64)
        points = map_rectified_to_camera_px(np.stack([u, v], axis=-1), seen_by).astype(np.float32)
        expected = cv2.remap(grey, points, cast(Any, None), cv2.INTER_LINEAR)
        made = rectifier.rectify_image(grey, image_size)
        np.testing.assert_allclose(made.astype(int), expected.astype(int), atol=6)  # 1/32 pixel of 255
        np.testing.assert_array_equal(made, rectifier.rectify_image(grey, image_size))


def test_lowest_row_reaches_the_cameras_corners() -> None:
    assert lowest_visible_row_px(camera("", ())) == 179.0
    barrel = camera("plumb_bob", (-0.3, 0.1, 0.0, 0.0))
    lowest = lowest_visible_row_px(barrel)
    u_px = np.linspace(-500.0, 800.0, 2000)
    below = map_rectified_to_camera_px(np.column_stack([u_px, np.full(2000, lowest + 2.0)]), barrel)
    assert not in_image_mask(below, barrel).any()
    within = map_rectified_to_camera_px(np.column_stack([u_px, np.full(2000, lowest - 2.0)]), barrel)
    assert in_image_mask(within, barrel).any()


def test_maps_of_many_sizes_do_not_pile_up() -> None:
    rectifier = Rectifier(lambda width_px, height_px: camera("equidistant", ()).with_image_size(width_px, height_px))
    grey = np.tile(np.arange(64, dtype=np.uint8), (36, 1))
    first = rectifier.rectify_image(grey, (640, 360))
    for k in range(1, 3 * MAX_CACHED_MAPS):
        rectifier.rectify_image(grey, (640 + k, 360))
        assert len(rectifier._maps) <= MAX_CACHED_MAPS
    np.testing.assert_array_equal(rectifier.rectify_image(grey, (640, 360)), first)
