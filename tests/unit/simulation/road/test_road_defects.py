"""Ramps, bends, lane changes and marks on the road that are added to a drive on demand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.errors import UsageError
from cwcli.simulation.road.camera import wide_camera
from cwcli.simulation.road.car import OFFSET, YAW_RATE
from cwcli.simulation.road.defects import (
    LANE_CHANGE_DURATION_S,
    LaneChangingDriver,
    draw_lane_change_times_s,
    draw_ramp_curvature_1pm,
)
from cwcli.simulation.road.drive import RoadDrive, RoadDriveConfig, plan_road_drive

CAMERA = wide_camera(320, 180)
BASE = RoadDriveConfig(seed=3, duration_s=20.0, rate_hz=10.0)


def drive(**changes: float | str) -> RoadDrive:
    return plan_road_drive(replace(BASE, **changes), CAMERA)  # type: ignore[arg-type]


def test_a_ramp_by_hand() -> None:
    """10 m/s: straight for 60 m, 25 m of clothoid, 50 m of 0.4 rad/s / 10 m/s = 0.04 1/m, 25 m of clothoid."""
    stations = np.array([0.0, 60.0, 72.5, 85.0, 135.0, 147.5, 160.0])
    made = draw_ramp_curvature_1pm(stations, 0.4, 10.0, np.random.default_rng(0))
    np.testing.assert_allclose(np.abs(made), [0.0, 0.0, 0.02, 0.04, 0.04, 0.02, 0.0], atol=1e-12)


def test_the_car_goes_round_a_ramp_in_its_lane() -> None:
    made = drive(ramp_degps=25.0, speed_mps=10.0)
    states = made.states_at(made.time_s)
    assert np.degrees(np.abs(states[:, YAW_RATE])).max() == pytest.approx(25.0, abs=2.0)
    assert np.abs(states[:, OFFSET]).max() < 0.7


def test_a_lane_change_leads_to_the_next_lane_and_back() -> None:
    driver = LaneChangingDriver(wander_m=(0.0,), wander_s=(1.0,), wander_rad=(0.0,), lane_change_start_s=(5.0, 20.0))
    wishes = [
        driver.wanted_offset_m(time_s)
        for time_s in (5.0, 5.0 + LANE_CHANGE_DURATION_S / 2, 15.0, 20.0 + LANE_CHANGE_DURATION_S)
    ]
    assert wishes == pytest.approx([0.0, 1.8, 3.6, 0.0])


def test_the_truth_is_that_of_the_lane_in_which_the_camera_is() -> None:
    made = drive(lane_changes_per_min=4.0)
    truths = [made.lane_truth_at(index) for index in range(len(made))]
    width_m = made.scene.lane_width_m
    lanes = [round(truth.lane_m / width_m) for truth in truths]
    assert lanes[0] == 0
    assert max(lanes) == 1
    assert max(abs(truth.lateral_offset_m) for truth in truths) <= width_m / 2 + 1e-9
    crossing = lanes.index(1)
    near_m = np.array([1.0])
    before, after = truths[crossing - 1], truths[crossing]
    # The line that was the left boundary is now the right one, and in its place.
    assert after.boundary_y_m("right", near_m) == pytest.approx(before.boundary_y_m("left", near_m), abs=0.2)


def test_paint_lies_on_the_truth_of_the_next_lane() -> None:
    made = drive(lane_changes_per_min=4.0)
    index = next(
        i
        for i in range(len(made))
        if made.lane_truth_at(i).lane_m > 0.0 and abs(made.lane_truth_at(i).lateral_offset_m) < 0.3
    )
    frame = made.render_frame_at(index)
    rows = np.arange(120, 170)
    u = frame.truth.left_u_px[rows]  # beyond the second lane: a solid line
    inside = (u > 6) & (u < 313)
    assert inside.sum() > 10
    on = [frame.grey[row, round(column)] for row, column in zip(rows[inside], u[inside], strict=True)]
    off = [frame.grey[row, round(column) + 6] for row, column in zip(rows[inside], u[inside], strict=True)]
    assert np.median(on) > np.median(off) + 40


@pytest.mark.parametrize(
    "change",
    [{"bridges_per_km": 10.0}, {"slab_m": 5.0}, {"markings": "dots"}, {"bends_1pm": 0.01}, {"junctions": "exits"}],
)
def test_each_defect_changes_the_pictures_and_no_other_drive(change: dict[str, float | str]) -> None:
    plain, made = drive(), drive(**change)
    assert not all(np.array_equal(plain.render_frame_at(i).grey, made.render_frame_at(i).grey) for i in (0, 20, 40))
    again = drive(**change)
    assert np.array_equal(again.render_frame_at(20).grey, made.render_frame_at(20).grey)


def test_change_times_are_apart() -> None:
    times = draw_lane_change_times_s(4.0, 60.0, np.random.default_rng(1))
    assert len(times) == 4
    assert np.diff(times).min() >= LANE_CHANGE_DURATION_S
    assert draw_lane_change_times_s(0.0, 60.0, np.random.default_rng(1)) == ()


@pytest.mark.parametrize(
    "change", [{"markings": "snow"}, {"bends_1pm": 1.0}, {"ramp_degps": -1.0}, {"lane_changes_per_min": 60.0}]
)
def test_what_is_out_of_range_is_refused(change: dict[str, float | str]) -> None:
    with pytest.raises(UsageError):
        drive(**change)
