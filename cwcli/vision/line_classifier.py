"""The kind and the colour of both boundaries over time: single frames (`line_kind`, `line_colour`) vote on them.

Frames vote a few times a second, and their votes fade slowly, so that a change from solid to dashed shows after about
two seconds. A lane that is found anew, or takes the place of another one, begins without votes; in a
lane change the line that is crossed keeps its own.
"""

from __future__ import annotations

import math
from dataclasses import field, replace
from typing import TypeVar

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.vision.boundary import LineColour, LineKind
from cwcli.vision.encoded import Image
from cwcli.vision.lane_detect import StripeEvidence
from cwcli.vision.lane_model import HORIZON, WIDTH, ImageLane, boundary_columns_in_rows_px
from cwcli.vision.line_kind import LineKindInFrame, classify_lines_in_frame
from cwcli.vision.method import LaneFit, LaneFrame

MIN_TIME_BETWEEN_VOTING_FRAMES_S = 0.45
"""Least time in seconds between two frames that vote. Chosen by hand: it bounds the time of a frame."""
KIND_VOTE_DECAY_TIME_S = 1.5
"""Time constant in seconds with which votes for a kind fade. Chosen by hand; not fitted."""
COLOUR_VOTE_DECAY_TIME_S = 4.0
"""Time constant in seconds with which votes for a colour fade: frames in colour come once a second. Chosen by hand; not
fitted."""
MIN_VOTE_SUM = 0.3
"""Least sum of votes from which a kind or a colour follows. Chosen by hand; not fitted."""
MIN_VOTE_SHARE_OF_WINNER = 0.6
"""Share of the votes that the winning kind or colour must have. Chosen by hand; not fitted."""
MIN_VOTE_SHARE_OF_DOUBLE_LINE = 0.4
"""Share of the votes from which a line counts as double. Chosen by hand; not fitted."""
Name = TypeVar("Name", LineKind, LineColour)
MIN_DEPTH_BELOW_HORIZON_TO_READ_COLOUR_PX = 22.0
"""Least number of rows below the horizon at which colours are read: there a stripe of 12 cm, 1.3 m below the camera, is
two pixels wide."""
ROAD_SAMPLE_DISTANCE_IN_CAMERA_HEIGHTS = 0.4
"""Distance from a line towards the lane's middle at which the road is read, over the camera's height: half a metre.
Chosen by hand; not fitted."""
MIN_PAINT_EVIDENCE = 0.3
"""Evidence above which a row counts as painted. Chosen by hand; not fitted."""
MIN_PAINTED_ROWS = 3
"""Least number of painted rows from which a colour follows. Chosen by hand; not fitted."""
MIN_PAINT_CONTRAST_GREY = 8.0
"""Least brightness of paint above the road, in grey levels, in the mean of red and green. Chosen by hand; not
fitted."""
MAX_BLUE_TO_RED_AND_GREEN_RATIO_OF_YELLOW_PAINT, MIN_BLUE_TO_RED_AND_GREEN_RATIO_OF_WHITE_PAINT = 0.6, 0.75
"""Limits of the ratio of paint's extra brightness in blue to that in red and green, each over the road's: yellow below,
white above, unknown between. The ratio is 1 for white however much road a pixel shows beside the paint, about 0 for
yellow. Chosen by hand; not fitted."""


@dataclass
class _LineVotes:
    """Votes for the kind and the colour of one boundary."""

    kinds: dict[LineKind, float] = field(default_factory=dict)
    doubles: dict[bool, float] = field(default_factory=dict)
    colours: dict[LineColour, float] = field(default_factory=dict)

    def fade_votes_by_time_step(self, dt_s: float) -> None:
        """Let the votes so far fade for a time step."""
        kept_share = math.exp(-dt_s / KIND_VOTE_DECAY_TIME_S)
        self.kinds = {kind: kept_share * votes for kind, votes in self.kinds.items()}
        self.doubles = {is_double: kept_share * votes for is_double, votes in self.doubles.items()}
        kept_share = math.exp(-dt_s / COLOUR_VOTE_DECAY_TIME_S)
        self.colours = {colour: kept_share * votes for colour, votes in self.colours.items()}

    def add_votes_of_frame(self, kind_in_frame: LineKindInFrame, colour: LineColour) -> None:
        """Add the votes of a frame."""
        if kind_in_frame.kind is not LineKind.UNKNOWN:
            self.kinds[kind_in_frame.kind] = self.kinds.get(kind_in_frame.kind, 0.0) + 1.0
        if kind_in_frame.is_double is not None:
            self.doubles[kind_in_frame.is_double] = self.doubles.get(kind_in_frame.is_double, 0.0) + 1.0
        if colour is not LineColour.UNKNOWN:
            self.colours[colour] = self.colours.get(colour, 0.0) + 1.0

    def majority_kind(self) -> LineKind:
        """The kind with a clear majority, else `UNKNOWN`."""
        total = sum(self.doubles.values())
        if total >= MIN_VOTE_SUM and self.doubles.get(True, 0.0) > MIN_VOTE_SHARE_OF_DOUBLE_LINE * total:
            return LineKind.DOUBLE
        return _majority_value(self.kinds, LineKind.UNKNOWN)

    def majority_colour(self) -> LineColour:
        """The colour with a clear majority, else `UNKNOWN`."""
        return _majority_value(self.colours, LineColour.UNKNOWN)


def _majority_value(votes: dict[Name, float], unknown: Name) -> Name:
    """The value with a clear majority of the votes, else `unknown`."""
    total = sum(votes.values())
    best = max(votes, key=votes.__getitem__, default=unknown)
    return best if total >= MIN_VOTE_SUM and votes[best] > MIN_VOTE_SHARE_OF_WINNER * total else unknown


_UNKNOWN_KIND_AND_COLOUR = (LineKind.UNKNOWN, LineColour.UNKNOWN)
"""Kind and colour of a boundary without enough votes."""


class LineClassifier:
    """Finds the kind and the colour of a followed lane's boundaries by votes of its frames."""

    def __init__(self) -> None:
        self._votes = _LineVotes(), _LineVotes()
        self._names = _UNKNOWN_KIND_AND_COLOUR, _UNKNOWN_KIND_AND_COLOUR
        self._asked_ns: int | None = None

    def fit_with_kinds_and_colours(
        self, fit: LaneFit, frame: LaneFrame, evidence: StripeEvidence | None, lane: ImageLane | None
    ) -> LaneFit:
        """The fit with the kind and the colour of its boundaries.

        Args:
            lane: The fitted lane, shape (6,); None where there is none.
        """
        if fit.lane_change:
            crossed, beyond = self._votes if fit.lane_change > 0 else self._votes[::-1]
            beyond = _LineVotes()
            self._votes = (beyond, crossed) if fit.lane_change > 0 else (crossed, beyond)
            self._update_kinds_and_colours()
        elif fit.steady_s == 0.0 or lane is None:
            self._votes, self._names, self._asked_ns = (
                (_LineVotes(), _LineVotes()),
                (_UNKNOWN_KIND_AND_COLOUR, _UNKNOWN_KIND_AND_COLOUR),
                None,
            )
        if evidence is None or lane is None or not (fit.left.found or fit.right.found):
            return fit
        since_s = math.inf if self._asked_ns is None else (frame.stamp_ns - self._asked_ns) / 1e9
        if since_s >= MIN_TIME_BETWEEN_VOTING_FRAMES_S or frame.colour is not None:
            self._asked_ns = frame.stamp_ns
            self._collect_frame_votes(fit, frame, evidence, lane, 0.0 if math.isinf(since_s) else max(since_s, 0.0))
        left, right = (
            replace(side, kind=kind, colour=colour) if side.found else side
            for side, (kind, colour) in zip((fit.left, fit.right), self._names, strict=True)
        )
        return replace(fit, left=left, right=right)

    def _collect_frame_votes(
        self, fit: LaneFit, frame: LaneFrame, evidence: StripeEvidence, lane: ImageLane, since_s: float
    ) -> None:
        """Let a frame vote on both boundaries."""
        seen = classify_lines_in_frame(evidence, lane)
        colours = (LineColour.UNKNOWN, LineColour.UNKNOWN)
        if frame.colour is not None:
            colours = classify_line_colours(frame.colour, evidence, lane)
        sides = zip((fit.left, fit.right), self._votes, seen, colours, strict=True)
        for side, votes, line, colour in sides:
            votes.fade_votes_by_time_step(since_s)
            if side.found:
                votes.add_votes_of_frame(line, colour)
        self._update_kinds_and_colours()

    def _update_kinds_and_colours(self) -> None:
        """Update the kinds and colours of both boundaries from their votes."""
        left, right = self._votes
        self._names = (left.majority_kind(), left.majority_colour()), (right.majority_kind(), right.majority_colour())


def classify_line_colours(picture: Image, evidence: StripeEvidence, lane: ImageLane) -> tuple[LineColour, LineColour]:
    """The colours of the left and the right boundary in one frame.

    Args:
        picture: Shape (height, width, 3): blue, green, red, of the size of the frame that was searched.
    """
    pinhole = evidence.pinhole
    first = int(
        np.searchsorted(
            evidence.rows, float(lane[HORIZON]) + MIN_DEPTH_BELOW_HORIZON_TO_READ_COLOUR_PX / pinhole.focal_length_ratio
        )
    )
    rows, sharp = evidence.rows[first:], evidence.sharp[first:]
    inner = np.array(lane)
    inner[WIDTH] -= 2.0 * ROAD_SAMPLE_DISTANCE_IN_CAMERA_HEIGHTS * pinhole.focal_length_ratio
    lines = zip(
        *(boundary_columns_in_rows_px(each, rows.astype(np.float64), pinhole) for each in (lane, inner)), strict=True
    )
    colours = []
    for paint_px, road_px in lines:
        both = np.stack([paint_px, road_px])
        with np.errstate(invalid="ignore"):
            in_image = np.flatnonzero(((both >= 0.0) & (both <= picture.shape[1] - 1.0)).all(axis=0))
        paint_u, road_u = np.rint(both[:, in_image]).astype(np.intp)
        is_painted = sharp[in_image, paint_u] > MIN_PAINT_EVIDENCE
        paint, road = (picture[rows[in_image], u][is_painted] for u in (paint_u, road_u))
        colours.append(_classify_paint_colour(paint.astype(np.float64), road.astype(np.float64)))
    return colours[0], colours[1]


def _classify_paint_colour(paint: FloatArray, road: FloatArray) -> LineColour:
    """The colour that pixels of paint have relative to pixels of the road, shape (n, 3) each."""
    if len(paint) < MIN_PAINTED_ROWS or not np.ptp(np.concatenate([paint, road]), axis=1).any():
        return LineColour.UNKNOWN  # grey pictures have no colour
    blue, others = _blue_and_red_green_mean(paint)
    road_blue, road_others = _blue_and_red_green_mean(road)
    if others - road_others < MIN_PAINT_CONTRAST_GREY:
        return LineColour.UNKNOWN
    ratio = (blue - road_blue) / (others - road_others) / (road_blue / road_others)
    if ratio < MAX_BLUE_TO_RED_AND_GREEN_RATIO_OF_YELLOW_PAINT:
        return LineColour.YELLOW
    return LineColour.WHITE if ratio > MIN_BLUE_TO_RED_AND_GREEN_RATIO_OF_WHITE_PAINT else LineColour.UNKNOWN


def _blue_and_red_green_mean(pixels: FloatArray) -> tuple[float, float]:
    """Mean of blue, and mean of red and green, each at least one grey level."""
    blue, green, red = pixels.mean(axis=0).tolist()
    return max(blue, 1.0), max(0.5 * (green + red), 1.0)
