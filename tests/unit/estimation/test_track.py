"""The front door: starts, outages, standstill, odd input. Truth is made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.errors import DataError
from cwcli.estimation import EstimatorConfig, Kind, Measurements, estimate_track, estimate_tracks
from cwcli.estimation.config import ModelName

T0 = 1_700_000_000_000_000_000
NO_SEARCH = EstimatorConfig(latency="none")
CAUSAL = EstimatorConfig(latency="none", causal=True)


def stamps(time_s: np.ndarray) -> np.ndarray:
    return T0 + np.round(time_s * 1e9).astype(np.int64)


def straight(time_s: np.ndarray, speed: float, heading: float, sigma: float, seed: int = 0) -> Measurements:
    rng = np.random.default_rng(seed)
    xy = speed * time_s[:, None] * np.array([np.cos(heading), np.sin(heading)])
    return Measurements("gps", Kind.POSITION, stamps(time_s), xy + sigma * rng.standard_normal(xy.shape))


@pytest.mark.parametrize("heading", [0.0, 2.0, np.pi, -1.2])
@pytest.mark.parametrize("config", [NO_SEARCH, CAUSAL], ids=["smoothed", "causal"])
def test_track_from_positions_alone_finds_speed_and_heading(heading: float, config: EstimatorConfig) -> None:
    time = np.arange(0.0, 30.0, 0.1)
    track = estimate_track([straight(time, 12.0, heading, 0.5)], config, stamps(time))
    late = track.state[150:]
    np.testing.assert_allclose(late[:, 2], 12.0, atol=2.0 if config.causal else 1.0)
    np.testing.assert_allclose(np.angle(np.exp(1j * (late[:, 3] - heading))), 0.0, atol=0.1)


def test_track_of_a_stationary_car_stays_and_keeps_its_covariance_small() -> None:
    time = np.arange(0.0, 120.0, 0.1)
    track = estimate_track([straight(time, 0.0, 0.0, 0.5)], NO_SEARCH, stamps(time))
    assert np.isfinite(track.state).all()
    np.testing.assert_allclose(track.state[:, :2], 0.0, atol=0.6)
    np.testing.assert_allclose(track.state[10:, 2], 0.0, atol=0.3)
    assert track.covariance[:, 0, 0].max() < 0.52**2  # one fix's at the ends


def test_track_keeps_its_heading_through_a_stop() -> None:
    """Drive north, stand for a minute, drive on north: the heading drifts little while it cannot be seen."""
    time = np.arange(0.0, 100.0, 0.1)
    speed = np.interp(time, [0, 15, 20, 80, 85, 100], [10, 10, 0, 0, 10, 10])
    y = np.cumsum(speed) * 0.1
    rng = np.random.default_rng(1)
    xy = np.stack([0 * y, y], axis=1) + 0.3 * rng.standard_normal((len(time), 2))
    track = estimate_track([Measurements("gps", Kind.POSITION, stamps(time), xy)], NO_SEARCH, stamps(time))
    np.testing.assert_allclose(track.state[:, 3], np.pi / 2, atol=0.7)


def test_track_bridges_an_outage_with_growing_covariance() -> None:
    time = np.arange(0.0, 40.0, 0.1)
    seen = time[(time < 15.0) | (time > 25.0)]
    smoothed = estimate_track([straight(seen, 10.0, 0.5, 0.3)], NO_SEARCH, stamps(time))
    sigma = np.sqrt(smoothed.covariance[:, 0, 0])
    middle = np.argmax(sigma)
    assert 18.0 < time[middle] < 24.0  # the filter knows less of the heading towards the end
    assert sigma[middle] > 3.0 * sigma[100]
    error = np.hypot(*(smoothed.state[:, :2] - 10.0 * time[:, None] * np.array([np.cos(0.5), np.sin(0.5)])).T)
    assert error.max() < 4.0 * sigma[middle]
    causal = estimate_track([straight(seen, 10.0, 0.5, 0.3)], CAUSAL, stamps(time))
    inside = (time > 15.2) & (time < 24.8)
    assert (np.diff(np.sqrt(causal.covariance[inside, 0, 0])) > 0).all()


@pytest.mark.parametrize("model", ["cwcli", "song2016"])
@pytest.mark.parametrize("standing_s", [0.0, 30.0])
def test_causal_track_from_positions_is_honest_from_its_first_state(standing_s: float, model: ModelName) -> None:
    """Positions from before the heading shows are old when the filter starts: they must not pull it back."""
    time = np.arange(0.0, standing_s + 20.0, 0.1)
    way = 10.0 * np.maximum(time - standing_s, 0.0)
    gps = straight(time, 0.0, 0.0, 1.0, seed=1)
    gps = Measurements("gps", Kind.POSITION, gps.stamp_ns, gps.values + np.stack([way, 0.0 * way], axis=1))
    track = estimate_track([gps], EstimatorConfig(model=model, latency="none", causal=True), stamps(time))
    error = np.hypot(track.state[:, 0] - way, track.state[:, 1])
    sigma = np.sqrt(track.covariance[:, 0, 0] + track.covariance[:, 1, 1])
    assert (error < 4.0 * sigma).all()
    late = time > standing_s + 3.0
    assert error[late].max() < 2.5
    np.testing.assert_allclose(track.state[late, 2], 10.0, atol=4.0)
    assert track.sources[0].n_gated <= 2
    assert any("before the first heading" in note for note in track.notes)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_imu_alone_before_the_first_position_leaves_the_latency_right_and_the_covariance_honest(seed: int) -> None:
    """A log that begins in a tunnel: 15 s with a turn, an IMU with a hole, and then a fix a second."""
    rng = np.random.default_rng(seed)
    fine = np.arange(0.0, 90.0, 0.01)
    yaw_rate = 0.25 * np.sin(0.3 * fine)
    accel = 0.8 * np.sin(0.5 * fine)

    def integral(rate: np.ndarray) -> np.ndarray:
        return (np.cumsum(rate, axis=0) - 0.5 * rate) * 0.01  # a whole step would be a lead of half of it

    speed = 9.0 + integral(accel)
    heading = 1.1 + integral(yaw_rate)
    xy = integral(speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1))
    imu = np.zeros((len(fine), 6))
    imu[:, 0], imu[:, 2], imu[:, 5] = accel + 0.1, 9.81, yaw_rate + 1e-3
    imu += rng.standard_normal(imu.shape) * np.array([0.05, 0.05, 0.05, 1e-3, 1e-3, 1e-3])
    there = (fine < 0.2) | (fine > 2.0)
    rows = np.arange(1500, len(fine), 100)
    measurements = [
        Measurements("gps", Kind.POSITION, stamps(fine[rows]), xy[rows] + 0.1 * rng.standard_normal((len(rows), 2))),
        Measurements("imu", Kind.IMU, stamps(fine[there]), imu[there]),
    ]
    track = estimate_track(measurements, EstimatorConfig(), stamps(fine[::10]))
    error = track.state[:, :2] - xy[::10]
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(track.covariance[:, :2, :2]), error)
    assert nees[:150].max() < 16.0  # two degrees of freedom, one path: 99.97 %
    position = next(s for s in track.sources if s.kind is Kind.POSITION)
    assert abs(position.latency.found_s) < 0.05
    assert np.hypot(*error[170:].T).max() < 0.5


def test_causal_track_uses_nothing_that_comes_later() -> None:
    """With the noise stated, cutting the log's second half off leaves the first half as it was."""
    time = np.arange(0.0, 20.0, 0.1)
    whole = straight(time, 10.0, 0.5, 0.3)
    stated = np.full((len(time), 2), 0.09)
    config = EstimatorConfig(latency="none", causal=True)
    half = slice(0, 100)
    all_of_it = Measurements("gps", Kind.POSITION, whole.stamp_ns, whole.values, stated)
    first_half = Measurements("gps", Kind.POSITION, whole.stamp_ns[half], whole.values[half], stated[half])
    a = estimate_track([all_of_it], config, whole.stamp_ns[half])
    b = estimate_track([first_half], config, whole.stamp_ns[half])
    # Liveliness is found from the whole log in both; positions hardly depend on it.
    np.testing.assert_allclose(a.state[:, :2], b.state[:, :2], atol=0.15)


def test_rows_that_are_not_finite_are_counted_and_left_out() -> None:
    time = np.arange(0.0, 20.0, 0.1)
    m = straight(time, 10.0, 0.0, 0.3)
    values = m.values.copy()
    values[3, 0], values[50, 1] = np.nan, np.inf
    track = estimate_track([Measurements("gps", Kind.POSITION, m.stamp_ns, values)], NO_SEARCH, m.stamp_ns)
    (report,) = track.sources
    assert (report.n_read, report.n_not_finite) == (200, 2)
    assert report.n_used + report.n_gated == 198
    assert np.isfinite(track.state).all()


def test_order_of_rows_and_repeated_stamps_do_not_matter() -> None:
    time = np.arange(0.0, 20.0, 0.1)
    m = straight(time, 10.0, 0.0, 0.3)
    mixed = np.random.default_rng(2).permutation(len(time))
    a = estimate_track([m], NO_SEARCH, m.stamp_ns)
    b = estimate_track([Measurements("gps", Kind.POSITION, m.stamp_ns[mixed], m.values[mixed])], NO_SEARCH, m.stamp_ns)
    np.testing.assert_allclose(a.state, b.state, atol=1e-9)
    twice = np.repeat(np.arange(len(time)), 2)
    c = estimate_track([Measurements("gps", Kind.POSITION, m.stamp_ns[twice], m.values[twice])], NO_SEARCH, m.stamp_ns)
    assert np.isfinite(c.state).all()
    np.testing.assert_allclose(c.state[:, :2], a.state[:, :2], atol=0.5)


def test_no_finite_position_is_a_data_error() -> None:
    time = np.arange(0.0, 1.0, 0.1)
    speed = Measurements("wheel", Kind.SPEED, stamps(time), np.ones(10))
    nan = Measurements("gps", Kind.POSITION, stamps(time), np.full((10, 2), np.nan))
    with pytest.raises(DataError, match="position"):
        estimate_track([speed], NO_SEARCH, stamps(time))
    with pytest.raises(DataError, match="position"):
        estimate_track([speed, nan], NO_SEARCH, stamps(time))


@pytest.mark.parametrize("n", [1, 2, 3])
def test_a_few_positions_are_enough_for_a_track(n: int) -> None:
    time = np.arange(n) * 1.0
    track = estimate_track([straight(time, 5.0, 0.0, 0.0)], NO_SEARCH, stamps(time))
    assert np.isfinite(track.state).all()
    np.testing.assert_allclose(track.state[:, 0], 5.0 * time, atol=2.0)


def test_a_field_that_nobody_fills_is_not_believed() -> None:
    """A yaw rate of exactly zero in every message, on a circle."""
    time = np.arange(0.0, 30.0, 0.1)
    xy = 40.0 * np.stack([np.sin(0.25 * time), 1 - np.cos(0.25 * time)], axis=1)
    zero = Measurements("twist", Kind.YAW_RATE, stamps(time), np.zeros(len(time)))
    track = estimate_track([Measurements("gps", Kind.POSITION, stamps(time), xy), zero], NO_SEARCH, stamps(time))
    np.testing.assert_allclose(track.state[50:-50, 5], 0.25, atol=0.02)
    assert any("never changes" in note for note in track.notes)


def test_heading_measurements_may_wrap() -> None:
    """Westward: the heading sensor flips between +pi and -pi."""
    time = np.arange(0.0, 20.0, 0.1)
    rng = np.random.default_rng(5)
    heading = np.angle(np.exp(1j * (np.pi + 0.05 * rng.standard_normal(len(time)))))
    m = [straight(time, 10.0, np.pi, 0.3), Measurements("ahrs", Kind.HEADING, stamps(time), heading)]
    track = estimate_track(m, NO_SEARCH, stamps(time))
    np.testing.assert_allclose(np.cos(track.state[:, 3]), -1.0, atol=0.01)
    assert track.sources[1].n_gated < 5


def test_reversing_car_has_negative_speed_where_the_speed_sensor_says_so() -> None:
    time = np.arange(0.0, 20.0, 0.1)
    m = [
        straight(time, 2.0, np.pi, 0.1),
        Measurements("wheel", Kind.SPEED, stamps(time), -2.0 + 0.05 * np.random.default_rng(0).standard_normal(200)),
    ]
    track = estimate_track(m, NO_SEARCH, stamps(time))
    np.testing.assert_allclose(track.state[20:-20, 2], -2.0, atol=0.2)
    np.testing.assert_allclose(np.cos(track.state[:, 3]), 1.0, atol=0.05)


@pytest.mark.parametrize("pause_s", [300.0, 5 * 3600.0, 46 * 365.25 * 86400.0], ids=["5 min", "5 h", "46 years"])
@pytest.mark.parametrize("config", [NO_SEARCH, CAUSAL], ids=["smoothed", "causal"])
def test_pause_of_any_length_costs_nothing_and_harms_neither_side(pause_s: float, config: EstimatorConfig) -> None:
    time = np.arange(0.0, 20.0, 0.1)
    m = straight(time, 10.0, 0.4, 0.1)
    later = np.where(time < 10.0, time, time + pause_s)
    track = estimate_track([Measurements("gps", Kind.POSITION, stamps(later), m.values)], config, stamps(later))
    np.testing.assert_allclose(track.state[150:, 2], 10.0, atol=1.5)
    np.testing.assert_allclose(track.state[:, :2], m.values, atol=3.0)
    assert np.isfinite(track.covariance).all()


def test_messages_in_a_burst_are_left_out_and_counted() -> None:
    """A link stalls for 2 s and then delivers 20 messages within 0.1 s: the car does not race."""
    time = np.arange(0.0, 60.0, 0.1)
    received = time.copy()
    held = (time > 30.0) & (time < 32.0)
    received[held] = 32.0 + 0.005 * np.arange(held.sum())
    m = straight(time, 10.0, 0.0, 0.1)
    track = estimate_track([Measurements("v2x", Kind.POSITION, stamps(received), m.values)], NO_SEARCH, stamps(time))
    assert track.sources[0].n_held_back >= held.sum() - 2
    assert track.state[:, 2].max() < 13.0


def test_default_output_is_a_grid_over_the_log() -> None:
    time = np.arange(0.0, 10.0, 0.1)
    track = estimate_track([straight(time, 10.0, 0.0, 0.1)], EstimatorConfig(latency="none", rate_hz=50.0))
    assert np.diff(track.stamp_ns).tolist() == [20_000_000] * (len(track.stamp_ns) - 1)
    assert track.stamp_ns[0] == T0


def test_fleet_equals_its_cars_one_by_one() -> None:
    time = np.arange(0.0, 20.0, 0.1)
    groups = [([straight(time, 8.0 + k, 0.3 * k, 0.3, seed=k)], stamps(time)) for k in range(4)]
    for track, (measurements, output) in zip(estimate_tracks(groups, NO_SEARCH), groups, strict=True):
        np.testing.assert_array_equal(track.state, estimate_track(measurements, NO_SEARCH, output).state)


def test_song2016_model_runs_on_asynchronous_sensors() -> None:
    time = np.arange(0.0, 20.0, 0.1)
    m = [
        straight(time, 10.0, 0.4, 0.6),
        Measurements(
            "wheel", Kind.SPEED, stamps(time + 0.03), 10.0 + 0.5 * np.random.default_rng(1).standard_normal(200)
        ),
    ]
    track = estimate_track(m, EstimatorConfig(model="song2016", causal=True), stamps(time))
    np.testing.assert_allclose(track.state[100:, 2], 10.0, atol=0.5)
    # jerk and yaw acceleration are 0 in truth; their errors go together for a second, so not each is independent
    sigma = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2)[100:, 6:])
    assert (np.abs(track.state[100:, 6:]) < 4.0 * sigma).all()
    assert {r.source for r in track.sources} == {"gps", "wheel"}
