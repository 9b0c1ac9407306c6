"""Laws that the filter and the smoother obey on any input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation import EstimatorConfig, estimate_track
from cwcli.estimation.consistency import nees
from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.passes import FilterStart, SensorSeries, run_filter_pass
from cwcli.metrics.chi_square import chi_square_mean_bounds
from tests.studies.city_drive import EPOCH_NS, city_drive, measure
from tests.unit.estimation import naive_ekf

SYMMETRY_ATOL = 1e-12
EIGENVALUE_PART = -1e-9  # of the trace
DURATION_S = 60.0


@pytest.mark.parametrize("causal", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_covariance_is_symmetric_and_positive(seed: int, causal: bool) -> None:
    measurements = measure(city_drive(seed, DURATION_S), seed, {})
    if seed == 2:  # a hostile one: noise that is stated far too small
        measurements = [
            replace(m, covariance=np.full(m.values.shape, 1e-10)) if m.kind is Kind.SPEED else m for m in measurements
        ]
    track = estimate_track(measurements, EstimatorConfig(latency="none", causal=causal))
    p = track.covariance
    np.testing.assert_allclose(p, np.swapaxes(p, 1, 2), atol=SYMMETRY_ATOL)
    assert (np.linalg.eigvalsh(p)[:, 0] >= EIGENVALUE_PART * np.trace(p, axis1=1, axis2=2)).all()
    assert np.isfinite(track.state).all()


def test_smoother_is_never_less_sure_than_the_filter() -> None:
    measurements = measure(city_drive(0, DURATION_S), 0, {})
    output = EPOCH_NS + (np.arange(15.0, 59.0, 0.5) * 1e9).astype(np.int64)
    config = EstimatorConfig(latency="none")
    smoothed = estimate_track(measurements, config, output)
    filtered = estimate_track(measurements, replace(config, causal=True), output)
    for i in range(4):
        assert (smoothed.covariance[:, i, i] <= filtered.covariance[:, i, i] * 1.05).all()


def test_filter_and_smoother_agree_after_the_last_measurement() -> None:
    measurements = measure(city_drive(1, DURATION_S), 1, {})
    output = EPOCH_NS + np.array([int(61e9), int(63e9)])
    series_end = EstimatorConfig(latency="none")
    smoothed = estimate_track(measurements, series_end, output)
    again = estimate_track(measurements, replace(series_end, causal=True), output)
    np.testing.assert_allclose(smoothed.state[:, 2:6], again.state[:, 2:6], atol=1e-3)
    assert smoothed.covariance[1, 0, 0] > smoothed.covariance[0, 0, 0]


def test_nees_of_data_drawn_from_the_model_is_inside_its_bounds() -> None:
    """Truth drawn from the filter's own process; 30 runs; mean NEES of 8 states within the 95 % bounds, widened
    by the share that linearisation takes."""
    parameters = MotionParameters(jerk_sigma_mps3=0.5, yaw_accel_sigma_radps2=0.03, standstill_speed_mps=0.1)
    sigma0 = np.array([0.5, 0.5, 0.5, 0.05, 0.3, 0.02, 0.3, 0.02])
    end = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        mean0 = np.array([0, 0, 12.0, 0.4, 0, 0, 0, 0])
        x = mean0 + sigma0 * rng.standard_normal(8)
        time, xy, yaw = [], [], []
        for k in range(1, 61):
            q = naive_ekf.process_noise(x, np.zeros((8, 8)), 0.05, 0.0, parameters, np.zeros(8))
            noise = np.linalg.cholesky(q + 1e-15 * np.eye(8)) @ rng.standard_normal(8)
            x = naive_ekf.transition(x, 0.05, parameters, x[2] ** 2) + noise
            time.append(0.05 * k)
            xy.append(x[:2] + 0.3 * rng.standard_normal(2))
            yaw.append([x[5] + 0.005 * rng.standard_normal(), 0.0])
        t = np.array(time)
        r_xy, r_yaw = np.tile([0.09, 0.0, 0.09], (60, 1)), np.tile([2.5e-5, 0.0, 0.0], (60, 1))
        series = [
            SensorSeries("p", Kind.POSITION, t, np.array(xy), r_xy),
            SensorSeries("w", Kind.YAW_RATE, t, np.array(yaw), r_yaw),
        ]
        start = FilterStart(0.0, mean0, np.diag(sigma0**2))
        result = run_filter_pass(
            series, start, parameters.to_process_model(np.zeros(8)), t[-1:], smooth=True, reset_after=5
        )
        end.append(nees((result.state - x)[:, :8], result.covariance)[0])
    low, high = chi_square_mean_bounds(8, 30)
    assert 0.97 * low < np.mean(end) < 1.03 * high


def test_nis_of_a_simulated_drive_is_near_its_expectation() -> None:
    track = estimate_track(measure(city_drive(2, 200.0), 2, {}), EstimatorConfig())
    for report in track.sources:
        if report.kind is Kind.ACCEL:  # its noise takes in the rows that the gate rejects: the simulator's sharp ramps
            assert report.nis_mean == pytest.approx(1.0, rel=0.15)
        elif report.kind is not Kind.YAW_RATE:  # its noise model is strained by the simulator's sharp turns
            assert report.nis_mean == pytest.approx(report.nis_dof, rel=0.1)
