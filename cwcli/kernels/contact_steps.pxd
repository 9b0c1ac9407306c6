# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Roots of covariances, and which points of two uncertain paths a straight line can stand for."""

from libc.math cimport cos, exp, fabs, hypot, sin, sqrt

cdef enum:
    TURNED = 2  # what corners may be off, as a multiple of what the centre may be off the straight line
    BENT = 2  # the part of that by which the errors' roots may be
    GROWN = 20  # how much these may grow: a long step takes them for too wide
    MOST = 3  # sigmas: what is farther off counts as if it were there


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


cdef inline double line_off_m2(const double* a, const double* b, const double* q, double share) noexcept nogil:
    """How far a value at a share of the way is from the straight line between two, squared."""
    cdef double d = q[0] - a[0] - share * (b[0] - a[0])
    return d * d


cdef inline double root_off_m2(const Root* a, const Root* b, const Root* q, double share) noexcept nogil:
    return (line_off_m2(&a.xx, &b.xx, &q.xx, share) + 2.0 * line_off_m2(&a.xy, &b.xy, &q.xy, share)
            + line_off_m2(&a.yy, &b.yy, &q.yy, share))


cdef struct Outlines:
    double host_length, host_width, other_length, other_width


cdef inline double gap_sigmas(double one, double two, double reach, double variance_m2) noexcept nogil:
    """The least gap on the way from one place along a direction to another, in sigmas."""
    cdef double least = 0.0 if one * two <= 0.0 else min(fabs(one), fabs(two))
    return max(least - reach, 0.0) / sqrt(variance_m2)


cdef inline bint is_straight(Py_ssize_t a, Py_ssize_t b, Py_ssize_t at, const double* x, const double* y,
                      const double* host_heading, const double* other_heading, const Root* hosts, const Root* others,
                      const Outlines* outlines, double sigmas) noexcept nogil:
    """Whether at a point between two others all is as near to a straight line as a probability needs.

    What is off the line counts in the least sigma there, and by the density of the errors at the outlines' gap.
    """
    cdef double share = (at - a) / <double> (b - a), cosine = cos(host_heading[at]), sine = sin(host_heading[at])
    cdef double turn = other_heading[at] - host_heading[at], cos_turn = fabs(cos(turn)), sin_turn = fabs(sin(turn))
    cdef Root both = sum_of(squared(hosts[at]), squared(others[at]))
    cdef double bound_m2 = sigmas * sigmas * (both.xx * both.yy - both.xy * both.xy) / (both.xx + both.yy)
    cdef double bent_m2, grown_m2, off_m2, turned_m, ahead, left, gap
    turned_m = 0.5 * hypot(outlines.host_length, outlines.host_width) * fabs(
        host_heading[at] - 0.5 * (host_heading[a] + host_heading[b]))
    turned_m += 0.5 * hypot(outlines.other_length, outlines.other_width) * fabs(
        other_heading[at] - 0.5 * (other_heading[a] + other_heading[b]))
    bent_m2 = root_off_m2(hosts + a, hosts + b, hosts + at, share) + root_off_m2(others + a, others + b, others + at, share)
    grown_m2 = root_off_m2(hosts + a, hosts + a, hosts + b, 0.0) + root_off_m2(others + a, others + a, others + b, 0.0)
    off_m2 = line_off_m2(x + a, x + b, x + at, share) + line_off_m2(y + a, y + b, y + at, share)
    off_m2 = max(max(off_m2, turned_m * turned_m / (TURNED * TURNED)),
                 max(bent_m2 * (BENT * BENT), grown_m2 / (GROWN * GROWN)))
    ahead = gap_sigmas(
        cosine * x[a] + sine * y[a], cosine * x[b] + sine * y[b],
        0.5 * (outlines.host_length + outlines.other_length * cos_turn + outlines.other_width * sin_turn),
        both.xx * cosine * cosine + 2.0 * both.xy * cosine * sine + both.yy * sine * sine)
    left = gap_sigmas(
        cosine * y[a] - sine * x[a], cosine * y[b] - sine * x[b],
        0.5 * (outlines.host_width + outlines.other_length * sin_turn + outlines.other_width * cos_turn),
        both.xx * sine * sine - 2.0 * both.xy * cosine * sine + both.yy * cosine * cosine)
    gap = min(max(ahead, left), <double> MOST)
    return off_m2 <= bound_m2 * exp(gap * gap)
