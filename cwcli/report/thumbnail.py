"""A small drawing of a drive's track for the table of many logs: north up, both axes to one scale."""

from __future__ import annotations

import numpy as np

from cwcli.channels.published import EGO_STATE
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import FloatArray
from cwcli.signals.leaf_fields import read_numbers

WIDTH_PX, HEIGHT_PX = 56, 36
"""Size of a thumbnail, px. Chosen by hand: two lines of the table high."""
THUMBNAIL_MARGIN_PX = 2
"""Least distance of the track from the edge, px: half of the line's width and of the dot at the start."""
MAX_THUMBNAIL_POINTS = 32
"""Greatest number of points of a thumbnail. Chosen by hand: a path of them takes at most 6 bytes each."""
MIN_DRAWN_WAY_M = 1.0
"""Least length of the way of which a thumbnail is drawn, m. Chosen by hand: less is the noise of the positions."""


def read_ego_track_svg_path(log: Log) -> str:
    """Read the ego's track of an annotated log as the path of a thumbnail; "" where there is none.

    Raises:
        InputError: The log is damaged.
    """
    if EGO_STATE.topic not in {channel.topic for channel in log.channels}:
        return ""
    columns = log.columns(EGO_STATE.topic, ["stamp_ns", "x_m", "y_m"])
    order = np.argsort(read_numbers(columns, "stamp_ns"), kind="stable")
    return build_track_svg_path(*(read_numbers(columns, name)[order] for name in ("x_m", "y_m")))


def build_track_svg_path(x_m: FloatArray, y_m: FloatArray) -> str:
    """Build the SVG path of a track: points at equal distances along the way, in whole pixels, the start first.

    Args:
        x_m, y_m: Positions east and north in time order, (n,); those that are not finite are left out.
    """
    known = np.isfinite(x_m) & np.isfinite(y_m)
    if np.count_nonzero(known) < 2:
        return ""
    x, y = x_m[known], y_m[known]
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    extent = float(np.ptp(x)), float(np.ptp(y))
    if not (max(extent) >= MIN_DRAWN_WAY_M and np.isfinite(way[-1])):
        return ""
    at = np.linspace(0.0, way[-1], MAX_THUMBNAIL_POINTS)
    scale = min(
        (WIDTH_PX - 2 * THUMBNAIL_MARGIN_PX) / max(extent[0], 1e-9),
        (HEIGHT_PX - 2 * THUMBNAIL_MARGIN_PX) / max(extent[1], 1e-9),
    )
    right = WIDTH_PX / 2 + scale * (np.interp(at, way, x) - (x.min() + extent[0] / 2))
    down = HEIGHT_PX / 2 - scale * (np.interp(at, way, y) - (y.min() + extent[1] / 2))
    points = np.rint(np.stack([right, down], axis=1)).astype(int)
    moves = np.concatenate([[True], (np.diff(points, axis=0) != 0).any(axis=1)])
    return "M" + "L".join(f"{px} {py}" for px, py in points[moves].tolist())
