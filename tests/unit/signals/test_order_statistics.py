"""Distinct values, medians and quantiles are those of NumPy, to the bit."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.signals.columns import median_of_values, quantile_of_values, sort_distinct_values

SHAPES = [(1,), (2,), (3,), (7,), (100,), (101,), (5, 3)]


def drawn_values(shape: tuple[int, ...], kind: str) -> np.ndarray:
    """Values with repeats."""
    rng = np.random.default_rng(sum(shape))
    values = rng.integers(-4, 5, shape)
    return values * (1.0 + rng.random(shape)) if kind == "float" else values.astype(kind)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("kind", ["float", "int64", "int8"])
def test_they_are_those_of_numpy(shape: tuple[int, ...], kind: str) -> None:
    values = drawn_values(shape, kind)
    before = values.copy()
    np.testing.assert_array_equal(sort_distinct_values(values), np.unique(values), strict=True)
    assert median_of_values(values) == np.median(values)
    for share in (0.0, 0.01, 0.25, 0.5, 0.61, 0.95, 0.99, 1.0):
        assert quantile_of_values(values, share) == np.quantile(values, share)
    np.testing.assert_array_equal(values, before)


def test_large_integers_keep_their_digits_as_in_numpy() -> None:
    stamp_ns = np.array([1_700_000_000_000_000_001, 1_700_000_000_000_000_002, 1_700_000_000_100_000_007])
    assert median_of_values(stamp_ns) == np.median(stamp_ns)
    assert sort_distinct_values(stamp_ns).tolist() == stamp_ns.tolist()


def test_nothing_and_nan() -> None:
    assert np.isnan(median_of_values(np.zeros(0)))
    assert len(sort_distinct_values(np.zeros(0))) == 0
    values = np.array([2.0, np.nan, 1.0])
    assert np.isnan(median_of_values(values))
    assert np.isnan(quantile_of_values(values, 0.5))
