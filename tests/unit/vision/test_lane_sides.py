"""Which of two lines leaves a lane, and what the other one keeps of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.lane_detect import lane_objectives, measure_stripe_evidence, sampled_road_rows
from cwcli.vision.lane_following import narrow_prior_table, prior_of_followed_lane
from cwcli.vision.lane_model import BEND, HIGH, LOW, MIDDLE, VANISHING, WIDTH, bend_px2_per_curvature, first_frame_prior
from cwcli.vision.lane_sides import (
    LEFT,
    NO_LINE,
    RIGHT,
    FrameStep,
    LinePairState,
    _update_line_comparison,
    initial_line_pair_state,
    lane_by_one_line_and_paint_share,
    lane_middle_places_ahead_m,
    prior_with_known_width,
    update_lane_and_line_state,
)
from tests.unit.vision import straight_road

CAMERA = Camera(480, 270, 400.0, 400.0, 240.0, 135.0, mounting=Mounting(height_m=1.25, pitch_rad=0.01))
PRIOR = first_frame_prior(CAMERA)
LANE = np.array([240.0, 0.0, 2.88, 0.0, 130.0, 0.0])
"""3.6 m wide, straight ahead."""


def settled() -> LinePairState:
    return replace(initial_line_pair_state(LANE), agreed_s=5.0)


def after(lanes: list[np.ndarray], driven_1pm: float, frames: int = 10) -> LinePairState:
    sides, both = settled(), np.stack(lanes)
    for _ in range(frames):
        apart_m = lane_middle_places_ahead_m(both[LEFT], PRIOR) - lane_middle_places_ahead_m(both[RIGHT], PRIOR)
        sides = _update_line_comparison(sides, both, apart_m, bend_px2_per_curvature(CAMERA) * driven_1pm, 0.1)
    return sides


def leaving_lane(slope: float, curvature_1pm: float) -> np.ndarray:
    """The lane that a line gives which turns away to the right: 0.02 rad and a bend."""
    made = LANE.copy()
    made[VANISHING] += slope * CAMERA.fx
    made[BEND] = curvature_1pm * bend_px2_per_curvature(CAMERA)
    return made


def test_places_are_metres_on_the_road() -> None:
    """0.5 m beside the camera, 0.02 rad and 0.001 1/m: 0.5 + 0.14 + 0.0245 m at 7 m, 0.5 + 0.5 + 0.3125 m at 25 m."""
    lane = leaving_lane(0.02, 0.001)
    lane[MIDDLE] = 0.5 * PRIOR.place_units_per_m
    made = lane_middle_places_ahead_m(lane, PRIOR) - lane_middle_places_ahead_m(LANE, PRIOR)
    np.testing.assert_allclose(made, [0.6645, 1.3125], atol=1e-9)


@pytest.mark.parametrize("side", [LEFT, RIGHT])
def test_the_line_that_bends_unlike_the_car_leaves(side: int) -> None:
    lanes = [LANE, LANE]
    lanes[side] = leaving_lane(0.02 if side == RIGHT else -0.02, 0.001 if side == RIGHT else -0.001)
    assert after(lanes, 0.0).leaving_side == side


def test_in_a_bend_the_straight_line_leaves() -> None:
    """Seen alone the right line is the odd one, but the car drives in its bend."""
    bend = leaving_lane(0.0, 0.001)
    sides = settled()
    bent = replace(sides, smoothed_bends_px2=np.full(2, bend[BEND]), lanes_by_line=np.stack([bend, bend]))
    both = np.stack([leaving_lane(-0.02, 0.0), bend])
    for _ in range(10):
        apart_m = lane_middle_places_ahead_m(both[LEFT], PRIOR) - lane_middle_places_ahead_m(both[RIGHT], PRIOR)
        bent = _update_line_comparison(bent, both, apart_m, float(bend[BEND]), 0.1)
    assert bent.leaving_side == LEFT


def test_parallel_lines_stay_and_a_line_that_is_back_is_no_longer_leaving() -> None:
    assert after([LANE, LANE], 0.0).leaving_side == NO_LINE
    sides = after([LANE, leaving_lane(0.02, 0.001)], 0.0)
    for _ in range(20):
        sides = _update_line_comparison(sides, np.stack([LANE, LANE]), np.zeros(2), 0.0, 0.1)
    assert sides.leaving_side == NO_LINE
    assert sides.greatest_bend_doubt_px2 == 0.0


def test_nothing_leaves_a_lane_that_has_just_been_found() -> None:
    both = np.stack([LANE, leaving_lane(0.02, 0.001)])
    made = _update_line_comparison(initial_line_pair_state(LANE), both, np.array([-1.0, -2.0]), 0.0, 0.1)
    assert made.leaving_side == NO_LINE


def test_the_width_is_that_of_the_last_seconds_and_then_stays() -> None:
    sides = initial_line_pair_state(LANE)
    for _ in range(11):
        sides = sides.with_updated_width(2.8, 0.1)
    assert sides.is_width_known
    assert sides.width == pytest.approx(2.8)
    table = prior_with_known_width(PRIOR, sides).table
    np.testing.assert_allclose(table[WIDTH, [LOW, HIGH]], [2.8 - 0.12, 2.8 + 0.12])
    assert prior_with_known_width(PRIOR, initial_line_pair_state(LANE)) is PRIOR


def test_a_wider_lane_takes_no_place_beside_a_taper() -> None:
    wider = LANE.copy()
    wider[WIDTH] += 0.3
    assert not settled().may_be_replaced_by(wider, PRIOR)
    assert settled().may_be_replaced_by(LANE, PRIOR)
    assert not replace(settled(), by_one_line_s=5.0).may_be_replaced_by(LANE, PRIOR)
    assert initial_line_pair_state(LANE).may_be_replaced_by(wider, PRIOR)


def test_a_lane_beyond_its_limits_is_kept_at_them() -> None:
    """A straight road with one line, the left one of a lane as far aside as one is followed; its width, 0.2 m more than
    in the frame before, puts its middle 0.1 m beyond."""
    camera = straight_road.CAMERA
    size, prior = (camera.width_px, camera.height_px), prior_of_followed_lane(first_frame_prior(camera), camera, 25.0)
    table, horizon_px = prior.table, straight_road.HORIZON_PX
    lane = np.array([camera.cx, 0.0, straight_road.WIDTH_M * prior.place_units_per_m, 0.0, horizon_px, 0.0])
    lane[MIDDLE] = table[MIDDLE, HIGH]
    grey = straight_road.picture([(0.5 * lane[WIDTH] - lane[MIDDLE]) / prior.place_units_per_m], 0.0, 0)
    evidence = measure_stripe_evidence(grey, sampled_road_rows(horizon_px + 5.0, size[1]), horizon_px, prior.pinhole)
    before = replace(initial_line_pair_state(lane), agreed_s=5.0, width=lane[WIDTH] + 0.2 * prior.place_units_per_m)
    found, sides = update_lane_and_line_state(before, evidence, lane, prior, 0.0, FrameStep(size, 0.1, 0.8))
    assert sides.carried_side == RIGHT
    assert sides.by_one_line_s == 0.1
    assert found[MIDDLE] == table[MIDDLE, HIGH]
    assert lane_objectives(evidence, found[None], table)[0] > -1.0


def test_a_lane_predicted_far_beyond_its_limits_is_sought_within_them() -> None:
    """In two numbers at once, so that no step of a search that moves one after the other leads back."""
    camera = straight_road.CAMERA
    size, prior = (camera.width_px, camera.height_px), prior_of_followed_lane(first_frame_prior(camera), camera, 25.0)
    table, horizon_px = prior.table, straight_road.HORIZON_PX
    grey = straight_road.picture([0.5 * straight_road.WIDTH_M], 0.0, 0)
    evidence = measure_stripe_evidence(grey, sampled_road_rows(horizon_px + 5.0, size[1]), horizon_px, prior.pinhole)
    lane = np.array([camera.cx, 0.0, straight_road.WIDTH_M * prior.place_units_per_m, 0.0, horizon_px, 0.0])
    lane[[VANISHING, BEND]] = 1.5 * table[[VANISHING, BEND], HIGH]
    made, _ = lane_by_one_line_and_paint_share(
        evidence, lane, narrow_prior_table(prior, lane, 0.1), size, LEFT, float(lane[WIDTH])
    )
    assert (made[[VANISHING, BEND]] <= table[[VANISHING, BEND], HIGH]).all()
