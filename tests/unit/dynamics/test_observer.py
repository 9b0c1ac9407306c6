"""The observers against their NumPy twins, on exact runs, and on what real logs do to them."""

from dataclasses import replace
from typing import Any, Literal, cast

import numpy as np
import pytest

from cwcli.dynamics import blended as paper
from cwcli.dynamics.config import FilterNoise, ObserverConfig
from cwcli.dynamics.filter import build_kernel_model
from cwcli.dynamics.observer import OBSERVER_METHODS, observe_lateral_motion
from cwcli.dynamics.samples import FrameStatus, LaneSamples, LateralTrack, ScalarSamples
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.errors import DataError, MissingSignalError, UsageError
from cwcli.kernels import observer as kernel
from cwcli.kernels.observer import Begin, EventKind, EventStatus
from cwcli.simulation.lane_camera import (
    LaneSensorNoise,
    SensedDrive,
    simulate_lane_sensors_of_run,
)
from cwcli.simulation.lane_drive import LaneRuns, Road, simulate_lane_runs
from cwcli.simulation.single_track import PAPER_RUNS, simulate_zhang2011_run
from tests.unit.dynamics import naive_observer as naive
from tests.unit.dynamics.true_lane import true_lane_at_preview
from tests.work import count_calls

CAR = load_vehicle()
ROAD = Road(np.array([0.0, 200.0, 280.0, 500.0, 580.0]), np.array([0.0, 0.0, 0.002, 0.002, 0.0]))
TRUTH = simulate_lane_runs(ROAD, CAR, LaneRuns(np.array([25.0]), np.zeros(1), np.array([np.inf]), 0.0, 30.0), seed=1)
Method = Literal["cwcli", "zhang2011"]
ALL = cast(list[Method], sorted(OBSERVER_METHODS))


def sense(**noise: Any) -> SensedDrive:
    return simulate_lane_sensors_of_run(TRUTH, 0, ROAD, CAR, noise=LaneSensorNoise(**noise), seed=1)


SENSED = sense()


def true_state(sensed: SensedDrive) -> np.ndarray:
    rows = sensed.index
    place = true_lane_at_preview(TRUTH, 0, rows, ROAD, CAR)[:, :2]
    return np.column_stack([TRUTH.lateral_speed_mps[rows, 0], TRUTH.yaw_rate_radps[rows, 0], place])


def rms(track: LateralTrack, sensed: SensedDrive) -> tuple[float, float]:
    error = (track.state - true_state(sensed))[20:, :2]
    return tuple(np.sqrt(np.nanmean(error**2, axis=0)))


def test_blended_kernel_equals_its_twin() -> None:
    random = np.random.default_rng(4)
    n = 200
    bank = paper.design_observer_bank(CAR, ObserverConfig(), 0.1)
    low, weight = paper.lower_speed_index_and_upper_weight(np.linspace(2.0, 48.0, n))
    begin = np.zeros(n, np.int8)
    begin[[0, 90]], begin[60] = Begin.ANEW, Begin.STOP
    measured = random.normal(size=(n, 2)) * [0.3, 0.02]
    measured[30:35] = np.nan
    inputs = random.normal(size=(n, 2)) * [0.02, 0.001]
    periods = random.integers(1, 4, n).astype(np.int32)
    matrices = (bank.phi, bank.gamma, bank.gain)
    frames: dict[str, Any] = {
        "low": low,
        "weight": weight,
        "begin": begin,
        "periods": periods,
        "inputs": inputs,
        "measured": measured,
    }
    out = kernel.blend(*matrices, **frames)
    expected = naive.blend(*matrices, **frames)
    assert np.isnan(expected).any()
    np.testing.assert_allclose(out, expected, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("with_load", [False, True])
def test_filter_kernel_equals_its_twin(with_load: bool) -> None:
    config = ObserverConfig(estimate_load=with_load)
    ahead = replace(CAR, camera_forward_m=0.4)
    model = build_kernel_model(ahead, config)
    n = 100
    frames = slice(0, 20)
    values = np.full((n, 3), np.nan)
    kind = np.full(n, EventKind.YAW_RATE, np.int8)
    kind[::5] = EventKind.LANE
    kind[3::10] = EventKind.STEERING_ANGLE
    lanes = SENSED.lanes
    values[::5] = np.column_stack([lanes.lateral_deviation_m, lanes.heading_deviation_rad, lanes.curvature_1pm])[frames]
    index = SENSED.index[0] + 2 * np.arange(n)
    values[kind == EventKind.YAW_RATE, 0] = TRUTH.yaw_rate_radps[index, 0][kind == EventKind.YAW_RATE]
    values[kind == EventKind.STEERING_ANGLE, 0] = TRUTH.steer_rad[index, 0][kind == EventKind.STEERING_ANGLE]
    values[50:70:5] = np.nan
    sigmas = np.tile([0.05, 0.003, 3e-4], (n, 1))
    sigmas[kind != EventKind.LANE] = 0.003
    dt = np.full(n, 0.02)
    dt[0] = 0.0
    speed = 25.0 + np.sin(np.arange(n) * 0.1)
    begin = np.full(n, Begin.GO_ON, np.int8)
    preview_m = np.where(np.arange(n) < 40, 33.5, 33.5 - 0.2 * (np.arange(n) - 40))  # values, too, are moved along
    by_m = (preview_m - 33.5)[:, None]
    values[::5, 1:2] += (values[:, 2:3] * by_m)[::5]
    values[::5, 0:1] += (values[:, 1:2] * by_m - values[:, 2:3] * by_m**2 / 2)[::5]
    change = np.where(np.arange(n) < 60, 2e-6, -1e-6)
    events = kernel.Events(
        dt_s=dt,
        speed_mps=speed,
        kind=kind,
        begin=begin,
        values=values,
        sigmas=sigmas,
        preview_m=preview_m,
        change_1pm2=change,
    )
    x, p, status, at_m = kernel.observe(events, model)
    expected_x, expected_p = naive.observe(dt, speed, kind, values, sigmas, preview_m, change, model, ahead)
    is_told = (kind == EventKind.LANE) & np.isfinite(values[:, 1])
    np.testing.assert_allclose(at_m[is_told], preview_m[is_told])
    scale = np.sqrt(np.maximum(np.diagonal(expected_p, axis1=1, axis2=2), 1e-12))
    np.testing.assert_allclose((x - expected_x) / scale, 0.0, atol=1e-8)
    np.testing.assert_allclose((p - expected_p) / (scale[:, :, None] * scale[:, None, :]), 0.0, atol=1e-8)
    assert set(status[np.isnan(values).all(axis=1)]) == {EventStatus.PREDICTED}


@pytest.mark.parametrize("method", ALL)
def test_all_methods_find_the_steady_turn(method: Method) -> None:
    run = simulate_zhang2011_run(PAPER_RUNS["fig 14"], CAR)
    track = observe_lateral_motion(run.lanes, run.speed, CAR, ObserverConfig(method))
    np.testing.assert_allclose(track.state[-1, :2], run.state[-1, :2], rtol=0.01)
    assert track.counts["started"] == 1


@pytest.mark.parametrize("method", ALL)
def test_errors_on_a_noisy_drive(method: Method) -> None:
    lateral_mps, yaw_rate_radps = rms(
        observe_lateral_motion(SENSED.lanes, SENSED.speed, CAR, ObserverConfig(method)), SENSED
    )
    assert lateral_mps < 0.03
    assert np.degrees(yaw_rate_radps) < 0.5


def test_a_gyroscope_halves_the_yaw_rates_error_and_its_bias_is_found() -> None:
    sensed = sense(yaw_rate_bias_radps=0.003)
    alone = rms(observe_lateral_motion(sensed.lanes, sensed.speed, CAR), sensed)[1]
    fused = rms(observe_lateral_motion(sensed.lanes, sensed.speed, CAR, yaw_rate=sensed.yaw_rate), sensed)[1]
    assert fused < 0.6 * alone
    assert fused < 0.003  # less than the bias


def test_covariance_is_symmetric_positive_and_honest() -> None:
    track = observe_lateral_motion(SENSED.lanes, SENSED.speed, CAR)
    covariance = track.covariance
    np.testing.assert_allclose(covariance, np.swapaxes(covariance, 1, 2), atol=1e-15)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    error = (track.state - true_state(SENSED))[20:]
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance[20:]), error)
    assert 0.3 * 4 < nees.mean() < 3.0 * 4  # a parabola fits the road's ramps with an error that no frame tells of


def test_irregular_frames_are_used_at_their_own_times() -> None:
    even, uneven = sense(), sense(jitter_s=0.08)
    assert np.diff(uneven.stamp_ns).max() > 1.5 * np.diff(even.stamp_ns).max()
    for sensed in (even, uneven):
        lateral_mps, yaw_rate_radps = rms(observe_lateral_motion(sensed.lanes, sensed.speed, CAR), sensed)
        assert lateral_mps < 0.03
        assert np.degrees(yaw_rate_radps) < 0.3


@pytest.mark.parametrize("method", ALL)
def test_boundaries_missing_for_seconds(method: Method) -> None:
    sensed = sense(blind_s=((8.0, 9.0), (12.0, 17.0)))
    track = observe_lateral_motion(sensed.lanes, sensed.speed, CAR, ObserverConfig(method))
    time_s = TRUTH.time_s[sensed.index]
    short, long = (time_s >= 8.0) & (time_s < 9.0), (time_s >= 14.2) & (time_s < 17.0)
    assert set(track.status[short]) == {FrameStatus.PREDICTED}
    assert np.isfinite(track.state[short]).all()
    assert set(track.status[long]) == {FrameStatus.LOST}
    assert np.isnan(track.state[long]).all()
    after = time_s >= 18.5
    np.testing.assert_allclose(track.state[after, 1], true_state(sensed)[after, 1], atol=np.radians(1.5))


def test_uncertainty_grows_without_boundaries_and_the_gyroscope_limits_it() -> None:
    sensed = sense(blind_s=((8.0, 14.0),))
    at = [int(np.searchsorted(TRUTH.time_s[sensed.index], t)) for t in (7.9, 8.5, 9.5)]
    alone = observe_lateral_motion(sensed.lanes, sensed.speed, CAR)
    sigma = np.sqrt(alone.covariance[at, 1, 1])
    assert sigma[0] < sigma[1] < sigma[2]
    fused = observe_lateral_motion(sensed.lanes, sensed.speed, CAR, yaw_rate=sensed.yaw_rate)
    still_blind = int(np.searchsorted(TRUTH.time_s[sensed.index], 13.0))
    assert np.isnan(alone.state[still_blind, 1])
    assert fused.state[still_blind, 1] == pytest.approx(true_state(sensed)[still_blind, 1], abs=0.01)


@pytest.mark.parametrize("method", ALL)
def test_missing_speed(method: Method) -> None:
    nothing = ScalarSamples(np.zeros(0, np.int64), np.zeros(0))
    with pytest.raises(MissingSignalError, match="no speed"):
        observe_lateral_motion(SENSED.lanes, nothing, CAR, ObserverConfig(method))
    speed = SENSED.speed
    gap = (speed.stamp_ns > 10_000_000_000) & (speed.stamp_ns < 14_000_000_000)
    holed = ScalarSamples(speed.stamp_ns, np.where(gap, np.nan, speed.values))
    track = observe_lateral_motion(SENSED.lanes, holed, CAR, ObserverConfig(method))
    inside = (SENSED.stamp_ns > 11_000_000_000) & (SENSED.stamp_ns < 13_000_000_000)
    assert set(track.status[inside]) == {FrameStatus.NO_SPEED}
    assert np.isnan(track.state[inside]).all()
    assert track.status[-1] == FrameStatus.OBSERVED
    assert track.counts["started"] == 2


def test_standing_still() -> None:
    n = 100
    stamp_ns = np.arange(n, dtype=np.int64) * 100_000_000
    random = np.random.default_rng(0)
    noisy = [s * random.standard_normal(n) for s in (0.05, 0.003, 2e-4)]
    lanes, speed = LaneSamples(stamp_ns, noisy[0], noisy[1], noisy[2]), ScalarSamples(stamp_ns, np.zeros(n))
    ours = observe_lateral_motion(lanes, speed, CAR)
    np.testing.assert_allclose(ours.state[:, :2], 0.0, atol=2e-3)
    papers = observe_lateral_motion(lanes, speed, CAR, ObserverConfig("zhang2011"))
    assert set(papers.status) == {FrameStatus.TOO_SLOW}
    assert np.isnan(papers.state).all()


def test_from_standstill_to_speed_and_in_reverse() -> None:
    runs = LaneRuns(np.array([0.0]), np.zeros(1), np.array([np.inf]), 2.0, 12.0)
    truth = simulate_lane_runs(Road(), CAR, runs, seed=2)
    sensed = simulate_lane_sensors_of_run(truth, 0, Road(), CAR, seed=2)
    track = observe_lateral_motion(sensed.lanes, sensed.speed, CAR)
    assert np.isfinite(track.state).all()
    np.testing.assert_allclose(track.state[:, 1], truth.yaw_rate_radps[sensed.index, 0], atol=0.06)
    backward = ScalarSamples(sensed.speed.stamp_ns, np.full(len(sensed.speed.values), -1.5))
    assert np.isfinite(observe_lateral_motion(sensed.lanes, backward, CAR).state).all()


def test_a_gyroscope_with_the_wrong_sign_is_told_and_not_used() -> None:
    wrong = replace(SENSED.yaw_rate, values=-SENSED.yaw_rate.values)
    track = observe_lateral_motion(SENSED.lanes, SENSED.speed, CAR, yaw_rate=wrong)
    assert track.notes == ("the yaw rate turns the other way than the lane: not used; check its sign or mounting",)
    np.testing.assert_array_equal(track.state, observe_lateral_motion(SENSED.lanes, SENSED.speed, CAR).state)


@pytest.mark.parametrize("method", ALL)
def test_a_steering_angle_with_the_wrong_sign_is_told_and_not_used(method: Method) -> None:
    angle = TRUTH.steer_rad[SENSED.index, 0]
    right, wrong = (ScalarSamples(SENSED.stamp_ns, sign * angle) for sign in (1.0, -1.0))
    config = ObserverConfig(method)
    track = observe_lateral_motion(SENSED.lanes, SENSED.speed, CAR, config, steer=wrong)
    assert track.notes == (
        "the steering angle turns the other way than the lane: not used; check its sign or mounting",
    )
    np.testing.assert_array_equal(track.state, observe_lateral_motion(SENSED.lanes, SENSED.speed, CAR, config).state)
    assert observe_lateral_motion(SENSED.lanes, SENSED.speed, CAR, config, steer=right).notes == ()


def test_a_lane_change_moves_the_place_and_not_the_motion() -> None:
    lanes = SENSED.lanes
    jumped = lanes.lateral_deviation_m.copy()
    jumped[150:] += 3.6
    track = observe_lateral_motion(replace(lanes, lateral_deviation_m=jumped), SENSED.speed, CAR)
    expected = true_state(SENSED)
    assert track.status[150] == FrameStatus.REJECTED
    assert track.counts["started"] == 1
    np.testing.assert_allclose(track.state[150:170, 1], expected[150:170, 1], atol=0.02)
    np.testing.assert_allclose(track.state[155:, 2], expected[155:, 2] + 3.6, atol=0.2)


def test_a_turned_camera_is_found_and_its_uncertainty_is_no_noise() -> None:
    """Sigmas that hold the mounting's yaw (5 mrad) count as those without it, and the yaw itself does no harm."""
    lanes, yaw_rad, preview_m = SENSED.lanes, 0.005, 33.5
    assert lanes.lateral_sigma_m is not None and lanes.heading_sigma_rad is not None
    held = replace(
        lanes,
        lateral_sigma_m=np.hypot(lanes.lateral_sigma_m, preview_m * yaw_rad),
        heading_sigma_rad=np.hypot(lanes.heading_sigma_rad, yaw_rad),
        yaw_sigma_rad=yaw_rad,
    )
    told = ObserverConfig(noise=FilterNoise(camera_yaw_rad=yaw_rad))
    straight = observe_lateral_motion(held, SENSED.speed, CAR)
    np.testing.assert_allclose(straight.state, observe_lateral_motion(lanes, SENSED.speed, CAR, told).state, atol=1e-9)
    turned = replace(
        held,
        lateral_deviation_m=lanes.lateral_deviation_m + preview_m * yaw_rad,
        heading_deviation_rad=lanes.heading_deviation_rad + yaw_rad,
    )
    track = observe_lateral_motion(turned, SENSED.speed, CAR)
    np.testing.assert_allclose(track.state[100:, 0], straight.state[100:, 0], atol=0.02)
    np.testing.assert_allclose(track.state[100:, 1], straight.state[100:, 1], atol=0.001)


def test_a_turned_camera_far_ahead_moves_the_lane_by_its_own_distance() -> None:
    """Turning the camera moves the preview point about the camera, 33.5 m from it, not about the centre of gravity."""
    n, yaw_rad, place_m = 300, 0.005, 0.3
    stamp_ns = np.arange(n) * 100_000_000
    lanes = LaneSamples(stamp_ns, np.full(n, place_m + 33.5 * yaw_rad), np.full(n, yaw_rad), np.zeros(n))
    told = ObserverConfig(noise=FilterNoise(camera_yaw_rad=0.02))
    track = observe_lateral_motion(
        lanes, ScalarSamples(stamp_ns, np.full(n, 25.0)), replace(CAR, camera_forward_m=10.0), told
    )
    assert track.state[-1, 3] == pytest.approx(0.0, abs=3e-4)
    assert track.state[-1, 2] == pytest.approx(place_m, abs=0.01)


def test_the_start_knows_that_the_camera_may_be_turned() -> None:
    """At the first frame a place is as uncertain as the frame, and 33.5 m times the camera's yaw, make it."""
    yaw_rad, lateral_m, heading_rad = 0.01, 0.05, 0.003
    config = ObserverConfig(noise=FilterNoise(camera_yaw_rad=yaw_rad, lateral_floor_m=0.0, heading_floor_rad=0.0))
    lanes = LaneSamples(
        np.zeros(1, np.int64), np.full(1, 0.3), np.zeros(1), np.zeros(1), np.full(1, lateral_m), np.full(1, heading_rad)
    )
    covariance = observe_lateral_motion(
        lanes, ScalarSamples(np.zeros(1, np.int64), np.full(1, 25.0)), CAR, config
    ).covariance[0]
    np.testing.assert_allclose(
        covariance[2:, 2:],
        [
            [lateral_m**2 + (33.5 * yaw_rad) ** 2, 33.5 * yaw_rad**2],
            [33.5 * yaw_rad**2, heading_rad**2 + yaw_rad**2],
        ],
    )


def test_another_lane_does_not_make_the_camera_known() -> None:
    """After a jump of y_L the place is uncertain by the camera's yaw again, though every frame saw the same."""
    n, config = 60, ObserverConfig(noise=FilterNoise(camera_yaw_rad=0.01, lateral_floor_m=0.0))
    stamp_ns = np.arange(n) * 100_000_000
    speed = ScalarSamples(stamp_ns, np.full(n, 25.0))
    same = LaneSamples(stamp_ns, np.zeros(n), np.zeros(n), np.zeros(n), np.full(n, 0.05), np.full(n, 0.003))
    jumped = observe_lateral_motion(
        replace(same, lateral_deviation_m=np.where(np.arange(n) >= 40, 3.6, 0.0)), speed, CAR, config
    )
    assert jumped.status[40] == FrameStatus.REJECTED
    assert (
        jumped.covariance[40:, 2, 2] >= observe_lateral_motion(same, speed, CAR, config).covariance[40:, 2, 2]
    ).all()


def test_one_wrong_frame_is_left_out() -> None:
    heading = SENSED.lanes.heading_deviation_rad.copy()
    heading[150] += 0.2
    track = observe_lateral_motion(replace(SENSED.lanes, heading_deviation_rad=heading), SENSED.speed, CAR)
    assert track.status[150] == FrameStatus.REJECTED
    np.testing.assert_allclose(track.state[145:160, 1], true_state(SENSED)[145:160, 1], atol=0.02)


@pytest.mark.parametrize("with_gyro", [True, False])
def test_a_road_that_does_not_fit_leaves_a_measured_yaw_rate_alone(with_gyro: bool) -> None:
    """From 6 s on the lane is that of a ramp far ahead, on which the car does not turn yet."""
    n = 100
    stamp_ns = np.arange(n) * 100_000_000
    later: np.ndarray = np.arange(n) >= 60
    seen = LaneSamples(stamp_ns, -8.0 * later, -0.5 * later, -0.02 * later, *np.tile([[0.05], [0.003], [1e-4]], (1, n)))
    gyro = ScalarSamples(np.arange(10 * n) * 10_000_000, np.zeros(10 * n), 0.002) if with_gyro else None
    track = observe_lateral_motion(seen, ScalarSamples(stamp_ns, np.full(n, 10.0)), CAR, yaw_rate=gyro)
    assert (track.status[60:] == FrameStatus.STARTED).any()
    assert track.state[-1, 3] == pytest.approx(-0.5, abs=0.02)
    off_radps = np.abs(track.state[60:, 1]).max()
    assert (off_radps < 0.01) == with_gyro  # else the car is taken to follow the road: 10 m/s x 0.02 1/m


def test_a_pause_of_the_frames_starts_anew() -> None:
    keep = (SENSED.stamp_ns < 8_000_000_000) | (SENSED.stamp_ns > 13_000_000_000)
    columns: list[Any] = [v[keep] for v in vars(SENSED.lanes).values() if isinstance(v, np.ndarray)]
    lanes = LaneSamples(*columns)
    for method in ALL:
        track = observe_lateral_motion(lanes, SENSED.speed, CAR, ObserverConfig(method))
        assert track.counts["started"] == 2


@pytest.mark.parametrize("method", ALL)
def test_no_frames(method: Method) -> None:
    empty = LaneSamples(np.zeros(0, np.int64), np.zeros(0), np.zeros(0), np.zeros(0))
    assert len(observe_lateral_motion(empty, SENSED.speed, CAR, ObserverConfig(method))) == 0


def test_the_load_is_found_in_turns_if_asked_for() -> None:
    run = simulate_zhang2011_run(PAPER_RUNS["fig 16"], CAR)
    noise = FilterNoise(camera_yaw_rad=0.0, lateral_sigma_m=0.01, heading_sigma_rad=0.001, curvature_sigma_1pm=1e-5)
    mass_kg = observe_lateral_motion(run.lanes, run.speed, CAR, ObserverConfig(noise=noise, estimate_load=True)).mass_kg
    assert mass_kg[-1] == pytest.approx(1460.0, rel=0.02)
    assert observe_lateral_motion(run.lanes, run.speed, CAR, ObserverConfig(noise=noise)).mass_kg[-1] == 1215.0


def test_neighbours_are_blended_linearly_and_end_at_the_ends() -> None:
    low, weight = paper.lower_speed_index_and_upper_weight(np.array([0.0, 10.0, 67.0, 80.0, 160.0, 200.0]) / 3.6)
    np.testing.assert_array_equal(paper.OBSERVER_SPEEDS_KMH[low], [10, 10, 60, 80, 150, 150])
    np.testing.assert_allclose(weight, [0.0, 0.0, 0.7, 0.0, 1.0, 1.0], atol=1e-12)


def test_wrong_options_are_refused() -> None:
    with pytest.raises(UsageError, match="there is no observer 'luenberger'"):
        observe_lateral_motion(SENSED.lanes, SENSED.speed, CAR, ObserverConfig("luenberger"))  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="there is no steering rate"):
        observe_lateral_motion(SENSED.lanes, SENSED.speed, CAR, ObserverConfig("zhang2011", steer_rate="none"))  # type: ignore[arg-type]
    with pytest.raises(UsageError, match=r"preview_m is -33.5; permitted: a positive number"):
        ObserverConfig(preview_m=-33.5)
    with pytest.raises(UsageError, match=r"noise.gate is 0.0"):
        ObserverConfig(noise=FilterNoise(gate=0.0))
    backwards = replace(SENSED.speed, stamp_ns=SENSED.speed.stamp_ns[::-1])
    with pytest.raises(DataError, match="the stamps of the speed decrease"):
        observe_lateral_motion(SENSED.lanes, backwards, CAR)


@pytest.mark.parametrize("method", ALL)
def test_frames_are_no_calls_of_python(method: Method) -> None:
    """The loop over the frames is a kernel's: ten times as many are as many calls (seconds: bench_observer.py)."""

    def calls(n: int) -> int:
        lanes, speed = frames_and_speed(n)
        return count_calls(lambda: observe_lateral_motion(lanes, speed, CAR, ObserverConfig(method)))

    calls(100)  # what is kept from the first call on
    few, many = calls(2_000), calls(20_000)
    assert many < few + 100


def frames_and_speed(n: int) -> tuple[LaneSamples, ScalarSamples]:
    """Frames of a lane that is hardly one."""
    stamp_ns = np.arange(n, dtype=np.int64) * 100_000_000
    random = np.random.default_rng(0)
    lateral, heading, bend = (s * random.standard_normal(n) for s in (0.05, 0.003, 2e-4))
    lanes = LaneSamples(stamp_ns, lateral, heading, bend)
    speed = ScalarSamples(stamp_ns, np.full(n, 25.0))
    return lanes, speed
