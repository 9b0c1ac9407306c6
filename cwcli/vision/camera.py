"""A camera above a flat road: intrinsics with distortion, mounting, and the maps between image and ground plane.

Frames of reference: the image has u to the right and v down, in pixels, and the centre of the top left pixel is (0, 0),
as in OpenCV. The optical frame has x right, y down, z forward. The body frame has x forward, y left, z up (REP-103);
its origin here is the point of the road below the camera, moved sideways to the car's centre line.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field, replace
from functools import lru_cache

import numpy as np

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.canonical import CameraInfoSignal
from cwcli.signals.columns import FloatArray
from cwcli.vision.opencv_versions import undistort_points

WidthHeightPx = tuple[int, int]
"""Width and height of an image, pixels."""
OpticalRays = FloatArray
"""Directions in the optical frame (x right, y down, z ahead), shape (n, 3), of any length."""
BodyXyColumns = tuple[FloatArray, FloatArray]
"""Places on the road in the body frame, m ahead and m to the left, (n,) each."""
ImageUvColumns = tuple[FloatArray, FloatArray]
"""Columns and rows of image points, pixels, (n,) each."""
Rotation3x3 = FloatArray
"""A rotation matrix, shape (3, 3)."""

DEFAULT_FIELD_OF_VIEW_RAD = math.radians(60.0)
"""Horizontal field of view that is assumed where the log holds no calibration, in radians. Chosen by hand; not
fitted."""
FISHEYE_MODELS = ("equidistant", "fisheye", "kannala_brandt")
"""Distortion models, by their names in messages, that OpenCV's fisheye functions compute."""
POLYNOMIAL_MODELS = ("plumb_bob", "rational_polynomial", "thin_prism", "radtan", "")
"""Distortion models, by their names in messages, that OpenCV's polynomial functions compute."""
KNOWN_DISTORTION_MODEL_NAMES = (*POLYNOMIAL_MODELS, *FISHEYE_MODELS)
"""All distortion models that a calibration may name."""
MIN_RAY_COMPONENT_TO_DIVIDE_BY = 1e-9
"""Least component of a direction, forward or down, that is divided by; smaller ones count as parallel. Chosen by hand;
not fitted."""
MAX_RAY_ANGLE_RAD = math.radians(89.0)
"""Greatest angle from the optical axis that is projected, in radians: an image plane shows less than 90 degrees."""
N_DISTORTION_CHECK_ANGLES = 512
"""Number of angles at which a distortion is checked for turning back. Chosen by hand; not fitted."""
DISTORTION_COEFFICIENTS_OF_UNDISTORTED_IMAGE = (0.0,) * 4
"""Coefficients of an image without distortion, as OpenCV takes them."""

_BODY_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation from the optical to the body frame for a camera that looks straight ahead and is level."""


@dataclass(frozen=True)
class Mounting:
    """Position and orientation of a camera on the car.

    Attributes:
        height_m: Height above the road.
        pitch_rad: Nose down positive (REP-103).
        yaw_rad: Counter-clockwise positive: looking to the left.
        roll_rad: Positive about the forward axis: right side down.
        lateral_offset_m: Distance left of the car's centre line.
    """

    height_m: float = 1.3
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    roll_rad: float = 0.0
    lateral_offset_m: float = 0.0


@dataclass(frozen=True)
class Camera:
    """A calibrated, mounted camera for images of one size.

    Attributes:
        width_px, height_px: Image size.
        fx, fy, cx, cy: Pixels.
        distortion_model: As in the message: "" or a polynomial model (`plumb_bob`, `rational_polynomial`) or a fisheye
            one (`equidistant`).
        distortion: Its coefficients. A fisheye without any is one whose coefficients are zero, not a pinhole.
        mounting: The camera's mounting on the car.
        is_default: There was no calibration; the intrinsics are assumed.
    """

    width_px: int
    height_px: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion_model: str = ""
    distortion: tuple[float, ...] = ()
    mounting: Mounting = field(default_factory=Mounting)
    is_default: bool = False

    def with_image_size(self, width_px: int, height_px: int) -> Camera:
        """The same camera for images scaled to another size (also if the aspect ratio changes)."""
        sx, sy = width_px / self.width_px, height_px / self.height_px
        return replace(
            self,
            width_px=width_px,
            height_px=height_px,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
        )

    def with_pitch_and_yaw(self, *, pitch_rad: float = math.nan, yaw_rad: float = math.nan) -> Camera:
        """The same camera with another pitch and yaw; NaN keeps the old one."""
        mounting = self.mounting
        if not math.isnan(pitch_rad):
            mounting = replace(mounting, pitch_rad=pitch_rad)
        if not math.isnan(yaw_rad):
            mounting = replace(mounting, yaw_rad=yaw_rad)
        return replace(self, mounting=mounting)

    def body_from_optical_rotation(self) -> Rotation3x3:
        """Rotation from the optical to the body frame, Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3)."""
        mounting = self.mounting
        body_axes: FloatArray = (
            rotation_from_yaw_pitch_roll(mounting.yaw_rad, mounting.pitch_rad, mounting.roll_rad) @ _BODY_FROM_OPTICAL
        )
        return body_axes

    def intrinsic_matrix(self) -> FloatArray:
        """The matrix K of the intrinsics, shape (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def viewing_rays_from_image(self, u_px: FloatArray, v_px: FloatArray) -> OpticalRays:
        """Directions (x, y, 1) in the optical frame of image points, distortion removed.

        Returns:
            Shape (n, 3).
        """
        if not self.differs_from_pinhole():
            x, y = (u_px - self.cx) / self.fx, (v_px - self.cy) / self.fy
            return np.column_stack([x, y, np.ones_like(x)])
        import cv2

        points = np.column_stack([u_px, v_px]).astype(np.float64).reshape(-1, 1, 2)
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
        coefficients = self.distortion_coefficients()
        if self.is_fisheye():
            ideal = cv2.fisheye.undistortPoints(points, self.intrinsic_matrix(), coefficients, criteria=stop)
        else:
            ideal = undistort_points(points, self.intrinsic_matrix(), coefficients, stop)
        return np.column_stack([ideal.reshape(-1, 2), np.ones(len(points))])

    def ground_points_from_image(self, u_px: FloatArray, v_px: FloatArray) -> BodyXyColumns:
        """Points on the road, in the body frame, that image points show.

        Returns:
            x_m, y_m: Shape (n,); NaN at and above the horizon.
        """
        return self.ground_points_from_rays(self.viewing_rays_from_image(u_px, v_px))

    def ground_points_from_rays(self, rays: OpticalRays) -> BodyXyColumns:
        """Points on the road that directions in the optical frame meet, as in `ground_points_from_image`; rays have
        shape (n, 3)."""
        body = rays @ self.body_from_optical_rotation().T
        down = -body[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(down > MIN_RAY_COMPONENT_TO_DIVIDE_BY, self.mounting.height_m / down, np.nan)
        return scale * body[:, 0], scale * body[:, 1] + self.mounting.lateral_offset_m

    def image_points_from_ground(self, x_m: FloatArray, y_m: FloatArray) -> ImageUvColumns:
        """Image points of points on the road in the body frame.

        Returns:
            u_px, v_px: Shape (n,); NaN behind the camera.
        """
        body = np.column_stack(
            [x_m, y_m - self.mounting.lateral_offset_m, np.full_like(x_m, 0.0 - self.mounting.height_m)]
        )
        return self.image_points_from_rays(body @ self.body_from_optical_rotation())

    def image_points_from_rays(self, rays: OpticalRays) -> ImageUvColumns:
        """Image points of directions in the optical frame, with distortion.

        Args:
            rays: Shape (n, 3), of any length.

        Returns:
            u_px, v_px: Shape (n,); NaN behind the camera, and beyond `max_undistorted_radius_over_depth`.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            ideal = np.where(rays[:, 2:] > MIN_RAY_COMPONENT_TO_DIVIDE_BY, rays[:, :2] / rays[:, 2:], np.nan)
        if not self.differs_from_pinhole():
            return self.fx * ideal[:, 0] + self.cx, self.fy * ideal[:, 1] + self.cy
        is_projected = np.hypot(ideal[:, 0], ideal[:, 1]) < self.max_undistorted_radius_over_depth
        pixels = np.full_like(ideal, np.nan)
        if is_projected.any():
            pixels[is_projected] = _project_with_distortion(
                ideal[is_projected],
                self.intrinsic_matrix(),
                self.distortion_coefficients(),
                is_fisheye=self.is_fisheye(),
            )
        return pixels[:, 0], pixels[:, 1]

    @property
    def max_undistorted_radius_over_depth(self) -> float:
        """Distance from the axis, over the depth, up to which a point farther out in the scene is farther out in the
        image.

        Beyond it the polynomial of a strong distortion turns back, and would show the scene a second time. Infinite
        without distortion.
        """
        return (
            _max_undistorted_radius_of_lens(self.is_fisheye(), self.distortion)
            if self.differs_from_pinhole()
            else math.inf
        )

    def horizon_row_px(self, pitch_rad: FloatArray | None = None) -> FloatArray:
        """Row of the horizon straight ahead of the camera, distortion and roll left out; may lie outside the image.

        Args:
            pitch_rad: Pitches of any shape to use instead of the mounting's.
        """
        pitch = np.array(self.mounting.pitch_rad) if pitch_rad is None else pitch_rad
        return np.asarray(self.cy - self.fy * np.tan(pitch))

    def is_fisheye(self) -> bool:
        """Whether the distortion is a fisheye model's."""
        return self.distortion_model.lower() in FISHEYE_MODELS

    def differs_from_pinhole(self) -> bool:
        """Whether the image is another one than a pinhole's."""
        return self.is_fisheye() or any(self.distortion)

    def distortion_coefficients(self) -> FloatArray:
        """The distortion's coefficients as OpenCV takes them."""
        return np.array(self.distortion or DISTORTION_COEFFICIENTS_OF_UNDISTORTED_IMAGE)


def _project_with_distortion(
    undistorted_xy: FloatArray, intrinsics: FloatArray, coefficients: FloatArray, *, is_fisheye: bool
) -> FloatArray:
    """Image points, shape (n, 2), of the undistorted points x / z, y / z, shape (n, 2)."""
    import cv2

    zero = np.zeros(3)
    points = np.column_stack([undistorted_xy, np.ones(len(undistorted_xy))]).reshape(-1, 1, 3)
    project = cv2.fisheye.projectPoints if is_fisheye else cv2.projectPoints
    return np.asarray(project(points, zero, zero, intrinsics, coefficients)[0].reshape(-1, 2), np.float64)


@lru_cache(maxsize=16)
def _max_undistorted_radius_of_lens(is_fisheye: bool, distortion: tuple[float, ...]) -> float:
    """`Camera.max_undistorted_radius_over_depth`, computed once for each lens."""
    radius = np.tan(np.linspace(0.0, MAX_RAY_ANGLE_RAD, N_DISTORTION_CHECK_ANGLES))
    across, coefficients = (
        np.column_stack([radius, np.zeros(N_DISTORTION_CHECK_ANGLES)]),
        np.array(distortion or DISTORTION_COEFFICIENTS_OF_UNDISTORTED_IMAGE),
    )
    right, left = (
        _project_with_distortion(sign * across, np.eye(3), coefficients, is_fisheye=is_fisheye)[:, 0]
        for sign in (1.0, -1.0)
    )
    with np.errstate(over="ignore", invalid="ignore"):
        turns = np.flatnonzero(~(np.diff(right - left) > 0.0))  # the difference has no tangential part
    return float(radius[turns[0]]) if len(turns) else float(radius[-1])


def rotation_from_yaw_pitch_roll(yaw_rad: float, pitch_rad: float, roll_rad: float) -> FloatArray:
    """The rotation matrix Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3)."""
    cz, sz, cy, sy = math.cos(yaw_rad), math.sin(yaw_rad), math.cos(pitch_rad), math.sin(pitch_rad)
    cx, sx = math.cos(roll_rad), math.sin(roll_rad)
    rz = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
    ry = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    rx = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    return np.asarray(rz @ ry @ rx)


def default_camera(
    width_px: int, height_px: int, mounting: Mounting, *, field_of_view_rad: float = DEFAULT_FIELD_OF_VIEW_RAD
) -> Camera:
    """The assumed camera of a log without calibration: square pixels, the axis at the image's centre, no distortion.

    Args:
        field_of_view_rad: Horizontal, over the whole width.
    """
    focal_px = width_px / 2.0 / math.tan(field_of_view_rad / 2.0)
    return Camera(
        width_px=width_px,
        height_px=height_px,
        fx=focal_px,
        fy=focal_px,
        cx=(width_px - 1) / 2.0,
        cy=(height_px - 1) / 2.0,
        mounting=mounting,
        is_default=True,
    )


def camera_from_calibration(info: CameraInfoSignal, mounting: Mounting, *, is_rectified: bool) -> Camera:
    """The camera of a calibration message.

    Args:
        is_rectified: The images are rectified already: P holds their intrinsics, and there is no distortion. (The
            rectifying rotation of a stereo camera is left out: the mounting is that of the rectified image.)

    Raises:
        UsageError: The distortion model is unknown.
    """
    model = info.distortion_model.lower()
    if model not in KNOWN_DISTORTION_MODEL_NAMES:
        raise UsageError(
            f"the distortion model {info.distortion_model!r} is unknown",
            where=info.source,
            hint=f"known: {', '.join(name for name in KNOWN_DISTORTION_MODEL_NAMES if name)}",
        )
    k = info.projection[:, :3] if is_rectified else info.intrinsic
    return Camera(
        width_px=info.width_px,
        height_px=info.height_px,
        fx=float(k[0, 0]),
        fy=float(k[1, 1]),
        cx=float(k[0, 2]),
        cy=float(k[1, 2]),
        distortion_model="" if is_rectified else model,
        distortion=() if is_rectified else pad_distortion_coefficients(model, info.distortion),
        mounting=mounting,
    )


def pad_distortion_coefficients(model: str, coefficients: FloatArray | Sequence[float]) -> tuple[float, ...]:
    """Distortion coefficients, filled with zeros to a number that OpenCV takes: 4 for a fisheye, else 4, 5, 8, 12 or
    14.

    Empty if there is no distortion: all are zero, and the model is no fisheye.
    """
    numbers = [float(value) for value in coefficients]
    if not any(numbers) and model not in FISHEYE_MODELS:
        return ()
    lengths = (4,) if model in FISHEYE_MODELS else (4, 5, 8, 12, 14)
    length = next((n for n in lengths if n >= len(numbers)), lengths[-1])
    return tuple((numbers + [0.0] * length)[:length])
