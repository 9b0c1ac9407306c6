# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the vehicle-state kernel: what each kind of sensor is expected to read."""

from libc.math cimport cos, sin

from cwcli.kernels.ekf_motion cimport NH, NMAX, add_sym


cdef inline int count_slots(int kind, int bias, int lag) noexcept nogil:
    """Number of Jacobian entries that `expect` fills per axis."""
    if kind < 2:
        return NH if lag >= 0 else 2
    if lag >= 0:
        return 4
    return 2 if bias >= 0 else 1


cdef inline int expect(const double* x, int kind, int bias, int lag, double* h, double* hx, int* idx) noexcept nogil:
    """Expected measurement h (1 or 2), its Jacobian hx (2 x NH) at the state indices idx. Returns the width.

    A latency state tau is the part of the latency that the stamps do not correct yet: z = h(x(t - tau)) to first order.
    `count_slots` says how many slots are in use; the others are not touched.
    """
    cdef double c, s, u, th, tau = 0.0
    cdef int i
    cdef int m = count_slots(kind, bias, lag)
    for i in range(m):
        hx[i] = 0.0
        hx[NH + i] = 0.0
        idx[i] = 0
    if lag >= 0:
        tau = x[lag]
    if kind == 0:                                         # position
        idx[1] = 1
        hx[0] = 1.0
        hx[NH + 1] = 1.0
        h[0] = x[0]
        h[1] = x[1]
        if lag >= 0:
            c = cos(x[3])
            s = sin(x[3])
            u = x[2]
            idx[2] = 2
            idx[3] = 3
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


cdef inline void inflate(double* x, double* p, int kind, const double* nu, int n) noexcept nogil:
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
