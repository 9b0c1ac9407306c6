# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the vehicle-state kernel against rounding: Joseph's form, and the information that runs backward."""

from libc.math cimport sqrt

from cwcli.kernels.ekf_motion cimport NMAX
from cwcli.kernels.positive cimport add_square, factor


cdef inline bint is_lossy(double all, double part) noexcept nogil:
    """True where so much of a variance (or of an information) goes that a plain difference keeps less than ten digits."""
    return all > 1e6 * part


cdef inline void take_in(double* p, const double* k, double r, const double* hx, const int* idx, int m,
                         int n) noexcept nogil:
    """P <- (I - k h') P (I - k h')' + r k k', put together from the factor of P, so that it stays positive.

    With the gain k = P h / (h' P h + r) this is P - k k' (h' P h + r), of which rounding leaves few digits where h' P h is
    far larger than r.
    """
    cdef int i, j
    cdef double hl
    cdef double low[NMAX * NMAX]
    cdef double parts[NMAX * (NMAX + 1)]
    factor(p, n, NMAX, low)
    for j in range(n):
        hl = 0.0
        for i in range(m):
            hl += hx[i] * low[idx[i] * n + j]
        for i in range(n):
            parts[i * (n + 1) + j] = low[i * n + j] - k[i] * hl
    for i in range(n):
        parts[i * (n + 1) + n] = k[i] * sqrt(r)
        for j in range(n):
            p[i * NMAX + j] = 0.0
    add_square(parts, n, n + 1, NMAX, p)


cdef inline void take_outer(double* a, const double* g, const double* w, int n) noexcept nogil:
    """a <- a - g w', four columns at once: behind n all of `w` has to be zero."""
    cdef int i, k
    cdef double c
    cdef double* row
    for i in range(n):
        c = g[i]
        row = a + i * NMAX
        for k in range(0, n, 4):
            row[k] -= c * w[k]
            row[k + 1] -= c * w[k + 1]
            row[k + 2] -= c * w[k + 2]
            row[k + 3] -= c * w[k + 3]


cdef inline void forget(double* y, double* big, double* q, int n) noexcept nogil:
    """(Y, y) <- what is known of the state before noise q was added to it: Y <- (Y^-1 + q)^-1. Leaves q zero.

    One column of q = sum of d g g' after the other: Y g g' Y / (1 / d + g' Y g) is taken away, as a scalar measurement
    takes covariance away from a state.
    """
    cdef int i, j, k, count
    cdef double d, scale, inner
    cdef bint is_small
    cdef double w[NMAX]
    cdef double g[NMAX]
    cdef int at[NMAX]
    cdef double* row
    for i in range(n, NMAX):
        w[i] = 0.0
    for j in range(n):
        row = q + j * NMAX
        d = row[j]
        row[j] = 0.0
        count = 0
        for i in range(j + 1, n):
            if row[i] != 0.0:
                at[count] = i
                g[count] = row[i] / d if d > 0.0 else 0.0
                count += 1
                row[i] = 0.0
        if d <= 0.0:
            continue
        for i in range(n):
            w[i] = big[j * NMAX + i]
        inner = y[j]
        for k in range(count):
            inner += g[k] * y[at[k]]
            row = big + at[k] * NMAX
            for i in range(n):
                w[i] += g[k] * row[i]
            row = q + at[k] * NMAX
            for i in range(k, count):                         # what is left of q, above its diagonal
                row[at[i]] -= d * g[k] * g[i]
        scale = w[j]
        for k in range(count):
            scale += g[k] * w[at[k]]
        if scale <= 0.0:                                      # nothing is known along g
            continue
        is_small = is_lossy(1.0 + d * scale, 1.0)
        scale = d / (1.0 + d * scale)
        inner *= scale
        for i in range(n):
            y[i] -= inner * w[i]
        if is_small:
            at[count] = j
            g[count] = 1.0
            for i in range(n):
                w[i] *= scale
            take_in(big, w, 1.0 / d, g, at, count + 1, n)
            continue
        for i in range(n):
            g[i] = scale * w[i]
        take_outer(big, g, w, n)
    for i in range(n):                                        # below the diagonal of q
        for k in range(i):
            q[i * NMAX + k] = 0.0


cdef inline void smooth_output(double* x, double* p, const double* y, const double* big, int n) noexcept nogil:
    """x and P (n x n, packed) of the filter become those of the smoother: see the kernel's head."""
    cdef int i, j, k
    cdef double acc, least
    cdef double low[NMAX * NMAX]                              # P = L L'
    cdef double a[NMAX * NMAX]
    cdef double w[NMAX * NMAX]
    for j in range(n):
        acc = p[j * n + j]
        least = 1e-15 * acc                                   # below it is rounding, and the state is known
        for k in range(j):
            acc -= low[j * NMAX + k] * low[j * NMAX + k]
        if not acc > least:
            for i in range(j, n):
                low[i * NMAX + j] = 0.0
            continue
        low[j * NMAX + j] = sqrt(acc)
        acc = 1.0 / low[j * NMAX + j]
        for i in range(j + 1, n):
            low[i * NMAX + j] = p[i * n + j]
            for k in range(j):
                low[i * NMAX + j] -= low[i * NMAX + k] * low[j * NMAX + k]
            low[i * NMAX + j] *= acc
    for i in range(n):                                        # Y L
        for j in range(n):
            w[i * NMAX + j] = 0.0
        for k in range(n):
            for j in range(k + 1):
                w[i * NMAX + j] += big[i * NMAX + k] * low[k * NMAX + j]
    for i in range(n):                                        # the lower half of I + L' Y L
        for j in range(i + 1):
            a[i * NMAX + j] = 1.0 if i == j else 0.0
    for k in range(n):
        for i in range(k + 1):
            acc = low[k * NMAX + i]
            for j in range(i + 1):
                a[i * NMAX + j] += acc * w[k * NMAX + j]
    for i in range(n):                                        # w <- L'
        for j in range(n):
            w[i * NMAX + j] = low[j * NMAX + i] if i <= j else 0.0
    for j in range(n):                                        # a = C C', w <- C^-1 L'
        # Without rounding no pivot is below 1: later measurements take nothing from what is known.
        a[j * NMAX + j] = sqrt(a[j * NMAX + j]) if a[j * NMAX + j] > 1.0 else 1.0
        acc = 1.0 / a[j * NMAX + j]
        for i in range(j + 1, n):
            a[i * NMAX + j] *= acc
        for i in range(j + 1, n):
            for k in range(j + 1, i + 1):
                a[i * NMAX + k] -= a[i * NMAX + j] * a[k * NMAX + j]
        for k in range(n):
            w[j * NMAX + k] *= acc
        for i in range(j + 1, n):
            for k in range(n):
                w[i * NMAX + k] -= a[i * NMAX + j] * w[j * NMAX + k]
    for i in range(n):
        for j in range(n):
            a[i * NMAX + j] = 0.0
    for k in range(n):
        for i in range(n):
            acc = w[k * NMAX + i]
            for j in range(n):
                a[i * NMAX + j] += acc * w[k * NMAX + j]
    for i in range(n):
        acc = 0.0
        for j in range(n):
            p[i * n + j] = a[i * NMAX + j]
            acc += a[i * NMAX + j] * y[j]
        x[i] += acc
