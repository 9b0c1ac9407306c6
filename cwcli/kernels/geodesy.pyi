import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]

class TangentPlane:
    """The plane tangent to the WGS84 ellipsoid at a place: x east, y north, z up, in metres."""

    def __init__(self, lat_deg: float, lon_deg: float, alt_m: float) -> None:
        """Set the origin: degrees, and metres above the ellipsoid, all finite and in range."""

    def forward(self, lon_deg: _F, lat_deg: _F, alt_m: _F) -> _F:
        """Positions on the plane, shape (3, n): x, y, z in metres.

        Args:
            lon_deg, lat_deg: (n,): degrees.
            alt_m: (n,): metres above the ellipsoid.

        Infinite where the latitude lies beyond a pole or the longitude beyond 10 rad, which are no places.
        """

    def inverse(self, x_m: _F, y_m: _F, z_m: _F) -> _F:
        """Longitude and latitude in degrees and height above the ellipsoid in metres, shape (3, n), of (n,) each."""
