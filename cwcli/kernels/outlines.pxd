# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""How far two rectangles are apart on their edge directions."""

from libc.math cimport fabs


cdef inline double separation_m(double x, double y, double cos_host, double sin_host, double cos_other,
                                double sin_other, const double* host, const double* other) noexcept nogil:
    """The largest separation over the four edge directions: `cwcli.measures.outlines.outline_separation_by_directions_m`.

    `host` and `other` are length and width.
    """
    cdef double cosine = fabs(cos_host * cos_other + sin_host * sin_other)
    cdef double sine = fabs(cos_host * sin_other - sin_host * cos_other)
    cdef double own = max(
        fabs(x * cos_host + y * sin_host) - 0.5 * (host[0] + other[0] * cosine + other[1] * sine),
        fabs(y * cos_host - x * sin_host) - 0.5 * (host[1] + other[0] * sine + other[1] * cosine))
    cdef double theirs = max(
        fabs(x * cos_other + y * sin_other) - 0.5 * (other[0] + host[0] * cosine + host[1] * sine),
        fabs(y * cos_other - x * sin_other) - 0.5 * (other[1] + host[0] * sine + host[1] * cosine))
    return max(own, theirs)
