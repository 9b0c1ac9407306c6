"""The kernel of the paths against its plain twins: the same bits."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.kernels import paths as kernel
from tests.unit.prediction import naive_paths


@pytest.mark.parametrize("nodes", [1, 3])
@pytest.mark.parametrize("own_times", [False, True], ids=["common times", "own times"])
@pytest.mark.parametrize(
    "uses", [(False,) * 4, (True, False, False, False), (False, False, True, False), (True,) * 4], ids=str
)
def test_quadrature(uses: tuple[bool, bool, bool, bool], own_times: bool, nodes: int) -> None:
    rng = np.random.default_rng(5)
    m, steps = 7, 11
    shape = (m if own_times else 1, steps, nodes)
    state = rng.normal(size=(m, 8))
    state[0, 4:] = 0.0  # straight on: some sums are zeros, with a sign
    turns = any(uses[2:])
    heading = rng.normal(size=(m, steps, nodes) if turns else (m, 1, 1))
    weight = rng.uniform(0.0, 0.1, shape)
    responses = tuple(rng.normal(size=shape) if used else np.zeros(shape) for used in uses)
    a, b, c, d = responses
    cosine, sine = np.cos(heading), np.sin(heading)
    whole = naive_paths.quadrature(state, cosine, sine, weight, (a, b, c, d), uses)
    for points in (np.arange(steps + 1), np.array([3, 4, 11]), np.array([0, 5])):
        found = kernel.quadrature(
            state, cosine=cosine, sine=sine, weight=weight, responses=(a, b, c, d), uses=uses, points=points
        )
        assert found.tobytes() == np.ascontiguousarray(whole[:, :, points]).tobytes()


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
