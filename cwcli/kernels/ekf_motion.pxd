# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the vehicle-state kernel: the motion model, its Jacobian and its noise."""

from libc.math cimport M_PI, cos, exp, expm1, fabs, round, sin

from cwcli.kernels.ekf cimport MotionModel

cdef enum:
    NMAX = 24  # states at most
    NH = 8     # states that one measurement depends on at most

# From N_MOTION on stand the slowly varying parameters. SONG2016 has the first six.
cdef enum:
    X = 0
    Y = 1
    SPEED = 2
    HEADING = 3
    ACCEL = 4
    YAW_RATE = 5
    JERK = 6
    YAW_ACCEL = 7
    N_MOTION = 8

cdef struct DampedMotion:
    double accel_rate          # 1/s, decay of the acceleration
    double jerk_rate           # 1/s, decay of the jerk
    double jerk_noise          # white noise behind the jerk, (m/s^3)^2/s
    double yaw_rate_rate       # 1/s, decay of the yaw rate
    double yaw_accel_rate      # 1/s, decay of the yaw acceleration
    double yaw_accel_noise     # white noise behind the yaw acceleration at speed, (rad/s^2)^2/s
    double standstill_speed    # m/s, speed below which a car hardly turns
    double standstill_floor    # part of yaw_accel_noise left at standstill
    double xy_noise            # m^2/s across the heading, side-slip
    double along_share         # of it, along the heading of a moving car
    double heading_noise       # rad^2/s, side-slip and roll: what the gyroscope does not see of the course
    double reverse_speed       # m/s, reversing faster than this is taken for a heading that is wrong by pi


cdef struct Model:
    int kind                   # MotionModel
    int n                      # states
    DampedMotion damped
    double walk_noise[NMAX]    # DAMPED: white noise behind each parameter, variance per second
    double turn_noise[NMAX]    # DAMPED: the same by radian turned
    int n_fading               # DAMPED: parameters that fade to zero (Gauss-Markov); the others walk
    int fading[NMAX]           # their states
    double fade_rate[NMAX]     # 1/s, of each of `fading`
    double step_noise[36]      # SONG2016: Q of a step


cdef struct Step:
    int kind                   # MotionModel
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
    int n_fading
    int fading[NMAX]
    double keep[NMAX]          # what is left of each of `fading` after dt


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


cdef inline double speed_squared(const double* x, const double* p) noexcept nogil:
    """Its expectation."""
    return x[SPEED] * x[SPEED] + p[SPEED * NMAX + SPEED]


cdef inline double yaw_rate_of(const double* x) noexcept nogil:
    return x[YAW_RATE]


cdef inline double decay_of_yaw_rate(double v2, const Model* model) noexcept nogil:
    """A car that stands does not turn: its yaw rate dies away."""
    cdef double standing = 0.25 / (v2 + 0.25)             # 1 at rest, 1/2 at half a metre per second
    if standing < 0.02:
        return model.damped.yaw_rate_rate
    return model.damped.yaw_rate_rate + 3.3 * standing * standing    # within 0.3 s at rest


cdef inline void linearise(const double* x, double dt, double yaw_decay, const Model* model, Step* f,
                    double* cached) noexcept nogil:
    """Fill the transition over dt about x. `cached` keeps the linear part of the last dt (14 numbers)."""
    cdef double heading
    f.kind = model.kind
    f.dt = dt
    if model.kind == MotionModel.SONG2016:                # eq. 2 and 6
        heading = x[HEADING]
        f.ds = x[SPEED] * dt + 0.5 * x[ACCEL] * dt * dt
        f.c = cos(heading)
        f.s = sin(heading)
        f.xv = dt
        f.xa = 0.5 * dt * dt
        f.xj = 0.0
        f.pw = 0.0
        f.pal = 0.0
        f.n_fading = 0
        return
    cdef int i
    if cached[0] != dt:
        f.n_fading = model.n_fading
        for i in range(model.n_fading):
            f.fading[i] = model.fading[i]
            f.keep[i] = exp(-model.fade_rate[i] * dt)
        companion(dt, model.damped.accel_rate, model.damped.jerk_rate, cached + 1)
        cached[0] = dt
        cached[13] = -1.0
    if cached[13] != yaw_decay:
        companion(dt, yaw_decay, model.damped.yaw_accel_rate, cached + 7)
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
    heading = x[HEADING] + f.pw * x[YAW_RATE] + f.pal * x[YAW_ACCEL]
    f.ds = f.xv * x[SPEED] + f.xa * x[ACCEL] + f.xj * x[JERK]
    f.c = cos(heading)
    f.s = sin(heading)


cdef inline void propagate(double* x, const Step* f) noexcept nogil:
    cdef double a, w
    cdef int i
    x[X] += f.ds * f.c
    x[Y] += f.ds * f.s
    if f.kind == MotionModel.SONG2016:
        x[SPEED] += x[ACCEL] * f.dt
        x[HEADING] += x[YAW_RATE] * f.dt
        return
    a = x[ACCEL]
    w = x[YAW_RATE]
    x[SPEED] += f.f_va * a + f.f_vj * x[JERK]
    x[HEADING] += f.f_pw * w + f.f_pal * x[YAW_ACCEL]
    x[ACCEL] = f.f_aa * a + f.f_aj * x[JERK]
    x[JERK] = f.f_ja * a + f.f_jj * x[JERK]
    x[YAW_RATE] = f.f_ww * w + f.f_wal * x[YAW_ACCEL]
    x[YAW_ACCEL] = f.f_alw * w + f.f_alal * x[YAW_ACCEL]
    for i in range(f.n_fading):
        x[f.fading[i]] *= f.keep[i]


cdef inline void times_f(double* p, const Step* f, int n, int row, int col) noexcept nogil:
    """p <- F p along the axis with stride `row`; `col` is the stride of the other axis."""
    cdef int i, k
    cdef double v, h, a, w, j, al, ds, w_h
    cdef double* q
    for i in range(n):
        q = p + i * col
        v = q[SPEED * row]
        h = q[HEADING * row]
        a = q[ACCEL * row]
        w = q[YAW_RATE * row]
        if f.kind == MotionModel.SONG2016:
            ds = f.xv * v + f.xa * a
            q[X * row] += f.c * ds - f.s * f.ds * h
            q[Y * row] += f.s * ds + f.c * f.ds * h
            q[SPEED * row] = v + f.dt * a
            q[HEADING * row] = h + f.dt * w
        else:
            j = q[JERK * row]
            al = q[YAW_ACCEL * row]
            ds = f.xv * v + f.xa * a + f.xj * j
            w_h = f.ds * (h + f.pw * w + f.pal * al)
            q[X * row] += f.c * ds - f.s * w_h
            q[Y * row] += f.s * ds + f.c * w_h
            q[SPEED * row] = v + f.f_va * a + f.f_vj * j
            q[HEADING * row] = h + f.f_pw * w + f.f_pal * al
            q[ACCEL * row] = f.f_aa * a + f.f_aj * j
            q[JERK * row] = f.f_ja * a + f.f_jj * j
            q[YAW_RATE * row] = f.f_ww * w + f.f_wal * al
            q[YAW_ACCEL * row] = f.f_alw * w + f.f_alal * al
            for k in range(f.n_fading):
                q[f.fading[k] * row] *= f.keep[k]


cdef inline void times_ft(double* p, const Step* f, int n, int row, int col, int count) noexcept nogil:
    """p <- F' p along the axis with stride `row`, for `count` vectors `col` apart."""
    cdef int i, k
    cdef double x, y, v, h, a, w, j, al, ds, w_h
    cdef double* q
    for i in range(count):
        q = p + i * col
        x = q[X * row]
        y = q[Y * row]
        v = q[SPEED * row]
        h = q[HEADING * row]
        a = q[ACCEL * row]
        w = q[YAW_RATE * row]
        ds = f.c * x + f.s * y
        w_h = f.ds * (f.c * y - f.s * x)
        q[SPEED * row] = v + f.xv * ds
        q[HEADING * row] = h + w_h
        if f.kind == MotionModel.SONG2016:
            q[ACCEL * row] = a + f.dt * v + f.xa * ds
            q[YAW_RATE * row] = w + f.dt * h
        else:
            j = q[JERK * row]
            al = q[YAW_ACCEL * row]
            q[ACCEL * row] = f.xa * ds + f.f_va * v + f.f_aa * a + f.f_ja * j
            q[JERK * row] = f.xj * ds + f.f_vj * v + f.f_aj * a + f.f_jj * j
            q[YAW_RATE * row] = f.pw * w_h + f.f_pw * h + f.f_ww * w + f.f_alw * al
            q[YAW_ACCEL * row] = f.pal * w_h + f.f_pal * h + f.f_wal * w + f.f_alal * al
            for k in range(f.n_fading):
                q[f.fading[k] * row] *= f.keep[k]


cdef inline void add_sym(double* p, int i, int j, double v) noexcept nogil:
    p[i * NMAX + j] += v
    if i != j:
        p[j * NMAX + i] += v


cdef inline double astray(double v2, const double* p, double untold_s, const Model* model) noexcept nogil:
    """Variance per second, of x and of y, of what a way under an uncertain heading has beside its linear part.

    Of a unit vector whose angle has the variance P, the variance is 1 - exp(-P), of which P exp(-P) is linear in the
    angle. An error of the heading lasts as long as nothing has told it, but no longer than a yaw rate.
    """
    cdef double spread = p[HEADING * NMAX + HEADING], lasts_s = 1.0 / model.damped.yaw_rate_rate
    if model.kind == MotionModel.SONG2016 or spread < 1e-3:
        return 0.0
    return v2 * (1.0 - (1.0 + spread) * exp(-spread)) * (untold_s if untold_s < lasts_s else lasts_s)


cdef inline double pointed(const double* p) noexcept nogil:
    """The expectation of cos 2e, e the error of the heading: how much a noise across it points across it still."""
    return exp(-2.0 * p[HEADING * NMAX + HEADING])


cdef inline void add_noise(double* p, double v2, double lost, double across, double yaw_rate, const Step* f,
                           const Model* model) noexcept nogil:
    """Continuous white noise behind jerk and yaw acceleration, random walks for the parameters.

    v2: `speed_squared`, lost: `astray`, across: `pointed`, yaw_rate: all of before, f: the step.
    """
    cdef int i, j
    cdef double q, v0, along, dt = f.dt, t2 = dt * dt, t3 = t2 * dt, t4 = t3 * dt, t5 = t4 * dt
    if model.kind == MotionModel.SONG2016:
        for i in range(6):
            for j in range(6):
                p[i * NMAX + j] += model.step_noise[i * 6 + j]
        return
    q = model.damped.jerk_noise
    add_sym(p, SPEED, SPEED, q * t5 / 20)
    add_sym(p, SPEED, ACCEL, q * t4 / 8)
    add_sym(p, SPEED, JERK, q * t3 / 6)
    add_sym(p, ACCEL, ACCEL, q * t3 / 3)
    add_sym(p, ACCEL, JERK, q * t2 / 2)
    add_sym(p, JERK, JERK, q * dt)
    v0 = model.damped.standstill_speed
    q = v2 / (v2 + v0 * v0)
    if q < model.damped.standstill_floor:
        q = model.damped.standstill_floor
    q *= model.damped.yaw_accel_noise
    add_sym(p, HEADING, HEADING, q * t5 / 20)
    add_sym(p, HEADING, YAW_RATE, q * t4 / 8)
    add_sym(p, HEADING, YAW_ACCEL, q * t3 / 6)
    add_sym(p, YAW_RATE, YAW_RATE, q * t3 / 3)
    add_sym(p, YAW_RATE, YAW_ACCEL, q * t2 / 2)
    add_sym(p, YAW_ACCEL, YAW_ACCEL, q * dt)
    q = v2 / (v2 + v0 * v0)
    along = 0.5 * q * (1.0 - model.damped.along_share)    # what a moving car's own direction is spared of the slip
    across *= along
    q *= dt
    add_sym(p, HEADING, HEADING, q * model.damped.heading_noise)
    q *= model.damped.xy_noise
    along *= q
    across *= q
    q += dt * lost - along
    add_sym(p, X, X, q - across * (f.c * f.c - f.s * f.s))
    add_sym(p, Y, Y, q + across * (f.c * f.c - f.s * f.s))
    add_sym(p, X, Y, -2.0 * across * f.c * f.s)
    for i in range(N_MOTION, model.n):
        p[i * NMAX + i] += (model.walk_noise[i] + model.turn_noise[i] * fabs(yaw_rate)) * dt
    for j in range(model.n_fading):                       # what fading takes off again: q (1 - exp(-2 dt/T)) T/2 in all
        i = model.fading[j]
        q = 2.0 * model.fade_rate[j]
        p[i * NMAX + i] += model.walk_noise[i] * (-expm1(-q * dt) / q - dt)


cdef inline bint is_reversed(const double* x, const double* p, const Model* model) noexcept nogil:
    """The car seems to reverse so fast that rather its heading is wrong by half a turn."""
    return (model.kind == MotionModel.DAMPED and x[SPEED] < -model.damped.reverse_speed
            and x[SPEED] * x[SPEED] > 25.0 * p[SPEED * NMAX + SPEED])


cdef inline void flip_sign(double* x, double* p, int n) noexcept nogil:
    """x <- T x, p <- T p T with T = diag(-1) at speed, acceleration and jerk."""
    cdef int i, j
    x[SPEED] = -x[SPEED]
    x[ACCEL] = -x[ACCEL]
    x[JERK] = -x[JERK]
    for i in range(n):
        for j in range(n):
            if (i == SPEED or i == ACCEL or i == JERK) != (j == SPEED or j == ACCEL or j == JERK):
                p[i * NMAX + j] = -p[i * NMAX + j]


cdef inline void turn_round(double* x, double* p, int n) noexcept nogil:
    flip_sign(x, p, n)
    x[HEADING] += M_PI


cdef inline void begin_again(double* x, double* p, const double* state, const double* variance, int n) noexcept nogil:
    """Take the motion from elsewhere, and nothing of what was known of it; the parameters stay.

    Of the smoother this moves the states about which it is linear, not what it knows: backward nothing is forgotten.
    """
    cdef double state_heading                             # the whole turn nearest to the one before
    cdef int i, j, n_motion = N_MOTION if n > N_MOTION else n
    for i in range(n_motion):
        for j in range(n):
            p[i * NMAX + j] = 0.0
            p[j * NMAX + i] = 0.0
        p[i * NMAX + i] = variance[i]
    state_heading = state[HEADING] + 2.0 * M_PI * round((x[HEADING] - state[HEADING]) / (2.0 * M_PI))
    for i in range(n_motion):
        x[i] = state[i]
    x[HEADING] = state_heading
