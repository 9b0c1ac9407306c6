# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the vehicle-state kernel: what each kind of sensor is expected to read."""

from libc.math cimport cos, sin

from cwcli.kernels.ekf cimport MotionModel, Sensor
from cwcli.kernels.ekf_motion cimport (
    ACCEL, HEADING, JERK, NH, NMAX, SPEED, X, Y, YAW_ACCEL, YAW_RATE, Model, add_sym
)


cdef inline int count_slots(int sensor, int bias, int lag) noexcept nogil:
    """Number of Jacobian entries that `expect` fills per axis."""
    if sensor == Sensor.POSITION or sensor == Sensor.VELOCITY:
        return NH if lag >= 0 else 2
    if lag >= 0:
        return 4
    return 2 if bias >= 0 else 1


cdef inline int expect(const double* x, int sensor, int bias, int lag, double* h, double* hx, int* idx) noexcept nogil:
    """Expected measurement h (1 or 2), its Jacobian hx (2 x NH) at the state indices idx. Returns the width.

    A latency state tau is the part of the latency that the stamps do not correct yet: z = h(x(t - tau)) to first order.
    `count_slots` says how many slots are in use; the others are not touched.
    """
    cdef double c, s, u, th, tau = 0.0
    cdef int i
    cdef int m = count_slots(sensor, bias, lag)
    for i in range(m):
        hx[i] = 0.0
        hx[NH + i] = 0.0
        idx[i] = 0
    if lag >= 0:
        tau = x[lag]
    if sensor == Sensor.POSITION:
        idx[0] = X
        idx[1] = Y
        hx[0] = 1.0
        hx[NH + 1] = 1.0
        h[0] = x[X]
        h[1] = x[Y]
        if lag >= 0:
            c = cos(x[HEADING])
            s = sin(x[HEADING])
            u = x[SPEED]
            idx[2] = SPEED
            idx[3] = HEADING
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
        if lag >= 0:
            idx[2] = ACCEL
            idx[3] = YAW_RATE
            idx[4] = lag
            hx[2] = -tau * c
            hx[NH + 2] = -tau * s
            hx[3] = tau * u * s
            hx[NH + 3] = -tau * u * c
            hx[4] = -x[ACCEL] * c + u * x[YAW_RATE] * s
            hx[NH + 4] = -x[ACCEL] * s - u * x[YAW_RATE] * c
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


cdef inline void inflate(double* x, double* p, int sensor, const double* nu, const Model* model) noexcept nogil:
    """Give up what contradicts a source that was rejected too often: widen what it measures."""
    if sensor == Sensor.POSITION:
        add_sym(p, X, X, nu[0] * nu[0] + nu[1] * nu[1] + 1.0)
        add_sym(p, Y, Y, nu[0] * nu[0] + nu[1] * nu[1] + 1.0)
        add_sym(p, SPEED, SPEED, 25.0)
        add_sym(p, HEADING, HEADING, 1.0)
    elif sensor == Sensor.VELOCITY:
        add_sym(p, SPEED, SPEED, nu[0] * nu[0] + nu[1] * nu[1] + 1.0)
        add_sym(p, HEADING, HEADING, 1.0)
    elif sensor == Sensor.SPEED:
        add_sym(p, SPEED, SPEED, nu[0] * nu[0] + 1.0)
    elif sensor == Sensor.HEADING:
        add_sym(p, HEADING, HEADING, nu[0] * nu[0] + 0.01)
    elif sensor == Sensor.ACCEL:
        add_sym(p, ACCEL, ACCEL, nu[0] * nu[0])
        if model.kind == MotionModel.DAMPED:
            add_sym(p, JERK, JERK, 25.0)
    else:
        add_sym(p, YAW_RATE, YAW_RATE, nu[0] * nu[0])
        if model.kind == MotionModel.DAMPED:
            add_sym(p, YAW_ACCEL, YAW_ACCEL, 1.0)
