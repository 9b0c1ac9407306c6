# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Target-tracking kernels: one target through time, the smoother, and one scan against many tracks.

The GIL is released; nothing is allocated inside a loop. The models and sensors are in `track_motion.pxd` and
`track_sensors.pxd`. The plain NumPy twin is in tests/unit/tracking/tracking_oracle.py.
"""
from libc.math cimport INFINITY, NAN

import numpy as np

from cwcli.kernels.positive cimport add_square, factor, times_lower
from cwcli.kernels.track_motion cimport Tuning, predict
from cwcli.kernels.track_sensors cimport Innovation, Row, is_gated, measure, start


cdef class Filter:
    cdef Tuning tuning

    def __init__(self, Tuning tuning):
        self.tuning = tuning


cdef class Rows:
    cdef const signed char[::1] kind
    cdef const double[:, ::1] z, origin
    cdef const double[:, :, ::1] r

    def __init__(self, *, kind, z, r, origin):
        self.kind, self.z, self.r, self.origin = kind, z, r, origin


cdef inline Row row_at(Rows rows, Py_ssize_t i) noexcept nogil:
    cdef Row row
    row.kind, row.z, row.r, row.origin = rows.kind[i], &rows.z[i, 0], &rows.r[i, 0, 0], &rows.origin[i, 0]
    return row


cdef class Filtered:
    cdef readonly object state, covariance, innovation, nis, n_values, status
    cdef readonly double log_likelihood
    # What the smoother needs: of each row, or of the last one alone.
    cdef double[:, ::1] predicted_state
    cdef double[:, :, ::1] step_noise, jacobian

    def __init__(self, Py_ssize_t n, Py_ssize_t n_kept, int d):
        self.state, self.predicted_state = np.empty((n_kept, d)), np.empty((n_kept, d))
        self.covariance, self.step_noise = np.empty((n_kept, d, d)), np.empty((n_kept, d, d))
        self.jacobian = np.empty((n_kept, d, d))
        self.innovation, self.nis = np.empty((n, 3)), np.empty(n)
        self.n_values, self.status = np.empty(n, np.int8), np.empty(n, np.int8)


def run(Filter filter, const double[::1] dt_s, Rows rows, *, bint smooth):
    cdef Filtered out = Filtered(dt_s.shape[0], dt_s.shape[0], filter.tuning.d)
    filter_rows(&filter.tuning, dt_s, rows, out, True)
    if smooth:
        smooth_rows(out)
    return out


def log_likelihood(Filter filter, const double[::1] dt_s, Rows rows):
    cdef Filtered out = Filtered(dt_s.shape[0], 1, filter.tuning.d)
    filter_rows(&filter.tuning, dt_s, rows, out, False)
    return out.log_likelihood


cdef int filter_rows(const Tuning* t, const double[::1] dt, Rows rows, Filtered out, bint keep) except -1:
    """Filter one target's detections in time order; without `keep` only the last state stays."""
    cdef double[:, ::1] x = out.state, xp = out.predicted_state, innovation = out.innovation
    cdef double[:, :, ::1] p = out.covariance, q = out.step_noise, f = out.jacobian
    cdef double[::1] nis = out.nis
    cdef signed char[::1] n_values = out.n_values, status = out.status
    cdef int n = <int>dt.shape[0], d = t.d, i, j, k, m, n_rejected = 0
    cdef bint started = False
    cdef double xs[6], ps[36], xn[6], pn[36], fn[36], qn[36]
    cdef double total = 0.0
    cdef Row row
    cdef Innovation found
    with nogil:
        for i in range(n):
            row = row_at(rows, i)
            found.n_values = 0
            nis[i] = NAN
            if not started or dt[i] > t.max_gap_s:
                if row.kind == RowKind.NOTHING:
                    started = False                  # a longer gap than is bridged, or nothing to start from yet
                    status[i] = RowStatus.EMPTY
                else:
                    start(t, &row, xs, ps)
                    started = True
                    n_rejected = 0
                    status[i] = RowStatus.STARTED
                for j in range(d):
                    xn[j] = xs[j] if started else NAN
                    for k in range(d):
                        qn[j * d + k] = 0.0
                        fn[j * d + k] = 0.0
            else:
                predict(t, xs, ps, dt[i], xn, pn, fn, qn)
                for j in range(d):
                    xs[j] = xn[j]
                for j in range(d * d):
                    ps[j] = pn[j]
                status[i] = RowStatus.PREDICTED
                if row.kind != RowKind.NOTHING:
                    measure(t, xs, ps, &row, True, True, &found)
                    if found.nis < 0.0:
                        status[i] = RowStatus.SINGULAR
                    else:
                        nis[i] = found.nis
                        total += found.loglik
                        if is_gated(t, &found):
                            status[i] = RowStatus.GATED
                            n_rejected += 1
                            if n_rejected >= t.restart_after > 0:
                                start(t, &row, xs, ps)
                                for j in range(d * d):
                                    fn[j] = 0.0
                                for j in range(d):
                                    xn[j] = xs[j]
                                n_rejected = 0
                                status[i] = RowStatus.STARTED
                        else:
                            status[i] = RowStatus.USED
                            n_rejected = 0
            n_values[i] = found.n_values
            for j in range(3):
                innovation[i, j] = found.nu[j] if found.n_values > j else NAN
            if keep or i == n - 1:
                m = i if keep else 0
                for j in range(d):
                    x[m, j] = xs[j] if started else NAN
                    xp[m, j] = xn[j]
                    for k in range(d):
                        p[m, j, k] = ps[j * d + k] if started else NAN
                        q[m, j, k] = qn[j * d + k]
                        f[m, j, k] = fn[j * d + k]
    out.log_likelihood = total
    return 0


cdef int smooth_rows(Filtered out) except -1:
    """Rauch-Tung-Striebel smoother, in place on state and covariance.

    With the statistical Jacobians of the unscented filter it is the unscented smoother. Rows with f = 0 are starts,
    over which nothing flows back. With the gain G and A = I - G F the covariance is A P A' + G (Q + P_next) G', put
    together from factors, so it stays positive.
    """
    cdef double[:, ::1] x = out.state
    cdef double[:, :, ::1] p = out.covariance
    cdef const double[:, ::1] xp = out.predicted_state
    cdef const double[:, :, ::1] q = out.step_noise, f = out.jacobian
    cdef int n = <int>x.shape[0], d = <int>x.shape[1], i, j, k, b
    cdef double[36] low
    cdef double[36] l
    cdef double[36] g
    cdef double[36] a
    cdef double[36] part
    cdef double[36] s
    cdef double[6] y
    cdef double v
    with nogil:
        for i in range(n - 2, -1, -1):
            if x[i, 0] != x[i, 0] or f[i + 1, 0, 0] == 0.0:
                continue
            factor(&p[i, 0, 0], d, d, low)
            times_lower(&f[i + 1, 0, 0], low, d, d, part)
            for j in range(d):                       # the predicted covariance
                for k in range(d):
                    s[j * d + k] = q[i + 1, j, k]
            add_square(part, d, d, d, s)
            if factor(s, d, d, l) != 0:
                continue
            for j in range(d):                       # row j of P F^T, times the inverse of the predicted covariance
                for k in range(d):
                    v = 0.0
                    for b in range(d):
                        v += p[i, j, b] * f[i + 1, k, b]
                    y[k] = v
                for k in range(d):
                    for b in range(k):
                        y[k] -= l[k * d + b] * y[b]
                    y[k] /= l[k * d + k]
                for k in range(d - 1, -1, -1):
                    for b in range(k + 1, d):
                        y[k] -= l[b * d + k] * y[b]
                    y[k] /= l[k * d + k]
                for k in range(d):
                    g[j * d + k] = y[k]
            for j in range(d):
                v = 0.0
                for k in range(d):
                    v += g[j * d + k] * (x[i + 1, k] - xp[i + 1, k])
                x[i, j] += v
                for k in range(d):
                    v = 1.0 if j == k else 0.0
                    for b in range(d):
                        v -= g[j * d + b] * f[i + 1, b, k]
                    a[j * d + k] = v
            times_lower(a, low, d, d, part)
            for j in range(d * d):
                s[j] = 0.0
            add_square(part, d, d, d, s)
            factor(&q[i + 1, 0, 0], d, d, low)
            times_lower(g, low, d, d, part)
            add_square(part, d, d, d, s)
            factor(&p[i + 1, 0, 0], d, d, low)
            times_lower(g, low, d, d, part)
            add_square(part, d, d, d, s)
            for j in range(d):
                for k in range(d):
                    p[i, j, k] = s[j * d + k]
    return 0


def predict_many(Filter filter, double[:, ::1] x, double[:, :, ::1] p, double dt_s):
    cdef const Tuning* t = &filter.tuning
    cdef int i, j, k, d = t.d
    cdef double xn[6], pn[36], fn[36], qn[36]
    with nogil:
        for i in range(x.shape[0]):
            predict(t, &x[i, 0], &p[i, 0, 0], dt_s, xn, pn, fn, qn)
            for j in range(d):
                x[i, j] = xn[j]
                for k in range(d):
                    p[i, j, k] = pn[j * d + k]


def score_many(Filter filter, double[:, ::1] x, double[:, :, ::1] p, Rows rows, Py_ssize_t first, Py_ssize_t last):
    cdef const Tuning* t = &filter.tuning
    loglik_array = np.empty((x.shape[0], last - first))
    cdef double[:, ::1] loglik = loglik_array
    cdef Py_ssize_t i, j
    cdef double reach, dx, dy
    cdef Row row
    cdef Innovation found
    with nogil:
        for i in range(x.shape[0]):
            for j in range(last - first):
                row = row_at(rows, first + j)
                loglik[i, j] = -INFINITY
                if row.kind == RowKind.POSITION:     # cheap first: a position far outside any gate
                    dx = row.z[0] - x[i, 0]
                    dy = row.z[1] - x[i, 1]
                    reach = t.gate_nis[2] * (p[i, 0, 0] + p[i, 1, 1] + row.r[0] + row.r[4])
                    if t.gate_nis[2] > 0.0 and dx * dx + dy * dy > reach:
                        continue
                measure(t, &x[i, 0], &p[i, 0, 0], &row, False, True, &found)
                if found.nis >= 0.0 and not is_gated(t, &found):
                    loglik[i, j] = found.loglik
    return loglik_array


def update_many(Filter filter, double[:, ::1] x, double[:, :, ::1] p, const long long[::1] track, Rows rows,
                const long long[::1] taken):
    cdef Py_ssize_t i
    cdef Row row
    cdef Innovation found
    with nogil:
        for i in range(track.shape[0]):
            row = row_at(rows, taken[i])
            measure(&filter.tuning, &x[track[i], 0], &p[track[i], 0, 0], &row, True, False, &found)


def start_many(Filter filter, double[:, ::1] x, double[:, :, ::1] p, Rows rows, const long long[::1] taken):
    cdef Py_ssize_t i
    cdef Row row
    with nogil:
        for i in range(taken.shape[0]):
            row = row_at(rows, taken[i])
            start(&filter.tuning, &row, &x[i, 0], &p[i, 0, 0])
