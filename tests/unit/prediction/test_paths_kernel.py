"""The kernel of the paths against its plain twins: the same bits, but for cosines and the order of sums of products."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from cwcli.kernels import paths as kernel
from cwcli.signals.vehicle_state import HEADING, SPEED, YAW_RATE
from tests.unit.prediction import naive_paths


@pytest.mark.parametrize("nodes", [1, 3])
@pytest.mark.parametrize("own_times", [False, True], ids=["common times", "own times"])
@pytest.mark.parametrize(
    "uses", [(False,) * 4, (True, False, False, False), (False, False, True, False), (True,) * 4], ids=str
)
def test_quadrature(uses: tuple[bool, bool, bool, bool], own_times: bool, nodes: int) -> None:
    rng = np.random.default_rng(5)
    m, steps = 7, 11
    shape = (m if own_times else 1, nodes, steps)
    state = rng.normal(size=(m, 8))
    state[0, 4:] = 0.0  # straight on: some sums are zeros, with a sign
    weight = rng.uniform(0.0, 0.1, shape)
    responses = tuple(rng.normal(size=shape) if used else np.zeros(shape) for used in uses)
    a, b, c, d = responses
    whole = naive_paths.quadrature(state, weight, (a, b, c, d), uses)
    every = kernel.quadrature(state, weight=weight, responses=(a, b, c, d), uses=uses, points=np.arange(steps + 1))
    np.testing.assert_allclose(every, whole, rtol=0.0, atol=1e-14)
    assert np.signbit(every[:, 0]).tolist() == np.signbit(whole[:, 0]).tolist()
    for points in (np.array([3, 4, 11]), np.array([0, 5])):
        found = kernel.quadrature(state, weight=weight, responses=(a, b, c, d), uses=uses, points=points)
        assert found.tobytes() == np.ascontiguousarray(every[:, :, points]).tobytes()
    for i in range(m):  # a row is the same whatever is beside it
        own = [each[i : i + 1] if own_times else each for each in (weight, a, b, c, d)]
        alone = kernel.quadrature(
            state[i : i + 1],
            weight=own[0],
            responses=(own[1], own[2], own[3], own[4]),
            uses=uses,
            points=np.arange(steps + 1),
        )
        assert alone.tobytes() == every[:, i : i + 1].tobytes()


def test_responses_of_parts_are_their_products() -> None:
    rng = np.random.default_rng(7)
    m, parts, steps = 5, 4, 9
    state, weight = rng.normal(size=(m, 8)), rng.uniform(0.0, 0.1, (1, 3, steps))
    inside, none = rng.uniform(0.0, 1.0, (parts, 3, steps)), np.zeros((1, 3, steps))
    along, across = rng.normal(size=(2, m, parts))
    uses, points = (True, False, True, False), np.arange(steps + 1)
    found = kernel.quadrature(
        state,
        weight=weight,
        responses=(inside, none, inside, none),
        uses=uses,
        points=points,
        acting_slopes=(along, across),
    )
    accel, yaw_rate = (np.tensordot(each, inside, 1) for each in (along, across))
    expected = kernel.quadrature(
        state, weight=weight, responses=(accel, none, yaw_rate, none), uses=uses, points=points
    )
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize(("farthest_rad", "bound"), [(0.7, 4e-16), (np.pi, 1e-15), (20.0, 1e-14), (5000.0, 1e-12)])
def test_directions_against_long_double(farthest_rad: float, bound: float) -> None:
    turn = np.linspace(-farthest_rad, farthest_rad, 2001)
    heading = 2.0
    found = cosine_and_sine_of_turn(heading, turn)
    exact = np.longdouble(heading) + turn.astype(np.longdouble)
    assert np.abs(found[0] - np.cos(exact)).max() < bound
    assert np.abs(found[1] - np.sin(exact)).max() < bound


def cosine_and_sine_of_turn(heading: float, turn: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """One step of weight 1 per row: the derivatives to the speed are the direction itself; shape (2, n)."""
    state, one, none = np.zeros((len(turn), 8)), np.ones((1, 1, 1)), np.zeros((1, 1, 1))
    state[:, HEADING], state[:, YAW_RATE] = heading, turn
    uses, responses = (False, False, True, False), (none, none, one, none)
    return kernel.quadrature(state, weight=one, responses=responses, uses=uses, points=np.array([1]))[:, :, 0, SPEED]


def test_directions_that_do_not_exist_are_nan() -> None:
    assert np.isnan(cosine_and_sine_of_turn(1.0, np.array([np.nan, np.inf, -np.inf]))).all()
    assert np.isnan(cosine_and_sine_of_turn(np.inf, np.array([0.5]))).all()


@pytest.mark.parametrize("own_times", [False, True], ids=["common times", "own times"])
def test_position_covariance(own_times: bool) -> None:
    rng = np.random.default_rng(8)
    m, k = 6, 5
    jacobian, heading = rng.normal(size=(2, m, k, 8)), rng.normal(size=(m, k))
    jacobian[0, ..., :2], jacobian[1, ..., :2] = (1.0, 0.0), (0.0, 1.0)  # derivatives to x and y
    covariance = rng.normal(size=(m, 8, 8))
    covariance = covariance @ covariance.transpose(0, 2, 1)
    trust = rng.uniform(0.0, 1.0, (m, 4))
    trust[0], trust[1, 2] = 0.0, 0.0
    covariance[1, YAW_RATE], covariance[1, :, YAW_RATE] = np.nan, np.nan  # not known, and not used
    variance, sigma = rng.uniform(0.0, 1.0, (4, m if own_times else 1, k)), rng.uniform(0.0, 1.0, (m, 4))
    out = np.empty((m, k, 3))
    kernel.position_covariance(
        jacobian, heading, covariance=covariance, trust=trust, variance=variance, sigma=sigma, out=out
    )
    each = variance * np.moveaxis(sigma, 1, 0)[:, :, None] ** 2
    driver_m2 = np.array([each[0] + each[1], each[2] + each[3]])
    expected = naive_paths.position_covariance(jacobian, heading, covariance, trust, driver_m2)
    np.testing.assert_allclose(out, expected[..., [0, 0, 1], [0, 1, 1]], rtol=1e-13, atol=1e-13)
    kernel.position_covariance(jacobian, heading, covariance=None, trust=trust, variance=variance, sigma=sigma, out=out)
    alone = naive_paths.position_covariance(jacobian, heading, np.zeros((m, 8, 8)), trust, driver_m2)
    np.testing.assert_allclose(out, alone[..., [0, 0, 1], [0, 1, 1]], rtol=1e-13, atol=1e-13)


def test_adapt_scale() -> None:
    rng = np.random.default_rng(6)
    n, sets = 400, 3
    log_excess = rng.normal(size=(sets, n))
    log_excess[0] += 3.0  # runs into the bound
    is_known = rng.random((sets, n)) > 0.1
    n_known = np.maximum(np.arange(n) - rng.integers(5, 9), 0)
    step_s = rng.uniform(0.0, 0.5, n)
    found = kernel.adapt_scale(log_excess, is_known, n_known, step_s, rate_1ps=0.3, bound=1.5, miss_share=0.1)
    for k in range(sets):
        expected = naive_paths.adapt_scale(
            log_excess[k], is_known[k], n_known, step_s, rate_1ps=0.3, bound=1.5, miss_share=0.1
        )
        assert found[k].tobytes() == expected.tobytes()
    assert found[0].max() == 1.5


@pytest.mark.parametrize("n_points", [2, 3, 50])
def test_on_track(n_points: int) -> None:
    rng = np.random.default_rng(n_points)
    stamp_ns = np.cumsum(rng.integers(1, 8, n_points)) * 100_000_000
    state = rng.normal(size=(n_points, 8))
    state[n_points // 2, 1] = np.nan
    at_ns = rng.integers(-3, int(stamp_ns[-1]) // 50_000_000 + 3, (40, 6)) * 50_000_000  # on points and between them
    found, is_known = kernel.on_track(at_ns, stamp_ns, state[:, :2], 4e8)
    position, known = naive_paths.on_track(at_ns, stamp_ns, state[:, :2], 4e8)
    assert found.tobytes() == position.tobytes()
    assert is_known.tolist() == known.tolist()
