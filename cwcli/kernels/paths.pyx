# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Predicted paths: the quadrature of a motion model along each path, and the record that scales their ellipses.

`cwcli.prediction.integrate` lays out the nodes and says what is integrated; the sums are added in the order in which
NumPy's `cumsum` adds them, one row after the other, all of whose numbers stay in the processor's cache.
`cwcli.prediction.calibrate` says how the record counts. The plain twins are in tests/unit/prediction/naive_paths.py;
that of the record gives the same bits, that of the quadrature what is left of them by another cosine.
"""

from libc.math cimport NAN, cos, fabs, isfinite, sin, sqrt

import numpy as np

cdef enum:  # cwcli.signals.vehicle_state
    X = 0
    Y = 1
    SPEED = 2
    HEADING = 3
    ACCEL = 4
    YAW_RATE = 5
    JERK = 6
    YAW_ACCEL = 7


cdef double SHORT_TURN_RAD = 0.7853981633974483  # an eighth of a circle: the polynomials hold as far as this
cdef int MAX_DOUBLINGS = 8  # longer turns than 64 pi are libm's


cdef inline Py_ssize_t row_of(const double[:, :, ::1] values, Py_ssize_t i) noexcept nogil:
    return i if values.shape[0] > 1 else 0


cdef double largest(const double* values, Py_ssize_t n) noexcept nogil:
    cdef double found = 0.0
    cdef Py_ssize_t i
    for i in range(n):
        found = max(found, fabs(values[i]))
    return found


cdef void turn_direction(double heading, const double* turn, Py_ssize_t n, double largest_turn, double* cosine,
                         double* sine) noexcept nogil:
    """cos and sin of heading + turn, n of them, within 1e-15 for turns up to half a circle.

    The polynomials are those of Sun's fdlibm (`k_cos.c`, `k_sin.c`); a longer turn is halved until they hold, and its
    direction doubled as often, by cos 2a = 1 - 2 sin^2 a and sin 2a = 2 sin a cos a.
    """
    cdef double c0 = cos(heading), s0 = sin(heading), part = 1.0, a, z, c, s
    cdef Py_ssize_t i
    cdef int doublings = 0, k
    while largest_turn * part > SHORT_TURN_RAD and doublings <= MAX_DOUBLINGS:
        part *= 0.5
        doublings += 1
    if largest_turn == 0.0:
        for i in range(n):
            cosine[i], sine[i] = c0, s0
        return
    if doublings > MAX_DOUBLINGS:
        for i in range(n):
            cosine[i], sine[i] = cos(heading + turn[i]), sin(heading + turn[i])
        return
    for i in range(n):
        a = turn[i] * part
        z = a * a
        sine[i] = a + a * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * (
            -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * (
                -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)))))
        cosine[i] = 1.0 - (0.5 * z - z * z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * (
            2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07 + z * (
                2.08757232129817482790e-09 + z * -1.13596475577881948265e-11))))))
    for k in range(doublings):
        for i in range(n):
            c, s = cosine[i], sine[i]
            cosine[i] = 1.0 - 2.0 * s * s
            sine[i] = 2.0 * s * c
    for i in range(n):
        c, s = cosine[i], sine[i]
        cosine[i] = c0 * c - s0 * s
        sine[i] = s0 * c + c0 * s


cdef void run_sums(const double* of_x, const double* of_y, const double* response, Py_ssize_t n_nodes,
                   Py_ssize_t n_steps, const Py_ssize_t[::1] points, double* step_x, double* step_y, double sign,
                   double* out_x, double* out_y) noexcept nogil:
    """Running sums over the steps of two values at the nodes, times a response unless it is NULL, at the points.

    `sign` is that of the sum of x; the sums stand 8 numbers apart, as in a row of the Jacobian.
    """
    cdef Py_ssize_t s, q, at = 0, base
    cdef double x = -0.0, y = -0.0  # the neutral element: 0.0 would lose the sign of a zero
    for q in range(n_nodes):
        base = q * n_steps
        if response == NULL:
            if q == 0:
                for s in range(n_steps):
                    step_x[s], step_y[s] = of_x[s], of_y[s]
            else:
                for s in range(n_steps):
                    step_x[s] += of_x[base + s]
                    step_y[s] += of_y[base + s]
        elif q == 0:
            for s in range(n_steps):
                step_x[s], step_y[s] = of_x[s] * response[s], of_y[s] * response[s]
        else:
            for s in range(n_steps):
                step_x[s] += of_x[base + s] * response[base + s]
                step_y[s] += of_y[base + s] * response[base + s]
    if points.shape[0] and points[0] == 0:
        out_x[0], out_y[0] = sign * 0.0, 0.0
        at = 1
    for s in range(n_steps):
        if at == points.shape[0]:
            break
        x += step_x[s]
        y += step_y[s]
        if points[at] == s + 1:
            out_x[8 * at], out_y[8 * at] = sign * x, y
            at += 1


cdef void act(const double[:, ::1] slopes, Py_ssize_t row, const double[:, :, ::1] acting, Py_ssize_t n,
              double* response) noexcept nogil:
    """The response of a row whose derivative changes the speed or the heading by a rate of its own in each part."""
    cdef Py_ssize_t k, i
    cdef const double* inside = &acting[0, 0, 0]
    cdef double slope = slopes[row, 0]
    for i in range(n):
        response[i] = slope * inside[i]
    for k in range(1, acting.shape[0]):
        inside, slope = &acting[k, 0, 0], slopes[row, k]
        for i in range(n):
            response[i] += slope * inside[i]


def quadrature(const double[:, ::1] state, *, const double[:, :, ::1] weight, responses, uses,
               const Py_ssize_t[::1] points, acting_slopes=None):
    cdef const double[:, :, ::1] to_accel, to_jerk, to_yaw_rate, to_yaw_accel
    to_accel, to_jerk, to_yaw_rate, to_yaw_accel = responses
    cdef bint used[4]
    used = uses
    cdef bint acts = acting_slopes is not None, turns = used[2] or used[3]
    cdef const double[:, ::1] accel_slopes, yaw_slopes
    if acts:
        accel_slopes, yaw_slopes = acting_slopes
    cdef Py_ssize_t m = state.shape[0], n_nodes = weight.shape[1], n_steps = weight.shape[2], n = n_nodes * n_steps
    jacobian_array = np.zeros((2, m, points.shape[0], 8))
    cdef double[:, :, :, ::1] jacobian = jacobian_array
    if m == 0 or n == 0 or points.shape[0] == 0:
        jacobian_array[0, :, :, X] = jacobian_array[1, :, :, Y] = 1.0
        return jacobian_array
    cdef double[:, ::1] scratch = np.empty((9, n))
    cdef double* own_accel = &scratch[0, 0]
    cdef double* own_yaw = &scratch[1, 0]
    cdef double* turn = &scratch[2, 0]
    cdef double* c = &scratch[3, 0]
    cdef double* s = &scratch[4, 0]
    cdef double* moved_x = &scratch[5, 0]
    cdef double* moved_y = &scratch[6, 0]
    cdef double* step_x = &scratch[7, 0]
    cdef double* step_y = &scratch[8, 0]
    cdef const double* accel
    cdef const double* jerk
    cdef const double* yaw
    cdef const double* yaw_accel
    cdef const double* of_weight
    cdef double* dx
    cdef double* dy
    cdef double v0, a0, j0, w0, dw0, v, largest_turn, largest_yaw = 0.0, largest_yaw_accel = 0.0
    cdef Py_ssize_t i, k
    with nogil:
        for i in range(m):
            v0, a0, j0 = state[i, SPEED], state[i, ACCEL], state[i, JERK]
            w0, dw0 = state[i, YAW_RATE], state[i, YAW_ACCEL]
            of_weight = &weight[row_of(weight, i), 0, 0]
            jerk = &to_jerk[row_of(to_jerk, i), 0, 0]
            yaw_accel = &to_yaw_accel[row_of(to_yaw_accel, i), 0, 0]
            if acts:
                act(accel_slopes, i, to_accel, n, own_accel)
                act(yaw_slopes, i, to_yaw_rate, n, own_yaw)
                accel, yaw = own_accel, own_yaw
                largest_yaw = largest(yaw, n)
            else:
                accel = &to_accel[row_of(to_accel, i), 0, 0]
                yaw = &to_yaw_rate[row_of(to_yaw_rate, i), 0, 0]
                if i == 0 or to_yaw_rate.shape[0] > 1:
                    largest_yaw = largest(yaw, n)
            if i == 0 or to_yaw_accel.shape[0] > 1:
                largest_yaw_accel = largest(yaw_accel, n)
            if turns:
                for k in range(n):
                    turn[k] = w0 * yaw[k]
                largest_turn = fabs(w0) * largest_yaw
                if used[3]:
                    for k in range(n):
                        turn[k] += dw0 * yaw_accel[k]
                    largest_turn += fabs(dw0) * largest_yaw_accel
                turn_direction(state[i, HEADING], turn, n, largest_turn, c, s)
                for k in range(n):
                    c[k] *= of_weight[k]
                    s[k] *= of_weight[k]
            else:
                c[0], s[0] = cos(state[i, HEADING]), sin(state[i, HEADING])
                for k in range(1, n):
                    c[k], s[k] = c[0] * of_weight[k], s[0] * of_weight[k]
                c[0] *= of_weight[0]
                s[0] *= of_weight[0]
            for k in range(n):
                v = v0 + a0 * accel[k] + j0 * jerk[k]
                moved_x[k] = v * c[k]
                moved_y[k] = v * s[k]
            # to a heading that turns by d, a point at (dx, dy) moves by d (-dy, dx)
            dx, dy = &jacobian[0, i, 0, 0], &jacobian[1, i, 0, 0]
            run_sums(c, s, NULL, n_nodes, n_steps, points, step_x, step_y, 1.0, dx + SPEED, dy + SPEED)
            run_sums(moved_y, moved_x, NULL, n_nodes, n_steps, points, step_x, step_y, -1.0, dx + HEADING, dy + HEADING)
            if used[0]:
                run_sums(c, s, accel, n_nodes, n_steps, points, step_x, step_y, 1.0, dx + ACCEL, dy + ACCEL)
            if used[1]:
                run_sums(c, s, jerk, n_nodes, n_steps, points, step_x, step_y, 1.0, dx + JERK, dy + JERK)
            if used[2]:
                run_sums(moved_y, moved_x, yaw, n_nodes, n_steps, points, step_x, step_y, -1.0, dx + YAW_RATE,
                         dy + YAW_RATE)
            if used[3]:
                run_sums(moved_y, moved_x, yaw_accel, n_nodes, n_steps, points, step_x, step_y, -1.0, dx + YAW_ACCEL,
                         dy + YAW_ACCEL)
            for k in range(points.shape[0]):
                jacobian[0, i, k, X] = jacobian[1, i, k, Y] = 1.0
    return jacobian_array


def position_covariance(const double[:, :, :, ::1] jacobian, const double[:, :] heading, *, covariance,
                        const double[:, ::1] trust, const double[:, :, ::1] variance,
                        const double[:, ::1] sigma, double[:, :, ::1] out):
    cdef const double[:, :, :] of_start
    cdef bint has_covariance = covariance is not None
    if has_covariance:
        of_start = covariance
    cdef Py_ssize_t m = heading.shape[0], n = heading.shape[1], i, p, row
    if m == 0 or n == 0:
        return
    cdef double[:, ::1] scratch = np.empty((3, n))
    cdef double* turn = &scratch[0, 0]
    cdef double* cosine = &scratch[1, 0]
    cdef double* sine = &scratch[2, 0]
    cdef double scaled[64]
    cdef double root[8]
    cdef int column[6]
    cdef double weight[4]
    cdef double along, cross, both, sum_x, sum_y, xx, xy, yy, first
    cdef const double* to_x
    cdef const double* to_y
    cdef int k, l, a, b, n_columns
    with nogil:
        for i in range(m):
            for k in range(4):
                weight[k] = sigma[i, k] * sigma[i, k]
            first = heading[i, 0]
            for p in range(n):
                turn[p] = heading[i, p] - first
            turn_direction(first, turn, n, largest(turn, n), cosine, sine)
            row = i if variance.shape[1] > 1 else 0
            for p in range(n):
                along = variance[0, row, p] * weight[0] + variance[1, row, p] * weight[1]
                cross = variance[2, row, p] * weight[2] + variance[3, row, p] * weight[3]
                out[i, p, 0] = along * (cosine[p] * cosine[p]) + cross * (sine[p] * sine[p])
                out[i, p, 1] = (along - cross) * cosine[p] * sine[p]
                out[i, p, 2] = along * (sine[p] * sine[p]) + cross * (cosine[p] * cosine[p])
            if not has_covariance:
                continue
            # the posterior's g P for a derivative of trust g; one that is not trusted at all may be NaN
            for k in range(4):
                root[k] = 1.0
            root[ACCEL], root[JERK] = sqrt(trust[i, 0]), sqrt(trust[i, 1])
            root[YAW_RATE], root[YAW_ACCEL] = sqrt(trust[i, 2]), sqrt(trust[i, 3])
            n_columns = 0
            for k in range(8):
                if k > Y and root[k] != 0.0:
                    column[n_columns] = k
                    n_columns += 1
                for l in range(8):
                    both = root[k] * root[l]
                    scaled[8 * k + l] = 0.0 if both == 0.0 else of_start[i, k, l] * both
            for p in range(n):
                to_x, to_y = &jacobian[0, i, p, 0], &jacobian[1, i, p, 0]
                xx, xy, yy = scaled[8 * X + X], scaled[8 * X + Y], scaled[8 * Y + Y]
                for a in range(n_columns):
                    k = column[a]
                    xx += to_x[k] * scaled[8 * k + X]
                    xy += to_x[k] * scaled[8 * k + Y]
                    yy += to_y[k] * scaled[8 * k + Y]
                for b in range(n_columns):
                    l = column[b]
                    sum_x, sum_y = scaled[8 * X + l], scaled[8 * Y + l]
                    for a in range(n_columns):
                        k = column[a]
                        sum_x += to_x[k] * scaled[8 * k + l]
                        sum_y += to_y[k] * scaled[8 * k + l]
                    xx += sum_x * to_x[l]
                    xy += sum_x * to_y[l]
                    yy += sum_y * to_y[l]
                out[i, p, 0] += xx
                out[i, p, 1] += xy
                out[i, p, 2] += yy


def adapt_scale(const double[:, ::1] log_excess, is_known, const Py_ssize_t[::1] n_known, const double[::1] step_s, *,
                double rate_1ps, double bound, double miss_share):
    cdef const unsigned char[:, ::1] known = is_known.view(np.uint8)
    log_scale_array = np.empty((log_excess.shape[0], n_known.shape[0]))
    cdef double[:, ::1] log_scale = log_scale_array
    cdef Py_ssize_t i, seen, one
    cdef double now
    with nogil:
        for one in range(log_excess.shape[0]):
            now = 0.0
            seen = 0
            for i in range(n_known.shape[0]):
                while seen < n_known[i]:
                    if known[one, seen]:
                        # against the ellipse as it was scaled when it was made
                        if log_excess[one, seen] > log_scale[one, seen]:
                            now += rate_1ps * step_s[seen] * (1.0 - miss_share)
                        else:
                            now += rate_1ps * step_s[seen] * (0.0 - miss_share)
                        now = min(max(now, -bound), bound)
                    seen += 1
                log_scale[one, i] = now
    return log_scale_array


def stream_quantiles(const Py_ssize_t[::1] cell, const double[::1] weight, const Py_ssize_t[::1] track,
                     const Py_ssize_t[::1] n_known, const Py_ssize_t[::1] asking, const double[::1] prior,
                     const double[::1] levels):
    cdef Py_ssize_t n_cells = prior.shape[0], n_tracks = 1, e, i, c, level, seen = 0
    for e in range(track.shape[0]):
        n_tracks = max(n_tracks, track[e] + 1)
    for i in range(asking.shape[0]):
        n_tracks = max(n_tracks, asking[i] + 1)
    cdef double[::1] all_mass = np.array(prior)
    cdef double[:, ::1] own_mass = np.zeros((n_tracks, n_cells))
    cdef double[::1] own_total = np.zeros(n_tracks)
    out_array = np.empty((n_known.shape[0], levels.shape[0]))
    cdef double[:, ::1] out = out_array
    cdef double total = np.sum(prior), wanted, below, here
    with nogil:
        for i in range(n_known.shape[0]):
            while seen < n_known[i]:
                all_mass[cell[seen]] += weight[seen]
                own_mass[track[seen], cell[seen]] += weight[seen]
                own_total[track[seen]] += weight[seen]
                total += weight[seen]
                seen += 1
            below = 0.0
            c = 0
            for level in range(levels.shape[0]):
                wanted = levels[level] * (total - own_total[asking[i]])
                here = all_mass[c] - own_mass[asking[i], c]
                while below + here < wanted and c < n_cells - 1:
                    below += here
                    c += 1
                    here = all_mass[c] - own_mass[asking[i], c]
                out[i, level] = c + (min((wanted - below) / here, 1.0) if here > 0.0 else 1.0)
    return out_array


def on_track(const long long[:, ::1] at_ns, const long long[::1] stamp_ns, const double[:, :] xy, double max_gap_ns):
    found_array = np.empty((at_ns.shape[0], at_ns.shape[1], 2))
    cdef double[:, :, ::1] found = found_array
    is_known = np.empty((at_ns.shape[0], at_ns.shape[1]), bool)
    cdef unsigned char[:, ::1] known = is_known.view(np.uint8)
    cdef Py_ssize_t m = stamp_ns.shape[0], i, k, low, high, middle
    cdef long long now, gap
    cdef double share, x, y
    with nogil:
        for i in range(at_ns.shape[0]):
            for k in range(at_ns.shape[1]):
                now = at_ns[i, k]
                low, high = 0, m - 1  # the point behind is the first one not before `now`, and not the very first
                while high - low > 1:
                    middle = (low + high) >> 1
                    if stamp_ns[middle] < now:
                        low = middle
                    else:
                        high = middle
                found[i, k, 0] = found[i, k, 1] = NAN
                known[i, k] = 0
                gap = stamp_ns[high] - stamp_ns[low]
                if now != stamp_ns[high] and now != stamp_ns[low]:  # on a point nothing is interpolated
                    if now < stamp_ns[0] or now > stamp_ns[m - 1] or gap > max_gap_ns:
                        continue
                share = <double>(now - stamp_ns[low]) / <double>(gap if gap > 1 else 1)
                x = xy[low, 0] + share * (xy[high, 0] - xy[low, 0])
                y = xy[low, 1] + share * (xy[high, 1] - xy[low, 1])
                if isfinite(x) and isfinite(y):
                    found[i, k, 0], found[i, k, 1] = x, y
                    known[i, k] = 1
    return found_array, is_known
