"""Trajectories without a line of names: TUM (a time, a position and a quaternion) and KITTI (rows of pose matrices).

Sources: cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats; the development kit of
cvlibs.net/datasets/kitti/eval_odometry.php.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cwcli.errors import DataError, InputError
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.tables import Answers, ColumnsOfRows, Preset, Question, SourceTable
from cwcli.importing.text_file import iter_text_lines
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

TRAJECTORY_NUMBER_PATTERN = re.compile(r"^[+-]?((\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?|nan|inf)$", re.IGNORECASE)
LINES_PARSED_AT_ONCE = 50_000
"""Number of lines that are parsed at a time. Chosen by hand: they take a few megabytes."""
POSE_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""Position and quaternion, in the order of TUM."""
POSE_PRESETS = {
    "time": Preset("time", "s"),
    **{axis: Preset(axis, "m") for axis in "xyz"},
    **{f"q{axis}": Preset(f"quaternion_{axis}") for axis in "xyzw"},
}
"""Column -> the quantity and unit that the format fixes."""
MAX_QUATERNION_LENGTH_ERROR = 0.05
"""Largest deviation of the length of a quaternion from 1; numbers beyond it are no quaternion. Chosen by hand."""
MAX_ROTATION_DETERMINANT_ERROR = 0.05
"""Largest deviation of the determinant of a rotation matrix from 1; numbers beyond it are no rotation. Chosen by
hand."""
MAX_SHARE_OF_LINES_WITH_WRONG_COLUMN_COUNT = 0.05
"""Largest share of lines with a wrong number of columns that are left out; more is an error. Chosen by hand."""


def first_lines_as_numbers(head: FileHead, n: int) -> FloatArray | None:
    """Return the first lines as numbers (m, n); None unless every one holds n, between blanks or between commas.

    Lines with # are remarks.
    """
    lines = [line for line in head.lines if not line.startswith(("#", "%"))]
    rows = [_split_line_into_cells(line) for line in lines]
    if not rows or any(len(row) != n or not all(TRAJECTORY_NUMBER_PATTERN.match(cell) for cell in row) for row in rows):
        return None
    return np.array(rows, np.float64)


def _split_line_into_cells(line: str) -> list[str]:
    """Return the cells of a line: between blanks, else between commas."""
    cells = line.split()
    return cells if len(cells) > 1 else [cell.strip() for cell in line.rstrip(", ").split(",")]


def is_one_number_per_line(head: FileHead) -> bool:
    """Tell whether a file holds one number a line, below a line of words at most."""
    lines = [line for line in head.lines if not line.startswith(("#", "%"))]
    numbers = [line for line in lines if TRAJECTORY_NUMBER_PATTERN.match(line)]
    return len(numbers) > 1 and len(numbers) >= len(lines) - 1


def iter_number_lines(path: str, n: int, notes: list[str]) -> Iterator[list[list[str]]]:
    """Yield blocks of lines of n cells each; lines with another number of cells are counted.

    Raises:
        DataError: Too many of them.
        InputError: The file can't be read.
    """
    n_bad = n_good = 0
    lines = iter_text_lines(path)
    while block := list(islice(lines, LINES_PARSED_AT_ONCE)):
        rows = [_split_line_into_cells(line) for line in block if line.strip() and line[0] not in "#%"]
        good = [row for row in rows if len(row) == n and all(TRAJECTORY_NUMBER_PATTERN.match(cell) for cell in row)]
        n_bad += len(rows) - len(good)
        n_good += len(good)
        if good:
            yield good
    if n_bad > MAX_SHARE_OF_LINES_WITH_WRONG_COLUMN_COUNT * (n_bad + n_good):
        raise DataError(
            f"{n_bad} of {n_bad + n_good} lines are not {n} numbers", where=path, hint="the file may be damaged"
        )
    if n_bad and (said := f"{n_bad} lines are not {n} numbers and are left out") not in notes:
        notes.append(said)


def read_tum_poses(path: str, answers: Answers) -> Sequence[SourceTable]:
    """Return the poses of a TUM file."""
    notes: list[str] = []

    def read_column_batches(columns: Sequence[str]) -> Iterator[ColumnsOfRows]:
        import pyarrow as pa

        for rows in iter_number_lines(path, 8, notes):
            values = np.array([row[1:] for row in rows], np.float64)
            batch = {name: values[:, k] for k, name in enumerate(POSE_COLUMNS)}
            yield {name: pa.array([row[0] for row in rows]) if name == "time" else batch[name] for name in columns}

    presets = {**POSE_PRESETS, "time": Preset("time")}  # its size shows the unit: some tools write ns
    return [SourceTable(path, "", "tum", ("time", *POSE_COLUMNS), read_column_batches, presets=presets, notes=notes)]


def read_kitti_poses(path: str, answers: Answers) -> Sequence[SourceTable]:
    """Return the poses of a KITTI file, with the times that the user names.

    Raises:
        AmbiguousError: No times are named, and none lie beside the file.
        DataError: There is another number of times.
    """
    notes: list[str] = []
    blocks = [np.array(rows, np.float64) for rows in iter_number_lines(path, 12, notes)]
    if not blocks:
        raise InputError("it has no poses", where=path)
    matrices = np.concatenate(blocks).reshape(-1, 3, 4)
    stamp_ns, why = find_stamps_of_rows(path, answers, len(matrices))
    quaternions = xyzw_quaternions_of_rotations(matrices[:, :, :3])
    columns = {"time": stamp_ns} | {name: matrices[:, k, 3] for k, name in enumerate("xyz")}
    columns |= {f"q{axis}": quaternions[:, k] for k, axis in enumerate("xyzw")}
    notes.append(f"times: {why}")
    presets = {**POSE_PRESETS, "time": Preset("time", "ns")}
    return [SourceTable.of_arrays(path, "", "kitti", columns, presets=presets, notes=notes)]


class RowStamps(NamedTuple):
    """Stamps of rows in ns, and what they are from."""

    stamp_ns: Int64Array
    origin: str


def find_stamps_of_rows(path: str, answers: Answers, n: int) -> RowStamps:
    """Return the stamps in ns (n,) of rows without a time: of `--times`, or of a times.txt beside the file.

    Raises:
        AmbiguousError: There are none.
        DataError: There is another number of them.
        InputError: The file of times can't be read.
    """
    source = answers.frame_times
    rate = re.fullmatch(r"(\d+(?:\.\d+)?)\s*[hH][zZ]", source)
    if rate and float(rate.group(1)) > 0:
        stamp_ns = np.rint(np.arange(n) * (NS_PER_S / float(rate.group(1)))).astype(np.int64)
        return RowStamps(stamp_ns, f"{source}, as you said")
    if not source:
        times_file = Path(path).with_name("times.txt")
        if not times_file.is_file():
            raise Question(path, "its rows have no times", "--times times.txt, or --times 10Hz").as_error()
        source = str(times_file)
    stamps = read_time_lines_ns(source, n + 1)
    if len(stamps) != n:
        shown = f"more than {n}" if len(stamps) > n else len(stamps)
        raise DataError(f"{source} has {shown} times for {n} rows", where=path, hint="--times FILE names another one")
    return RowStamps(stamps, source)


def read_time_lines_ns(path: str, max_n: int) -> Int64Array:
    """Return the first times of a file with one a line, in ns: seconds, or ns since 1970 as EuRoC has them.

    Args:
        path: The file; its first line may be words.
        max_n: Greatest number of times that are read.

    Raises:
        InputError: It can't be read, or holds something else.
    """
    import pyarrow as pa

    from cwcli.importing.cells import read_whole_units_fraction_and_validity
    from cwcli.importing.times import Instants, time_base_of_numbers

    lines = (line.strip() for line in iter_text_lines(path) if line.strip() and line[0] not in "#%")
    cells = [re.split(r"[,;\s]", line, maxsplit=1)[0] for line in islice(lines, max_n + 1)]
    cells = cells[1:] if cells and not TRAJECTORY_NUMBER_PATTERN.match(cells[0]) else cells[:max_n]
    if not cells or not all(TRAJECTORY_NUMBER_PATTERN.match(cell) for cell in cells):
        raise InputError("it has no number at the start of each line", where=path)
    instants = Instants(*read_whole_units_fraction_and_validity(pa.array(cells), "."))
    base = time_base_of_numbers(instants, "", ())
    return instants.to_ns(base.unit if base.since == "1970" else "s")


def xyzw_quaternions_of_rotations(rotation: FloatArray) -> FloatArray:
    """Return unit quaternions x, y, z, w (n, 4) of rotation matrices (n, 3, 3): the largest component first."""
    trace = np.trace(rotation, axis1=1, axis2=2)
    diagonal = np.einsum("nii->ni", rotation)
    squares = np.column_stack([1.0 + 2.0 * diagonal - trace[:, None], 1.0 + trace])
    largest = np.argmax(squares, axis=1)
    r = rotation
    off = {
        (0, 1): r[:, 0, 1] + r[:, 1, 0], (0, 2): r[:, 0, 2] + r[:, 2, 0], (1, 2): r[:, 1, 2] + r[:, 2, 1],
        (0, 3): r[:, 2, 1] - r[:, 1, 2], (1, 3): r[:, 0, 2] - r[:, 2, 0], (2, 3): r[:, 1, 0] - r[:, 0, 1],
    }  # fmt: skip
    table = np.zeros((len(r), 4, 4))
    for (i, k), values in off.items():
        table[:, i, k] = table[:, k, i] = values
    for i in range(4):
        table[:, i, i] = squares[:, i]
    rows = table[np.arange(len(r)), largest]
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(rows / np.where(length > 0, length, np.nan))


def _accepts_tum_file(head: FileHead) -> bool:
    rows = first_lines_as_numbers(head, 8)
    if rows is None:
        return False
    found = rows[np.isfinite(rows[:, 1:]).all(axis=1)]  # a lost pose is nan
    lengths = np.linalg.norm(found[:, 4:], axis=1)
    return len(found) > 0.5 * len(rows) and bool((np.abs(lengths - 1.0) < MAX_QUATERNION_LENGTH_ERROR).all())


def _accepts_kitti_file(head: FileHead) -> bool:
    rows = first_lines_as_numbers(head, 12)
    if rows is None:
        return False
    volume = np.linalg.det(rows.reshape(-1, 3, 4)[:, :, :3])
    return bool((np.abs(volume - 1.0) < MAX_ROTATION_DETERMINANT_ERROR).all())


TUM_TRAJECTORY_IMPORT_KIND = ImportKind("TUM trajectories", (".tum", ".txt"), _accepts_tum_file, read_tum_poses)
"""The description of TUM's trajectories: `time x y z qx qy qz qw`, a line each."""
KITTI_POSES_IMPORT_KIND = ImportKind(
    "KITTI poses, with a file of times or a rate", (".txt", ".kitti"), _accepts_kitti_file, read_kitti_poses
)
"""The description of KITTI's poses: the upper three rows of a pose matrix a line, without times."""
