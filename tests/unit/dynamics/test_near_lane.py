"""The preview point that the default observer takes, and what it makes of it on tight bends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.near_lane import (
    convert_sine_states_to_angles,
    move_lanes_to_nearer_preview,
    reference_to_actual_speed_ratio,
)
from cwcli.dynamics.observer import observe_lateral_motion
from cwcli.dynamics.samples import FrameStatus, LaneSamples, LateralTrack, ScalarSamples
from cwcli.dynamics.single_track import steady_lateral_speed_per_yaw_rate_m
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.prediction.lateral import predict_paths_from_observer
from cwcli.simulation.road.camera import wide_camera
from cwcli.simulation.road.car import HEADING, OFFSET, STATION, YAW_RATE
from cwcli.simulation.road.drive import RoadDrive, RoadDriveConfig, plan_road_drive
from cwcli.simulation.streams import seconds_to_ns

PREVIEW_M = 33.5
HALF_WIDTH_M = 1.8


def frames(*middles: tuple[float, float, float], change_1pm2: float = 0.0) -> LaneSamples:
    """Lanes of straight parallel lines, or concentric circles, about middles of slope 0 beside the camera."""
    n, nothing = len(middles), np.full(len(middles), np.nan)
    lines = np.array(
        [
            [(y + side, slope, curvature / (1.0 - curvature * side)) for side in (HALF_WIDTH_M, -HALF_WIDTH_M)]
            for y, slope, curvature in middles
        ]
    )
    sigmas = (np.full(n, 0.04), np.full(n, 0.003), np.full(n, 1e-4))
    stamp_ns = np.arange(n) * 100_000_000
    return LaneSamples(
        stamp_ns, nothing, nothing, nothing, *sigmas, lines=lines, curvature_change_1pm2=np.full(n, change_1pm2)
    )


def test_how_quickly_roads_bend_goes_with_the_speed() -> None:
    assert reference_to_actual_speed_ratio(np.array([30.0, 25.0, 12.5, -12.5, 5.0, 0.0, np.nan])).tolist() == [
        1,
        1,
        2,
        2,
        5,
        5,
        1,
    ]


def test_the_preview_point_is_nearer_where_the_car_is_slow_or_the_lane_turns() -> None:
    lanes = frames((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.5, 0.0, -0.02), (0.0, 0.0, 1.0 / 4.0))
    near, at_m, change = move_lanes_to_nearer_preview(lanes, np.array([25.0, 6.25, 25.0, 25.0]), PREVIEW_M, 0.0)
    # a quarter of the speed: an eighth of the distance; on 50 m the sine of 0.4 is at 20 m, on 4 m nearer than 2 m
    np.testing.assert_allclose(at_m, [33.5, 33.5 / 8.0, 20.0, 2.0])
    # 50 m to the right, 0.5 m to the left: y_L is right positive, e_L the sine, K_L right positive
    assert near.lateral_deviation_m[2] == pytest.approx(50.0 - np.sqrt(2100.0) - 0.5)
    assert near.heading_deviation_rad[2] == pytest.approx(0.4)
    assert near.curvature_1pm[2] == pytest.approx(0.02)
    assert change.tolist() == [0.0] * 4


def test_the_change_of_the_curvature_is_handed_on() -> None:
    near, at_m, change = move_lanes_to_nearer_preview(
        frames((0.0, 0.0, 0.01), change_1pm2=0.0008), np.array([12.5]), PREVIEW_M, 0.0
    )
    assert change.tolist() == [0.0008]
    assert near.curvature_1pm[0] == pytest.approx(-0.01 + 0.0008 * at_m[0])


@pytest.mark.parametrize(
    ("camera_forward_m", "nearest_m"), [(2.0, 2.0), (0.0, 2.0), (-0.5, 2.5), (-3.0, 5.0), (-10.0, 12.0)]
)
def test_the_preview_point_is_ahead_of_the_camera_and_of_the_car(camera_forward_m: float, nearest_m: float) -> None:
    """At 5 m/s it would be 33.5 m / 5^1.5 = 3.0 m ahead of the camera, where the lane turns nearer still."""
    lanes = frames((0.0, 0.0, 0.0), (0.0, 0.0, 1.0 / 4.0))
    _, at_m, _ = move_lanes_to_nearer_preview(lanes, np.array([5.0, 5.0]), PREVIEW_M, camera_forward_m)
    np.testing.assert_allclose(at_m[0], max(33.5 / 5.0**1.5, nearest_m))
    if nearest_m < 4.0:  # there is no lane farther on
        np.testing.assert_allclose(at_m[1], nearest_m)


@pytest.mark.parametrize("camera_forward_m", [-3.0, -10.0])
def test_a_slow_car_with_the_camera_far_behind_is_observed(camera_forward_m: float) -> None:
    """5 m/s round 100 m, seen by the camera of a bus or a trailer: the yaw rate is 0.05 rad/s."""
    car = replace(load_vehicle(), camera_forward_m=camera_forward_m)
    n, curvature, v = 100, 0.01, 5.0
    lever_m = float(steady_lateral_speed_per_yaw_rate_m(car, np.array([[v]]))[0, 0])
    slope = curvature * (camera_forward_m + lever_m)
    y_m = curvature * camera_forward_m * (0.5 * camera_forward_m + lever_m)
    lanes = frames(*[(y_m, slope, curvature)] * n)
    track = observe_lateral_motion(lanes, ScalarSamples(lanes.stamp_ns, np.full(n, v)), car)
    np.testing.assert_allclose(track.state[50:, 1], v * curvature, atol=0.002)
    assert (track.preview_m + camera_forward_m >= 2.0 - 1e-9).all()
    turning = np.diff(predict_paths_from_observer(track, car).heading_rad[50:], axis=1) / 0.05
    np.testing.assert_allclose(turning, v * curvature, atol=0.004)


def test_frames_that_tell_no_shape_stay_as_they_are() -> None:
    told = frames((0.0, 0.0, 0.0))
    bare = replace(told, lateral_deviation_m=np.full(1, 0.3), lines=np.full((1, 2, 3), np.nan))
    for lanes in (bare, replace(bare, lines=None, curvature_change_1pm2=None)):
        near, at_m, change = move_lanes_to_nearer_preview(lanes, np.array([5.0]), PREVIEW_M, 0.0)
        assert (near.lateral_deviation_m[0], at_m[0], change[0]) == (0.3, 33.5, 0.0)


def test_the_published_direction_is_the_angle_and_the_filters_the_sine() -> None:
    state = np.array([[0.1, 0.2, 0.3, 0.4], [np.nan] * 4])
    covariance = np.tile(np.full((4, 4), 0.01), (2, 1, 1))
    angle, made = convert_sine_states_to_angles(state, covariance)
    assert angle[0].tolist() == pytest.approx([0.1, 0.2, 0.3, 0.411517])
    assert np.isnan(angle[1]).all()
    assert made[0, 3, 3] == pytest.approx(0.01 / (1.0 - 0.4**2))  # d asin s = ds / cos
    assert made[0, 3, 0] == made[0, 0, 3] == pytest.approx(0.01 / np.sqrt(1.0 - 0.4**2))
    assert (made[0, :3, :3] == 0.01).all()


def test_a_circle_is_published_with_its_angle_at_the_preview_point() -> None:
    """20 m to the right: the sine of 0.4 is 8 m ahead, where the lane points 23.58 degrees from the car."""
    lanes = frames(*[(0.0, 0.0, -0.05)] * 60)
    speed = ScalarSamples(lanes.stamp_ns, np.full(60, 10.0))
    track = observe_lateral_motion(lanes, speed, load_vehicle())
    assert track.preview_m[-1] == pytest.approx(8.0)
    assert track.state[-1, 3] == pytest.approx(0.4115, abs=2e-3)


def ramp(seed: int) -> tuple[RoadDrive, LaneSamples, ScalarSamples]:
    """30 s round ramps of 23 m at 10 m/s, after spirals of 25 m: the true lane 2 to 15 m ahead as a spiral."""
    drive = plan_road_drive(
        RoadDriveConfig(seed=seed, duration_s=30.0, rate_hz=10.0, ramp_degps=25.0, speed_mps=10.0),
        wide_camera(480, 270),
    )
    states = drive.states_at(drive.time_s)
    along_m = np.linspace(0.0, 17.0, 341)
    lines, changes = [], []
    for station_m, offset_m, heading_rad in states[:, [STATION, OFFSET, HEADING]]:
        curvature = np.interp(station_m + along_m, drive.knots_m, drive.curvature_1pm)
        direction = -heading_rad + np.concatenate([[0.0], np.cumsum(curvature[1:] + curvature[:-1]) / 2.0 * 0.05])
        x_m = np.concatenate([[0.0], np.cumsum(np.cos(direction[1:]) * 0.05)])
        is_seen = (x_m >= 2.0) & (x_m <= 15.0)
        growth, rate, start = np.polyfit(x_m[is_seen], np.sin(direction[is_seen]), 2)
        cosine = np.sqrt(1.0 - start**2)
        changes.append(-2.0 * growth / cosine**3)
        lines.append(
            [
                [(side - offset_m) / cosine, start / cosine, rate / (1.0 - rate * side) / cosine**3]
                for side in (HALF_WIDTH_M, -HALF_WIDTH_M)
            ]
        )
    nothing, stamp_ns = np.full(len(lines), np.nan), seconds_to_ns(drive.time_s)
    lateral, heading, bend = (np.full(len(lines), sigma) for sigma in (0.03, 0.003, 3e-4))
    lanes = LaneSamples(
        *(stamp_ns, nothing, nothing, nothing, lateral, heading, bend),
        lines=np.array(lines),
        curvature_change_1pm2=np.array(changes),
    )
    return drive, lanes, ScalarSamples(stamp_ns, drive.speed_at_mps(drive.time_s))


def yaw_rate_errors_degps(drive: RoadDrive, track: LateralTrack) -> np.ndarray:
    return np.degrees(track.state[:, 1] - drive.states_at(drive.time_s)[:, YAW_RATE])[20:]


@pytest.mark.parametrize("seed", [1, 2])
def test_ramps_are_observed_from_the_lane_and_the_speed_alone(seed: int) -> None:
    """There is no lane 33.5 m ahead; the lane nearer by tells the yaw rate."""
    drive, lanes, speed = ramp(seed)
    car = load_vehicle()
    track = observe_lateral_motion(lanes, speed, car)
    assert set(track.status[1:]) == {FrameStatus.OBSERVED}
    assert np.abs(np.degrees(drive.states_at(drive.time_s)[:, YAW_RATE])).max() > 20.0
    errors = yaw_rate_errors_degps(drive, track)
    assert np.sqrt(np.mean(errors**2)) < 1.0
    assert np.abs(errors).max() < 3.0
    unshaped = replace(lanes, lines=None)
    assert set(observe_lateral_motion(unshaped, speed, car, ObserverConfig()).status) == {FrameStatus.LOST}
