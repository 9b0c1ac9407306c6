"""Laws that every registered motion model obeys."""

import numpy as np
import numpy.typing as npt
import pytest

from cwcli.prediction.driver import DriverPrior
from cwcli.prediction.integrate import integrate_paths
from cwcli.prediction.models import MODELS
from cwcli.prediction.rollout import (
    Discretisation,
    RolloutSettings,
    _require_model,
    _scale_derivatives_by_trust,
    roll_out_paths,
)
from cwcli.signals.columns import StateRows
from cwcli.signals.vehicle_state import STATE_COLUMNS_OF_MOTION_MODEL_RESPONSES

FloatArray = npt.NDArray[np.float64]
ATOL_M = 1e-9
PAPER_MODELS = [name for name, model in MODELS.items() if model.in_paper]
FORMS = [(name, "exact") for name in MODELS] + [(name, "paper") for name in PAPER_MODELS]


def moving_starts(n: int, seed: int) -> FloatArray:
    """Cars in traffic that don't stop within 2.5 s: (n, 8)."""
    rng = np.random.default_rng(seed)
    state = rng.normal(size=(n, 8)) * [50.0, 50.0, 2.0, 2.0, 1.0, 0.2, 0.5, 0.1]
    state[:, 2] += 20.0
    return state


def any_starts(n: int, seed: int) -> FloatArray:
    """Cars that stop, stand, start, reverse, turn: (n, 8)."""
    rng = np.random.default_rng(seed)
    state = rng.normal(size=(n, 8)) * [50.0, 50.0, 6.0, 2.0, 3.0, 0.3, 2.0, 0.2]
    state[: n // 5, 2] = 0.0
    return state


def covariances(n: int, seed: int) -> FloatArray:
    """Full covariances of a filter, (n, 8, 8)."""
    root = np.random.default_rng(seed).normal(size=(n, 8, 8)) * np.array(
        [0.5, 0.5, 0.3, 0.02, 0.2, 0.02, 0.3, 0.02]
    ).reshape(8, 1)
    return root @ root.transpose(0, 2, 1) / 8.0


@pytest.mark.parametrize("name", MODELS)
def test_path_starts_at_the_state(name: str) -> None:
    state, covariance = any_starts(200, 0), covariances(200, 1)
    paths = roll_out_paths(name, state, covariance)
    start = np.column_stack([paths.x_m[:, 0], paths.y_m[:, 0], paths.speed_mps[:, 0], paths.heading_rad[:, 0]])
    np.testing.assert_array_equal(start, state[:, :4])
    at_start = np.column_stack([covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]])
    np.testing.assert_allclose(paths.position_covariance_m2[:, 0], at_start, rtol=0, atol=1e-15)


def jacobian_of_path_xy_to_start_state(model: str, state: StateRows, settings: RolloutSettings) -> FloatArray:
    """Derivative of every predicted (x, y) with respect to the start state, shape (n, k, 2, 8)."""
    chosen, prior = _require_model(model, settings.discretisation), settings.driver_prior_of_settings
    trust = chosen.trust(state, None, prior) * np.array(chosen.uses)
    start = _scale_derivatives_by_trust(state, trust)
    jacobian = integrate_paths(chosen, start, settings.time_s, prior, settings.discretisation).jacobian
    jacobian = np.moveaxis(jacobian, 0, 2)
    jacobian[..., STATE_COLUMNS_OF_MOTION_MODEL_RESPONSES] *= trust[:, None, None, :]
    return jacobian


@pytest.mark.parametrize(("name", "discretisation"), FORMS)
def test_jacobian_equals_finite_differences(name: str, discretisation: Discretisation) -> None:
    state = np.concatenate([moving_starts(20, 2), any_starts(40, 3)])
    state = state[np.abs(state[:, 2]) > 0.5]  # at v = 0 the clamp has a corner
    step = 1e-6
    jacobian = jacobian_of_path_xy_to_start_state(name, state, settings=RolloutSettings(discretisation=discretisation))
    for column in range(8):
        ahead, behind = state.copy(), state.copy()
        ahead[:, column] += step
        behind[:, column] -= step
        later, earlier = (
            roll_out_paths(name, start, None, settings=RolloutSettings(discretisation=discretisation))
            for start in (ahead, behind)
        )
        slope = np.stack([later.x_m - earlier.x_m, later.y_m - earlier.y_m], axis=-1) / (2.0 * step)
        np.testing.assert_allclose(jacobian[..., column], slope, rtol=0, atol=2e-5)


@pytest.mark.parametrize("name", MODELS)
def test_covariance_is_symmetric_positive_and_grows(name: str) -> None:
    state, covariance = any_starts(300, 4), covariances(300, 5)
    xx, xy, yy = np.moveaxis(roll_out_paths(name, state, covariance).position_covariance_m2, -1, 0)
    assert (xx > 0.0).all()
    assert (yy > 0.0).all()
    assert (xx * yy - xy**2 > -1e-12 * xx * yy).all()
    driver = roll_out_paths(name, state, None).position_covariance_m2
    assert (np.diff(driver[..., 0] + driver[..., 2], axis=1) > -1e-12).all()


@pytest.mark.parametrize("name", MODELS)
def test_covariance_matches_samples(name: str) -> None:
    # small spread, so that the model is linear over it
    start = np.array([[10.0, -5.0, 15.0, 0.7, -1.0, 0.2, 0.4, -0.1]])
    covariance = covariances(1, 6) * 1e-4
    ignored = [
        column
        for column, used in zip(STATE_COLUMNS_OF_MOTION_MODEL_RESPONSES, MODELS[name].uses, strict=True)
        if not used
    ]
    start[:, ignored] = covariance[:, ignored] = covariance[:, :, ignored] = 0.0
    # a driver who adds nothing, whose derivatives last, and of whom everything is believed
    steady = DriverPrior(
        accel_sigma_mps2=1e4,
        accel_time_s=1e3,
        jerk_sigma_mps3=1e4,
        yaw_rate_sigma_radps=1e4,
        yaw_time_s=1e3,
        yaw_accel_sigma_radps2=1e4,
        curvature_sigma_1pm=1e4,
        along_floor_mps2=0.0,
        along_share=0.0,
        cross_floor_mps2=0.0,
        cross_share=0.0,
    )
    samples = np.random.default_rng(7).multivariate_normal(start[0], covariance[0], size=40_000)
    paths = roll_out_paths(name, samples, None, settings=RolloutSettings(prior=steady))
    found = np.cov(paths.x_m[:, -1], paths.y_m[:, -1])
    both = roll_out_paths(name, start, covariance, settings=RolloutSettings(prior=steady)).position_covariance_m2[0, -1]
    driver = roll_out_paths(name, start, None, settings=RolloutSettings(prior=steady)).position_covariance_m2[0, -1]
    scale = np.sqrt(found[0, 0] * found[1, 1])
    np.testing.assert_allclose(both - driver, [found[0, 0], found[0, 1], found[1, 1]], atol=0.03 * scale)


@pytest.mark.parametrize("name", MODELS)
def test_stopped_car_stays_stopped(name: str) -> None:
    state = np.zeros((3, 8))
    state[:, 5], state[:, 7] = 0.3, 0.1  # a gyroscope that drifts
    state[1, 4] = -2.0  # the brake is held
    state[2, 3] = 1.0
    paths = roll_out_paths(name, state, None)
    assert (paths.x_m == 0.0).all()
    assert (paths.y_m == 0.0).all()
    assert (paths.speed_mps == 0.0).all()
    np.testing.assert_array_equal(paths.heading_rad, np.repeat(state[:, 3:4], 51, axis=1))
    assert (paths.position_covariance_m2 == 0.0).all()


@pytest.mark.parametrize(("name", "discretisation"), FORMS)
def test_no_car_changes_direction(name: str, discretisation: Discretisation) -> None:
    state = any_starts(500, 8)
    paths = roll_out_paths(name, state, None, settings=RolloutSettings(horizon_s=5.0, discretisation=discretisation))
    assert (paths.speed_mps[state[:, 2] >= 0.0] >= 0.0).all()
    assert (paths.speed_mps[state[:, 2] < 0.0] <= 0.0).all()
    stopped = paths.speed_mps[:, 1:-1] == 0.0  # a car at rest may drive off at the start, and only there
    assert stopped.any() or name in ("cv", "ctrv")
    for values in (paths.x_m, paths.y_m, paths.heading_rad, paths.speed_mps):
        np.testing.assert_allclose(np.where(stopped, np.diff(values[:, 1:], axis=1), 0.0), 0.0, atol=ATOL_M)


@pytest.mark.parametrize("name", MODELS)
def test_path_turns_and_moves_with_its_start(name: str) -> None:
    state, covariance = any_starts(50, 9), covariances(50, 10)
    turn, shift = 0.83, np.array([100.0, -40.0])
    cosine, sine = np.cos(turn), np.sin(turn)
    rotation = np.array([[cosine, -sine], [sine, cosine]])
    moved, full = state.copy(), np.eye(8)
    moved[:, :2] = state[:, :2] @ rotation.T + shift
    moved[:, 3] += turn
    full[:2, :2] = rotation
    one, other = roll_out_paths(name, state, covariance), roll_out_paths(name, moved, full @ covariance @ full.T)
    expected = np.stack([one.x_m, one.y_m], axis=-1) @ rotation.T + shift
    np.testing.assert_allclose(np.stack([other.x_m, other.y_m], axis=-1), expected, atol=1e-9)
    sizes = [path.position_covariance_m2[..., 0] + path.position_covariance_m2[..., 2] for path in (one, other)]
    np.testing.assert_allclose(sizes[1], sizes[0], rtol=1e-9)


@pytest.mark.parametrize("name", MODELS)
def test_path_does_not_depend_on_the_step(name: str) -> None:
    state, covariance = any_starts(100, 11), covariances(100, 12)
    fine, coarse = (
        roll_out_paths(name, state, covariance, settings=RolloutSettings(step_s=step)) for step in (0.05, 0.25)
    )
    np.testing.assert_allclose(coarse.x_m, fine.x_m[:, ::5], atol=1e-6)
    np.testing.assert_allclose(coarse.y_m, fine.y_m[:, ::5], atol=1e-6)
    np.testing.assert_allclose(coarse.position_covariance_m2, fine.position_covariance_m2[:, ::5], rtol=0.01, atol=1e-3)


@pytest.mark.parametrize("name", ["cv", "ca", "ctrv", "ctra"])
def test_two_legs_make_one_path(name: str) -> None:
    state = any_starts(100, 13)
    whole = roll_out_paths(name, state, None, settings=RolloutSettings(horizon_s=2.5))
    middle = state.copy()
    middle[:, 0], middle[:, 1] = whole.x_m[:, 20], whole.y_m[:, 20]
    middle[:, 2], middle[:, 3] = whole.speed_mps[:, 20], whole.heading_rad[:, 20]
    stopped = middle[:, 2] == 0.0
    middle[np.ix_(stopped, [4, 5, 6, 7])] = 0.0
    second = roll_out_paths(name, middle, None, settings=RolloutSettings(horizon_s=1.5))
    np.testing.assert_allclose(second.x_m, whole.x_m[:, 20:], atol=ATOL_M)
    np.testing.assert_allclose(second.y_m, whole.y_m[:, 20:], atol=ATOL_M)


@pytest.mark.parametrize("name", PAPER_MODELS)
def test_paper_recursion_tends_to_the_exact_integral(name: str) -> None:
    state = any_starts(100, 14)
    exact = roll_out_paths(name, state, None, settings=RolloutSettings(step_s=0.5))
    errors = []
    for step in (0.05, 0.025, 0.0125):
        paper = roll_out_paths(name, state, None, settings=RolloutSettings(step_s=step, discretisation="paper"))
        stride = round(0.5 / step)
        errors.append(np.hypot(paper.x_m[:, ::stride] - exact.x_m, paper.y_m[:, ::stride] - exact.y_m).max())
    if name in ("cv", "ca"):
        assert max(errors) < 1e-5  # exact for straight paths with constant acceleration
    else:
        assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)
        assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("name", MODELS)
def test_a_row_that_is_not_finite_spoils_no_other(name: str) -> None:
    state, covariance = moving_starts(5, 15), covariances(5, 16)
    expected = roll_out_paths(name, state[[0, 1, 3, 4]], covariance[[0, 1, 3, 4]])
    state[2] = np.nan
    found = roll_out_paths(name, state, covariance)
    assert np.isnan(found.x_m[2]).all()
    np.testing.assert_array_equal(found.x_m[[0, 1, 3, 4]], expected.x_m)
