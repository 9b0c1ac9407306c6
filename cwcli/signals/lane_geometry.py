"""A bend in the image: concentric circles, or parallel spirals, on a flat ground, seen by a camera without roll.

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

Where the bend changes, K + K' x ahead, the sine is s = s_0 + r / h + g / h^2 with g = K' fy^2 H^2 / 2. The integral
of tan phi is then that of the circle with the same s_0 and s, less that of the bulge g t (T - t), T = 1 / h, between
the two: g T^3 / 6, each part of it times d tan phi / ds = (1 - s^2)^-1.5, taken in the bulge's middle. So u loses

    fx g / (6 h^2) (1 - ((s_0 + s) / 2)^2)^-1.5,

and for small angles u = u_0 + m h + k / h + q / h^2 with q = K' fx fy^2 H^2 / 6. Beside the camera's line g is that
over (1 - K y)^3.

Where s comes near 1 the line turns back: there it ends. Left out: the cosine of the camera's pitch, by which fx
is too small (1 % at 8 degrees).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cwcli.signals.columns import FloatArray

ArcCoefficients = FloatArray
"""Coefficients of arcs on the road, shape (..., 3), as for `lateral_positions_of_arcs_m`."""
LeftRightArcs = FloatArray
"""Coefficients of the left and the right line of each lane, shape (n, 2, 3)."""
FarNearBendSpiral = FloatArray
"""Image curves x = far + near h + bend / h + spiral / h^2, shape (..., 4), with h in rows below the horizon."""
YDirectionCurvature = FloatArray
"""Place to the left (m), direction (rad) and curvature (1/m) at a distance ahead, shape (..., 3)."""

MAX_SINE_OF_DRAWN_LINE_DIRECTION = 0.97
"""The sine of the direction (1) at which a drawn line ends, because it turns back there; chosen by hand."""
MIN_INNER_PARALLEL_RADIUS_SHARE = 0.2
"""The least radius of a parallel line inside a bend, as a share (1) of the bend's radius; a tighter line is no lane.
Chosen by hand."""


class Pinhole(NamedTuple):
    """The parts of a camera that the shape of a road needs: column of the principal point, fx, and fx / fy."""

    centre_px: float
    focal_px: float
    focal_length_ratio: float


def far_near_bend_spiral_of_parallel_line(
    far_px: float, near: float, bend_px2: float, spiral_px3: float, pinhole: Pinhole
) -> tuple[float, float, float, float]:
    """Return far, near, bend and spiral of the parallel line with this `near`, from those of the line through y = 0.

    Args:
        far_px, bend_px2, spiral_px3: u_0, k and q of that line, columns counted as those of `pinhole`.
        near: m of the line that is wanted.
    """
    slope = (far_px - pinhole.centre_px) / pinhole.focal_px
    cosine = (1.0 + slope * slope) ** -0.5
    rate = 2.0 * bend_px2 * cosine**3 / pinhole.focal_px
    tighter = 1.0 / max(1.0 - rate * near / pinhole.focal_px, MIN_INNER_PARALLEL_RADIUS_SHARE)
    start = min(max(slope * cosine * tighter, -MAX_SINE_OF_DRAWN_LINE_DIRECTION), MAX_SINE_OF_DRAWN_LINE_DIRECTION)
    own_cosine = (1.0 - start * start) ** 0.5
    bend = rate * tighter * pinhole.focal_px / (2.0 * own_cosine**3)
    spiral = spiral_px3 * (cosine / own_cosine * tighter) ** 3
    return pinhole.centre_px + pinhole.focal_px * start / own_cosine, near, bend, spiral


def image_columns_of_arcs(
    far_near_bend_spiral: FarNearBendSpiral,
    rows_below_horizon: FloatArray,
    centre_column: FloatArray,
    focal_px: FloatArray,
) -> FloatArray:
    """Return the image columns (px) of arcs, each given by the polynomial that touches it beside the camera.

    Args:
        far_near_bend_spiral: Shape (..., 4): far, near, bend, spiral of x = far + near h + bend / h + spiral / h^2.
        rows_below_horizon: Rows below the horizon, of a shape that goes together with (...), as those of the others.
        centre_column, focal_px: Column of the principal point, and fx; NaN: not known, then the polynomial itself.

    Returns:
        NaN at and above the horizon, and where a line has turned back.
    """
    far, near, bend, spiral = np.moveaxis(far_near_bend_spiral, -1, 0)
    rows_below_horizon = np.where(rows_below_horizon > 0.0, rows_below_horizon, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (far - centre_column) / focal_px
        cosine = 1.0 / np.sqrt(1.0 + slope * slope)
        start, rate, growth = slope * cosine, 2.0 * bend * cosine**3 / focal_px, 3.0 * spiral * cosine**3 / focal_px
        more = growth / rows_below_horizon**2
        sine = start + rate / rows_below_horizon + more
        middle = 1.0 - (0.5 * (start + sine)) ** 2
        chord = (start + sine) / (cosine + np.sqrt(1.0 - sine * sine))
        arc = centre_column + near * rows_below_horizon + focal_px * (chord - more / (6.0 * middle**1.5))
        arc = np.where(1.0 / rows_below_horizon < _first_positive_root_of_sine_or_inf(start, rate, growth), arc, np.nan)
        return np.where(
            np.isfinite(focal_px + centre_column),
            arc,
            far + near * rows_below_horizon + (bend + spiral / rows_below_horizon) / rows_below_horizon,
        )


def _first_positive_root_of_sine_or_inf(
    start: FloatArray, rate: FloatArray, growth: FloatArray, sine: float = MAX_SINE_OF_DRAWN_LINE_DIRECTION
) -> FloatArray:
    """Return the smallest positive t at which start + rate t + growth t^2 is `sine` or -`sine`, else inf."""
    end = np.where(np.abs(start) < sine, np.inf, 0.0)
    for limit in (-sine, sine):
        root = np.sqrt(rate * rate - 4.0 * growth * (start - limit))
        for sign in (-1.0, 1.0):
            t = 2.0 * (start - limit) / (sign * root - rate)
            end = np.where((t > 0.0) & (t < end), t, end)
    return end


def lateral_positions_of_arcs_m(
    arc_coefficients: ArcCoefficients, x_m: FloatArray, change_1pm2: FloatArray | float = 0.0
) -> FloatArray:
    """Return the lateral positions (m) of arcs on the road, each given by the polynomial that touches it beside the
    camera.

    Args:
        arc_coefficients: Shape (..., 3): y0 (m), slope, curvature (1/m) of
            y = y0 + slope x + curvature x^2 / 2 + change x^3 / 6.
        x_m: Distances ahead, of a shape that goes together with (...).
        change_1pm2: Change of curvature per metre ahead, of the parallel line through y = 0; that of the lines is
            `curvature_change_ratios_to_centre_line` times as great. Of a shape that goes together with (...).

    Returns:
        Metres to the side to which y counts; NaN where a line has turned back, and behind the camera.
    """
    y0, slope, curvature = np.moveaxis(arc_coefficients, -1, 0)
    change = np.broadcast_to(change_1pm2 * curvature_change_ratios_to_centre_line(arc_coefficients), y0.shape)
    roads = np.stack([slope, y0, curvature / 2.0, change / 6.0], axis=-1)
    ahead_m = np.where(x_m > 0.0, x_m, np.nan)
    places_m = ahead_m * image_columns_of_arcs(roads, 1.0 / ahead_m, np.array(0.0), np.array(1.0))
    return np.asarray(np.where(x_m == 0.0, y0, places_m))


def curvature_change_ratios_to_centre_line(arc_coefficients: ArcCoefficients) -> FloatArray:
    """Return the ratios (...) of each line's change of curvature to that of the parallel line through y = 0.

    Both as x^3 / 6 counts them; the other way round than `far_near_bend_spiral_of_parallel_line`, from
    K y = K_own y / (1 + K_own y).

    Args:
        arc_coefficients: Shape (..., 3), as for `lateral_positions_of_arcs_m`.
    """
    y0, slope, curvature = np.moveaxis(arc_coefficients, -1, 0)
    cosine = 1.0 / np.sqrt(1.0 + slope * slope)
    tighter = np.clip(
        1.0 + curvature * cosine**3 * y0, MIN_INNER_PARALLEL_RADIUS_SHARE, 1.0 / MIN_INNER_PARALLEL_RADIUS_SHARE
    )
    start = np.clip(slope * cosine / tighter, -MAX_SINE_OF_DRAWN_LINE_DIRECTION, MAX_SINE_OF_DRAWN_LINE_DIRECTION)
    return np.asarray((tighter * np.sqrt(1.0 - start * start) / cosine) ** 3)


def middle_line_of_parallel_arcs(arc_coefficients: ArcCoefficients) -> ArcCoefficients:
    """Return the lines (n, 3) in the middle between parallel ones, with the same coefficients.

    Args:
        arc_coefficients: Shape (n, k, 3), as for `lateral_positions_of_arcs_m`.
    """
    y0, slope, curvature = np.moveaxis(arc_coefficients, -1, 0)
    middle = y0.mean(axis=1)
    cosine = 1.0 / np.sqrt(1.0 + slope * slope)
    rate = curvature * cosine**3
    tighter = np.clip(
        1.0 + rate * (y0 - middle[:, None]), MIN_INNER_PARALLEL_RADIUS_SHARE, 1.0 / MIN_INNER_PARALLEL_RADIUS_SHARE
    )
    start = np.clip(
        (slope * cosine / tighter).mean(axis=1), -MAX_SINE_OF_DRAWN_LINE_DIRECTION, MAX_SINE_OF_DRAWN_LINE_DIRECTION
    )
    own_cosine = np.sqrt(1.0 - start * start)
    return np.column_stack([middle, start / own_cosine, (rate / tighter).mean(axis=1) / own_cosine**3])


def y_direction_curvature_of_arcs_at_distance(
    arc_coefficients: ArcCoefficients, x_m: FloatArray, change_1pm2: FloatArray
) -> YDirectionCurvature:
    """Return y (m), direction (rad) and curvature (1/m) of arcs at a distance ahead, shape (..., 3).

    NaN behind the camera, and where an arc has turned back.

    Args:
        arc_coefficients, x_m, change_1pm2: As for `lateral_positions_of_arcs_m`.
    """
    places_m = lateral_positions_of_arcs_m(arc_coefficients, x_m, change_1pm2)
    start, rate, growth = _coefficients_of_direction_sine_over_forward_x(arc_coefficients, change_1pm2)
    ahead = rate + 2.0 * growth * x_m
    sine = start + (rate + growth * x_m) * x_m
    with np.errstate(invalid="ignore"):
        y_direction_curvature = np.stack([places_m, np.arcsin(sine), np.broadcast_to(ahead, places_m.shape)], axis=-1)
    return np.where(np.isnan(places_m)[..., None], np.nan, y_direction_curvature)


def y_direction_curvature_of_lane_centres_at_distance(
    left_and_right_arcs: LeftRightArcs, x_m: FloatArray, change_1pm2: FloatArray
) -> YDirectionCurvature:
    """Return y (m), direction (rad) and curvature (1/m) of each lane's centre at a distance ahead, shape (n, 3).

    Where one line alone is known, direction and curvature are its own, and y is NaN; so are all three where the lane
    has turned back.

    Args:
        left_and_right_arcs: Shape (n, 2, 3), as for `lateral_positions_of_arcs_m`; NaN for a line that is not known.
        x_m, change_1pm2: As for `lateral_positions_of_arcs_m`; shape (n,).
    """
    y_direction_curvature = y_direction_curvature_of_arcs_at_distance(
        centre_arcs_of_lanes(left_and_right_arcs), x_m, change_1pm2
    )
    y_direction_curvature[np.isnan(left_and_right_arcs.sum(axis=(1, 2))), 0] = np.nan
    return y_direction_curvature


def centre_arcs_of_lanes(left_and_right_arcs: LeftRightArcs) -> ArcCoefficients:
    """Return the line (n, 3) in the middle between both lines of each lane, or the only known one."""
    centre, only = (
        middle_line_of_parallel_arcs(left_and_right_arcs),
        np.where(np.isnan(left_and_right_arcs[:, 0]), left_and_right_arcs[:, 1], left_and_right_arcs[:, 0]),
    )
    return np.where(np.isnan(centre[:, :1]), only, centre)


def distance_ahead_to_direction_sine_m(
    arc_coefficients: ArcCoefficients, sine: float, change_1pm2: FloatArray
) -> FloatArray:
    """Return how far ahead (m) the sine of each line's direction first reaches `sine` to either side, (n,), else inf.

    Args:
        arc_coefficients, change_1pm2: As for `lateral_positions_of_arcs_m`; shapes (n, 3) and (n,).
        sine: Positive, below 1. A line that points farther aside beside the camera has turned at 0.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        return _first_positive_root_of_sine_or_inf(
            *_coefficients_of_direction_sine_over_forward_x(arc_coefficients, change_1pm2), sine
        )


def _coefficients_of_direction_sine_over_forward_x(
    arc_coefficients: ArcCoefficients, change_1pm2: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return s_0, K and K' / 2 of each line, shape (...) each: its direction's sine is s_0 + K x + K' x^2 / 2."""
    _, slope, curvature = np.moveaxis(arc_coefficients, -1, 0)
    cosine = 1.0 / np.sqrt(1.0 + slope * slope)
    change = change_1pm2 * curvature_change_ratios_to_centre_line(arc_coefficients) * cosine**3
    return slope * cosine, curvature * cosine**3, 0.5 * change
