"""Clips made of real stills: each is moved as a driving car would see it, so its lanes' movement is known.

Below the horizon the picture moves by the ground's homography, above it by that of a rotation.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from cwcli.metrics.lane_scores import lanes_beside_ego
from cwcli.signals.columns import FloatArray
from cwcli.vision.camera import Camera, Mounting, default_camera
from cwcli.vision.lane_model import bend_px2_per_curvature
from cwcli.vision.lane_tracker import LaneTracker, search_size
from cwcli.vision.method import GreyImage, LaneFrame
from tests.studies.lane_halves import drawn, labelled
from tests.studies.real_clips import RATE_HZ, SECOND_NS, SHARED, SPEED_MPS, Shot, as_bytes

LABELLED = SHARED / "logs" / "tusimple-0313-dev.mcap"
STILLS = SHARED / "data" / "udacity_lanes"
STILL_FOLDERS = ("advanced_test_images", "p1_test_images")
STILL_S = 4.0
WEAVE_M, WEAVE_S = 0.3, 6.0
PITCH_RAD = 0.006
"""Of a body on its springs, about once a second."""
WAY_M = 8.0
"""Ahead and back again: a still has no more road in sight near by."""
NOISE_GREY = 3.0


@dataclass(frozen=True)
class Still:
    """A picture and its lane u = u0 + m h + k / h, h rows below the horizon.

    Attributes:
        name: Of the picture.
        grey: It.
        lane: u0, m of the left and of the right boundary, k, and the horizon; px.
        labels: Points (n, 2) of both boundaries where they were labelled; empty: they were not.
    """

    name: str
    grey: GreyImage
    lane: tuple[float, float, float, float, float]
    labels: tuple[FloatArray, FloatArray] | None


def lane_of_points(points: tuple[FloatArray, FloatArray], height_px: int) -> tuple[float, float, float, float, float]:
    """u0, m left, m right, k and the horizon that lie nearest to points on both boundaries, by least squares."""
    best = (math.inf, (0.0, 0.0, 0.0, 0.0, 0.0))
    top = min(float(each[:, 1].min()) for each in points)
    for horizon in np.arange(top - 0.12 * height_px, top - 2.0, 0.5):
        parts, right = [], []
        for side, each in enumerate(points):
            h = each[:, 1] - horizon
            part = np.zeros((len(h), 4))
            part[:, 0], part[:, 1 + side], part[:, 3] = 1.0, h, 1.0 / h
            parts.append(part)
            right.append(each[:, 0])
        design, wanted = np.concatenate(parts), np.concatenate(right)
        found, *_ = np.linalg.lstsq(design, wanted, rcond=None)
        miss = float(((design @ found - wanted) ** 2).sum())
        if miss < best[0]:
            best = miss, (*(float(value) for value in found), float(horizon))
    return best[1]


def read_stills() -> list[Still]:
    """The labelled frames, then the pictures without labels."""
    made = []
    for number, (frame, lanes, rows) in enumerate(labelled(LABELLED, lambda width, height: (width, height))):
        assert frame.image is not None
        height, width = frame.image.shape
        beside = lanes_beside_ego(lanes, rows, width, height)
        points = [np.column_stack([each, rows])[each >= 0.0] for each in beside]
        points = [each for each in points if len(each) >= 3]
        if len(points) == 2:
            points.sort(key=lambda each: float(each[:, 0].mean()))
            pair = points[0], points[1]
            made.append(Still(f"labelled {number}", np.array(frame.image), lane_of_points(pair, height), pair))
    return made + read_pictures()


def read_pictures() -> list[Still]:
    """The pictures without labels, whose lane is that which the default method finds."""
    made = []
    for folder in STILL_FOLDERS:
        for path in sorted((STILLS / folder).glob("*.jpg")):
            grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            assert grey is not None
            height, width = grey.shape
            camera = default_camera(width, height, Mounting()).with_image_size(*search_size(width, height))
            small = cv2.resize(grey, (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA)
            fit = LaneTracker().step(LaneFrame(small, camera, 0, 0))
            rows = np.arange(0.66 * height, height - 1.0, 8.0)
            lines = drawn(fit, camera, rows, height)
            found = [np.column_stack([line, rows])[np.isfinite(line)] for line in lines]
            name = f"{folder.split('_')[0]} {path.stem}"
            made.append(Still(name, grey, lane_of_points((found[0], found[1]), height), None))
    return made


def still_clip(still: Still, *, with_motion: bool, seed: int = 0) -> Iterator[Shot]:
    """The still as a car would see it that weaves about the lane's middle, pitches, and drives on and back again.

    Args:
        still: The picture.
        with_motion: Speed and yaw rate are told.
        seed: Of noise and of the movement's phases.
    """
    rng = np.random.default_rng([seed, sum(map(ord, still.name))])
    height, width = still.grey.shape
    camera = default_camera(width, height, Mounting())
    u0, left, right, bend, horizon = still.lane
    curvature_1pm = bend / bend_px2_per_curvature(camera)
    phase, pitch_phase = rng.uniform(0.0, 2.0 * math.pi, 2)
    omega = 2.0 * math.pi / WEAVE_S
    centre_m = 0.5 * (left + right) * camera.mounting.height_m * camera.fy / camera.fx
    direction = (u0 - camera.cx) / camera.fx
    rows = np.arange(float(height))
    for number in range(round(STILL_S * RATE_HZ)):
        time = number / RATE_HZ
        right_m = centre_m + WEAVE_M * math.sin(omega * time + phase)
        rate_mps = WEAVE_M * omega * math.cos(omega * time + phase)
        accel = -WEAVE_M * omega**2 * math.sin(omega * time + phase)
        heading = direction + rate_mps / SPEED_MPS  # to the right: the camera looks ahead along the lane
        pitch = PITCH_RAD * math.sin(2.0 * math.pi * 1.1 * time + pitch_phase)
        step = SPEED_MPS / RATE_HZ
        ahead_m = abs((number * step + WAY_M) % (2.0 * WAY_M) - WAY_M)
        turned, aside_m = curvature_1pm * ahead_m, 0.5 * curvature_1pm * ahead_m**2  # along the lane, as the car does
        place_m = right_m + direction * ahead_m + aside_m, ahead_m
        ground, far, now = _views(camera, horizon, pitch, heading + turned, place_m)
        grey = _seen(still.grey, ground)
        edge = min(max(math.ceil(now), 0), height)
        grey[:edge] = _seen(still.grey, far)[:edge]
        noise = rng.normal(0.0, NOISE_GREY, grey.shape).astype(np.float32)
        lines = _moved(still, ground, rows, horizon)
        shot = Shot(as_bytes(grey + noise), round(number * SECOND_NS / RATE_HZ), lines, now)
        if with_motion:
            yaw_rate = -accel / SPEED_MPS - curvature_1pm * SPEED_MPS
            shot = Shot(shot.grey, shot.stamp_ns, lines, now, SPEED_MPS, yaw_rate)
        yield shot


def _seen(grey: GreyImage, still_from_view: FloatArray) -> GreyImage:
    """The still through a map of pixels; beyond its edges goes on what is there."""
    size, how = (grey.shape[1], grey.shape[0]), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(grey, still_from_view, size, flags=how, borderMode=cv2.BORDER_REPLICATE))


def _views(
    camera: Camera, horizon_px: float, pitch_rad: float, heading_rad: float, place_m: tuple[float, float]
) -> tuple[FloatArray, FloatArray, float]:
    """Maps of the pixels of a moved camera to those of the still: on the road, and far away; and its horizon's row.

    Args:
        camera: The assumed one.
        horizon_px: Of the still.
        pitch_rad: More than the still's, nose down.
        heading_rad: To the right.
        place_m: To the right and ahead.
    """
    inside = camera.intrinsic_matrix()
    still_pitch = math.atan((camera.cy - horizon_px) / camera.fy)

    def level_from_camera(pitch: float) -> FloatArray:
        cos, sin = math.cos(pitch), math.sin(pitch)
        return np.array([[1.0, 0.0, 0.0], [0.0, cos, sin], [0.0, -sin, cos]])

    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    new = level_from_camera(still_pitch + pitch_rad)
    turned = level_from_camera(still_pitch).T @ turn @ new
    moved = level_from_camera(still_pitch).T @ np.array([place_m[0], 0.0, place_m[1]])
    normal = np.array([0.0, 1.0, 0.0]) @ new / camera.mounting.height_m
    back = np.linalg.inv(inside)
    now = camera.cy - camera.fy * math.tan(still_pitch + pitch_rad)
    return inside @ (turned + np.outer(moved, normal)) @ back, inside @ turned @ back, now


def _moved(still: Still, ground: FloatArray, rows: FloatArray, horizon_px: float) -> FloatArray:
    """Shape (2, height): the lane's boundaries in the moved picture."""
    u0, left, right, bend, _ = still.lane
    h = np.geomspace(4.0, 6.0 * len(rows), 400)
    made = []
    for near in (left, right):
        points = np.stack([u0 + near * h + bend / h, horizon_px + h, np.ones_like(h)])
        u, v, w = np.linalg.inv(ground) @ points
        ok = (w > 0) if np.count_nonzero(w > 0) >= np.count_nonzero(w < 0) else (w < 0)
        u, v = u[ok] / w[ok], v[ok] / w[ok]
        order = np.argsort(v)
        made.append(np.interp(rows, v[order], u[order], left=np.nan, right=np.nan))
    return np.array(made)
