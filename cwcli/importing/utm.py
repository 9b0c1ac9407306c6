"""Places in UTM, the transverse Mercator grid in zones of six degrees, on the ellipsoid of WGS84."""

from __future__ import annotations

import re

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.signals.perceived import WGS84_EQUATOR_RADIUS_M, WGS84_FLATTENING

SCALE_AT_CENTRAL_MERIDIAN, FALSE_EASTING_M, FALSE_NORTHING_OF_SOUTH_M = 0.9996, 500_000.0, 10_000_000.0
"""Scale, easting of the central meridian in m, and northing of the equator in m for the south (DMA TM8358.2)."""
MAX_UTM_ZONE = 60
"""The number of zones, from 180 degrees west."""
IS_SOUTH_BY_FIRST_DIGITS_OF_UTM_EPSG_CODE = {326: False, 327: True, 258: False}
"""First digits of an EPSG code whose last two are the zone -> whether it is of the south: WGS84 north and south, and
ETRS89, which is as good as WGS84 for a car."""


def parse_utm_zone_or_none(text: str) -> tuple[int, bool] | None:
    """Return zone and whether it is of the south, of `utm33n`, `UTM 56S` or `EPSG:32633`; None for anything else."""
    named = re.fullmatch(r"utm[ _-]?(\d{1,2})[ _-]?([ns])", text.strip().lower())
    coded = re.fullmatch(r"epsg:(\d{3})(\d{2})", text.strip().lower())
    if named:
        zone, is_south = int(named[1]), named[2] == "s"
    elif coded and int(coded[1]) in IS_SOUTH_BY_FIRST_DIGITS_OF_UTM_EPSG_CODE:
        zone, is_south = int(coded[2]), IS_SOUTH_BY_FIRST_DIGITS_OF_UTM_EPSG_CODE[int(coded[1])]
    else:
        return None
    return (zone, is_south) if 1 <= zone <= MAX_UTM_ZONE else None


def geographic_of_utm_deg(
    easting_m: FloatArray, northing_m: FloatArray, zone: int, is_south: bool
) -> tuple[FloatArray, FloatArray]:
    """Return latitudes and longitudes (n,) in degrees of places in a zone.

    By Krueger's series to the third order of the third flattening (Karney 2011, J. Geodesy 85, eq. 15, 36 and 19 to
    21): a millimeter within the zone.
    """
    n = WGS84_FLATTENING / (2.0 - WGS84_FLATTENING)
    radius_m = WGS84_EQUATOR_RADIUS_M / (1.0 + n) * (1.0 + n**2 / 4.0 + n**4 / 64.0)
    betas = (
        n / 2.0 - 2.0 / 3.0 * n**2 + 37.0 / 96.0 * n**3,
        n**2 / 48.0 + n**3 / 15.0,
        17.0 / 480.0 * n**3,
    )
    scale_m = SCALE_AT_CENTRAL_MERIDIAN * radius_m
    xi = (northing_m - (FALSE_NORTHING_OF_SOUTH_M if is_south else 0.0)) / scale_m
    eta = (easting_m - FALSE_EASTING_M) / scale_m
    xi_sphere, eta_sphere = xi.copy(), eta.copy()
    for k, beta in enumerate(betas, 1):
        xi_sphere -= beta * np.sin(2 * k * xi) * np.cosh(2 * k * eta)
        eta_sphere -= beta * np.cos(2 * k * xi) * np.sinh(2 * k * eta)
    tangent_of_conformal = np.sin(xi_sphere) / np.hypot(np.sinh(eta_sphere), np.cos(xi_sphere))
    eccentricity = np.sqrt(WGS84_FLATTENING * (2.0 - WGS84_FLATTENING))
    tangent = tangent_of_conformal / (1.0 - eccentricity**2)
    for _ in range(5):  # Newton's method, which doubles the digits
        root = np.hypot(1.0, tangent)
        sigma = np.sinh(eccentricity * np.arctanh(eccentricity * tangent / root))
        conformal = tangent * np.hypot(1.0, sigma) - sigma * root
        slope = (1.0 - eccentricity**2) * np.hypot(1.0, conformal) * root / (1.0 + (1.0 - eccentricity**2) * tangent**2)
        tangent = tangent + (tangent_of_conformal - conformal) / slope
    longitude_deg = np.degrees(np.arctan2(np.sinh(eta_sphere), np.cos(xi_sphere))) + 6.0 * zone - 183.0
    return np.degrees(np.arctan(tangent)), longitude_deg
