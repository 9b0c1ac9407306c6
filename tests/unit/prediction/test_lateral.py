"""Paths from the observer: closed forms, frames of reference, and the honesty of the band on simulated drives."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from cwcli.dynamics.observer import observe_lateral_motion
from cwcli.dynamics.samples import LateralTrack
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.errors import UsageError
from cwcli.prediction.lateral import (
    LateralPathConfig,
    dead_reckon_x_y_m_and_heading_rad,
    predict_paths_from_observer,
    recent_shrunk_speed_slope_mps2,
    transform_paths_to_map,
)
from cwcli.prediction.lateral_calibrate import scale_covariance_across_path, sigma_factors_across_path_by_time
from cwcli.simulation.lane_camera import simulate_lane_sensors_of_run
from cwcli.simulation.lane_drive import LaneRuns, Road, simulate_lane_runs

CAR = load_vehicle()
PAPER = LateralPathConfig(model="zhang2011")


def track_of(
    n: int = 1, *, v: float = 20.0, lateral: float = 0.0, yaw_rate: float = 0.0, bend: float = 0.0
) -> LateralTrack:
    """n equal frames at 10 Hz; `bend` is the road's curvature, left positive."""
    return LateralTrack(
        stamp_ns=np.arange(n, dtype=np.int64) * 100_000_000,
        state=np.tile([lateral, yaw_rate, 0.0, 0.0], (n, 1)),
        preview_m=np.full(n, 33.5),
        covariance=np.tile(np.diag([1e-4, 1e-6, 0.0, 0.0]), (n, 1, 1)),
        speed_mps=np.full(n, v),
        steer_rad=np.zeros(n),
        curvature_1pm=np.full(n, -bend),
        mass_kg=np.full(n, 1215.0),
        mass_sigma_kg=np.full(n, np.nan),
        status=np.zeros(n, np.int8),
    )


def test_constant_yaw_rate_is_a_circle() -> None:
    # Radius v / gamma = 100 m, 0.4 rad in 2 s: x = 100 sin 0.4, y = 100 (1 - cos 0.4).
    paths = predict_paths_from_observer(track_of(yaw_rate=0.2), CAR, PAPER)
    assert paths.time_s[-1] == pytest.approx(2.0)
    assert paths.x_m[0, -1] == pytest.approx(100 * np.sin(0.4), abs=2e-3)
    assert paths.y_m[0, -1] == pytest.approx(100 * (1 - np.cos(0.4)), abs=2e-3)
    assert paths.heading_rad[0, -1] == pytest.approx(0.4)


def test_lateral_speed_carries_the_car_sideways() -> None:
    paths = predict_paths_from_observer(track_of(lateral=-0.3), CAR, PAPER)
    assert paths.y_m[0, -1] == pytest.approx(-0.6)
    assert paths.x_m[0, -1] == pytest.approx(40.0)


def test_a_car_that_follows_the_bend_stays_on_it() -> None:
    track = track_of(yaw_rate=20.0 * 0.004, bend=0.004)
    ours, papers = (
        predict_paths_from_observer(track, CAR, LateralPathConfig(model=model)) for model in ("cwcli", "zhang2011")
    )
    np.testing.assert_allclose(ours.y_m, papers.y_m, atol=1e-9)


def test_the_yaw_rate_goes_over_to_the_roads() -> None:
    # heading after t: road v k t, and what is left of the deviation: -v k tau (1 - exp(-t/tau)).
    path = predict_paths_from_observer(track_of(bend=0.004), CAR, LateralPathConfig(adapt_s=0.7))
    expected = 0.08 * (2.0 - 0.7 * (1.0 - np.exp(-2.0 / 0.7)))
    assert path.heading_rad[0, -1] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(("preview_m", "camera_forward_m"), [(0.0, 0.0), (3.0, -3.0), (3.0, -4.0)])
def test_a_preview_point_at_the_car_or_behind_it_leaves_paths_that_take_the_road_ahead(
    preview_m: float, camera_forward_m: float
) -> None:
    """4 m/s, 0.1 s: the car is at 0.4 m; a bend from there on is what it drives 2 m farther on at the latest."""
    car = replace(CAR, camera_forward_m=camera_forward_m)
    curvature_1pm = np.array([0.0, -0.01])
    track = replace(track_of(2, v=4.0), curvature_1pm=curvature_1pm, preview_m=np.full(2, preview_m))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        path = predict_paths_from_observer(track, car, LateralPathConfig(horizon_s=10.0))
    assert np.isfinite(path.y_m).all()
    turning = np.diff(path.heading_rad[1]) / 0.05
    np.testing.assert_allclose(turning[-1], 4.0 * 0.01, atol=1e-6)


def test_scatter_of_the_speed_is_no_acceleration() -> None:
    """20 Hz, 0.05 m/s: the slope over 1 s scatters by 0.036 m/s^2, in 2 s 7 cm; nearly all of it is cut."""
    scatter = np.random.default_rng(1).normal(0.0, 0.05, 2000)
    track = replace(track_of(2000), stamp_ns=np.arange(2000, dtype=np.int64) * 50_000_000, speed_mps=25.0 + scatter)
    accel = recent_shrunk_speed_slope_mps2(track)
    assert np.sqrt(np.mean(accel**2)) < 0.02
    braking = replace(track, speed_mps=25.0 + scatter - 2.0 * 0.05 * np.arange(2000))
    np.testing.assert_allclose(recent_shrunk_speed_slope_mps2(braking)[30:], -2.0, atol=0.2)


def test_no_acceleration_from_few_frames_or_beyond_a_gap() -> None:
    track = replace(track_of(6), speed_mps=np.array([20.0, 21.0, 22.0, np.nan, 23.0, 24.0]))
    assert recent_shrunk_speed_slope_mps2(track)[:4].tolist() == [0.0, 0.0, 0.0, 0.0]
    gap = replace(track_of(6), stamp_ns=np.arange(6, dtype=np.int64) * 2_000_000_000, speed_mps=np.arange(6.0))
    assert not recent_shrunk_speed_slope_mps2(gap).any()
    assert len(recent_shrunk_speed_slope_mps2(track_of(0))) == 0


def test_a_steady_acceleration_goes_on() -> None:
    track = replace(track_of(30), speed_mps=20.0 + 1.0 * 0.1 * np.arange(30.0))
    path = predict_paths_from_observer(track, CAR)
    assert path.x_m[-1, -1] == pytest.approx(22.9 * 2.0 + 0.5 * 1.0 * 4.0, abs=1e-6)
    assert predict_paths_from_observer(track, CAR, PAPER).x_m[-1, -1] == pytest.approx(22.9 * 2.0)


def test_a_braking_car_stops_and_does_not_reverse() -> None:
    track = replace(track_of(12), speed_mps=np.maximum(6.0 - 5.0 * 0.1 * np.arange(12), 0.0))
    path = predict_paths_from_observer(track, CAR)
    assert path.speed_mps[-1].min() >= 0.0
    assert np.diff(path.x_m[-1]).min() >= 0.0


def test_paths_in_the_map() -> None:
    paths = predict_paths_from_observer(track_of(yaw_rate=0.2), CAR, PAPER)
    placed = transform_paths_to_map(paths, np.array([10.0]), np.array([-5.0]), np.array([np.pi / 2]))
    np.testing.assert_allclose(placed.x_m, 10.0 - paths.y_m, atol=1e-12)
    np.testing.assert_allclose(placed.y_m, -5.0 + paths.x_m, atol=1e-12)
    np.testing.assert_allclose(placed.position_covariance_m2[..., 0], paths.position_covariance_m2[..., 2], atol=1e-12)
    np.testing.assert_allclose(placed.position_covariance_m2[..., 1], -paths.position_covariance_m2[..., 1], atol=1e-12)


def test_covariance_equals_random_draws_of_the_start() -> None:
    # Without unrest and with the paper's model only v_y, gamma and the speed are open.
    config = replace(PAPER, unrest_mps2=1e-9, accel_sigma_mps2=1e-9)
    random = np.random.default_rng(5)
    n = 4000
    spread = random.normal(size=(n, 3)) * [0.01, 0.001, 0.1]
    base = track_of(n)
    drawn = replace(base, state=base.state + np.pad(spread[:, :2], ((0, 0), (0, 2))), speed_mps=20.0 + spread[:, 2])
    ends = predict_paths_from_observer(drawn, CAR, config)
    told = predict_paths_from_observer(track_of(), CAR, config).position_covariance_m2[0, -1]
    assert np.var(ends.y_m[:, -1]) == pytest.approx(told[2], rel=0.1)
    assert np.var(ends.x_m[:, -1]) == pytest.approx(told[0], rel=0.1)


def test_no_state_no_path() -> None:
    track = track_of(3)
    track.state[1] = np.nan
    paths = predict_paths_from_observer(track, CAR)
    assert np.isnan(paths.y_m[1]).all()
    assert np.isfinite(paths.y_m[[0, 2]]).all()


@pytest.mark.parametrize(
    "changes",
    [
        {"model": "spline"},
        {"horizon_s": 0.0},
        {"horizon_s": 1e9},
        {"step_s": 3.0},
        {"step_s": 1e-9},
        {"adapt_s": -1.0},
    ],
)
def test_wrong_options_are_refused(changes: dict[str, object]) -> None:
    with pytest.raises(UsageError):
        LateralPathConfig(**changes)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def drives():
    road = Road(np.array([0.0, 200.0, 280.0, 500.0, 580.0, 900.0, 980.0]), np.array([0, 0, 0.002, 0.002, 0, 0, -0.003]))
    truth = simulate_lane_runs(
        road, CAR, LaneRuns(np.full(4, 25.0), np.zeros(4), np.full(4, np.inf), 0.0, 60.0), seed=3
    )
    return road, truth, [simulate_lane_sensors_of_run(truth, run, road, CAR, seed=3) for run in range(4)]


@pytest.mark.parametrize(("with_gyro", "median_m"), [(False, 0.6), (True, 0.35)])
def test_error_and_band_at_two_seconds(drives, with_gyro: bool, median_m: float) -> None:
    _, truth, sensed = drives
    errors, inside = [], []
    for run, drive in enumerate(sensed):
        track = observe_lateral_motion(drive.lanes, drive.speed, CAR, yaw_rate=drive.yaw_rate if with_gyro else None)
        paths = scale_covariance_across_path(predict_paths_from_observer(track, CAR), track)
        rows = np.arange(20, len(track) - 21)
        now, later = drive.index[rows], drive.index[rows] + 200
        dx, dy = (values[later, run] - values[now, run] for values in (truth.x_m, truth.y_m))
        cos, sin = np.cos(truth.yaw_rad[now, run]), np.sin(truth.yaw_rad[now, run])
        ex, ey = paths.x_m[rows, -1] - (cos * dx + sin * dy), paths.y_m[rows, -1] - (cos * dy - sin * dx)
        errors.append(np.hypot(ex, ey))
        inside.append(np.abs(ey) < 1.645 * np.sqrt(paths.position_covariance_m2[rows, -1, 2]))
    assert np.median(np.concatenate(errors)) < median_m
    assert 0.85 <= np.mean(np.concatenate(inside)) <= 0.95


def test_dead_reckoning_follows_the_true_track(drives) -> None:
    _, truth, sensed = drives
    drive = sensed[0]
    track = observe_lateral_motion(drive.lanes, drive.speed, CAR, yaw_rate=drive.yaw_rate)
    x, y, _ = dead_reckon_x_y_m_and_heading_rad(track)
    first, last = drive.index[0], drive.index[100]
    driven = np.hypot(truth.x_m[last, 0] - truth.x_m[first, 0], truth.y_m[last, 0] - truth.y_m[first, 0])
    assert np.hypot(x[100], y[100]) == pytest.approx(driven, rel=2e-3)


def test_a_short_record_keeps_the_assumed_sigmas() -> None:
    track = track_of(3)
    np.testing.assert_allclose(
        sigma_factors_across_path_by_time(predict_paths_from_observer(track, CAR), track), 1.0, atol=0.15
    )
