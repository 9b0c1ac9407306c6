# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""The probability that two outlines touch along uncertain paths, summed over lines through the space of the errors.

`cwcli.measures.collision_probability` says what is computed and why; its plain twin is
tests/unit/measures/naive_collision.py.
"""

from libc.math cimport NAN, cos, exp, fabs, hypot, isnan, sin, sqrt
from libc.stdlib cimport free, malloc

import numpy as np

cdef enum:
    N_AXES = 5  # the edges' directions of both outlines, and across the way of a step
    N_VALUES = 11  # of an axis: place, reach, slopes in the plane of the lines (2) and off it (2); change of place and slopes

cdef double STANDING_M = 1e-9
cdef double PARALLEL = 1e-12
cdef double ALIKE = 0.01  # share of the variance by which errors differ in time: below, fewer lines are enough


cdef struct Root:
    double xx
    double xy
    double yy


cdef inline Root root_of(double xx, double xy, double yy) noexcept nogil:
    """The symmetric square root of a covariance."""
    cdef double s = sqrt(max(xx * yy - xy * xy, 0.0)), t
    cdef Root out
    t = sqrt(xx + yy + 2.0 * s)
    out.xx, out.xy, out.yy = (xx + s) / t, xy / t, (yy + s) / t
    return out


cdef inline Root squared(Root a) noexcept nogil:
    cdef Root out
    out.xx, out.xy, out.yy = a.xx * a.xx + a.xy * a.xy, a.xy * (a.xx + a.yy), a.xy * a.xy + a.yy * a.yy
    return out


cdef inline Root inverse(Root a) noexcept nogil:
    cdef double d = a.xx * a.yy - a.xy * a.xy
    cdef Root out
    out.xx, out.xy, out.yy = a.yy / d, -a.xy / d, a.xx / d
    return out


cdef inline Root sum_of(Root a, Root b) noexcept nogil:
    cdef Root out
    out.xx, out.xy, out.yy = a.xx + b.xx, a.xy + b.xy, a.yy + b.yy
    return out


cdef inline Root middle_of(Root a, Root b) noexcept nogil:
    cdef Root out
    out.xx, out.xy, out.yy = 0.5 * (a.xx + b.xx), 0.5 * (a.xy + b.xy), 0.5 * (a.yy + b.yy)
    return out


cdef inline Root change_of(Root a, Root b) noexcept nogil:
    cdef Root out
    out.xx, out.xy, out.yy = b.xx - a.xx, b.xy - a.xy, b.yy - a.yy
    return out


cdef inline Root root_at(const double[:, :, ::1] covariance, Py_ssize_t i, Py_ssize_t k, double least) noexcept nogil:
    return root_of(covariance[i, k, 0] + least, covariance[i, k, 1], covariance[i, k, 2] + least)


cdef inline void product(Root a, Root b, double* out) noexcept nogil:
    """The product of two symmetric matrices, row by row."""
    out[0], out[1] = a.xx * b.xx + a.xy * b.xy, a.xx * b.xy + a.xy * b.yy
    out[2], out[3] = a.xy * b.xx + a.yy * b.xy, a.xy * b.xy + a.yy * b.yy


cdef inline double half_extent(double nx, double ny, double cosine, double sine, double length, double width) noexcept nogil:
    """Half of what an outline measures along a direction."""
    return 0.5 * (length * fabs(nx * cosine + ny * sine) + width * fabs(ny * cosine - nx * sine))


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
                        const double[:, ::1] lines,
                        const double[:, ::1] few_lines, const Py_ssize_t[::1] ends, double far_sigmas, double least_m2):
    cdef Py_ssize_t n_rows = x.shape[0], n_steps = x.shape[1] - 1, n_ends = ends.shape[0]
    out_array = np.zeros((n_rows, n_ends))
    cdef double[:, ::1] out = out_array
    cdef double* values = <double*> malloc(n_steps * N_AXES * N_VALUES * sizeof(double))
    cdef double* normals = <double*> malloc(n_steps * N_AXES * 2 * sizeof(double))
    cdef Root* roots = <Root*> malloc(n_steps * 4 * sizeof(Root))
    cdef Py_ssize_t* kept = <Py_ssize_t*> malloc(n_steps * sizeof(Py_ssize_t))
    cdef double* low = <double*> malloc(n_steps * sizeof(double))
    cdef double* high = <double*> malloc(n_steps * sizeof(double))
    cdef Py_ssize_t i, s, at, n_kept, nearest, line, end
    cdef const double[:, ::1] used
    cdef int axis, n
    cdef double mx, my, dx, dy, way, ch, sh, co, so, nx, ny, c, r, xx, xy, yy, apart, most, least, shifted, moved, turned, ahead_x = 1.0, ahead_y = 0.0
    cdef double cosine, sine, w1, w2, slope, one, two, lo, hi
    cdef double* value
    cdef Root host, other, both, across, host_begin, other_begin, host_next, other_next
    cdef double to_host[4]
    cdef double to_other[4]
    cdef double left_host[4]
    cdef double left_other[4]
    try:
        if not (values and normals and roots and kept and low and high):
            raise MemoryError
        with nogil:
            for i in range(n_rows):
                n_kept, nearest, least = 0, 0, far_sigmas
                for s in range(n_steps):
                    mx, my = 0.5 * (x[i, s] + x[i, s + 1]), 0.5 * (y[i, s] + y[i, s + 1])
                    dx, dy = x[i, s + 1] - x[i, s], y[i, s + 1] - y[i, s]
                    one = 0.5 * (host_heading[i, s] + host_heading[i, s + 1])
                    two = 0.5 * (other_heading[i, s] + other_heading[i, s + 1])
                    if s == 0:
                        host_next = root_at(host_covariance, i, s, least_m2)
                        other_next = root_at(other_covariance, i, s, least_m2)
                    host_begin, other_begin = host_next, other_next
                    host_next = root_at(host_covariance, i, s + 1, least_m2)
                    other_next = root_at(other_covariance, i, s + 1, least_m2)
                    host, other = middle_of(host_begin, host_next), middle_of(other_begin, other_next)
                    roots[4 * n_kept], roots[4 * n_kept + 1] = host, other
                    roots[4 * n_kept + 2] = change_of(host_begin, host_next)
                    roots[4 * n_kept + 3] = change_of(other_begin, other_next)
                    both = sum_of(squared(host), squared(other))
                    xx, xy, yy = both.xx, both.xy, both.yy
                    if isnan(mx + my + xx + xy + yy + one + two):
                        n_kept = -1
                        break
                    ch, sh, co, so = cos(one), sin(one), cos(two), sin(two)
                    way = hypot(dx, dy)
                    most = -1e300
                    for axis in range(N_AXES):
                        if axis == 4:
                            nx, ny = ch, sh
                        elif axis == 1:
                            nx, ny = -sh, ch
                        elif axis == 2:
                            nx, ny = co, so
                        elif axis == 3:
                            nx, ny = -so, co
                        elif way > STANDING_M:  # first: it tells most lines that they miss
                            nx, ny = -dy / way, dx / way
                        else:
                            nx, ny = -sh, ch
                        c = nx * mx + ny * my
                        moved = nx * dx + ny * dy
                        r = half_extent(nx, ny, ch, sh, host_length, host_width)
                        r += half_extent(nx, ny, co, so, other_length, other_width)
                        apart = (fabs(c) - r - 0.5 * fabs(moved)) / sqrt(xx * nx * nx + 2.0 * xy * nx * ny + yy * ny * ny)
                        most = max(most, apart)
                        normals[(n_kept * N_AXES + axis) * 2] = nx
                        normals[(n_kept * N_AXES + axis) * 2 + 1] = ny
                        values[(n_kept * N_AXES + axis) * N_VALUES] = c
                        values[(n_kept * N_AXES + axis) * N_VALUES + 1] = r
                        values[(n_kept * N_AXES + axis) * N_VALUES + 6] = moved
                    if most >= far_sigmas:
                        continue
                    if most < least:
                        nearest, least, ahead_x, ahead_y = n_kept, most, ch, sh
                    kept[n_kept] = s
                    n_kept += 1
                if n_kept < 0:
                    for end in range(n_ends):
                        out[i, end] = NAN
                if n_kept <= 0:
                    continue
                host, other = roots[4 * nearest], roots[4 * nearest + 1]
                both = sum_of(squared(host), squared(other))
                both = inverse(root_of(both.xx, both.xy, both.yy))
                product(host, both, to_host)
                product(other, both, to_other)
                host, other = inverse(host), inverse(other)
                across = sum_of(squared(host), squared(other))
                across = inverse(root_of(across.xx, across.xy, across.yy))
                product(host, across, left_host)
                product(other, across, left_other)
                shifted = 0.0
                for at in range(n_kept):
                    host, other = roots[4 * at], roots[4 * at + 1]
                    host_next, other_next = roots[4 * at + 2], roots[4 * at + 3]
                    for axis in range(N_AXES):
                        nx, ny = normals[(at * N_AXES + axis) * 2], normals[(at * N_AXES + axis) * 2 + 1]
                        value = values + (at * N_AXES + axis) * N_VALUES
                        xx, xy = nx * host.xx + ny * host.xy, nx * host.xy + ny * host.yy
                        one, two = nx * other.xx + ny * other.xy, nx * other.xy + ny * other.yy
                        value[2] = xx * to_host[0] + xy * to_host[2] + one * to_other[0] + two * to_other[2]
                        value[3] = xx * to_host[1] + xy * to_host[3] + one * to_other[1] + two * to_other[3]
                        value[4] = one * left_other[0] + two * left_other[2] - xx * left_host[0] - xy * left_host[2]
                        value[5] = one * left_other[1] + two * left_other[3] - xx * left_host[1] - xy * left_host[3]
                        xx, xy = nx * host_next.xx + ny * host_next.xy, nx * host_next.xy + ny * host_next.yy
                        one, two = nx * other_next.xx + ny * other_next.xy, nx * other_next.xy + ny * other_next.yy
                        value[7] = xx * to_host[0] + xy * to_host[2] + one * to_other[0] + two * to_other[2]
                        value[8] = xx * to_host[1] + xy * to_host[3] + one * to_other[1] + two * to_other[3]
                        value[9] = one * left_other[0] + two * left_other[2] - xx * left_host[0] - xy * left_host[2]
                        value[10] = one * left_other[1] + two * left_other[3] - xx * left_host[1] - xy * left_host[3]
                        one = value[4] * value[4] + value[5] * value[5]
                        shifted = max(shifted, one / (one + value[2] * value[2] + value[3] * value[3]))
                used = few_lines if shifted < ALIKE else lines
                for line in range(used.shape[0]):
                    cosine = ahead_x * used[line, 0] - ahead_y * used[line, 1]
                    sine = ahead_y * used[line, 0] + ahead_x * used[line, 1]
                    w1 = ahead_x * used[line, 2] - ahead_y * used[line, 3]
                    w2 = ahead_y * used[line, 2] + ahead_x * used[line, 3]
                    n, end = 0, 0
                    for at in range(n_kept):
                        while end < n_ends and kept[at] >= ends[end]:
                            out[i, end] += share_of(low, high, n)
                            end += 1
                        lo, hi = -1e300, 1e300
                        value = values + at * N_AXES * N_VALUES
                        for axis in range(N_AXES):
                            c = value[0] + value[4] * w1 + value[5] * w2
                            slope = value[2] * cosine + value[3] * sine
                            moved = 0.5 * (value[6] + value[9] * w1 + value[10] * w2)
                            turned = 0.5 * (value[7] * cosine + value[8] * sine)
                            if fabs(slope) < PARALLEL:
                                slope, turned = PARALLEL, 0.0
                            if fabs(turned) >= fabs(slope):
                                turned = 0.0
                            if (moved * slope - c * turned) * slope < 0.0:  # by which way it goes where the line is amid the slab
                                moved, turned = -moved, -turned
                            one, two = (-value[1] - c - moved) / (slope + turned), (value[1] - c + moved) / (slope - turned)
                            if slope < 0.0:
                                one, two = two, one
                            if one > lo:
                                lo = one
                            if two < hi:
                                hi = two
                            if lo > hi:
                                break
                            value += N_VALUES
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
                    out[i, end] /= used.shape[0]
    finally:
        free(values)
        free(normals)
        free(roots)
        free(kept)
        free(low)
        free(high)
    return out_array
