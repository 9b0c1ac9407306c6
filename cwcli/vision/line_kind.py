"""What kind of line a found boundary is: solid, dashed, raised dots, double.

It is measured along the line, after the search: where its rows show paint, how long the painted stretches and the gaps
are on the ground, and whether a second stripe runs beside it. Lengths are in lane widths, so that neither the camera's
height nor its focal length has to be known well. One frame sees a few dashes at most, so frames vote
(`line_watch`).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from cwcli.kernels import lane_ridge
from cwcli.signals.columns import FloatArray
from cwcli.vision.boundary import LineKind
from cwcli.vision.lane_detect import Evidence
from cwcli.vision.lane_model import HORIZON

PAINTED, LEAST_PAINTED, BEST_ROW = 0.5, 0.2, 3
"""A row counts as painted if it has this share of the evidence of the line's third best row, and at least 0.2. Chosen
by hand; not fitted."""
ROW_LENGTH, FINE_ROW_LENGTH = 0.35, 0.1
"""Greatest length of road that a row covers, in lane widths: for all kinds, and for raised dots. Chosen by hand; not
fitted."""
LONG = 2.5
"""Painted length from which a line is solid, in lane widths: 9 m. The longest dashes of motorways have 6 m."""
LEAST_SEEN = 1.2
"""Least length of a line that must be seen to judge its kind, in lane widths. Chosen by hand; not fitted."""
HOLE = 0.3
"""Greatest length of worn paint, in lane widths; a longer bare stretch is a gap. Chosen by hand; not fitted."""
GAP = 0.45
"""Least length of a gap between dashes, in lane widths: 1.6 m. Chosen by hand; not fitted."""
DASH = 0.2
"""Least length of a dash, in lane widths: 0.7 m. Chosen by hand; not fitted."""
BLOB = 0.09
"""Greatest length of a raised dot, in lane widths: 0.3 m. Chosen by hand; not fitted."""
SOLID_SHARE = 0.9
"""Share of a short line that must be painted without a gap for the line to be solid. Chosen by hand; not fitted."""
SECOND = np.arange(0.12, 0.41, 0.025)
"""Distances at which the second stripe of a double line is looked for, over the camera's height: 16 to 53 cm."""
SECOND_PLACES = np.concatenate([-SECOND[::-1], [0.0], SECOND])
"""The same distances to both sides of a line, with 0 for the line itself."""
SECOND_DEPTH_PX, SECOND_ROWS = 12.0, 5
"""Least number of rows below the horizon, and least number of rows, with which two stripes can be told apart. Chosen by
hand; not fitted."""
SECOND_SHARE, SECOND_LEAST = 0.15, 0.1
"""Least evidence of the weaker stripe: as a share of the stronger one's mean, and as a value. A dashed stripe beside a
solid one has little more. Chosen by hand; not fitted."""
VALLEY_SHARE = 0.5
"""Greatest evidence between both stripes, as a share of the weaker one's. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class SeenLine:
    """Kind of a line as one frame shows it.

    Attributes:
        kind: The kind of the line; never `DOUBLE`, and `UNKNOWN` where the frame does not show it.
        is_double: Whether a second stripe runs beside it; None where that could not be seen.
    """

    kind: LineKind
    is_double: bool | None


@dataclass(frozen=True)
class Stretch:
    """A painted or bare stretch of a line: its length in lane widths and in rows."""

    is_painted: bool
    length: float
    n_rows: int

    @property
    def least(self) -> float:
        """Least length that the stretch may have, in lane widths: its first and last row may show what lies in the next
        one."""
        return self.length * max(self.n_rows - 2, 0) / self.n_rows


def seen_lines(evidence: Evidence, lane: FloatArray) -> tuple[SeenLine, SeenLine]:
    """Kinds of the left and of the right boundary as one frame shows them.

    Args:
        evidence: The stripes of the frame.
        lane: The lane, shape (6,), see `lane_model`.
    """
    _, middle, width, _, horizon, _ = lane.tolist()
    rows = evidence.rows[::-1]
    h: FloatArray = rows - horizon
    ahead = evidence.pinhole.focal_px / (np.maximum(h, 1.0) * width)
    lengths = ahead[1:] - ahead[:-1]
    n = int(lengths.searchsorted(ROW_LENGTH))
    sides = [middle - 0.5 * width, middle + 0.5 * width]
    along = lane_ridge.along(evidence.wide, evidence.rows, lane, np.array(sides), evidence.scoring())[:, ::-1][:, :n]
    lines = []
    for values, place in zip(along, sides, strict=True):
        kind = LineKind.UNKNOWN
        if n >= BEST_ROW:
            least = max(PAINTED * float(np.partition(values, -BEST_ROW)[-BEST_ROW]), LEAST_PAINTED)
            is_seen = values >= 0.0
            kind = kind_of((values[is_seen] > least).tolist(), lengths[:n][is_seen].tolist())
        lines.append(SeenLine(kind, _is_double(evidence, lane, place)))
    return lines[0], lines[1]


def kind_of(painted: Sequence[bool], lengths: Sequence[float]) -> LineKind:
    """The kind of a line from its rows, the nearest first.

    Args:
        painted: Whether each row shows paint.
        lengths: Length of each row on the ground, in lane widths; they grow.
    """
    total = sum(lengths)
    if total < LEAST_SEEN:
        return LineKind.UNKNOWN
    line = stretches(painted, lengths)
    whole = without_holes(line)
    longest = max((each.length for each in whole if each.is_painted), default=0.0)
    if longest >= LONG:
        return LineKind.SOLID
    n_fine = bisect_right(lengths, FINE_ROW_LENGTH)
    n_dots = _n_dots(stretches(painted[:n_fine], lengths[:n_fine]))
    has_dash = any(each.is_painted and each.least >= DASH for each in whole)
    if n_dots >= (2 if has_dash else 1):  # far away, four dots at arm's length look like a dash
        return LineKind.DOTS
    if has_dash and any(not each.is_painted and each.length >= GAP for each in whole[:-1]):
        return LineKind.DASHED
    if has_dash and total < LONG and longest >= SOLID_SHARE * total:
        return LineKind.SOLID
    return LineKind.UNKNOWN


def stretches(painted: Sequence[bool], lengths: Sequence[float]) -> list[Stretch]:
    """The painted and the bare stretches of a line in turn, the nearest first."""
    found: list[Stretch] = []
    first = 0
    for is_painted, group in groupby(painted):
        n = sum(1 for _ in group)
        found.append(Stretch(is_painted, sum(lengths[first : first + n]), n))
        first += n
    return found


def without_holes(line: Sequence[Stretch]) -> list[Stretch]:
    """The stretches, with short bare ones between painted ones taken as painted."""
    filled: list[Stretch] = []
    for k, each in enumerate(line):
        is_hole = not each.is_painted and each.length <= HOLE and 0 < k < len(line) - 1
        if is_hole or (filled and filled[-1].is_painted and each.is_painted):
            before = filled.pop()
            filled.append(Stretch(True, before.length + each.length, before.n_rows + each.n_rows))
        else:
            filled.append(each)
    return filled


def _n_dots(line: Sequence[Stretch]) -> int:
    """Number of blobs with bare road on both sides that a line shows; 0 if it shows anything else."""
    if any(each.is_painted and each.least > BLOB for each in line):
        return 0
    return sum(
        each.is_painted and min(before.length, after.length) > BLOB
        for before, each, after in zip(line, line[1:], line[2:], strict=False)
    )


def _is_double(evidence: Evidence, lane: FloatArray, place: float) -> bool | None:
    """Whether a second stripe runs beside a line at a place over the camera's height; None where that can't be seen."""
    stretch = evidence.pinhole.stretch
    first = int(evidence.rows.searchsorted(float(lane[HORIZON]) + max(SECOND_DEPTH_PX / stretch, evidence.min_h)))
    rows, sharp = evidence.rows[first:], evidence.sharp[first:]
    values = lane_ridge.along(sharp, rows, lane, place + stretch * SECOND_PLACES, evidence.scoring())
    is_seen = (values[0] >= 0.0) & (values[-1] >= 0.0)
    if np.count_nonzero(is_seen) < SECOND_ROWS:
        return None
    mean: list[float] = (values @ is_seen / np.count_nonzero(is_seen)).tolist()
    middle = len(SECOND)
    for own, *beside in (mean[middle::-1], mean[middle:]):
        second = max(beside)
        less, more = sorted((own, second))
        valley = min(beside[: beside.index(second)], default=less)
        if less > max(SECOND_SHARE * more, SECOND_LEAST) and valley < VALLEY_SHARE * less:
            return True
    return False
