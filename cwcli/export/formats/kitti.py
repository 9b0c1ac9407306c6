"""KITTI poses: the upper three rows of the pose matrix, row by row, a line each, without a time.

Source: the odometry benchmark's development kit (cvlibs.net/datasets/kitti/eval_odometry.php).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.export.formats.base import Track, TrackFormat


def encode_kitti_poses(tracks: Sequence[Track]) -> bytes:
    """Encode the poses of the body (x forward, y left, z up; not a camera) in the map frame, height 0."""
    (track,) = tracks
    sine, cosine = np.sin(track.heading_rad), np.cos(track.heading_rad)
    lines = [
        f"{c:.12f} {-s:.12f} 0 {x:.6f} {s:.12f} {c:.12f} 0 {y:.6f} 0 0 1 0\n"
        for s, c, x, y in zip(sine, cosine, track.x_m, track.y_m, strict=True)
    ]
    return "".join(lines).encode()


FORMAT = TrackFormat(
    (".kitti", ".txt"), "KITTI poses, for evo; without times", encode_kitti_poses, holds_one_track=True
)
"""The description of this format for the table of formats."""
