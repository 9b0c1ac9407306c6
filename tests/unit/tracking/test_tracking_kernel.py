"""The kernel against its plain NumPy twin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.kernels.track import RowStatus
from cwcli.simulation.dual_sensor import SensorNoise, observe_single_target, times_and_true_states_on_path
from cwcli.tracking.config import IS_UNSCENTED_BY_FILTER, MOTION_MODELS, FilterConfig
from cwcli.tracking.detections import DetectionKind, Detections, SensorModel
from cwcli.tracking.prepare import prepare_detections
from cwcli.tracking.single_target import filter_single_target, log_likelihood_of_rows
from tests.unit.tracking import tracking_oracle as oracle

NOISE = SensorNoise(azimuth_rad=0.03)
N = 80


def rows_with_moving_sensor(use_rate=True):
    scene = observe_single_target(*times_and_true_states_on_path("weave", N), NOISE, np.random.default_rng(7))
    sensors = {
        "lidar": SensorModel(sigma=(0.1, 0.2), yaw_rad=0.4, x_m=1.0),
        "radar": SensorModel(
            sigma=(NOISE.range_m, NOISE.azimuth_rad, NOISE.rate_mps), y_m=-0.5, use_range_rate=use_rate
        ),
    }
    data = [
        Detections("lidar", DetectionKind.POSITION, scene.lidar_stamp_ns, scene.lidar_xy),
        Detections("radar", DetectionKind.RADAR, scene.radar_stamp_ns, scene.radar),
    ]
    rows = prepare_detections(data, sensors).rows
    origin = rows.origin.copy()
    origin[:, 2:] = 0.3, -0.2
    return replace(rows, origin=origin)


@pytest.mark.parametrize("use_rate", [True, False])
@pytest.mark.parametrize("kappa", [0.0, 1.5])
@pytest.mark.parametrize("model", MOTION_MODELS)
@pytest.mark.parametrize("name", IS_UNSCENTED_BY_FILTER)
def test_filter_and_smoother_equal_the_numpy_twin(name, model, kappa, use_rate) -> None:
    rows = rows_with_moving_sensor(use_rate)
    config = FilterConfig(
        filter=name, model=model, noise=0.7, turn_noise=0.3, kappa=kappa, cartesian_below=0.0, gate_probability=1.0
    )
    causal, smoothed = filter_single_target(rows, config, smooth=False), filter_single_target(rows, config, smooth=True)
    x0, p0 = causal.state[0], causal.covariance[0]
    expected = oracle.run(
        name, model, rows.stamp_ns * 1e-9, rows.kind, rows.z, rows.r, rows.origin, x0, p0, 0.7, 0.3, kappa
    )
    np.testing.assert_allclose(causal.state, expected[0], atol=2e-6)
    np.testing.assert_allclose(causal.covariance, expected[1], atol=2e-6)
    np.testing.assert_allclose(smoothed.state, expected[2], atol=5e-6)
    np.testing.assert_allclose(smoothed.covariance, expected[3], atol=5e-6)
    np.testing.assert_allclose(causal.nis[1:], expected[4][1:], rtol=1e-4, atol=1e-6)
    assert causal.log_likelihood == pytest.approx(expected[5], abs=1e-3)
    assert log_likelihood_of_rows(rows, config) == pytest.approx(causal.log_likelihood, abs=1e-9)


def test_start_from_lidar_is_the_point_with_an_open_velocity() -> None:
    rows = rows_with_moving_sensor().select_rows(slice(0, 1))
    out = filter_single_target(rows, FilterConfig(model="cv", start_speed_mps=7.0))
    assert out.status[0] == RowStatus.STARTED
    np.testing.assert_allclose(out.state[0], [*rows.z[0, :2], 0.0, 0.0])
    np.testing.assert_allclose(out.covariance[0, :2, :2], rows.r[0, :2, :2])
    np.testing.assert_allclose(out.covariance[0, 2:, 2:], 49.0 * np.eye(2))


def test_start_from_radar_knows_the_speed_along_the_beam() -> None:
    # 10 m along 30 deg, receding at 4 m/s from a sensor at rest: the beam direction takes the rate, the rest is open
    data = Detections("r", DetectionKind.RADAR, np.array([0]), np.array([[10.0, np.radians(30.0), 4.0]]))
    rows = prepare_detections([data], {"r": SensorModel(sigma=(0.2, 0.001, 0.01))}).rows
    out = filter_single_target(rows, FilterConfig(model="cv", start_speed_mps=10.0))
    along = np.array([np.cos(np.radians(30.0)), 0.5])
    np.testing.assert_allclose(out.state[0, :2], 10.0 * along, atol=1e-12)
    np.testing.assert_allclose(out.state[0, 2:], 4.0 * along, atol=1e-3)
    speed_cov = out.covariance[0, 2:, 2:]
    assert along @ speed_cov @ along < 0.02**2
    across = np.array([-along[1], along[0]])
    assert across @ speed_cov @ across == pytest.approx(100.0)
    position_cov = out.covariance[0, :2, :2]
    assert along @ position_cov @ along == pytest.approx(0.04)
    assert across @ position_cov @ across == pytest.approx((10.0 * 0.001) ** 2)


@pytest.mark.parametrize("name", IS_UNSCENTED_BY_FILTER)
@pytest.mark.parametrize("first", ["lidar", "radar"])
def test_a_target_at_the_origin_starts_and_is_followed(name, first) -> None:
    """Range 0: the bearing does not exist. The target stands on the sensor, then walks away."""
    rng = np.random.default_rng(3)
    t = 0.05 * np.arange(200)
    truth = np.stack([np.maximum(t - 1.0, 0.0), np.zeros(200)], axis=1)
    stamp = np.round(t * 1e9).astype(np.int64)
    lidar, radar = (
        (slice(0, None, 2), slice(1, None, 2)) if first == "lidar" else (slice(1, None, 2), slice(0, None, 2))
    )
    r = np.hypot(*truth[radar].T)
    rate = np.where(t[radar] > 1.0, 1.0, 0.0)
    seen = np.stack([r, np.zeros(100), rate], axis=1)
    seen[r == 0.0, 1] = rng.uniform(-np.pi, np.pi, int((r == 0.0).sum()))
    data = [
        Detections("l", DetectionKind.POSITION, stamp[lidar], truth[lidar] + 0.05 * rng.standard_normal((100, 2))),
        Detections("r", DetectionKind.RADAR, stamp[radar], seen),
    ]
    out = filter_single_target(prepare_detections(data).rows, FilterConfig(filter=name, smooth=False))
    assert np.isfinite(out.state).all()
    assert (np.linalg.eigvalsh(out.covariance) > 0.0).all()
    np.testing.assert_allclose(out.state[-1, :4], [truth[-1, 0], 0.0, 1.0, 0.0], atol=0.25)


def test_a_bearing_across_pi_is_wrapped() -> None:
    """A target that walks behind the sensor, where the azimuth jumps from pi to -pi."""
    t = 0.05 * np.arange(100)
    truth = np.stack([np.full(100, -5.0), 1.0 - 0.4 * t, np.zeros(100), np.full(100, -0.4)], axis=1)
    stamp = np.round(t * 1e9).astype(np.int64)
    azimuth = np.arctan2(truth[:, 1], truth[:, 0])
    assert azimuth.max() > 3.0
    assert azimuth.min() < -3.0
    r = np.hypot(truth[:, 0], truth[:, 1])
    rate = (truth[:, :2] * truth[:, 2:]).sum(axis=1) / r
    rows = prepare_detections([Detections("r", DetectionKind.RADAR, stamp, np.stack([r, azimuth, rate], axis=1))]).rows
    for name in IS_UNSCENTED_BY_FILTER:
        out = filter_single_target(rows, FilterConfig(filter=name, model="cv", smooth=False))
        assert (out.status[1:] == RowStatus.USED).all()
        np.testing.assert_allclose(out.state[-1], truth[-1], atol=0.05)


def test_outliers_are_gated_and_ten_in_a_row_make_a_new_start() -> None:
    n = 100
    stamp = 100_000_000 * np.arange(n)
    xy = np.stack([np.arange(n) * 0.1, np.zeros(n)], axis=1)
    xy[30] += 20.0
    xy[50:] += 40.0  # another target from here on
    rows = prepare_detections([Detections("l", DetectionKind.POSITION, stamp, xy)]).rows
    out = filter_single_target(rows, FilterConfig(model="cv", noise=0.1, smooth=False, gate_probability=0.999))
    gated = np.flatnonzero(out.status == RowStatus.GATED)
    assert gated[0] == 30
    restart = np.flatnonzero(out.status == RowStatus.STARTED)
    assert restart[0] == 0
    assert 55 <= restart[1] <= 60
    np.testing.assert_allclose(out.state[-1, :2], xy[-1], atol=0.2)


def test_a_gap_longer_than_is_bridged_makes_a_new_start() -> None:
    stamp = np.concatenate([np.arange(10), 100 + np.arange(10)]) * 100_000_000
    xy = np.concatenate([np.zeros((10, 2)), np.full((10, 2), 30.0)])
    rows = prepare_detections([Detections("l", DetectionKind.POSITION, stamp, xy)]).rows
    out = filter_single_target(rows, FilterConfig(max_gap_s=2.0))
    assert np.flatnonzero(out.status == RowStatus.STARTED).tolist() == [0, 10]
    np.testing.assert_allclose(out.state[:10, :2], 0.0, atol=1e-9)  # nothing is smoothed across the gap
    np.testing.assert_allclose(out.state[10:, :2], 30.0, atol=1e-9)


def test_no_rows_give_no_states() -> None:
    rows = prepare_detections([]).rows
    out = filter_single_target(rows, FilterConfig())
    assert out.state.shape == (0, 5)
    assert out.log_likelihood == 0.0
