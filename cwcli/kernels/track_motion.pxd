# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the target-tracking kernels: motion models and the prediction.

State (xiang2019 eq. 15, extended): x, y, vx, vy in the tracking frame, then the model's own: turn rate (CTRV) or
ax, ay (CA). Matrices are row-major, packed by their own size.
Both filters go through the same code: a filter is a way to linearise. The extended filter takes Jacobians; the
unscented one takes the statistical linearisation by the sigma points, z = H (x - mean) + z_mean + e with the
covariance of e, which is algebraically the unscented transform (xiang2019 eq. 7-13). Covariances are put together from
their factors, so that they stay symmetric and positive (positive.pxd).
"""
from libc.math cimport cos, fabs, sin, sqrt

from cwcli.kernels.positive cimport add_square, factor, times_lower
from cwcli.kernels.track cimport Model

cdef struct Tuning:
    int model              # track.Model
    int d                  # number of states: 4, 6, 5
    bint unscented
    double main_noise      # density of acceleration noise (CV, CTRV) or of jerk noise (CA), squared
    double turn_noise      # density of turn-rate noise (CTRV), squared
    double speed_variance  # start: of each velocity component
    double extra_variance  # start: of turn rate or acceleration
    double kappa           # sigma-point spread: sqrt(n + kappa) sigma
    double cartesian_below # radar update in Cartesian form when position sigma / range exceeds this; 0 = never
    double gate_nis[4]     # limit of the squared normalised innovation by its number of values; 0 = none
    double max_gap_s       # a longer gap is not bridged
    int restart_after      # so many gated detections in a row make a new start; 0 = never


cdef inline void zero(double* a, int n) noexcept nogil:
    cdef int i
    for i in range(n):
        a[i] = 0.0


cdef inline void turn_terms(double w, double dt, double* s, double* c, double* ds, double* dc) noexcept nogil:
    """s = sin(w dt)/w, c = (1 - cos(w dt))/w and their derivatives by w, safe at w = 0."""
    cdef double a = w * dt
    if fabs(a) < 1e-4:
        s[0] = dt * (1.0 - a * a / 6.0)
        c[0] = dt * a * 0.5
        ds[0] = -dt * dt * a / 3.0
        dc[0] = dt * dt * (0.5 - a * a / 8.0)
    else:
        s[0] = sin(a) / w
        c[0] = (1.0 - cos(a)) / w
        ds[0] = (dt * cos(a) - s[0]) / w
        dc[0] = (dt * sin(a) - c[0]) / w


cdef inline void motion(const Tuning* t, const double* x, double dt, double* out) noexcept nogil:
    cdef double s, c, ds, dc, h
    if t.model == Model.CTRV:
        turn_terms(x[4], dt, &s, &c, &ds, &dc)
        out[0] = x[0] + s * x[2] - c * x[3]
        out[1] = x[1] + c * x[2] + s * x[3]
        out[2] = (1.0 - x[4] * c) * x[2] - x[4] * s * x[3]
        out[3] = x[4] * s * x[2] + (1.0 - x[4] * c) * x[3]
        out[4] = x[4]
        return
    out[0] = x[0] + dt * x[2]
    out[1] = x[1] + dt * x[3]
    out[2] = x[2]
    out[3] = x[3]
    if t.model == Model.CA:
        h = 0.5 * dt * dt
        out[0] += h * x[4]
        out[1] += h * x[5]
        out[2] += dt * x[4]
        out[3] += dt * x[5]
        out[4] = x[4]
        out[5] = x[5]


cdef inline void motion_jacobian(const Tuning* t, const double* x, double dt, double* f) noexcept nogil:
    cdef int i, d = t.d
    cdef double s, c, ds, dc, w, cosa, sina, dcos, dsin
    for i in range(d * d):
        f[i] = 0.0
    for i in range(d):
        f[i * d + i] = 1.0
    if t.model == Model.CTRV:
        w = x[4]
        turn_terms(w, dt, &s, &c, &ds, &dc)
        cosa = 1.0 - w * c
        sina = w * s
        dcos = -c - w * dc
        dsin = s + w * ds
        f[0 * d + 2] = s
        f[0 * d + 3] = -c
        f[0 * d + 4] = ds * x[2] - dc * x[3]
        f[1 * d + 2] = c
        f[1 * d + 3] = s
        f[1 * d + 4] = dc * x[2] + ds * x[3]
        f[2 * d + 2] = cosa
        f[2 * d + 3] = -sina
        f[2 * d + 4] = dcos * x[2] - dsin * x[3]
        f[3 * d + 2] = sina
        f[3 * d + 3] = cosa
        f[3 * d + 4] = dsin * x[2] + dcos * x[3]
        return
    f[0 * d + 2] = dt
    f[1 * d + 3] = dt
    if t.model == Model.CA:
        f[0 * d + 4] = 0.5 * dt * dt
        f[1 * d + 5] = 0.5 * dt * dt
        f[2 * d + 4] = dt
        f[3 * d + 5] = dt


cdef inline void add_process_noise(const Tuning* t, double dt, double* p) noexcept nogil:
    """White acceleration (or jerk) in continuous time, integrated over the step."""
    cdef int d = t.d, k
    cdef double q = t.main_noise, d2 = dt * dt, d3 = d2 * dt
    for k in range(2):
        if t.model == Model.CA:
            p[k * d + k] += q * d3 * d2 / 20.0
            p[k * d + k + 2] += q * d2 * d2 / 8.0
            p[(k + 2) * d + k] += q * d2 * d2 / 8.0
            p[k * d + k + 4] += q * d3 / 6.0
            p[(k + 4) * d + k] += q * d3 / 6.0
            p[(k + 2) * d + k + 2] += q * d3 / 3.0
            p[(k + 2) * d + k + 4] += q * d2 * 0.5
            p[(k + 4) * d + k + 2] += q * d2 * 0.5
            p[(k + 4) * d + k + 4] += q * dt
        else:
            p[k * d + k] += q * d3 / 3.0
            p[k * d + k + 2] += q * d2 * 0.5
            p[(k + 2) * d + k] += q * d2 * 0.5
            p[(k + 2) * d + k + 2] += q * dt
    if t.model == Model.CTRV:
        p[4 * d + 4] += t.turn_noise * dt


cdef inline void predict(const Tuning* t, const double* x, const double* p, double dt,
                         double* xp, double* pp, double* f, double* q) noexcept nogil:
    """State and covariance after `dt`; and what the smoother needs: the (statistical) Jacobian `f`, and the covariance `q`
    of what comes in beside it, the motion's noise and the spread that the line leaves out.

    CV and CA are linear, so both filters take the closed form; the sigma points are for CTRV.
    """
    cdef int i, j, k, d = t.d
    cdef double[36] l
    cdef double[36] fl
    cdef double[36] e
    cdef double[6] at
    cdef double[6] up
    cdef double[6] down
    cdef double[6] centre
    cdef double spread, w, w0, s
    zero(q, d * d)
    if dt == 0.0:
        motion_jacobian(t, x, dt, f)
        for i in range(d):
            xp[i] = x[i]
        for i in range(d * d):
            pp[i] = p[i]
        return
    if factor(p, d, d, l) == 0 and t.model == Model.CTRV and t.unscented:
        spread = sqrt(d + t.kappa)
        w = 0.5 / (d + t.kappa)
        w0 = t.kappa / (d + t.kappa)
        motion(t, x, dt, centre)
        for i in range(d):
            xp[i] = w0 * centre[i]
        for j in range(d):
            for i in range(d):
                at[i] = x[i] + spread * l[i * d + j]
            motion(t, at, dt, up)
            for i in range(d):
                at[i] = x[i] - spread * l[i * d + j]
            motion(t, at, dt, down)
            for i in range(d):
                xp[i] += w * (up[i] + down[i])
                fl[i * d + j] = (up[i] - down[i]) / (2.0 * spread)
                e[i * d + j] = 0.5 * (up[i] + down[i])
        for i in range(d):                                            # f = (f L) L^-1, row by row from the right
            for j in range(d - 1, -1, -1):
                s = fl[i * d + j]
                for k in range(j + 1, d):
                    s -= f[i * d + k] * l[k * d + j]
                f[i * d + j] = s / l[j * d + j]
        for i in range(d):
            for k in range(i + 1):
                s = w0 * (centre[i] - xp[i]) * (centre[k] - xp[k])
                for j in range(d):
                    s += 2.0 * w * (e[i * d + j] - xp[i]) * (e[k * d + j] - xp[k])
                q[i * d + k] = s
                q[k * d + i] = s
    else:
        motion(t, x, dt, xp)
        motion_jacobian(t, x, dt, f)
        times_lower(f, l, d, d, fl)
    add_process_noise(t, dt, q)
    for i in range(d * d):
        pp[i] = q[i]
    add_square(fl, d, d, d, pp)
