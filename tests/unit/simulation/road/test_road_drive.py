"""The drive: the car's motion against closed forms and against the frames' truth."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.dynamics.vehicle import load_vehicle
from cwcli.errors import UsageError
from cwcli.simulation.drivers import SwayingDriver
from cwcli.simulation.road.camera import camera_of_zhang2011
from cwcli.simulation.road.car import (
    BEARING,
    HEADING,
    LATERAL_SPEED,
    OFFSET,
    STATION,
    STEER,
    YAW_RATE,
    X,
    Y,
    times_and_states_of_drive_along_lane,
    understeer_factor_s2pm2,
)
from cwcli.simulation.road.drive import RoadDriveConfig, plan_road_drive

CAR = load_vehicle()
STILL = SwayingDriver(wander_m=(), wander_s=(), wander_rad=())


def test_understeer_is_the_papers() -> None:
    assert understeer_factor_s2pm2(CAR) == pytest.approx(0.000843, abs=5e-7)


def test_steady_bend_settles_at_the_papers_steady_state() -> None:
    # Radius 250 m at 20 m/s: gamma = v / R; v_y and steer from eq. 11 (corrected) with both rates zero.
    v, kappa = 20.0, 1 / 250
    _, states = times_and_states_of_drive_along_lane(lambda s: kappa, lambda t: v, STILL, 20.0, CAR)
    end = states[-1]
    gamma = v * kappa
    a = np.array([[-120000 / v, 60000.0], [60000 * 0.16 / v, 54000.0]])
    b = np.array([1215 * v * gamma + 60000 * (0.9 - 1.06) * gamma / v, 60000 * (0.9**2 + 1.06**2) * gamma / v])
    v_y, steer = np.linalg.solve(a, b)
    assert end[YAW_RATE] == pytest.approx(gamma, rel=0.01)
    assert end[STEER] == pytest.approx(steer, rel=0.02)
    assert end[LATERAL_SPEED] == pytest.approx(v_y, abs=0.02)
    assert abs(end[OFFSET]) < 0.35


def test_straight_road_without_sway_stays_straight() -> None:
    time_s, states = times_and_states_of_drive_along_lane(lambda s: 0.0, lambda t: 25.0, STILL, 3.0, CAR)
    np.testing.assert_allclose(states[:, STATION], 25.0 * time_s, atol=1e-9)
    np.testing.assert_allclose(states[:, [OFFSET, HEADING, YAW_RATE]], 0.0, atol=1e-12)


def test_map_track_and_lane_coordinates_tell_the_same_drive() -> None:
    # On a circle of the lane: the distance to the circle's centre gives the offset, the angle the station.
    kappa = 1 / 400
    _, states = times_and_states_of_drive_along_lane(lambda s: kappa, lambda t: 22.0, SwayingDriver(), 12.0, CAR)
    first = states[0]
    bearing = first[BEARING] - first[HEADING]  # of the lane at the start
    normal = np.array([-np.sin(bearing), np.cos(bearing)])
    centre = np.array([first[X], first[Y]]) + (400 - first[OFFSET]) * normal
    radius = np.hypot(states[:, X] - centre[0], states[:, Y] - centre[1])
    np.testing.assert_allclose(400 - radius, states[:, OFFSET], atol=1e-6)
    lane = states[:, BEARING] - states[:, HEADING] - bearing
    np.testing.assert_allclose(400 * lane, states[:, STATION], atol=1e-6)


def test_preview_deviation_follows_the_papers_kinematics() -> None:
    # eq. 20 for quantities that are positive to the left: dy/dt = v e - v_y - gamma D, de/dt = v K - gamma.
    drive = plan_road_drive(RoadDriveConfig(seed=2, duration_s=4.0, rate_hz=50.0), camera_of_zhang2011())
    preview = np.array([drive.lane_truth_at(i).lane_centre_at_preview(33.5) for i in range(len(drive))])
    states = drive.states_at(drive.time_s)
    y_left, direction, curvature = preview.T
    v = 25.0
    rate = np.gradient(y_left, drive.time_s)
    # The lane's centre at the preview point moves by the car's own motion and along the lane.
    expected = (
        v * np.tan(direction) - states[:, LATERAL_SPEED] - states[:, YAW_RATE] * (33.5 + y_left * np.tan(direction))
    )
    np.testing.assert_allclose(rate[2:-2], expected[2:-2], atol=0.01)
    turn = np.gradient(direction, drive.time_s)
    np.testing.assert_allclose(turn[2:-2], (v * curvature - states[:, YAW_RATE])[2:-2], atol=2e-3)


def test_drive_is_repeatable_and_frames_are_independent() -> None:
    config = RoadDriveConfig(weather="rain", seed=3, duration_s=1.0)
    one, two = (plan_road_drive(config, camera_of_zhang2011()) for _ in range(2))
    assert len(one) == 21
    two.render_frame_at(4)
    assert np.array_equal(one.render_frame_at(9).grey, two.render_frame_at(9).grey)
    assert np.array_equal(one.lane_truth_at(9).left_visible, one.render_frame_at(9).truth.left_visible)
    assert one.render_frame_at(0).truth.condition == "rain"


def test_lane_keeping_stays_in_the_lane() -> None:
    for seed in (1, 2, 3):
        drive = plan_road_drive(RoadDriveConfig(road="complex", seed=seed, duration_s=20.0), camera_of_zhang2011())
        assert np.abs(drive.fine_states[:, OFFSET]).max() < 0.6


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (RoadDriveConfig(weather="hail"), "no weather 'hail'"),
        (RoadDriveConfig(road="worst"), "no road 'worst'"),
        (RoadDriveConfig(duration_s=0.0), "the duration of 0 s"),
        (RoadDriveConfig(rate_hz=1000.0), "the rate of 1000 Hz"),
        (RoadDriveConfig(speed_mps=1.0), "the speed of 1 m/s"),
        (RoadDriveConfig(accel_mps2=-2.0), "the speed at the end of -15 m/s"),
    ],
)
def test_impossible_drives_are_refused(config: RoadDriveConfig, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        plan_road_drive(config, camera_of_zhang2011())
