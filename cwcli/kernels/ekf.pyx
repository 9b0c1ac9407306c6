# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Extended Kalman filter and smoother of one vehicle, over a whole log at once.

State (first 8 of n): x, y, v, heading, a, yaw rate, jerk, yaw acceleration; behind them any number of slowly varying
parameters (sensor biases, latencies) up to n = 16. With n = 6 and a Q matrix the model is song2016's (eq. 2, 6).

Measurements are applied one scalar at a time; a correlated pair is decorrelated first, which equals the joint update.
The smoother is the modified Bryson-Frazier form (Bierman, 1973): it carries the adjoint lambda and its covariance
backward and needs no matrix inverse and no predicted covariance, so only the gain of each update is stored. It gives the
same result as Rauch-Tung-Striebel. The plain NumPy twin is in tests/unit/estimation/naive_ekf.py.
"""

from libc.math cimport M_PI, cos, fabs, log, remainder, sin

# The gate widens with the time since a source was last believed: the model's errors grow over an outage in ways that
# its covariance does not know of, and the first position after a tunnel must not be taken for an outlier.
cdef double GATE_WIDENS_S = 2.0

# A burst of messages that were held back can be long in rows and short in time: a source must stay elsewhere for this
# long before it is believed again. Inertial sensors (kind 4, 5) are believed by rows alone.
cdef double PATIENCE_S = 2.0

# Below about half a metre per second the yaw rate dies away within 0.3 s.
cdef double STANDING_M2 = 0.25
cdef double STANDING_RATE = 3.3

cdef enum:
    NMAX = 16
    NH = 5

# Order of the entries of `model` (see cwcli.estimation.model.ModelParameters).
cdef enum:
    P_RATE_A = 0        # 1/s, decay of the acceleration
    P_RATE_J = 1        # 1/s, decay of the jerk
    P_Q_J = 2           # white noise behind the jerk, (m/s^3)^2/s
    P_RATE_W = 3        # 1/s, decay of the yaw rate
    P_RATE_ALPHA = 4    # 1/s, decay of the yaw acceleration
    P_Q_ALPHA = 5       # white noise behind the yaw acceleration at speed, (rad/s^2)^2/s
    P_V_YAW = 6         # m/s, speed below which a car hardly turns
    P_Q_XY = 7          # m^2/s, side-slip and map error
    P_FLIP = 8          # m/s, reversing faster than this is taken for a heading that is wrong by pi
    P_Q_FLOOR = 9       # part of P_Q_ALPHA left at standstill
    P_Q_HEADING = 10    # rad^2/s, side-slip and roll: what the gyroscope does not see of the course
    P_COUNT = 11


cdef struct Step:
    double dt
    double c
    double s
    double ds
    double xv
    double xa
    double xj
    double pw
    double pal
    double f_va
    double f_vj
    double f_aa
    double f_aj
    double f_ja
    double f_jj
    double f_pw
    double f_pal
    double f_ww
    double f_wal
    double f_alw
    double f_alal


cdef void companion(double dt, double rate1, double rate2, double* out) noexcept nogil:
    """Transition of (integral, value, rate of change) of a value with poles -rate1 and -rate2, by Taylor series."""
    # value'' = -b value - c value'; the coefficients of the series follow a two-term recursion.
    cdef double b = rate1 * rate2
    cdef double c = rate1 + rate2
    cdef double u0 = 1.0, d0 = 0.0      # derivative k of the value from (value = 1, rate = 0), times dt^k / k!
    cdef double u1 = 0.0, d1 = 1.0      # the same from (value = 0, rate = 1)
    cdef double g = 1.0
    cdef double va = 0.0, vj = 0.0, aa = 0.0, aj = 0.0, ja = 0.0, jj = 0.0
    cdef double nu0, nu1
    cdef int k
    for k in range(9):
        aa += u0 * g
        aj += u1 * g
        ja += d0 * g
        jj += d1 * g
        va += u0 * g * dt / (k + 1)
        vj += u1 * g * dt / (k + 1)
        g *= dt / (k + 1)
        nu0 = -b * u0 - c * d0
        u0 = d0
        d0 = nu0
        nu1 = -b * u1 - c * d1
        u1 = d1
        d1 = nu1
    out[0] = va
    out[1] = vj
    out[2] = aa
    out[3] = aj
    out[4] = ja
    out[5] = jj


cdef inline double decay_of_yaw_rate(double v2, const double* model) noexcept nogil:
    """A car that stands does not turn: its yaw rate dies away. v2 is the expected square of the speed."""
    cdef double standing = STANDING_M2 / (v2 + STANDING_M2)
    if standing < 0.02:
        return model[P_RATE_W]
    return model[P_RATE_W] + STANDING_RATE * standing * standing


cdef void linearise(const double* x, double dt, double yaw_decay, const double* model, int n, Step* f,
                    double* cached) noexcept nogil:
    """Fill the transition over dt about x. `cached` keeps the linear part of the last dt (14 numbers)."""
    cdef double heading
    f.dt = dt
    if n == 6:                                            # song2016, eq. 2 and 6
        heading = x[3]
        f.ds = x[2] * dt + 0.5 * x[4] * dt * dt
        f.c = cos(heading)
        f.s = sin(heading)
        f.xv = dt
        f.xa = 0.5 * dt * dt
        f.xj = 0.0
        f.pw = 0.0
        f.pal = 0.0
        return
    if cached[0] != dt:
        companion(dt, model[P_RATE_A], model[P_RATE_J], cached + 1)
        cached[0] = dt
        cached[13] = -1.0
    if cached[13] != yaw_decay:
        companion(dt, yaw_decay, model[P_RATE_ALPHA], cached + 7)
        cached[13] = yaw_decay
    f.f_va = cached[1]
    f.f_vj = cached[2]
    f.f_aa = cached[3]
    f.f_aj = cached[4]
    f.f_ja = cached[5]
    f.f_jj = cached[6]
    f.f_pw = cached[7]
    f.f_pal = cached[8]
    f.f_ww = cached[9]
    f.f_wal = cached[10]
    f.f_alw = cached[11]
    f.f_alal = cached[12]
    # Distance along the mean heading of the step.
    f.xv = dt
    f.xa = 0.5 * dt * dt
    f.xj = dt * dt * dt / 6.0
    f.pw = 0.5 * dt
    f.pal = dt * dt / 6.0
    heading = x[3] + f.pw * x[5] + f.pal * x[7]
    f.ds = f.xv * x[2] + f.xa * x[4] + f.xj * x[6]
    f.c = cos(heading)
    f.s = sin(heading)


cdef void propagate(double* x, Step* f, int n) noexcept nogil:
    cdef double a, w
    x[0] += f.ds * f.c
    x[1] += f.ds * f.s
    if n == 6:
        x[2] += x[4] * f.dt
        x[3] += x[5] * f.dt
        return
    a = x[4]
    w = x[5]
    x[2] += f.f_va * a + f.f_vj * x[6]
    x[3] += f.f_pw * w + f.f_pal * x[7]
    x[4] = f.f_aa * a + f.f_aj * x[6]
    x[6] = f.f_ja * a + f.f_jj * x[6]
    x[5] = f.f_ww * w + f.f_wal * x[7]
    x[7] = f.f_alw * w + f.f_alal * x[7]


cdef void times_f(double* p, Step* f, int n, int row, int col) noexcept nogil:
    """p <- F p along the axis with stride `row`; `col` is the stride of the other axis."""
    cdef int i
    cdef double v, h, a, w, j, al, ds, w_h
    cdef double* q
    for i in range(n):
        q = p + i * col
        v = q[2 * row]
        h = q[3 * row]
        a = q[4 * row]
        w = q[5 * row]
        if n == 6:
            ds = f.xv * v + f.xa * a
            q[0] += f.c * ds - f.s * f.ds * h
            q[row] += f.s * ds + f.c * f.ds * h
            q[2 * row] = v + f.dt * a
            q[3 * row] = h + f.dt * w
        else:
            j = q[6 * row]
            al = q[7 * row]
            ds = f.xv * v + f.xa * a + f.xj * j
            w_h = f.ds * (h + f.pw * w + f.pal * al)
            q[0] += f.c * ds - f.s * w_h
            q[row] += f.s * ds + f.c * w_h
            q[2 * row] = v + f.f_va * a + f.f_vj * j
            q[3 * row] = h + f.f_pw * w + f.f_pal * al
            q[4 * row] = f.f_aa * a + f.f_aj * j
            q[6 * row] = f.f_ja * a + f.f_jj * j
            q[5 * row] = f.f_ww * w + f.f_wal * al
            q[7 * row] = f.f_alw * w + f.f_alal * al


cdef void times_ft(double* p, Step* f, int n, int row, int col, int count) noexcept nogil:
    """p <- F' p along the axis with stride `row`, for `count` vectors `col` apart."""
    cdef int i
    cdef double x, y, v, h, a, w, j, al, ds, w_h
    cdef double* q
    for i in range(count):
        q = p + i * col
        x = q[0]
        y = q[row]
        v = q[2 * row]
        h = q[3 * row]
        a = q[4 * row]
        w = q[5 * row]
        ds = f.c * x + f.s * y
        w_h = f.ds * (f.c * y - f.s * x)
        q[2 * row] = v + f.xv * ds
        q[3 * row] = h + w_h
        if n == 6:
            q[4 * row] = a + f.dt * v + f.xa * ds
            q[5 * row] = w + f.dt * h
        else:
            j = q[6 * row]
            al = q[7 * row]
            q[4 * row] = f.xa * ds + f.f_va * v + f.f_aa * a + f.f_ja * j
            q[6 * row] = f.xj * ds + f.f_vj * v + f.f_aj * a + f.f_jj * j
            q[5 * row] = f.pw * w_h + f.f_pw * h + f.f_ww * w + f.f_alw * al
            q[7 * row] = f.pal * w_h + f.f_pal * h + f.f_wal * w + f.f_alal * al


cdef inline void add_sym(double* p, int i, int j, double v) noexcept nogil:
    p[i * NMAX + j] += v
    if i != j:
        p[j * NMAX + i] += v


cdef void add_noise(double* p, const double* x, double dt, const double* model, const double* q_matrix,
                    const double* q_walk, int n) noexcept nogil:
    """Continuous white noise behind jerk and yaw acceleration, random walks for the parameters."""
    cdef int i, j
    cdef double q, v2, v0, t2 = dt * dt, t3 = t2 * dt, t4 = t3 * dt, t5 = t4 * dt
    if n == 6:
        for i in range(6):
            for j in range(6):
                p[i * NMAX + j] += q_matrix[i * 6 + j]
        return
    q = model[P_Q_J]
    add_sym(p, 2, 2, q * t5 / 20)
    add_sym(p, 2, 4, q * t4 / 8)
    add_sym(p, 2, 6, q * t3 / 6)
    add_sym(p, 4, 4, q * t3 / 3)
    add_sym(p, 4, 6, q * t2 / 2)
    add_sym(p, 6, 6, q * dt)
    v2 = x[2] * x[2] + p[2 * NMAX + 2]
    v0 = model[P_V_YAW]
    q = v2 / (v2 + v0 * v0)
    if q < model[P_Q_FLOOR]:
        q = model[P_Q_FLOOR]
    q *= model[P_Q_ALPHA]
    add_sym(p, 3, 3, q * t5 / 20)
    add_sym(p, 3, 5, q * t4 / 8)
    add_sym(p, 3, 7, q * t3 / 6)
    add_sym(p, 5, 5, q * t3 / 3)
    add_sym(p, 5, 7, q * t2 / 2)
    add_sym(p, 7, 7, q * dt)
    q = dt * v2 / (v2 + v0 * v0)
    add_sym(p, 3, 3, q * model[P_Q_HEADING])
    q *= model[P_Q_XY]
    add_sym(p, 0, 0, q)
    add_sym(p, 1, 1, q)
    for i in range(8, n):
        p[i * NMAX + i] += q_walk[i] * dt


cdef int expect(const double* x, int kind, int bias, int lag, double* h, double* hx, int* idx) noexcept nogil:
    """Expected measurement h (1 or 2), its Jacobian hx (2 x NH) at the state indices idx. Returns the width.

    A latency state tau is the part of the latency that the stamps do not correct yet: z = h(x(t - tau)) to first order.
    Unused slots have the value 0 at index 0.
    """
    cdef double c, s, u, th, tau = 0.0
    cdef int i
    for i in range(2 * NH):
        hx[i] = 0.0
    for i in range(NH):
        idx[i] = 0
    if lag >= 0:
        tau = x[lag]
    if kind == 0:                                         # position
        c = cos(x[3])
        s = sin(x[3])
        idx[1] = 1
        idx[2] = 2
        idx[3] = 3
        hx[0] = 1.0
        hx[NH + 1] = 1.0
        h[0] = x[0]
        h[1] = x[1]
        if lag >= 0:
            u = x[2]
            idx[4] = lag
            h[0] -= tau * u * c
            h[1] -= tau * u * s
            hx[2] = -tau * c
            hx[NH + 2] = -tau * s
            hx[3] = tau * u * s
            hx[NH + 3] = -tau * u * c
            hx[4] = -u * c
            hx[NH + 4] = -u * s
        return 2
    if kind == 1:                                         # velocity over ground
        u = x[2] - tau * x[4]
        th = x[3] - tau * x[5]
        c = cos(th)
        s = sin(th)
        h[0] = u * c
        h[1] = u * s
        idx[0] = 2
        idx[1] = 3
        hx[0] = c
        hx[NH] = s
        hx[1] = -u * s
        hx[NH + 1] = u * c
        if lag >= 0:
            idx[2] = 4
            idx[3] = 5
            idx[4] = lag
            hx[2] = -tau * c
            hx[NH + 2] = -tau * s
            hx[3] = tau * u * s
            hx[NH + 3] = -tau * u * c
            hx[4] = -x[4] * c + u * x[5] * s
            hx[NH + 4] = -x[4] * s - u * x[5] * c
        return 2
    # Scalars: state i with the rate of change in state r.
    cdef int r = -1
    i = 2
    if kind == 2:
        i = 2
        r = 4
    elif kind == 3:
        i = 3
        r = 5
    elif kind == 4:
        i = 4
        r = 6
    else:
        i = 5
        r = 7
    idx[0] = i
    hx[0] = 1.0
    h[0] = x[i]
    if bias >= 0:
        idx[1] = bias
        hx[1] = 1.0
        h[0] += x[bias]
    if lag >= 0:
        idx[2] = r
        idx[3] = lag
        hx[2] = -tau
        hx[3] = -x[r]
        h[0] -= tau * x[r]
    return 1


cdef void inflate(double* x, double* p, int kind, const double* nu, int n) noexcept nogil:
    """Give up what contradicts a source that was rejected too often: widen what it measures."""
    if kind == 0:
        add_sym(p, 0, 0, nu[0] * nu[0] + nu[1] * nu[1] + 1.0)
        add_sym(p, 1, 1, nu[0] * nu[0] + nu[1] * nu[1] + 1.0)
        add_sym(p, 2, 2, 25.0)
        add_sym(p, 3, 3, 1.0)
    elif kind == 1:
        add_sym(p, 2, 2, nu[0] * nu[0] + nu[1] * nu[1] + 1.0)
        add_sym(p, 3, 3, 1.0)
    elif kind == 2:
        add_sym(p, 2, 2, nu[0] * nu[0] + 1.0)
    elif kind == 3:
        add_sym(p, 3, 3, nu[0] * nu[0] + 0.01)
    elif kind == 4:
        add_sym(p, 4, 4, nu[0] * nu[0])
        if n > 6:
            add_sym(p, 6, 6, 25.0)
    else:
        add_sym(p, 5, 5, nu[0] * nu[0])
        if n > 6:
            add_sym(p, 7, 7, 1.0)


def forward(const double[::1] time_s, const int[::1] first, const int[::1] out_row,
            const int[::1] series, const double[:, ::1] z, const double[:, ::1] r,
            const int[::1] kind, const int[::1] bias, const int[::1] lag, const double[::1] gate, const int[::1] reset_after,
            const double[::1] model, const double[:, ::1] q_matrix, const double[::1] q_walk,
            double[::1] x, double[:, ::1] p,
            double[:, ::1] x_post, signed char[::1] flip, double[::1] yaw_decay, double[:, ::1] gain, double[:, ::1] partials,
            double[:, ::1] innovation, signed char[::1] status, double[:, ::1] nis,
            double[:, ::1] out_x, double[:, :, ::1] out_p, int[::1] streak, double[::1] believed):
    """Run the filter over all steps.

    Shapes: T steps, U updates, S series, m output rows, n states.

    Args:
        time_s: (T,), increasing.
        first: (T + 1,): the updates of step k are first[k]..first[k + 1] - 1.
        out_row: (T,): row of the output that step k fills, or -1.
        series: (U,): index into the S arrays.
        z, r: (U, 2) values and (U, 3) noise (r00, r01, r11).
        kind, bias, lag: (S,): see `expect`; -1 = none.
        gate: (S,): chi-square limit; <= 0 switches the gate off.
        reset_after: (S,): rejections in a row after which a source is believed.
        model: (11,), q_matrix: (6, 6) for n = 6, q_walk: (n,).
        x, p: (n,), (n, n): state at time_s[0]; overwritten with the last one.
        x_post: (T, n) or (0, 0) when nothing is stored for `backward`. flip, yaw_decay: (T,).
        gain: (2 U, n), partials: (2 U, 5), innovation: (2 U, 2) as (nu / S, 1 / S): or (0, 0).
        status: (U,): 0 gated, 1 used, 2 used after a reset.
        nis: (U, 3): squared normalised innovation, mean nu^2 over the axes, mean h P h' over the axes.
        out_x, out_p: (m, n), (m, n, n): the filter's state at the output rows.
        streak, believed: (S,): rejections in a row so far (zeros) and time of the last used one (time_s[0]).

    Returns:
        Log-likelihood of the used innovations.
    """
    cdef int n = x.shape[0], n_steps = time_s.shape[0]
    cdef bint keep = x_post.shape[0] > 0
    cdef double total = 0.0
    with nogil:
        total = forward_c(&time_s[0], n_steps, &first[0], &out_row[0],
                          &series[0] if series.shape[0] else NULL, &z[0, 0] if series.shape[0] else NULL,
                          &r[0, 0] if series.shape[0] else NULL,
                          &kind[0], &bias[0], &lag[0], &gate[0], &reset_after[0], &model[0], &q_matrix[0, 0], &q_walk[0],
                          &x[0], &p[0, 0], n, keep, &x_post[0, 0] if keep else NULL, &flip[0] if keep else NULL,
                          &yaw_decay[0] if keep else NULL,
                          &gain[0, 0] if gain.shape[0] else NULL, &partials[0, 0] if partials.shape[0] else NULL,
                          &innovation[0, 0] if innovation.shape[0] else NULL,
                          &status[0] if series.shape[0] else NULL, &nis[0, 0] if series.shape[0] else NULL,
                          &out_x[0, 0] if out_x.shape[0] else NULL, &out_p[0, 0, 0] if out_p.shape[0] else NULL,
                          &streak[0], &believed[0])
    return total


cdef double forward_c(const double* time_s, int n_steps, const int* first, const int* out_row,
                      const int* series, const double* z, const double* r,
                      const int* kind, const int* bias, const int* lag, const double* gate, const int* reset_after,
                      const double* model, const double* q_matrix, const double* q_walk,
                      double* x_io, double* p_io, int n, bint keep, double* x_post, signed char* flip,
                      double* yaw_decay, double* gain, double* partials, double* innovation, signed char* status, double* nis,
                      double* out_x, double* out_p, int* streak, double* believed) noexcept nogil:
    cdef double x[NMAX]
    cdef double p[NMAX * NMAX]
    cdef double cached[14]
    cdef double h[2]
    cdef double nu[2]
    cdef double hx[2 * NH]
    cdef double ph[2 * NMAX]
    cdef double g[NMAX]
    cdef int idx[NH]
    cdef Step f
    cdef int i, j, k, u, s, width, axis, row
    cdef double dt, r0, r1, r2, s00, s01, s11, det, d2, corr, var, inv, acc, quiet, decay, total = 0.0
    cached[0] = -1.0
    for i in range(NMAX * NMAX):
        p[i] = 0.0
    for i in range(n):
        x[i] = x_io[i]
        for j in range(n):
            p[i * NMAX + j] = p_io[i * n + j]
    for k in range(n_steps):
        if k > 0:
            dt = time_s[k] - time_s[k - 1]
            if dt > 0.0:
                decay = decay_of_yaw_rate(x[2] * x[2] + p[2 * NMAX + 2], model)
                if keep:
                    yaw_decay[k] = decay
                linearise(x, dt, decay, model, n, &f, cached)
                times_f(p, &f, n, NMAX, 1)
                times_f(p, &f, n, 1, NMAX)
                add_noise(p, x, dt, model, q_matrix, q_walk, n)
                propagate(x, &f, n)
                for i in range(n):                        # round-off makes the two products differ in the last bit
                    for j in range(i):
                        p[j * NMAX + i] = p[i * NMAX + j]
        for u in range(first[k], first[k + 1]):
            s = series[u]
            width = expect(x, kind[s], bias[s], lag[s], h, hx, idx)
            for axis in range(width):
                nu[axis] = z[2 * u + axis] - h[axis]
            if kind[s] == 3:
                nu[0] = remainder(nu[0], 2.0 * M_PI)
            r0 = r[3 * u]
            r1 = r[3 * u + 1]
            r2 = r[3 * u + 2]
            for axis in range(width):
                for i in range(n):
                    acc = 0.0
                    for j in range(NH):
                        acc += p[i * NMAX + idx[j]] * hx[axis * NH + j]
                    ph[axis * NMAX + i] = acc
            s00 = 0.0
            for j in range(NH):
                s00 += hx[j] * ph[idx[j]]
            if width == 1:
                nis[3 * u + 1] = nu[0] * nu[0]
                nis[3 * u + 2] = s00
                d2 = nu[0] * nu[0] / (s00 + r0)
            else:
                s01 = 0.0
                s11 = 0.0
                for j in range(NH):
                    s01 += hx[j] * ph[NMAX + idx[j]]
                    s11 += hx[NH + j] * ph[NMAX + idx[j]]
                nis[3 * u + 1] = 0.5 * (nu[0] * nu[0] + nu[1] * nu[1])
                nis[3 * u + 2] = 0.5 * (s00 + s11)
                s00 += r0
                s01 += r1
                s11 += r2
                det = s00 * s11 - s01 * s01
                d2 = (s11 * nu[0] * nu[0] - 2.0 * s01 * nu[0] * nu[1] + s00 * nu[1] * nu[1]) / det
            nis[3 * u] = d2
            quiet = 1.0 + (time_s[k] - believed[s]) / GATE_WIDENS_S
            if gate[s] > 0.0 and not d2 <= gate[s] * quiet * quiet:
                streak[s] += 1
                if streak[s] <= reset_after[s] or (kind[s] < 4 and time_s[k] - believed[s] < PATIENCE_S):
                    status[u] = 0
                    continue
                inflate(x, p, kind[s], nu, n)
                status[u] = 2
            else:
                status[u] = 1
            streak[s] = 0
            believed[s] = time_s[k]
            # Decorrelate the second axis from the first: z1 - corr z0 has noise r11 - corr r01.
            corr = 0.0
            if width == 2 and r1 != 0.0:
                corr = r1 / r0
                nu[1] -= corr * nu[0]
                r2 -= corr * r1
                for j in range(NH):
                    hx[NH + j] -= corr * hx[j]
            for axis in range(width):
                row = 2 * u + axis
                for i in range(n):
                    acc = 0.0
                    for j in range(NH):
                        acc += p[i * NMAX + idx[j]] * hx[axis * NH + j]
                    g[i] = acc
                var = r0 if axis == 0 else r2
                for j in range(NH):
                    var += hx[axis * NH + j] * g[idx[j]]
                inv = 1.0 / var
                acc = nu[axis]
                total -= 0.5 * (log(2.0 * M_PI * var) + acc * acc * inv)
                if keep:
                    for i in range(n):
                        gain[row * n + i] = g[i] * inv
                    for j in range(NH):
                        partials[row * NH + j] = hx[axis * NH + j]
                    innovation[2 * row] = acc * inv
                    innovation[2 * row + 1] = inv
                if axis == 0 and width == 2:              # the second innovation about the state after the first update
                    for j in range(NH):
                        nu[1] -= hx[NH + j] * g[idx[j]] * inv * acc
                for i in range(n):
                    x[i] += g[i] * inv * acc
                    for j in range(n):
                        p[i * NMAX + j] -= g[i] * g[j] * inv
        if keep:
            flip[k] = 0
        if n > 6 and x[2] < -model[P_FLIP] and x[2] * x[2] > 25.0 * p[2 * NMAX + 2]:
            x[2] = -x[2]
            x[4] = -x[4]
            x[6] = -x[6]
            x[3] += M_PI
            flip_sign(p, n)
            if keep:
                flip[k] = 1
        if keep:
            for i in range(n):
                x_post[k * n + i] = x[i]
        row = out_row[k]
        if row >= 0:
            for i in range(n):
                out_x[row * n + i] = x[i]
                for j in range(n):
                    out_p[(row * n + i) * n + j] = p[i * NMAX + j]
    for i in range(n):
        x_io[i] = x[i]
        for j in range(n):
            p_io[i * n + j] = p[i * NMAX + j]
    return total


cdef void flip_sign(double* p, int n) noexcept nogil:
    """p <- T p T with T = diag(-1) at speed, acceleration and jerk."""
    cdef int i, j
    for i in range(n):
        for j in range(n):
            if (i == 2 or i == 4 or i == 6) != (j == 2 or j == 4 or j == 6):
                p[i * NMAX + j] = -p[i * NMAX + j]


def backward(const double[::1] time_s, const int[::1] first, const int[::1] out_row, const int[::1] series,
             const int[::1] kind, const int[::1] bias, const int[::1] lag, const double[::1] model,
             const double[:, ::1] x_post, const signed char[::1] flip, const double[::1] yaw_decay,
             const double[:, ::1] gain,
             const double[:, ::1] partials, const double[:, ::1] innovation, const signed char[::1] status,
             double[:, ::1] out_x, double[:, :, ::1] out_p):
    """Smooth what `forward` stored: out_x and out_p at the output rows become the smoothed state and covariance."""
    cdef int n = x_post.shape[1], n_steps = time_s.shape[0]
    if n_steps == 0 or out_x.shape[0] == 0:
        return
    with nogil:
        backward_c(&time_s[0], n_steps, &first[0], &out_row[0], &series[0] if series.shape[0] else NULL,
                   &kind[0], &bias[0], &lag[0], &model[0], n, &x_post[0, 0], &flip[0], &yaw_decay[0],
                   &gain[0, 0] if gain.shape[0] else NULL, &partials[0, 0] if partials.shape[0] else NULL,
                   &innovation[0, 0] if innovation.shape[0] else NULL, &status[0] if series.shape[0] else NULL,
                   &out_x[0, 0], &out_p[0, 0, 0])


cdef void backward_c(const double* time_s, int n_steps, const int* first, const int* out_row, const int* series,
                     const int* kind, const int* bias, const int* lag, const double* model, int n,
                     const double* x_post, const signed char* flip, const double* yaw_decay, const double* gain, const double* partials,
                     const double* innovation, const signed char* status, double* out_x,
                     double* out_p) noexcept nogil:
    cdef double la[NMAX]
    cdef double big[NMAX * NMAX]
    cdef double w[NMAX]
    cdef double tmp[NMAX * NMAX]
    cdef double cached[14]
    cdef double h[2]
    cdef double hx[2 * NH]
    cdef int idx[NH]
    cdef Step f
    cdef int i, j, l, k, u, s, width, axis, row
    cdef double acc, c, inv, dt
    cdef double* px
    cdef double* pp
    cdef const double* kg
    cdef const double* hv
    cached[0] = -1.0
    for i in range(NMAX):
        la[i] = 0.0
    for i in range(NMAX * NMAX):
        big[i] = 0.0
    for k in range(n_steps - 1, -1, -1):
        row = out_row[k]
        if row >= 0:
            px = out_x + row * n
            pp = out_p + row * n * n
            for i in range(n):                            # P Lambda, and P lambda
                acc = 0.0
                for l in range(n):
                    acc += pp[i * n + l] * la[l]
                px[i] -= acc
                for j in range(n):
                    tmp[i * NMAX + j] = 0.0
                for l in range(n):
                    c = pp[i * n + l]
                    for j in range(n):
                        tmp[i * NMAX + j] += c * big[l * NMAX + j]
            for i in range(n):
                for j in range(n):
                    w[j] = 0.0
                for l in range(n):
                    c = tmp[i * NMAX + l]
                    for j in range(n):
                        w[j] += c * pp[l * n + j]
                for j in range(n):
                    tmp[i * NMAX + j] = w[j]
            for i in range(n):
                for j in range(n):
                    pp[i * n + j] -= 0.5 * (tmp[i * NMAX + j] + tmp[j * NMAX + i])
        if flip[k]:
            flip_sign(big, n)
            la[2] = -la[2]
            la[4] = -la[4]
            la[6] = -la[6]
        for u in range(first[k + 1] - 1, first[k] - 1, -1):
            if status[u] == 0:
                continue
            s = series[u]
            # Only the indices are wanted here; the values were stored.
            width = expect(x_post + k * n, kind[s], bias[s], lag[s], h, hx, idx)
            for axis in range(width - 1, -1, -1):
                kg = gain + (2 * u + axis) * n
                hv = partials + (2 * u + axis) * NH
                inv = innovation[2 * (2 * u + axis) + 1]
                acc = innovation[2 * (2 * u + axis)]
                c = inv
                for i in range(n):
                    acc += kg[i] * la[i]
                    w[i] = 0.0
                for l in range(n):
                    for i in range(n):
                        w[i] += kg[l] * big[l * NMAX + i]
                for i in range(n):
                    c += kg[i] * w[i]
                for j in range(NH):
                    la[idx[j]] -= hv[j] * acc
                for j in range(NH):
                    if hv[j] == 0.0:
                        continue
                    for i in range(n):
                        big[i * NMAX + idx[j]] -= w[i] * hv[j]
                        big[idx[j] * NMAX + i] -= w[i] * hv[j]
                    for l in range(NH):
                        big[idx[j] * NMAX + idx[l]] += c * hv[j] * hv[l]
        if k > 0:
            dt = time_s[k] - time_s[k - 1]
            if dt > 0.0:
                linearise(x_post + (k - 1) * n, dt, yaw_decay[k], model, n, &f, cached)
                times_ft(la, &f, n, 1, 0, 1)
                times_ft(big, &f, n, NMAX, 1, n)
                times_ft(big, &f, n, 1, NMAX, n)
                for i in range(n):
                    for j in range(i):
                        acc = 0.5 * (big[j * NMAX + i] + big[i * NMAX + j])
                        big[j * NMAX + i] = acc
                        big[i * NMAX + j] = acc
