# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""What the estimator does around its filter passes, for a few hundred rows at a time: where NumPy takes longer to begin
than to compute. The plain twins are in tests/unit/estimation/naive_lineup.py.
"""

from libc.math cimport ceil, sqrt


def matching_factor(const double[:] nu2, const double[:] prior, const double[::1] noise, double most, int n_steps,
                    double limit):
    """The factor on the noise at which the innovations are as large as they should be, by bisection of its log.

    Args:
        nu2, prior: (n,): squared innovation and its variance without the measurement's own noise.
        noise: (n,): the measurement's variance.
        most: The factor lies in [1 / most, most].
        n_steps: Of the bisection.
        limit: No squared, normalised innovation counts more than this.
    """
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


def count_steps(const double[::1] update_s, const double[::1] output_s, double start_s, double max_step_s,
                int max_pieces):
    """How many steps `lay_steps` would lay."""
    cdef Py_ssize_t n
    with nogil:
        n = walk(update_s, output_s, start_s, max_step_s, max_pieces, NULL, NULL, NULL)
    return n


def lay_steps(const double[::1] update_s, const double[::1] output_s, double start_s, double max_step_s,
              int max_pieces, double[::1] time_s, int[::1] first, int[::1] out_row):
    """Lay a pass's steps: the start, each time of an update, and each output behind the updates of the same time.

    Gaps are crossed in equal pieces.

    Args:
        update_s, output_s: (n,), (m,): non-decreasing, none before the start.
        start_s: Where the pass begins.
        max_step_s, max_pieces: A gap is divided so that no piece is longer, but into no more pieces than that.
        time_s: (T,): overwritten with the steps' times; T is what `count_steps` says.
        first: (T + 1,): overwritten; the updates of step k are first[k]..first[k + 1] - 1.
        out_row: (T,): overwritten with the output that step k is, or -1.
    """
    with nogil:
        walk(update_s, output_s, start_s, max_step_s, max_pieces, &time_s[0], &first[0], &out_row[0])


cdef Py_ssize_t walk(const double[::1] update_s, const double[::1] output_s, double start_s, double max_step_s,
                     int max_pieces, double* time_s, int* first, int* out_row) noexcept nogil:
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
