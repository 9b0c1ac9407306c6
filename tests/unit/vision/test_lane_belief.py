"""How sure a boundary is: by hand, on noise, and on roads without paint."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from cwcli.signals.columns import FloatArray
from cwcli.signals.lane_geometry import Pinhole
from cwcli.vision.boundary_probability import (
    BOUNDARY_LOG_ODDS_WEIGHTS,
    FIRST_FRAME_LOG_ODDS_WEIGHTS,
    PROBABILITY_OF_OTHER_LINE_IN_FIRST_FRAME,
    PROBABILITY_OF_WELL_SEEN_OTHER_LINE,
    boundary_probabilities,
    first_frame_boundary_probabilities,
    left_and_right_paint_shares,
    probability_features_of_left_and_right,
    road_clutter_share,
)
from cwcli.vision.camera import Camera, Mounting, default_camera
from cwcli.vision.lane_detect import StripeEvidence
from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.method import LaneFrame
from tests.set_frames import render_set_frame
from tests.studies.lane_reliability import drawn
from tests.unit.vision.lane_scene import mounted

STEP_NS = 100_000_000
LANE = np.array([159.5, 0.0, 1.0, 0.0, 80.0, 0.0])
"""Straight ahead, its boundaries h / 2 to each side."""


def evidence(sharp: FloatArray) -> StripeEvidence:
    table = np.ascontiguousarray(sharp, np.float32)
    rows = np.arange(100, 100 + len(table), dtype=np.int32)
    return StripeEvidence(rows, table, table, table, 80.0, 7.0, Pinhole(159.5, 300.0, 1.0))


def test_crowd_by_hand() -> None:
    table = np.zeros((90, 320))
    assert road_clutter_share(evidence(table), LANE) == 0.0
    assert road_clutter_share(evidence(table + 0.3), LANE) == 1.0
    table[:, :160] = 0.2  # all that lies left of the middle
    assert road_clutter_share(evidence(table), LANE) == pytest.approx(0.5, abs=0.02)
    painted = np.zeros((90, 320))
    h = np.arange(20.0, 110.0)
    for place in (-1.5, -0.5, 0.5, 1.5):  # boundaries are no crowd
        u = np.round(159.5 + place * h).astype(int)
        painted[np.flatnonzero((u >= 0) & (u < 320)), u[(u >= 0) & (u < 320)]] = 1.0
    assert road_clutter_share(evidence(painted), LANE) < 0.02


def test_probability_by_hand() -> None:
    table = np.zeros((90, 320))
    table[:, :160] = 0.2
    seen = evidence(table)
    own = math.sqrt(left_and_right_paint_shares(seen, LANE)[0])
    by_hand = BOUNDARY_LOG_ODDS_WEIGHTS @ [1.0, own, math.log(0.4 + 0.02), math.sqrt(road_clutter_share(seen, LANE))]
    assert boundary_probabilities(seen, LANE, 0.4)[0] == pytest.approx(
        (1.0 - PROBABILITY_OF_WELL_SEEN_OTHER_LINE) / (1.0 + math.exp(-by_hand))
    )
    for votes, off in ((0.6, 0.0), (0.33, 0.0), (0.33 - 1.0 / 22.0, 1.0), (0.0, 7.26)):
        assert boundary_probabilities(seen, LANE, 0.4, vote_share=votes)[0] == pytest.approx(
            (1.0 - PROBABILITY_OF_WELL_SEEN_OTHER_LINE) / (1.0 + math.exp(off - by_hand))
        )
    features = probability_features_of_left_and_right(seen, LANE, -1e30)
    np.testing.assert_array_equal(np.array(features)[:, 2], math.log(0.02))


def test_of_a_carried_boundary_its_own_paint_alone_tells() -> None:
    """The right one shows nothing: z = 20.09 + 7.47 ln 0.02 - 44.19 sqrt(crowd), at most -9.1."""
    table = np.zeros((90, 320))
    table[:, :160] = 0.2
    seen = evidence(table)
    assert left_and_right_paint_shares(seen, LANE)[1] == 0.0
    by_hand = BOUNDARY_LOG_ODDS_WEIGHTS @ [1.0, 0.0, math.log(0.02), math.sqrt(road_clutter_share(seen, LANE))]
    told = boundary_probabilities(seen, LANE, 0.4, 1)
    assert told[0] == boundary_probabilities(seen, LANE, 0.4)[0]
    assert told[1] == pytest.approx((1.0 - PROBABILITY_OF_WELL_SEEN_OTHER_LINE) / (1.0 + math.exp(-by_hand)))
    own = left_and_right_paint_shares(seen, LANE)[0]  # of a lane both of whose boundaries are like this one
    assert boundary_probabilities(seen, LANE, 9.0, 0)[0] == boundary_probabilities(seen, LANE, 2.0 * own)[0]


def test_rivals_of_a_first_frame_take_their_shares_by_hand() -> None:
    """The second lane is worse by 0.12, so it counts exp(-1), and has other lines; the third shares the left line."""
    seen = evidence(np.zeros((90, 320)))
    beside, wider = LANE.copy(), LANE.copy()
    beside[1] += 0.3
    wider[1:3] = 0.25, 1.5  # the left boundary stays at -0.5
    z = FIRST_FRAME_LOG_ODDS_WEIGHTS @ [1.0, math.log(0.4 + 0.02), 0.0, 0.2 - 0.33, 0.0]
    most = 1.0 - PROBABILITY_OF_OTHER_LINE_IN_FIRST_FRAME
    for lanes, values, weights in (
        ([LANE], [0.4], (0.0, 0.0)),
        ([LANE, beside], [0.4, 0.28], (math.exp(-1.0), math.exp(-1.0))),
        ([LANE, beside, wider], [0.4, 0.28, 0.4], (math.exp(-1.0), 1.0 + math.exp(-1.0))),
    ):
        told = first_frame_boundary_probabilities(seen, np.array(lanes), np.array(values), 0.2, 190)
        assert told == pytest.approx([most / (1.0 + (1.0 + weight) * math.exp(-z)) for weight in weights])


def test_what_looks_like_stripes_everywhere_is_no_boundary() -> None:
    assert BOUNDARY_LOG_ODDS_WEIGHTS[1] > 0.0
    assert BOUNDARY_LOG_ODDS_WEIGHTS[2] > 0.0
    assert BOUNDARY_LOG_ODDS_WEIGHTS[3] < 0.0


@pytest.mark.parametrize("camera", [mounted(), default_camera(320, 240, Mounting())])
@pytest.mark.parametrize("sigma", [8.0, 30.0, 70.0])
@pytest.mark.parametrize("grain_px", [0.0, 1.5])
def test_noise_is_no_lane(camera: Camera, sigma: float, grain_px: float) -> None:
    search, rng = LaneTracker(), np.random.default_rng(3)
    for index in range(4):
        noise: np.ndarray = rng.normal(size=(240, 320))
        if grain_px:
            noise = cv2.GaussianBlur(noise, (0, 0), grain_px)
        grey = np.clip(120.0 + sigma / noise.std() * noise, 0, 255).astype(np.uint8)
        fit = search.step(LaneFrame(grey, camera, index * STEP_NS, index))
        assert not fit.left.found
        assert not fit.right.found


def test_roads_without_paint_have_hardly_a_boundary() -> None:
    found = []
    for made in drawn("bare", 20, 104):
        fit = LaneTracker().step(LaneFrame(made.grey, mounted(), 0, 0))
        found += [fit.left.found, fit.right.found]
    assert np.mean(found) <= 0.15


def test_painted_roads_have_both() -> None:
    for index in range(10):
        fit = LaneTracker().step(LaneFrame(render_set_frame("complex", index, seed=6).grey, mounted(), 0, 0))
        assert fit.left.found
        assert fit.right.found
