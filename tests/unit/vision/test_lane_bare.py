"""Drives at 25 m/s on a straight road on which the paint of a line ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.method import LaneFit, LaneFrame
from tests.unit.vision.straight_road import CAMERA, HORIZON_PX, WIDTH_M, picture

SPEED_MPS, STEP_S = 25.0, 0.1
OLD_RIGHT = 1
"""Of the lines, from right to left."""
CHANGE_S = (5.0, 9.0)


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


FARTHER_M = 0.85
"""The line that takes the place of the right one lies so much farther out."""


def wider_from(time_s: float, ends_s: float, begins_s: float) -> Moment:
    """A straight road; the line on the right ends, and another one begins farther out."""
    right = [-0.5 * WIDTH_M] if time_s < ends_s else []
    right += [-0.5 * WIDTH_M - FARTHER_M] if time_s >= begins_s else []
    return Moment([*right, 0.5 * WIDTH_M])


def test_a_boundary_without_paint_is_not_found() -> None:
    """The lane goes on by its left line; on the right it has the place that the right line had, and there is none."""
    fits = driven(lambda time_s: wider_from(time_s, 2.0, 2.0), 6.0)
    assert all(fit.left.found and fit.right.found for fit in fits[:20])
    assert all(fit.left.found for fit in fits)
    late = [fit.right for fit in fits[25:]]  # the belief forgets in 0.3 s
    assert not any(right.found for right in late)
    assert max(right.probability for right in late) < 0.1


def test_a_lane_goes_on_by_one_line_for_ten_seconds_at_most() -> None:
    """The new line begins 11 s after the old one's end: after ten seconds any other lane may be the right one."""
    fits = driven(lambda time_s: wider_from(time_s, 2.0, 13.0), 15.5)
    assert not any(fit.right.found for fit in fits[30:120])
    assert fits[-1].left.found
    assert fits[-1].right.found
    assert abs(right_m(fits[-1]) + 0.5 * WIDTH_M + FARTHER_M) < 0.1
