import numpy as np
import pytest

from cwcli.simulation.dual_sensor import (
    TARGET_POSITIONS_BY_PATH_SHAPE,
    SensorNoise,
    measure_positions_with_lidar,
    measure_states_with_radar,
    observe_single_target,
    simulate_static_target,
    times_and_true_states_on_path,
)
from tests.crossing_targets import simulate_crossing_targets

NOISE = SensorNoise(lidar_m=0.1, range_m=0.25, azimuth_rad=0.01, rate_mps=0.12)


def test_measurements_of_a_known_state_have_the_declared_noise() -> None:
    # at (3, 4) with velocity (1, 2): range 5, azimuth atan2(4, 3), range rate (3 + 8) / 5 = 2.2 (eq. 2-4)
    state = np.tile([3.0, 4.0, 1.0, 2.0], (40_000, 1))
    rng = np.random.default_rng(0)
    seen = measure_states_with_radar(state, NOISE, rng)
    np.testing.assert_allclose(seen.mean(axis=0), [5.0, np.arctan2(4.0, 3.0), 2.2], atol=0.005)
    np.testing.assert_allclose(seen.std(axis=0), [0.25, 0.01, 0.12], rtol=0.02)
    points = measure_positions_with_lidar(state, NOISE, rng)
    np.testing.assert_allclose(points.mean(axis=0), [3.0, 4.0], atol=0.005)
    np.testing.assert_allclose(points.std(axis=0), 0.1, rtol=0.02)


def test_ranges_stay_positive_and_azimuths_within_pi() -> None:
    state = np.tile([-0.1, 0.0, 0.0, 0.0], (1000, 1))
    seen = measure_states_with_radar(state, NOISE, np.random.default_rng(0))
    assert (seen[:, 0] >= 0.0).all()
    assert (np.abs(seen[:, 1]) <= np.pi).all()


def test_a_standing_target_is_straight_ahead_and_the_sensors_alternate() -> None:
    scene = simulate_static_target(4.9, 8, NOISE, np.random.default_rng(0))
    assert len(scene.lidar_stamp_ns) == len(scene.radar_stamp_ns) == 4
    assert scene.radar_stamp_ns[0] - scene.lidar_stamp_ns[0] == 50_000_000
    np.testing.assert_array_equal(scene.truth_state, np.tile([0.0, 4.9, 0.0, 0.0], (8, 1)))


@pytest.mark.parametrize("name", TARGET_POSITIONS_BY_PATH_SHAPE)
def test_segments_are_smooth_walks_in_front_of_the_car(name) -> None:
    _, state = times_and_true_states_on_path(name, 240)
    speed = np.hypot(state[:, 2], state[:, 3])
    assert (speed > 0.5).all()
    assert (speed < 2.0).all()
    assert (state[:, 1] > 0.0).all()
    assert np.hypot(state[:, 0], state[:, 1]).max() < 25.0
    assert np.abs(np.diff(state[:, :2], axis=0)).max() < 0.11
    scene = observe_single_target(*times_and_true_states_on_path(name, 240), NOISE, np.random.default_rng(1))
    error = scene.lidar_xy - scene.truth_state[::2, :2]
    assert np.abs(error).max() < 0.5


def test_crossing_targets_meet_in_clutter_with_missed_detections() -> None:
    scene = simulate_crossing_targets(np.random.default_rng(2), n_scans=400, clutter_per_scan=10.0)
    middle = scene.truth_state[scene.truth_stamp_ns == scene.lidar_scan_ns[200], :2]
    assert np.hypot(*middle.T).max() < 5.0
    per_scan = len(scene.lidar_xy) / 400
    assert per_scan == pytest.approx(10.0 + 5 * 0.9, abs=0.6)
    assert len(scene.radar) == 0
    assert len(scene.truth_state) == 5 * 400


def test_crossing_targets_with_radar_alternate_and_repeat_with_the_seed() -> None:
    a, b = (simulate_crossing_targets(np.random.default_rng(3), with_radar=True) for _ in range(2))
    np.testing.assert_array_equal(a.radar, b.radar)
    assert len(a.lidar_scan_ns) == len(a.radar_scan_ns) == 50
    assert set(a.radar_stamp_ns.tolist()) <= set(a.radar_scan_ns.tolist())
    assert a.radar.shape[1] == 3
