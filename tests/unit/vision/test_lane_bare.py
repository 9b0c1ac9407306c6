"""A straight road at 25 m/s on which the paint of a line ends. Its frames are drawn here, lines where they are told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.method import LaneFit, LaneFrame

SPEED_MPS, STEP_S = 25.0, 0.1
WIDTH_M = 3.5
PAINT_M, FAR_M = 0.15, 80.0
CAMERA = Camera(480, 270, 416.0, 416.0, 239.5, 134.5, mounting=Mounting(height_m=1.4, pitch_rad=0.02))
HORIZON_PX = float(CAMERA.horizon_v_px())
OLD_RIGHT = 1
"""Of the lines, from right to left."""
CHANGE_S = (5.0, 9.0)


def picture(lines_m: list[float], yaw_rad: float, seed: int) -> np.ndarray:
    """White lines on asphalt under a grey sky, with grain: `lines_m` beside the camera, left positive."""
    grey = np.full((CAMERA.height_px, CAMERA.width_px), 85.0)
    grey[: int(HORIZON_PX)] = 180.0
    u = np.arange(CAMERA.width_px)
    for v in range(int(HORIZON_PX) + 2, CAMERA.height_px):
        x_m = CAMERA.fy * CAMERA.mounting.height_m / (v - HORIZON_PX)
        for y_m in lines_m if x_m <= FAR_M else []:
            centre = CAMERA.cx - CAMERA.fx * (y_m / x_m - np.tan(yaw_rad))
            half = max(0.5 * PAINT_M * CAMERA.fx / x_m, 0.35)
            share = np.clip(half + 0.5 - np.abs(u - centre), 0.0, 1.0)
            grey[v] = grey[v] * (1.0 - share) + 220.0 * share
    grain = np.random.default_rng(seed).normal(0.0, 3.0, grey.shape)
    return np.asarray(np.clip(grey + grain, 0, 255).astype(np.uint8))


@dataclass(frozen=True)
class Moment:
    """What is true of a frame.

    Attributes:
        lines_m: The painted lines from the camera, left positive.
        yaw_rad, yaw_rate_radps: The car's direction along the road, and how it turns.
    """

    lines_m: list[float]
    yaw_rad: float = 0.0
    yaw_rate_radps: float = 0.0


def driven(moment: Callable[[float], Moment], seconds: float) -> list[LaneFit]:
    search, fits = LaneTracker(), []
    for number in range(round(seconds / STEP_S)):
        now = moment(number * STEP_S)
        grey = picture(now.lines_m, now.yaw_rad, number)
        stamp_ns = 10**18 + number * 10**8
        fits.append(search.step(LaneFrame(grey, CAMERA, stamp_ns, number, SPEED_MPS, now.yaw_rate_radps)))
    return fits


def change_to_the_left(time_s: float) -> Moment:
    """One lane in four seconds along a sine; the line to the right of the car ends one second before."""
    begin, end = CHANGE_S
    turn, duration_s = 2.0 * np.pi, end - begin
    part = min(max((time_s - begin) / duration_s, 0.0), 1.0)
    offset_m = WIDTH_M * (part - np.sin(turn * part) / turn)
    sideways_mps = WIDTH_M * (1.0 - np.cos(turn * part)) / duration_s
    sideways_mps2 = WIDTH_M * turn * np.sin(turn * part) / duration_s**2
    lines_m = [(k - 1.5) * WIDTH_M - offset_m for k in range(4) if k != OLD_RIGHT or time_s < begin - 1.0]
    return Moment(lines_m, sideways_mps / SPEED_MPS, sideways_mps2 / SPEED_MPS)


def right_m(fit: LaneFit) -> float:
    """Where the right boundary lies 8 m ahead, left positive."""
    v = HORIZON_PX + CAMERA.fy * CAMERA.mounting.height_m / 8.0
    column = float(fit.right.x_px(np.array([CAMERA.height_px - v]))[0]) - 1.0
    return (CAMERA.cx - column) * 8.0 / CAMERA.fx


def test_a_lane_that_one_line_holds_is_left_once() -> None:
    """The car is over the line at 7 s, and in the next lane when it is 0.55 lanes over: 2.1 m at 7.2 s."""
    fits = driven(change_to_the_left, 9.0)
    assert [(number, fit.lane_change) for number, fit in enumerate(fits) if fit.lane_change] == [(72, 1)]
    for number in range(72, 90):
        truth = change_to_the_left(number * STEP_S)
        assert abs(right_m(fits[number]) - (truth.lines_m[1] - 8.0 * truth.yaw_rad)) < 0.1
