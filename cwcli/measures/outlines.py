"""Oriented rectangles: the outlines of two cars, and their gap.

`dx, dy` is the other's centre minus the host's, map frame; a size is (length_m, width_m). By the separating-axis
theorem two rectangles are apart exactly if their projections are apart on one of the four edge directions.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray

Size = tuple[float, float]


def _axes(
    dx: FloatArray,
    dy: FloatArray,
    heading_host: FloatArray,
    heading_other: FloatArray,
    host: Size,
    other: Size,
) -> list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
    """Per edge direction: its unit vector (x, y), the projected centre distance and the sum of half extents."""
    cos_between = np.abs(np.cos(heading_other - heading_host))
    sin_between = np.abs(np.sin(heading_other - heading_host))
    out = []
    for heading, own, guest in ((heading_host, host, other), (heading_other, other, host)):
        cosine, sine = np.cos(heading), np.sin(heading)
        lengthwise = 0.5 * (own[0] + guest[0] * cos_between + guest[1] * sin_between)
        crosswise = 0.5 * (own[1] + guest[0] * sin_between + guest[1] * cos_between)
        out.append((cosine, sine, dx * cosine + dy * sine, lengthwise))
        out.append((-sine, cosine, -dx * sine + dy * cosine, crosswise))
    return out


def overlap_margin(
    dx: FloatArray,
    dy: FloatArray,
    heading_host: FloatArray,
    heading_other: FloatArray,
    host: Size,
    other: Size,
) -> FloatArray:
    """Largest separation over the four edge directions, metres: positive apart, negative overlapping."""
    margins = [
        np.abs(centre) - reach for _, _, centre, reach in _axes(dx, dy, heading_host, heading_other, host, other)
    ]
    return np.asarray(np.maximum.reduce(margins))


def outline_distance(
    dx: FloatArray,
    dy: FloatArray,
    heading_host: FloatArray,
    heading_other: FloatArray,
    host: Size,
    other: Size,
) -> FloatArray:
    """Shortest distance between the outlines, metres; where they overlap, minus the penetration depth.

    The shortest distance of two rectangles apart always ends on a corner of one of them.
    """
    margin = overlap_margin(dx, dy, heading_host, heading_other, host, other)
    nearest = np.minimum(
        _corners_to_box(dx, dy, heading_host, heading_other, host, other),
        _corners_to_box(-dx, -dy, heading_other, heading_host, other, host),
    )
    return np.where(margin > 0.0, nearest, margin)


def _corners_to_box(
    dx: FloatArray, dy: FloatArray, heading_box: FloatArray, heading_guest: FloatArray, box: Size, guest: Size
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
