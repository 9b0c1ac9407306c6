"""Lane hypotheses: each is refined on its own, and those that have become one lane are merged."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.vision.camera import WidthHeightPx
from cwcli.vision.lane_detect import StripeEvidence, best_lane_on_wide_evidence, lane_objectives, refine_lanes
from cwcli.vision.lane_following import (
    MARGIN_OF_BOUNDARY_MOVEMENT_M,
    MAX_BOUNDARY_LATERAL_SPEED_UNKNOWN_CAR_MOTION_MPS,
    curvature_candidates,
    has_lines_at_boundaries,
    max_boundary_difference_m,
    narrow_prior_table,
    pitch_candidates,
)
from cwcli.vision.lane_mean import OBJECTIVE_DIFFERENCE_OF_WEIGHT_1_OVER_E
from cwcli.vision.lane_model import HIGH, LOW, ImageLane, LanePrior, LeftRightProbabilities, is_same_lane_in_image
from cwcli.vision.lane_sides import NO_LINE, LinePairState

MAX_RIVAL_OBJECTIVE_DEFICIT = 5.0 * OBJECTIVE_DIFFERENCE_OF_WEIGHT_1_OVER_E
"""Greatest deficit of objective with which a lane is still a rival: below it, it has less than 1 % of the
probability."""
MIN_OBJECTIVE_GAIN_TO_SWITCH = 0.03
"""Objective by which a hypothesis must be better than another one to take its place. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class LaneHypothesis:
    """A lane that is followed.

    Attributes:
        lane: Shape (6,), see `lane_model`.
        value: Objective over the last frames.
        last_value: Objective in the last frame.
        start_penalty: Objective that the stricter prior of a first frame took off when the lane was found, at most 0;
            it stays a reason against the lane.
        better_s: Time for which it has been better than the published one.
        lane_change: The lane change in this frame: 1 to the left, -1 to the right, else 0.
        line_pair: State of its two lines, if it is the published one.
        is_tight: The log has no speed, and the lane is followed as a tight bend.
    """

    lane: FloatArray
    value: float
    last_value: float
    start_penalty: float = 0.0
    better_s: float = 0.0
    lane_change: int = 0
    line_pair: LinePairState | None = None
    is_tight: bool = False

    @property
    def carried_side(self) -> int:
        """The boundary whose place follows from the other line (`lane_sides`), or `NO_LINE`."""
        return NO_LINE if self.line_pair is None else self.line_pair.carried_side


def refine_predicted_lane(
    evidence: StripeEvidence,
    lane: ImageLane,
    prior: LanePrior,
    size: WidthHeightPx,
    dt_s: float,
    sideways_mps: float,
    *,
    is_slow: bool,
) -> tuple[ImageLane, float]:
    """Refine a predicted lane on a frame; returns the lane, shape (6,), and its objective.

    Args:
        sideways_mps: Greatest lateral speed at which the prediction may be wrong.
        is_slow: The car is slow, so that bends may begin and end within sight: other bends are tried too.
    """
    table = narrow_prior_table(prior, lane, dt_s, sideways_mps)
    lane = np.minimum(np.maximum(lane, table[:, LOW]), table[:, HIGH])
    if (
        not prior.is_mounting_known
    ):  # else the horizon is known from the mounting, and the search's own steps reach what bumps do
        lane = best_lane_on_wide_evidence(evidence, pitch_candidates(lane, prior, table, dt_s), table)
    starts = lane[None]
    if is_slow:
        best = best_lane_on_wide_evidence(evidence, curvature_candidates(lane, prior, table, size[1]), table)
        if not np.array_equal(best, lane):
            starts = np.stack([lane, best])
    lanes, values = refine_lanes(
        evidence, starts, table, size, use_wide_evidence=True, step_scale=1.0, neighbour_weight=0.0
    )
    lanes, _ = refine_lanes(
        evidence,
        lanes[int(values.argmax())],
        table,
        size,
        use_wide_evidence=False,
        step_scale=0.5,
        neighbour_weight=0.0,
    )
    return lanes[0], float(lane_objectives(evidence, lanes, prior.table)[0])


def choose_tight_or_gentle_bend(
    evidence: StripeEvidence,
    lane: ImageLane,
    tight_lane_and_objective: tuple[ImageLane, float],
    prior: LanePrior,
    size: WidthHeightPx,
    dt_s: float,
    sideways_mps: float,
) -> tuple[ImageLane, float, bool]:
    """A tight bend, its objective and True; or a gentle one and False, if that is as good and nothing jumps.

    Args:
        tight_lane_and_objective: The tight bend, shape (6,), and its objective.
        prior: The prior of gentle bends.
    """
    gentle, last = refine_predicted_lane(evidence, lane, prior, size, dt_s, sideways_mps, is_slow=False)
    reach_m = MAX_BOUNDARY_LATERAL_SPEED_UNKNOWN_CAR_MOTION_MPS * dt_s + MARGIN_OF_BOUNDARY_MOVEMENT_M
    if (
        tight_lane_and_objective[1] <= last + MIN_OBJECTIVE_GAIN_TO_SWITCH
        and max_boundary_difference_m(gentle, tight_lane_and_objective[0], prior, size[1]) <= reach_m
    ):
        return gentle, last, False
    return *tight_lane_and_objective, True


def find_tight_bend_hypothesis(
    lead: LaneHypothesis,
    evidence: StripeEvidence,
    tight_prior: LanePrior,
    size: WidthHeightPx,
    dt_s: float,
    sideways_mps: float,
) -> LaneHypothesis | None:
    """The published lane once more as a tight bend, if that is clearly better in this frame; else None."""
    lane, last = refine_predicted_lane(evidence, lead.lane, tight_prior, size, dt_s, sideways_mps, is_slow=True)
    if last <= lead.last_value + MIN_OBJECTIVE_GAIN_TO_SWITCH:
        return None
    return replace(lead, lane=lane, value=lead.value + last - lead.last_value, last_value=last, is_tight=True)


def share_probability_with_rivals(
    probabilities: LeftRightProbabilities, lane: LaneHypothesis, rivals: list[LaneHypothesis], height_px: int
) -> LeftRightProbabilities:
    """The probabilities of a lane's boundaries after its rivals have taken their share.

    Of several lanes that a frame may show, each has a share of exp(objective / 0.015), as in the mean of a first
    frame. A rival that has a line where a boundary lies, as the next lane has, takes nothing from that boundary.

    Args:
        lane, rivals: The published hypothesis, and the other ones.
    """
    parts = [1.0, 1.0]
    for rival in rivals:
        gain = rival.value - lane.value
        if gain > -MAX_RIVAL_OBJECTIVE_DEFICIT:
            part = math.exp(min(gain, MAX_RIVAL_OBJECTIVE_DEFICIT) / OBJECTIVE_DIFFERENCE_OF_WEIGHT_1_OVER_E)
            for side, has_line in enumerate(has_lines_at_boundaries(rival.lane, lane.lane, height_px)):
                parts[side] += 0.0 if has_line else part
    return probabilities[0] / parts[0], probabilities[1] / parts[1]


def add_or_merge_hypothesis(followed: list[LaneHypothesis], new: LaneHypothesis, size: WidthHeightPx) -> None:
    """Add a hypothesis; of two that lie on the same pixels the first stays, unless the new one is clearly better."""
    for k, other in enumerate(followed):
        if is_same_lane_in_image(new.lane, other.lane, *size):
            if new.last_value > other.last_value + MIN_OBJECTIVE_GAIN_TO_SWITCH:
                value = max(new.value, other.value)
                followed[k] = replace(
                    new,
                    value=value,
                    lane_change=other.lane_change,
                    start_penalty=other.start_penalty,
                    line_pair=other.line_pair,
                )
            return
    followed.append(new)
