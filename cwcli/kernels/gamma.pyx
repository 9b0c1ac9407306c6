# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""The sums of the incomplete gamma function, whose number of terms grows with the degrees of freedom of a chi-square
variable. The plain twins are in tests/unit/metrics/naive_gamma.py.
"""

from libc.math cimport fabs

cdef enum:
    MAX_FRACTION_TERMS = 10000

cdef double LEAST_TERM = 1e-16
cdef double LEAST_CHANGE = 1e-15
cdef double TINY = 1e-300


def lower_gamma_series(double a, double x):
    cdef double term = 1.0 / a, total = 1.0 / a, n = a
    with nogil:
        while term > total * LEAST_TERM:
            n += 1.0
            term *= x / n
            total += term
    return total


def upper_gamma_fraction(double a, double x):
    cdef double b = x + 1.0 - a, c = 1.0 / TINY, d, fraction, an
    cdef int i
    with nogil:
        d = 1.0 / b
        fraction = d
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
