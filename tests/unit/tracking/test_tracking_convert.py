import numpy as np
import pytest

from cwcli.tracking.convert import (
    radar_values_and_covariances_from_cartesian,
    target_rows_of_result,
    vehicle_states_and_covariances_of_target,
)
from cwcli.tracking.detections import DetectionKind, Detections
from cwcli.tracking.gospa import TargetMoments
from cwcli.tracking.tracker import track_many_targets, track_one_target


def test_a_cartesian_radar_track_becomes_range_azimuth_and_rate() -> None:
    values, covariance = radar_values_and_covariances_from_cartesian(np.array([[3.0, 4.0]]), np.array([[1.0, 2.0]]))
    np.testing.assert_allclose(values, [[5.0, np.arctan2(4.0, 3.0), 2.2]])
    assert np.isnan(covariance).all()


def test_its_covariance_is_that_of_many_samples() -> None:
    rng = np.random.default_rng(0)
    p, v = np.array([30.0, 40.0]), np.array([-5.0, 2.0])
    cov_p, cov_v = np.array([[0.2, 0.05], [0.05, 0.1]]), np.diag([0.3, 0.1])
    n = 200_000
    samples, _ = radar_values_and_covariances_from_cartesian(
        rng.multivariate_normal(p, cov_p, n), rng.multivariate_normal(v, cov_v, n)
    )
    _, covariance = radar_values_and_covariances_from_cartesian(p[None], v[None], cov_p[None], cov_v[None])
    scale = np.sqrt(np.diag(covariance[0]))
    np.testing.assert_allclose(
        np.cov(samples.T) / np.outer(scale, scale), covariance[0] / np.outer(scale, scale), atol=0.02
    )


def test_no_covariance_at_range_0_and_where_it_is_not_given() -> None:
    given = np.stack([np.eye(2), np.full((2, 2), np.nan), np.eye(2)])
    values, covariance = radar_values_and_covariances_from_cartesian(
        np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]), np.zeros((3, 2)), given, given
    )
    assert np.isnan(covariance).all(axis=(1, 2)).tolist() == [True, True, False]
    assert values[0, 0] == 0.0


def test_rows_of_all_tracks_are_in_the_order_of_time() -> None:
    stamp = np.repeat(np.arange(30), 2) * 100_000_000
    xy = np.stack([stamp * 1e-9, np.tile([0.0, 30.0], 30)], axis=1)
    rows = target_rows_of_result(track_many_targets([Detections("lidar", DetectionKind.POSITION, stamp, xy)]))
    assert len(rows.stamp_ns) == 60
    assert rows.id[:4].tolist() == [1, 2, 1, 2]
    assert (np.diff(rows.stamp_ns) >= 0).all()
    assert rows.sensor.values == ("lidar",)
    assert rows.covariance.shape == (60, 4, 4)
    assert len(target_rows_of_result(track_one_target([])).stamp_ns) == 0


def test_vehicle_states_hold_the_heading_when_the_target_stops() -> None:
    state = np.array([[0, 0, 0.01, 0.2], [0, 0, 3.0, 4.0], [1, 1, 0.1, -0.1], [1, 1, -2.0, 0.0]])
    out, covariance = vehicle_states_and_covariances_of_target(state, np.tile(np.eye(4) * 0.01, (4, 1, 1)))
    heading = np.arctan2(4.0, 3.0)
    np.testing.assert_allclose(out[:, 3], [heading, heading, heading, np.pi - 2 * np.pi])
    np.testing.assert_allclose(out[:, 2], np.hypot(state[:, 2], state[:, 3]))
    assert covariance[1, 2, 2] == pytest.approx(0.01)
    assert covariance[1, 3, 3] == pytest.approx(0.01 / 25.0)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12


def test_an_unknown_velocity_gives_a_heading_that_may_be_anything() -> None:
    _, covariance = vehicle_states_and_covariances_of_target(np.zeros((1, 4)), np.eye(4)[None] * 100.0)
    assert covariance[0, 3, 3] == pytest.approx(np.pi**2 / 3)


def test_truth_is_brought_to_the_stamps_of_the_tracks() -> None:
    s = 1_000_000_000
    truth = TargetMoments(np.array([0, s // 4, 3 * s, 0]), np.array([1, 1, 1, 2]), np.arange(16.0).reshape(4, 4))
    there = truth.interpolate_at(np.array([0, s // 8, s // 4, s, 3 * s, 4 * s]))
    first = there.id == 1
    assert there.stamp_ns[first].tolist() == [0, s // 8, s // 4, 3 * s]  # nothing in the gap
    np.testing.assert_allclose(there.state[first][:, 0], [0.0, 2.0, 4.0, 8.0])
    assert there.stamp_ns[~first].tolist() == [0]
