"""Paths against closed forms, an independent integrator, and the paper's recursion written out."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

from cwcli.errors import UsageError
from cwcli.prediction.driver import DriverPrior, displacement_variance_s4, fading_accel_displacement_s2
from cwcli.prediction.fleet import HORIZON_KNOTS_S
from cwcli.prediction.models import MODELS
from cwcli.prediction.paths import Paths
from cwcli.prediction.rollout import RolloutSettings, path_time_grid_s, roll_out_paths

FloatArray = npt.NDArray[np.float64]
ATOL_M = 1e-9


def one(**values: float) -> FloatArray:
    """One state, (1, 8), by short names."""
    names = ("x", "y", "v", "heading", "a", "w", "j", "dw")
    return np.array([[values.get(name, 0.0) for name in names]])


def end(paths: Paths) -> tuple[float, float]:
    return float(paths.x_m[0, -1]), float(paths.y_m[0, -1])


def test_constant_velocity_by_hand() -> None:
    # 2.5 s at 10 m/s towards north-west
    state = one(v=10.0, heading=3 * math.pi / 4, a=5.0, w=1.0, j=1.0, dw=1.0)
    assert end(roll_out_paths("cv", state, None)) == pytest.approx((-25 / math.sqrt(2), 25 / math.sqrt(2)), abs=ATOL_M)


def test_constant_acceleration_by_hand() -> None:
    # 10 * 2.5 + 2 * 2.5^2 / 2 = 31.25 m
    paths = roll_out_paths("ca", one(v=10.0, a=2.0, w=0.5), None)
    assert end(paths) == pytest.approx((31.25, 0.0), abs=ATOL_M)
    assert paths.speed_mps[0, -1] == pytest.approx(15.0)


def test_constant_turn_rate_is_a_circle() -> None:
    # 10 m/s, 0.4 rad/s: radius 25 m, 1 rad in 2.5 s
    paths = roll_out_paths("ctrv", one(v=10.0, w=0.4), None)
    assert end(paths) == pytest.approx((25 * math.sin(1.0), 25 * (1 - math.cos(1.0))), abs=1e-8)
    np.testing.assert_allclose(np.hypot(paths.x_m, paths.y_m - 25.0), 25.0, atol=1e-8)


def test_braking_car_stops_by_hand() -> None:
    # 8 m/s braking with 4 m/s^2: stands after 2 s and 8 m
    paths = roll_out_paths("ctra", one(v=8.0, a=-4.0, w=0.1), None)
    at = np.searchsorted(paths.time_s, 1.999)
    assert paths.speed_mps[0, at - 1] == pytest.approx(0.2)
    assert (paths.speed_mps[0, at:] == 0.0).all()
    np.testing.assert_allclose(paths.heading_rad[0, at:], 0.2, atol=1e-12)
    straight = roll_out_paths("ca", one(v=8.0, a=-4.0), None)
    assert end(straight) == pytest.approx((8.0, 0.0), abs=ATOL_M)


def test_reversing_car_stops_by_hand() -> None:
    # 1.9 m/s backwards, slowing by 1 m/s^2: 1.9^2 / 2 m back, and no farther
    paths = roll_out_paths("ca", one(v=-1.9, a=1.0), None)
    assert end(paths) == pytest.approx((-1.805, 0.0), abs=ATOL_M)
    assert paths.speed_mps[0, -1] == 0.0


def test_car_at_rest_drives_off() -> None:
    assert end(roll_out_paths("ca", one(a=2.0), None)) == pytest.approx((6.25, 0.0), abs=ATOL_M)
    # jerk alone: 2 t^3 / 6
    assert end(roll_out_paths("cj-cya", one(j=2.0), None)) == pytest.approx((2.5**3 / 3, 0.0), abs=ATOL_M)


def test_constant_jerk_and_yaw_acceleration_against_scipy() -> None:
    state = one(x=3.0, y=-2.0, v=12.0, heading=0.4, a=-1.0, w=0.3, j=0.8, dw=-0.25)[0]

    def slope(_: float, s: FloatArray) -> list[float]:
        v, heading, a, w = s[2], s[3], s[4], s[5]
        return [v * math.cos(heading), v * math.sin(heading), a, w, state[6], state[7]]

    solution = solve_ivp(slope, (0.0, 2.5), state[:6], rtol=1e-11, atol=1e-11).y[:, -1]
    paths = roll_out_paths("cj-cya", state[None], None)
    assert end(paths) == pytest.approx(solution[:2], abs=1e-8)
    assert (paths.speed_mps[0, -1], paths.heading_rad[0, -1]) == pytest.approx(solution[2:4], abs=1e-8)


def test_measured_gains_against_scipy() -> None:
    # acceleration acts 0.5 s in full by 1 s and nothing more; the yaw rate is taken back after 2.5 s
    state = one(v=12.0, heading=0.4, a=-1.0, w=0.3, j=0.8, dw=-0.25)
    acted = np.array([[[0.25, 0.5, 0.5, 0.5], [0.5, 1.0, 2.0, 0.0]]])
    knots = [0.0, *HORIZON_KNOTS_S]

    def slope(t: float, _: FloatArray) -> list[float]:
        speed = 12.0 - np.interp(t, knots, [0.0, *acted[0, 0]])
        heading = 0.4 + 0.3 * np.interp(t, knots, [0.0, *acted[0, 1]])
        return [speed * math.cos(heading), speed * math.sin(heading)]

    solution = solve_ivp(slope, (0.0, 4.0), state[0, :2], rtol=1e-11, atol=1e-11, max_step=0.01).y[:, -1]
    paths = roll_out_paths("auto", state, None, settings=RolloutSettings(horizon_s=4.0), acting_s=acted)
    assert end(paths) == pytest.approx(solution, abs=1e-6)
    assert paths.speed_mps[0, -1] == pytest.approx(11.5)
    assert paths.heading_rad[0, -1] == pytest.approx(0.4 + 0.3 * 0.8)  # 2 s at 2.5 s, 0 at 5 s


def test_gains_of_cars_that_stop_are_those_of_each_alone() -> None:
    rng = np.random.default_rng(5)
    state = rng.normal(size=(40, 8)) * [5.0, 5.0, 4.0, 1.0, 3.0, 0.3, 1.0, 0.1]
    acted = np.sort(rng.uniform(0.0, 3.0, size=(40, 2, 4)), axis=2)
    together = roll_out_paths("auto", state, None, acting_s=acted)
    for i in range(40):
        alone = roll_out_paths("auto", state[i : i + 1], None, acting_s=acted[i : i + 1])
        np.testing.assert_allclose(alone.x_m[0], together.x_m[i], atol=ATOL_M)
        np.testing.assert_allclose(alone.speed_mps[0], together.speed_mps[i], atol=ATOL_M)


def paper_recursion(state: FloatArray, n_steps: int, step_s: float) -> FloatArray:
    """song2016 eq. 10 as printed: x, y after each step, (n_steps + 1, 2)."""
    x, y, v, heading, a, w, jerk, yaw_accel = state
    out = [(x, y)]
    for _ in range(n_steps):
        way = v * step_s + a * step_s**2 / 2
        x, y = x + way * math.cos(heading), y + way * math.sin(heading)
        v, heading = v + a * step_s, heading + w * step_s
        a, w = a + jerk * step_s, w + yaw_accel * step_s
        out.append((x, y))
    return np.array(out)


def test_paper_discretisation_is_equation_10() -> None:
    state = one(x=3.0, y=-2.0, v=12.0, heading=0.4, a=-1.0, w=0.3, j=0.8, dw=-0.25)
    paths = roll_out_paths("cj-cya", state, None, settings=RolloutSettings(discretisation="paper"))
    expected = paper_recursion(state[0], 50, 0.05)
    np.testing.assert_allclose(np.column_stack([paths.x_m[0], paths.y_m[0]]), expected, atol=ATOL_M)


def test_paper_discretisation_is_equation_2_without_the_rates() -> None:
    state = one(v=12.0, heading=0.4, a=-1.0, w=0.3, j=0.8, dw=-0.25)
    paths = roll_out_paths("ctra", state, None, settings=RolloutSettings(horizon_s=2.1, discretisation="paper"))
    kept = state[0].copy()
    kept[6:] = 0.0
    np.testing.assert_allclose(
        np.column_stack([paths.x_m[0], paths.y_m[0]]), paper_recursion(kept, 42, 0.05), atol=ATOL_M
    )


def test_paper_discretisation_stops_too() -> None:
    # 1 m/s braking with 2 m/s^2 stands after 0.25 m
    assert end(
        roll_out_paths("ca", one(v=1.03, a=-2.0), None, settings=RolloutSettings(discretisation="paper"))
    ) == pytest.approx((1.03**2 / 4, 0.0), abs=ATOL_M)


@pytest.mark.parametrize(
    ("special", "general", "zero"),
    [("ctrv", "ctra", "a"), ("ca", "ctra", "w"), ("cv", "ca", "a"), ("cv", "ctrv", "w")],
)
def test_models_agree_where_they_should(special: str, general: str, zero: str) -> None:
    values = {"v": 12.0, "heading": 0.4, "a": -1.0, "w": 0.3}
    values[zero] = 0.0
    one_path, other = (roll_out_paths(name, one(**values), None) for name in (special, general))
    np.testing.assert_allclose(one_path.x_m, other.x_m, atol=ATOL_M)
    np.testing.assert_allclose(one_path.y_m, other.y_m, atol=ATOL_M)


def test_jerk_model_without_rates_is_the_turn_rate_and_acceleration_model() -> None:
    state = one(v=12.0, heading=0.4, a=-1.0, w=0.3)
    np.testing.assert_allclose(
        roll_out_paths("cj-cya", state, None).x_m, roll_out_paths("ctra", state, None).x_m, atol=ATOL_M
    )


def test_auto_trusts_nothing_that_drowns_in_noise() -> None:
    state = one(v=12.0, heading=0.4, a=-1.0, w=0.3, j=0.8, dw=-0.25)
    covariance = np.diag([0.1, 0.1, 0.1, 1e-4, 1e8, 1e8, 1e8, 1e8])[None]
    np.testing.assert_allclose(
        roll_out_paths("auto", state, covariance).x_m, roll_out_paths("cv", state, covariance).x_m, atol=1e-5
    )


def test_auto_whose_derivatives_go_on_is_the_turn_rate_and_acceleration_model() -> None:
    state = one(v=12.0, heading=0.4, a=-1.0, w=0.3, j=0.8, dw=-0.25)
    expected = roll_out_paths("ctra", state, None, settings=RolloutSettings(horizon_s=5.0))
    found = roll_out_paths(
        "auto",
        state,
        np.zeros((1, 8, 8)),
        settings=RolloutSettings(horizon_s=5.0),
        acting_s=np.tile(HORIZON_KNOTS_S, (1, 2, 1)),
    )
    np.testing.assert_allclose(found.x_m, expected.x_m, atol=ATOL_M)
    np.testing.assert_allclose(found.y_m, expected.y_m, atol=ATOL_M)


def test_auto_whose_derivatives_carry_nothing_is_constant_velocity() -> None:
    state = one(v=12.0, heading=0.4, a=-1.0, w=0.3, j=0.8, dw=-0.25)
    found = roll_out_paths("auto", state, np.zeros((1, 8, 8)), acting_s=np.zeros((1, 2, 4)))
    np.testing.assert_array_equal(found.x_m, roll_out_paths("cv", state, None).x_m)


def test_auto_without_a_record_half_trusts_what_is_as_large_as_five_sigmas() -> None:
    covariance = np.zeros((1, 8, 8))
    covariance[0, 4, 4] = (1.0 / 5.0) ** 2
    trust = MODELS["auto"].trust(one(v=20.0, a=-1.0, w=0.1), covariance, DriverPrior())
    np.testing.assert_allclose(trust, [[0.5, 0.0, 1.0, 0.0]])


def test_displacement_variance_against_a_simulated_process() -> None:
    # a Gauss-Markov acceleration of unit variance, integrated twice: 20,000 runs of 2.5 s
    tau, step, n = 3.0, 0.01, 250
    rng = np.random.default_rng(0)
    accel = rng.normal(size=20_000)
    first, speed, place = accel.copy(), np.zeros(20_000), np.zeros(20_000)
    keep = math.exp(-step / tau)
    for _ in range(n):
        following = keep * accel + math.sqrt(1 - keep**2) * rng.normal(size=20_000)
        place += speed * step + (2 * accel + following) * step**2 / 6
        speed += (accel + following) * step / 2
        accel = following
    time = np.array([0.0, 1.0, 2.5])
    held = np.cov(place, first)[0, 1] / np.var(first)
    assert fading_accel_displacement_s2(time, tau)[-1] == pytest.approx(held, rel=0.02)
    assert displacement_variance_s4(time, tau)[-1] == pytest.approx(np.var(place - held * first), rel=0.04)
    assert displacement_variance_s4(np.array([0.1]), tau)[0] == pytest.approx(0.1**5 / (10 * tau), rel=0.1)


def test_time_grid_reaches_the_horizon() -> None:
    np.testing.assert_allclose(path_time_grid_s(2.5, 0.05), np.arange(51) * 0.05)
    np.testing.assert_allclose(path_time_grid_s(1.0, 0.3), [0.0, 0.3, 0.6, 0.9, 1.2])


@pytest.mark.parametrize(("horizon", "step"), [(0.0, 0.05), (-1.0, 0.05), (2.5, 0.0), (math.nan, 0.1), (1.0, math.inf)])
def test_bad_horizon_or_step_is_a_usage_error(horizon: float, step: float) -> None:
    with pytest.raises(UsageError):
        roll_out_paths("cv", one(), None, settings=RolloutSettings(horizon_s=horizon, step_s=step))


def test_unknown_model_is_a_usage_error_that_names_the_models() -> None:
    with pytest.raises(UsageError) as error:
        roll_out_paths("walking", one(), None)
    assert "cj-cya" in error.value.hint


def test_auto_has_no_paper_form() -> None:
    with pytest.raises(UsageError, match="song2016"):
        roll_out_paths("auto", one(), None, settings=RolloutSettings(discretisation="paper"))


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="state has shape"):
        roll_out_paths("cv", np.zeros((3, 6)), None)
    with pytest.raises(ValueError, match="covariance has shape"):
        roll_out_paths("cv", np.zeros((3, 8)), np.zeros((3, 6, 6)))


def test_no_starts_give_no_paths() -> None:
    paths = roll_out_paths("auto", np.zeros((0, 8)), np.zeros((0, 8, 8)))
    assert paths.x_m.shape == (0, 51)
    assert paths.position_covariance_m2.shape == (0, 51, 3)
