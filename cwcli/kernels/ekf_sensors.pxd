# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the vehicle-state kernel: what each kind of sensor is expected to read."""

from libc.math cimport cos, sin

from cwcli.kernels.ekf cimport MotionModel, Sensor
from cwcli.kernels.ekf_motion cimport (
    ACCEL, HEADING, JERK, NH, NMAX, SPEED, X, Y, YAW_ACCEL, YAW_RATE, Model, add_sym, pointed, speed_squared
)


cdef struct Parameters:
    # The states of a source's parameters, -1 = none. The rows of `SourceTable.parameters` have this order.
    int bias
    int slow       # slow error; of a position's y the next state
    int scale      # minus 1
    int lever      # lever arm, m
    int ahead      # by how much the sensor stands ahead of where it is said to, m
    int latency


cdef struct Place:
    # Where a source stands on the car, m from the estimated point. The rows of `SourceTable.place_m` have this order.
    double ahead
    double left


cdef inline bint tells_heading(int sensor) noexcept nogil:
    return sensor == Sensor.POSITION or sensor == Sensor.VELOCITY or sensor == Sensor.HEADING


cdef inline bint is_apart(const Parameters* own, const Place* at) noexcept nogil:
    """Whether the source stands elsewhere than the estimated point."""
    return own.ahead >= 0 or at.ahead != 0.0 or at.left != 0.0


cdef inline int count_slots(int sensor, const Parameters* own, const Place* at) noexcept nogil:
    """Number of Jacobian entries that `expect` fills per axis."""
    if is_apart(own, at):
        return NH
    if sensor == Sensor.POSITION:
        return 7 if own.latency >= 0 else (4 if own.slow >= 0 else 2)
    if own.latency >= 0:
        return 5
    if sensor == Sensor.VELOCITY:
        return 2
    if own.slow >= 0 or own.lever >= 0:
        return 3
    return 2 if own.bias >= 0 or own.scale >= 0 else 1


cdef inline int expect(const double* x, int sensor, const Parameters* own, const Place* at, double pitch_rate,
                       double* h, double* hx, int* idx) noexcept nogil:
    """Expected measurement h (1 or 2), its Jacobian hx (2 x NH) at the state indices idx. Returns the width.

    A latency state tau is the part of the latency that the stamps do not correct yet: z = h(x(t - tau)) to first order.
    A speed is (1 + scale) (v - lever pitch_rate): of a point that is the lever arm lower than the estimated one, while
    the body turns nose down. A source at (a, b) ahead and to the left of the estimated point p measures there: at the
    position p + R(heading) (a, b), with the velocity that the yaw rate w adds, R(heading) (-w b, w a), and the forward
    acceleration - w^2 a - w' b. `count_slots` says how many slots are in use; the others are not touched.
    """
    cdef double c, s, u, th, k = 1.0, tau = 0.0, ahead = at.ahead, left = at.left
    cdef bint apart = is_apart(own, at)
    cdef int i
    cdef int m = count_slots(sensor, own, at)
    for i in range(m):
        hx[i] = 0.0
        hx[NH + i] = 0.0
        idx[i] = 0
    if own.latency >= 0:
        tau = x[own.latency]
    if own.ahead >= 0:
        ahead += x[own.ahead]
        idx[NH - 1] = own.ahead
    if sensor == Sensor.POSITION:
        idx[0] = X
        idx[1] = Y
        hx[0] = 1.0
        hx[NH + 1] = 1.0
        h[0] = x[X]
        h[1] = x[Y]
        if own.slow >= 0:
            idx[2] = own.slow
            idx[3] = own.slow + 1
            hx[2] = 1.0
            hx[NH + 3] = 1.0
            h[0] += x[own.slow]
            h[1] += x[own.slow + 1]
        if own.latency >= 0:
            c = cos(x[HEADING])
            s = sin(x[HEADING])
            u = x[SPEED]
            idx[4] = SPEED
            idx[5] = HEADING
            idx[6] = own.latency
            h[0] -= tau * u * c
            h[1] -= tau * u * s
            hx[4] = -tau * c
            hx[NH + 4] = -tau * s
            hx[5] = tau * u * s
            hx[NH + 5] = -tau * u * c
            hx[6] = -u * c
            hx[NH + 6] = -u * s
        if apart:
            c = cos(x[HEADING])
            s = sin(x[HEADING])
            idx[5] = HEADING
            h[0] += ahead * c - left * s
            h[1] += ahead * s + left * c
            hx[5] -= ahead * s + left * c
            hx[NH + 5] += ahead * c - left * s
            if own.ahead >= 0:
                hx[NH - 1] = c
                hx[2 * NH - 1] = s
        return 2
    if sensor == Sensor.VELOCITY:                         # over ground
        u = x[SPEED] - tau * x[ACCEL]
        th = x[HEADING] - tau * x[YAW_RATE]
        c = cos(th)
        s = sin(th)
        h[0] = u * c
        h[1] = u * s
        idx[0] = SPEED
        idx[1] = HEADING
        hx[0] = c
        hx[NH] = s
        hx[1] = -u * s
        hx[NH + 1] = u * c
        if own.latency >= 0:
            idx[2] = ACCEL
            idx[3] = YAW_RATE
            idx[4] = own.latency
            hx[2] = -tau * c
            hx[NH + 2] = -tau * s
            hx[3] = tau * u * s
            hx[NH + 3] = -tau * u * c
            hx[4] = -x[ACCEL] * c + u * x[YAW_RATE] * s
            hx[NH + 4] = -x[ACCEL] * s - u * x[YAW_RATE] * c
        if apart:
            c = cos(x[HEADING])
            s = sin(x[HEADING])
            idx[3] = YAW_RATE
            h[0] -= x[YAW_RATE] * (ahead * s + left * c)
            h[1] += x[YAW_RATE] * (ahead * c - left * s)
            hx[1] -= x[YAW_RATE] * (ahead * c - left * s)
            hx[NH + 1] -= x[YAW_RATE] * (ahead * s + left * c)
            hx[3] -= ahead * s + left * c
            hx[NH + 3] += ahead * c - left * s
            if own.ahead >= 0:
                hx[NH - 1] = -x[YAW_RATE] * s
                hx[2 * NH - 1] = x[YAW_RATE] * c
        return 2
    # Scalars: state i with the rate of change in state r.
    cdef int r
    if sensor == Sensor.SPEED:
        i = SPEED
        r = ACCEL
    elif sensor == Sensor.HEADING:
        i = HEADING
        r = YAW_RATE
    elif sensor == Sensor.ACCEL:
        i = ACCEL
        r = JERK
    else:
        i = YAW_RATE
        r = YAW_ACCEL
    u = x[i] - tau * x[r]
    if own.lever >= 0:
        u -= x[own.lever] * pitch_rate
    if apart and sensor == Sensor.SPEED:
        u -= x[YAW_RATE] * left
        idx[5] = YAW_RATE
    elif apart and sensor == Sensor.ACCEL:
        u -= x[YAW_RATE] * x[YAW_RATE] * ahead + x[YAW_ACCEL] * left
        idx[5] = YAW_RATE
        idx[6] = YAW_ACCEL
        hx[5] = -2.0 * x[YAW_RATE] * ahead
        hx[6] = -left
        if own.ahead >= 0:
            hx[NH - 1] = -x[YAW_RATE] * x[YAW_RATE]
    if own.scale >= 0:
        k += x[own.scale]
        idx[1] = own.scale
        hx[1] = u
    if apart and sensor == Sensor.SPEED:
        hx[5] = -k * left
    idx[0] = i
    hx[0] = k
    h[0] = k * u
    if own.bias >= 0:                                     # of a rate, which has no scale
        idx[1] = own.bias
        hx[1] = 1.0
        h[0] += x[own.bias]
    if own.lever >= 0:
        idx[2] = own.lever
        hx[2] = -k * pitch_rate
    if own.slow >= 0:                                     # of anything but a speed
        idx[2] = own.slow
        hx[2] = 1.0
        h[0] += x[own.slow]
    if own.latency >= 0:
        idx[3] = r
        idx[4] = own.latency
        hx[3] = -k * tau
        hx[4] = -k * x[r]
    return 1


cdef inline double add_stamp_noise(const double* x, const double* p, double sigma_s, double* r) noexcept nogil:
    """Add to a position's noise r (r00, r01, r11) that its stamp errs by e: it lies v e away along the way.

    E(v v') sigma^2, with the speed and the heading as they are known beforehand. Returns its mean over the axes.
    """
    cdef double variance = sigma_s * sigma_s * speed_squared(x, p), straight = pointed(p)
    cdef double c = cos(x[HEADING]), s = sin(x[HEADING])
    r[0] += variance * (0.5 * (1.0 - straight) + straight * c * c)
    r[1] += variance * straight * c * s
    r[2] += variance * (0.5 * (1.0 - straight) + straight * s * s)
    return 0.5 * variance


cdef inline double along_excess(const double* x, const double* nu, double s00, double s01, double s11,
                                double det) noexcept nogil:
    """By how much the log-likelihood of an innovation nu with covariance S grows where its variance grows by
    v v' sigma^2, less where it grows by as much across the way: by sigma^2. 0 is expected where both are right.
    """
    cdef double c = cos(x[HEADING]), s = sin(x[HEADING])
    cdef double w0 = (s11 * nu[0] - s01 * nu[1]) / det, w1 = (s00 * nu[1] - s01 * nu[0]) / det
    cdef double along = c * w0 + s * w1, across = c * w1 - s * w0
    along = along * along - (c * c * s11 - 2.0 * c * s * s01 + s * s * s00) / det
    across = across * across - (s * s * s11 + 2.0 * c * s * s01 + c * c * s00) / det
    return 0.5 * x[SPEED] * x[SPEED] * (along - across)


cdef inline void inflate(double* p, int sensor, double nu2, const Model* model) noexcept nogil:
    """Give up what contradicts a source that was rejected too often: widen what it measures.

    `nu2` is the square of its innovation, summed over the axes.
    """
    if sensor == Sensor.POSITION:
        add_sym(p, X, X, nu2 + 1.0)
        add_sym(p, Y, Y, nu2 + 1.0)
        add_sym(p, SPEED, SPEED, 25.0)
        add_sym(p, HEADING, HEADING, 1.0)
    elif sensor == Sensor.VELOCITY:
        add_sym(p, SPEED, SPEED, nu2 + 1.0)
        add_sym(p, HEADING, HEADING, 1.0)
    elif sensor == Sensor.SPEED:
        add_sym(p, SPEED, SPEED, nu2 + 1.0)
    elif sensor == Sensor.HEADING:
        add_sym(p, HEADING, HEADING, nu2 + 0.01)
    elif sensor == Sensor.ACCEL:
        add_sym(p, ACCEL, ACCEL, nu2)
        if model.kind == MotionModel.DAMPED:
            add_sym(p, JERK, JERK, 25.0)
    else:
        add_sym(p, YAW_RATE, YAW_RATE, nu2)
        if model.kind == MotionModel.DAMPED:
            add_sym(p, YAW_ACCEL, YAW_ACCEL, 1.0)
