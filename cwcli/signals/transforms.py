"""Frames of reference in a log: the pose of each frame in its parent, and of a camera on the vehicle."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.signals.limits import MAX_COORDINATE_M

BODY_FRAME_NAMES = ("base_footprint", "base_link")
"""The names of the vehicle's frame, preferred first: on the road below it (REP-105), else that of the body."""
MAX_FRAME_TREE_ANCESTORS = 100
"""The largest number of ancestors that are followed in a tree of frames; chosen by hand against loops."""
MIN_COSINE_OF_CAMERA_LOOKING_AHEAD = 0.5
"""The least cosine (1) between the axes of camera and vehicle of a camera that looks ahead: 60 degrees. Chosen by
hand."""


@dataclass(frozen=True)
class Transform:
    """The pose of a frame of reference in its parent.

    Attributes:
        parent, child: Frame ids, without a leading slash.
        translation_m: x, y, z of the child's origin in the parent.
        rotation: Quaternion x, y, z, w that turns the child's axes into the parent's.
    """

    parent: str
    child: str
    translation_m: tuple[float, float, float]
    rotation: tuple[float, float, float, float]

    def parent_from_child_matrix(self) -> FloatArray:
        """Return parent from child, shape (4, 4). NaN if the quaternion has no direction, or the place is not on
        Earth."""
        x, y, z, w = self.rotation
        size = math.sqrt(x * x + y * y + z * z + w * w)
        matrix = np.eye(4)
        if not (0.0 < size < math.inf and all(abs(each) <= MAX_COORDINATE_M for each in self.translation_m)):
            return np.full((4, 4), np.nan)
        x, y, z, w = x / size, y / size, z / size, w / size
        matrix[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        matrix[:3, 3] = self.translation_m
        return matrix


def find_body_frame_and_transform(tree: Mapping[str, Transform], frame: str) -> tuple[str, FloatArray] | None:
    """Find the vehicle's frame for a frame: its name and (4, 4) body from frame; None where no path connects them.

    `base_footprint` is taken where the tree has it, whether above or below `base_link`.
    """
    up = _transforms_to_ancestors(tree, frame)
    for body in BODY_FRAME_NAMES:
        down = _transforms_to_ancestors(tree, body)
        common = next((name for name in up if name in down), None)
        if common is None or (body not in tree and body not in up):
            continue
        body_transform = np.linalg.inv(down[common]) @ up[common]
        if np.isfinite(body_transform).all():
            return body, body_transform
    return None


def find_carrying_body_frame_and_transform(tree: Mapping[str, Transform], frame: str) -> tuple[str, FloatArray] | None:
    """Find the vehicle's frame among a frame's ancestors: its name and (4, 4) body from frame; None where there is
    none.

    `base_link` itself does not count: many drivers stamp it on every message.
    """
    up = _transforms_to_ancestors(tree, frame)
    for body in BODY_FRAME_NAMES if frame not in BODY_FRAME_NAMES else ():
        if body in up and np.isfinite(up[body]).all():
            return body, up[body]
    return None


def _transforms_to_ancestors(tree: Mapping[str, Transform], frame: str) -> dict[str, FloatArray]:
    """Return (4, 4) ancestor from frame for each ancestor, by name, the frame itself first."""
    by_frame = {frame: np.eye(4)}
    at = frame
    while at in tree and len(by_frame) < MAX_FRAME_TREE_ANCESTORS:
        above = tree[at].parent
        if above in by_frame:
            break
        by_frame[above] = tree[at].parent_from_child_matrix() @ by_frame[at]
        at = above
    return by_frame


@dataclass(frozen=True)
class CameraPose:
    """The pose of a camera that looks ahead from the vehicle; angles as in REP-103.

    Attributes:
        height_m: Above the body frame's origin.
        lateral_m: Left of it.
        pitch_rad, yaw_rad, roll_rad: Nose down, counter-clockwise and right side down positive.
    """

    height_m: float
    lateral_m: float
    pitch_rad: float
    yaw_rad: float
    roll_rad: float


def camera_pose_from_matrix(body_from_camera: FloatArray) -> CameraPose | None:
    """Return a camera's pose from (4, 4) body from camera; None if it does not look ahead.

    The camera's frame is an optical one (z ahead, x to the right, y down) or has the body's axes (x ahead, y to the
    left, z up). Which one it is shows in where its z and x axes point, whatever its name says.
    """
    rotation = body_from_camera[:3, :3]
    if rotation[0, 2] > MIN_COSINE_OF_CAMERA_LOOKING_AHEAD and rotation[0, 2] > rotation[0, 0]:
        forward, left, up = rotation[:, 2], -rotation[:, 0], -rotation[:, 1]
    elif rotation[0, 0] > MIN_COSINE_OF_CAMERA_LOOKING_AHEAD:
        forward, left, up = rotation[:, 0], rotation[:, 1], rotation[:, 2]
    else:
        return None
    return CameraPose(
        height_m=float(body_from_camera[2, 3]),
        lateral_m=float(body_from_camera[1, 3]),
        pitch_rad=-math.asin(float(np.clip(forward[2], -1.0, 1.0))),
        yaw_rad=math.atan2(float(forward[1]), float(forward[0])),
        roll_rad=math.atan2(float(left[2]), float(up[2])),
    )
