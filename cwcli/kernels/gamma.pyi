def lower_gamma_series(a: float, x: float) -> float:
    """The sum of x^n / (a (a + 1) ... (a + n)) over n >= 0 (Abramowitz and Stegun 6.5.29), for 0 <= x < a + 1."""

def upper_gamma_fraction(a: float, x: float) -> float:
    """The continued fraction of Gamma(a, x) e^x x^-a (Abramowitz and Stegun 6.5.31), for x >= a + 1."""
