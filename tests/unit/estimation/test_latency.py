"""Latencies, biases and noise found from a simulated city drive. The full study: `python -m tests.studies.latency`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation import EstimatorConfig, Kind, Measurements, estimate_track
from tests.studies.city_drive import EPOCH_NS, Sensors, city_drive, measure
from tests.studies.latency import SOURCES, TOLERANCE_S, one_run

DURATION_S = 300.0


def test_planted_latencies_are_found_within_10_ms_in_nineteen_of_twenty() -> None:
    """A small version of the study: 7 runs, 3 sources, planted between -50 and 300 ms."""
    errors = np.array([[one_run(seed, DURATION_S).error_s[s] for s in SOURCES] for seed in range(5)])
    assert (np.abs(errors) <= TOLERANCE_S).mean() >= 0.95
    assert np.abs(errors).max() < 0.02


def test_a_latency_of_a_second_is_found_through_the_coarse_guess() -> None:
    track = estimate_track(measure(city_drive(3, DURATION_S), 3, {"gnss": 0.5, "speed": 1.0}), EstimatorConfig())
    found = {r.source: r for r in track.sources}
    assert found["gnss"].latency_s == pytest.approx(0.5, abs=0.02)
    assert found["speed"].latency_s == pytest.approx(1.0, abs=0.02)
    assert found["imu"].latency_status == "reference"


def test_biases_and_noise_are_found() -> None:
    sensors = replace(Sensors(), accel_bias_mps2=-1.7, yaw_rate_bias_radps=0.008)
    track = estimate_track(measure(city_drive(4, DURATION_S), 4, {}, sensors), EstimatorConfig())
    found = {r.kind: r for r in track.sources}
    assert found[Kind.ACCEL].bias == pytest.approx(-1.7, abs=0.05)
    assert found[Kind.YAW_RATE].bias == pytest.approx(0.008, abs=2e-4)
    assert found[Kind.POSITION].sigma == pytest.approx(0.6, rel=0.1)
    assert found[Kind.SPEED].sigma == pytest.approx(0.5, rel=0.1)
    assert found[Kind.HEADING].sigma == pytest.approx(np.radians(1.0), rel=0.15)
    assert found[Kind.ACCEL].sigma == pytest.approx(0.049, rel=0.15)
    assert {found[k].noise_origin for k in found} == {"log"}
    for kind in (Kind.POSITION, Kind.SPEED, Kind.HEADING):
        assert found[kind].nis_mean == pytest.approx(found[kind].nis_dof, rel=0.1)


def test_a_car_that_drives_straight_at_one_speed_shows_no_latency() -> None:
    time = np.arange(0.0, 100.0, 0.1)
    rng = np.random.default_rng(0)
    xy = np.stack([10.0 * time, 0 * time], axis=1) + 0.3 * rng.standard_normal((1000, 2))
    imu = np.tile([0.0, 0.0, 9.81, 0.0, 0.0, 0.0], (1000, 1)) + 0.01 * rng.standard_normal((1000, 6))
    stamp = EPOCH_NS + (time * 1e9).astype(np.int64)
    track = estimate_track(
        [Measurements("gnss", Kind.POSITION, stamp, xy), Measurements("imu", Kind.IMU, stamp, imu)], EstimatorConfig()
    )
    assert track.sources[0].latency_status == "not observable"
    assert track.sources[0].latency_s == 0.0
    assert any("not observable" in note for note in track.notes)


def test_given_latency_is_used_as_it_is_and_the_others_are_found() -> None:
    measurements = measure(city_drive(5, 150.0), 5, {"gnss": 0.2, "speed": 0.1})
    track = estimate_track(measurements, EstimatorConfig(latency={"gnss:position": 0.2}))
    found = {r.source: r for r in track.sources}
    assert (found["gnss"].latency_s, found["gnss"].latency_status) == (0.2, "given")
    assert found["speed"].latency_status == "estimated"
    off = estimate_track(measurements, EstimatorConfig(latency="none"))
    assert {r.latency_status for r in off.sources} == {"off"}


def test_correcting_the_latency_makes_the_track_better() -> None:
    drive = city_drive(6, DURATION_S)
    measurements = measure(drive, 6, {"gnss": 0.25, "speed": 0.1, "heading": 0.1})
    output = EPOCH_NS + (np.arange(5.0, DURATION_S - 5.0, 0.1) * 1e9).astype(np.int64)
    truth = drive.at((output - EPOCH_NS) / 1e9)
    rms = {}
    for latency in ("auto", "none"):
        state = estimate_track(measurements, EstimatorConfig(latency=latency), output).state
        rms[latency] = np.sqrt(np.mean((state[:, 0] - truth["x_m"]) ** 2 + (state[:, 1] - truth["y_m"]) ** 2))
    assert rms["auto"] < 0.2
    assert rms["none"] > 3.0 * rms["auto"]


def test_states_are_on_the_positions_clock_where_the_imu_is_late() -> None:
    """The IMU comes 80 ms late, the positions on time: a position can't be early, so its clock rules."""
    drive = city_drive(7, DURATION_S)
    track = estimate_track(measure(drive, 7, {"imu": 0.08}), EstimatorConfig())
    found = {r.source: r for r in track.sources}
    assert found["gnss"].latency_s == pytest.approx(-0.08, abs=TOLERANCE_S)
    assert any("reference is late" in note for note in track.notes)
    inside = slice(100, -100)
    truth = drive.at((track.stamp_ns[inside] - EPOCH_NS) / 1e9)
    error = np.hypot(track.state[inside, 0] - truth["x_m"], track.state[inside, 1] - truth["y_m"])
    assert np.sqrt((error**2).mean()) < 0.2
