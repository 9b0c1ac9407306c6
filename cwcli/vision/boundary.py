"""One lane boundary in the image (zhang2011, eq. 1).

Coordinates of a search image of `height_px` rows: pixels are numbered from 1 at the bottom left, x to the right, y up,
so the centre of the pixel in column u and row v (from 0 at the top left, as in NumPy and OpenCV) has x = u + 1 and
y = height_px - v.
"""

from __future__ import annotations

from dataclasses import replace
from enum import IntEnum
from math import isfinite, nan

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray


class LineKind(IntEnum):
    """Kind of the paint along a boundary: `cwcli.v1.LaneBoundary.Kind`."""

    UNKNOWN = 0
    SOLID = 1
    DASHED = 2
    DOTS = 3
    DOUBLE = 4


class LineColour(IntEnum):
    """Colour of the paint along a boundary: `cwcli.v1.LaneBoundary.Colour`."""

    UNKNOWN = 0
    WHITE = 1
    YELLOW = 2


@dataclass(frozen=True)
class Boundary:
    """One boundary as x = a y^2 + b y + c in the pixels of the search image (eq. 1).

    Attributes:
        a: 1/pixel; positive bends to the right.
        b: Slope at the bottom.
        c: Foot, pixels.
        score: Value of the method's objective, in grey levels where it is zhang2011's.
        probability: That this is a boundary, 0 to 1; NaN if the method makes no such statement.
        found: Whether the method says that there is a boundary.
        covariance: Shape (3, 3) of (a, b, c); None if the method gives none: then the camera geometry assumes one.
        kind, colour: Kind and colour of the paint, as far as the frames show them.
    """

    a: float
    b: float
    c: float
    score: float
    probability: float
    found: bool
    covariance: FloatArray | None = None
    kind: LineKind = LineKind.UNKNOWN
    colour: LineColour = LineColour.UNKNOWN

    def x_px(self, y_px: FloatArray) -> FloatArray:
        """Columns x of the boundary at heights y, both in the pixels of the search image."""
        return (self.a * y_px + self.b) * y_px + self.c


BOUNDARY_NOT_FOUND = Boundary(nan, nan, nan, nan, nan, False)
"""The boundary of a frame in which none was found: its numbers are NaN."""


def replace_parabola_of_boundary(boundary: Boundary, a_per_px: float, b_slope: float, c_px: float) -> Boundary:
    """The boundary with another parabola; one that was not found, or has no parabola now, stays or becomes so."""
    found = boundary.found and isfinite(a_per_px) and isfinite(b_slope) and isfinite(c_px)
    replaced = replace(boundary, a=a_per_px, b=b_slope, c=c_px, found=found)
    return replaced if found else replace(replaced, kind=LineKind.UNKNOWN, colour=LineColour.UNKNOWN)
