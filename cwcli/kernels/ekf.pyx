# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Extended Kalman filter and smoother of one vehicle, over a whole log at once.

State (first 8 of n): x, y, v, heading, a, yaw rate, jerk, yaw acceleration; behind them any number of slowly varying
parameters (sensor biases, latencies) up to n = 16. With n = 6 and a Q matrix the model is song2016's (eq. 2, 6).

Measurements are applied one scalar at a time; a correlated pair is decorrelated first, which equals the joint update.
The smoother is the modified Bryson-Frazier form (Bierman, 1973): it carries the adjoint lambda and its covariance
backward and needs no matrix inverse and no predicted covariance, so only the gain of each update is stored. It gives the
same result as Rauch-Tung-Striebel. The plain NumPy twin is in tests/unit/estimation/naive_ekf.py.
"""

from libc.math cimport M_PI, log, remainder, sqrt

from cwcli.kernels.ekf_motion cimport (
    NH,
    NMAX,
    P_FLIP,
    Step,
    add_noise,
    decay_of_yaw_rate,
    flip_sign,
    linearise,
    propagate,
    times_f,
    times_ft,
)
from cwcli.kernels.ekf_sensors cimport count_slots, expect, inflate

# The gate widens with the time since a source was last believed: the model's errors grow over an outage in ways that
# its covariance does not know of, and the first position after a tunnel must not be taken for an outlier.
cdef double GATE_WIDENS_S = 2.0

# A burst of messages that were held back can be long in rows and short in time: a source must stay elsewhere for this
# long before it is believed again. Inertial sensors (kind 4, 5) are believed by rows alone.
cdef double PATIENCE_S = 2.0


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
    cdef int i, j, k, u, s, width, axis, row, m
    cdef double dt, r0, r1, r2, s00, s01, s11, det, d2, corr, var, inv, acc, quiet, decay, root, total = 0.0, volume = 1.0
    cdef bint fresh
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
            m = count_slots(kind[s], bias[s], lag[s])
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
                    for j in range(m):
                        acc += p[i * NMAX + idx[j]] * hx[axis * NH + j]
                    ph[axis * NMAX + i] = acc
            fresh = True
            s00 = 0.0
            for j in range(m):
                s00 += hx[j] * ph[idx[j]]
            if width == 1:
                nis[3 * u + 1] = nu[0] * nu[0]
                nis[3 * u + 2] = s00
                d2 = nu[0] * nu[0] / (s00 + r0)
            else:
                s01 = 0.0
                s11 = 0.0
                for j in range(m):
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
                fresh = False
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
                for j in range(m):
                    hx[NH + j] -= corr * hx[j]
            for axis in range(width):
                row = 2 * u + axis
                if fresh:                                 # the gate has computed it
                    for i in range(n):
                        g[i] = ph[i]
                    fresh = False
                else:
                    for i in range(n):
                        acc = 0.0
                        for j in range(m):
                            acc += p[i * NMAX + idx[j]] * hx[axis * NH + j]
                        g[i] = acc
                var = r0 if axis == 0 else r2
                for j in range(m):
                    var += hx[axis * NH + j] * g[idx[j]]
                inv = 1.0 / var
                acc = nu[axis]
                total -= 0.5 * acc * acc * inv
                volume *= 2.0 * M_PI * var                # one logarithm for many updates
                if volume > 1e200 or volume < 1e-200:
                    total -= 0.5 * log(volume)
                    volume = 1.0
                if keep:
                    for i in range(n):
                        gain[row * n + i] = g[i] * inv
                    for j in range(m):
                        partials[row * NH + j] = hx[axis * NH + j]
                    innovation[2 * row] = acc * inv
                    innovation[2 * row + 1] = inv
                if axis == 0 and width == 2:              # the second innovation about the state after the first update
                    for j in range(m):
                        nu[1] -= hx[NH + j] * g[idx[j]] * inv * acc
                root = sqrt(inv)
                for i in range(n):
                    x[i] += g[i] * inv * acc
                    g[i] *= root
                for i in range(n):                        # symmetric to the last bit
                    for j in range(n):
                        p[i * NMAX + j] -= g[i] * g[j]
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
    return total - 0.5 * log(volume)


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
    cdef int i, j, l, k, u, s, width, axis, row, m
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
            m = count_slots(kind[s], bias[s], lag[s])
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
                for j in range(m):
                    la[idx[j]] -= hv[j] * acc
                for j in range(m):
                    if hv[j] == 0.0:
                        continue
                    for i in range(n):
                        big[i * NMAX + idx[j]] -= w[i] * hv[j]
                        big[idx[j] * NMAX + i] -= w[i] * hv[j]
                    for l in range(m):
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
