"""A road of constant curvature in the image: concentric circles on a flat ground, seen by a camera without roll.

Camera frame on the ground: x ahead of the camera's foot, y to the right; h = fy H / x rows below the horizon, and a
place y is in column u = cx + fx y / x. A curve whose direction turns by kappa per metre of its length has
d(sin phi) / dx = cos phi dphi / dx = kappa, so on a circle

    sin phi(x) = sin phi_0 + K x,        y(x) = y_0 + integral of tan phi over x
             = y_0 + x (sin phi_0 + sin phi(x)) / (cos phi_0 + cos phi(x))

(the chord's slope: the integral of s / sqrt(1 - s^2) is -sqrt(1 - s^2)). With x = fy H / h, the place
m = y_0 fx / (fy H) and the sines s_0 = sin phi_0, s = s_0 + r / h, where r = K fy H, the camera's height drops out:

    u = cx + m h + fx (s_0 + s) / (sqrt(1 - s_0^2) + sqrt(1 - s^2)).

Small angles give back u = u_0 + m h + k / h, with the column u_0 = cx + fx tan phi_0 in which the tangent beside the
camera vanishes, and k = r fx / (2 cos^3 phi_0): it is the parabola that touches the circle there. The circle is
K^3 x^4 / 8 beside it: 0.5 m at 15 m in a bend of 23 m.

All lines of a lane have one centre. The circle m beside that through the camera's foot has the radius 1 / K - y, so
both its sines are those of that one over 1 - K y = 1 - r m / fx; K y is 0.08 for a boundary on a ramp of 23 m.

Where s comes near 1 the circle turns back: there the line ends. Left out: the cosine of the camera's pitch, by which fx
is too small (1 % at 8 degrees).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cwcli.signals.columns import FloatArray

TURNED = 0.97
"""Sine of the direction at which lines end."""
LEAST_REST = 0.2
"""Of the radius, inside a boundary: farther in there is no lane."""


class Pinhole(NamedTuple):
    """What of a camera the shape of a road takes: column of the principal point, fx, and fx / fy."""

    centre_px: float
    focal_px: float
    stretch: float


def own_arc(far_px: float, near: float, bend_px2: float, pinhole: Pinhole) -> tuple[float, float, float]:
    """far, near and bend of the line at a place, from u_0 and k of the circle through the camera's foot.

    Args:
        far_px, bend_px2: u_0 and k of that circle, columns counted as those of `pinhole`.
        near: m of the line.
        pinhole: The camera.
    """
    slope = (far_px - pinhole.centre_px) / pinhole.focal_px
    cosine = (1.0 + slope * slope) ** -0.5
    rate = 2.0 * bend_px2 * cosine**3 / pinhole.focal_px
    tighter = 1.0 / max(1.0 - rate * near / pinhole.focal_px, LEAST_REST)
    start = min(max(slope * cosine * tighter, -TURNED), TURNED)
    own_cosine = (1.0 - start * start) ** 0.5
    bend = rate * tighter * pinhole.focal_px / (2.0 * own_cosine**3)
    return pinhole.centre_px + pinhole.focal_px * start / own_cosine, near, bend


def arc_columns(
    far: FloatArray, near: FloatArray, bend: FloatArray, h: FloatArray, centre: FloatArray, focal: FloatArray
) -> FloatArray:
    """Columns of circles, each told by the parabola that touches it beside the camera.

    Args:
        far, near, bend: Of x = far + near h + bend / h; all arguments of shapes that go together.
        h: Rows below the horizon.
        centre, focal: Column of the principal point, and fx; NaN: not known, then the parabola itself.

    Returns:
        NaN at and above the horizon, and where a circle has turned back.
    """
    h = np.where(h > 0.0, h, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (far - centre) / focal
        cosine = 1.0 / np.sqrt(1.0 + slope * slope)
        start = slope * cosine
        sine = start + 2.0 * bend * cosine**3 / (focal * h)
        own = np.sqrt(np.where(np.abs(sine) < TURNED, 1.0 - sine * sine, np.nan))
        arc = centre + near * h + focal * (start + sine) / (cosine + own)
        return np.where(np.isfinite(focal + centre), arc, far + near * h + bend / h)


def arc_places_m(touching: FloatArray, x_m: FloatArray) -> FloatArray:
    """Where circles lie on the road, each told by the parabola that touches it beside the camera.

    Args:
        touching: Shape (..., 3): y0 (m), slope, curvature (1/m) of y = y0 + slope x + curvature x^2 / 2.
        x_m: Distances ahead, above 0, of a shape that goes together with (...).

    Returns:
        Metres to the side to which y counts; NaN where a circle has turned back.
    """
    y0, slope, curvature = np.moveaxis(touching, -1, 0)
    return x_m * arc_columns(slope, y0, 0.5 * curvature, 1.0 / x_m, np.array(0.0), np.array(1.0))
