# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the vehicle-state kernel against rounding: Joseph's form, and the information that runs backward."""

from libc.math cimport sqrt

from cwcli.kernels.ekf_motion cimport NMAX


cdef inline void restore(double* p, const double* g, double root, double r, const double* hx, const int* idx, int m,
                         int n) noexcept nogil:
    """After p <- p - g g' with the gain k = g / root: what Joseph's form (1968) has more.

    Exactly, p h' = r k. What rounding made of a large p differs from that by d, which goes out to second order:
    p <- p - d k' - k d' + k (h d) k'.
    """
    cdef int i, j
    cdef double k[NMAX]
    cdef double d[NMAX]
    cdef double inner = 0.0
    for i in range(n):
        k[i] = g[i] / root
        d[i] = -r * k[i]
        for j in range(m):
            d[i] += p[i * NMAX + idx[j]] * hx[j]
    for j in range(m):
        inner += hx[j] * d[idx[j]]
    for i in range(n):
        for j in range(i + 1):
            p[i * NMAX + j] += inner * k[i] * k[j] - (d[i] * k[j] + k[i] * d[j])
            p[j * NMAX + i] = p[i * NMAX + j]


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
        scale = d / (1.0 + d * scale)
        inner *= scale
        for i in range(n):
            y[i] -= inner * w[i]
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
