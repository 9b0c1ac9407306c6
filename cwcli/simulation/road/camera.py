"""The camera of rendered frames: a pinhole above the road, without roll or distortion.

Image axes: u to the right, v down, the centre of the top left pixel at (0, 0). Body frame: x forward, y left, z up,
origin on the road below the camera. `pitch_rad` is nose down positive.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray

MIN_IMAGE_WIDTH_AND_HEIGHT_PX = (64, 48)
"""Smallest width and height of a rendered image, px. Chosen by hand; not fitted."""
MAX_IMAGE_WIDTH_AND_HEIGHT_PX = (4096, 3072)
"""Largest width and height of a rendered image, px. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class RoadCamera:
    """A camera of one image size on its mounting.

    Attributes:
        width_px, height_px: Image size.
        fx, fy, cx, cy: Focal lengths and principal point, pixels.
        height_m: Height above the road.
        pitch_rad: Pitch, nose down positive.
    """

    width_px: int
    height_px: int
    fx: float
    fy: float
    cx: float
    cy: float
    height_m: float
    pitch_rad: float

    def intrinsic_matrix(self) -> FloatArray:
        """The intrinsic matrix K, shape (3, 3), px."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def with_added_pitch(self, pitch_rad: float) -> RoadCamera:
        """The same camera with a pitch added, as the car's body pitches on its springs."""
        return replace(self, pitch_rad=self.pitch_rad + pitch_rad)

    def downward_slope_of_rows(self, v_px: FloatArray) -> FloatArray:
        """Downward slope of the viewing rays of rows, metres down for a metre ahead; negative above the horizon."""
        return np.tan(self.pitch_rad + np.arctan((np.asarray(v_px) - self.cy) / self.fy))

    def depth_along_optical_axis_m(self, x_m: FloatArray, below_m: FloatArray | float) -> FloatArray:
        """Distance along the optical axis of points x_m ahead of and below_m under the camera, m."""
        return x_m * math.cos(self.pitch_rad) + below_m * math.sin(self.pitch_rad)

    def project_to_image_px(self, x_m: FloatArray, y_m: FloatArray, z_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Project points of the body frame to image columns and rows (u, v), px; NaN behind the camera."""
        below = self.height_m - np.asarray(z_m)
        depth = self.depth_along_optical_axis_m(x_m, below)
        down = below * math.cos(self.pitch_rad) - x_m * math.sin(self.pitch_rad)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(depth > 0.1, 1.0 / depth, np.nan)
        return self.cx - self.fx * y_m * scale, self.cy + self.fy * down * scale


PAPER_PREVIEW_M = 33.5
"""Distance ahead at which the optical axis meets the road, m; zhang2011, section 1.2.3."""
PAPER_CAMERA_HEIGHT_M = 1.65
"""Height of the paper's camera above the road, m: follows from the focal length and the rows that show road
(docs/road-renderer.md)."""
PAPER_FOCAL_LENGTH_PX = 800.0
"""Focal length of the paper's camera at 320 columns, px: a lens of 12 mm before a 1/3-inch chip (4.8 mm wide). Chosen
by hand."""


def camera_of_zhang2011(width_px: int = 320, height_px: int = 240) -> RoadCamera:
    """zhang2011's camera, as far as the paper determines it.

    The optical axis meets the road 33.5 m ahead, and the road fills about two thirds of the image, 160 rows of 240, of
    which the lower 150 are searched. With a common lens of 800 pixels (12 mm at 1/3 inch) both hold for a camera 1.65 m
    high, below the roof of a microvan (the paper's car: wheelbase 1.96 m). A lane of 3.6 m has the slopes +-1.1 and the
    feet -14 and 334, in the middle of the paper's first search regions.

    Other sizes keep the horizontal field of view (22.6 deg) and the axis.
    """
    _check_image_size(width_px, height_px)
    focal = PAPER_FOCAL_LENGTH_PX * width_px / 320.0
    pitch = math.atan(PAPER_CAMERA_HEIGHT_M / PAPER_PREVIEW_M)
    return RoadCamera(
        width_px, height_px, focal, focal, (width_px - 1) / 2, (height_px - 1) / 2, PAPER_CAMERA_HEIGHT_M, pitch
    )


def wide_camera(width_px: int = 1280, height_px: int = 720) -> RoadCamera:
    """A present-day front camera: 60 deg wide, 1.3 m high, the horizon at 45 % of the image's height."""
    _check_image_size(width_px, height_px)
    focal = width_px / 2 / math.tan(math.radians(30.0))
    pitch = math.atan(0.05 * height_px / focal)
    return RoadCamera(width_px, height_px, focal, focal, (width_px - 1) / 2, (height_px - 1) / 2, 1.3, pitch)


CAMERA_MAKERS_BY_NAME = {"paper": camera_of_zhang2011, "wide": wide_camera}
"""Functions from width and height in pixels to a camera, by the name that `--set camera` takes."""


def _check_image_size(width_px: int, height_px: int) -> None:
    """Refuse an image size that can't be rendered."""
    if not (
        MIN_IMAGE_WIDTH_AND_HEIGHT_PX[0] <= width_px <= MAX_IMAGE_WIDTH_AND_HEIGHT_PX[0]
        and MIN_IMAGE_WIDTH_AND_HEIGHT_PX[1] <= height_px <= MAX_IMAGE_WIDTH_AND_HEIGHT_PX[1]
    ):
        raise UsageError(
            f"an image of {width_px} x {height_px} pixels can't be rendered",
            hint=f"from {MIN_IMAGE_WIDTH_AND_HEIGHT_PX[0]} x {MIN_IMAGE_WIDTH_AND_HEIGHT_PX[1]} "
            f"to {MAX_IMAGE_WIDTH_AND_HEIGHT_PX[0]} x {MAX_IMAGE_WIDTH_AND_HEIGHT_PX[1]}",
        )
