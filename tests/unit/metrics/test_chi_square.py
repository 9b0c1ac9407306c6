import math

import numpy as np
import pytest
from scipy import stats

from cwcli.kernels import gamma
from cwcli.metrics.chi_square import chi_square_mean_bounds, chi_square_quantile
from tests.unit.metrics import naive_gamma


@pytest.mark.parametrize("dof", [1, 2, 3, 10, 747.5, 40_000])
@pytest.mark.parametrize("probability", [1e-6, 0.025, 0.5, 0.975, 0.9999])
def test_quantile_and_distribution_equal_scipy(dof, probability) -> None:
    expected = stats.chi2.ppf(probability, dof)
    assert chi_square_quantile(probability, dof) == pytest.approx(expected, rel=1e-8)
    assert gamma.chi_square_cdf(expected, dof, math.lgamma(dof / 2)) == pytest.approx(probability, rel=1e-7)


@pytest.mark.parametrize("a", [0.5, 1.0, 5.0, 373.75, 30_000.0])
@pytest.mark.parametrize("ratio", [0.1, 0.9, 1.0, 1.1, 4.0])
def test_the_kernel_equals_its_plain_twin_to_the_bit(a, ratio) -> None:
    x = ratio * (a + 1.0)
    name = "lower_gamma_series" if x < a + 1.0 else "upper_gamma_fraction"
    assert getattr(gamma, name)(a, x) == getattr(naive_gamma, name)(a, x)


def test_two_degrees_of_freedom_by_hand() -> None:
    assert chi_square_quantile(0.95, 2) == pytest.approx(-2.0 * np.log(0.05))


def test_bounds_of_a_mean() -> None:
    # Bar-Shalom et al., section 5.4.2, example: 50 runs of 2 degrees of freedom: [1.48, 2.59] (chi-square of 100 / 50)
    low, high = chi_square_mean_bounds(2, 50)
    assert (round(low, 2), round(high, 2)) == (1.48, 2.59)
    assert np.isnan(chi_square_mean_bounds(2, 0)).all()


def test_mean_bounds_hold_95_percent_of_the_means() -> None:
    low, high = chi_square_mean_bounds(2, 100)
    means = np.random.default_rng(0).chisquare(2, (4000, 100)).mean(axis=1)
    assert ((means > low) & (means < high)).mean() == pytest.approx(0.95, abs=0.015)


@pytest.mark.parametrize("probability", [0.0, 1.0, -1.0])
def test_a_probability_outside_0_and_1_is_refused(probability) -> None:
    with pytest.raises(ValueError, match="not between"):
        chi_square_quantile(probability, 2)
