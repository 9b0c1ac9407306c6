"""The single-track car against the paper's numbers, a fine integration, scipy and its own limits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from cwcli.dynamics.matrix_exponential import (
    discretise_noise_covariance,
    matrix_exponential,
    transition_and_input_matrices,
)
from cwcli.dynamics.riccati import steady_kalman_gain, steady_predicted_covariance
from cwcli.dynamics.single_track import (
    critical_speed_mps,
    lateral_state_matrices,
    preview_state_matrices,
    steady_lateral_speed_and_yaw_rate,
    steady_lateral_speed_per_yaw_rate_m,
    steady_yaw_rate_per_steering_angle_1ps,
    understeer_gradient_rad_per_mps2,
)
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.signals.units import MPS_PER_KMH

CAR = load_vehicle()
H = np.eye(4)[2:]


@pytest.mark.parametrize(
    ("speed_kmh", "lateral_mps", "yaw_rate_radps"),
    [
        pytest.param(80, -1.413, 0.400, id="80 km/h, labels exchanged"),
        pytest.param(88, -1.865, 0.415, id="88 km/h, the paper's actual state"),
        pytest.param(90, -1.985, 0.418, id="90 km/h, labels exchanged"),
    ],
)
def test_steady_states_of_the_worked_example(speed_kmh: float, lateral_mps: float, yaw_rate_radps: float) -> None:
    assert steady_lateral_speed_and_yaw_rate(CAR, speed_kmh * MPS_PER_KMH, 0.05) == pytest.approx(
        (lateral_mps, yaw_rate_radps), abs=1e-3
    )


def test_steady_state_is_where_equation_11_rests() -> None:
    for speed in (3.0, 15.0, 40.0):
        a, b = lateral_state_matrices(CAR, speed)
        rest = np.linalg.solve(a, -b[:, 0] * 0.02)
        assert steady_lateral_speed_and_yaw_rate(CAR, speed, 0.02) == pytest.approx(tuple(rest), rel=1e-12)


def test_understeer_gradient_by_hand() -> None:
    # K_mu = 1215 (1.06 - 0.90) 60000 / (1.96 * 60000^2) = 1.65306e-3; f(v) = 1 + 1.65306e-3 / 1.96 v^2.
    assert understeer_gradient_rad_per_mps2(CAR) == pytest.approx(1.65306e-3, abs=1e-8)
    assert understeer_gradient_rad_per_mps2(CAR) / CAR.wheelbase_m == pytest.approx(0.000843, abs=5e-7)


def test_equation_12_gives_the_same_radius_with_and_without_slip() -> None:
    # delta_D = f delta_K turns the real car on the radius L / delta_K of the car without slip.
    speed, kinematic = 25.0, 0.01
    factor = 1.0 + understeer_gradient_rad_per_mps2(CAR) / CAR.wheelbase_m * speed**2
    yaw_rate = float(steady_yaw_rate_per_steering_angle_1ps(CAR, speed)) * factor * kinematic
    assert speed / yaw_rate == pytest.approx(CAR.wheelbase_m / kinematic, rel=1e-12)


@pytest.mark.parametrize("speed_kmh", [10, 60, 88, 160])
def test_discretisation_equals_a_fine_integration(speed_kmh: float) -> None:
    a, b = preview_state_matrices(CAR, speed_kmh * MPS_PER_KMH, 33.5)
    phi, gamma = transition_and_input_matrices(a, b, 0.1)
    x, u = np.array([0.3, -0.1, 0.5, 0.02]), np.array([0.03, 0.001])
    fine, n = x.copy(), 4000
    for _ in range(n):
        h = 0.1 / n
        k1 = a @ fine + b @ u
        k2 = a @ (fine + h / 2 * k1) + b @ u
        k3 = a @ (fine + h / 2 * k2) + b @ u
        k4 = a @ (fine + h * k3) + b @ u
        fine = fine + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    np.testing.assert_allclose(phi @ x + gamma @ u, fine, rtol=0, atol=1e-9)


def test_matrix_exponential_equals_scipys() -> None:
    random = np.random.default_rng(1)
    for scale in (0.0, 1e-6, 0.3, 5.0):
        matrix = random.normal(size=(6, 6)) * scale
        expected = expm(matrix)
        np.testing.assert_allclose(matrix_exponential(matrix), expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_noise_of_a_step_equals_its_integral() -> None:
    a, _ = preview_state_matrices(CAR, 20.0, 33.5)
    times = np.linspace(0.0, 0.1, 501)
    parts = np.array([expm(a * t) @ expm(a * t).T for t in times]) * 0.01
    integral = np.trapezoid(parts, times, axis=0)
    np.testing.assert_allclose(discretise_noise_covariance(a, 0.01 * np.eye(4), 0.1), integral, rtol=1e-4, atol=1e-12)


def test_signs_agree_with_the_papers() -> None:
    # With v_y, gamma and delta to the right, eq. 20 reads dy_L = v e_L - v_y - gamma D_L, de_L = v K_L - gamma.
    a, b = preview_state_matrices(CAR, 20.0, 33.5)
    turn, turn_input = np.diag([-1.0, -1.0, 1.0, 1.0]), np.diag([-1.0, 1.0])
    paper_a, paper_b = turn @ a @ turn, turn @ b @ turn_input
    np.testing.assert_array_equal(paper_a[2:], [[-1.0, -33.5, 0.0, 20.0], [0.0, -1.0, 0.0, 0.0]])
    np.testing.assert_array_equal(paper_b[2:], [[0.0, 0.0], [0.0, 20.0]])
    np.testing.assert_allclose(paper_a[:2, :2], a[:2, :2])
    np.testing.assert_allclose(paper_b[:2, 0], b[:2, 0])


def test_slow_and_standing_cars() -> None:
    for speed in (0.0, 0.5, 1.9, -1.0):
        a, b = lateral_state_matrices(CAR, speed)
        yaw_rate = np.linalg.solve(a, -b[:, 0] * 0.1)[1]
        assert np.all(np.linalg.eigvals(a).real < 0.0)
        assert yaw_rate == pytest.approx(speed * 0.1 / CAR.wheelbase_m, rel=0.01, abs=1e-15)


def test_a_car_that_oversteers_has_a_critical_speed() -> None:
    loose = replace(CAR, front_axle_m=CAR.rear_axle_m, rear_axle_m=CAR.front_axle_m)
    critical = critical_speed_mps(loose)
    assert critical_speed_mps(CAR) == np.inf
    assert np.linalg.eigvals(lateral_state_matrices(loose, critical * 0.99)[0]).real.max() < 0.0
    assert np.linalg.eigvals(lateral_state_matrices(loose, critical * 1.01)[0]).real.max() > 0.0


def test_lateral_speed_changes_sign_where_the_rear_axle_slips_as_much_as_it_leads() -> None:
    # l_r = m l_f v^2 / (k_r L): v = sqrt(1.06 * 60000 * 1.96 / (1215 * 0.9)) = 10.677 m/s.
    assert float(steady_lateral_speed_per_yaw_rate_m(CAR, 10.677)) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("speed_kmh", range(10, 161, 10))
def test_gains_equal_scipys_riccati_solution(speed_kmh: int) -> None:
    a, b = preview_state_matrices(CAR, speed_kmh * MPS_PER_KMH, 33.5)
    phi, _ = transition_and_input_matrices(a, b, 0.1)
    noise, r = discretise_noise_covariance(a, 0.01 * np.eye(4), 0.1), 0.01 * np.eye(2)
    expected = solve_discrete_are(phi.T, H.T, noise, r)
    np.testing.assert_allclose(steady_predicted_covariance(phi, H, noise, r), expected, rtol=1e-9)
    gain = expected @ H.T @ np.linalg.inv(H @ expected @ H.T + r)
    np.testing.assert_allclose(steady_kalman_gain(phi, H, noise, r), gain, rtol=1e-9, atol=1e-12)
    assert np.abs(np.linalg.eigvals(phi - gain @ H @ phi)).max() < 1.0


def test_a_filter_that_can_not_settle_is_refused() -> None:
    with pytest.raises(ValueError, match="does not converge"):
        steady_predicted_covariance(np.diag([1.1, 0.5]), np.array([[0.0, 1.0]]), np.eye(2), np.eye(1))
