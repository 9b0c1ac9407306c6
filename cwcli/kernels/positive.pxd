# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Covariances that stay positive whatever the rounding of the processor.

A covariance that is computed as F P F' or as P - K S K' loses as many digits as the result is smaller than its parts,
and may come out negative. Here it is factored first, P = L L', and put together as M M' with M = F L: the rounding of a
sum of products M_ik M_jk is below n eps |M_i| |M_j|, so the correlations err by no more than n eps, whatever M is.
(Array algorithms: T. Kailath, A. Sayed, B. Hassibi, Linear Estimation, 2000, chapter 12.)
"""

from libc.math cimport sqrt

cdef inline int factor(const double* a, int n, int stride, double* low) noexcept nogil:
    """Lower factor L of the leading n x n block of a covariance, into `low` (packed n x n, zero above the diagonal).

    A pivot below 1e-15 of its variance, which is what rounding makes of a pivot of zero, is raised to that: the factor
    cannot fail, and stands for a covariance that is never too small. A row without a variance above zero becomes zero;
    NaN stays NaN. 0 = every variance is above zero, -1 = not.
    """
    cdef int i, j, k, status = 0
    cdef double s, least
    for j in range(n):
        s = a[j * stride + j]
        if not s > 0.0:
            status = -1
        least = 1e-15 * s
        for k in range(j):
            s -= low[j * n + k] * low[j * n + k]
            low[k * n + j] = 0.0
        if s < least:
            s = least
        if s <= 0.0:
            for k in range(j):
                low[j * n + k] = 0.0
            for i in range(j, n):
                low[i * n + j] = 0.0
            continue
        low[j * n + j] = sqrt(s)
        for i in range(j + 1, n):
            s = a[i * stride + j]
            for k in range(j):
                s -= low[i * n + k] * low[j * n + k]
            low[i * n + j] = s / low[j * n + j]
    return status


cdef inline void times_lower(const double* f, const double* low, int rows, int n, double* out) noexcept nogil:
    """out = f L: f is rows x n, L lower n x n, all packed."""
    cdef int i, j, k
    cdef double s
    for i in range(rows):
        for j in range(n):
            s = 0.0
            for k in range(j, n):
                s += f[i * n + k] * low[k * n + j]
            out[i * n + j] = s


cdef inline void add_square(const double* m, int n, int columns, int stride, double* out) noexcept nogil:
    """out <- out + M M', exactly symmetric. M is packed n x columns; `stride`: of the rows of `out`."""
    cdef int i, j, k
    cdef double s
    for i in range(n):
        for j in range(i + 1):
            s = out[i * stride + j]
            for k in range(columns):
                s += m[i * columns + k] * m[j * columns + k]
            out[i * stride + j] = s
            out[j * stride + i] = s
