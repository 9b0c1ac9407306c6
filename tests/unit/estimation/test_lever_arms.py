"""Sensors that stand apart from the reference point: what is given is used, what shows is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.errors import UsageError
from cwcli.estimation import EstimatorConfig, Kind, Measurements, Track, estimate_track
from cwcli.estimation.calibration import parse_calibration_table
from cwcli.estimation.config import parse_lever_arm_options
from cwcli.estimation.lever_arms import move_states_and_covariances_to_antenna
from cwcli.estimation.parameter import ParameterStatus
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.tune import notes_on_arms_that_may_be_latencies
from tests.studies.sensor_model import NEES_BOUNDS, one_run

ANTENNA_M, IMU_M, WHEEL_M = (1.5, 0.4), (0.8, -0.3), (0.0, 0.7)


def test_parse_lever_arms() -> None:
    assert parse_lever_arm_options(["/gps/fix=1.5,0.4", "/imu/data=-0.8,0"]) == {
        "/gps/fix": (1.5, 0.4),
        "/imu/data": (-0.8, 0.0),
    }


@pytest.mark.parametrize(
    "entry", ["/gps/fix", "/gps/fix=1", "/gps/fix=1,2,3", "=1,0", "/gps/fix=nan,0", "/gps/fix=21,0", "/gps/fix=0,6"]
)
def test_parse_lever_arms_refuses(entry: str) -> None:
    with pytest.raises(UsageError, match="--lever-arm"):
        parse_lever_arm_options([entry])


def test_parse_lever_arms_refuses_a_topic_twice() -> None:
    with pytest.raises(UsageError, match="twice"):
        parse_lever_arm_options(["/a=1,0", "/a=1,0"])


def antenna(**more: object) -> SensorSeries:
    return SensorSeries("gps", Kind.POSITION, np.zeros(1), np.zeros((1, 2)), np.ones((1, 3)), **more)  # type: ignore[arg-type]


def test_states_move_to_the_antenna_with_their_covariance() -> None:
    """Heading north, antenna 2 m ahead: a heading's error moves it east and west, the place's north and south."""
    state = np.zeros((1, 9))
    state[0, [0, 1, 3, 8]] = 10.0, 20.0, np.pi / 2, 2.0
    variances = np.array([0.5, 0.6, 1.0, 0.01, 1.0, 1.0, 1.0, 1.0, 0.04])
    moved, covariance = move_states_and_covariances_to_antenna(
        [antenna(ahead_state=8)], state, np.diag(variances)[None]
    )
    np.testing.assert_allclose(moved[0, :4], [10.0, 22.0, 0.0, np.pi / 2], atol=1e-12)
    np.testing.assert_allclose(np.diagonal(covariance[0])[:2], [0.5 + 2.0**2 * 0.01, 0.6 + 0.04], atol=1e-12)
    assert covariance[0, 0, 3] == pytest.approx(-2.0 * 0.01)


def test_states_stay_where_the_place_of_an_antenna_was_given() -> None:
    state = np.ones((1, 9))
    series = [antenna(ahead_state=8), antenna(place_m=(1.0, 0.0))]
    moved, _ = move_states_and_covariances_to_antenna(series, state, np.eye(9)[None])
    np.testing.assert_array_equal(moved, state[:, :8])


Place = tuple[float, float]


def slalom(antenna_m: Place, imu_m: Place, wheel_m: Place) -> tuple[list[Measurements], np.ndarray, np.ndarray]:
    """A minute on a slalom of 10 m/s; every sensor apart, hardly any noise. Also stamps and (n, 4) true states."""
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 60.0, 0.02)
    w = 0.3 * np.sin(0.4 * t)
    w_dot = 0.12 * np.cos(0.4 * t)
    heading = 0.75 * (1.0 - np.cos(0.4 * t))
    steps = 10.0 * 0.02 * np.stack([np.cos(heading + 0.01 * w), np.sin(heading + 0.01 * w)], axis=1)
    xy = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)[:-1]])
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    stamp = np.asarray(t * 1e9, np.int64)
    fixes = xy + antenna_m[0] * ahead + antenna_m[1] * left + rng.normal(0.0, 0.03, xy.shape)
    velocity = (10.0 - w * antenna_m[1])[:, None] * ahead + (w * antenna_m[0])[:, None] * left
    velocity += rng.normal(0.0, 0.05, xy.shape)
    wheel = 10.0 - w * wheel_m[1] + rng.normal(0.0, 0.02, len(t))
    accel = -(w**2) * imu_m[0] - w_dot * imu_m[1] + rng.normal(0.0, 0.02, len(t))
    found = [
        Measurements("gps", Kind.POSITION, stamp[::5], fixes[::5]),
        Measurements("gps", Kind.VELOCITY, stamp[::5], velocity[::5]),
        Measurements("wheel", Kind.SPEED, stamp[::2], wheel[::2]),
        Measurements("imu", Kind.ACCEL, stamp, accel),
        Measurements("imu", Kind.YAW_RATE, stamp, w + rng.normal(0.0, 0.002, len(t))),
    ]
    return found, stamp[::25], np.column_stack([xy, np.full(len(t), 10.0), heading])[::25]


def rms(track: Track, truth: np.ndarray) -> np.ndarray:
    """Root mean square errors of speed (m/s) and heading (rad), two seconds of the start left out."""
    return np.asarray(np.sqrt(((track.state[:, 2:4] - truth[:, 2:])[4:] ** 2).mean(axis=0)))


def test_given_places_are_taken_off_every_kind_of_sensor() -> None:
    """Without them no state fits all the sensors: the wheel's speed differs by 1.1 m * 0.3 rad/s from the GNSS's."""
    measurements, stamp_ns, truth = slalom(ANTENNA_M, IMU_M, WHEEL_M)
    given = {"gps": ANTENNA_M, "imu": IMU_M, "wheel": WHEEL_M}
    config = EstimatorConfig(latency="none", sensor_model="none")
    with_them = estimate_track(measurements, replace(config, lever_arms=given), stamp_ns)
    without = estimate_track(measurements, config, stamp_ns)
    error = np.abs(with_them.state[4:, :4] - truth[4:])
    assert error[:, :2].max() < 0.1
    assert np.sqrt((error[:, 2] ** 2).mean()) < 0.02
    assert np.degrees(error[:, 3].max()) < 0.3
    assert np.sqrt((np.hypot(*(without.state[4:, :2] - truth[4:, :2]).T) ** 2).mean()) > 0.5  # nearer to the antenna
    assert (rms(without, truth) > 3.0 * rms(with_them, truth)).all()


def test_a_calibration_s_places_ahead_are_used_and_the_states_stay_the_antenna_s() -> None:
    measurements, stamp_ns, truth = slalom((1.5, 0.0), (0.8, 0.0), (0.0, 0.0))
    constants = {
        "gps": {"position": {"noise_sigma": 0.03, "ahead_m": 1.5}, "velocity": {"noise_sigma": 0.05, "ahead_m": 1.5}},
        "wheel": {"speed": {"noise_sigma": 0.02}},
        "imu": {"accel": {"noise_sigma": 0.02, "ahead_m": 0.8}, "yaw_rate": {"noise_sigma": 0.002}},
    }
    table = {
        source: {kind: {name: {"value": value} for name, value in own.items()} for kind, own in kinds.items()}
        for source, kinds in constants.items()
    }
    calibration = parse_calibration_table({"cwcli_calibration": 1, **table}, "car.toml")
    config = EstimatorConfig(latency="none", causal=True, calibration=calibration)
    track = estimate_track(measurements, config, stamp_ns)
    antenna_xy = truth[:, :2] + 1.5 * np.stack([np.cos(truth[:, 3]), np.sin(truth[:, 3])], axis=1)
    assert np.hypot(*(track.state[4:, :2] - antenna_xy[4:]).T).max() < 0.1
    assert np.degrees(rms(track, truth)[1]) < 0.3
    reports = {s.kind: s.ahead_m for s in track.sources}
    assert reports[Kind.ACCEL].status is ParameterStatus.GIVEN
    assert reports[Kind.POSITION].value == pytest.approx(1.5, abs=1e-6)


def test_places_ahead_that_show_are_found_and_the_states_stay_the_antenna_s() -> None:
    run = one_run("city", 1000, "auto", 1.5, 0.8)
    for kind, true in ((Kind.POSITION, 1.5), (Kind.ACCEL, 0.8)):
        (found,) = (s.ahead_m for s in run.track.sources if s.kind is kind)
        assert found.status is ParameterStatus.USED
        assert abs(found.value - true) < 3.0 * found.sigma < 0.5
    assert run.rms["position"] < 0.2
    assert all(NEES_BOUNDS[0] <= run.nees[name] <= NEES_BOUNDS[1] for name in ("position", "speed", "heading"))


def test_no_place_ahead_is_found_where_there_is_none() -> None:
    run = one_run("city", 1001, "auto")
    assert all(s.ahead_m.status is not ParameterStatus.USED for s in run.track.sources)


def test_an_arm_that_may_be_a_latency_is_told_where_it_is_clear_by_itself() -> None:
    series = [
        SensorSeries(f"/{i}", kind, np.zeros(1), np.zeros((1, 2)), np.ones((1, 3)))
        for i, kind in enumerate((Kind.POSITION, Kind.POSITION, Kind.ACCEL, Kind.POSITION))
    ]
    ahead_m = {0: (1.9, 0.5), 1: (1.4, 0.5), 2: (2.0, 0.1), 3: (2.0, 0.1)}
    (note,) = notes_on_arms_that_may_be_latencies(series, ahead_m, [0, 1, 2])
    assert note.startswith("/0: its fixes are late, or its antenna stands about 1.9 m ahead of the rear axle")
