# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the target-tracking kernels: sensors, their linearisation, the update and the start.

A measurement depends on the first four states only, so its sigma points are those of x, y, vx, vy whatever the model.
"""
from libc.math cimport M_PI, atan2, cos, floor, log, sin, sqrt

from cwcli.kernels.positive cimport add_square, factor
from cwcli.kernels.track cimport RowKind
from cwcli.kernels.track_motion cimport Tuning, zero


cdef struct Row:
    int kind           # track.RowKind, not NOTHING
    const double* z
    const double* r    # 3 x 3
    const double* origin


cdef struct Innovation:
    int n_values
    double nu[3]
    double nis         # -1 when singular
    double loglik


cdef inline bint is_gated(const Tuning* t, const Innovation* found) noexcept nogil:
    return t.gate_nis[found.n_values] > 0.0 and not found.nis <= t.gate_nis[found.n_values]


cdef inline double wrap(double a) noexcept nogil:
    return a - 2.0 * M_PI * floor((a + M_PI) / (2.0 * M_PI))


cdef inline int radar(const double* x, const double* o, double* z, double* lx, double* ly) noexcept nogil:
    """Range, azimuth, range rate of state x seen from o = (x, y, vx, vy) (xiang2019 eq. 2-4). -1 at range 0."""
    cdef double dx = x[0] - o[0], dy = x[1] - o[1]
    cdef double r = sqrt(dx * dx + dy * dy)
    z[0] = r
    if r < 1e-9:
        z[1] = 0.0
        z[2] = 0.0
        return -1
    lx[0] = dx / r
    ly[0] = dy / r
    z[1] = atan2(dy, dx)
    z[2] = lx[0] * (x[2] - o[2]) + ly[0] * (x[3] - o[3])
    return 0


cdef inline int linearise_radar(const Tuning* t, const double* x, const double* p, const double* o, int m,
                                double* z, double* h, double* omega) noexcept nogil:
    """Expected measurement z (3), its Jacobian h (3 x 4) and the spread omega (3 x 3) that the line leaves out."""
    cdef double[16] l
    cdef double[12] fl
    cdef double[12] mid
    cdef double[6] at
    cdef double[3] centre
    cdef double[3] up
    cdef double[3] down
    cdef double spread, w, w0, s, lx, ly, r, wx, wy
    cdef int i, j, k, bad
    zero(omega, 9)
    bad = radar(x, o, centre, &lx, &ly)
    if not t.unscented or factor(p, 4, t.d, l) != 0:
        if bad:
            return -1
        r = centre[0]
        wx = x[2] - o[2]
        wy = x[3] - o[3]
        zero(h, 12)
        h[0] = lx
        h[1] = ly
        h[4] = -ly / r
        h[5] = lx / r
        h[8] = (wx - centre[2] * lx) / r
        h[9] = (wy - centre[2] * ly) / r
        h[10] = lx
        h[11] = ly
        for i in range(3):
            z[i] = centre[i]
        return 0
    spread = sqrt(4.0 + t.kappa)
    w = 0.5 / (4.0 + t.kappa)
    w0 = t.kappa / (4.0 + t.kappa)
    zero(z, 3)
    for j in range(4):
        for i in range(4):
            at[i] = x[i] + spread * l[i * 4 + j]
        radar(at, o, up, &lx, &ly)
        for i in range(4):
            at[i] = x[i] - spread * l[i * 4 + j]
        radar(at, o, down, &lx, &ly)
        up[1] = wrap(up[1] - centre[1])            # differences to the centre point, so that +-pi does no harm
        down[1] = wrap(down[1] - centre[1])
        up[0] -= centre[0]
        down[0] -= centre[0]
        up[2] -= centre[2]
        down[2] -= centre[2]
        for i in range(m):
            fl[i * 4 + j] = (up[i] - down[i]) / (2.0 * spread)
            mid[i * 4 + j] = 0.5 * (up[i] + down[i])
            z[i] += w * (up[i] + down[i])
    for i in range(m):
        for j in range(3, -1, -1):
            s = fl[i * 4 + j]
            for k in range(j + 1, 4):
                s -= h[i * 4 + k] * l[k * 4 + j]
            h[i * 4 + j] = s / l[j * 4 + j]
    for i in range(m):
        for k in range(i + 1):
            s = w0 * z[i] * z[k]
            for j in range(4):
                s += 2.0 * w * (mid[i * 4 + j] - z[i]) * (mid[k * 4 + j] - z[k])
            omega[i * 3 + k] = s
            omega[k * 3 + i] = s
    for i in range(m):
        z[i] += centre[i]
    return 0


cdef inline bint wants_cartesian(const Tuning* t, const double* x, const double* p, const double* o) noexcept nogil:
    """True when the predicted position is so wide for its range that the bearing is not near a line in it."""
    cdef double dx = x[0] - o[0], dy = x[1] - o[1]
    return p[0] + p[t.d + 1] > t.cartesian_below * t.cartesian_below * (dx * dx + dy * dy) and t.cartesian_below > 0.0


cdef inline int to_cartesian(const double* z, const double* r, const double* o, int m, double cross_speed2,
                             double* zc, double* lx, double* ly, double* rc) noexcept nogil:
    """Radar measurement as x, y (and closing speed along the measured bearing). Returns the rows that are left.

    Below one sigma of range the bearing says nothing: a round position is left.
    """
    cdef double c = cos(z[1]), s = sin(z[1]), rr = r[0], tt = z[0] * z[0] * r[4]
    zero(rc, 9)
    lx[0] = c
    ly[0] = s
    zc[0] = o[0] + z[0] * c
    zc[1] = o[1] + z[0] * s
    if z[0] * z[0] <= rr:
        rc[0] = rr
        rc[4] = rr
        return 2
    rc[0] = c * c * rr + s * s * tt
    rc[1] = c * s * (rr - tt)
    rc[3] = rc[1]
    rc[4] = s * s * rr + c * c * tt
    if m < 3:
        return 2
    zc[2] = z[2] + c * o[2] + s * o[3]
    rc[8] = r[8] + r[4] * cross_speed2
    return 3


cdef inline void correct(const Tuning* t, double* x, double* p, const double* h, const double* r, bint apply,
                         bint gated, Innovation* found) noexcept nogil:
    """Kalman update in Joseph form of the factors, in place; fills in nis and loglik of the innovation.

    h: as many rows of 4 as there are values. r: 3 x 3. Without `apply`, or with `gated` outside the gate, the state stays.
    """
    cdef int i, j, k, b, d = t.d, m = found.n_values
    cdef const double* nu = found.nu
    cdef double[18] pht
    cdef double[18] gain
    cdef double[9] s
    cdef double[9] l
    cdef double[3] y
    cdef double[36] low
    cdef double[18] hl
    cdef double[54] parts
    cdef double v, logdet = 0.0
    for i in range(d):
        for j in range(m):
            pht[i * 3 + j] = (p[i * d] * h[j * 4] + p[i * d + 1] * h[j * 4 + 1]
                              + p[i * d + 2] * h[j * 4 + 2] + p[i * d + 3] * h[j * 4 + 3])
    for i in range(m):
        for j in range(m):
            v = r[i * 3 + j]
            for k in range(4):
                v += h[i * 4 + k] * pht[k * 3 + j]
            s[i * m + j] = v
    found.nis = -1.0
    found.loglik = 0.0
    if factor(s, m, m, l) != 0:
        return
    v = 0.0
    for i in range(m):
        y[i] = nu[i]
        for k in range(i):
            y[i] -= l[i * m + k] * y[k]
        y[i] /= l[i * m + i]
        v += y[i] * y[i]
        logdet += 2.0 * log(l[i * m + i])
    found.nis = v
    found.loglik = -0.5 * (v + logdet + m * 1.8378770664093453)
    if apply and not (gated and is_gated(t, found)):
        for i in range(d):                          # gain = pht S^-1
            for j in range(m):
                y[j] = pht[i * 3 + j]
                for k in range(j):
                    y[j] -= l[j * m + k] * y[k]
                y[j] /= l[j * m + j]
            for j in range(m - 1, -1, -1):
                for k in range(j + 1, m):
                    y[j] -= l[k * m + j] * y[k]
                y[j] /= l[j * m + j]
            for j in range(m):
                gain[i * 3 + j] = y[j]
                x[i] += y[j] * nu[j]
        factor(p, d, d, low)
        factor(r, m, 3, l)
        for i in range(m):
            for j in range(d):
                v = 0.0
                for k in range(j, 4):
                    v += h[i * 4 + k] * low[k * d + j]
                hl[i * d + j] = v
        b = d + m
        for i in range(d):                          # [(I - K H) L, K L_R], L L^T = P, L_R L_R^T = R
            for j in range(d):
                v = low[i * d + j]
                for k in range(m):
                    v -= gain[i * 3 + k] * hl[k * d + j]
                parts[i * b + j] = v
            for j in range(m):
                v = 0.0
                for k in range(j, m):
                    v += gain[i * 3 + k] * l[k * m + j]
                parts[i * b + d + j] = v
        zero(p, d * d)
        add_square(parts, d, b, d, p)               # eq. 14 (corrected)


cdef inline void measure(const Tuning* t, double* x, double* p, const Row* row, bint apply, bint gated,
                         Innovation* found) noexcept nogil:
    """One detection on one state."""
    cdef double[12] h
    cdef double[9] omega
    cdef double[9] noise
    cdef double[3] expected
    cdef double[3] zc
    cdef double lx, ly, cross
    cdef const double* z = row.z
    cdef const double* o = row.origin
    cdef int i, m
    zero(found.nu, 3)
    if row.kind == RowKind.POSITION:
        zero(h, 8)
        h[0] = 1.0
        h[5] = 1.0
        found.nu[0] = z[0] - x[0]
        found.nu[1] = z[1] - x[1]
        found.n_values = 2
        correct(t, x, p, h, row.r, apply, gated, found)
        return
    m = 3 if row.kind == RowKind.RADAR else 2
    if wants_cartesian(t, x, p, o):
        lx = cos(z[1])
        ly = sin(z[1])
        cross = ly * (x[2] - o[2]) - lx * (x[3] - o[3])
        cross = (cross * cross + ly * ly * p[2 * t.d + 2] + lx * lx * p[3 * t.d + 3]
                 - 2.0 * lx * ly * p[2 * t.d + 3])
        m = to_cartesian(z, row.r, o, m, cross, zc, &lx, &ly, noise)
        zero(h, 12)
        h[0] = 1.0
        h[5] = 1.0
        h[10] = lx
        h[11] = ly
        found.nu[0] = zc[0] - x[0]
        found.nu[1] = zc[1] - x[1]
        if m == 3:
            found.nu[2] = zc[2] - lx * x[2] - ly * x[3]
        found.n_values = m
        correct(t, x, p, h, noise, apply, gated, found)
        # density per metre and radian, as below
        found.loglik += log(z[0] if z[0] * z[0] > row.r[0] else sqrt(row.r[0]))
        return
    found.n_values = m
    if linearise_radar(t, x, p, o, m, expected, h, omega) != 0:
        found.nis = -1.0
        found.loglik = 0.0
        return
    for i in range(9):
        noise[i] = row.r[i] + omega[i]
    found.nu[0] = z[0] - expected[0]
    found.nu[1] = wrap(z[1] - expected[1])
    if m == 3:
        found.nu[2] = z[2] - expected[2]
    correct(t, x, p, h, noise, apply, gated, found)


cdef inline void start(const Tuning* t, const Row* row, double* x, double* p) noexcept nogil:
    """First state from one detection (xiang2019 eq. 5, 6): its position, its range rate, else an open velocity."""
    cdef double[9] rc
    cdef double[12] h
    cdef double[3] zc
    cdef Innovation found
    cdef double lx, ly
    cdef const double* z = row.z
    cdef const double* r = row.r
    cdef const double* o = row.origin
    cdef int i, m, d = t.d
    zero(x, d)
    zero(p, d * d)
    p[2 * d + 2] = t.speed_variance
    p[3 * d + 3] = t.speed_variance
    for i in range(4, d):
        p[i * d + i] = t.extra_variance
    if row.kind == RowKind.POSITION:
        x[0] = z[0]
        x[1] = z[1]
        p[0] = r[0]
        p[1] = r[1]
        p[d] = r[3]
        p[d + 1] = r[4]
        return
    m = 3 if row.kind == RowKind.RADAR else 2
    m = to_cartesian(z, r, o, m, t.speed_variance + o[2] * o[2] + o[3] * o[3], zc, &lx, &ly, rc)
    x[0] = zc[0]
    x[1] = zc[1]
    p[0] = rc[0]
    p[1] = rc[1]
    p[d] = rc[3]
    p[d + 1] = rc[4]
    if m == 3:
        zero(h, 12)
        h[2] = lx
        h[3] = ly
        zero(found.nu, 3)
        found.nu[0] = zc[2]
        found.n_values = 1
        rc[0] = rc[8]
        correct(t, x, p, h, rc, True, False, &found)
