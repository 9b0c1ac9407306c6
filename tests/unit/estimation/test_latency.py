"""Latencies, biases and noise found from a simulated city drive. The full study: `python -m tests.studies.latency`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation import EstimatorConfig, Kind, Latency, LatencyStatus, Measurements, Track, estimate_track
from cwcli.estimation.latency import remove_latency_drift
from cwcli.estimation.passes import SensorSeries
from tests.studies.city_drive import EPOCH_NS, Sensors, city_drive, measure
from tests.studies.latency import SOURCES, TOLERANCE_S, one_run, with_slow_error

ATOL_M2 = 1e-4
DURATION_S = 300.0


def test_planted_latencies_are_found_and_corrected_within_10_ms_in_nineteen_of_twenty() -> None:
    """A small version of the study: 5 runs, 3 sources, planted between -50 and 300 ms."""
    runs = [one_run(seed, DURATION_S) for seed in range(5)]
    for errors_s in ([r.error_s for r in runs], [r.left_s for r in runs]):
        errors = np.array([[error_s[s] for s in SOURCES] for error_s in errors_s])
        assert (np.abs(errors) <= TOLERANCE_S).mean() >= 0.95
        assert np.abs(errors).max() < 0.02


def test_a_latency_of_a_second_is_found_through_the_coarse_guess() -> None:
    track = estimate_track(measure(city_drive(3, DURATION_S), 3, {"gnss": 0.5, "speed": 1.0}), EstimatorConfig())
    found = {r.source: r for r in track.sources}
    assert found["gnss"].latency.applied_s == pytest.approx(0.5, abs=0.02)
    assert found["speed"].latency.applied_s == pytest.approx(1.0, abs=0.02)
    assert found["imu"].latency.status == "reference"


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


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_without_a_latency_the_default_is_the_track_that_trusts_the_stamps(seed: int) -> None:
    """What is found is told with its sigma, and nothing is moved."""
    measurements = measure(city_drive(seed, 150.0), seed, {})
    track = estimate_track(measurements, EstimatorConfig())
    for r in track.sources:
        if r.latency.status is not LatencyStatus.REFERENCE:
            assert r.latency.status is LatencyStatus.NOT_SIGNIFICANT
            assert abs(r.latency.found_s) < 3.0 * r.latency.sigma_s < 0.1
            assert r.latency.applied_s == 0.0
    np.testing.assert_array_equal(track.state, estimate_track(measurements, EstimatorConfig(latency="none")).state)


@pytest.mark.long
def test_sigma_is_that_of_the_error_where_noise_is_white() -> None:
    """Twelve drives without a latency: the errors over the said sigmas scatter by about one."""
    drives = [measure(city_drive(seed, 150.0), seed, {}) for seed in range(20, 32)]
    latencies = [
        r.latency
        for measurements in drives
        for r in estimate_track(measurements, EstimatorConfig()).sources
        if r.latency.status is not LatencyStatus.REFERENCE
    ]
    pulls = np.array([latency.found_s / latency.sigma_s for latency in latencies])
    assert len(pulls) == 36
    assert 0.6 < np.sqrt(np.mean(pulls**2)) < 1.15


def drifting(late_s) -> tuple[Track, Track, np.ndarray]:
    """The default's track and the one that trusts the stamps, both at the fixes, and where the car was then."""
    drive = city_drive(0, DURATION_S)
    gnss, *rest = measure(drive, 0, {})
    late_ns = np.round(1e9 * late_s((gnss.stamp_ns - EPOCH_NS) / 1e9)).astype(np.int64)
    measurements = [replace(gnss, stamp_ns=gnss.stamp_ns + late_ns), *rest]
    when_ns = EPOCH_NS + np.arange(20, 280, dtype=np.int64) * 10**9
    default, trusting = (
        estimate_track(measurements, EstimatorConfig(latency=mode), when_ns) for mode in ("auto", "none")
    )
    aligned = estimate_track([gnss, *rest], EstimatorConfig(latency="none"), when_ns)
    return default, trusting, aligned.state[:, :2]


@pytest.mark.parametrize(
    ("late_s", "rate", "left"),
    [
        pytest.param(lambda t: 0.2 * t / DURATION_S, 0.2 / DURATION_S, 0.2, id="from 0 to 200 ms"),
        # The least squares' line through a step of 0.2 s grows by 1.5 times 0.2 s over the drive, and leaves 50 of the
        # 141 ms (root mean squares); the filter that trusts the stamps believes the fixes less, and errs less.
        pytest.param(
            lambda t: np.where(t > DURATION_S / 2, 0.2, 0.0),
            1.5 * 0.2 / DURATION_S,
            0.6,
            id="a step",
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_latency_that_drifts_is_corrected_along_a_line(late_s, rate: float, left: float) -> None:
    default, trusting, xy = drifting(late_s)
    latency = default.sources[0].latency
    assert latency.status is LatencyStatus.DRIFTS
    assert latency.found_s == pytest.approx(0.1, abs=0.02)
    assert latency.drift == pytest.approx(rate, rel=0.2)
    assert [note for note in default.notes if "drifts by" in note]
    error, without = (np.hypot(*(track.state[:, :2] - xy).T) for track in (default, trusting))
    assert np.sqrt(np.mean(error**2)) < left * np.sqrt(np.mean(without**2))


def test_beyond_what_was_searched_a_drift_is_held() -> None:
    """0.1 s and 1 ms per second about 1000 s: at 1100 s 0.2 s; from 1150 s on it stays 0.25 s."""
    stamps = SensorSeries(
        "gnss", Kind.POSITION, np.array([1000.0, 1100.0, 1150.0, 1400.0]), np.zeros((4, 2)), np.zeros((4, 3))
    )
    latency = Latency(LatencyStatus.DRIFTS, 0.1, drift=0.001, middle_s=1000.0)
    np.testing.assert_allclose(remove_latency_drift(stamps, latency).time_s, [1000.0, 1099.9, 1149.85, 1399.85])


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_a_speed_says_nothing_of_a_headings_latency(seed: int) -> None:
    """With the latency a state the filter was sure of 196, -293 and 500 ms; fixed ones are all as good."""
    measurements = measure(city_drive(seed, DURATION_S), seed, {})[:3]
    found = {r.source: r.latency for r in estimate_track(measurements, EstimatorConfig()).sources}
    assert found["speed"].status is LatencyStatus.REFERENCE
    assert found["heading"].applied_s == 0.0
    assert found["heading"].status is LatencyStatus.NOT_OBSERVABLE


@pytest.mark.parametrize("duration_s", [1.0, 5.0, 20.0])
def test_a_short_log_has_no_latency_corrected_that_is_not_there(duration_s: float) -> None:
    measurements = measure(city_drive(1, duration_s), 1, {})
    track = estimate_track(measurements, EstimatorConfig())
    assert np.isfinite(track.state).all()
    assert {r.latency.applied_s for r in track.sources} == {0.0}


def test_a_large_latency_of_a_short_log_is_applied_with_a_wide_sigma() -> None:
    """Forty seconds are eight blocks of five seconds, in few of which something happens."""
    track = estimate_track(measure(city_drive(1, 40.0), 1, {"gnss": 0.3}), EstimatorConfig())
    latency = track.sources[0].latency
    assert latency.status is LatencyStatus.APPLIED
    assert latency.found_s == pytest.approx(0.3, abs=0.04)
    assert 1.3 * latency.bound_s < latency.sigma_s < 0.1


def test_a_parked_car_shows_no_latency() -> None:
    rng = np.random.default_rng(0)
    stamp = EPOCH_NS + np.arange(0, 100_000_000_000, 50_000_000)
    n = len(stamp)
    imu = np.tile([0.0, 0.0, 9.81, 0.0, 0.0, 0.0], (n, 1)) + 0.01 * rng.standard_normal((n, 6))
    measurements = [
        Measurements("gnss", Kind.POSITION, stamp, 0.5 * rng.standard_normal((n, 2))),
        Measurements("speed", Kind.SPEED, stamp, np.zeros(n)),
        Measurements("imu", Kind.IMU, stamp, imu),
    ]
    found = [r.latency for r in estimate_track(measurements, EstimatorConfig()).sources[:2]]
    assert [latency.status for latency in found] == [LatencyStatus.NOT_OBSERVABLE] * 2


def test_one_source_is_its_own_reference() -> None:
    (gnss, *_) = measure(city_drive(2, 60.0), 2, {"gnss": 0.3})
    (report,) = estimate_track([gnss], EstimatorConfig()).sources
    assert report.latency == Latency(LatencyStatus.REFERENCE)


def test_causal_and_smoothed_tracks_correct_the_same_latency() -> None:
    measurements = measure(city_drive(8, 150.0), 8, {"gnss": 0.1})
    smoothed, causal = (estimate_track(measurements, EstimatorConfig(causal=c)).sources for c in (False, True))
    assert [r.latency for r in smoothed] == [r.latency for r in causal]
    assert smoothed[0].latency.status is LatencyStatus.APPLIED


def test_the_papers_filter_tells_the_latency_that_was_given() -> None:
    measurements = measure(city_drive(2, 30.0), 2, {})
    config = EstimatorConfig(model="song2016", latency={"gnss": 0.2})
    found = {r.source: r.latency for r in estimate_track(measurements, config).sources}
    assert found["gnss"] == Latency(LatencyStatus.GIVEN, 0.2)
    assert found["speed"].status is LatencyStatus.OFF


def test_a_car_that_drives_straight_at_one_speed_shows_no_latency() -> None:
    time = np.arange(0.0, 100.0, 0.1)
    rng = np.random.default_rng(0)
    xy = np.stack([10.0 * time, 0 * time], axis=1) + 0.3 * rng.standard_normal((1000, 2))
    imu = np.tile([0.0, 0.0, 9.81, 0.0, 0.0, 0.0], (1000, 1)) + 0.01 * rng.standard_normal((1000, 6))
    stamp = EPOCH_NS + (time * 1e9).astype(np.int64)
    track = estimate_track(
        [Measurements("gnss", Kind.POSITION, stamp, xy), Measurements("imu", Kind.IMU, stamp, imu)], EstimatorConfig()
    )
    assert track.sources[0].latency.status == "not observable"
    assert track.sources[0].latency.applied_s == 0.0
    assert any("not observable" in note for note in track.notes)


def test_given_latency_is_used_as_it_is_and_the_others_are_found() -> None:
    measurements = measure(city_drive(5, 150.0), 5, {"gnss": 0.2, "speed": 0.1})
    track = estimate_track(measurements, EstimatorConfig(latency={"gnss:position": 0.2}))
    found = {r.source: r for r in track.sources}
    assert (found["gnss"].latency.applied_s, found["gnss"].latency.status) == (0.2, "given")
    assert found["speed"].latency.status == "applied"
    off = estimate_track(measurements, EstimatorConfig(latency="none"))
    assert {r.latency.status for r in off.sources} == {"off"}


def test_the_others_are_found_against_an_imu_whose_latency_is_given() -> None:
    """The IMU comes 80 ms late and the positions 300 ms."""
    measurements = measure(city_drive(7, 150.0), 7, {"imu": 0.08, "gnss": 0.3})
    found = {r.source: r.latency for r in estimate_track(measurements, EstimatorConfig(latency={"imu": 0.08})).sources}
    assert found["imu"] == Latency(LatencyStatus.GIVEN, 0.08)
    assert found["gnss"].applied_s == pytest.approx(0.3, abs=2 * TOLERANCE_S)
    assert found["speed"].status is LatencyStatus.NOT_SIGNIFICANT
    assert found["speed"].found_s == pytest.approx(0.0, abs=3.0 * found["speed"].sigma_s)


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
    """The IMU comes 80 ms late, all others on time: they agree."""
    drive = city_drive(7, DURATION_S)
    track = estimate_track(measure(drive, 7, {"imu": 0.08}), EstimatorConfig())
    found = {r.source: r for r in track.sources}
    assert found["imu"].latency.applied_s == pytest.approx(0.08, abs=TOLERANCE_S)
    assert {found[source].latency.status for source in ("gnss", "speed", "heading")} == {LatencyStatus.REFERENCE}
    assert any("so imu is late" in note for note in track.notes)
    inside = slice(100, -100)
    truth = drive.at((track.stamp_ns[inside] - EPOCH_NS) / 1e9)
    error = np.hypot(track.state[inside, 0] - truth["x_m"], track.state[inside, 1] - truth["y_m"])
    assert np.sqrt((error**2).mean()) < 0.2


def test_position_is_no_surer_along_the_way_than_its_latency() -> None:
    """Along the way its variance grows by (v sigma)^2 against that with the same latency given as exact.

    The growth is what the filter makes of moved stamps, in which the noise of the fixes differs: within a fifth in the
    mean, and nowhere below half. Across the way it does not grow.
    """
    measurements = measure(city_drive(6, 60.0), 6, {"gnss": 0.25})
    found = estimate_track(measurements, EstimatorConfig())
    latency = found.sources[0].latency
    assert latency.status is LatencyStatus.APPLIED
    exact = estimate_track(measurements, EstimatorConfig(latency={"gnss": latency.found_s}))
    heading = found.state[:, 3]
    along, across = np.stack([np.cos(heading), np.sin(heading)]), np.stack([-np.sin(heading), np.cos(heading)])
    grown = [
        np.einsum("in,nij,jn->n", axis, found.covariance[:, :2, :2] - exact.covariance[:, :2, :2], axis)
        for axis in (along, across)
    ]
    expected = (found.state[:, 2] * latency.sigma_s) ** 2
    assert grown[0].mean() == pytest.approx(expected.mean(), rel=0.2)
    assert (grown[0] >= 0.5 * expected - ATOL_M2).all()
    np.testing.assert_allclose(grown[1], 0.0, atol=ATOL_M2)


def test_slow_errors_of_the_fixes_are_told_from_a_latency_and_bound_it() -> None:
    """1.5 m over 3 s: the bound is near the errors of 24 drives, 24 ms; white noise would promise 6 ms."""
    measurements = measure(city_drive(3, 300.0), 3, {})
    slow = [with_slow_error(m, 1.5, 3.0, 3) if m.kind is Kind.POSITION else m for m in measurements]
    white, coloured = (estimate_track(m, EstimatorConfig()).sources[0].latency for m in (measurements, slow))
    assert white.bound_s < 0.005
    assert 0.01 < coloured.bound_s < 0.03
    assert coloured.status is LatencyStatus.NOT_SIGNIFICANT
    assert abs(coloured.found_s) < 2.0 * coloured.sigma_s < 0.1
    (few,) = (
        report
        for report in estimate_track(
            [m.select_rows(m.stamp_ns < EPOCH_NS + 30 * 10**9) for m in slow], EstimatorConfig()
        ).sources
        if report.kind is Kind.POSITION
    )
    assert few.latency.status is LatencyStatus.NOT_OBSERVABLE
    assert few.latency.bound_s > 0.05
