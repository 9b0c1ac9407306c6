"""The default lane method on rendered frames and drives, and on frames that show no lane."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from cwcli.metrics.lane_scores import VISUAL_STANDARD_MIN_ROW_SHARE
from cwcli.reproduction.zhang2011.rendered import camera_with_pitch_error
from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.camera import camera_of_zhang2011, wide_camera
from cwcli.simulation.road.drive import RoadDriveConfig, plan_road_drive
from cwcli.vision import lane_tracker
from cwcli.vision.camera import Camera, Mounting, default_camera
from cwcli.vision.ground import compute_lane_geometry
from cwcli.vision.lane_covariance import propagate_covariance_to_fit
from cwcli.vision.lane_following import (
    curvature_candidates,
    lane_change_left_1_right_minus_1,
    narrow_prior_table,
    predict_lane_at_next_frame,
    prior_of_followed_lane,
    prior_with_driven_curvature,
    shift_to_adjacent_lane,
)
from cwcli.vision.lane_hypotheses import LaneHypothesis, add_or_merge_hypothesis
from cwcli.vision.lane_model import (
    BEND,
    HIGH,
    LOW,
    MEAN,
    MIDDLE,
    SIGMA,
    SPIRAL,
    WIDTH,
    boundary_columns_in_rows_px,
    first_frame_prior,
    fit_boundary_parabolas,
    is_same_lane_in_image,
    pinhole_of_camera,
    pitch_from_horizon_rad,
)
from cwcli.vision.lane_tracker import LaneTracker, search_size
from cwcli.vision.method import LaneFit, LaneFrame, LaneState
from cwcli.vision.methods import DEFAULT_METHOD, METHODS
from cwcli.vision.vanishing import find_vanishing_points
from tests.set_frames import render_set_frame
from tests.studies.lane_drives import places_m, planned, watched
from tests.unit.vision.fake_frames import encoded
from tests.unit.vision.fit_lists import columns_of
from tests.unit.vision.lane_scene import mounted, score
from tests.unit.vision.scenes import LEFT, RIGHT, road_image

STEP_NS = 100_000_000


def alone(grey: np.ndarray, camera: Camera) -> LaneFit:
    return LaneTracker().step(LaneFrame(grey, camera, 0, 0))


def test_it_is_the_default() -> None:
    assert DEFAULT_METHOD == "cwcli"
    assert METHODS["cwcli"].uses_motion


@pytest.mark.parametrize(("name", "n", "least"), [("good", 30, 30), ("complex", 40, 39)])
def test_rendered_frames_alone(name: str, n: int, least: int) -> None:
    """The whole sets: docs/lanes.md."""
    right = 0
    for index in range(n):
        made = render_set_frame(name, index)
        right += score(alone(made.grey, mounted()), made.truth).is_correct
    assert right >= least


def test_without_calibration_or_mounting() -> None:
    right = 0
    for index in range(15):
        made = render_set_frame("good", index, seed=7)
        fit = alone(made.grey, default_camera(320, 240, Mounting()))
        right += score(fit, made.truth).is_correct
        horizon_px = default_camera(320, 240, Mounting()).horizon_row_px(np.array(fit.pitch_rad))
        truth_px = made.truth.camera.cy - made.truth.camera.fy * math.tan(made.truth.camera.pitch_rad)
        assert horizon_px == pytest.approx(truth_px, abs=6.0)
    assert right >= 14


def test_the_same_fits_on_every_run() -> None:
    made = [render_set_frame("complex", index).grey for index in range(4)]

    def fits() -> list[LaneFit]:
        search = LaneTracker()
        return [search.step(LaneFrame(grey, mounted(), k * STEP_NS, k)) for k, grey in enumerate(made)]

    np.testing.assert_array_equal(columns_of(fits()).parabolas, columns_of(fits()).parabolas)


def test_a_drive_is_followed_with_and_without_motion() -> None:
    config = RoadDriveConfig(weather="rain", road="complex", seed=5, duration_s=2.0, rate_hz=10.0)
    drive = plan_road_drive(config, camera_of_zhang2011())
    for speed_mps in (25.0, math.nan):
        search = LaneTracker()
        fits = []
        for index in range(len(drive)):
            made = drive.render_frame_at(index)
            fit = search.step(LaneFrame(made.grey, mounted(), index * STEP_NS, index, speed_mps, 0.0 * speed_mps))
            fits.append(fit)
            assert score(fit, made.truth).is_correct
        width_m = compute_lane_geometry(columns_of(fits), mounted(), preview_m=33.5).lane_width_m
        np.testing.assert_allclose(width_m, drive.lane_truth_at(0).lane_width_m, rtol=0.05)


@pytest.mark.parametrize("size", [(32, 32), (320, 240), (640, 32), (33, 400)])
@pytest.mark.parametrize("pitch_rad", [0.0, 0.05, 0.9, -0.9])
def test_frames_that_show_nothing(size: tuple[int, int], pitch_rad: float) -> None:
    width, height = size
    camera = Camera(width, height, width, width, width / 2, height / 2, mounting=Mounting(pitch_rad=pitch_rad))
    ramp = np.broadcast_to(np.arange(width) % 256, (height, width)).astype(np.uint8)
    for grey in (np.zeros((height, width), np.uint8), np.full((height, width), 255, np.uint8), ramp):
        search = LaneTracker()
        for index in range(12):
            fit = search.step(LaneFrame(grey, camera, index * STEP_NS, index, 20.0, 0.1))
            assert not fit.left.found
            assert not fit.right.found
            assert math.isnan(fit.pitch_rad)


@pytest.mark.parametrize("grey", [20, 90, 180])
def test_sensor_noise_on_a_plain_road_is_no_lane(grey: int) -> None:
    noisy = np.clip(np.random.default_rng(grey).normal(grey, 3.0, (240, 320)), 0, 255).astype(np.uint8)
    fit = alone(noisy, mounted())
    assert max(fit.left.probability, fit.right.probability) < 0.5


def test_a_lane_comes_after_darkness() -> None:
    search, made = LaneTracker(), render_set_frame("good", 1)
    for index in range(20):
        assert not search.step(LaneFrame(np.zeros((240, 320), np.uint8), mounted(), index * STEP_NS, index)).left.found
    seen = [search.step(LaneFrame(made.grey, mounted(), k * STEP_NS, k)) for k in range(20, 40)]
    assert score(seen[-1], made.truth).is_correct


def test_parabolas_of_a_straight_lane_are_its_lines() -> None:
    camera = mounted()
    lane = np.array([150.0, 0.1, 2.2, 0.0, 80.0, 0.0])
    v = np.array([100.0, 150.0, 230.0])
    for side, (a, b, c) in enumerate(fit_boundary_parabolas(lane, camera)):
        y = 240.0 - v
        assert a == pytest.approx(0.0, abs=1e-9)
        columns = boundary_columns_in_rows_px(lane, v, pinhole_of_camera(camera))[side]
        np.testing.assert_allclose(a * y**2 + b * y + c - 1.0, columns, atol=1e-6)
    assert camera.horizon_row_px(np.array(pitch_from_horizon_rad(lane, camera))) == pytest.approx(80.0)


def test_prediction_by_hand() -> None:
    camera = mounted()
    prior = first_frame_prior(camera)
    straight = np.array([camera.cx, 0.0, 2.2, 0.0, 80.0, 0.0])
    # 0.02 rad/s to the left for 0.1 s: the vanishing point moves 0.002 rad x 800 px to the right.
    made = predict_lane_at_next_frame(straight, camera, 20.0, 0.02, 0.1, prior)
    np.testing.assert_allclose(made - straight, [1.6, 0.0, 0.0, 0.0, 0.0, 0.0], atol=1e-9)
    # The lane points 0.01 rad to the right: after 2 m its middle is 0.02 m farther right, over 1.65 m of height.
    pointed = straight + np.array([8.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    made = predict_lane_at_next_frame(pointed, camera, 20.0, 0.0, 0.1, prior)
    assert made[1] == pytest.approx(0.02 / 1.65)
    # The camera beyond the left boundary is in the next lane.
    over = straight + np.array([0.0, 1.3, 0.0, 0.0, 0.0, 0.0])
    assert np.array_equal(predict_lane_at_next_frame(over, camera, math.nan, math.nan, 0.1, prior), over)
    assert lane_change_left_1_right_minus_1(over) == 1
    assert lane_change_left_1_right_minus_1(over * np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0])) == -1
    assert lane_change_left_1_right_minus_1(straight) == 0
    assert shift_to_adjacent_lane(over, 1)[1] == pytest.approx(1.3 - 2.2)


def test_vanishing_point_of_drawn_lines() -> None:
    grey = np.full((360, 640), 90, np.uint8)
    for u in (-200, 60, 300, 520, 900):
        cv2.line(grey, (330, 140), (u, 359), 160, 2, cv2.LINE_AA)
    point = find_vanishing_points(grey, 320.0)[0]
    assert point.v_px == pytest.approx(140.0, abs=4.0)
    assert point.u_px == pytest.approx(330.0, abs=6.0)
    assert find_vanishing_points(np.full((360, 640), 90, np.uint8), 320.0) == []


def test_vanishing_point_of_a_faint_picture() -> None:
    # A 14th of the lines' contrast above: 5 grey levels, as in haze.
    grey = np.full((360, 640), 90, np.uint8)
    for u in (-200, 60, 300, 520, 900):
        cv2.line(grey, (330, 140), (u, 359), 95, 2, cv2.LINE_AA)
    point = find_vanishing_points(grey, 320.0)[0]
    assert point.v_px == pytest.approx(140.0, abs=4.0)
    assert point.u_px == pytest.approx(330.0, abs=6.0)


def test_search_size_keeps_the_shape() -> None:
    assert search_size(1280, 720) == search_size(1920, 1080) == search_size(960, 540) == (640, 360)
    assert search_size(640, 480) == (554, 416)  # sqrt(230400 / (640 * 480)) = 0.8660
    assert search_size(640, 360) == (640, 360)
    assert search_size(320, 240) == (320, 240)


def test_the_lanes_that_a_first_frame_averages_are_no_rivals_of_their_mean() -> None:
    search, camera = LaneTracker(), default_camera(320, 240, Mounting())
    for number in range(3):  # drawn without perspective, so that lanes with several bends fit equally well
        jpeg = np.frombuffer(encoded(road_image(LEFT, RIGHT, seed=number), ".jpg"), np.uint8)
        grey = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE), np.uint8)
        fit = search.step(LaneFrame(grey, camera, number * STEP_NS, number))
        assert min(fit.left.probability, fit.right.probability) > 0.5  # a rival takes half of 0.97 or more


def test_a_new_camera_starts_anew() -> None:
    search, made = LaneTracker(), render_set_frame("good", 2)
    search.step(LaneFrame(made.grey, mounted(), 0, 0))
    other = replace(mounted(), mounting=Mounting(height_m=1.65, pitch_rad=0.0493))
    assert score(search.step(LaneFrame(made.grey, other, STEP_NS, 1)), made.truth).is_correct


def test_prior_of_a_first_frame_does_not_flatten_a_bend_that_is_followed() -> None:
    """The prior says straight on; a lane that bends by three of its sigmas is expected to go on bending."""
    camera = mounted()
    prior = first_frame_prior(camera)
    lane = prior.table[:, MEAN].copy()
    lane[BEND] = 3.0 * prior.table[BEND, SIGMA]
    assert narrow_prior_table(prior, lane, 0.1)[BEND, MEAN] == lane[BEND]


def test_lanes_that_bend_to_different_sides_do_not_coincide() -> None:
    """Both are the best near some place, but the first loses the road far ahead (from a rendered drive)."""
    wrong = np.array([147.5, -0.056, 2.131, 346.0, 80.6, 0.0])
    right = np.array([159.3, -0.071, 2.150, -156.0, 79.4, 0.0])
    assert not is_same_lane_in_image(wrong, right, 320, 240)
    assert is_same_lane_in_image(right, right + np.array([0.5, 0.003, -0.003, 10.0, 0.1, 0.0]), 320, 240)
    assert not is_same_lane_in_image(right, right + np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.0]), 320, 240)


def test_of_two_lanes_on_the_same_pixels_the_first_is_followed_unless_it_is_clearly_worse() -> None:
    """Without the margin a lane would jump to and fro between two that fit alike, which the yaw rate would feel."""
    lane = np.array([159.3, -0.071, 2.150, -156.0, 79.4, 0.0])
    for gain, expected in ((0.02, 0.9), (0.04, 0.94), (-0.5, 0.9)):
        followed = [LaneHypothesis(lane, 1.0, 0.9)]
        add_or_merge_hypothesis(followed, LaneHypothesis(lane + 0.001, 0.8, 0.9 + gain), (320, 240))
        assert [each.last_value for each in followed] == [pytest.approx(expected)]


def test_a_spiral_goes_on_by_hand() -> None:
    """0.001 1/m^2 to the right at 10 m/s: in 0.1 s the bend gains 0.001 1/m, and the lane turns by 0.0005 rad."""
    camera = mounted()
    lane = np.array([camera.cx, 0.0, 2.2, 0.0, 80.0, 0.001 * 800.0 * (800.0 * 1.65) ** 2 / 6.0])
    made = predict_lane_at_next_frame(lane, camera, 10.0, 0.0, 0.1, first_frame_prior(camera))
    gained = [800.0 * 0.0005, 0.0, 0.0, 0.001 * 800.0 * 800.0 * 1.65 / 2.0, 0.0, 0.0]
    np.testing.assert_allclose(made - lane, gained, atol=1e-9)


def test_other_bends_keep_the_near_row() -> None:
    camera = mounted()
    prior = prior_of_followed_lane(first_frame_prior(camera), camera, 10.0)
    lane = np.array([camera.cx, 0.1, 2.2, 200.0, 80.0, 900.0])
    wide = np.column_stack([np.zeros((6, 2)), np.full(6, -1e9), np.full(6, 1e9)])
    others = curvature_candidates(lane, prior, wide, 240)
    near_h, step = 0.6 * 160.0, 1e-3

    def column(each: np.ndarray, h: float) -> float:
        return float(each[0] + each[1] * h + each[3] / h + each[5] / h**2)

    for other in others:
        assert column(other, near_h) == pytest.approx(column(lane, near_h))
        slopes = [(column(each, near_h + step) - column(each, near_h - step)) / (2.0 * step) for each in (lane, other)]
        assert slopes[1] == pytest.approx(slopes[0], abs=1e-6)
    assert np.ptp(others[:, 5]) == pytest.approx(4.0 * prior.table[SPIRAL, SIGMA])
    kept = curvature_candidates(lane, prior, narrow_prior_table(prior, lane, 0.1, 0.8), 240)
    assert np.ptp(kept[:, MIDDLE]) <= 2.0 * 0.1 / 1.65 + 1e-9  # and the lane does not jump


@pytest.mark.parametrize("with_motion", [True, False])
def test_a_ramp_is_followed_from_its_beginning_to_its_end(with_motion: bool) -> None:
    """Radius 23 m, with spirals of 25 m: both boundaries where they are, to 0.2 m at 8 m, in every frame."""
    seen = watched(drive := planned("ramp", 200, 16.0), drive.iter_rendered_frames(), with_motion=with_motion)
    found, true = places_m(seen)
    assert np.abs(found - true).max() < 0.2
    assert (np.nan_to_num(seen.share, nan=1.0) >= VISUAL_STANDARD_MIN_ROW_SHARE).mean() > 0.99


def test_a_followed_lane_may_not_jump() -> None:
    """In 0.1 s at 0.8 m/s and 0.02 m beside: 0.1 m over 1.65 m of height."""
    camera = mounted()
    prior = prior_of_followed_lane(first_frame_prior(camera), camera, 25.0)
    lane = np.array([camera.cx, 0.1, 2.2, 0.0, 80.0, 0.0])
    table = narrow_prior_table(prior, lane, 0.1, 0.8)
    assert table[MIDDLE, [LOW, HIGH]] == pytest.approx([0.1 - 0.1 / 1.65, 0.1 + 0.1 / 1.65])


def test_a_ramp_is_looked_for_where_the_car_turns() -> None:
    camera = mounted()
    prior = prior_with_driven_curvature(
        first_frame_prior(camera), camera, 10.0, 0.4
    )  # to the left, K = -0.04 1/m to the right
    assert prior.table[BEND, MEAN] == pytest.approx(-0.04 * 800.0 * 800.0 * 1.65 / 2.0)
    assert prior.table[BEND, LOW] < prior.table[BEND, MEAN]
    assert prior_with_driven_curvature(first_frame_prior(camera), camera, 10.0, math.nan).table[BEND, MEAN] == 0.0


def test_a_lane_is_held_through_frames_that_do_not_show_it_and_then_lost() -> None:
    search, made = LaneTracker(), render_set_frame("good", 2)
    dark = np.full((240, 320), 60, np.uint8)
    fits = [search.step(LaneFrame(made.grey, mounted(), k * STEP_NS, k)) for k in range(10)]
    assert all(fit.state is LaneState.FOUND for fit in fits)
    assert [fit.steady_s for fit in fits] == pytest.approx([0.1 * k for k in range(10)])
    held = search.step(LaneFrame(dark, mounted(), 10 * STEP_NS, 10))
    assert held.state is LaneState.HELD
    assert score(held, made.truth).is_correct
    states = [search.step(LaneFrame(dark, mounted(), k * STEP_NS, k)).state for k in range(11, 30)]
    assert states[-1] is LaneState.LOST


def test_a_lane_that_comes_back_after_it_was_lost_is_found_anew() -> None:
    search, made = LaneTracker(), render_set_frame("good", 2)
    dark = np.full((240, 320), 60, np.uint8)
    for k in range(10):
        search.step(LaneFrame(made.grey, mounted(), k * STEP_NS, k))
    n = 10
    while search.step(LaneFrame(dark, mounted(), n * STEP_NS, n)).state is not LaneState.LOST:
        n += 1
    fits = [search.step(LaneFrame(made.grey, mounted(), k * STEP_NS, k)) for k in range(n + 1, n + 8)]
    found = [fit.steady_s for fit in fits if fit.state is not LaneState.LOST]
    assert found == pytest.approx([0.1 * k for k in range(len(found))])
    assert len(found) > 2


def test_a_lane_change_is_told_once_and_its_lines_stay_in_place(monkeypatch: pytest.MonkeyPatch) -> None:
    config = RoadDriveConfig(seed=3, duration_s=14.0, rate_hz=10.0, lane_changes_per_min=5.0)
    drive = plan_road_drive(config, wide_camera(320, 180))
    camera = camera_with_pitch_error(drive.camera)
    search, changes, measured = LaneTracker(), [], [False] * len(drive)

    def measure(*arguments: Any) -> FloatArray:
        measured[index] = True
        return propagate_covariance_to_fit(*arguments)

    monkeypatch.setattr(lane_tracker, "propagate_covariance_to_fit", measure)
    for index in range(len(drive)):
        made = drive.render_frame_at(index)
        fit = search.step(LaneFrame(made.grey, camera, index * STEP_NS, index, 25.0))
        changes.append(fit.lane_change)
    lanes = [round(drive.lane_truth_at(index).lane_m) for index in range(len(drive))]
    crossings = np.flatnonzero(np.diff(lanes)) + 1
    told = np.flatnonzero(changes)
    assert len(crossings) == 1
    assert [changes[k] for k in told] == [1]
    assert abs(told[0] - crossings[0]) <= 10  # a second
    assert measured[told[0]]  # the covariance of the lane that it came into
    assert sum(measured) < 0.4 * len(drive)
    assert fit.steady_s > 5.0


def test_a_lane_that_takes_anothers_place_has_its_own_covariance(monkeypatch: pytest.MonkeyPatch) -> None:
    search, made = LaneTracker(), render_set_frame("good", 2)
    measured: list[FloatArray] = []

    def measure(lane: FloatArray, *arguments: Any) -> FloatArray:
        measured.append(lane)
        return propagate_covariance_to_fit(lane, *arguments)

    monkeypatch.setattr(lane_tracker, "propagate_covariance_to_fit", measure)
    for k in range(3):
        fit = search.step(LaneFrame(made.grey, mounted(), k * STEP_NS, k))
    assert len(measured) == 1
    seen = search._hypotheses[0]
    aside = seen.lane.copy()
    aside[MIDDLE] += 0.5 * aside[WIDTH]
    search._hypotheses = [replace(seen, lane=aside, value=-1.0), replace(seen, value=1.0, better_s=9.0)]
    fit = search.step(LaneFrame(made.grey, mounted(), 3 * STEP_NS, 3))
    assert score(fit, made.truth).is_correct
    assert len(measured) == 2
    assert abs(measured[1][MIDDLE] - measured[0][MIDDLE]) < 0.1
