"""What is predicted from a state does not depend on which other states are predicted with it."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.prediction.fleet import HORIZON_KNOTS_S, interpolate_acting_time_s, multiply_rows_reproducibly
from cwcli.prediction.outcome_history import PathStarts, measure_acting_time_s
from cwcli.prediction.scales import interpolate_log_scale

N = 400
TIME_S = np.linspace(0.0, 2.5, 51)


def test_products_are_those_of_matrices() -> None:
    rng = np.random.default_rng(1)
    weights, rows = rng.normal(size=(7, 3)), rng.normal(size=(3, 11))
    np.testing.assert_allclose(multiply_rows_reproducibly(weights, rows), weights @ rows, rtol=1e-14)


@pytest.mark.parametrize("n", [1, 2, 3, 17, 64, 129])
def test_scales_and_accelerations_of_a_row_are_the_same_bits_in_any_company(n: int) -> None:
    rng = np.random.default_rng(2)
    log_scale, acted = rng.normal(size=(N, 3)), np.cumsum(rng.uniform(size=(N, len(HORIZON_KNOTS_S))), axis=1)
    for first in (0, 5, N - n):
        rows = slice(first, first + n)
        assert np.array_equal(
            interpolate_log_scale(log_scale[rows], TIME_S), interpolate_log_scale(log_scale, TIME_S)[rows]
        )
        assert np.array_equal(
            interpolate_acting_time_s(acted[rows], TIME_S[None]), interpolate_acting_time_s(acted, TIME_S[None])[rows]
        )


def test_the_first_state_of_a_vehicle_says_the_same_alone() -> None:
    rng = np.random.default_rng(3)
    n, stamp_ns = 40, 10**18 + 50_000_000 * np.arange(40)
    state = rng.normal([0.0, 0.0, 10.0, 0.0, 1.0, 0.1, 0.5, 0.05], 1.0, (n, 8))
    covariance = np.tile(np.diag([0.3, 0.3, 0.1, 0.01, 0.3, 0.01, 0.3, 0.01]), (n, 1, 1))
    whole = measure_acting_time_s(PathStarts(np.zeros(n, np.intp), stamp_ns, state, covariance, stamp_ns))
    alone = measure_acting_time_s(
        PathStarts(np.zeros(1, np.intp), stamp_ns[:1], state[:1], covariance[:1], stamp_ns[:1])
    )
    assert np.array_equal(alone, whole[:1])
