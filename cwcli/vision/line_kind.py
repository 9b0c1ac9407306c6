"""What kind of line a found boundary is: solid, dashed, raised dots, double.

It is measured along the line, after the search: where its rows show paint, how long the painted stretches and the gaps
are on the ground, and whether a second stripe runs beside it. Lengths are in lane widths, so that neither the camera's
height nor its focal length has to be known well. One frame sees a few dashes at most, so frames vote
(`line_classifier`).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import groupby

import numpy as np

from cwcli.kernels import lane_ridge
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.vision.boundary import LineKind
from cwcli.vision.lane_detect import StripeEvidence
from cwcli.vision.lane_model import HORIZON, ImageLane

MIN_PAINTED_EVIDENCE_OF_REFERENCE_ROW_SHARE, MIN_PAINTED_EVIDENCE, EVIDENCE_RANK_OF_REFERENCE_ROW = 0.5, 0.2, 3
"""A row counts as painted if it has this share of the evidence of the line's third best row, and at least 0.2. Chosen
by hand; not fitted."""
MAX_ROAD_LENGTH_PER_ROW_IN_LANE_WIDTHS, MAX_ROAD_LENGTH_PER_ROW_FOR_DOTS_IN_LANE_WIDTHS = 0.35, 0.1
"""Greatest length of road that a row covers, in lane widths: for all kinds, and for raised dots. Chosen by hand; not
fitted."""
MIN_PAINTED_LENGTH_OF_SOLID_LINE_IN_LANE_WIDTHS = 2.5
"""Painted length from which a line is solid, in lane widths: 9 m. The longest dashes of motorways have 6 m."""
MIN_SEEN_LENGTH_TO_JUDGE_LINE_KIND_IN_LANE_WIDTHS = 1.2
"""Least length of a line that must be seen to judge its kind, in lane widths. Chosen by hand; not fitted."""
MAX_WORN_PAINT_LENGTH_IN_LANE_WIDTHS = 0.3
"""Greatest length of worn paint, in lane widths; a longer bare stretch is a gap. Chosen by hand; not fitted."""
MIN_GAP_LENGTH_BETWEEN_DASHES_IN_LANE_WIDTHS = 0.45
"""Least length of a gap between dashes, in lane widths: 1.6 m. Chosen by hand; not fitted."""
MIN_DASH_LENGTH_IN_LANE_WIDTHS = 0.2
"""Least length of a dash, in lane widths: 0.7 m. Chosen by hand; not fitted."""
MAX_RAISED_DOT_LENGTH_IN_LANE_WIDTHS = 0.09
"""Greatest length of a raised dot, in lane widths: 0.3 m. Chosen by hand; not fitted."""
MIN_PAINTED_SHARE_OF_SHORT_SOLID_LINE = 0.9
"""Share of a short line that must be painted without a gap for the line to be solid. Chosen by hand; not fitted."""
SECOND_STRIPE_DISTANCES_IN_CAMERA_HEIGHTS = np.arange(0.12, 0.41, 0.025)
"""Distances at which the second stripe of a double line is looked for, over the camera's height: 16 to 53 cm."""
SECOND_STRIPE_OFFSETS_IN_CAMERA_HEIGHTS = np.concatenate(
    [-SECOND_STRIPE_DISTANCES_IN_CAMERA_HEIGHTS[::-1], [0.0], SECOND_STRIPE_DISTANCES_IN_CAMERA_HEIGHTS]
)
"""The same distances to both sides of a line, with 0 for the line itself."""
MIN_DEPTH_BELOW_HORIZON_TO_TELL_TWO_STRIPES_PX, MIN_ROWS_TO_TELL_TWO_STRIPES_APART = 12.0, 5
"""Least number of rows below the horizon, and least number of rows, with which two stripes can be told apart. Chosen by
hand; not fitted."""
MIN_WEAKER_TO_STRONGER_STRIPE_EVIDENCE_RATIO, MIN_SECOND_STRIPE_EVIDENCE = 0.15, 0.1
"""Least evidence of the weaker stripe: as a share of the stronger one's mean, and as a value. A dashed stripe beside a
solid one has little more. Chosen by hand; not fitted."""
MAX_EVIDENCE_BETWEEN_STRIPES_SHARE = 0.5
"""Greatest evidence between both stripes, as a share of the weaker one's. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class LineKindInFrame:
    """Kind of a line as one frame shows it.

    Attributes:
        kind: The kind of the line; never `DOUBLE`, and `UNKNOWN` where the frame does not show it.
        is_double: Whether a second stripe runs beside it; None where that could not be seen.
    """

    kind: LineKind
    is_double: bool | None


@dataclass(frozen=True)
class LineStretch:
    """A painted or bare stretch of a line: its length in lane widths and in rows."""

    is_painted: bool
    length: float
    n_rows: int

    @property
    def min_length_in_lane_widths(self) -> float:
        """Least length that the stretch may have, in lane widths: its first and last row may show what lies in the next
        one."""
        return self.length * max(self.n_rows - 2, 0) / self.n_rows


def classify_lines_in_frame(evidence: StripeEvidence, lane: ImageLane) -> tuple[LineKindInFrame, LineKindInFrame]:
    """Kinds of the left and of the right boundary as one frame shows them."""
    _, middle, width, _, horizon, _ = lane.tolist()
    rows = evidence.rows[::-1]
    h: FloatArray = rows - horizon
    ahead = evidence.pinhole.focal_px / (np.maximum(h, 1.0) * width)
    lengths = ahead[1:] - ahead[:-1]
    n = int(lengths.searchsorted(MAX_ROAD_LENGTH_PER_ROW_IN_LANE_WIDTHS))
    sides = [middle - 0.5 * width, middle + 0.5 * width]
    along = lane_ridge.along(evidence.wide, evidence.rows, lane, np.array(sides), evidence.scoring_settings())[:, ::-1][
        :, :n
    ]
    lines = []
    for values, place in zip(along, sides, strict=True):
        kind = LineKind.UNKNOWN
        if n >= EVIDENCE_RANK_OF_REFERENCE_ROW:
            least = max(
                MIN_PAINTED_EVIDENCE_OF_REFERENCE_ROW_SHARE
                * float(np.partition(values, -EVIDENCE_RANK_OF_REFERENCE_ROW)[-EVIDENCE_RANK_OF_REFERENCE_ROW]),
                MIN_PAINTED_EVIDENCE,
            )
            is_seen = values >= 0.0
            kind = classify_line_kind((values[is_seen] > least).tolist(), lengths[:n][is_seen].tolist())
        lines.append(LineKindInFrame(kind, _has_second_stripe(evidence, lane, place)))
    return lines[0], lines[1]


def classify_line_kind(is_row_painted: Sequence[bool], row_lengths_lane_widths: Sequence[float]) -> LineKind:
    """The kind of a line from its rows, the nearest first.

    Args:
        row_lengths_lane_widths: Length of each row on the ground, in lane widths; they grow.
    """
    total = sum(row_lengths_lane_widths)
    if total < MIN_SEEN_LENGTH_TO_JUDGE_LINE_KIND_IN_LANE_WIDTHS:
        return LineKind.UNKNOWN
    line = split_into_stretches(is_row_painted, row_lengths_lane_widths)
    whole = fill_worn_holes(line)
    longest = max((each.length for each in whole if each.is_painted), default=0.0)
    if longest >= MIN_PAINTED_LENGTH_OF_SOLID_LINE_IN_LANE_WIDTHS:
        return LineKind.SOLID
    n_fine = bisect_right(row_lengths_lane_widths, MAX_ROAD_LENGTH_PER_ROW_FOR_DOTS_IN_LANE_WIDTHS)
    n_dots = _count_raised_dots(split_into_stretches(is_row_painted[:n_fine], row_lengths_lane_widths[:n_fine]))
    has_dash = any(
        each.is_painted and each.min_length_in_lane_widths >= MIN_DASH_LENGTH_IN_LANE_WIDTHS for each in whole
    )
    if n_dots >= (2 if has_dash else 1):  # far away, four dots at arm's length look like a dash
        return LineKind.DOTS
    if has_dash and any(
        not each.is_painted and each.length >= MIN_GAP_LENGTH_BETWEEN_DASHES_IN_LANE_WIDTHS for each in whole[:-1]
    ):
        return LineKind.DASHED
    if (
        has_dash
        and total < MIN_PAINTED_LENGTH_OF_SOLID_LINE_IN_LANE_WIDTHS
        and longest >= MIN_PAINTED_SHARE_OF_SHORT_SOLID_LINE * total
    ):
        return LineKind.SOLID
    return LineKind.UNKNOWN


def split_into_stretches(painted: Sequence[bool], lengths: Sequence[float]) -> list[LineStretch]:
    """The painted and the bare stretches of a line in turn, the nearest first."""
    found: list[LineStretch] = []
    first = 0
    for is_painted, group in groupby(painted):
        n = sum(1 for _ in group)
        found.append(LineStretch(is_painted, sum(lengths[first : first + n]), n))
        first += n
    return found


def fill_worn_holes(line: Sequence[LineStretch]) -> list[LineStretch]:
    """The stretches, with short bare ones between painted ones taken as painted."""
    filled: list[LineStretch] = []
    for k, each in enumerate(line):
        is_hole = not each.is_painted and each.length <= MAX_WORN_PAINT_LENGTH_IN_LANE_WIDTHS and 0 < k < len(line) - 1
        if is_hole or (filled and filled[-1].is_painted and each.is_painted):
            before = filled.pop()
            filled.append(LineStretch(True, before.length + each.length, before.n_rows + each.n_rows))
        else:
            filled.append(each)
    return filled


def _count_raised_dots(line: Sequence[LineStretch]) -> int:
    """Number of blobs with bare road on both sides that a line shows; 0 if it shows anything else."""
    if any(each.is_painted and each.min_length_in_lane_widths > MAX_RAISED_DOT_LENGTH_IN_LANE_WIDTHS for each in line):
        return 0
    return sum(
        each.is_painted and min(before.length, after.length) > MAX_RAISED_DOT_LENGTH_IN_LANE_WIDTHS
        for before, each, after in zip(line, line[1:], line[2:], strict=False)
    )


def _has_second_stripe(evidence: StripeEvidence, lane: ImageLane, offset: float) -> bool | None:
    """Whether a second stripe runs beside a line at a place over the camera's height; None where that can't be seen."""
    stretch = evidence.pinhole.focal_length_ratio
    first = int(
        evidence.rows.searchsorted(
            float(lane[HORIZON]) + max(MIN_DEPTH_BELOW_HORIZON_TO_TELL_TWO_STRIPES_PX / stretch, evidence.min_depth_px)
        )
    )
    rows, sharp = evidence.rows[first:], evidence.sharp[first:]
    values = lane_ridge.along(
        sharp, rows, lane, offset + stretch * SECOND_STRIPE_OFFSETS_IN_CAMERA_HEIGHTS, evidence.scoring_settings()
    )
    is_seen = (values[0] >= 0.0) & (values[-1] >= 0.0)
    if np.count_nonzero(is_seen) < MIN_ROWS_TO_TELL_TWO_STRIPES_APART:
        return None
    mean: list[float] = (values @ is_seen / np.count_nonzero(is_seen)).tolist()
    middle = len(SECOND_STRIPE_DISTANCES_IN_CAMERA_HEIGHTS)
    for own, *neighbours in (mean[middle::-1], mean[middle:]):
        second = max(neighbours)
        less, more = sorted((own, second))
        valley = min(neighbours[: neighbours.index(second)], default=less)
        if (
            less > max(MIN_WEAKER_TO_STRONGER_STRIPE_EVIDENCE_RATIO * more, MIN_SECOND_STRIPE_EVIDENCE)
            and valley < MAX_EVIDENCE_BETWEEN_STRIPES_SHARE * less
        ):
            return True
    return False
