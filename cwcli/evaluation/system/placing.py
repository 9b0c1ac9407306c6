"""Where another system's coordinates lie in the map: a turn and a shift, found from where the ego was."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray

MIN_EXTENT_M = 5.0
"""RMS distance from their middle of the points from which a turn can be found; nearer together, none is."""
MIN_POINTS = 3


@dataclass(frozen=True)
class Placing:
    """From another frame to the map.

    Attributes:
        turn_rad: Heading of the frame's x axis in the map, counter-clockwise from east.
        pivot_m: Shape (2,): a point of the frame.
        place_m: Shape (2,): where it is in the map.
    """

    turn_rad: float
    pivot_m: FloatArray
    place_m: FloatArray

    def xy(self, xy_m: FloatArray) -> FloatArray:
        """Points (n, 2) in the map."""
        cosine, sine = math.cos(self.turn_rad), math.sin(self.turn_rad)
        return np.asarray((xy_m - self.pivot_m) @ np.array([[cosine, sine], [-sine, cosine]]) + self.place_m)

    def heading(self, yaw_rad: FloatArray) -> FloatArray:
        """Headings (n,) in the map."""
        return np.asarray(wrap_angle(yaw_rad + self.turn_rad))

    def note(self, topic: str, frame: str) -> str:
        """What was done, for the user."""
        origin = self.xy(np.zeros((1, 2)))[0]
        named = f"its frame {frame}" if frame else "its frame"
        return (
            f"{topic}: {named} was laid onto the track by a turn of {math.degrees(self.turn_rad):.2f} deg and a shift "
            f"of ({origin[0]:.2f}, {origin[1]:.2f}) m; a constant error of these does not show"
        )


def fitted(xy_m: FloatArray, onto_m: FloatArray) -> Placing | None:
    """The placing that lays points (n, 2) onto others, rows with NaN left out; None with fewer than three.

    The turn is that of least squares (Umeyama 1991, eq. 40 to 42, in the plane, without a scale); the shift is the
    median, so that a jump of either moves nothing.
    """
    known = np.isfinite(xy_m).all(axis=1) & np.isfinite(onto_m).all(axis=1)
    if int(known.sum()) < MIN_POINTS:
        return None
    own, theirs = xy_m[known], onto_m[known]
    middle = own.mean(axis=0)
    apart, target = own - middle, theirs - theirs.mean(axis=0)
    turn_rad = 0.0
    if math.sqrt(float((apart**2).sum(axis=1).mean())) >= MIN_EXTENT_M:
        cross = float((apart[:, 0] * target[:, 1] - apart[:, 1] * target[:, 0]).sum())
        turn_rad = math.atan2(cross, float((apart * target).sum()))
    turned = Placing(turn_rad, middle, np.zeros(2)).xy(own)
    return Placing(turn_rad, middle, np.median(theirs - turned, axis=0))
