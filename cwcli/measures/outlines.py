"""Oriented rectangles: the outlines of two cars, and their gap.

`dx, dy` is the other's centre minus the host's, map frame; a size is (length_m, width_m). By the separating-axis
theorem two rectangles are apart exactly if their projections are apart on one of the four edge directions.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray

LengthAndWidthM = tuple[float, float]
"""Length and width of an outline, m."""


def outline_separation_m(
    dx: FloatArray,
    dy: FloatArray,
    heading_host: FloatArray,
    heading_other: FloatArray,
    host: LengthAndWidthM,
    other: LengthAndWidthM,
) -> FloatArray:
    """Largest separation over the four edge directions, metres: positive apart, negative overlapping."""
    directions = [(np.cos(heading), np.sin(heading)) for heading in (heading_host, heading_other)]
    return outline_separation_by_directions_m(dx, dy, directions[0], directions[1], host, other)


def outline_separation_by_directions_m(
    dx: FloatArray,
    dy: FloatArray,
    along_host: tuple[FloatArray, FloatArray],
    along_other: tuple[FloatArray, FloatArray],
    host: LengthAndWidthM,
    other: LengthAndWidthM,
) -> FloatArray:
    """Largest separation over the four edge directions from cosine and sine of the headings, metres."""
    (cos_host, sin_host), (cos_other, sin_other) = along_host, along_other
    cos_between = np.abs(cos_host * cos_other + sin_host * sin_other)
    sin_between = np.abs(cos_host * sin_other - sin_host * cos_other)
    most: FloatArray | None = None
    for (cosine, sine), own, guest in ((along_host, host, other), (along_other, other, host)):
        lengthwise = np.abs(dx * cosine + dy * sine) - 0.5 * (own[0] + guest[0] * cos_between + guest[1] * sin_between)
        crosswise = np.abs(dy * cosine - dx * sine) - 0.5 * (own[1] + guest[0] * sin_between + guest[1] * cos_between)
        separation_m = np.maximum(lengthwise, crosswise)
        most = separation_m if most is None else np.maximum(most, separation_m)
    return np.asarray(most)


def signed_outline_distance_m(
    dx_m: FloatArray,
    dy_m: FloatArray,
    host_heading_rad: FloatArray,
    other_heading_rad: FloatArray,
    host: LengthAndWidthM,
    other: LengthAndWidthM,
) -> FloatArray:
    """Shortest distance between the outlines, metres; where they overlap, minus the penetration depth.

    The shortest distance of two rectangles apart always ends on a corner of one of them.
    """
    margin = outline_separation_m(dx_m, dy_m, host_heading_rad, other_heading_rad, host, other)
    nearest = np.minimum(
        _distance_of_corners_to_box_m(dx_m, dy_m, host_heading_rad, other_heading_rad, host, other),
        _distance_of_corners_to_box_m(-dx_m, -dy_m, other_heading_rad, host_heading_rad, other, host),
    )
    return np.where(margin > 0.0, nearest, margin)


def _distance_of_corners_to_box_m(
    dx: FloatArray,
    dy: FloatArray,
    heading_box: FloatArray,
    heading_guest: FloatArray,
    box: LengthAndWidthM,
    guest: LengthAndWidthM,
) -> FloatArray:
    """Smallest distance from the guest's corners to the box, the guest's centre at (dx, dy) from the box's."""
    cosine, sine = np.cos(heading_box), np.sin(heading_box)
    cos_guest, sin_guest = np.cos(heading_guest), np.sin(heading_guest)
    best = np.full(np.shape(dx), np.inf)
    for along in (-0.5 * guest[0], 0.5 * guest[0]):
        for across in (-0.5 * guest[1], 0.5 * guest[1]):
            x = dx + along * cos_guest - across * sin_guest
            y = dy + along * sin_guest + across * cos_guest
            outside_x = np.maximum(np.abs(x * cosine + y * sine) - 0.5 * box[0], 0.0)
            outside_y = np.maximum(np.abs(-x * sine + y * cosine) - 0.5 * box[1], 0.0)
            best = np.minimum(best, np.hypot(outside_x, outside_y))
    return best
