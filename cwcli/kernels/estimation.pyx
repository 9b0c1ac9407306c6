# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""What the estimator does around its filter passes, for a few hundred rows at a time: where NumPy takes longer to begin
than to compute. The plain twins are in tests/unit/estimation/naive_estimation.py.
"""

from libc.math cimport ceil, exp, sqrt

import numpy as np


def matching_factor(const double[:] nu2, const double[:] prior, const double[::1] noise, *, double most, int n_steps,
                    double limit):
    cdef Py_ssize_t n = nu2.shape[0], i
    cdef double low = 1.0 / most, high = most, middle, total, each
    cdef int step
    with nogil:
        for step in range(n_steps):
            middle = sqrt(low * high)
            total = 0.0
            for i in range(n):
                each = nu2[i] / (prior[i] + middle * noise[i])
                total += limit if each > limit else each  # one that is not a number stays it
            if total / n > 1.0:
                low = middle
            else:
                high = middle
    return sqrt(low * high)


def fading_integral(const double[::1] time_s, const double[::1] rate, *, double decay_s, double max_gap_s):
    cdef Py_ssize_t n = time_s.shape[0], i
    cdef double keep, gap
    found = np.zeros(n)
    cdef double[::1] value = found
    with nogil:
        for i in range(1, n):
            gap = time_s[i] - time_s[i - 1]
            keep = exp(-gap / decay_s)
            value[i] = keep * value[i - 1]
            if gap < max_gap_s:
                value[i] += (1.0 - keep) * decay_s * 0.5 * (rate[i - 1] + rate[i])
    return found


def lay_steps(const double[::1] update_s, const double[::1] output_s, *, double start_s, double max_step_s,
              int max_pieces):
    cdef Py_ssize_t n
    cdef double[::1] time_s
    cdef int[::1] first, out_row
    with nogil:
        n = walk(update_s, output_s, start_s, max_step_s, max_pieces, NULL, NULL, NULL)
    found = np.empty(n), np.empty(n + 1, np.int32), np.empty(n, np.int32)
    time_s, first, out_row = found
    with nogil:
        walk(update_s, output_s, start_s, max_step_s, max_pieces, &time_s[0], &first[0], &out_row[0])
    return found


cdef Py_ssize_t walk(const double[::1] update_s, const double[::1] output_s, double start_s, double max_step_s,
                     int max_pieces, double* time_s, int* first, int* out_row) noexcept nogil:
    """Count the steps and, where there is room for them, lay them."""
    cdef Py_ssize_t n = update_s.shape[0], m = output_s.shape[0], i = 0, j = 0, step = 0
    cdef int piece, pieces
    cdef double now = start_s, before = start_s, gap, wanted
    while True:
        gap = now - before
        wanted = ceil(gap / max_step_s - 1e-9)
        pieces = max_pieces if wanted > max_pieces else <int>wanted
        for piece in range(1, pieces):
            if time_s != NULL:
                time_s[step], first[step], out_row[step] = before + piece * (gap / pieces), <int>i, -1
            step += 1
        if step == 0 or (i < n and not update_s[i] > now):
            if time_s != NULL:
                time_s[step], first[step], out_row[step] = now, <int>i, -1
            step += 1
            while i < n and not update_s[i] > now:  # so that it ends, whatever the times are
                i += 1
        while j < m and not output_s[j] > now:
            if time_s != NULL:
                time_s[step], first[step], out_row[step] = now, <int>i, <int>j
            step += 1
            j += 1
        if i == n and j == m:
            break
        before = now
        if i == n or (j < m and output_s[j] < update_s[i]):
            now = output_s[j]
        else:
            now = update_s[i]
    if first != NULL:
        first[step] = <int>n
    return step
