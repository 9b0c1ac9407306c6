"""The two lines of a lane, each followed alone: where a ramp leaves or joins, one of them runs aside from the lane.

The boundaries of a lane are parallel, and its width stays. Where an exit begins, the paint of one boundary leaves it
over a taper, so the lanes that the two lines give, each alone with the width that the lane had, move apart. Then the
lane goes on by the line that lies where the lane was predicted from the car's motion; the other boundary is carried
beside it until its line, or another one, lies there again. While a boundary is carried, only its own paint counts for
its probability (`boundary_probability`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.vision.boundary_probability import left_and_right_paint_shares
from cwcli.vision.camera import WidthHeightPx
from cwcli.vision.lane_detect import StripeEvidence, refine_lanes
from cwcli.vision.lane_following import narrow_prior_table
from cwcli.vision.lane_model import (
    BEND,
    HIGH,
    LOW,
    MEAN,
    MIDDLE,
    SPIRAL,
    VANISHING,
    WIDTH,
    ImageLane,
    ImageLanes,
    LanePrior,
    LanePriorTable,
)

NO_LINE, LEFT, RIGHT = -1, 0, 1
"""Numbers of the lines: none, the left one, the right one."""
COMPARISON_DISTANCES_M = np.array([7.0, 25.0])
"""Distances ahead at which the lanes by both lines are compared, in metres. Chosen by hand; not fitted."""
MAX_DIVERGENCES_OF_PARALLEL_LINES_M = np.array([0.1, 0.2])
"""Distances in metres between both lanes, at those places, above which the lines are not parallel: a taper of 1 : 60 at
both."""
AGREEMENT_SHARE_OF_DIVERGENCE_LIMITS = 0.4
"""Share of those distances below which both lines give the same lane. Chosen by hand; not fitted."""
MIN_DISTANCE_OF_DEPARTED_LINE_TO_SEARCH_PLACE_AGAIN_M = 0.5
"""Distance in metres from which a line that has left is looked for again in its place. Chosen by hand; not fitted."""
MIN_PAINT_SHARE_TO_GIVE_LANE = 0.05
"""Least share of paint with which a line gives a lane. Chosen by hand; not fitted."""
MIN_PAINT_OF_BOTH_LINES_TO_COMPARE_SHAPES_SHARE = 0.1
"""Least share of paint of both lines with which their shapes are compared: two or three dots fit any bend. Chosen on
drives with raised dots (docs/lanes.md)."""
DIVERGENCE_SMOOTHING_TIME_CONSTANT_S = 0.3
"""Time constant in seconds with which the distance between both lanes is smoothed. Chosen by hand; not fitted."""
BEND_SMOOTHING_TIME_CONSTANT_S = 1.0
"""Time constant in seconds with which the bends of both lines are smoothed. In that time a road's bend changes by
0.0003 1/m (a clothoid of A = 300 m at 25 m/s), that of a line with a kink by more."""
LANE_WIDTH_SMOOTHING_TIME_S = 3.0
"""Time constant in seconds with which the lane's width is smoothed. Chosen by hand; not fitted."""
MIN_AGREED_TIME_OF_KNOWN_WIDTH_S = 1.0
"""Time in seconds after which the lane's width counts as known. Chosen by hand; not fitted."""
MAX_TIME_OF_LANE_GIVEN_BY_ONE_LINE_S = 10.0
"""Longest time in seconds for which a lane goes on by one line: a taper of 240 m takes as long. Later any other lane
may be the right one."""
MAX_CHANGE_OF_KNOWN_LANE_WIDTH_M = 0.15
"""Greatest change of the lane's width in metres once it is known. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class LinePairState:
    """State of a followed lane's two lines.

    Attributes:
        width: Width of the lane over the last seconds, over the camera's height.
        agreed_s: Time for which both lines agreed.
        by_one_line_s: Time for which the lane has gone on by one line since both were last seen to agree.
        lanes_by_line: Shape (2, 6): the lane by its left line alone, and by its right one.
        smoothed_bends_px2: Shape (2,): bends of both lines over the last second (px^2).
        driven_bend_px2: The bend in which the car drove (px^2); NaN where it is not known.
        divergence_m: Shape (2,): place of the left line's lane minus that of the right line's, ahead (m, right
            positive).
        bend_doubt_px2: How much worse the right line's bend fits the road than the left line's (px^2).
        greatest_bend_doubt_px2: The doubt of the greatest size since the lines are apart.
        leaving_side: The line that leaves the lane, or `NO_LINE`.
        carried_side: The boundary whose place follows from the other line, or `NO_LINE`.
    """

    width: float
    agreed_s: float
    by_one_line_s: float
    lanes_by_line: FloatArray
    smoothed_bends_px2: FloatArray
    driven_bend_px2: float
    divergence_m: FloatArray
    bend_doubt_px2: float
    greatest_bend_doubt_px2: float
    leaving_side: int
    carried_side: int = NO_LINE

    @property
    def is_width_known(self) -> bool:
        """Whether the width is known."""
        return self.agreed_s >= MIN_AGREED_TIME_OF_KNOWN_WIDTH_S

    @property
    def do_lines_agree(self) -> bool:
        """Whether both lines agreed when they were last seen."""
        return self.by_one_line_s == 0.0 and bool(
            (
                np.abs(self.divergence_m) < AGREEMENT_SHARE_OF_DIVERGENCE_LIMITS * MAX_DIVERGENCES_OF_PARALLEL_LINES_M
            ).all()
        )

    def may_be_replaced_by(self, lane: ImageLane, prior: LanePrior) -> bool:
        """Whether another lane may take this one's place: both lines agree, and its width is the known one."""
        is_as_wide = abs(float(lane[WIDTH]) - self.width) <= MAX_CHANGE_OF_KNOWN_LANE_WIDTH_M * prior.place_units_per_m
        return not self.is_width_known or (is_as_wide and self.by_one_line_s == 0.0)

    def with_updated_width(self, width: float, dt_s: float) -> LinePairState:
        """The state after a frame in which both lines gave a lane of this width."""
        seen_s = self.agreed_s + dt_s
        share = max(1.0 - math.exp(-dt_s / LANE_WIDTH_SMOOTHING_TIME_S), dt_s / max(seen_s, dt_s, 1e-9))
        return replace(self, width=self.width + share * (width - self.width), agreed_s=seen_s)


def initial_line_pair_state(lane: ImageLane) -> LinePairState:
    """The first state, for a lane that has just been found."""
    both = np.stack([lane, lane])
    return LinePairState(float(lane[WIDTH]), 0.0, 0.0, both, both[:, BEND], math.nan, np.zeros(2), 0.0, 0.0, NO_LINE)


def prior_with_known_width(prior: LanePrior, sides: LinePairState | None) -> LanePrior:
    """The prior with limits around the lane's width, once the width is known."""
    if sides is None or not sides.is_width_known:
        return prior
    table, reach = prior.table.copy(), MAX_CHANGE_OF_KNOWN_LANE_WIDTH_M * prior.place_units_per_m
    table[WIDTH, LOW] = max(table[WIDTH, LOW], sides.width - reach)
    table[WIDTH, HIGH] = min(table[WIDTH, HIGH], sides.width + reach)
    return prior.with_table(table)


def lane_by_one_line_and_paint_share(
    evidence: StripeEvidence,
    lane: ImageLane,
    table: LanePriorTable,
    size: WidthHeightPx,
    side: int,
    width_camera_heights: float,
) -> tuple[ImageLane, float]:
    """The lane that one line gives, shape (6,), and the share of the line that shows paint.

    The line is searched as the boundary of a lane that is so wide that its other boundary is out of sight.

    Args:
        lane: The predicted lane, shape (6,).
        table: The prior's table around the prediction.
        side: `LEFT` or `RIGHT`.
        width_camera_heights: Width of the lane, over the camera's height.
    """
    sign = 1.0 if side == LEFT else -1.0
    wider = 2.0 * size[0] / evidence.min_depth_px
    lane, table = lane.copy(), table.copy()
    for k, more in ((WIDTH, wider), (MIDDLE, 0.5 * sign * wider)):
        lane[k] += more
        table[k, [MEAN, LOW, HIGH]] += more
    lane = np.clip(lane, table[:, LOW], table[:, HIGH])  # from a lane that can't be, no search comes back
    lanes, _ = refine_lanes(evidence, lane, table, size, use_wide_evidence=True, neighbour_weight=0.0)
    lanes, _ = refine_lanes(
        evidence, lanes[0], table, size, use_wide_evidence=False, step_scale=0.5, neighbour_weight=0.0
    )
    best = lanes[0]
    best[MIDDLE] += 0.5 * sign * (width_camera_heights - best[WIDTH])
    best[WIDTH] = width_camera_heights
    return best, float(left_and_right_paint_shares(evidence, best)[side])


def lane_middle_places_ahead_m(lane: ImageLane, prior: LanePrior) -> FloatArray:
    """Places of a lane's middle at the comparison distances, shape (2,), right positive, up to what all lanes of a
    camera share."""
    focal_px = prior.pinhole.focal_px
    h = focal_px / (prior.place_units_per_m * COMPARISON_DISTANCES_M)  # fy H / x
    u_px = lane[VANISHING] + lane[MIDDLE] * h + (lane[BEND] + lane[SPIRAL] / h) / h
    return np.asarray(u_px * COMPARISON_DISTANCES_M / focal_px)


class FrameStep(NamedTuple):
    """The step to a frame from the one before.

    Attributes:
        size: Width and height of the image.
        dt_s: Time since the frame before.
        sideways_mps: Greatest lateral speed at which the prediction may be wrong.
    """

    size: tuple[int, int]
    dt_s: float
    sideways_mps: float


def update_lane_and_line_state(
    sides: LinePairState,
    evidence: StripeEvidence,
    lane_by_both_lines: ImageLane,
    prior: LanePrior,
    driven_bend_px2: float,
    step: FrameStep,
) -> tuple[ImageLane, LinePairState]:
    """Update the lane and the state of its lines from a new frame.

    Args:
        sides: The state before; its lanes are predicted for this frame.
        lane_by_both_lines: The lane by both lines, shape (6,).
        step: The step from the state before.

    Returns:
        The lane, shape (6,), by both lines or by the one that stays; and the state after the frame.
    """
    size, dt_s = step.size, step.dt_s
    lanes, shares = np.empty((2, 6)), [0.0, 0.0]
    for side in (LEFT, RIGHT):
        before = sides.lanes_by_line[side]
        table = narrow_prior_table(prior, before, dt_s, step.sideways_mps)
        lanes[side], shares[side] = lane_by_one_line_and_paint_share(evidence, before, table, size, side, sides.width)
    if min(shares) >= MIN_PAINT_OF_BOTH_LINES_TO_COMPARE_SHAPES_SHARE:
        sides = _update_line_comparison(
            sides,
            lanes,
            lane_middle_places_ahead_m(lanes[LEFT], prior) - lane_middle_places_ahead_m(lanes[RIGHT], prior),
            driven_bend_px2,
            dt_s,
        )
        if sides.leaving_side == NO_LINE:
            sides = sides.with_updated_width(float(lane_by_both_lines[WIDTH]), dt_s)
    kept_side = NO_LINE
    if sides.leaving_side != NO_LINE:
        kept_side = 1 - sides.leaving_side
    elif min(shares) < MIN_PAINT_SHARE_TO_GIVE_LANE <= max(shares) and sides.is_width_known:
        kept_side = int(np.argmax(shares))
    if kept_side != NO_LINE:
        lane_by_both_lines = np.clip(lanes[kept_side], prior.table[:, LOW], prior.table[:, HIGH])
    is_away = abs(float(sides.divergence_m[0])) > MIN_DISTANCE_OF_DEPARTED_LINE_TO_SEARCH_PLACE_AGAIN_M
    for side in (LEFT, RIGHT):
        if shares[side] < MIN_PAINT_SHARE_TO_GIVE_LANE or (side == sides.leaving_side and is_away):
            lanes[side] = lane_by_both_lines  # and looked for again where it should be
            sides = replace(
                sides,
                smoothed_bends_px2=np.full(2, lane_by_both_lines[BEND]),
                divergence_m=np.zeros(2),
                bend_doubt_px2=0.0,
                greatest_bend_doubt_px2=0.0,
                leaving_side=NO_LINE,
            )
    if kept_side != NO_LINE:
        sides = replace(sides, by_one_line_s=sides.by_one_line_s + dt_s, carried_side=1 - kept_side)
    elif min(shares) >= MIN_PAINT_SHARE_TO_GIVE_LANE:
        sides = replace(sides, by_one_line_s=0.0, carried_side=NO_LINE)
    if sides.by_one_line_s > MAX_TIME_OF_LANE_GIVEN_BY_ONE_LINE_S:
        return lane_by_both_lines, replace(initial_line_pair_state(lane_by_both_lines), carried_side=sides.carried_side)
    return lane_by_both_lines, replace(sides, lanes_by_line=lanes)


def _update_line_comparison(
    sides: LinePairState, lanes: ImageLanes, apart_m: FloatArray, driven: float, dt_s: float
) -> LinePairState:
    """The state after both lines were seen: the lanes by each, shape (2, 6), and their distance ahead, shape (2,)."""
    swift, slow = (
        1.0 - math.exp(-dt_s / DIVERGENCE_SMOOTHING_TIME_CONSTANT_S),
        1.0 - math.exp(-dt_s / BEND_SMOOTHING_TIME_CONSTANT_S),
    )
    if math.isfinite(sides.driven_bend_px2):
        driven = sides.driven_bend_px2 + swift * (driven - sides.driven_bend_px2)
    divergence_m = sides.divergence_m + swift * (apart_m - sides.divergence_m)
    strange = np.abs(lanes[:, BEND] - sides.smoothed_bends_px2) + np.abs(sides.smoothed_bends_px2 - driven)
    doubt = sides.bend_doubt_px2 + slow * (float(strange[RIGHT] - strange[LEFT]) - sides.bend_doubt_px2)
    bends = sides.smoothed_bends_px2 + slow * (lanes[:, BEND] - sides.smoothed_bends_px2)
    verdict, leaving = max(sides.greatest_bend_doubt_px2, doubt, key=abs), sides.leaving_side
    conflict = float((np.abs(divergence_m) / MAX_DIVERGENCES_OF_PARALLEL_LINES_M).max())
    if conflict < AGREEMENT_SHARE_OF_DIVERGENCE_LIMITS:
        verdict, leaving = 0.0, NO_LINE
    elif sides.is_width_known and (conflict > 1.0 or leaving != NO_LINE):
        leaving = RIGHT if verdict > 0.0 else LEFT
    return replace(
        sides,
        smoothed_bends_px2=bends,
        driven_bend_px2=driven,
        divergence_m=divergence_m,
        bend_doubt_px2=doubt,
        greatest_bend_doubt_px2=verdict,
        leaving_side=leaving,
    )
