"""Plain twins of `cwcli.kernels.gamma`."""

from __future__ import annotations


def lower_gamma_series(a: float, x: float) -> float:
    """Term by term, until one is lost in the rounding of the sum."""
    term = total = 1.0 / a
    n = a
    while term > total * 1e-16:
        n += 1.0
        term *= x / n
        total += term
    return total


def upper_gamma_fraction(a: float, x: float) -> float:
    """Lentz's method, until a step changes nothing but the rounding."""
    tiny = 1e-300
    b = x + 1.0 - a
    c, d = 1.0 / tiny, 1.0 / b
    fraction = d
    for i in range(1, 10_000):
        an = -i * (i - a)
        b += 2.0
        d = 1.0 / (an * d + b if an * d + b != 0.0 else tiny)
        c = b + an / c if c != 0.0 else tiny
        fraction *= c * d
        if abs(c * d - 1.0) < 1e-15:
            break
    return fraction
