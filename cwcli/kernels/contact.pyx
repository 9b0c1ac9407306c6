# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""The probability that two outlines touch along uncertain paths, summed over lines through the space of the errors.

`cwcli.measures.collision_probability` says what is computed and why; its plain twin is
tests/unit/measures/naive_collision.py.
"""

from libc.math cimport NAN, cos, exp, fabs, hypot, isnan, sin, sqrt
from libc.stdlib cimport free, malloc

import numpy as np

from cwcli.kernels.contact_steps cimport (
    Outlines,
    Root,
    change_of,
    inverse,
    is_straight,
    middle_of,
    root_of,
    squared,
    sum_of,
)

include "contact_lines.pxi"


def contact_probability(const double[:, ::1] x, const double[:, ::1] y,
                        const double[:, ::1] host_heading, const double[:, ::1] other_heading,
                        const double[:, :, ::1] host_covariance, const double[:, :, ::1] other_covariance, *,
                        double host_length, double host_width, double other_length, double other_width,
                        const double[:, ::1] lines, const Py_ssize_t[::1] n_lines, const double[::1] enough_below,
                        const Py_ssize_t[::1] ends, double far_sigmas, double least_m2, double straight_sigmas):
    cdef Py_ssize_t n_rows = x.shape[0], n_points = x.shape[1], n_ends = ends.shape[0]
    out_array = np.zeros((n_rows, n_ends))
    cdef double[:, ::1] out = out_array
    cdef Step* steps = <Step*> malloc(n_points * sizeof(Step))
    cdef Root* hosts = <Root*> malloc(n_points * sizeof(Root))
    cdef Root* others = <Root*> malloc(n_points * sizeof(Root))
    cdef double* low = <double*> malloc(n_points * sizeof(double))
    cdef double* high = <double*> malloc(n_points * sizeof(double))
    cdef Py_ssize_t* order = <Py_ssize_t*> malloc(n_points * sizeof(Py_ssize_t))
    cdef Py_ssize_t* group_ends = <Py_ssize_t*> malloc(n_ends * sizeof(Py_ssize_t))  # in the order, of each end
    cdef Py_ssize_t* points = <Py_ssize_t*> malloc((n_points + 1) * sizeof(Py_ssize_t))
    cdef Py_ssize_t n_taken, p, last, length, quarter
    cdef Outlines outlines
    cdef Py_ssize_t i, s, k, at, n_kept, nearest, index, end, tier, first, used
    cdef Step* step
    cdef Errors errors
    cdef int axis, tight = 0, n
    cdef double way, nx, ny, apart, most, least, shifted, known, ahead_x = 1.0, ahead_y = 0.0
    cdef double one, two
    cdef Root both, host, other
    cdef double to_host[4]
    cdef double to_other[4]
    cdef double left_host[4]
    cdef double left_other[4]
    try:
        if not (steps and points and order and group_ends and hosts and others and low and high):
            raise MemoryError
        outlines.host_length, outlines.host_width = host_length, host_width
        outlines.other_length, outlines.other_width = other_length, other_width
        with nogil:
            for i in range(n_rows):
                known = 0.0
                for k in range(n_points):
                    hosts[k] = root_of(
                        host_covariance[i, k, 0] + least_m2, host_covariance[i, k, 1], host_covariance[i, k, 2] + least_m2
                    )
                    others[k] = root_of(
                        other_covariance[i, k, 0] + least_m2, other_covariance[i, k, 1], other_covariance[i, k, 2] + least_m2
                    )
                    known += x[i, k] + y[i, k] + host_heading[i, k] + other_heading[i, k]
                    known += hosts[k].xx + hosts[k].yy + others[k].xx + others[k].yy
                if isnan(known):
                    for end in range(n_ends):
                        out[i, end] = NAN
                    continue
                n_taken, s, length = 1, 0, n_points
                points[0] = 0
                for end in range(n_ends + 1):
                    last = ends[end] if end < n_ends else n_points - 1
                    while s < last:
                        k = min(s + length, last)
                        while k > s + 1:
                            quarter = max((k - s) // 4, 1)
                            if (is_straight(s, k, s + quarter, &x[i, 0], &y[i, 0], &host_heading[i, 0],
                                            &other_heading[i, 0], hosts, others, &outlines, straight_sigmas)
                                    and is_straight(s, k, k - quarter, &x[i, 0], &y[i, 0], &host_heading[i, 0],
                                                    &other_heading[i, 0], hosts, others, &outlines, straight_sigmas)):
                                break
                            k = s + (k - s + 1) // 2
                        length = 2 * (k - s)
                        s = k
                        points[n_taken] = k
                        n_taken += 1
                n_kept, nearest, least = 0, 0, far_sigmas
                for p in range(n_taken - 1):
                    s, k = points[p], points[p + 1]
                    step = steps + n_kept
                    step.begin = s
                    step.x, step.y = 0.5 * (x[i, s] + x[i, k]), 0.5 * (y[i, s] + y[i, k])
                    step.way_x, step.way_y = x[i, k] - x[i, s], y[i, k] - y[i, s]
                    one = 0.5 * (host_heading[i, s] + host_heading[i, k])
                    two = 0.5 * (other_heading[i, s] + other_heading[i, k])
                    step.cos_host, step.sin_host, step.cos_other, step.sin_other = cos(one), sin(one), cos(two), sin(two)
                    step.host, step.other = middle_of(hosts[s], hosts[k]), middle_of(others[s], others[k])
                    step.host_change, step.other_change = change_of(hosts[s], hosts[k]), change_of(others[s], others[k])
                    both = sum_of(squared(step.host), squared(step.other))
                    way = hypot(step.way_x, step.way_y)
                    most = -1e300
                    for axis in range(N_AXES):
                        if axis == 4:
                            nx, ny = step.cos_host, step.sin_host
                        elif axis == 1:
                            nx, ny = -step.sin_host, step.cos_host
                        elif axis == 2:
                            nx, ny = step.cos_other, step.sin_other
                        elif axis == 3:
                            nx, ny = -step.sin_other, step.cos_other
                        elif way > STANDING_M:  # first: it tells most lines that they miss
                            nx, ny = -step.way_y / way, step.way_x / way
                        else:
                            nx, ny = -step.sin_host, step.cos_host
                        step.slabs[axis].x, step.slabs[axis].y = nx, ny
                        step.slabs[axis].reach = reach_along(nx, ny, step, &outlines)
                        apart = fabs(nx * step.x + ny * step.y) - step.slabs[axis].reach - 0.5 * fabs(nx * step.way_x + ny * step.way_y)
                        apart /= sqrt(both.xx * nx * nx + 2.0 * both.xy * nx * ny + both.yy * ny * ny)
                        if apart > most:
                            most, tight = apart, axis
                    if most >= far_sigmas:
                        continue
                    step.gap = most
                    order_slabs(tight, step.order)
                    step.weight = exp(-0.5 * most * most) if most > 0.0 else 1.0
                    if most < least:
                        nearest, least, ahead_x, ahead_y = n_kept, most, step.cos_host, step.sin_host
                    n_kept += 1
                if not n_kept:
                    continue
                host, other = steps[nearest].host, steps[nearest].other
                both = sum_of(squared(host), squared(other))
                both = inverse(root_of(both.xx, both.xy, both.yy))
                product(host, both, to_host)
                product(other, both, to_other)
                host, other = inverse(host), inverse(other)
                both = sum_of(squared(host), squared(other))
                both = inverse(root_of(both.xx, both.xy, both.yy))
                product(host, both, left_host)
                product(other, both, left_other)
                shifted = 0.0
                for at in range(n_kept):
                    step = steps + at
                    maps_of(step.host, step.other, to_host, to_other, left_host, left_other, step.along, step.aside)
                    maps_of(step.host_change, step.other_change, to_host, to_other, left_host, left_other,
                            step.along_change, step.aside_change)
                    for axis in range(N_AXES):
                        project_lines(step, &step.slabs[axis])
                        shifted = max(shifted, step.weight * share_aside(&step.slabs[axis]))
                at = 0
                for end in range(n_ends):
                    first = at
                    while at < n_kept and steps[at].begin < ends[end]:
                        order[at] = at
                        at += 1
                    sort_by_gap(order, first, at, steps)
                    group_ends[end] = at
                first, tier = 0, 0
                while tier < enough_below.shape[0] and shifted >= enough_below[tier]:
                    first += n_lines[tier]
                    tier += 1
                used = n_lines[tier]
                for index in range(first, first + used):
                    errors.cosine = ahead_x * lines[index, 0] - ahead_y * lines[index, 1]
                    errors.sine = ahead_y * lines[index, 0] + ahead_x * lines[index, 1]
                    errors.one = ahead_x * lines[index, 2] - ahead_y * lines[index, 3]
                    errors.two = ahead_y * lines[index, 2] + ahead_x * lines[index, 3]
                    n = 0
                    for end in range(n_ends):
                        for at in range(group_ends[end - 1] if end else 0, group_ends[end]):
                            n = add_interval(steps + order[at], &errors, &outlines, low, high, n)
                        out[i, end] += share_of(low, high, n)
                for end in range(n_ends):
                    out[i, end] /= used
    finally:
        free(steps)
        free(points)
        free(order)
        free(group_ends)
        free(hosts)
        free(others)
        free(low)
        free(high)
    return out_array
