# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""What a vehicle's derivatives were worth: the sums and solutions of `cwcli.prediction.outcome_history`, which says what they are.

The plain twins are in tests/unit/prediction/naive_record.py.
"""

from libc.math cimport M_PI, fabs, fmin, isfinite, isnan, sqrt

import numpy as np

cdef enum:
    SUMS = 9  # x x' above the diagonal: 00 01 02 11 12 22, and x y
    MAX_KNOTS = 16

cdef double POSITIVE_PART = 1.0 / sqrt(2.0 * M_PI)  # mean of max(z, 0), z standard normal


def changes(const double[::1] age_s, const double[:, ::1] value, const Py_ssize_t[::1] first,
            const double[::1] look_back_s):
    cdef Py_ssize_t n = age_s.shape[0], n_knots = look_back_s.shape[0], i, k, axis, before
    change_array = np.empty((n, 2, n_knots))
    passed_array = np.empty((n, n_knots))
    cdef double[:, :, ::1] change = change_array
    cdef double[:, ::1] passed = passed_array
    cdef double then, step, share, was
    with nogil:
        for k in range(n_knots):
            before = 0
            for i in range(n):
                before = max(before, first[i])
                then = max(age_s[i] - look_back_s[k], 0.0)
                while before + 1 < i and age_s[before + 1] <= then:
                    before += 1
                passed[i, k] = age_s[i] - then
                step = age_s[min(before + 1, i)] - age_s[before]
                share = (then - age_s[before]) / step if step > 0.0 else 0.0
                for axis in range(2):
                    was = value[axis, before] + share * (value[axis, min(before + 1, i)] - value[axis, before])
                    change[i, axis, k] = value[axis, i] - was
    return change_array, passed_array


def gains(const double[:, :, :, ::1] parts, const double[:, :, ::1] promised, const double[:, :, ::1] followed, *,
          const double[::1] step_s, const double[::1] knots_s, const Py_ssize_t[::1] track,
          const Py_ssize_t[:, ::1] known_row, const long long[:, ::1] known_ns, const long long[::1] now_ns, const Py_ssize_t[:, ::1] by_known,
          const Py_ssize_t[::1] by_now, const double[:, :, ::1] prior, const double[:, ::1] error_m,
          const double[:, :, ::1] carried, const double[::1] prior_outcomes):
    cdef Py_ssize_t n = parts.shape[0], n_knots = knots_s.shape[0], n_tracks = 0, i, j, k, axis, part, at
    for i in range(n):
        n_tracks = max(n_tracks, track[i] + 1)
    out_array = np.empty((n, 2, n_knots, 3))
    cdef double[:, :, :, ::1] out = out_array
    cdef double[:, :, ::1] total = np.zeros((n_knots, 2, SUMS))
    # a vehicle's own outcomes count by its rows: of several that became known at once a later one tells an earlier one
    # nothing; those of the others by the time, so from the sum over all are taken the vehicle's by the time
    cdef double[:, :, :, ::1] own = np.zeros((max(n_tracks, 1), n_knots, 2, SUMS))
    cdef double[:, :, :, ::1] own_by_time = np.zeros((max(n_tracks, 1), n_knots, 2, SUMS))
    cdef Py_ssize_t[:, ::1] own_seen = np.repeat(np.searchsorted(track, np.arange(n_tracks))[:, None], n_knots, axis=1)
    cdef Py_ssize_t seen[MAX_KNOTS]
    cdef double gain[3]
    cdef double ridge[3]
    cdef double others[SUMS]
    with nogil:
        for k in range(n_knots):
            seen[k] = 0
        for at in range(n):
            i = by_now[at]
            for k in range(n_knots):
                while seen[k] < n and known_ns[by_known[k, seen[k]], k] <= now_ns[i]:
                    j = by_known[k, seen[k]]
                    for axis in range(2):
                        add(parts, promised, followed, j, axis, k, step_s[j] / knots_s[k], prior, error_m[axis, k],
                            &own_by_time[track[j], k, axis, 0], &total[k, axis, 0])
                    seen[k] += 1
                while own_seen[track[i], k] < i and known_row[own_seen[track[i], k], k] <= i:
                    j = own_seen[track[i], k]
                    for axis in range(2):
                        add(parts, promised, followed, j, axis, k, step_s[j] / knots_s[k], prior, error_m[axis, k],
                            &own[track[i], k, axis, 0], NULL)
                    own_seen[track[i], k] += 1
            for axis in range(2):
                for k in range(n_knots):
                    for part in range(3):
                        ridge[part] = prior_outcomes[part] * error_m[axis, k] ** 2
                        if k and not isnan(carried[axis, k, part]):
                            gain[part] = min(max(gain[part] * carried[axis, k, part], 0.0), 1.0)
                        else:
                            gain[part] = prior[axis, k, part]
                    if n_tracks > 1:
                        for part in range(SUMS):
                            others[part] = total[k, axis, part] - own_by_time[track[i], k, axis, part]
                        solve(others, ridge, error_m[axis, k], gain)
                    solve(&own[track[i], k, axis, 0], ridge, error_m[axis, k], gain)
                    for part in range(3):
                        out[i, axis, k, part] = gain[part]
    return out_array


cdef inline void add(const double[:, :, :, ::1] parts, const double[:, :, ::1] promised,
                     const double[:, :, ::1] followed, Py_ssize_t j, Py_ssize_t axis, Py_ssize_t k, double weight,
                     const double[:, :, ::1] prior, double error_m, double* own, double* total) noexcept nogil:
    """One outcome, weighted by how far it is from what the fleet or constant velocity expects, the nearer of the two."""
    cdef double y = followed[j, axis, k], left
    cdef double x[3]
    cdef double more[SUMS]
    cdef int s
    if not isfinite(y):
        return
    left = y
    for s in range(3):
        x[s] = promised[j, axis, k] * parts[j, axis, k, s]
        left -= x[s] * prior[axis, k, s]
    weight /= 1.0 + fmin(fabs(left), fabs(y)) / error_m
    more[0], more[1], more[2] = x[0] * x[0], x[0] * x[1], x[0] * x[2]
    more[3], more[4], more[5] = x[1] * x[1], x[1] * x[2], x[2] * x[2]
    more[6], more[7], more[8] = x[0] * y, x[1] * y, x[2] * y
    for s in range(SUMS):
        own[s] += weight * more[s]
        if total != NULL:
            total[s] += weight * more[s]


cdef inline void solve(const double* sums, const double* ridge, double error_m, double* gain) noexcept nogil:
    """The gains by Cholesky's factors, in [0, 1]; `gain` is the prior and becomes the posterior.

    The unclear part comes last in the elimination: 1 / l22^2 is the variance of its gain over that of an outcome.
    What it has more than its prior is less what a gain of 0 would show on average.
    """
    cdef double l00, l10, l20, l11, l21, l22, c0, c1, c2, unclear, lasting, new
    l00 = sqrt(sums[5] + ridge[2])
    l10, l20 = sums[4] / l00, sums[2] / l00
    l11 = sqrt(sums[3] + ridge[1] - l10 * l10)
    l21 = (sums[1] - l20 * l10) / l11
    l22 = sqrt(sums[0] + ridge[0] - l20 * l20 - l21 * l21)
    c0 = (sums[8] + ridge[2] * gain[2]) / l00
    c1 = (sums[7] + ridge[1] * gain[1] - l10 * c0) / l11
    c2 = (sums[6] + ridge[0] * gain[0] - l20 * c0 - l21 * c1) / l22
    unclear = c2 / l22
    lasting = (c1 - l21 * unclear) / l11
    new = (c0 - l10 * lasting - l20 * unclear) / l00
    unclear = max(unclear - POSITIVE_PART * error_m / l22, min(unclear, gain[0]))
    gain[0], gain[1], gain[2] = min(max(unclear, 0.0), 1.0), min(max(lasting, 0.0), 1.0), min(max(new, 0.0), 1.0)
