"""The camera against hand calculation, OpenCV's projection and its own inverse."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from cwcli.errors import UsageError
from cwcli.signals.canonical import CameraInfoSignal
from cwcli.vision.camera import Camera, Mounting, camera_from_calibration, default_camera

ATOL_PX = 1e-6
ATOL_M = 1e-6
X_M = np.array([5.0, 10.0, 20.0, 33.5, 60.0, 15.0])
Y_M = np.array([1.75, -1.75, 0.0, 2.0, -3.0, 6.0])
PLUMB_BOB = (-0.25, 0.08, 0.001, -0.0005, -0.01)
RATIONAL = (0.1, -0.05, 0.0004, 0.0003, 0.01, 0.35, -0.1, 0.02)
FISHEYE = (-0.02, 0.004, -0.001, 0.0002)


def test_level_camera_by_hand() -> None:
    # 1.2 m up, focal length 500: a point 10 m ahead and 2 m to the left lies 100 left of and 60 below the centre.
    camera = Camera(640, 480, 500.0, 500.0, 320.0, 240.0, mounting=Mounting(height_m=1.2))
    u, v = camera.image_points_from_ground(np.array([10.0]), np.array([2.0]))
    assert (u[0], v[0]) == pytest.approx((220.0, 300.0), abs=ATOL_PX)
    assert float(camera.horizon_row_px()) == pytest.approx(240.0)


def test_signs_of_the_mounting_by_hand() -> None:
    camera = Camera(640, 480, 500.0, 500.0, 320.0, 240.0, mounting=Mounting(height_m=1.2))
    ahead = (np.array([20.0]), np.array([0.0]))
    u0, v0 = camera.image_points_from_ground(*ahead)
    nose_down = camera.with_pitch_and_yaw(pitch_rad=0.05)
    assert nose_down.image_points_from_ground(*ahead)[1][0] < v0[0]  # the road moves up in the image
    assert float(nose_down.horizon_row_px()) == pytest.approx(240.0 - 500.0 * math.tan(0.05))
    to_the_left = camera.with_pitch_and_yaw(yaw_rad=0.05)
    assert to_the_left.image_points_from_ground(*ahead)[0][0] > u0[0]
    left_of_centre = Camera(640, 480, 500.0, 500.0, 320.0, 240.0, mounting=Mounting(1.2, lateral_offset_m=0.5))
    assert left_of_centre.image_points_from_ground(*ahead)[0][0] == pytest.approx(320.0 + 500.0 * 0.5 / 20.0)


@pytest.mark.parametrize(
    ("model", "coefficients"),
    [("", ()), ("plumb_bob", PLUMB_BOB), ("rational_polynomial", RATIONAL), ("equidistant", FISHEYE)],
)
def test_ground_and_image_are_inverse(model: str, coefficients: tuple[float, ...]) -> None:
    mounting = Mounting(1.4, pitch_rad=0.04, yaw_rad=-0.02, roll_rad=0.01, lateral_offset_m=-0.2)
    camera = Camera(1280, 720, 900.0, 905.0, 640.0, 350.0, model, coefficients, mounting)
    x_m, y_m = camera.ground_points_from_image(*camera.image_points_from_ground(X_M, Y_M))
    np.testing.assert_allclose(x_m, X_M, atol=1e-4)
    np.testing.assert_allclose(y_m, Y_M, atol=1e-4)


def test_projection_equals_opencv_with_the_rotation_spelt_out() -> None:
    mounting = Mounting(1.4, pitch_rad=0.04, yaw_rad=-0.02, lateral_offset_m=0.3)
    camera = Camera(1280, 720, 900.0, 905.0, 640.0, 350.0, "plumb_bob", PLUMB_BOB, mounting)
    # Optical from body: undo yaw (about z), then pitch (about y), then rename the axes.
    undo_yaw = cv2.Rodrigues(np.array([0.0, 0.0, 0.02]))[0]
    undo_pitch = cv2.Rodrigues(np.array([0.0, -0.04, 0.0]))[0]
    rename = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    turn = rename @ undo_pitch @ undo_yaw
    shift = -turn @ np.array([0.0, 0.3, 1.4])
    points = np.column_stack([X_M, Y_M, np.zeros_like(X_M)])
    expected = cv2.projectPoints(points, cv2.Rodrigues(turn)[0], shift, camera.intrinsic_matrix(), np.array(PLUMB_BOB))[
        0
    ]
    np.testing.assert_allclose(np.column_stack(camera.image_points_from_ground(X_M, Y_M)), expected[:, 0], atol=1e-5)


def test_points_behind_and_above_the_horizon_are_nan() -> None:
    camera = default_camera(640, 480, Mounting())
    assert np.isnan(camera.image_points_from_ground(np.array([-5.0]), np.array([0.0]))[0][0])
    x_m, y_m = camera.ground_points_from_image(np.array([320.0]), np.array([100.0]))
    assert np.isnan(x_m[0])
    assert np.isnan(y_m[0])


def test_resized_camera_sees_the_same_ground() -> None:
    camera = Camera(1280, 720, 900.0, 905.0, 640.0, 350.0, mounting=Mounting(1.4, pitch_rad=0.04))
    small = camera.with_image_size(320, 240)
    u, v = camera.image_points_from_ground(X_M, Y_M)
    su, sv = small.image_points_from_ground(X_M, Y_M)
    np.testing.assert_allclose((su + 0.5) * 4.0, u + 0.5, atol=ATOL_PX)
    np.testing.assert_allclose((sv + 0.5) * 3.0, v + 0.5, atol=ATOL_PX)


def test_default_camera_has_the_stated_field_of_view() -> None:
    camera = default_camera(1000, 500, Mounting())
    assert camera.is_default
    edge = camera.viewing_rays_from_image(np.array([-0.5, 999.5]), np.array([249.5, 249.5]))
    np.testing.assert_allclose(np.degrees(np.arctan(edge[:, 0])), [-30.0, 30.0], atol=1e-9)


def info(model: str, distortion: tuple[float, ...]) -> CameraInfoSignal:
    k = np.array([[900.0, 0, 640], [0, 905.0, 350], [0, 0, 1]])
    p = np.array([[800.0, 0, 630, 0], [0, 800.0, 340, 0], [0, 0, 1, 0]])
    return CameraInfoSignal("/camera_info", "camera", 1280, 720, model, np.array(distortion), k, np.eye(3), p)


def test_calibration_gives_k_and_distortion_or_p_for_rectified_images() -> None:
    camera = camera_from_calibration(info("plumb_bob", PLUMB_BOB), Mounting(), is_rectified=False)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (900.0, 905.0, 640.0, 350.0)
    assert camera.distortion == PLUMB_BOB
    rectified = camera_from_calibration(info("plumb_bob", PLUMB_BOB), Mounting(), is_rectified=True)
    assert (rectified.fx, rectified.cx, rectified.distortion) == (800.0, 630.0, ())


def test_unknown_distortion_is_an_error_that_names_it() -> None:
    with pytest.raises(UsageError, match="atan"):
        camera_from_calibration(info("atan", (0.9,)), Mounting(), is_rectified=False)
