"""Independent values, NEES and error rows, against closed forms and hand calculation."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation.consistency import (
    compare_errors_with_truth,
    effective_count_of_squared_errors,
    effective_sample_count,
    nees,
)


def autoregression(coefficient: float, white: np.ndarray) -> np.ndarray:
    """First order: each value is the coefficient times the one before it, and the noise."""
    values = white.copy()
    for k in range(1, len(values)):
        values[k] += coefficient * values[k - 1]
    return values


def test_effective_count_of_a_correlated_series() -> None:
    """First-order autoregression with coefficient c is worth n (1 - c) / (1 + c)."""
    white = np.random.default_rng(1).standard_normal(20_000)
    assert effective_sample_count(white) == pytest.approx(20_000, rel=0.05)
    assert effective_sample_count(autoregression(0.8, white)) == pytest.approx(20_000 * 0.2 / 1.8, rel=0.15)


def test_effective_count_of_squared_errors() -> None:
    """With the autocorrelation c^k the squares have c^2k, and are worth n (1 - c^2) / (1 + c^2)."""
    white = np.random.default_rng(1).standard_normal((20_000, 2))
    unit = np.broadcast_to(np.eye(2), (20_000, 2, 2))
    assert effective_count_of_squared_errors(white, unit) == pytest.approx(20_000, rel=0.05)
    lasting = autoregression(0.95, white) * [3.0, 0.2]  # the covariance is that of the errors
    covariance = unit * np.array([9.0, 0.04]) / (1.0 - 0.95**2)
    expected = 20_000 * (1 - 0.95**2) / (1 + 0.95**2)
    assert effective_count_of_squared_errors(lasting, covariance) == pytest.approx(expected, rel=0.25)


def test_effective_counts_of_four_values_by_hand() -> None:
    """Two and two: a quarter at a lag of one, less than nothing at two; the squares have a sixteenth."""
    values = np.array([0.1, 0.1, -0.1, -0.1])
    assert effective_sample_count(values) == pytest.approx(4.0 / 1.5)
    squares = effective_count_of_squared_errors(values[:, None], np.full((4, 1, 1), 0.01))
    assert squares == pytest.approx(4.0 / 1.125)


def test_what_was_not_estimated_has_no_error_row() -> None:
    both = {"speed": np.zeros(2), "heading": np.zeros(2)}
    assert [row.name for row in compare_errors_with_truth(both, both, {"speed": np.ones(2)})] == ["speed"]


def test_an_error_that_never_changes_is_about_one_error() -> None:
    error = np.full((1000, 1), 0.6)
    assert effective_count_of_squared_errors(error, np.ones((1000, 1, 1))) == pytest.approx(1.5, rel=0.01)


def test_nees_by_hand() -> None:
    error = np.array([[1.0, 2.0], [0.0, 3.0]])
    covariance = np.array([[[1.0, 0.0], [0.0, 4.0]], [[1.0, 0.0], [0.0, 9.0]]])
    np.testing.assert_allclose(nees(error, covariance), [2.0, 1.0])


def test_error_rows_by_hand() -> None:
    truth = {"speed": np.array([10.0, 10.0]), "heading": np.array([np.pi, np.pi])}
    measured = {"speed": np.array([11.0, 9.0]), "heading": np.array([-np.pi + 0.1, np.pi - 0.1])}
    estimated = {"speed": np.array([10.5, 10.5]), "heading": np.array([np.pi, np.nan])}
    speed, heading = compare_errors_with_truth(truth, measured, estimated)
    assert (speed.measured_sigma, speed.estimated_sigma, speed.estimated_bias) == (1.0, 0.5, 0.5)
    assert speed.change_percent == pytest.approx(-50.0)
    assert heading.measured_sigma == pytest.approx(np.degrees(0.1))
    assert (heading.n, heading.estimated_sigma) == (1, 0.0)
