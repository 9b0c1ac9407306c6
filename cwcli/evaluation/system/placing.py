"""Placement of another system's frame in the map: a rotation and a shift, fitted to the ego's track."""

from __future__ import annotations

import math

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import EastNorthRows, FloatArray

MIN_RMS_EXTENT_FOR_ROTATION_M = 5.0
"""Least RMS distance of the points from their mean, m, for which a rotation is fitted. Chosen by hand; not fitted."""
MIN_POINTS_FOR_PLACEMENT = 3
"""Least number of points for a fit."""


@dataclass(frozen=True)
class FramePlacement:
    """Transformation of another frame to the map.

    Attributes:
        turn_rad: Heading of the frame's x axis in the map, counter-clockwise from east.
        pivot_m: Shape (2,): a point in the frame.
        place_m: Shape (2,): the same point in the map.
    """

    turn_rad: float
    pivot_m: FloatArray
    place_m: FloatArray

    def points_in_map_m(self, xy_m: EastNorthRows) -> FloatArray:
        """Transform points (n, 2), m, to the map."""
        cosine, sine = math.cos(self.turn_rad), math.sin(self.turn_rad)
        return np.asarray((xy_m - self.pivot_m) @ np.array([[cosine, sine], [-sine, cosine]]) + self.place_m)

    def headings_in_map_rad(self, yaw_rad: FloatArray) -> FloatArray:
        """Transform yaw angles (n,) to headings in the map."""
        return np.asarray(wrap_angle(yaw_rad + self.turn_rad))

    def placement_note(self, topic: str, frame: str) -> str:
        """Return a note for the user on the fitted rotation and shift."""
        origin = self.points_in_map_m(np.zeros((1, 2)))[0]
        named = f"its frame {frame}" if frame else "its frame"
        return (
            f"{topic}: {named} was aligned with the track by a rotation of {math.degrees(self.turn_rad):.2f} deg and "
            f"a shift of ({origin[0]:.2f}, {origin[1]:.2f}) m; a constant error of these does not show"
        )


def fit_frame_placement(xy_m: EastNorthRows, onto_m: EastNorthRows) -> FramePlacement | None:
    """Fit the placement that moves points (n, 2) onto others; rows with NaN are ignored; None with fewer than three.

    The rotation is that of least squares (Umeyama 1991, eq. 40 to 42, in the plane, without a scale); the shift is the
    median, which a jump does not affect.
    """
    known = np.isfinite(xy_m).all(axis=1) & np.isfinite(onto_m).all(axis=1)
    if int(known.sum()) < MIN_POINTS_FOR_PLACEMENT:
        return None
    own, theirs = xy_m[known], onto_m[known]
    middle = own.mean(axis=0)
    own_from_middle, target = own - middle, theirs - theirs.mean(axis=0)
    turn_rad = 0.0
    if math.sqrt(float((own_from_middle**2).sum(axis=1).mean())) >= MIN_RMS_EXTENT_FOR_ROTATION_M:
        cross = float((own_from_middle[:, 0] * target[:, 1] - own_from_middle[:, 1] * target[:, 0]).sum())
        turn_rad = math.atan2(cross, float((own_from_middle * target).sum()))
    turned_points = FramePlacement(turn_rad, middle, np.zeros(2)).points_in_map_m(own)
    return FramePlacement(turn_rad, middle, np.median(theirs - turned_points, axis=0))
