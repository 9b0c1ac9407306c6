"""Frames that are no good picture of a road: nothing is found in them, or what is found is right."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from cwcli.logs.read.reader import Log
from cwcli.metrics.lane_scores import (
    VISUAL_REFERENCE_IMAGE_WIDTH_PX,
    VISUAL_STANDARD_COLUMN_TOLERANCE_PX,
    VISUAL_STANDARD_MIN_ROW_SHARE,
    share_of_rows_within_tolerance,
)
from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.camera import wide_camera
from cwcli.simulation.road.drive import RoadDriveConfig, plan_road_drive
from cwcli.stages.lanes import LanesConfig, lanes
from cwcli.vision.camera import Mounting, default_camera
from cwcli.vision.lane_tracker import LaneTracker, search_size
from cwcli.vision.method import GreyImage, LaneFrame
from tests.studies.lane_halves import drawn
from tests.unit.vision.fake_frames import encoded
from tests.unit.vision.lane_logs import write_log

WIDTH_PX, HEIGHT_PX, N_FRAMES = 640, 360, 12
V, U = np.mgrid[:HEIGHT_PX, :WIDTH_PX].astype(np.float64)
Moved = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


@lru_cache
def road(rate_hz: float = 10.0) -> list[tuple[GreyImage, FloatArray]]:
    """Pictures and the columns (2, height) of the true boundaries in each row; NaN where there is none."""
    config = RoadDriveConfig(seed=3, duration_s=(N_FRAMES - 1) / rate_hz, rate_hz=rate_hz)
    frames = plan_road_drive(config, wide_camera(WIDTH_PX, HEIGHT_PX)).iter_rendered_frames()
    sides = ("left", "right")
    return [
        (
            each.grey,
            np.array(
                [np.where(getattr(each.truth, f"{k}_visible"), getattr(each.truth, f"{k}_u_px"), np.nan) for k in sides]
            ),
        )
        for each in frames
    ]


def interlaced(number: int) -> GreyImage:
    """Every other row is of the frame before."""
    made = road()[number][0].copy()
    made[1::2] = road()[max(number - 1, 0)][0][1::2]
    return made


def under_wiper(grey: GreyImage, number: int) -> GreyImage:
    """A dark blade with a bright edge, elsewhere in each frame."""
    angle = math.radians(165.0 - 13.0 * number)
    across = np.abs((U - WIDTH_PX / 2) * math.sin(angle) + (V - 1.1 * HEIGHT_PX) * math.cos(angle)) / WIDTH_PX
    return np.where(across < 0.03, 25, np.where(across < 0.036, 235, grey)).astype(np.uint8)


def with_bonnet(grey: GreyImage) -> GreyImage:
    """A dark bonnet with two bright stripes that point at the horizon."""
    made = grey.copy()
    cv2.ellipse(made, (320, 403), (384, 97), 0, 0, 360, 45, -1)
    for end in (250, 400):
        cv2.line(made, ((320 + end) // 2, 318), (end, 360), 220, 5)
    return made


def with_reflection(grey: GreyImage) -> GreyImage:
    """A phone on the dashboard, mirrored in the windscreen: a veil with bright edges beside the lane's middle."""
    made, screen = grey.astype(np.float64), np.array([[230, 198], [333, 191], [371, 353], [218, 356]], np.int32)
    veil, edges = np.zeros_like(made), np.zeros_like(made)
    cv2.fillPoly(veil, [screen], 45.0)
    cv2.polylines(edges, [screen], True, 90.0, 4)
    return np.clip(made + veil + cv2.GaussianBlur(edges, (0, 0), 1.0), 0, 255).astype(np.uint8)


def through_fisheye(grey: GreyImage) -> GreyImage:
    """A lens of r = f theta that no calibration tells."""
    focal = WIDTH_PX / 2 / math.tan(math.radians(30.0))
    x, y = (U - 319.5) / focal, (V - 179.5) / focal
    factor = np.tan(np.hypot(x, y)) / np.maximum(np.hypot(x, y), 1e-9)
    u, v = (focal * x * factor + 319.5).astype(np.float32), (focal * y * factor + 179.5).astype(np.float32)
    return np.asarray(cv2.remap(grey, u, v, cv2.INTER_LINEAR))


def lines_through_fisheye(lines: FloatArray) -> FloatArray:
    """Where that lens shows the boundaries, in each row of its picture."""
    focal, rows = WIDTH_PX / 2 / math.tan(math.radians(30.0)), np.arange(float(HEIGHT_PX))
    made = []
    for u_px in lines:
        x, y = (u_px - 319.5) / focal, (rows - 179.5) / focal
        factor = np.arctan(np.hypot(x, y)) / np.hypot(x, y)
        is_seen = np.isfinite(x)
        u, v = (focal * x * factor + 319.5)[is_seen], (focal * y * factor + 179.5)[is_seen]
        made.append(np.interp(rows, v, u, left=np.nan, right=np.nan))
    return np.array(made)


def judge(pictures: list[GreyImage], truths: list[FloatArray] | None, rate_hz: float = 10.0) -> tuple[int, int, float]:
    """How many boundaries are found, how many of them are wrong, and the greatest probability of a wrong one."""
    height, width = pictures[0].shape
    size = search_size(width, height)
    camera = default_camera(width, height, Mounting()).with_image_size(*size)
    search, n_found, wrong = LaneTracker(), 0, [0.0]
    for number, picture in enumerate(pictures):
        grey = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
        fit = search.step(LaneFrame(grey, camera, round(number * 1e9 / rate_hz), number))
        lines = drawn(fit, camera, np.arange(float(height)), height)
        for side, boundary in enumerate((fit.left, fit.right)):
            n_found += boundary.found
            true = np.full(height, np.nan) if truths is None else truths[number][side]
            share = share_of_rows_within_tolerance(
                lines[side],
                true,
                np.isfinite(true),
                tolerance_px=VISUAL_STANDARD_COLUMN_TOLERANCE_PX * width / VISUAL_REFERENCE_IMAGE_WIDTH_PX,
            )
            if boundary.found and not share >= VISUAL_STANDARD_MIN_ROW_SHARE:
                wrong.append(boundary.probability)
    return n_found, len(wrong) - 1, max(wrong)


@pytest.mark.parametrize("kind", ["black", "white", "overexposed", "noise"])
def test_nothing_is_found_where_no_road_is_in_sight(kind: str) -> None:
    rng = np.random.default_rng(0)
    changes: dict[str, Callable[[GreyImage], np.ndarray]] = {
        "black": np.zeros_like,
        "white": lambda grey: np.full_like(grey, 255),
        "overexposed": lambda grey: np.clip(2.0 * grey + 120.0, 0, 255),
        "noise": lambda grey: rng.integers(0, 256, grey.shape),
    }
    assert judge([changes[kind](grey).astype(np.uint8) for grey, _ in road()], None) == (0, 0, 0.0)


@pytest.mark.parametrize("is_upside_down", [True, False])
def test_in_a_picture_upside_down_or_through_a_dirty_lens_little_is_found_and_not_for_sure(
    is_upside_down: bool,
) -> None:
    """The search can't tell each such picture from a road: a few boundaries are found, at little above 0.5."""
    pictures = [
        np.ascontiguousarray(grey[::-1, ::-1])
        if is_upside_down
        else np.asarray(cv2.GaussianBlur(grey, (0, 0), 25.0), np.uint8)
        for grey, _ in road()
    ]
    n_found, _, probability = judge(pictures, None)
    assert n_found <= 4  # of 24
    assert probability < 0.7


@pytest.mark.parametrize(
    "kind", ["portrait", "letterbox", "fisheye", "interlaced", "wiper", "bonnet", "reflection", "grey cast"]
)
def test_the_lane_is_found_and_right_in_spite_of_what_is_odd(kind: str) -> None:
    pictures, truths = [grey for grey, _ in road()], [lines for _, lines in road()]
    if kind == "portrait":  # 9 : 16, the bottom corners with the nearest boundaries cut off
        pictures, truths = [grey[:, 219:421] for grey in pictures], [lines - 219.0 for lines in truths]
        truths = [np.where((lines >= 0.0) & (lines < 202.0), lines, np.nan) for lines in truths]
    elif kind == "letterbox":  # a camera held upright that records a wide picture between black bars
        pictures = [np.pad(grey, ((140, 140), (0, 0))) for grey in pictures]
        truths = [np.pad(lines, ((0, 0), (140, 140)), constant_values=np.nan) for lines in truths]
    elif kind == "fisheye":
        pictures, truths = list(map(through_fisheye, pictures)), list(map(lines_through_fisheye, truths))
    elif kind == "interlaced":
        pictures = [interlaced(number) for number in range(N_FRAMES)]
    elif kind == "wiper":
        pictures = [under_wiper(grey, number) for number, grey in enumerate(pictures)]
    else:
        change = {"bonnet": with_bonnet, "reflection": with_reflection, "grey cast": lambda grey: grey // 2 + 100}[kind]
        pictures = list(map(change, pictures))
    n_found, n_wrong, _ = judge([np.ascontiguousarray(each) for each in pictures], truths)
    assert n_wrong == 0
    assert n_found == 2 * N_FRAMES


def test_a_dashcam_of_four_frames_a_second_is_followed() -> None:
    pictures, truths = zip(*road(4.0), strict=True)
    assert judge(list(pictures), list(truths), 4.0) == (2 * N_FRAMES, 0, 0.0)


@pytest.mark.parametrize("cast", [(0.45, 0.9, 1.15), (1.2, 0.9, 0.6), (0.7, 1.1, 0.7)])
def test_white_lines_are_found_and_not_called_yellow_under_a_colour_cast(
    cast: tuple[float, float, float], tmp_path: Path
) -> None:
    """Blue, green, red: a sodium lamp, a blue windscreen, a wrong white balance."""
    pictures = [np.clip(grey[..., None] * np.array(cast), 0, 255).astype(np.uint8) for grey, _ in road()]
    with Log.open(write_log(tmp_path / "cast.mcap", [encoded(each, ".jpg") for each in pictures])) as log:
        table: Mapping[str, Any] = lanes(log, LanesConfig()).tables["lanes"].columns
    for side in ("left", "right"):
        assert np.all(table[f"{side}_found"])
        assert set(table[f"{side}_colour"]) == {"white"}
