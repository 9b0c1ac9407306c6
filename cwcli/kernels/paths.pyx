# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Predicted paths: the quadrature of a motion model along each path, and the record that scales their ellipses.

`cwcli.prediction.integrate` lays out the nodes and says what is integrated; the sums are added in the order in which
NumPy's `cumsum` adds them. `cwcli.prediction.calibrate` says how the record counts. The plain twins of both are in
tests/unit/prediction/naive_paths.py and give the same bits.
"""

from libc.math cimport NAN, isfinite

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


cdef inline Py_ssize_t row_of(const double[:, :, ::1] values, Py_ssize_t i) noexcept nogil:
    return i if values.shape[0] > 1 else 0


def quadrature(const double[:, ::1] state, *, const double[:, :, ::1] cosine, const double[:, :, ::1] sine,
               const double[:, :, ::1] weight, responses, uses, const Py_ssize_t[::1] points):
    cdef const double[:, :, ::1] to_accel, to_jerk, to_yaw_rate, to_yaw_accel
    to_accel, to_jerk, to_yaw_rate, to_yaw_accel = responses
    cdef bint used[4]
    used = uses
    jacobian_array = np.empty((2, state.shape[0], points.shape[0], 8))
    cdef double[:, :, :, ::1] jacobian = jacobian_array
    cdef Py_ssize_t n_steps = weight.shape[1], n_nodes = weight.shape[2], i, s, q, at
    cdef Py_ssize_t each_step = 1 if cosine.shape[1] > 1 else 0, each_node = 1 if cosine.shape[2] > 1 else 0
    cdef Py_ssize_t of_weight, of_accel, of_jerk, of_rate, of_yaw_accel
    cdef double v0, a0, j0, v, c, w_sin, moved_x, moved_y
    cdef double step[12], total[12]
    cdef int k
    with nogil:
        for i in range(state.shape[0]):
            v0, a0, j0 = state[i, SPEED], state[i, ACCEL], state[i, JERK]
            of_weight, of_accel, of_jerk = row_of(weight, i), row_of(to_accel, i), row_of(to_jerk, i)
            of_rate, of_yaw_accel = row_of(to_yaw_rate, i), row_of(to_yaw_accel, i)
            for k in range(12):
                total[k] = 0.0
            at = 0
            if points.shape[0] and points[0] == 0:
                store(total, used, jacobian, i, 0)
                at = 1
            for k in range(12):
                total[k] = -0.0  # the neutral element: 0.0 would lose the sign of a zero
            for s in range(n_steps):
                if at == points.shape[0]:
                    break
                for q in range(n_nodes):
                    c = cosine[i, s * each_step, q * each_node] * weight[of_weight, s, q]
                    w_sin = sine[i, s * each_step, q * each_node] * weight[of_weight, s, q]
                    v = v0 + a0 * to_accel[of_accel, s, q] + j0 * to_jerk[of_jerk, s, q]
                    moved_x, moved_y = v * c, v * w_sin
                    if q == 0:
                        for k in range(12):
                            step[k] = -0.0
                    step[0] += moved_x
                    step[1] += moved_y
                    step[2] += c
                    step[3] += w_sin
                    step[4] += c * to_accel[of_accel, s, q]
                    step[5] += w_sin * to_accel[of_accel, s, q]
                    step[6] += c * to_jerk[of_jerk, s, q]
                    step[7] += w_sin * to_jerk[of_jerk, s, q]
                    step[8] += moved_x * to_yaw_rate[of_rate, s, q]
                    step[9] += moved_y * to_yaw_rate[of_rate, s, q]
                    step[10] += moved_x * to_yaw_accel[of_yaw_accel, s, q]
                    step[11] += moved_y * to_yaw_accel[of_yaw_accel, s, q]
                for k in range(12):
                    total[k] += step[k]
                if points[at] == s + 1:
                    store(total, used, jacobian, i, at)
                    at += 1
    return jacobian_array


cdef inline void store(const double* total, const bint* uses, double[:, :, :, ::1] jacobian,
                       Py_ssize_t i, Py_ssize_t at) noexcept nogil:
    """The derivatives at a point: to a heading that turns by d, a point at (dx, dy) moves by d (-dy, dx)."""
    cdef double* of_x = &jacobian[0, i, at, 0]
    cdef double* of_y = &jacobian[1, i, at, 0]
    cdef int k
    for k in range(8):
        of_x[k] = of_y[k] = 0.0
    of_x[X] = of_y[Y] = 1.0
    of_x[SPEED], of_y[SPEED] = total[2], total[3]
    of_x[HEADING], of_y[HEADING] = -total[1], total[0]
    if uses[0]:
        of_x[ACCEL], of_y[ACCEL] = total[4], total[5]
    if uses[1]:
        of_x[JERK], of_y[JERK] = total[6], total[7]
    if uses[2]:
        of_x[YAW_RATE], of_y[YAW_RATE] = -total[9], total[8]
    if uses[3]:
        of_x[YAW_ACCEL], of_y[YAW_ACCEL] = -total[11], total[10]


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
