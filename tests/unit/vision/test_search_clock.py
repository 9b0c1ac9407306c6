"""Which frames of a camera are searched, and what is said of the others."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from cwcli.logs.read.reader import Log
from cwcli.simulation.road.camera import wide_camera
from cwcli.simulation.road.drive import RoadDriveConfig, plan_road_drive
from cwcli.stages.lanes import LanesConfig, lanes
from cwcli.vision.frames import decode_frames
from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.method import LaneFit, LaneFrame, LaneState
from cwcli.vision.search_clock import SearchClock
from tests.set_frames import render_set_frame
from tests.unit.vision.fake_frames import FakeFrame, encoded
from tests.unit.vision.fit_lists import columns_of
from tests.unit.vision.lane_logs import write_log
from tests.unit.vision.lane_scene import mounted

SIZE = (640, 360)
SPEED_MPS = 20.0
FIRST_NS = 1_700_000_000_000_000_000


def searched(rate_hz: float, n: int = 13, *, is_every_frame: bool = False) -> list[int]:
    """Numbers of the frames of a camera that are searched."""
    clock = SearchClock(is_every_frame=is_every_frame)
    return [k for k in range(n) if clock.is_search_due(FIRST_NS + round(k * 1e9 / rate_hz), SIZE)]


@pytest.mark.parametrize(
    ("rate_hz", "every"), [(4.0, 1), (10.0, 1), (12.0, 1), (15.0, 1), (20.0, 1), (25.0, 1), (30.0, 2), (60.0, 4)]
)
def test_a_fast_camera_is_searched_at_least_every_70_ms(rate_hz: float, every: int) -> None:
    assert searched(rate_hz) == list(range(0, 13, every))
    assert searched(rate_hz, is_every_frame=True) == list(range(13))


def test_a_frame_is_searched_after_a_gap_a_step_back_and_a_change_of_size() -> None:
    clock = SearchClock()
    step_ns = 33_333_333
    assert [clock.is_search_due(FIRST_NS + k * step_ns, SIZE) for k in range(4)] == [True, False, True, False]
    assert clock.is_search_due(FIRST_NS + 4 * step_ns, SIZE)
    assert clock.is_search_due(FIRST_NS + 5 * step_ns, (320, 240))
    assert clock.is_search_due(FIRST_NS + 4 * step_ns, (320, 240))  # time goes back
    assert clock.is_search_due(FIRST_NS + 9 * step_ns, (320, 240))  # frames were dropped
    assert clock.is_search_due(FIRST_NS + 9 * step_ns, (320, 240))  # the same time again


def test_frames_between_two_searches_are_not_decoded() -> None:
    image = encoded(np.full((60, 80), 90, np.uint8), ".jpg")
    broken = image[:200] + b"\x00" * (len(image) - 202) + b"\xff\xd9"  # a header, and an end
    step_ns = 33_333_333
    data = [image if k % 2 == 0 else broken for k in range(7)]
    frames = [FakeFrame(each, log_time_ns=FIRST_NS + k * step_ns, stamp_ns=None) for k, each in enumerate(data)]
    decoded = list(decode_frames(frames, wanted_size_of=lambda *_: (80, 60), search_clock=SearchClock()))
    assert [each.is_skipped for each in decoded] == [k % 2 > 0 for k in range(7)]
    assert [each.image is None for each in decoded] == [k % 2 > 0 for k in range(7)]
    assert {(each.width_px, each.height_px, each.rejection_reason) for each in decoded} == {(80, 60, "")}
    assert [each.index for each in decoded] == list(range(7))


def test_what_is_no_image_is_rejected_also_between_two_searches() -> None:
    image = encoded(np.full((60, 80), 90, np.uint8), ".jpg")
    data = [image, b"no image", image[:100], image]
    frames = [FakeFrame(each, log_time_ns=FIRST_NS + k * 33_333_333, stamp_ns=None) for k, each in enumerate(data)]
    decoded = list(decode_frames(frames, wanted_size_of=lambda *_: (80, 60), search_clock=SearchClock()))
    assert [bool(each.rejection_reason) for each in decoded] == [False, True, True, False]


def followed(n: int) -> tuple[LaneTracker, LaneFit]:
    """A search that has seen n frames of a rendered lane, and the last fit."""
    scene, search = render_set_frame("good", 3), LaneTracker()
    for k in range(n):
        fit = search.step(LaneFrame(scene.grey, mounted(), k * 100_000_000, k, SPEED_MPS, 0.0))
    return search, fit


def test_a_lane_is_carried_as_the_car_moves() -> None:
    """The lane turns by the yaw rate times the time, away from the car's turn: u0 moves by fx times as much."""
    search, last = followed(3)
    straight = search.carry(250_000_000, SPEED_MPS, 0.0)
    turned = search.carry(250_000_000, SPEED_MPS, 0.1)  # to the left: the lane moves to the right
    assert straight.state == turned.state == LaneState.CARRIED
    assert straight.roads is not None
    assert turned.roads is not None
    np.testing.assert_allclose((turned.roads - straight.roads)[:, 0], mounted().fx * 0.1 * 0.05, rtol=0.02)
    assert (straight.left.probability, straight.right.probability) == (last.left.probability, last.right.probability)
    assert straight.steady_s == pytest.approx(last.steady_s + 0.05)


def test_a_lane_is_carried_as_it_moved_where_the_motion_is_not_known() -> None:
    """The picture moves by 2 pixels in 100 ms, so in 50 ms the lane's vanishing point moves by 1 pixel."""
    scene, search = render_set_frame("good", 3), LaneTracker()
    for k in range(5):
        fit = search.step(LaneFrame(np.roll(scene.grey, 2 * k, axis=1), mounted(), k * 100_000_000, k))
    carried = search.carry(450_000_000)
    assert fit.roads is not None
    assert carried.roads is not None
    np.testing.assert_allclose((carried.roads - fit.roads)[:, 0], 1.0, atol=0.3)
    np.testing.assert_allclose((carried.roads - fit.roads)[:, 1], 0.0, atol=0.01)


def test_a_search_does_not_depend_on_what_was_carried() -> None:
    scene = render_set_frame("good", 3)
    fits = []
    for is_carried in (False, True):
        search, _ = followed(3)
        if is_carried:
            search.carry(250_000_000, SPEED_MPS, 0.3)
        fits.append(search.step(LaneFrame(scene.grey, mounted(), 300_000_000, 3, SPEED_MPS, 0.0)))
    np.testing.assert_equal(asdict(fits[0]), asdict(fits[1]))


def test_no_lane_is_carried_where_none_was_found() -> None:
    search = LaneTracker()
    search.step(LaneFrame(np.zeros((240, 320), np.uint8), mounted(), 0, 0))
    fit = search.carry(33_000_000, SPEED_MPS, 0.0)
    assert (fit.left.found, fit.right.found, fit.state) == (False, False, LaneState.LOST)
    assert math.isnan(fit.steady_s)
    assert not columns_of([fit]).found.any()


def test_every_frame_of_a_fast_camera_has_a_lane(tmp_path: Path) -> None:
    config = RoadDriveConfig(duration_s=1.0, rate_hz=30.0, seed=5, speed_mps=20.0)
    drive = plan_road_drive(config, wide_camera(480, 270))
    frames = [cv2.imencode(".jpg", each.grey)[1].tobytes() for each in drive.iter_rendered_frames()]
    source = write_log(tmp_path / "fast.mcap", frames, step_ns=33_333_333)
    tables: dict[bool, Mapping[str, Any]] = {}
    for is_every in (False, True):
        with Log.open(source) as log:
            result = lanes(log, LanesConfig(every_frame=is_every))
        tables[is_every] = result.tables["lanes"].columns
        assert len(tables[is_every]["state"]) == len(frames)
        n_searched = {row[0]: row[1] for row in result.summary.sections[0].rows}["frames searched"]
        assert n_searched == (len(frames) if is_every else -(-len(frames) // 2))
    states = list(tables[False]["state"])
    assert [each == "carried" for each in states[1:]] == [k % 2 > 0 for k in range(1, len(frames))]
    assert "carried" not in list(tables[True]["state"])
    for side in ("left", "right"):
        apart = np.abs(np.asarray(tables[False][f"{side}_lateral_m"]) - np.asarray(tables[True][f"{side}_lateral_m"]))
        assert apart.max() <= 0.1  # m
