"""The local map: east-north-up about an origin on the WGS84 ellipsoid.

The transformation is the geographic-to-topocentric one (EPSG method 9837), exact up to rounding at any distance; it is
not a map projection, so distances near the origin are not scaled. A kernel computes it, because importing PROJ takes as
long as importing NumPy; tests/unit/signals/test_geodesy.py compares every bit with PROJ's.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from cwcli.errors import UsageError
from cwcli.kernels.geodesy import TangentPlane
from cwcli.signals.columns import EastNorthUpColumns, FloatArray, LatLonAlt, LatLonAltColumns


class LocalMap:
    """A plane tangent to the WGS84 ellipsoid at an origin: x east, y north, z up, in metres.

    Attributes:
        origin_lat_deg, origin_lon_deg: WGS84, degrees.
        origin_alt_m: Height above the ellipsoid, metres.
    """

    def __init__(self, origin_lat_deg: float, origin_lon_deg: float, origin_alt_m: float = 0.0) -> None:
        """Set the origin.

        Raises:
            ValueError: When the origin is not a finite place on the ellipsoid. An altitude of NaN becomes 0.
        """
        if not (abs(origin_lat_deg) <= 90.0 and abs(origin_lon_deg) <= 180.0):  # also False for NaN
            raise ValueError(f"not a place on the ellipsoid: latitude {origin_lat_deg}, longitude {origin_lon_deg}")
        self.origin_lat_deg = float(origin_lat_deg)
        self.origin_lon_deg = float(origin_lon_deg)
        self.origin_alt_m = float(origin_alt_m) if np.isfinite(origin_alt_m) else 0.0

    def __repr__(self) -> str:
        return f"LocalMap({self.origin_lat_deg!r}, {self.origin_lon_deg!r}, {self.origin_alt_m!r})"

    def __reduce__(self) -> tuple[type[LocalMap], tuple[float, float, float]]:
        """What makes an equal one: a pickle and a copy hold the origin alone."""
        return LocalMap, (self.origin_lat_deg, self.origin_lon_deg, self.origin_alt_m)

    @cached_property
    def _tangent_plane(self) -> TangentPlane:
        return TangentPlane(self.origin_lat_deg, self.origin_lon_deg, self.origin_alt_m)

    def map_from_wgs84(self, lat_deg: FloatArray, lon_deg: FloatArray, alt_m: FloatArray) -> EastNorthUpColumns:
        """Place WGS84 positions on the map.

        Args:
            lat_deg, lon_deg: Shape (n,), degrees.
            alt_m: Shape (n,), metres above the ellipsoid. Where it is NaN the origin's is assumed and z is NaN.

        Returns:
            x (east), y (north), z (up), each of shape (n,), metres. NaN where latitude or longitude is not finite.
        """
        has_alt = np.isfinite(alt_m)
        x_m, y_m, z_m = self._transform_points(
            lon_deg, lat_deg, np.where(has_alt, alt_m, self.origin_alt_m), inverse=False
        )
        return x_m, y_m, np.where(has_alt, z_m, np.nan)

    def wgs84_from_map(self, x_m: FloatArray, y_m: FloatArray, z_m: FloatArray) -> LatLonAltColumns:
        """The inverse of `map_from_wgs84`.

        Args:
            x_m, y_m, z_m: Shape (n,), metres. Where z is NaN, 0 is assumed and the altitude is NaN.

        Returns:
            Latitude (degrees), longitude (degrees), altitude (metres), each of shape (n,).
        """
        has_z = np.isfinite(z_m)
        lon_deg, lat_deg, alt_m = self._transform_points(x_m, y_m, np.where(has_z, z_m, 0.0), inverse=True)
        return lat_deg, lon_deg, np.where(has_z, alt_m, np.nan)

    def _transform_points(
        self,
        first_coordinate: FloatArray,
        second_coordinate: FloatArray,
        third_coordinate: FloatArray,
        *,
        inverse: bool,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        first_coordinate, second_coordinate, third_coordinate = (
            np.array(values, dtype=np.float64)
            for values in np.broadcast_arrays(first_coordinate, second_coordinate, third_coordinate)
        )
        is_finite = np.isfinite(first_coordinate) & np.isfinite(second_coordinate)
        transform = self._tangent_plane.inverse if inverse else self._tangent_plane.forward
        result = transform(
            first_coordinate.reshape(-1), second_coordinate.reshape(-1), third_coordinate.reshape(-1)
        ).reshape(3, *first_coordinate.shape)
        first, second, third = (np.where(is_finite, values, np.nan) for values in result)
        return first, second, third


def parse_truth_origin(text: str) -> LatLonAlt:
    """Parse `LAT,LON,ALT` in degrees and metres.

    Raises:
        UsageError: It is not three numbers in range.
    """
    try:
        latitude_deg, longitude_deg, altitude_m = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"--truth-origin {text!r} is not LAT,LON,ALT") from None
    if not (abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180 and math.isfinite(altitude_m)):
        raise UsageError(f"--truth-origin {text!r} is not on the earth")
    return latitude_deg, longitude_deg, altitude_m
