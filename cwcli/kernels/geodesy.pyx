# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""WGS84 positions to and from a local tangent plane; see geodesy.pyi.

Forward by the geocentric coordinates of Hofmann-Wellenhof and Moritz (2005), eq. 5-27, and the topocentric rotation of
IOGP 373-7-2 (EPSG methods 9602 and 9837); back by Bowring's (1976) single step, which is exact to a nanometre near the
ground. The operations stand in the order in which PROJ 9 has them, so that the numbers are PROJ's to the last bit.
"""

from libc.math cimport M_PI, asin, atan, atan2, cos, fabs, floor, fmax, fmin, sin, sqrt, tan

import numpy as np

cdef double A = 6378137.0  # WGS84's semi-major axis in metres
cdef double F = 1.0 / 298.257223563  # its flattening
cdef double ES = 2.0 * F - F * F  # its first eccentricity squared
cdef double E2S = tan(asin(sqrt(ES))) * tan(asin(sqrt(ES)))  # its second eccentricity squared
cdef double B_BY_A = 1.0 - F
cdef double RAD_PER_DEG = 0.017453292519943296
cdef double MAX_PHI = 0.5 * M_PI + 1e-12  # greatest latitude in radians that rounding may give a pole
cdef double MAX_LAM = 10.0  # greatest longitude in radians that is taken: more is no angle but a mistake
cdef double LEAST_COS_PHI = 1e-6  # of a latitude where the height is taken along the axis instead of across it
cdef double INF = float("inf")


cdef inline double normal_radius(double sin_phi) noexcept nogil:
    return A / sqrt(1.0 - ES * sin_phi * sin_phi)


cdef inline void to_geocentric(double lam, double phi, double h, double* xyz) noexcept nogil:
    cdef double cos_phi = cos(phi), sin_phi = sin(phi)
    cdef double n = normal_radius(sin_phi)
    xyz[0] = (n + h) * cos_phi * cos(lam)
    xyz[1] = (n + h) * cos_phi * sin(lam)
    xyz[2] = (n * (1.0 - ES) + h) * sin_phi


cdef inline double wrap(double lam) noexcept nogil:
    """Longitude within one turn."""
    if fabs(lam) <= M_PI:
        return lam
    lam += M_PI
    lam -= 2.0 * M_PI * floor(lam / (2.0 * M_PI))
    return lam - M_PI


cdef void to_geodetic(const double* xyz, double* lam_phi_h) noexcept nogil:
    cdef double x = xyz[0] * (1.0 / A), y = xyz[1] * (1.0 / A), z = xyz[2] * (1.0 / A)
    cdef double p = sqrt(x * x + y * y), p_b = p * B_BY_A
    cdef double norm = sqrt(z * z + p_b * p_b), c = 1.0, s = 0.0, inverse
    if norm != 0.0:
        inverse = 1.0 / norm
        c, s = p_b * inverse, z * inverse
    cdef double y_phi = z + E2S * B_BY_A * s * s * s, x_phi = p - ES * c * c * c
    cdef double norm_phi = sqrt(y_phi * y_phi + x_phi * x_phi), cos_phi = 1.0, sin_phi = 0.0
    if norm_phi != 0.0:
        inverse = 1.0 / norm_phi
        cos_phi, sin_phi = x_phi * inverse, y_phi * inverse
    if x_phi <= 0.0:  # at the centre of the earth
        cos_phi, sin_phi = 0.0, 1.0 if xyz[2] >= 0.0 else -1.0
        lam_phi_h[1] = 0.5 * M_PI * sin_phi
    else:
        lam_phi_h[1] = atan(y_phi / x_phi)
    lam_phi_h[0] = atan2(y, x)
    if cos_phi < LEAST_COS_PHI:
        c, s = cos_phi * cos_phi, B_BY_A * B_BY_A * (sin_phi * sin_phi)
        lam_phi_h[2] = fabs(xyz[2]) - A * sqrt((c + B_BY_A * B_BY_A * s) / (c + s))
    else:
        lam_phi_h[2] = A * p / cos_phi - normal_radius(sin_phi)


cdef class TangentPlane:
    cdef double origin[3]
    cdef double sin_phi, cos_phi, sin_lam, cos_lam

    def __cinit__(self, double lat_deg, double lon_deg, double alt_m):
        cdef double phi = lat_deg * RAD_PER_DEG, lam = lon_deg * RAD_PER_DEG
        to_geocentric(lam, phi, alt_m, self.origin)
        self.sin_phi, self.cos_phi, self.sin_lam, self.cos_lam = sin(phi), cos(phi), sin(lam), cos(lam)

    def forward(self, const double[::1] lon_deg, const double[::1] lat_deg, const double[::1] alt_m):
        cdef Py_ssize_t n = lon_deg.shape[0], i
        out_array = np.empty((3, n))
        cdef double[:, ::1] out = out_array
        cdef double xyz[3]
        cdef double lam, phi, dx, dy, dz
        with nogil:
            for i in range(n):
                lam, phi = lon_deg[i] * RAD_PER_DEG, lat_deg[i] * RAD_PER_DEG
                if not (fabs(phi) <= MAX_PHI and fabs(lam) <= MAX_LAM):
                    out[0, i] = out[1, i] = out[2, i] = INF
                    continue
                phi = fmin(fmax(phi, -0.5 * M_PI), 0.5 * M_PI)
                to_geocentric(wrap(lam), phi, alt_m[i], xyz)
                dx, dy, dz = xyz[0] - self.origin[0], xyz[1] - self.origin[1], xyz[2] - self.origin[2]
                out[0, i] = -dx * self.sin_lam + dy * self.cos_lam
                out[1, i] = -dx * self.sin_phi * self.cos_lam - dy * self.sin_phi * self.sin_lam + dz * self.cos_phi
                out[2, i] = dx * self.cos_phi * self.cos_lam + dy * self.cos_phi * self.sin_lam + dz * self.sin_phi
        return out_array

    def inverse(self, const double[::1] x_m, const double[::1] y_m, const double[::1] z_m):
        cdef Py_ssize_t n = x_m.shape[0], i
        out_array = np.empty((3, n))
        cdef double[:, ::1] out = out_array
        cdef double xyz[3]
        cdef double place[3]
        with nogil:
            for i in range(n):
                xyz[0] = (self.origin[0] - x_m[i] * self.sin_lam - y_m[i] * self.sin_phi * self.cos_lam
                          + z_m[i] * self.cos_phi * self.cos_lam)
                xyz[1] = (self.origin[1] + x_m[i] * self.cos_lam - y_m[i] * self.sin_phi * self.sin_lam
                          + z_m[i] * self.cos_phi * self.sin_lam)
                xyz[2] = self.origin[2] + y_m[i] * self.cos_phi + z_m[i] * self.sin_phi
                to_geodetic(xyz, place)
                out[0, i] = place[0] / RAD_PER_DEG
                out[1, i] = place[1] / RAD_PER_DEG
                out[2, i] = place[2]
        return out_array
