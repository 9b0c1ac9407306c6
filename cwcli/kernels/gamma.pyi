def lower_gamma_series(a: float, x: float) -> float:
    """The sum of x^n / (a (a + 1) ... (a + n)) over n >= 0 (Abramowitz and Stegun 6.5.29), for 0 <= x < a + 1."""

def upper_gamma_fraction(a: float, x: float) -> float:
    """The continued fraction of Gamma(a, x) e^x x^-a (Abramowitz and Stegun 6.5.31), for x >= a + 1."""

def chi_square_cdf(x: float, dof: float, log_gamma: float) -> float:
    """The probability that a chi-square variable with `dof` degrees of freedom is at most x.

    Regularised incomplete gamma function: its series below the mean, its continued fraction above. `log_gamma` is
    log(Gamma(dof / 2)).
    """

def chi_square_quantile(probability: float, dof: float, log_gamma: float) -> float:
    """The x at which `chi_square_cdf` is the probability, by bisection until the bracket is 1e-12 of x wide."""
