"""TUM trajectories: `time x y z qx qy qz qw`, a line each."""

import numpy as np

from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.trajectory import read_tum, rows_of_numbers

MAX_LENGTH_ERROR = 0.05
"""Largest deviation of the length of a quaternion from 1; other numbers are no quaternion."""


def _accepts(head: FileHead) -> bool:
    rows = rows_of_numbers(head, 8)
    return rows is not None and bool((np.abs(np.linalg.norm(rows[:, 4:], axis=1) - 1.0) < MAX_LENGTH_ERROR).all())


KIND = ImportKind("TUM trajectories", (".tum", ".txt"), _accepts, read_tum)
"""The description of this kind."""
