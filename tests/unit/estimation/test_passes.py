"""The compiled filter and smoother against the NumPy twin, filterpy, and the closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter, rts_smoother

from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.parameter import Parameter
from cwcli.estimation.passes import FilterStart, PitchRateSeries, SensorSeries, run_filter_pass
from cwcli.estimation.song2016 import filtered_states_and_covariances_of_matrix, process_noise_covariance
from tests.unit.estimation import naive_ekf

ATOL = 2e-6  # finite-difference Jacobians of the twin limit the comparison
SIGMA = (0.6, 0.6, 0.5, 0.0175, 0.049, 0.00175)


def series_of(
    kind: Kind, time: np.ndarray, values: np.ndarray, noise: tuple[float, float, float], **more
) -> SensorSeries:
    padded = np.zeros((len(time), 2))
    padded[:, : values.shape[1]] = values
    return SensorSeries(kind.name, kind, time, padded, np.tile(np.array(noise), (len(time), 1)), **more)


def mixed_series(seed: int) -> tuple[list[SensorSeries], FilterStart, np.ndarray]:
    """A bend with every kind of measurement, parameters of every kind, sensors apart and a gap; 21 states."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0.0, 4.0, 25))
    t = t[(t < 2.0) | (t > 2.7)]
    n = len(t)
    speed, heading = 8.0 + t, 0.3 + 0.2 * t
    xy = np.stack([8 * t, 3 * t], axis=1) + rng.normal(0, 0.5, (n, 2))
    uv = np.stack([speed * np.cos(heading), speed * np.sin(heading)], axis=1) + rng.normal(0, 0.2, (n, 2))
    series = [
        series_of(
            Kind.POSITION,
            t,
            xy,
            (0.3, 0.1, 0.4),
            latency_s=0.05,
            latency_state=10,
            slow_state=12,
            place_m=(0.7, -0.4),
            ahead_state=18,
            stamp_error=Parameter(0.06),
        ),
        series_of(Kind.VELOCITY, t + 0.013, uv, (0.05, -0.01, 0.04), latency_state=11, ahead_state=19),
        series_of(
            Kind.SPEED,
            t + 0.02,
            (speed + rng.normal(0, 0.3, n))[:, None],
            (0.09, 0, 0),
            latency_s=0.01,
            latency_state=17,
            scale_state=15,
            lever_state=16,
            place_m=(1.0, 0.6),
            pitch_rate=PitchRateSeries(np.linspace(-0.1, 5, 100), rng.normal(0, 0.5, 100)),
        ),
        series_of(Kind.HEADING, t, (heading + 2 * np.pi)[:, None], (0.001, 0, 0)),
        series_of(
            Kind.ACCEL,
            t + 0.031,
            (1.2 + rng.normal(0, 0.1, n))[:, None],
            (0.01, 0, 0),
            bias_state=8,
            slow_state=14,
            place_m=(-0.5, 0.8),
            ahead_state=20,
        ),
        series_of(Kind.YAW_RATE, t + 0.031, (0.21 + rng.normal(0, 0.01, n))[:, None], (1e-4, 0, 0), bias_state=9),
    ]
    state = np.zeros(21)
    state[2:4] = 7.5, 0.35
    state[12:] = 0.1, -0.2, 0.1, 0.02, 0.5, 0.03, 1.1, 0.4, 1.5
    sigma = np.array([1, 1, 1, 0.2, 1, 0.1, 1, 0.1, 0.5, 0.01, 0.1, 0.1, 1, 1, 0.3, 0.05, 1, 0.1, 1, 1, 2])
    walk = np.zeros(21)
    walk[8:10] = 1e-4, 1e-8
    walk[12:15] = 0.5, 0.5, 0.1
    return series, FilterStart(0.0, state, np.diag(sigma**2)), walk


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_pass_equals_twin_on_mixed_sensors(seed: int) -> None:
    series, start, walk = mixed_series(seed)
    output = np.linspace(0.0, 4.2, 23)
    parameters = MotionParameters(time_constant_s={12: 2.0, 13: 2.0, 14: 0.7}, turn_noise={14: 0.3})
    naive = naive_ekf.run(series, start, parameters, walk, output)
    filtered = run_filter_pass(series, start, parameters.to_process_model(walk), output, smooth=False, reset_after=10)
    smoothed = run_filter_pass(series, start, parameters.to_process_model(walk), output, smooth=True, reset_after=10)
    np.testing.assert_allclose(filtered.state, naive.filtered, atol=ATOL)
    np.testing.assert_allclose(filtered.covariance, naive.filtered_p, atol=ATOL)
    np.testing.assert_allclose(smoothed.state, naive.smoothed, atol=ATOL)
    np.testing.assert_allclose(smoothed.covariance, naive.smoothed_p, atol=ATOL)
    assert filtered.log_likelihood == pytest.approx(naive.log_likelihood, abs=1e-4)
    nis = np.concatenate([n[:, 0] for n in filtered.nis])
    assert sorted(nis[np.isfinite(nis)]) == pytest.approx(sorted(naive.nis), abs=1e-4)


def test_song2016_equals_filterpy_ekf_over_the_matrix_update() -> None:
    """Eq. 8 in filterpy, with the Jacobian of eq. 6, on a curve."""
    rng = np.random.default_rng(3)
    n, dt = 120, 0.05
    t = dt * np.arange(n)
    truth = np.stack([10 * t, 0 * t, 10 + 0 * t, 0.2 * t, 0 * t, 0.2 + 0 * t], axis=1)
    z = truth + np.array(SIGMA) * rng.standard_normal((n, 6))
    q = process_noise_covariance(dt)
    ekf = ExtendedKalmanFilter(dim_x=6, dim_z=6)
    ekf.x, ekf.P, ekf.R, ekf.Q = z[0].copy(), np.diag(np.square(SIGMA)), np.diag(np.square(SIGMA)), q
    expected = [ekf.x.copy()]
    for row in z[1:]:
        x, y, v, phi, a, w = ekf.x
        s = v * dt + a * dt**2 / 2
        c, sn = np.cos(phi), np.sin(phi)
        ekf.F = np.array(
            [[1, 0, dt * c, -s * sn, dt**2 * c / 2, 0], [0, 1, dt * sn, s * c, dt**2 * sn / 2, 0],
             [0, 0, 1, 0, dt, 0], [0, 0, 0, 1, 0, dt], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]]
        )  # fmt: skip
        ekf.P = ekf.F @ ekf.P @ ekf.F.T + q
        ekf.x = np.array([x + s * c, y + s * sn, v + a * dt, phi + w * dt, a, w])
        ekf.update(row, lambda _: np.eye(6), lambda state: state)
        expected.append(ekf.x.copy())
    state, covariance = filtered_states_and_covariances_of_matrix(z, SIGMA)
    np.testing.assert_allclose(state, expected, atol=1e-9)
    np.testing.assert_allclose(covariance[-1], ekf.P, atol=1e-9)


def test_song2016_on_a_straight_line_equals_filterpy_kalman_and_rts() -> None:
    """With heading and yaw rate known to be zero the model is linear in x, v, a; filterpy's smoother is the oracle."""
    rng = np.random.default_rng(4)
    n, dt = 80, 0.05
    z = np.zeros((n, 6))
    z[:, 0] = 5 * dt * np.arange(n) + 0.6 * rng.standard_normal(n)
    z[:, 2] = 5 + 0.5 * rng.standard_normal(n)
    z[:, 4] = 0.05 * rng.standard_normal(n)
    sigma = (0.6, 0.6, 0.5, 1e-9, 0.05, 1e-9)
    q = process_noise_covariance(dt, jerk=1.0, yaw_accel=1e-12)
    state, covariance = filtered_states_and_covariances_of_matrix(z, sigma, process_noise=q, smooth=True)
    use = [0, 2, 4]
    kf = KalmanFilter(dim_x=3, dim_z=3)
    kf.F = np.array([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]])
    kf.H, kf.Q, kf.R = np.eye(3), q[np.ix_(use, use)], np.diag(np.square(np.array(sigma)[use]))
    kf.x, kf.P = z[0, use].copy(), kf.R.copy()
    xs, ps = [kf.x.copy()], [kf.P.copy()]
    for row in z[1:, use]:
        kf.predict()
        kf.update(row)
        xs.append(kf.x.copy())
        ps.append(kf.P.copy())
    smooth_x, smooth_p, _, _ = rts_smoother(np.array(xs), np.array(ps), [kf.F] * n, [kf.Q] * n)
    np.testing.assert_allclose(state[:, use], smooth_x, atol=1e-7)
    np.testing.assert_allclose(covariance[:, use][:, :, use], smooth_p, atol=1e-7)


def test_gate_rejects_a_jump_and_counts_it() -> None:
    time = 0.1 * np.arange(100.0)
    xy = np.stack([10.0 * time, np.zeros(100)], axis=1)
    xy[50] += 30.0
    s = replace(series_of(Kind.POSITION, time, xy, (0.01, 0.0, 0.01)), gate_nis=13.8)
    state = np.zeros(8)
    state[2] = 10.0
    start = FilterStart(0.0, state, np.diag([1, 1, 1, 0.1, 1, 0.1, 1, 0.1]))
    result = run_filter_pass(
        [s], start, MotionParameters().to_process_model(np.zeros(8)), time, smooth=True, reset_after=20
    )
    assert np.flatnonzero(result.status[0] == 0).tolist() == [50]
    np.testing.assert_allclose(result.state[:, 0], 10.0 * time, atol=0.2)


def test_gate_gives_in_when_the_measurements_stay_elsewhere() -> None:
    """A map jump of 200 m: after the documented patience the filter follows, and the reset is counted."""
    time = 0.1 * np.arange(200.0)
    xy = np.stack([10.0 * time, np.zeros(200)], axis=1)
    xy[100:, 1] += 200.0
    s = replace(series_of(Kind.POSITION, time, xy, (0.01, 0.0, 0.01)), gate_nis=13.8)
    state = np.zeros(8)
    state[2] = 10.0
    start = FilterStart(0.0, state, np.diag([1, 1, 1, 0.1, 1, 0.1, 1, 0.1]))
    result = run_filter_pass(
        [s], start, MotionParameters().to_process_model(np.zeros(8)), time, smooth=False, reset_after=10
    )
    assert (result.status[0] == 0).sum() == 19  # two seconds from the last believed row
    assert (result.status[0] == 2).sum() == 1
    np.testing.assert_allclose(result.state[-1, :2], xy[-1], atol=0.5)


def test_update_and_output_at_the_same_stamp_give_the_updated_state() -> None:
    s = series_of(Kind.POSITION, np.array([0.0]), np.array([[4.0, 2.0]]), (1e-6, 0.0, 1e-6))
    start = FilterStart(0.0, np.zeros(8), np.eye(8))
    result = run_filter_pass(
        [s], start, MotionParameters().to_process_model(np.zeros(8)), np.array([0.0]), smooth=False, reset_after=3
    )
    np.testing.assert_allclose(result.state[0, :2], [4.0, 2.0], atol=1e-4)


def test_start_of_another_length_than_the_model_is_refused() -> None:
    start = FilterStart(0.0, np.zeros(6), np.eye(6))
    with pytest.raises(ValueError, match="a start of 6 states for a motion model of 8"):
        run_filter_pass(
            [], start, MotionParameters().to_process_model(np.zeros(8)), np.zeros(1), smooth=False, reset_after=3
        )
