"""TUM trajectories: `timestamp tx ty tz qx qy qz qw`, a line each.

Source: the RGB-D benchmark's file formats (cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.export.formats.base import Track, TrackFormat


def encode_tum_trajectory(tracks: Sequence[Track]) -> bytes:
    """Encode positions in metres in the map frame, height 0; nine decimals of a second keep stamps exact."""
    (track,) = tracks
    half = 0.5 * track.heading_rad
    rows = zip(track.stamp_ns.tolist(), track.x_m, track.y_m, np.sin(half), np.cos(half), strict=True)
    lines = [
        f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d} {x:.6f} {y:.6f} 0 0 0 {sine:.12f} {cosine:.12f}\n"
        for stamp_ns, x, y, sine, cosine in rows
    ]
    return "".join(lines).encode()


FORMAT = TrackFormat((".tum",), "TUM trajectory, for evo and SLAM tools", encode_tum_trajectory, holds_one_track=True)
"""The description of this format for the table of formats."""
