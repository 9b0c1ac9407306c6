# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""When two outlines meet: at constant accelerations, along arcs, and where they have been at different times.

`cwcli.measures` says what is searched; the plain twins are in tests/unit/measures/naive_encounters.py.
"""

from libc.math cimport INFINITY, NAN, copysign, fabs, isfinite, sqrt

import numpy as np

from cwcli.kernels.outlines cimport separation_m

cdef struct Interval:
    double low
    double high
    bint exists


cdef inline Interval below_zero(double bend, double slope, double start) noexcept nogil:
    """Where start + slope t + bend t^2 / 2 <= 0, for bend >= 0."""
    cdef Interval found
    cdef double root = slope * slope - 2.0 * bend * start, larger, one = 0.0, two = 0.0
    found.low, found.high = INFINITY, -INFINITY
    if bend == 0.0 and slope == 0.0:  # without motion it is there for all time or never
        found.exists = start <= 0.0
        if found.exists:
            found.low, found.high = -INFINITY, INFINITY
        return found
    found.exists = root >= 0.0
    if found.exists:
        larger = -(slope + copysign(sqrt(root), slope))
        if larger != 0.0:  # else a double root at 0
            one, two = larger / bend, 2.0 * start / larger
        found.low, found.high = min(one, two), max(one, two)
    return found


def accelerated_contact_time(const double[:, ::1] centre, const double[:, ::1] speed, const double[:, ::1] reach,
                             const double[:, ::1] bend):
    cdef Py_ssize_t m = centre.shape[1], i
    out_array = np.empty(m)
    cdef double[::1] out = out_array
    cdef double low[4]
    cdef double high[4]
    cdef double first_end[4]
    cdef double second[4]
    cdef double q, v, c, sign, now, later, wait
    cdef Interval near, far
    cdef int k, turn
    with nogil:
        for i in range(m):
            for k in range(4):
                q, v, c = bend[k, i], speed[k, i], centre[k, i]
                q = 0.0 if fabs(q) < 1e-9 else q
                sign = -1.0 if q < 0.0 else 1.0
                q, v, c = sign * q, sign * v, sign * c
                v = 0.0 if fabs(v) < 1e-9 else v
                near = below_zero(q, v, c - reach[k, i])  # c + v t + q t^2 / 2 <= R from low to high
                far = below_zero(q, v, c + reach[k, i])  # and below -R in between
                low[k], high[k] = near.low, near.high
                first_end[k] = far.low if far.exists else near.high
                second[k] = far.high if far.exists else INFINITY
            now = 0.0
            for turn in range(9):
                # the earliest time from `now` on at which each direction overlaps; contact is where none has to wait
                later = -INFINITY
                for k in range(4):
                    if now <= first_end[k]:
                        wait = max(low[k], now)
                    elif now <= high[k]:
                        wait = max(second[k], now)
                    else:
                        wait = INFINITY
                    later = max(later, wait)
                if not later > now:
                    break
                now = later
            out[i] = now
    return out_array


def overlap_time_along_arcs(const double[:, ::1] place, const double[:, ::1] direction, const double[:, :, ::1] chord,
                            const double[:, :, ::1] turn, const double[::1] close_m, host_size, other_size, *,
                            int n_steps, double step_s):
    cdef Py_ssize_t m = place.shape[0], i
    out_array = np.empty(m)
    cdef double[::1] out = out_array
    cdef double host[2]
    cdef double other[2]
    host, other = host_size, other_size
    cdef double own[4]  # place and direction
    cdef double theirs[4]
    cdef double x, y, before, now
    cdef int step
    with nogil:
        for i in range(m):
            own[0] = own[1] = own[3] = 0.0
            own[2] = 1.0
            theirs[0], theirs[1] = place[i, 0], place[i, 1]
            theirs[2], theirs[3] = direction[i, 0], direction[i, 1]
            out[i] = NAN
            before = INFINITY
            for step in range(n_steps + 1):
                x, y = theirs[0] - own[0], theirs[1] - own[1]
                now = INFINITY
                if x * x + y * y <= close_m[i] * close_m[i]:
                    now = separation_m(x, y, own[2], own[3], theirs[2], theirs[3], host, other)
                    if now <= 0.0:
                        out[i] = step_s * (step - (now / (now - before) if isfinite(before) else 0.0))
                        break
                before = now
                move(own, &chord[0, i, 0], &turn[0, i, 0])
                move(theirs, &chord[1, i, 0], &turn[1, i, 0])
    return out_array


cdef inline void move(double* pose, const double* chord, const double* turn) noexcept nogil:
    """Go along a chord, given in the pose's own axes, and turn."""
    cdef double cosine = pose[2], sine = pose[3]
    pose[0] += cosine * chord[0] - sine * chord[1]
    pose[1] += cosine * chord[1] + sine * chord[0]
    pose[2] = cosine * turn[0] - sine * turn[1]
    pose[3] = cosine * turn[1] + sine * turn[0]


def rows_of_least_lag(const double[:, ::1] poses, host_size, other_size, double reach_m, Py_ssize_t n_lags):
    cdef double host[2]
    cdef double other[2]
    host, other = host_size, other_size
    cdef Py_ssize_t n = poses.shape[1], lag, i, mine, them, found_mine = -1, found_them = -1
    cdef int sign
    cdef double x, y, reach_m2 = reach_m * reach_m
    with nogil:
        for lag in range(n_lags):
            for sign in range(2 if lag else 1):
                mine = lag if sign else 0
                them = lag - mine
                for i in range(n - lag):
                    x, y = poses[4, them + i] - poses[0, mine + i], poses[5, them + i] - poses[1, mine + i]
                    if x * x + y * y <= reach_m2 and separation_m(
                        x, y, poses[2, mine + i], poses[3, mine + i], poses[6, them + i], poses[7, them + i],
                        host, other
                    ) <= 0.0:
                        found_mine, found_them = mine + i, them + i
                        break
                if found_mine >= 0:
                    break
            if found_mine >= 0:
                break
    return found_mine, found_them
