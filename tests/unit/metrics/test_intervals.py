"""Confidence intervals against SciPy, published numbers and simulated coverage."""

import math

import numpy as np
import pytest
from scipy import stats

from cwcli.metrics.intervals import (
    bootstrap_interval,
    clustered_proportion_interval,
    normal_interval,
    poisson_interval,
    proportion_interval,
)


@pytest.mark.parametrize("count", [0, 1, 3, 10, 57, 400])
@pytest.mark.parametrize("level", [0.8, 0.95])
def test_poisson_interval_is_garwoods(count: int, level: float) -> None:
    tail = (1.0 - level) / 2.0
    low = stats.chi2.ppf(tail, 2 * count) / 2.0 if count else 0.0
    high = stats.chi2.ppf(1.0 - tail, 2 * count + 2) / 2.0
    assert poisson_interval(count, level) == pytest.approx((low, high), abs=1e-9)


@pytest.mark.parametrize("count", [1000, 1001, 20_000, 10**9])
def test_poisson_interval_of_many_events_takes_no_longer(count: int) -> None:
    expected = stats.chi2.ppf(0.025, 2 * count) / 2.0, stats.chi2.ppf(0.975, 2 * count + 2) / 2.0
    assert poisson_interval(count) == pytest.approx(expected, rel=1e-6)
    assert all(map(math.isfinite, poisson_interval(10**300)))


def test_poisson_interval_of_no_events_is_the_rule_of_three() -> None:
    # one-sided 95 %: -ln(0.05) = 2.996; two-sided 90 % has the same upper tail
    assert poisson_interval(0, 0.9) == pytest.approx((0.0, 2.9957322736), abs=1e-9)


@pytest.mark.parametrize(("successes", "n"), [(0, 10), (1, 10), (9, 10), (10, 10), (850, 1000)])
def test_proportion_interval_is_wilsons(successes: int, n: int) -> None:
    expected = stats.binomtest(successes, n).proportion_ci(0.95, method="wilson")
    assert proportion_interval(successes, n) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_normal_interval_by_hand() -> None:
    # mean 3, standard deviation sqrt(2.5), standard error sqrt(0.5), 1.959964 sigma
    half = 1.959963984540054 * np.sqrt(0.5)
    assert normal_interval(np.array([1.0, 2.0, 3.0, 4.0, 5.0])) == pytest.approx((3 - half, 3 + half), abs=1e-12)


def test_bootstrap_interval_agrees_with_scipy() -> None:
    values = np.random.default_rng(3).exponential(size=200)
    expected = stats.bootstrap(
        (values,), np.mean, method="percentile", n_resamples=4000, rng=np.random.default_rng(4)
    ).confidence_interval
    found = bootstrap_interval(values, seed=5, n_resamples=4000)
    assert found == pytest.approx((expected.low, expected.high), abs=0.02)


def test_bootstrap_interval_same_seed_same_numbers() -> None:
    values = np.random.default_rng(0).normal(size=50)
    assert bootstrap_interval(values, seed=1) == bootstrap_interval(values, seed=1)
    assert bootstrap_interval(values, seed=1) != bootstrap_interval(values, seed=2)


def test_bootstrap_interval_of_a_median() -> None:
    values = np.arange(101.0)
    low, high = bootstrap_interval(values, lambda sample: float(np.median(sample)), seed=0)
    assert 30.0 < low < 50.0 < high < 70.0


def test_block_bootstrap_is_wider_on_a_time_series_that_repeats_its_values() -> None:
    # every value ten times in a row; a run of 20 holds a, 10 and 10 - a of three values, a = 0..9, so the variance of
    # its mean is (28.5 + 100 + 38.5) / 400 of a value's, against 1 / 20 for 20 single draws
    values = np.repeat(np.random.default_rng(1).normal(size=200), 10)
    plain = np.diff(bootstrap_interval(values, seed=0))[0]
    blocks = np.diff(bootstrap_interval(values, seed=0, block=20))[0]
    assert blocks / plain == pytest.approx(np.sqrt(0.4175 * 20.0), rel=0.1)


def test_intervals_of_too_little_are_not_known() -> None:
    one = np.array([1.0])
    for low, high in (normal_interval(one), bootstrap_interval(one, seed=0), proportion_interval(0, 0)):
        assert np.isnan(low)
        assert np.isnan(high)


def test_intervals_refuse_nonsense() -> None:
    with pytest.raises(ValueError, match="negative"):
        poisson_interval(-1)
    with pytest.raises(ValueError, match="not a share"):
        proportion_interval(3, 2)
    with pytest.raises(ValueError, match="level"):
        normal_interval(np.zeros(3), level=1.0)
    with pytest.raises(ValueError, match="block"):
        bootstrap_interval(np.zeros(3), seed=0, block=0)


def test_clusters_that_are_alike_count_as_one_trial_each() -> None:
    # Ten drives of ten frames, each drive all right or all wrong: what is known is what ten trials tell.
    assert clustered_proportion_interval([10] * 7 + [0] * 3, [10] * 10) == pytest.approx(proportion_interval(7, 10))
    assert clustered_proportion_interval([10] * 10, [10] * 10) == pytest.approx(proportion_interval(10, 10))


def test_clusters_that_are_not_alike_count_in_full() -> None:
    # Seven of ten in every drive: less spread than independent trials have, so the design effect is 1.
    assert clustered_proportion_interval([7] * 10, [10] * 10) == pytest.approx(proportion_interval(70, 100))


def test_clustered_interval_lies_between() -> None:
    # Sums 9, 9, 5, 5 of 10: share 0.7, residuals 2, 2, -2, -2; variance 4/3 * 16; over 40 * 0.7 * 0.3: 2.54.
    low, high = clustered_proportion_interval([9, 9, 5, 5], [10] * 4)
    z2, n = stats.norm.ppf(0.975) ** 2, 40 / (64 / 3 / 8.4)
    half = np.sqrt(z2 * (0.21 / n + z2 / (4 * n * n))) / (1 + z2 / n)
    assert (low, high) == pytest.approx(
        ((0.7 + z2 / (2 * n)) / (1 + z2 / n) - half, (0.7 + z2 / (2 * n)) / (1 + z2 / n) + half)
    )


@pytest.mark.parametrize(("successes", "trials"), [([1], [1, 2]), ([3], [2]), ([-1], [2])])
def test_clustered_interval_refuses_nonsense(successes: list[int], trials: list[int]) -> None:
    with pytest.raises(ValueError, match="cluster"):
        clustered_proportion_interval(successes, trials)
