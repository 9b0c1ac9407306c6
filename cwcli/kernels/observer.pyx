# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Observers of lateral speed and yaw rate over a whole log at once.

`blended` is zhang2011's pair of observers with gains computed beforehand (eq. 15, 18, 22). `follow` is one Kalman filter with
the time between events as it is. The plain NumPy twins are in tests/unit/dynamics/naive_observer.py.
"""

from libc.math cimport ceil, fabs, fmax, fmin, isnan, log2, NAN
from libc.string cimport memcpy, memset

cdef enum:
    N = 9               # states of `follow`
    VY = 0              # lateral speed, left positive
    G = 1               # yaw rate
    YL = 2              # lateral deviation at the preview point
    EL = 3              # heading deviation
    STEER = 4           # steering angle
    KL = 5              # road curvature, right positive
    ETA = 6             # nominal mass / mass
    GYRO = 7            # bias of the measured yaw rate
    CAM = 8             # yaw of the camera against its declared mounting

# Order of `model`; see cwcli.dynamics.filter.model_vector.
cdef enum:
    P_SUM = 0           # (k_f + k_r) / m
    P_MOMENT = 1        # (l_r k_r - l_f k_f) / m
    P_FRONT = 2         # k_f / m
    P_MOMENT_I = 3      # (l_r k_r - l_f k_f) / I
    P_DAMP_I = 4        # (l_f^2 k_f + l_r^2 k_r) / I
    P_FRONT_I = 5       # l_f k_f / I
    P_PREVIEW = 6       # from the centre of gravity to the preview point
    P_MIN_SPEED = 7
    P_Q = 8             # 9 noise intensities, in the order of the states; that of K_L per metre
    P_START = 17        # 9 standard deviations at the start; those of y_L and e_L are the measurement's
    P_GATE = 26         # innovations beyond this many sigmas are not believed
    P_STREAK = 27       # so many disbelieved frames in a row restart the filter
    P_WHEELBASE = 28
    P_REAR = 29         # l_r
    P_SLIP = 30         # m l_f / (k_r L)
    P_GRADIENT = 31     # K_mu
    P_MAX_STEP = 32     # longest step of the noise's trapezoidal rule
    P_ETA_LOW = 33
    P_ETA_HIGH = 34
    P_STILL = 35        # speed below which the car's yaw rate and lateral speed are known to be near zero
    P_CAMERA = 36       # from the camera to the preview point: about the camera its yaw turns it
    P_COUNT = 37

cdef enum:
    LANE = 0
    YAW_RATE = 1
    WHEEL = 2

cdef enum:
    IS_NOT_STARTED = 0
    IS_USED = 1
    IS_PREDICTED = 2
    IS_REJECTED = 3
    IS_RESTARTED = 4

KIND_LANE, KIND_YAW_RATE, KIND_STEER = LANE, YAW_RATE, WHEEL
NOT_STARTED, USED, PREDICTED, REJECTED, RESTARTED = IS_NOT_STARTED, IS_USED, IS_PREDICTED, IS_REJECTED, IS_RESTARTED


def blended(
    const int[::1] low,
    const double[::1] weight,
    const signed char[::1] begin,
    const int[::1] periods,
    const double[:, ::1] inputs,
    const double[:, ::1] measured,
    const double[:, :, ::1] phi,
    const double[:, :, ::1] gamma,
    const double[:, :, ::1] gain,
    double[:, ::1] out,
):
    """Run the observers `low[i]` and `low[i] + 1` on frame i and blend them.

    begin: 1 starts anew from the frame's measurement with v_y = gamma = 0; 2 stops: no state until the next 1.
    periods: frame periods since the frame before; all but the last are predicted without correction.
    out: (n, 4), NaN where there is no state.
    """
    cdef Py_ssize_t n = low.shape[0], i
    cdef int p, c, r, which, s
    cdef bint running = False
    cdef double x[4]
    cdef double z[2][4]
    cdef double dy, de, w
    with nogil:
        for i in range(n):
            if begin[i] == 2:
                running = False
            if begin[i] == 1:
                running = True
                x[0] = 0.0
                x[1] = 0.0
                x[2] = measured[i, 0]
                x[3] = measured[i, 1]
            elif running:
                w = weight[i]
                for p in range(periods[i]):
                    for which in range(2):
                        s = low[i] + which
                        for r in range(4):
                            z[which][r] = gamma[s, r, 0] * inputs[i, 0] + gamma[s, r, 1] * inputs[i, 1]
                            for c in range(4):
                                z[which][r] += phi[s, r, c] * x[c]
                        if p == periods[i] - 1:
                            dy = measured[i, 0] - z[which][2]
                            de = measured[i, 1] - z[which][3]
                            if not isnan(dy) and not isnan(de):
                                for r in range(4):
                                    z[which][r] += gain[s, r, 0] * dy + gain[s, r, 1] * de
                    for r in range(4):
                        x[r] = (1.0 - w) * z[0][r] + w * z[1][r]
            for r in range(4):
                out[i, r] = x[r] if running else NAN


cdef void multiply(const double* a, const double* b, double* out) noexcept nogil:
    cdef int i, j, k
    cdef double v
    memset(out, 0, N * N * sizeof(double))
    for i in range(N):
        for k in range(N):
            v = a[i * N + k]
            if v != 0.0:
                for j in range(N):
                    out[i * N + j] += v * b[k * N + j]


cdef void exponential(const double* a, double* out) noexcept nogil:
    """exp(a) by scaling and squaring of the Taylor series of order 12."""
    cdef double work[N * N]
    cdef double scaled[N * N]
    cdef double norm = 0.0, row, factor
    cdef int i, j, k, squarings = 0
    for i in range(N):
        row = 0.0
        for j in range(N):
            row += fabs(a[i * N + j])
        norm = fmax(norm, row)
    if norm > 0.5:
        squarings = <int>ceil(log2(norm / 0.5))
    factor = 1.0
    for k in range(squarings):
        factor *= 0.5
    for i in range(N * N):
        scaled[i] = a[i] * factor
    memset(out, 0, N * N * sizeof(double))
    for i in range(N):
        out[i * N + i] = 1.0
    for k in range(12, 0, -1):
        multiply(scaled, out, work)
        for i in range(N * N):
            out[i] = work[i] / k
        for i in range(N):
            out[i * N + i] += 1.0
    for k in range(squarings):
        multiply(out, out, work)
        memcpy(out, work, N * N * sizeof(double))


cdef void predict(double* x, double* p, double dt, double v, const double* m) noexcept nogil:
    """One step with the speed held. The load's column of the Jacobian is that of the start of the step."""
    cdef double ve = fmax(v, m[P_MIN_SPEED])
    cdef double share = fmax(-1.0, v / ve)
    cdef double eta = x[ETA]
    cdef double a[N * N]
    cdef double f[N * N]
    cdef double work[N * N]
    cdef double moved[N]
    cdef double q[N]
    cdef double force
    cdef int i, j, k
    memset(a, 0, N * N * sizeof(double))
    a[VY * N + VY] = -eta * m[P_SUM] / ve
    a[VY * N + G] = eta * m[P_MOMENT] / ve - ve
    a[VY * N + STEER] = eta * m[P_FRONT] * share
    a[G * N + VY] = m[P_MOMENT_I] / ve
    a[G * N + G] = -m[P_DAMP_I] / ve
    a[G * N + STEER] = m[P_FRONT_I] * share
    a[YL * N + VY] = 1.0
    a[YL * N + G] = m[P_PREVIEW]
    a[YL * N + EL] = v
    a[EL * N + G] = 1.0
    a[EL * N + KL] = v
    # d(dv_y)/d(eta): the tyres' forces by the nominal mass. For the mean eta is part of A, so that column is left out there.
    force = -m[P_SUM] / ve * x[VY] + m[P_MOMENT] / ve * x[G] + m[P_FRONT] * share * x[STEER]
    a[VY * N + ETA] = force
    for i in range(N * N):
        a[i] *= dt
    exponential(a, f)
    for i in range(N):
        moved[i] = 0.0
        for j in range(N):
            if j != ETA or i == ETA:
                moved[i] += f[i * N + j] * x[j]
    for i in range(N):
        x[i] = moved[i]
    for i in range(N):
        q[i] = 0.5 * dt * m[P_Q + i]
    q[KL] *= fabs(v)
    # P = F (P + Q dt/2) F' + Q dt/2
    for i in range(N):
        p[i * N + i] += q[i]
    multiply(f, p, work)
    for i in range(N):
        for j in range(STEER):
            p[i * N + j] = 0.0
            for k in range(N):
                p[i * N + j] += work[i * N + k] * f[j * N + k]
        for j in range(STEER, N):  # these states walk: their rows of F are those of the identity
            p[i * N + j] = work[i * N + j]
    for i in range(N):
        p[i * N + i] += q[i]
        for j in range(i):
            p[i * N + j] = 0.5 * (p[i * N + j] + p[j * N + i])
            p[j * N + i] = p[i * N + j]


cdef int update(double* x, double* p, const double* h, double z, double r, double gate) noexcept nogil:
    """One scalar measurement; 0 if it is not believed (gate > 0)."""
    cdef double ph[N]
    cdef double s = r, innovation = z, gain
    cdef int i, j
    for i in range(N):
        ph[i] = 0.0
        for j in range(N):
            ph[i] += p[i * N + j] * h[j]
    for i in range(N):
        s += h[i] * ph[i]
        innovation -= h[i] * x[i]
    if gate > 0.0 and innovation * innovation > gate * gate * s:
        return 0
    for i in range(N):
        gain = ph[i] / s
        x[i] += gain * innovation
        for j in range(i + 1):
            p[i * N + j] -= gain * ph[j]
            p[j * N + i] = p[i * N + j]
    return 1


cdef void place(double* x, double* p, int state, double lever, double z, double sigma) noexcept nogil:
    """Begin a state anew from z = state + lever * (yaw of the camera) + noise: it is known no better than that yaw."""
    cdef int j
    x[state] = z - lever * x[CAM]
    for j in range(N):
        if j != state:
            p[state * N + j] = -lever * p[CAM * N + j]
            p[j * N + state] = p[state * N + j]
    p[state * N + state] = sigma * sigma - lever * p[state * N + CAM]


cdef void start(double* x, double* p, const double[:, ::1] values, const double[:, ::1] sigmas, Py_ssize_t at, double v,
                const double* m, bint keep) noexcept nogil:
    """The car follows the road steadily, as far as it is known. `keep`: what the log has taught of load and biases stays."""
    cdef double ve = fmax(v, m[P_MIN_SPEED])
    cdef double k = values[at, 2]
    cdef double kept_x[3]
    cdef double kept_p[3]
    cdef int i
    for i in range(3):
        kept_x[i] = x[ETA + i]
        kept_p[i] = p[(ETA + i) * N + ETA + i]
    memset(p, 0, N * N * sizeof(double))
    if isnan(k):
        k = 0.0
    x[G] = -v * k
    x[VY] = (m[P_REAR] - m[P_SLIP] * v * v) * x[G] if v > m[P_MIN_SPEED] else m[P_REAR] * x[G]
    x[STEER] = -(m[P_WHEELBASE] + m[P_GRADIENT] * v * v) * k
    x[KL] = k
    x[ETA] = kept_x[0] if keep else 1.0
    x[GYRO] = kept_x[1] if keep else 0.0
    x[CAM] = kept_x[2] if keep else 0.0
    for i in range(N):
        p[i * N + i] = m[P_START + i] * m[P_START + i]
    if v < m[P_STILL]:
        p[VY * N + VY] *= 1e-4
        p[G * N + G] *= 1e-4
    if not isnan(values[at, 2]):
        p[KL * N + KL] = sigmas[at, 2] * sigmas[at, 2]
    if keep:
        for i in range(3):
            p[(ETA + i) * N + ETA + i] = kept_p[i]
    place(x, p, EL, 1.0, values[at, 1], sigmas[at, 1])
    place(x, p, YL, m[P_CAMERA], values[at, 0], sigmas[at, 0])


def follow(
    const double[::1] dt_s,
    const double[::1] speed,
    const signed char[::1] kind,
    const signed char[::1] begin,
    const double[:, ::1] values,
    const double[:, ::1] sigmas,
    const double[::1] model,
    double[:, ::1] out_x,
    double[:, :, ::1] out_p,
    signed char[::1] status,
):
    """Filter all events in order.

    dt_s: since the event before. speed: over that time. kind: KIND_*. begin: 1 forgets all but load and biases first, 2 has
    no state at this event. values, sigmas: (k, 3): y_L, e_L, K_L, or one number in column 0; NaN for none.
    """
    cdef Py_ssize_t n = dt_s.shape[0], i
    cdef double x[N]
    cdef double p[N * N]
    cdef double h[N]
    cdef double m[P_COUNT]
    cdef bint running = False, ever = False
    cdef int j, k, steps, streak = 0, believed, tried
    cdef double r, gate, step
    memset(x, 0, N * sizeof(double))
    memset(p, 0, N * N * sizeof(double))
    for j in range(P_COUNT):
        m[j] = model[j]
    gate = m[P_GATE]
    with nogil:
        for i in range(n):
            if begin[i] != 0:
                running = False
            if running and dt_s[i] > 0.0:
                steps = <int>ceil(dt_s[i] / m[P_MAX_STEP] - 1e-9)
                steps = 1 if steps < 1 else steps
                step = dt_s[i] / steps
                for k in range(steps):
                    predict(x, p, step, speed[i], m)
            status[i] = IS_PREDICTED if running else IS_NOT_STARTED
            if kind[i] == LANE and begin[i] != 2:
                if not running:
                    if not isnan(values[i, 0]) and not isnan(values[i, 1]):
                        start(x, p, values, sigmas, i, speed[i], m, ever)
                        running = True
                        ever = True
                        streak = 0
                        status[i] = IS_RESTARTED
                else:
                    tried = 0
                    believed = 0
                    for k in range(1, 3):
                        if isnan(values[i, k]):
                            continue
                        memset(h, 0, N * sizeof(double))
                        if k == 1:
                            h[EL] = 1.0
                            h[CAM] = 1.0
                        else:
                            h[KL] = 1.0
                        tried += 1
                        believed += update(x, p, h, values[i, k], sigmas[i, k] * sigmas[i, k], gate)
                    if not isnan(values[i, 0]):
                        memset(h, 0, N * sizeof(double))
                        h[YL] = 1.0
                        h[CAM] = m[P_CAMERA]
                        tried += 1
                        if update(x, p, h, values[i, 0], sigmas[i, 0] * sigmas[i, 0], gate):
                            believed += 1
                        else:
                            # Another lane, or a wrong boundary: its place says nothing of the motion; begin it anew.
                            place(x, p, YL, m[P_CAMERA], values[i, 0], sigmas[i, 0])
                    if tried > 0:
                        status[i] = IS_USED if believed == tried else IS_REJECTED
                        streak = 0 if believed == tried else streak + 1
                        if streak >= m[P_STREAK] and not isnan(values[i, 0]) and not isnan(values[i, 1]):
                            start(x, p, values, sigmas, i, speed[i], m, True)
                            streak = 0
                            status[i] = IS_RESTARTED
            elif running and not isnan(values[i, 0]) and begin[i] != 2:
                memset(h, 0, N * sizeof(double))
                r = sigmas[i, 0] * sigmas[i, 0]
                if kind[i] == YAW_RATE:
                    h[G] = 1.0
                    h[GYRO] = 1.0
                else:
                    h[STEER] = 1.0
                status[i] = IS_USED if update(x, p, h, values[i, 0], r, gate) else IS_REJECTED
            if running:
                x[ETA] = fmin(fmax(x[ETA], m[P_ETA_LOW]), m[P_ETA_HIGH])
                if fabs(speed[i]) < m[P_STILL]:
                    # A car that stands neither slides nor turns.
                    for k in range(2):
                        memset(h, 0, N * sizeof(double))
                        h[k] = 1.0
                        update(x, p, h, 0.0, 1e-6, 0.0)
            for j in range(N):
                out_x[i, j] = x[j] if running else NAN
                for k in range(N):
                    out_p[i, j, k] = p[j * N + k] if running else NAN
