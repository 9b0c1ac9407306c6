# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Target-tracking kernels: one target through time, the smoother, and one scan against many tracks.

Plain arrays in and out; the GIL is released; nothing is allocated inside a loop. `cwcli.tracking` checks shapes and
documents units. The models and sensors are in `track_motion.pxd` and `track_sensors.pxd`.
"""
from libc.math cimport INFINITY, NAN

from cwcli.kernels.track_motion cimport Tuning, cholesky, congruence, predict
from cwcli.kernels.track_sensors cimport measure, start

cdef enum:
    USED = 0
    GATED = 1
    STARTED = 2
    SINGULAR = 3
    PREDICTED = 4
    EMPTY = 5


cdef Tuning tuning_of(int model, bint unscented, const double[::1] params) noexcept:
    cdef Tuning t
    t.model = model
    t.d = 4 if model == 0 else (6 if model == 1 else 5)
    t.unscented = unscented
    t.q_main = params[0]
    t.q_turn = params[1]
    t.speed_var = params[2]
    t.extra_var = params[3]
    t.kappa = params[4]
    t.convert = params[5]
    return t


def n_states(int model):
    """Number of states of a model: 4 (constant velocity), 6 (constant acceleration), 5 (constant turn rate)."""
    return 4 if model == 0 else (6 if model == 1 else 5)


def filter_one(const double[::1] dt, const signed char[::1] kind, const double[:, ::1] z, const double[:, :, ::1] r,
               const double[:, ::1] origin, int model, bint unscented, const double[::1] params,
               const double[::1] gates, double[:, ::1] x, double[:, :, ::1] p, double[:, ::1] xp,
               double[:, :, ::1] pp, double[:, :, ::1] f, double[:, ::1] innovation, double[::1] nis,
               double[::1] loglik, signed char[::1] rows, signed char[::1] status):
    """Filter one target's detections in time order.

    dt (n,): seconds since the row before. kind (n,): -1 predict only, else see `measure`. z (n, 3), r (n, 3, 3),
    origin (n, 4): the sensor's x, y, vx, vy. params (8,): the six of `Tuning`, the longest gap in s that is bridged,
    and how many rejections in a row make a new start. gates (4,): NIS limit by number of rows, 0 = none.
    The outputs x, p, xp, pp, f have n rows, or one row, which then holds the last state (log-likelihood only).
    Returns the sum of the log-likelihoods.
    """
    cdef Tuning t = tuning_of(model, unscented, params)
    cdef int n = <int>dt.shape[0], d = t.d, i, j, k, m, n_rejected = 0
    cdef bint keep = x.shape[0] == n, started = False
    cdef double[6] xs
    cdef double[36] ps
    cdef double[6] xn
    cdef double[36] pn
    cdef double[36] fn
    cdef double[3] nu
    cdef double total = 0.0, ll, v, max_gap = params[6]
    cdef int max_rejected = <int>params[7]
    with nogil:
        for i in range(n):
            rows[i] = 0
            nis[i] = NAN
            loglik[i] = 0.0
            for j in range(3):
                nu[j] = NAN
            if not started or dt[i] > max_gap:
                if kind[i] < 0:
                    status[i] = PREDICTED if started else EMPTY
                    if started:                      # a longer gap than is bridged, and nothing to start from yet
                        started = False
                        status[i] = EMPTY
                else:
                    start(&t, kind[i], &z[i, 0], &r[i, 0, 0], &origin[i, 0], xs, ps)
                    started = True
                    n_rejected = 0
                    status[i] = STARTED
                for j in range(d):
                    xn[j] = xs[j] if started else NAN
                    for k in range(d):
                        pn[j * d + k] = ps[j * d + k] if started else NAN
                        fn[j * d + k] = 0.0
            else:
                predict(&t, xs, ps, dt[i], xn, pn, fn)
                for j in range(d):
                    xs[j] = xn[j]
                for j in range(d * d):
                    ps[j] = pn[j]
                status[i] = PREDICTED
                if kind[i] >= 0:
                    ll = measure(&t, xs, ps, kind[i], &z[i, 0], &r[i, 0, 0], &origin[i, 0], &gates[0], True,
                                 &v, nu, &m)
                    rows[i] = m
                    if v < 0.0:
                        status[i] = SINGULAR
                    else:
                        nis[i] = v
                        loglik[i] = ll
                        total += ll
                        status[i] = USED
                        if gates[m] > 0.0 and v > gates[m]:
                            status[i] = GATED
                            n_rejected += 1
                            if n_rejected >= max_rejected > 0:
                                start(&t, kind[i], &z[i, 0], &r[i, 0, 0], &origin[i, 0], xs, ps)
                                for j in range(d * d):
                                    fn[j] = 0.0
                                    pn[j] = ps[j]
                                for j in range(d):
                                    xn[j] = xs[j]
                                n_rejected = 0
                                status[i] = STARTED
                        else:
                            n_rejected = 0
            for j in range(3):
                innovation[i, j] = nu[j] if rows[i] > j else NAN
            if keep or i == n - 1:
                m = i if keep else 0
                for j in range(d):
                    x[m, j] = xs[j] if started else NAN
                    xp[m, j] = xn[j]
                    for k in range(d):
                        p[m, j, k] = ps[j * d + k] if started else NAN
                        pp[m, j, k] = pn[j * d + k]
                        f[m, j, k] = fn[j * d + k]
    return total


def smooth_one(double[:, ::1] x, double[:, :, ::1] p, const double[:, ::1] xp, const double[:, :, ::1] pp,
               const double[:, :, ::1] f):
    """Rauch-Tung-Striebel smoother, in place on x (n, d) and p (n, d, d); xp, pp, f from `filter_one`.

    With the statistical Jacobians of the unscented filter it is the unscented smoother. Rows with f = 0 are starts,
    over which nothing flows back. The covariance is summed in Joseph form, so it stays positive.
    """
    cdef int n = <int>x.shape[0], d = <int>x.shape[1], i, j, k, b
    cdef double[36] l
    cdef double[36] g
    cdef double[36] a
    cdef double[36] q
    cdef double[36] s
    cdef double[6] y
    cdef double v
    with nogil:
        for i in range(n - 2, -1, -1):
            if x[i, 0] != x[i, 0] or f[i + 1, 0, 0] == 0.0:
                continue
            if cholesky(&pp[i + 1, 0, 0], d, d, l) != 0:
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
            congruence(&f[i + 1, 0, 0], &p[i, 0, 0], d, q)
            for j in range(d):
                for k in range(d):
                    q[j * d + k] = pp[i + 1, j, k] - q[j * d + k] + p[i + 1, j, k]
            congruence(g, q, d, s)
            congruence(a, &p[i, 0, 0], d, q)
            for j in range(d):
                for k in range(d):
                    p[i, j, k] = q[j * d + k] + s[j * d + k]


def predict_many(double[:, ::1] x, double[:, :, ::1] p, double dt, int model, bint unscented,
                 const double[::1] params):
    """Bring all tracks x (m, d), p (m, d, d) forward by dt seconds, in place."""
    cdef Tuning t = tuning_of(model, unscented, params)
    cdef int i, j, k, d = t.d
    cdef double[6] xn
    cdef double[36] pn
    cdef double[36] fn
    with nogil:
        for i in range(x.shape[0]):
            predict(&t, &x[i, 0], &p[i, 0, 0], dt, xn, pn, fn)
            for j in range(d):
                x[i, j] = xn[j]
                for k in range(d):
                    p[i, j, k] = pn[j * d + k]


def score_many(double[:, ::1] x, double[:, :, ::1] p, const signed char[::1] kind, const double[:, ::1] z,
               const double[:, :, ::1] r, const double[:, ::1] origin, int model, bint unscented,
               const double[::1] params, const double[::1] gates, double[:, ::1] loglik):
    """Log-likelihood of every detection of a scan under every track, (tracks, detections); -inf outside the gate."""
    cdef Tuning t = tuning_of(model, unscented, params)
    cdef Py_ssize_t i, j
    cdef int m
    cdef double v, ll, reach, dx, dy
    cdef double[3] nu
    with nogil:
        for i in range(x.shape[0]):
            for j in range(z.shape[0]):
                loglik[i, j] = -INFINITY
                if kind[j] == 0:                     # cheap first: a position far outside any gate
                    dx = z[j, 0] - x[i, 0]
                    dy = z[j, 1] - x[i, 1]
                    reach = gates[2] * (p[i, 0, 0] + p[i, 1, 1] + r[j, 0, 0] + r[j, 1, 1])
                    if gates[2] > 0.0 and dx * dx + dy * dy > reach:
                        continue
                ll = measure(&t, &x[i, 0], &p[i, 0, 0], kind[j], &z[j, 0], &r[j, 0, 0], &origin[j, 0], &gates[0],
                             False, &v, nu, &m)
                if v >= 0.0 and (gates[m] <= 0.0 or v <= gates[m]):
                    loglik[i, j] = ll


def update_many(double[:, ::1] x, double[:, :, ::1] p, const long long[::1] track, const long long[::1] detection,
                const signed char[::1] kind, const double[:, ::1] z, const double[:, :, ::1] r,
                const double[:, ::1] origin, int model, bint unscented, const double[::1] params,
                const double[::1] no_gates):
    """Update tracks[i] with detections[i] of a scan, in place."""
    cdef Tuning t = tuning_of(model, unscented, params)
    cdef Py_ssize_t i, a, b
    cdef int m
    cdef double v
    cdef double[3] nu
    with nogil:
        for i in range(track.shape[0]):
            a = track[i]
            b = detection[i]
            measure(&t, &x[a, 0], &p[a, 0, 0], kind[b], &z[b, 0], &r[b, 0, 0], &origin[b, 0], &no_gates[0], True,
                    &v, nu, &m)


def start_many(const signed char[::1] kind, const double[:, ::1] z, const double[:, :, ::1] r,
               const double[:, ::1] origin, int model, const double[::1] params, double[:, ::1] x,
               double[:, :, ::1] p):
    """First state of one new track per detection, into x (n, d) and p (n, d, d)."""
    cdef Tuning t = tuning_of(model, False, params)
    cdef Py_ssize_t i
    with nogil:
        for i in range(z.shape[0]):
            start(&t, kind[i], &z[i, 0], &r[i, 0, 0], &origin[i, 0], &x[i, 0], &p[i, 0, 0])
