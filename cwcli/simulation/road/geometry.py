"""The road ahead of the camera: lines parallel to the lane's centre, and the distance that each image row shows.

Body frame: x forward, y left, z up. Offsets from the lane's centre line are positive to the left; one that is an array
has a value for each arc length of `ARC_LENGTH_GRID_M`. The surface is a cylinder z = g x^2 / 2 across the driving
direction (a crest has g < 0, a sag g > 0), so each row shows one distance.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.camera import RoadCamera

ARC_LENGTH_GRID_M: FloatArray = np.concatenate(
    [np.arange(-2.0, 40.0, 0.5), np.arange(40.0, 120.0, 1.0), np.arange(120.0, 421.0, 3.0)]
)
"""Arc lengths ahead at which curves are computed, shape (k,), m. Between them a chord errs by less than 0.1 mm in the
first 40 m at a radius of 300 m: below 0.02 pixel."""
DISTANCE_AHEAD_OF_ROAD_SURFACE_END_M = 400.0
"""Distance ahead at which the road's surface ends, m. Chosen by hand; not fitted."""
MAX_SEEN_ROAD_DIRECTION_RAD = np.radians(75.0)
"""Angle from the camera's axis at which the road has turned away and is no longer seen, rad. Chosen by hand; not
fitted."""


@dataclass(frozen=True)
class RoadAhead:
    """The lane's centre line in the body frame.

    Attributes:
        curvature_1pm: Shape (k,): at the grid's arc lengths from the point beside the camera, left positive.
        offset_m: Offset of the camera from the lane's centre, left positive.
        heading_rad: Heading of the body from the lane's direction at that point, counter-clockwise positive.
        vertical_1pm: Vertical curvature g of the surface (above).
        station_m: Arc length of the point beside the camera along the road, which fixes dashes and texture.
        bearing_rad: Heading of the body from the start of a drive, counter-clockwise, which moves the skyline.
    """

    curvature_1pm: FloatArray
    offset_m: float
    heading_rad: float
    vertical_1pm: float = 0.0
    station_m: float = 0.0
    bearing_rad: float = 0.0

    @cached_property
    def direction_rad(self) -> FloatArray:
        """The direction of the centre line in the body frame at the grid's arc lengths, shape (k,), rad."""
        steps = np.diff(ARC_LENGTH_GRID_M) * (self.curvature_1pm[1:] + self.curvature_1pm[:-1]) / 2
        direction = np.concatenate([[0.0], np.cumsum(steps)])
        return np.asarray(direction - np.interp(0.0, ARC_LENGTH_GRID_M, direction) - self.heading_rad)

    @cached_property
    def centre_line_m(self) -> tuple[FloatArray, FloatArray]:
        """x and y of the centre line at the grid's arc lengths, (k,) each, m. The curve is a chain of short arcs."""
        direction = self.direction_rad
        middle = (direction[1:] + direction[:-1]) / 2
        turn = direction[1:] - direction[:-1]
        chord = np.diff(ARC_LENGTH_GRID_M) * np.sinc(turn / (2 * np.pi))
        x = np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))])
        y = np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))])
        at = int(np.searchsorted(ARC_LENGTH_GRID_M, 0.0))
        start_x, start_y = x[at], y[at]
        heading = direction[at]
        return (
            np.asarray(x - start_x + self.offset_m * np.sin(heading)),
            np.asarray(y - start_y - self.offset_m * np.cos(heading)),
        )

    def line_at_offset_m(self, offset_m: float | FloatArray) -> tuple[FloatArray, FloatArray]:
        """x and y of the line at an offset from the lane's centre, at the grid's arc lengths, (k,) each, m."""
        x, y = self.centre_line_m
        return x - offset_m * np.sin(self.direction_rad), y + offset_m * np.cos(self.direction_rad)

    @cached_property
    def n_grid_points_ahead(self) -> int:
        """The number of grid points before the road turns away from the camera (75 deg)."""
        far_points = np.flatnonzero(np.abs(self.direction_rad) > MAX_SEEN_ROAD_DIRECTION_RAD)
        return int(far_points[0]) if len(far_points) else len(ARC_LENGTH_GRID_M)

    def line_y_at_distance_m(self, offset_m: float | FloatArray, x_m: FloatArray) -> FloatArray:
        """y of the line at an offset, at distances ahead, m; NaN outside the road."""
        x, y = (values[: self.n_grid_points_ahead] for values in self.line_at_offset_m(offset_m))
        return np.interp(x_m, x, y, left=np.nan, right=np.nan)

    def line_station_at_distance_m(self, offset_m: float | FloatArray, x_m: FloatArray) -> FloatArray:
        """Station of the line at an offset, at distances ahead, m: arc length of the centre line beside the point."""
        x = self.line_at_offset_m(offset_m)[0][: self.n_grid_points_ahead]
        return np.interp(x_m, x, ARC_LENGTH_GRID_M[: self.n_grid_points_ahead]) + self.station_m

    def pose_at_arc_length(self, s_m: float, offset_m: float) -> tuple[float, float, float]:
        """x, y (m) and direction (rad) of the point s_m ahead along the lane, offset_m to its left."""
        x, y = self.line_at_offset_m(offset_m)
        return tuple(float(np.interp(s_m, ARC_LENGTH_GRID_M, values)) for values in (x, y, self.direction_rad))  # type: ignore[return-value]

    def surface_height_at_distance_m(self, x_m: FloatArray) -> FloatArray:
        """Height of the surface at distances ahead, m."""
        return self.vertical_1pm * np.asarray(x_m) ** 2 / 2

    def distance_of_rows_m(self, camera: RoadCamera, v_px: FloatArray) -> FloatArray:
        """Distance ahead of the nearest road point on each row, m; NaN where the row meets none within 400 m.

        From h - g x^2 / 2 = m x with m the ray's fall: x = 2 h / (m + sqrt(m^2 + 2 g h)).
        """
        m = camera.downward_slope_of_rows(v_px)
        under = m * m + 2 * self.vertical_1pm * camera.height_m
        with np.errstate(invalid="ignore", divide="ignore"):
            bottom = m + np.sqrt(np.where(under >= 0, under, np.nan))
            x = 2 * camera.height_m / np.where(bottom > 0, bottom, np.nan)
        return np.where(x <= DISTANCE_AHEAD_OF_ROAD_SURFACE_END_M, x, np.nan)

    def line_column_at_distance_px(
        self, camera: RoadCamera, offset_m: float | FloatArray, x_m: FloatArray
    ) -> FloatArray:
        """Image column of the line at an offset, at distances ahead, px; NaN outside the road."""
        depth = camera.depth_along_optical_axis_m(x_m, camera.height_m - self.surface_height_at_distance_m(x_m))
        return np.asarray(camera.cx - camera.fx * self.line_y_at_distance_m(offset_m, x_m) / depth)
