# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the observer's Kalman filter: the car and the road over a step, one measurement, the start."""

from libc.math cimport ceil, fabs, fmax, isnan, log2, sqrt
from libc.string cimport memcpy, memset

from cwcli.kernels.observer cimport CAM, EL, ETA, G, GYRO, KL, N, STEER, VY, YL
from cwcli.kernels.positive cimport add_square, factor, times_lower

cdef struct Model:
    double side_force       # (k_f + k_r) / m
    double moment_force     # (l_r k_r - l_f k_f) / m
    double front_force      # k_f / m
    double moment           # (l_r k_r - l_f k_f) / I
    double yaw_damping      # (l_f^2 k_f + l_r^2 k_r) / I
    double front_moment     # l_f k_f / I
    double camera_forward_m # of the camera ahead of the centre of gravity
    double wheelbase_m
    double rear_axle_m      # l_r
    double slip             # m l_f / (k_r L)
    double understeer       # K_mu
    double min_speed
    double still_mps        # speed below which the car's yaw rate and lateral speed are known to be near zero
    double max_step_s       # longest step of the noise's trapezoidal rule
    double eta_low
    double eta_high
    double gate_sigmas      # innovations beyond this many sigmas are gated
    int restart_after       # so many gated frames in a row start the filter anew
    double gyro_recent_s    # or the lane alone, if a yaw rate fitted within this time
    double chosen_mps       # roads bend and drivers steer as `walk_noise` tells from this speed on, faster below
    double slowest_mps      # and no faster still below this one
    double walk_noise[9]    # intensities, in the order of the states; that of K_L per metre
    double start_sigma[9]   # at the start; those of y_L and e_L are the measurement's


cdef inline void multiply(const double* a, const double* b, double* out) noexcept nogil:
    cdef int i, j, k
    cdef double v
    memset(out, 0, N * N * sizeof(double))
    for i in range(N):
        for k in range(N):
            v = a[i * N + k]
            if v != 0.0:
                for j in range(N):
                    out[i * N + j] += v * b[k * N + j]


cdef inline void exponential(const double* a, double* out) noexcept nogil:
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


cdef inline void carry(double* p, const double* f) noexcept nogil:
    """P <- F P F', put together from the factor of P, so that it stays positive."""
    cdef double low[N * N]
    cdef double moved[N * N]
    factor(p, N, N, low)
    times_lower(f, low, N, N, moved)
    memset(p, 0, N * N * sizeof(double))
    add_square(moved, N, N, N, p)


cdef inline double quickness(double v, const Model* m) noexcept nogil:
    """How many times as slow as `chosen_mps` the car is: at the same lateral jerk a road's curvature changes in a metre
    by its cube, and a steering angle in a second by its square."""
    return fmax(1.0, m.chosen_mps / fmax(fabs(v), m.slowest_mps))


cdef inline void predict(double* x, double* p, double dt, double v, double preview_m, double change, const Model* m) noexcept nogil:
    """One step with the speed held, K_L changing by `change` in a metre. The load's column of the Jacobian is that of
    the start of the step."""
    cdef double ve = fmax(v, m.min_speed)
    cdef double share = fmax(-1.0, v / ve)
    cdef double eta = x[ETA]
    cdef double a[N * N], f[N * N], moved[N], q[N]
    cdef double force
    cdef int i, j
    memset(a, 0, N * N * sizeof(double))
    a[VY * N + VY] = -eta * m.side_force / ve
    a[VY * N + G] = eta * m.moment_force / ve - ve
    a[VY * N + STEER] = eta * m.front_force * share
    a[G * N + VY] = m.moment / ve
    a[G * N + G] = -m.yaw_damping / ve
    a[G * N + STEER] = m.front_moment * share
    a[YL * N + VY] = 1.0
    a[YL * N + G] = preview_m + m.camera_forward_m
    a[YL * N + EL] = v
    a[EL * N + G] = 1.0
    a[EL * N + KL] = v
    # d(dv_y)/d(eta): the tyres' forces by the nominal mass. For the mean eta is part of A, so that column is left out there.
    force = -m.side_force / ve * x[VY] + m.moment_force / ve * x[G] + m.front_force * share * x[STEER]
    a[VY * N + ETA] = force
    for i in range(N * N):
        a[i] *= dt
    exponential(a, f)
    x[KL] += 0.5 * dt * v * change
    for i in range(N):
        moved[i] = 0.0
        for j in range(N):
            if j != ETA or i == ETA:
                moved[i] += f[i * N + j] * x[j]
    for i in range(N):
        x[i] = moved[i]
    x[KL] += 0.5 * dt * v * change
    for i in range(N):
        q[i] = 0.5 * dt * m.walk_noise[i]
    q[KL] *= fabs(v) * quickness(v, m) ** 6
    q[STEER] *= quickness(v, m) ** 4
    # P = F (P + Q dt/2) F' + Q dt/2
    for i in range(N):
        p[i * N + i] += q[i]
    carry(p, f)
    for i in range(N):
        p[i * N + i] += q[i]


cdef inline void move_along(double* x, double* p, double by_m, double v, double change, const Model* m) noexcept nogil:
    """Move the preview point along the lane; the curvature of the metres between walks, as in driving along them."""
    cdef double f[N * N]
    cdef double noise = 0.5 * fabs(by_m) * m.walk_noise[KL] * quickness(v, m) ** 6
    cdef int i
    memset(f, 0, N * N * sizeof(double))
    for i in range(N):
        f[i * N + i] = 1.0
    f[YL * N + EL] = by_m
    f[YL * N + KL] = 0.5 * by_m * by_m
    f[EL * N + KL] = by_m
    x[YL] += by_m * (x[EL] + by_m * (0.5 * x[KL] + by_m * change / 6.0))
    x[EL] += by_m * (x[KL] + 0.5 * by_m * change)
    x[KL] += by_m * change
    p[KL * N + KL] += noise
    carry(p, f)
    p[KL * N + KL] += noise


cdef inline int update(double* x, double* p, const double* h, double z, double r, double gate) noexcept nogil:
    """One scalar measurement, in Joseph form of the factors; 0 if it is gated (gate > 0)."""
    cdef double ph[N], hl[N], low[N * N], parts[N * (N + 1)]
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
    factor(p, N, N, low)
    for j in range(N):
        hl[j] = 0.0
        for i in range(j, N):
            hl[j] += h[i] * low[i * N + j]
    for i in range(N):                          # [(I - k h') L, k sqrt(r)], L L' = P
        gain = ph[i] / s
        x[i] += gain * innovation
        for j in range(N):
            parts[i * (N + 1) + j] = low[i * N + j] - gain * hl[j]
        parts[i * (N + 1) + N] = gain * sqrt(r)
    memset(p, 0, N * N * sizeof(double))
    add_square(parts, N, N + 1, N, p)
    return 1


cdef inline void place(double* x, double* p, int state, double lever, double z, double sigma) noexcept nogil:
    """Begin a state anew from z = state + lever * (yaw of the camera) + noise: it is known no better than that yaw."""
    cdef int j
    x[state] = z - lever * x[CAM]
    for j in range(N):
        if j != state:
            p[state * N + j] = -lever * p[CAM * N + j]
            p[j * N + state] = p[state * N + j]
    p[state * N + state] = sigma * sigma - lever * p[state * N + CAM]


cdef inline void start(double* x, double* p, const double* values, const double* sigmas, double v, double preview_m, const Model* m, bint keep) noexcept nogil:
    """The car follows the road steadily, as far as it is known. `keep`: what the log has taught of load and biases stays."""
    cdef double ve = fmax(v, m.min_speed)
    cdef double k = values[2]
    cdef double kept_x[3], kept_p[3]
    cdef int i
    for i in range(3):
        kept_x[i] = x[ETA + i]
        kept_p[i] = p[(ETA + i) * N + ETA + i]
    memset(p, 0, N * N * sizeof(double))
    if isnan(k):
        k = 0.0
    x[G] = -v * k
    x[VY] = (m.rear_axle_m - m.slip * v * v) * x[G] if v > m.min_speed else m.rear_axle_m * x[G]
    x[STEER] = -(m.wheelbase_m + m.understeer * v * v) * k
    x[KL] = k
    x[ETA] = kept_x[0] if keep else 1.0
    x[GYRO] = kept_x[1] if keep else 0.0
    x[CAM] = kept_x[2] if keep else 0.0
    for i in range(N):
        p[i * N + i] = m.start_sigma[i] * m.start_sigma[i]
    if v < m.still_mps:
        p[VY * N + VY] *= 1e-4
        p[G * N + G] *= 1e-4
    if not isnan(values[2]):
        p[KL * N + KL] = sigmas[2] * sigmas[2]
    if keep:
        for i in range(3):
            p[(ETA + i) * N + ETA + i] = kept_p[i]
    place(x, p, EL, 1.0, values[1], sigmas[1])
    place(x, p, YL, preview_m, values[0], sigmas[0])
