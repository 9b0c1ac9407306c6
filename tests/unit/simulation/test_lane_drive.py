"""The simulated lane against closed forms: a steady turn, the preview point on a circle, the noise of the camera."""

import numpy as np
import pytest

from cwcli.dynamics.single_track import steady_lateral_speed_and_yaw_rate, understeer_gradient_rad_per_mps2
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.simulation.drivers import TargetLineDriver
from cwcli.simulation.lane_camera import LaneSensorNoise, simulate_lane_sensors_of_run
from cwcli.simulation.lane_drive import LaneRuns, Road, simulate_lane_runs
from tests.unit.dynamics.true_lane import true_lane_at_preview

CAR = load_vehicle()
CALM = TargetLineDriver(unrest_mps2=0.0)
RADIUS_M = 400.0
CIRCLE = Road(np.array([0.0]), np.array([1.0 / RADIUS_M]))


def test_a_circle_is_driven_in_the_steady_state() -> None:
    truth = simulate_lane_runs(
        CIRCLE, CAR, LaneRuns(np.array([25.0]), np.zeros(1), np.array([np.inf]), 0.0, 10.0), driver=CALM
    )
    steer = (CAR.wheelbase_m + understeer_gradient_rad_per_mps2(CAR) * 25.0**2) / RADIUS_M
    expected = steady_lateral_speed_and_yaw_rate(CAR, 25.0, steer)
    assert truth.steer_rad[-1, 0] == pytest.approx(steer, rel=1e-3)
    assert (truth.lateral_speed_mps[-1, 0], truth.yaw_rate_radps[-1, 0]) == pytest.approx(expected, rel=1e-3)
    assert abs(truth.offset_m[-1, 0]) < 0.01
    # On the circle around (0, R): the driven place is on it too.
    assert np.hypot(truth.x_m[-1, 0], truth.y_m[-1, 0] - RADIUS_M) == pytest.approx(
        RADIUS_M - truth.offset_m[-1, 0], abs=1e-3
    )


def test_the_preview_point_on_a_circle() -> None:
    truth = simulate_lane_runs(
        CIRCLE, CAR, LaneRuns(np.array([25.0]), np.zeros(1), np.array([np.inf]), 0.0, 5.0), driver=CALM
    )
    row = np.array([400])
    heading, offset = truth.heading_rad[400, 0], truth.offset_m[400, 0]
    # The lane's centre in the lane frame is x = R sin a, y = R (1 - cos a); turned by -heading it is 33.5 m ahead.
    angle = np.linspace(0.0, 0.2, 200_001)
    dx, dy = RADIUS_M * np.sin(angle), RADIUS_M * (1.0 - np.cos(angle)) - offset
    forward, left = np.cos(heading) * dx + np.sin(heading) * dy, -np.sin(heading) * dx + np.cos(heading) * dy
    at = int(np.argmin(np.abs(forward - 33.5)))
    expected = (-left[at], -(angle[at] - heading), -1.0 / RADIUS_M)
    assert tuple(true_lane_at_preview(truth, 0, row, CIRCLE, CAR)[0]) == pytest.approx(expected, abs=1e-4)


def test_a_camera_without_noise_sees_a_straight_lane_exactly() -> None:
    runs = LaneRuns(np.array([20.0]), np.array([0.3]), np.array([2.0]), 0.0, 6.0)
    truth = simulate_lane_runs(Road(), CAR, runs, driver=CALM)
    sensed = simulate_lane_sensors_of_run(truth, 0, Road(), CAR, noise=LaneSensorNoise(pixel_px=0.0))
    offset, heading = truth.offset_m[sensed.index, 0], truth.heading_rad[sensed.index, 0]
    np.testing.assert_allclose(sensed.left_body[:, 0], (1.8 - offset) / np.cos(heading), atol=1e-9)
    np.testing.assert_allclose(sensed.left_body[:, 1], -np.tan(heading), atol=1e-9)
    np.testing.assert_allclose(sensed.lanes.heading_deviation_rad, heading, atol=1e-9)
    np.testing.assert_allclose(sensed.left_body[:, 0] - sensed.right_body[:, 0], 3.6 / np.cos(heading), atol=1e-9)


def test_told_sigmas_are_those_of_the_noise() -> None:
    truth = simulate_lane_runs(
        Road(), CAR, LaneRuns(np.array([20.0]), np.zeros(1), np.array([np.inf]), 0.0, 200.0), driver=CALM
    )
    lanes = simulate_lane_sensors_of_run(truth, 0, Road(), CAR, seed=1).lanes
    pairs = (
        (lanes.lateral_deviation_m, lanes.lateral_sigma_m),
        (lanes.heading_deviation_rad, lanes.heading_sigma_rad),
        (lanes.curvature_1pm, lanes.curvature_sigma_1pm),
    )
    for values, sigma in pairs:
        assert sigma is not None
        assert np.std(values) == pytest.approx(sigma[0], rel=0.06)  # 2001 frames: 1.6 % at one sigma


def test_the_drift_has_the_rate_that_was_asked_for() -> None:
    runs = LaneRuns(np.full(2, 25.0), np.array([0.5, -0.2]), np.full(2, 2.0), 0.0, 9.0)
    truth = simulate_lane_runs(Road(), CAR, runs, driver=CALM)
    np.testing.assert_allclose(truth.approach_mps[-1], [0.5, -0.2], atol=0.03)
    np.testing.assert_allclose(truth.left_gap_m + truth.right_gap_m, 3.6 - CAR.width_m * np.cos(truth.heading_rad))


def test_the_same_seed_drives_the_same() -> None:
    runs = LaneRuns(np.array([25.0]), np.zeros(1), np.array([np.inf]), 0.0, 2.0)
    first, same, other = (simulate_lane_runs(CIRCLE, CAR, runs, seed=seed).offset_m for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, same)
    assert not np.array_equal(first, other)
