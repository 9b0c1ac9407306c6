"""Rendered road frames as a lens with distortion, or a rolled camera, would see them, with the truth in its pixels.

The renderer's camera is a pinhole without roll. Its frames and its exact truth are warped by OpenCV's own functions;
nothing of `cwcli.vision` but the mounting's type is used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import cv2
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.camera import RoadCamera
from cwcli.simulation.road.drive import RoadDrive, RoadDriveConfig, plan_road_drive
from cwcli.simulation.road.truth import LaneTruth
from cwcli.vision.camera import Mounting
from cwcli.vision.opencv_versions import undistort_points

WIDTH_PX, HEIGHT_PX = 640, 360
HEIGHT_M = 1.3
RATIONAL = (0.2, -0.05, 0.0005, -0.0004, 0.0, 0.5, 0.0, 0.0)
FINER = 1.5
"""Pixels of the rendered frame for one of the lens's, at the middle."""


@dataclass(frozen=True)
class Lens:
    """A lens and how its camera hangs.

    Attributes:
        model, coefficients: As in a calibration message.
        focal_px: Of an image of `WIDTH_PX` x `HEIGHT_PX`.
        margin: Width and height of the rendered frame over those that a pinhole with this focal length has.
        roll_rad: Right side down positive.
        pitch_rad: Nose down positive.
    """

    model: str
    coefficients: tuple[float, ...]
    focal_px: float
    margin: float
    roll_rad: float = 0.0
    pitch_rad: float = math.radians(2.0)

    @cached_property
    def matrix(self) -> FloatArray:
        return np.array([[self.focal_px, 0.0, 322.0], [0.0, self.focal_px, 176.0], [0.0, 0.0, 1.0]])

    @cached_property
    def source(self) -> RoadCamera:
        """Of the rendered frames."""
        width, height = (round(FINER * self.margin * side / 2) * 2 for side in (WIDTH_PX, HEIGHT_PX))
        focal = FINER * self.focal_px
        return RoadCamera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, HEIGHT_M, self.pitch_rad)

    @property
    def mounting(self) -> Mounting:
        return Mounting(height_m=HEIGHT_M, pitch_rad=self.pitch_rad, roll_rad=self.roll_rad)

    @cached_property
    def map(self) -> FloatArray:
        """Shape (height, width, 2): where each pixel of the lens is in the rendered frame."""
        v, u = np.mgrid[:HEIGHT_PX, :WIDTH_PX].astype(np.float64)
        seen = np.column_stack([u.ravel(), v.ravel()])[:, None]
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
        if self.model == "equidistant":
            ideal = cv2.fisheye.undistortPoints(seen, self.matrix, np.array(self.coefficients), criteria=stop)
        else:
            ideal = undistort_points(seen, self.matrix, np.array(self.coefficients), stop)
        x, y = ideal.reshape(-1, 2).T
        cosine, sine = math.cos(self.roll_rad), math.sin(self.roll_rad)
        level = np.column_stack([cosine * x - sine * y, sine * x + cosine * y])
        camera = self.source
        return (level * [camera.fx, camera.fy] + [camera.cx, camera.cy]).reshape(HEIGHT_PX, WIDTH_PX, 2)

    def seen(self, frame: np.ndarray) -> np.ndarray:
        """A rendered frame through this lens."""
        smooth, nothing = cv2.GaussianBlur(frame, (0, 0), 0.5), cast(Any, None)  # OpenCV takes None for it
        return cv2.remap(smooth, self.map.astype(np.float32), nothing, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)

    def points(self, u_px: FloatArray, v_px: FloatArray) -> np.ndarray:
        """Shape (n, 2): where points of the rendered frame are in the lens's image."""
        camera = self.source
        x, y = (u_px - camera.cx) / camera.fx, (v_px - camera.cy) / camera.fy
        cosine, sine = math.cos(self.roll_rad), math.sin(self.roll_rad)
        rays = np.column_stack([cosine * x + sine * y, cosine * y - sine * x, np.ones_like(x)])[:, None]
        zero, coefficients = np.zeros(3), np.array(self.coefficients)
        if self.model == "equidistant":
            return cv2.fisheye.projectPoints(rays, zero, zero, self.matrix, coefficients)[0].reshape(-1, 2)
        return cv2.projectPoints(rays, zero, zero, self.matrix, coefficients)[0].reshape(-1, 2)

    def line(self, truth: LaneTruth, side: str) -> FloatArray:
        """Shape (n, 2): a true boundary in the lens's image, as far as the renderer calls it visible."""
        u_px = truth.left_u_px if side == "left" else truth.right_u_px
        rows = np.flatnonzero(truth.left_visible if side == "left" else truth.right_visible)
        return self.points(u_px[rows], rows.astype(np.float64))

    def calibration(self) -> CameraCalibration:
        message = CameraCalibration(frame_id="camera", width=WIDTH_PX, height=HEIGHT_PX)
        message.distortion_model = self.model
        message.D.extend(self.coefficients)
        message.K.extend(self.matrix.ravel())
        message.P.extend(np.column_stack([self.matrix, np.zeros(3)]).ravel())
        return message


LENSES = {
    "pinhole": Lens("plumb_bob", (0.0,) * 5, 554.0, 1.05),
    "plumb_bob": Lens("plumb_bob", (-0.3, 0.1, 0.0, 0.0, 0.0), 400.0, 1.5, pitch_rad=0.1),
    "rational_polynomial": Lens("rational_polynomial", RATIONAL, 400.0, 1.5, pitch_rad=0.1),
    "equidistant": Lens("equidistant", (-0.02, 0.004, -0.001, 0.0), 330.0, 2.0, pitch_rad=0.14),
    "equidistant, zeros": Lens("equidistant", (0.0,) * 4, 330.0, 2.0, pitch_rad=0.14),
    "roll": Lens("plumb_bob", (0.0,) * 5, 554.0, 1.2, roll_rad=math.radians(3.0)),
    "plumb_bob, roll": Lens(
        "plumb_bob", (-0.3, 0.1, 0.0, 0.0, 0.0), 400.0, 1.6, roll_rad=math.radians(-3.0), pitch_rad=0.1
    ),
}
"""Cameras above 60 degrees wide look down by some degrees, so that the horizon is off their axis, where lines bend."""


def drive_through(lens: Lens, *, seed: int = 3, n_frames: int = 20, road: str = "good") -> RoadDrive:
    """A drive at 10 Hz, rendered for a lens."""
    config = RoadDriveConfig(road=road, seed=seed, duration_s=(n_frames - 1) / 10.0, rate_hz=10.0)
    return plan_road_drive(config, lens.source)
