"""The two lines of a lane, each followed alone: where a ramp leaves or joins, one of them runs aside from the lane.

The boundaries of a lane are parallel, and its width stays. Where an exit begins, the paint of one boundary leaves it
over a taper, so the lanes that the two lines give, each alone with the width that the lane had, move apart. Then the
lane goes on by the line that lies where the lane was predicted from the car's motion; the other boundary is carried
beside it until its line, or another one, lies there again. While a boundary is carried, only its own paint counts for
its probability (`lane_belief`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.vision.lane_belief import supports
from cwcli.vision.lane_detect import Evidence, refined
from cwcli.vision.lane_following import narrowed
from cwcli.vision.lane_model import (
    BEND,
    HIGH,
    LOW,
    MEAN,
    MIDDLE,
    SPIRAL,
    VANISHING,
    WIDTH,
    LanePrior,
)

NO_LINE, LEFT, RIGHT = -1, 0, 1
"""Numbers of the lines: none, the left one, the right one."""
AT_M = np.array([7.0, 25.0])
"""Distances ahead at which the lanes by both lines are compared, in metres. Chosen by hand; not fitted."""
APART_M = np.array([0.1, 0.2])
"""Distances in metres between both lanes, at those places, above which the lines are not parallel: a taper of 1 : 60 at
both."""
PARALLEL = 0.4
"""Share of those distances below which both lines give the same lane. Chosen by hand; not fitted."""
AWAY_M = 0.5
"""Distance in metres from which a line that has left is looked for again in its place. Chosen by hand; not fitted."""
LEAST_SUPPORT = 0.05
"""Least share of paint with which a line gives a lane. Chosen by hand; not fitted."""
SHAPE_SUPPORT = 0.1
"""Least share of paint of both lines with which their shapes are compared: two or three dots fit any bend. Chosen on
drives with raised dots (docs/lanes.md)."""
MEMORY_S = 0.3
"""Time constant in seconds with which the distance between both lanes is smoothed. Chosen by hand; not fitted."""
BEND_S = 1.0
"""Time constant in seconds with which the bends of both lines are smoothed. In that time a road's bend changes by
0.0003 1/m (a clothoid of A = 300 m at 25 m/s), that of a line with a kink by more."""
WIDTH_S = 3.0
"""Time constant in seconds with which the lane's width is smoothed. Chosen by hand; not fitted."""
SETTLED_S = 1.0
"""Time in seconds after which the lane's width counts as known. Chosen by hand; not fitted."""
LONGEST_S = 10.0
"""Longest time in seconds for which a lane goes on by one line: a taper of 240 m takes as long. Later any other lane
may be the right one."""
WIDTH_REACH_M = 0.15
"""Greatest change of the lane's width in metres once it is known. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class Sides:
    """State of a followed lane's two lines.

    Attributes:
        width: Width of the lane over the last seconds, over the camera's height.
        seen_s: Time for which both lines agreed.
        alone_s: Time for which the lane has gone on by one line since both were last seen to agree.
        lanes: Shape (2, 6): the lane by its left line alone, and by its right one.
        bends: Shape (2,): bends of both lines over the last second (px^2).
        driven: The bend in which the car drove (px^2); NaN where it is not known.
        apart: Shape (2,): place of the left line's lane minus that of the right line's, ahead (m, right positive).
        doubt: How much worse the right line's bend fits the road than the left line's (px^2).
        verdict: The doubt of the greatest size since the lines are apart.
        leaving: The line that leaves the lane, or `NO_LINE`.
        carried: The boundary whose place follows from the other line, or `NO_LINE`.
    """

    width: float
    seen_s: float
    alone_s: float
    lanes: FloatArray
    bends: FloatArray
    driven: float
    apart: FloatArray
    doubt: float
    verdict: float
    leaving: int
    carried: int = NO_LINE

    @property
    def is_settled(self) -> bool:
        """Whether the width is known."""
        return self.seen_s >= SETTLED_S

    @property
    def is_quiet(self) -> bool:
        """Whether both lines agreed when they were last seen."""
        return self.alone_s == 0.0 and bool((np.abs(self.apart) < PARALLEL * APART_M).all())

    def may_become(self, lane: FloatArray, prior: LanePrior) -> bool:
        """Whether another lane may take this one's place: both lines agree, and its width is the known one."""
        is_as_wide = abs(float(lane[WIDTH]) - self.width) <= WIDTH_REACH_M * prior.per_m
        return not self.is_settled or (is_as_wide and self.alone_s == 0.0)

    def learned(self, width: float, dt_s: float) -> Sides:
        """The state after a frame in which both lines gave a lane of this width."""
        seen_s = self.seen_s + dt_s
        share = max(1.0 - math.exp(-dt_s / WIDTH_S), dt_s / max(seen_s, dt_s, 1e-9))
        return replace(self, width=self.width + share * (width - self.width), seen_s=seen_s)


def sides_of(lane: FloatArray) -> Sides:
    """The first state, for a lane that has just been found."""
    both = np.stack([lane, lane])
    return Sides(float(lane[WIDTH]), 0.0, 0.0, both, both[:, BEND], math.nan, np.zeros(2), 0.0, 0.0, NO_LINE)


def as_wide(prior: LanePrior, sides: Sides | None) -> LanePrior:
    """The prior with limits around the lane's width, once the width is known."""
    if sides is None or not sides.is_settled:
        return prior
    table, reach = prior.table.copy(), WIDTH_REACH_M * prior.per_m
    table[WIDTH, LOW] = max(table[WIDTH, LOW], sides.width - reach)
    table[WIDTH, HIGH] = min(table[WIDTH, HIGH], sides.width + reach)
    return prior.with_table(table)


def by_one_line(
    evidence: Evidence, lane: FloatArray, table: FloatArray, size: tuple[int, int], side: int, width: float
) -> tuple[FloatArray, float]:
    """The lane that one line gives, shape (6,), and the share of the line that shows paint.

    The line is searched as the boundary of a lane that is so wide that its other boundary is out of sight.

    Args:
        evidence: The stripes of the frame.
        lane: The predicted lane, shape (6,).
        table: The prior's table around the prediction.
        size: Width and height of the image.
        side: `LEFT` or `RIGHT`.
        width: Width of the lane, over the camera's height.
    """
    sign = 1.0 if side == LEFT else -1.0
    wider = 2.0 * size[0] / evidence.min_h
    lane, table = lane.copy(), table.copy()
    for k, more in ((WIDTH, wider), (MIDDLE, 0.5 * sign * wider)):
        lane[k] += more
        table[k, [MEAN, LOW, HIGH]] += more
    lane = np.clip(lane, table[:, LOW], table[:, HIGH])  # from a lane that can't be, no search comes back
    lanes, _ = refined(evidence, lane, table, size, wide=True, beside=0.0)
    lanes, _ = refined(evidence, lanes[0], table, size, wide=False, scale=0.5, beside=0.0)
    best = lanes[0]
    best[MIDDLE] += 0.5 * sign * (width - best[WIDTH])
    best[WIDTH] = width
    return best, float(supports(evidence, best)[side])


def places_m(lane: FloatArray, prior: LanePrior) -> FloatArray:
    """Places of a lane's middle at the comparison distances, shape (2,), right positive, up to what all lanes of a
    camera share."""
    focal_px = prior.pinhole.focal_px
    h = focal_px / (prior.per_m * AT_M)  # fy H / x
    u_px = lane[VANISHING] + lane[MIDDLE] * h + (lane[BEND] + lane[SPIRAL] / h) / h
    return np.asarray(u_px * AT_M / focal_px)


def kept(
    sides: Sides,
    evidence: Evidence,
    found: FloatArray,
    prior: LanePrior,
    size: tuple[int, int],
    driven: float,
    dt_s: float,
    sideways_mps: float,
) -> tuple[FloatArray, Sides]:
    """Update the lane and the state of its lines from a new frame.

    Args:
        sides: The state before; its lanes are predicted for this frame.
        evidence: The stripes of the frame.
        found: The lane by both lines, shape (6,).
        prior: The prior of a followed lane.
        size: Width and height of the image.
        driven: The bend in which the car drives (px^2).
        dt_s: Time since the state before.
        sideways_mps: Greatest lateral speed at which the prediction may be wrong.

    Returns:
        The lane, shape (6,), by both lines or by the one that stays; and the state after the frame.
    """
    lanes, shares = np.empty((2, 6)), [0.0, 0.0]
    for side in (LEFT, RIGHT):
        before = sides.lanes[side]
        table = narrowed(prior, before, dt_s, sideways_mps)
        lanes[side], shares[side] = by_one_line(evidence, before, table, size, side, sides.width)
    if min(shares) >= SHAPE_SUPPORT:
        sides = _compared(sides, lanes, places_m(lanes[LEFT], prior) - places_m(lanes[RIGHT], prior), driven, dt_s)
        if sides.leaving == NO_LINE:
            sides = sides.learned(float(found[WIDTH]), dt_s)
    kept_side = NO_LINE
    if sides.leaving != NO_LINE:
        kept_side = 1 - sides.leaving
    elif min(shares) < LEAST_SUPPORT <= max(shares) and sides.is_settled:
        kept_side = int(np.argmax(shares))
    if kept_side != NO_LINE:
        found = np.clip(lanes[kept_side], prior.table[:, LOW], prior.table[:, HIGH])
    is_away = abs(float(sides.apart[0])) > AWAY_M
    for side in (LEFT, RIGHT):
        if shares[side] < LEAST_SUPPORT or (side == sides.leaving and is_away):
            lanes[side] = found  # and looked for again where it should be
            sides = replace(
                sides, bends=np.full(2, found[BEND]), apart=np.zeros(2), doubt=0.0, verdict=0.0, leaving=NO_LINE
            )
    if kept_side != NO_LINE:
        sides = replace(sides, alone_s=sides.alone_s + dt_s, carried=1 - kept_side)
    elif min(shares) >= LEAST_SUPPORT:
        sides = replace(sides, alone_s=0.0, carried=NO_LINE)
    if sides.alone_s > LONGEST_S:
        return found, replace(sides_of(found), carried=sides.carried)
    return found, replace(sides, lanes=lanes)


def _compared(sides: Sides, lanes: FloatArray, apart_m: FloatArray, driven: float, dt_s: float) -> Sides:
    """The state after both lines were seen: the lanes by each, shape (2, 6), and their distance ahead, shape (2,)."""
    swift, slow = 1.0 - math.exp(-dt_s / MEMORY_S), 1.0 - math.exp(-dt_s / BEND_S)
    if math.isfinite(sides.driven):
        driven = sides.driven + swift * (driven - sides.driven)
    apart = sides.apart + swift * (apart_m - sides.apart)
    strange = np.abs(lanes[:, BEND] - sides.bends) + np.abs(sides.bends - driven)
    doubt = sides.doubt + slow * (float(strange[RIGHT] - strange[LEFT]) - sides.doubt)
    bends = sides.bends + slow * (lanes[:, BEND] - sides.bends)
    verdict, leaving = max(sides.verdict, doubt, key=abs), sides.leaving
    conflict = float((np.abs(apart) / APART_M).max())
    if conflict < PARALLEL:
        verdict, leaving = 0.0, NO_LINE
    elif sides.is_settled and (conflict > 1.0 or leaving != NO_LINE):
        leaving = RIGHT if verdict > 0.0 else LEFT
    return replace(sides, bends=bends, driven=driven, apart=apart, doubt=doubt, verdict=verdict, leaving=leaving)
