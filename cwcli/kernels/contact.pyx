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

cdef enum:
    N_AXES = 5  # the edges' directions of both outlines, and across the mean way of a step

cdef double STANDING_M = 1e-9
cdef double PARALLEL = 1e-12
cdef double ACROSS = 0.02  # rad: an axis so nearly across the way says as much as the one that is
cdef double OUTSIDE = 4.5  # sigmas: what a line meets out there does not matter


cdef struct Step:  # from one point to the next; changes are from begin to end
    Py_ssize_t begin
    double x, y, way_x, way_y  # middle of the centres' way, and the way
    double cos_host, sin_host, cos_other, sin_other
    double normals[10]
    double reach[5]
    int tight  # the direction along which the outlines are farthest apart, in sigmas
    double weight  # what the step can count for: the density there
    double tight_place, tight_reach, tight_ahead, tight_left, tight_one, tight_two  # along it, as in `along` and `aside`
    Root host, other, host_change, other_change
    double along[4]  # a line's direction to the place, row by row, and the two errors off the lines' plane
    double aside[4]
    double along_change[4]
    double aside_change[4]


cdef struct Line:  # in one step: place in the middle, its slope along the line, and half of the change of both
    double x, y, slope_x, slope_y, moved_x, moved_y, turned_x, turned_y


cdef inline void product(Root a, Root b, double* out) noexcept nogil:
    """The product of two symmetric matrices, row by row."""
    out[0], out[1] = a.xx * b.xx + a.xy * b.xy, a.xx * b.xy + a.xy * b.yy
    out[2], out[3] = a.xy * b.xx + a.yy * b.xy, a.xy * b.xy + a.yy * b.yy


cdef inline double half_extent(double nx, double ny, double cosine, double sine, double length, double width) noexcept nogil:
    """Half of what an outline measures along a direction."""
    return 0.5 * (length * fabs(nx * cosine + ny * sine) + width * fabs(ny * cosine - nx * sine))


cdef inline double reach_along(double nx, double ny, const Step* step, double host_length, double host_width,
                               double other_length, double other_width) noexcept nogil:
    """How near the centres are along a direction when the outlines touch there."""
    return (half_extent(nx, ny, step.cos_host, step.sin_host, host_length, host_width)
            + half_extent(nx, ny, step.cos_other, step.sin_other, other_length, other_width))


cdef inline void maps_of(Root host, Root other, const double* to_host, const double* to_other, const double* left_host,
                         const double* left_other, double* along, double* aside) noexcept nogil:
    """Lines' directions, and the errors off their plane, to places."""
    along[0] = host.xx * to_host[0] + host.xy * to_host[2] + other.xx * to_other[0] + other.xy * to_other[2]
    along[1] = host.xx * to_host[1] + host.xy * to_host[3] + other.xx * to_other[1] + other.xy * to_other[3]
    along[2] = host.xy * to_host[0] + host.yy * to_host[2] + other.xy * to_other[0] + other.yy * to_other[2]
    along[3] = host.xy * to_host[1] + host.yy * to_host[3] + other.xy * to_other[1] + other.yy * to_other[3]
    aside[0] = other.xx * left_other[0] + other.xy * left_other[2] - host.xx * left_host[0] - host.xy * left_host[2]
    aside[1] = other.xx * left_other[1] + other.xy * left_other[3] - host.xx * left_host[1] - host.xy * left_host[3]
    aside[2] = other.xy * left_other[0] + other.yy * left_other[2] - host.xy * left_host[0] - host.yy * left_host[2]
    aside[3] = other.xy * left_other[1] + other.yy * left_other[3] - host.xy * left_host[1] - host.yy * left_host[3]


cdef inline double share_aside(const Step* step, double nx, double ny) noexcept nogil:
    """Share of the variance along a direction that is off the lines' plane."""
    cdef double a = nx * step.aside[0] + ny * step.aside[2], b = nx * step.aside[1] + ny * step.aside[3]
    cdef double c = nx * step.along[0] + ny * step.along[2], d = nx * step.along[1] + ny * step.along[3]
    a, c = a * a + b * b, c * c + d * d
    return a / (a + c)


cdef void tighten(Step* step) noexcept nogil:
    """What tells most lines that they miss."""
    cdef double nx = step.normals[2 * step.tight], ny = step.normals[2 * step.tight + 1]
    cdef double changed = hypot(nx * step.along_change[0] + ny * step.along_change[2],
                                nx * step.along_change[1] + ny * step.along_change[3])
    changed += hypot(nx * step.aside_change[0] + ny * step.aside_change[2],
                     nx * step.aside_change[1] + ny * step.aside_change[3])
    step.tight_place = nx * step.x + ny * step.y
    step.tight_reach = step.reach[step.tight] + 0.5 * (fabs(nx * step.way_x + ny * step.way_y) + OUTSIDE * changed)
    step.tight_ahead = OUTSIDE * (nx * step.along[0] + ny * step.along[2])
    step.tight_left = OUTSIDE * (nx * step.along[1] + ny * step.along[3])
    step.tight_one = nx * step.aside[0] + ny * step.aside[2]
    step.tight_two = nx * step.aside[1] + ny * step.aside[3]


cdef inline void narrow(double nx, double ny, double reach, const Line* line, double* low, double* high) noexcept nogil:
    """Cut an interval of a line to where its place along a direction is within reach, at some time in the step."""
    cdef double c = nx * line.x + ny * line.y, slope = nx * line.slope_x + ny * line.slope_y
    cdef double moved = nx * line.moved_x + ny * line.moved_y, turned = nx * line.turned_x + ny * line.turned_y
    cdef double one, two
    if slope < 0.0:  # the slab is the same from its other side
        c, slope, moved, turned = -c, -slope, -moved, -turned
    if slope < PARALLEL:
        slope, turned = PARALLEL, 0.0
    if fabs(turned) >= slope:
        turned = 0.0
    one, two = -reach - c, reach - c
    # each bound goes one way during the step: it is farthest out at the begin or at the end
    if moved * slope > -one * turned:
        one = (one - moved) / (slope + turned)
    else:
        one = (one + moved) / (slope - turned)
    if moved * slope < -two * turned:
        two = (two - moved) / (slope + turned)
    else:
        two = (two + moved) / (slope - turned)
    low[0], high[0] = max(low[0], one), min(high[0], two)


cdef inline void narrow_across(double bound, const Step* step, const Line* line, double host_length, double host_width,
                               double other_length, double other_width, double* low, double* high) noexcept nogil:
    """Cut it by the direction across the way that the place has at one of its bounds: the mean way has another."""
    cdef double wx, wy, length
    if low[0] > high[0] or fabs(bound) > OUTSIDE:
        return
    wx, wy = line.moved_x + bound * line.turned_x, line.moved_y + bound * line.turned_y
    length = sqrt(wx * wx + wy * wy)
    if length < STANDING_M or fabs(step.normals[0] * wx + step.normals[1] * wy) <= ACROSS * length:
        return
    wx, wy = wx / length, wy / length
    narrow(-wy, wx, reach_along(-wy, wx, step, host_length, host_width, other_length, other_width), line, low, high)


cdef inline double share_below(double r) noexcept nogil:
    """Share of a line's errors below r: their distance from the middle is Rayleigh's, to either side alike."""
    cdef double half = 0.5 * exp(-0.5 * r * r)
    return half if r < 0.0 else 1.0 - half


cdef double share_of(double* low, double* high, int n) noexcept nogil:
    """Share of a line that is in any of n intervals, which are sorted in place."""
    cdef int i, k
    cdef double a, b, end, total = 0.0
    for i in range(1, n):
        a, b = low[i], high[i]
        k = i - 1
        while k >= 0 and low[k] > a:
            low[k + 1], high[k + 1] = low[k], high[k]
            k -= 1
        low[k + 1], high[k + 1] = a, b
    i = 0
    while i < n:
        a, end = low[i], high[i]
        i += 1
        while i < n and low[i] <= end:
            end = max(end, high[i])
            i += 1
        total += share_below(end) - share_below(a)
    return total


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
    cdef Py_ssize_t* points = <Py_ssize_t*> malloc((n_points + 1) * sizeof(Py_ssize_t))
    cdef Py_ssize_t n_taken, p, last, length, quarter
    cdef Outlines outlines
    cdef Py_ssize_t i, s, k, at, n_kept, nearest, index, end, tier, first, used
    cdef Step* step
    cdef Line line
    cdef int axis, n
    cdef double way, nx, ny, apart, most, least, shifted, known, ahead_x = 1.0, ahead_y = 0.0
    cdef double one, two, cosine, sine, w1, w2, lo, hi
    cdef Root both, host, other
    cdef double to_host[4]
    cdef double to_other[4]
    cdef double left_host[4]
    cdef double left_other[4]
    try:
        if not (steps and points and hosts and others and low and high):
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
                        step.normals[2 * axis], step.normals[2 * axis + 1] = nx, ny
                        step.reach[axis] = reach_along(nx, ny, step, host_length, host_width, other_length, other_width)
                        apart = fabs(nx * step.x + ny * step.y) - step.reach[axis] - 0.5 * fabs(nx * step.way_x + ny * step.way_y)
                        apart /= sqrt(both.xx * nx * nx + 2.0 * both.xy * nx * ny + both.yy * ny * ny)
                        if apart > most:
                            most, step.tight = apart, axis
                    if most >= far_sigmas:
                        continue
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
                    tighten(step)
                    for axis in range(N_AXES):
                        one = share_aside(step, step.normals[2 * axis], step.normals[2 * axis + 1])
                        shifted = max(shifted, step.weight * one)
                first, tier = 0, 0
                while tier < enough_below.shape[0] and shifted >= enough_below[tier]:
                    first += n_lines[tier]
                    tier += 1
                used = n_lines[tier]
                for index in range(first, first + used):
                    cosine = ahead_x * lines[index, 0] - ahead_y * lines[index, 1]
                    sine = ahead_y * lines[index, 0] + ahead_x * lines[index, 1]
                    w1 = ahead_x * lines[index, 2] - ahead_y * lines[index, 3]
                    w2 = ahead_y * lines[index, 2] + ahead_x * lines[index, 3]
                    n, end = 0, 0
                    for at in range(n_kept):
                        step = steps + at
                        while end < n_ends and step.begin >= ends[end]:
                            out[i, end] += share_of(low, high, n)
                            end += 1
                        apart = fabs(step.tight_place + step.tight_one * w1 + step.tight_two * w2) - step.tight_reach
                        if apart > fabs(step.tight_ahead * cosine + step.tight_left * sine):
                            continue
                        line.x = step.x + step.aside[0] * w1 + step.aside[1] * w2
                        line.y = step.y + step.aside[2] * w1 + step.aside[3] * w2
                        line.slope_x = step.along[0] * cosine + step.along[1] * sine
                        line.slope_y = step.along[2] * cosine + step.along[3] * sine
                        line.moved_x = 0.5 * (step.way_x + step.aside_change[0] * w1 + step.aside_change[1] * w2)
                        line.moved_y = 0.5 * (step.way_y + step.aside_change[2] * w1 + step.aside_change[3] * w2)
                        line.turned_x = 0.5 * (step.along_change[0] * cosine + step.along_change[1] * sine)
                        line.turned_y = 0.5 * (step.along_change[2] * cosine + step.along_change[3] * sine)
                        lo, hi = -1e300, 1e300
                        for axis in range(N_AXES):
                            narrow(step.normals[2 * axis], step.normals[2 * axis + 1], step.reach[axis], &line, &lo, &hi)
                            if lo > hi:
                                break
                        one, two = lo, hi
                        narrow_across(one, step, &line, host_length, host_width, other_length, other_width, &lo, &hi)
                        narrow_across(two, step, &line, host_length, host_width, other_length, other_width, &lo, &hi)
                        if lo > hi:
                            continue
                        if n and lo <= high[n - 1] and hi >= low[n - 1]:
                            low[n - 1], high[n - 1] = min(low[n - 1], lo), max(high[n - 1], hi)
                        else:
                            low[n], high[n] = lo, hi
                            n += 1
                    while end < n_ends:
                        out[i, end] += share_of(low, high, n)
                        end += 1
                for end in range(n_ends):
                    out[i, end] /= used
    finally:
        free(steps)
        free(points)
        free(hosts)
        free(others)
        free(low)
        free(high)
    return out_array
