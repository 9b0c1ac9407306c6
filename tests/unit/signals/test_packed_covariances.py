"""Covariances as sigmas and correlations, against NumPy's own arithmetic on the matrices."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.signals.packed_covariances import PackedCovariances, variances_of_states
from cwcli.signals.precision import round_plane_covariance, round_to_binary_digits, round_to_binary_step


def definite(n: int, k: int, *, least: float, seed: int = 0) -> np.ndarray:
    """Covariances whose correlations have eigenvalues down to about `least`, in very different units."""
    rng = np.random.default_rng(seed)
    base = rng.normal(size=(n, k, k)) * np.geomspace(1.0, np.sqrt(least), k)
    covariance = base @ np.swapaxes(base, 1, 2) + 1e-12 * np.eye(k)
    unit = np.geomspace(1e-4, 1e3, k)
    return covariance * unit[:, None] * unit


@pytest.mark.parametrize("least", [1.0, 1e-2, 1e-5, 1e-8])
def test_packed_covariance_is_positive_definite_whatever_it_was(least: float) -> None:
    dense = PackedCovariances.from_dense(definite(3000, 8, least=least)).to_dense_n_k_k()
    np.linalg.cholesky(dense)  # raises where one is not
    assert np.array_equal(dense, np.swapaxes(dense, 1, 2))


def test_packed_covariance_keeps_sigmas_to_nine_digits_and_correlations_to_a_thousandth() -> None:
    given = definite(3000, 8, least=0.3)
    packed = PackedCovariances.from_dense(given)
    sigma = np.sqrt(np.einsum("nii->ni", given))
    correlation = given / sigma[:, :, None] / sigma[:, None, :]
    np.testing.assert_allclose(packed.sigma, sigma, rtol=2.0**-9)
    above = np.triu_indices(8, 1)
    np.testing.assert_allclose(packed.correlation, correlation[:, above[0], above[1]], atol=2.0**-10 + 1e-7)


@pytest.mark.parametrize("least", [0.07, 0.05, 1e-2, 1e-3])
def test_step_of_correlations_is_small_beside_the_least_eigenvalue(least: float) -> None:
    """Of two states with correlation r it is 1 - r, which rounding changes by half a step."""
    correlation = 1.0 - least * np.linspace(0.8, 1.0, 50)
    given = np.stack([np.ones(50), correlation, correlation, np.ones(50)], axis=1).reshape(-1, 2, 2)
    rounded = PackedCovariances.from_dense(given)[:, 0, 1]
    np.testing.assert_allclose(1.0 - rounded, 1.0 - correlation, rtol=2.0**-6)
    assert np.abs(rounded - correlation).max() > least * 2.0**-9  # finer steps would spend bits on noise


def test_packed_covariances_are_read_like_an_array() -> None:
    packed = PackedCovariances.from_dense(definite(40, 8, least=0.1))
    dense = packed.to_dense_n_k_k()
    rows = np.array([3, 1, 39])
    assert packed.shape == dense.shape and len(packed) == 40
    for key in (
        np.s_[4:9], np.s_[rows], np.s_[7], np.s_[-1], np.s_[:, 2, 5], np.s_[:, 5, 2], np.s_[:, 6, 6], np.s_[rows, 0, 7],
        np.s_[:, :2, :2], np.s_[7, 1, 1],
    ):  # fmt: skip
        np.testing.assert_allclose(packed[key], dense[key], rtol=1e-15)
    np.testing.assert_allclose(variances_of_states(packed, [4, 5]), dense[:, [4, 5], [4, 5]], rtol=1e-15)
    np.testing.assert_allclose(variances_of_states(dense, [4, 5]), dense[:, [4, 5], [4, 5]])
    assert np.array_equal(np.asarray(packed), dense)


def test_covariance_that_is_not_positive_definite_is_packed_as_nan() -> None:
    given = np.tile(np.eye(3), (4, 1, 1))
    given[1, 0, 1] = given[1, 1, 0] = 1.5
    given[2, 2, 2] = -1.0
    assert np.isnan(PackedCovariances.from_dense(given).sigma).any(axis=1).tolist() == [False, True, True, False]


def test_numbers_are_rounded_to_steps_and_digits() -> None:
    assert round_to_binary_step(np.array([0.3, -0.3, 1e300, np.nan]), 2).tolist()[:3] == [0.25, -0.25, 1e300]
    assert round_to_binary_digits(np.array([0.0, 100.0, -3.3e-5]), 3).tolist() == [0.0, 96.0, -(2.0**-15)]


def test_rounded_plane_covariance_stays_one_and_is_no_smaller() -> None:
    rng = np.random.default_rng(1)
    sigma, correlation = rng.lognormal(size=(2000, 2)), np.tanh(3.0 * rng.normal(size=2000))
    given = np.stack([sigma[:, 0] ** 2, correlation * sigma.prod(axis=1), sigma[:, 1] ** 2], axis=1)
    rounded = round_plane_covariance(given, 6)
    xx, xy, yy = rounded.T
    assert (xx * yy > xy**2).all() and (rounded[:, ::2] >= given[:, ::2]).all()
    np.testing.assert_allclose(rounded[:, ::2], given[:, ::2], rtol=2.0**-5)
