"""Pictures whose straight edges do not meet in one point: nothing is found, however much looks like paint."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from cwcli.vision.camera import Mounting, default_camera
from cwcli.vision.lane_detect import search_first_frame_at_vanishing_points
from cwcli.vision.lane_model import HORIZON, VANISHING, first_frame_prior
from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.method import LaneFit, LaneFrame
from cwcli.vision.vanishing import MIN_CLEAR_VANISHING_POINT_VOTE_SHARE, find_vanishing_points
from tests.set_frames import render_set_frame

CAMERA = default_camera(320, 240, Mounting())
SCENES = [render_set_frame("good", index).grey for index in range(0, 24, 2)]
N_FRAMES = 6


def watched(grey: np.ndarray) -> LaneFit:
    """What is found in the last of some equal frames."""
    search = LaneTracker()
    for k in range(N_FRAMES):
        fit = search.step(LaneFrame(grey, CAMERA, k * 100_000_000, k))
    return fit


def test_a_picture_that_stands_on_its_head_has_no_lane() -> None:
    for turned in (lambda grey: grey, lambda grey: np.ascontiguousarray(grey[::-1, ::-1])):
        fits = [watched(turned(grey)) for grey in SCENES]
        found = sum(fit.left.found + fit.right.found for fit in fits)
        assert found == (2 * len(SCENES) if turned(SCENES[0]) is SCENES[0] else 0)


def test_a_lane_tells_which_of_several_vanishing_points_is_right() -> None:
    """The shadow of a railing has more edges than three lines that meet in column 330 and row 140."""
    grey = np.full((360, 640), 90, np.uint8)
    for u in (-200, 100, 560):
        cv2.line(grey, (330, 140), (u, 359), 160, 3, cv2.LINE_AA)
    lines_alone = grey.copy()
    for k in range(7):
        for u in (200 + 40 * k, 216 + 40 * k):
            cv2.line(grey, (u, 150 + 28 * k), (u + 30, 171 + 28 * k), 40, 3, cv2.LINE_AA)
    assert len(find_vanishing_points(lines_alone, 320.0)) == 1
    first, *others = find_vanishing_points(grey, 320.0)
    assert abs(first.u_px - 330.0) > 100.0
    assert any(abs(each.u_px - 330.0) < 6.0 and abs(each.v_px - 140.0) < 4.0 for each in others)
    assert max(each.votes for each in others) <= first.votes < MIN_CLEAR_VANISHING_POINT_VOTE_SHARE
    camera = default_camera(640, 360, Mounting())
    lanes, _, _, votes = search_first_frame_at_vanishing_points(grey, camera, first_frame_prior(camera))
    assert lanes[0, HORIZON] == pytest.approx(140.0, abs=2.0)
    assert lanes[0, VANISHING] == pytest.approx(330.0, abs=6.0)
    assert votes < first.votes
