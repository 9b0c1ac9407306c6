# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the vehicle-state kernel: the motion model, its Jacobian and its noise."""

from libc.math cimport cos, sin

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


cdef inline void companion(double dt, double rate1, double rate2, double* out) noexcept nogil:
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
    cdef double standing = 0.25 / (v2 + 0.25)             # 1 at rest, 1/2 at half a metre per second
    if standing < 0.02:
        return model[P_RATE_W]
    return model[P_RATE_W] + 3.3 * standing * standing    # within 0.3 s at rest


cdef inline void linearise(const double* x, double dt, double yaw_decay, const double* model, int n, Step* f,
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


cdef inline void propagate(double* x, Step* f, int n) noexcept nogil:
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


cdef inline void times_f(double* p, Step* f, int n, int row, int col) noexcept nogil:
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


cdef inline void times_ft(double* p, Step* f, int n, int row, int col, int count) noexcept nogil:
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


cdef inline void add_noise(double* p, const double* x, double dt, const double* model, const double* q_matrix,
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


cdef inline void flip_sign(double* p, int n) noexcept nogil:
    """p <- T p T with T = diag(-1) at speed, acceleration and jerk."""
    cdef int i, j
    for i in range(n):
        for j in range(n):
            if (i == 2 or i == 4 or i == 6) != (j == 2 or j == 4 or j == 6):
                p[i * NMAX + j] = -p[i * NMAX + j]
