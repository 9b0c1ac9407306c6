"""KITTI poses: the upper three rows of a pose matrix a line, without times."""

import numpy as np

from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.trajectory import first_lines_as_numbers, read_kitti_poses

MAX_VOLUME_ERROR = 0.05
"""Largest deviation of the determinant of a rotation matrix from 1; numbers beyond it are no rotation. Chosen by
hand."""


def _accepts_kitti_file(head: FileHead) -> bool:
    rows = first_lines_as_numbers(head, 12)
    if rows is None:
        return False
    volume = np.linalg.det(rows.reshape(-1, 3, 4)[:, :, :3])
    return bool((np.abs(volume - 1.0) < MAX_VOLUME_ERROR).all())


KIND = ImportKind(
    "KITTI poses, with a file of times or a rate", (".txt", ".kitti"), _accepts_kitti_file, read_kitti_poses
)
"""The description of this kind."""
