# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""The chi-square distribution by the incomplete gamma function, whose number of terms grows with the degrees of freedom.
The plain twins of the sums are in tests/unit/metrics/naive_gamma.py.
"""

from libc.math cimport exp, fabs, log

cdef enum:
    MAX_FRACTION_TERMS = 10000
    MAX_HALVINGS = 200

cdef double LEAST_TERM = 1e-16
cdef double LEAST_CHANGE = 1e-15
cdef double TINY = 1e-300
cdef double QUANTILE_RTOL = 1e-12



cdef double _lower_series(double a, double x) noexcept nogil:
    cdef double term = 1.0 / a, total = 1.0 / a, n = a
    while term > total * LEAST_TERM:
        n += 1.0
        term *= x / n
        total += term
    return total


cdef double _upper_fraction(double a, double x) noexcept nogil:
    cdef double b = x + 1.0 - a, c = 1.0 / TINY, d = 1.0 / b, fraction = d, an
    cdef int i
    for i in range(1, MAX_FRACTION_TERMS):
        an = -i * (i - a)
        b += 2.0
        d = an * d + b
        d = 1.0 / (d if d != 0.0 else TINY)
        c = b + an / c if c != 0.0 else TINY
        fraction *= c * d
        if fabs(c * d - 1.0) < LEAST_CHANGE:
            break
    return fraction


cdef double _chi_square_cdf(double x, double a, double log_gamma) noexcept nogil:
    cdef double h = 0.5 * x, front
    if x <= 0.0:
        return 0.0
    front = exp(a * log(h) - h - log_gamma)
    if h < a + 1.0:
        return front * _lower_series(a, h)
    return 1.0 - front * _upper_fraction(a, h)


def lower_gamma_series(double a, double x):
    return _lower_series(a, x)


def upper_gamma_fraction(double a, double x):
    return _upper_fraction(a, x)


def chi_square_cdf(double x, double dof, double log_gamma):
    return _chi_square_cdf(x, 0.5 * dof, log_gamma)


def chi_square_quantile(double probability, double dof, double log_gamma):
    cdef double a = 0.5 * dof, low = 0.0, high = dof + 10.0, middle
    cdef int i
    with nogil:
        while _chi_square_cdf(high, a, log_gamma) < probability:
            high *= 2.0
        for i in range(MAX_HALVINGS):
            middle = 0.5 * (low + high)
            if _chi_square_cdf(middle, a, log_gamma) < probability:
                low = middle
            else:
                high = middle
            if high - low <= QUANTILE_RTOL * high:
                break
    return 0.5 * (low + high)
