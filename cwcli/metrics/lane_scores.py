"""Scores of lane boundaries: TuSimple's, zhang2011's visual standard made exact, and how steady a lane is.

Plain arrays in. NaN means 'not found' in estimates and 'no truth' in truth. Nothing here knows of cameras or methods.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, FloatArray

TUSIMPLE_COLUMN_TOLERANCE_PX = 20.0
"""Tolerance of a column in a vertical lane [px], from TuSimple's public scorer (evaluate/lane.py)."""
TUSIMPLE_MIN_ROW_SHARE_OF_MATCH = 0.85
"""Smallest share of rows within the tolerance that matches a lane, from TuSimple's public scorer."""
TUSIMPLE_MAX_FRAME_TIME_MS = 200.0
"""Longest time for a frame [ms] that is accepted, from TuSimple's public scorer."""
TUSIMPLE_ABSENT_POINT_COLUMN_PX = -100.0
"""Column that stands for an absent point, from TuSimple's public scorer."""
TUSIMPLE_LANES_ABOVE_WHICH_ONE_MAY_BE_MISSED = 4
"""Number of labelled lanes above which one, of a lane change, may be missed; from TuSimple's public scorer."""
TUSIMPLE_MAX_EXTRA_PREDICTIONS = 2
"""Greatest number of predictions beyond the labelled lanes before a frame scores 0; from TuSimple's public scorer."""

N_LANE_POINTS_EXTRAPOLATED_DOWN = 8
"""Number of lowest points of a lane that are extrapolated to the image's lower edge; chosen by hand."""

VISUAL_STANDARD_COLUMN_TOLERANCE_PX = 6.0
"""Tolerance of the visual standard [px] in an image of `VISUAL_REFERENCE_IMAGE_WIDTH_PX`; chosen by hand."""
VISUAL_STANDARD_MIN_ROW_SHARE = 0.85
"""Smallest share of a boundary's visible rows within the tolerance; chosen by hand."""
VISUAL_REFERENCE_IMAGE_WIDTH_PX = 320
"""Width of the image [px] to which `VISUAL_STANDARD_COLUMN_TOLERANCE_PX` belongs: 320 x 240, as in zhang2011."""


@dataclass(frozen=True)
class TuSimpleScore:
    """TuSimple's three numbers.

    Attributes:
        accuracy: Share of the rows on which the best prediction is near enough, averaged over the truth's lanes.
        false_positive: Share of the predicted lanes that match no lane of the truth. Negative where one prediction
            matches several lanes: the public scorer counts it for each of them.
        false_negative: Share of the truth's lanes, four at most, that no prediction matches.
    """

    accuracy: float
    false_positive: float
    false_negative: float


def tusimple_score(
    predicted: Sequence[Sequence[float] | FloatArray],
    truth: Sequence[Sequence[float] | FloatArray],
    h_samples: Sequence[float] | FloatArray,
    *,
    time_ms: float = 0.0,
) -> TuSimpleScore:
    """One frame as TuSimple's public scorer judges it (tusimple-benchmark, evaluate/lane.py, last revision, `bench`).

    A row counts if the columns differ by less than 20 px / cos(angle), the angle that of a straight line through the
    truth's lane; a row on which both are absent counts too. A lane is matched if its best prediction has 85 % of its
    rows. The scorer's special cases are kept:

    - more than two predictions more than lanes of truth, or a time above 200 ms, give 0, 0, 1 for the frame;
    - of more than four lanes of truth the worst one is left out of the accuracy, one miss is forgiven, and both are
      shares of four;
    - without predictions the false positives are 0; without truth the accuracy and the false negatives are 0;
    - several lanes of truth may take the same prediction.

    Args:
        predicted: Lanes, each with a column for every row of `h_samples`; negative or NaN is absent.
        truth: Likewise.
        h_samples: The rows.
        time_ms: What the prediction took.

    Raises:
        ValueError: There are no rows, or a lane has another number of them.
    """
    n = len(h_samples)
    if n == 0:
        raise ValueError("h_samples is empty")
    for name, lines in (("truth", truth), ("prediction", predicted)):
        if any(len(lane) != n for lane in lines):
            raise ValueError(f"a lane of the {name} does not have a column for every row")
    if time_ms > TUSIMPLE_MAX_FRAME_TIME_MS or len(predicted) > len(truth) + TUSIMPLE_MAX_EXTRA_PREDICTIONS:
        return TuSimpleScore(0.0, 0.0, 1.0)
    rows = np.asarray(h_samples, np.float64)
    lanes = [np.asarray(lane, np.float64) for lane in truth]
    guesses = [_absent_as_minus_100(np.asarray(lane, np.float64)) for lane in predicted]
    best = []
    for lane in lanes:
        near_px = TUSIMPLE_COLUMN_TOLERANCE_PX / math.cos(_lane_angle_rad(lane, rows))
        at = _absent_as_minus_100(lane)
        best.append(max((float(np.mean(np.abs(guess - at) < near_px)) for guess in guesses), default=0.0))
    missed = sum(share < TUSIMPLE_MIN_ROW_SHARE_OF_MATCH for share in best)
    unmatched = len(guesses) - (len(lanes) - missed)
    total = sum(best)
    if len(lanes) > TUSIMPLE_LANES_ABOVE_WHICH_ONE_MAY_BE_MISSED:
        missed -= missed > 0
        total -= min(best)
    n_lanes = max(min(TUSIMPLE_LANES_ABOVE_WHICH_ONE_MAY_BE_MISSED, len(lanes)), 1)
    return TuSimpleScore(
        accuracy=total / n_lanes,
        false_positive=unmatched / len(guesses) if guesses else 0.0,
        false_negative=missed / n_lanes,
    )


def lanes_beside_ego(lanes: FloatArray, h_samples: FloatArray, width_px: float, height_px: float) -> list[FloatArray]:
    """Return the labelled lanes beside the car: on each side the one nearest to the middle of the image's lower edge.

    TuSimple's benchmark judges up to five lanes; methods that look for the car's own lane only are judged by these two.
    A lane is prolonged to the lower edge by the straight line through its `N_LANE_POINTS_EXTRAPOLATED_DOWN` lowest
    points.

    Args:
        lanes: Shape (k, h): a column for every row; negative is absent.
        h_samples: Shape (h,): the rows.
        width_px, height_px: Of the image.

    Returns:
        The left and the right one, each of shape (h,); fewer where a side has none.
    """
    feet: list[tuple[float, FloatArray]] = []
    for lane in lanes:
        present = np.flatnonzero(lane >= 0.0)
        if len(present) > 1:
            low = present[np.argsort(h_samples[present])][-N_LANE_POINTS_EXTRAPOLATED_DOWN:]
            slope, foot = np.polyfit(h_samples[low] - height_px, lane[low], 1)
            del slope
            feet.append((float(foot) - 0.5 * width_px, lane))
    left = max((foot for foot in feet if foot[0] < 0.0), key=lambda foot: foot[0], default=None)
    right = min((foot for foot in feet if foot[0] >= 0.0), key=lambda foot: foot[0], default=None)
    return [foot[1] for foot in (left, right) if foot is not None]


def _lane_angle_rad(lane: FloatArray, rows: FloatArray) -> float:
    """Return the angle from the vertical of the line fitted to the present points; 0 with fewer than two."""
    present = lane >= 0
    if present.sum() < 2:
        return 0.0
    v, u = rows[present], lane[present]
    v = v - v.mean()
    spread = float(v @ v)
    return math.atan(float(v @ (u - u.mean())) / spread) if spread > 0 else 0.0


def _absent_as_minus_100(lane: FloatArray) -> FloatArray:
    """Return the lane with `TUSIMPLE_ABSENT_POINT_COLUMN_PX` for absent points."""
    return np.where(lane >= 0, lane, TUSIMPLE_ABSENT_POINT_COLUMN_PX)


@dataclass(frozen=True)
class VisualScore:
    """zhang2011's visual standard for one frame.

    Attributes:
        left_share, right_share: Share of the boundary's visible rows within the tolerance; NaN if it has none.
        is_correct: Both reach 85 %. A boundary without visible rows is not judged; a frame without any is not correct.
    """

    left_share: float
    right_share: float
    is_correct: bool


def share_of_rows_within_tolerance(
    u_px: FloatArray,
    truth_u_px: FloatArray,
    visible: BoolArray,
    *,
    tolerance_px: float = VISUAL_STANDARD_COLUMN_TOLERANCE_PX,
    half_width_px: FloatArray | float = 0.0,
) -> float:
    """Return the share of the visible rows on which a boundary is at most tolerance_px from the truth.

    Args:
        u_px, truth_u_px: Shape (n,): columns; NaN is 'not found', which counts as a miss.
        visible: Shape (n,): rows to judge.
        tolerance_px: Greatest distance that counts as correct.
        half_width_px: Shape (n,), of the painted stripe around truth_u_px: then the distance is that from the paint.

    Returns:
        0 to 1; NaN without visible rows.
    """
    if not visible.any():
        return math.nan
    reach_px = np.broadcast_to(np.asarray(half_width_px), u_px.shape)[visible] + tolerance_px
    with np.errstate(invalid="ignore"):
        return float(np.mean(np.abs(u_px[visible] - truth_u_px[visible]) <= reach_px))


class BoundaryColumns(NamedTuple):
    """One boundary in a frame, by row.

    Attributes:
        u_px: Shape (n,): found columns, NaN where not found.
        truth_u_px: Shape (n,).
        is_visible: Shape (n,): rows to judge. (zhang2011 searches the lower 150 rows of 240: let the rows above count
            as not visible.)
        half_width_px: Of the painted stripe, shape (n,) or one number: then a line on the paint is no error, whichever
            of the stripe's edges a method follows. 0: the truth is a line.
    """

    u_px: FloatArray
    truth_u_px: FloatArray
    is_visible: BoolArray
    half_width_px: FloatArray | float = 0.0


def visual_standard_score(
    left: BoundaryColumns, right: BoundaryColumns, *, width_px: int = VISUAL_REFERENCE_IMAGE_WIDTH_PX
) -> VisualScore:
    """Judge one frame by the visual standard.

    Args:
        left, right: The boundaries.
        width_px: Of the image: the tolerance of 6 pixels belongs to 320 and scales.
    """
    tolerance = VISUAL_STANDARD_COLUMN_TOLERANCE_PX * width_px / VISUAL_REFERENCE_IMAGE_WIDTH_PX
    shares = [
        share_of_rows_within_tolerance(
            each.u_px, each.truth_u_px, each.is_visible, tolerance_px=tolerance, half_width_px=each.half_width_px
        )
        for each in (left, right)
    ]
    known_shares = [share for share in shares if not math.isnan(share)]
    return VisualScore(
        shares[0],
        shares[1],
        bool(known_shares) and all(share >= VISUAL_STANDARD_MIN_ROW_SHARE for share in known_shares),
    )


@dataclass(frozen=True)
class WidthScore:
    """Statistics of how steady the lane's width is over a drive.

    Attributes:
        n: Number of frames with a width.
        median_m: Median width.
        share_near: Share of the frames within the tolerance of the median.
        std_m: Standard deviation of the width.
        max_jump_m: Greatest change between neighbouring frames that both have a width.
    """

    n: int
    median_m: float
    share_near: float
    std_m: float
    max_jump_m: float


def lane_width_stability(width_m: FloatArray, *, tolerance: float = 0.05) -> WidthScore:
    """Judge lane widths of shape (frames,), NaN where a boundary was not found; tolerance is a share of the median."""
    known = width_m[np.isfinite(width_m)]
    if not len(known):
        return WidthScore(0, math.nan, math.nan, math.nan, math.nan)
    median = float(np.median(known))
    return WidthScore(
        n=len(known),
        median_m=median,
        share_near=float(np.mean(np.abs(known - median) <= tolerance * median)),
        std_m=float(known.std()),
        max_jump_m=max_step_between_frames(width_m),
    )


def max_step_between_frames(values: FloatArray) -> float:
    """Return the greatest change between neighbouring frames that both have a value; NaN if there are none."""
    steps = np.abs(np.diff(values))
    steps = steps[np.isfinite(steps)]
    return float(steps.max()) if len(steps) else math.nan
