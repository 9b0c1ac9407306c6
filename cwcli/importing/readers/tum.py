"""TUM trajectories: `time x y z qx qy qz qw`, a line each."""

import numpy as np

from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.trajectory import first_lines_as_numbers, read_tum_poses

MAX_LENGTH_ERROR = 0.05
"""Largest deviation of the length of a quaternion from 1; numbers beyond it are no quaternion. Chosen by hand."""


def _accepts_tum_file(head: FileHead) -> bool:
    rows = first_lines_as_numbers(head, 8)
    return rows is not None and bool((np.abs(np.linalg.norm(rows[:, 4:], axis=1) - 1.0) < MAX_LENGTH_ERROR).all())


KIND = ImportKind("TUM trajectories", (".tum", ".txt"), _accepts_tum_file, read_tum_poses)
"""The description of this kind."""
