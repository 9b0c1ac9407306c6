"""The default lane method: both boundaries together, several hypotheses over time.

Each hypothesis is a lane (`lane_model`). From frame to frame it is predicted from speed and yaw rate, where the log has
them, and improved on the new frame as far as a car can have moved (`lane_following`): so none of them jumps. Every few
frames a search for other lanes adds rivals; when nothing is left, the frame is searched as if it were the first. One
hypothesis is published until another has been clearly better for some time, or it is itself no longer seen. A frame
that hardly shows the lane does not end it: earlier frames are forgotten slowly, and the lane is held.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.vision.boundary import BOUNDARY_NOT_FOUND, Boundary, replace_parabola_of_boundary
from cwcli.vision.boundary_probability import (
    boundary_probabilities,
    first_frame_boundary_probabilities,
)
from cwcli.vision.camera import Camera, WidthHeightPx
from cwcli.vision.ground import MIN_DEPTH_BELOW_HORIZON_SHARE
from cwcli.vision.lane_covariance import covariance_of_first_five_lane_numbers, propagate_covariance_to_fit
from cwcli.vision.lane_detect import (
    MAX_SAMPLED_ROWS,
    EvidenceSource,
    StripeEvidence,
    lane_objectives,
    measure_stripe_evidence,
    sampled_road_rows,
    search_first_frame,
    search_first_frame_at_vanishing_points,
    search_rival_lanes,
)
from cwcli.vision.lane_following import (
    MARGIN_OF_BOUNDARY_MOVEMENT_M,
    MAX_BOUNDARY_LATERAL_SPEED_UNKNOWN_CAR_MOTION_MPS,
    MAX_BOUNDARY_SPEED_FROM_PREDICTION_KNOWN_MOTION_MPS,
    MIN_SPEED_WITHOUT_NEW_BENDS_MPS,
    boundary_difference_beside_camera_m,
    driven_rightward_curvature_or_nan_1pm,
    lane_change_between_left_1_right_minus_1,
    lane_change_left_1_right_minus_1,
    max_boundary_difference_m,
    predict_lane_at_next_frame,
    prior_at_lane_horizon,
    prior_of_followed_lane,
    prior_with_driven_curvature,
    prior_with_seen_horizon,
    shift_to_adjacent_lane,
)
from cwcli.vision.lane_hypotheses import (
    MIN_OBJECTIVE_GAIN_TO_SWITCH,
    LaneHypothesis,
    add_or_merge_hypothesis,
    choose_tight_or_gentle_bend,
    find_tight_bend_hypothesis,
    refine_predicted_lane,
    share_probability_with_rivals,
)
from cwcli.vision.lane_model import (
    BEND,
    HIGH,
    HORIZON,
    LOW,
    MEAN,
    SIGMA,
    SPIRAL,
    VANISHING,
    ImageLane,
    ImageLanes,
    LanePrior,
    LeftRightProbabilities,
    bend_px2_per_curvature,
    boundary_road_curves,
    first_frame_prior,
    fit_boundary_parabolas,
    pitch_from_horizon_rad,
)
from cwcli.vision.lane_sides import (
    FrameStep,
    LinePairState,
    initial_line_pair_state,
    prior_with_known_width,
    update_lane_and_line_state,
)
from cwcli.vision.line_classifier import LineClassifier
from cwcli.vision.method import LaneFit, LaneFrame, LaneState, Method

MAX_SEARCH_PIXELS = 230_400
"""Number of pixels to which a larger camera image is scaled for the search: 640 x 360. One size for all large cameras,
because thresholds and constants were chosen on it. Chosen by hand: it bounds the time of a frame."""
MIN_FOUND_PROBABILITY = 0.5
"""Probability from which a boundary counts as found. Fitted on rendered and labelled frames: one boundary in a hundred
is then found on rendered roads without paint."""
MAX_FOLLOWED_LANE_HYPOTHESES = 3
"""Greatest number of lanes that are followed side by side. Chosen by hand; not fitted."""
RIVAL_SEARCH_INTERVAL_FRAMES, DOUBTFUL_RIVAL_SEARCH_INTERVAL_FRAMES = 10, 3
"""Frames between two searches for rival lanes: as a rule, and while the published lane is hardly seen. Chosen by hand;
not fitted."""
LINE_UPDATE_INTERVAL_FRAMES = 2
"""Frames between two updates of the lane by each of its lines alone while both agree; it is every frame while they
differ. Chosen by hand; not fitted."""
RIVAL_PRIOR_SIGMA_FACTOR = 0.3
"""Factor of the prior's sigmas of direction and bend in the search for rival lanes. Chosen by hand; not fitted."""
MIN_FRAMES_WITHOUT_LANE_TO_GIVE_UP, MIN_TIME_WITHOUT_LANE_TO_GIVE_UP_S = 5, 0.5
"""A lane is given up when it has not been found in at least so many frames and for at least so many seconds. Chosen by
hand; not fitted."""
MAX_SEARCH_PAUSE_FRAMES = 16
"""Greatest pause between two searches from scratch, in frames; pauses double from 1. Chosen by hand; not fitted."""
OBJECTIVE_SMOOTHING_TIME_S = 0.45
"""Time constant in seconds with which a hypothesis forgets its earlier objectives. Chosen by hand; not fitted."""
LOG_ODDS_SMOOTHING_TIME_S = 0.3
"""Time constant in seconds with which the log-odds of a boundary are smoothed. Chosen by hand; not fitted."""
MAX_FRAME_LOG_ODDS = 4.0
"""Greatest absolute log-odds that one frame contributes to a boundary's probability. Chosen by hand; not fitted."""
MIN_BETTER_BEFORE_SWITCH_S = 0.4
"""Time in seconds for which another hypothesis must be clearly better before it is published. Chosen by hand; not
fitted."""
HORIZON_FOLLOWING_SHARE_PER_FRAME = 0.05
"""Share by which the prior's horizon follows that of a found lane in each frame, where the mounting is not known.
Chosen by hand; not fitted."""
ASSUMED_TIGHT_BEND_SPEED_MPS = 10.0
"""Speed in m/s that tight bends assume where the log has no speed: at it, bends begin and end within sight. Chosen by
hand; not fitted."""
TIGHT_BEND_SEARCH_INTERVAL_FRAMES = 3
"""Frames between two searches for a tight bend where the log has no speed. Chosen by hand; not fitted."""
FIRST_HORIZON_RECHECK_S = 0.2
"""Time in seconds after which a lane without a known mounting is searched from scratch again, because the horizon of a
single frame may be wrong. The time doubles with every search. Chosen by hand; not fitted."""
MAX_HORIZON_RECHECK_INTERVAL_S = 16.0
"""Greatest time in seconds between two searches from scratch for the horizon. Chosen by hand; not fitted."""
MIN_TIME_BETWEEN_COVARIANCES_NS = 300_000_000
"""Least time between two measurements of a lane's covariance, in nanoseconds. Chosen by hand: it bounds the time of a
frame."""


class LaneTracker:
    """The search over the frames of one camera.

    Args:
        seed: Not used: nothing is random.
        evidence_source: Measures the evidence of a frame.
    """

    def __init__(self, seed: int = 0, *, evidence_source: EvidenceSource = measure_stripe_evidence) -> None:
        self._evidence_source = evidence_source
        self._camera: Camera | None = None
        self._prior: LanePrior | None = None
        self._hypotheses: list[LaneHypothesis] = []
        self._evidence: StripeEvidence | None = None
        self._evidence_buffer = np.empty(
            0, np.float32
        )  # for the evidence: new memory in every frame costs as much as to fill it
        self._odds: list[float] | None = None
        self._last_fit: LaneFit | None = None
        self._last_lane: ImageLane | None = None
        self._lane_change_per_s: ImageLane | None = None
        self._is_tight_bend_better = False
        self._scene_votes = 1.0
        self._first_frame_probabilities: LeftRightProbabilities | None = None
        self._steady_s = math.nan
        self._followed_s, self._next_horizon_recheck_s = 0.0, FIRST_HORIZON_RECHECK_S
        self._last_ns = 0
        self._n_frames = 0
        self._n_lost = 0
        self._lost_s = 0.0
        self._pause = 0
        self._covariance: FloatArray | None = None
        self._measured_ns = 0
        self._line_classifier = (
            LineClassifier() if evidence_source is measure_stripe_evidence else None
        )  # of a net's map it is not known what it shows

    def step(self, frame: LaneFrame) -> LaneFit:
        """Find both boundaries in the next frame."""
        camera = frame.camera
        if self._camera is None or camera != self._camera:
            self._camera, self._prior, self._hypotheses, self._odds = camera, first_frame_prior(camera), [], None
        assert self._prior is not None
        dt_s = min(max((frame.stamp_ns - self._last_ns) / 1e9, 0.0), 0.5)
        self._last_ns = frame.stamp_ns
        if self._hypotheses:
            self._followed_s += dt_s
            self._hypotheses = self._follow_hypotheses(frame, camera, dt_s)
            self._steady_s += dt_s
        elif self._pause <= 0:
            self._hypotheses = self._search_from_scratch(frame, camera)
            self._steady_s, self._odds = 0.0, None
            self._followed_s, self._next_horizon_recheck_s = 0.0, FIRST_HORIZON_RECHECK_S
        self._n_frames += 1
        fit = self._publish_best_hypothesis(frame, camera, dt_s)
        lane, before = self._hypotheses[0].lane if self._hypotheses else None, self._last_lane
        is_same = dt_s > 0.0 and fit.steady_s > 0.0 and not fit.lane_change
        self._last_lane, self._lane_change_per_s = lane, None
        if is_same and lane is not None and before is not None:
            self._lane_change_per_s = (lane - before) / dt_s
        if self._line_classifier is not None:
            fit = self._line_classifier.fit_with_kinds_and_colours(fit, frame, self._evidence, lane)
        self._last_fit = fit
        return fit

    def carry(self, stamp_ns: int, speed_mps: float = math.nan, yaw_rate_radps: float = math.nan) -> LaneFit:
        """The fit of a frame that is not searched: the published lane, moved as the car has moved since the last one.

        What the next searched frame finds does not depend on it.

        Args:
            speed_mps, yaw_rate_radps: The car's motion; NaN where it is not known: then the lane goes on moving in the
                picture as it did between the last two searched frames.
        """
        last = self._last_fit
        if last is None or self._camera is None or self._prior is None or not (last.left.found or last.right.found):
            return LaneFit(BOUNDARY_NOT_FOUND, BOUNDARY_NOT_FOUND, state=LaneState.LOST)
        dt_s = min(max((stamp_ns - self._last_ns) / 1e9, 0.0), 0.5)
        camera = self._camera
        lane = predict_lane_at_next_frame(
            self._hypotheses[0].lane, camera, speed_mps, yaw_rate_radps, dt_s, self._prior
        )
        if self._lane_change_per_s is not None and math.isnan(speed_mps + yaw_rate_radps):
            lane = self._hypotheses[0].lane + self._lane_change_per_s * dt_s
        left, right = (
            replace_parabola_of_boundary(side, *parabola)
            for side, parabola in zip(
                (last.left, last.right), fit_boundary_parabolas(lane, camera).tolist(), strict=True
            )
        )
        return replace(
            last,
            left=left,
            right=right,
            pitch_rad=pitch_from_horizon_rad(lane, camera),
            roads=boundary_road_curves(lane, self._prior.pinhole),
            state=LaneState.CARRIED if last.state is LaneState.FOUND else last.state,
            steady_s=last.steady_s + dt_s,
            lane_change=0,
            covariance=last.covariance if left.found and right.found else None,
        )

    def _fit_covariance_measured_or_reused(self, lane: ImageLane, frame: LaneFrame, *, is_another: bool) -> FloatArray:
        """The covariance of a fit, measured in this frame or, for the same lane, at most 0.3 s earlier.

        It is measured anew for another lane: after a lane change, or when another hypothesis is published.
        """
        assert self._prior is not None
        assert self._evidence is not None
        if (
            self._covariance is None
            or is_another
            or frame.stamp_ns - self._measured_ns >= MIN_TIME_BETWEEN_COVARIANCES_NS
        ):
            is_bent = math.isnan(frame.speed_mps) and lane[SPIRAL] != 0.0
            table = prior_of_followed_lane(
                self._prior, frame.camera, ASSUMED_TIGHT_BEND_SPEED_MPS if is_bent else frame.speed_mps
            ).table
            own = covariance_of_first_five_lane_numbers(self._evidence, lane, table, frame.camera)
            self._covariance, self._measured_ns = propagate_covariance_to_fit(lane, own, frame.camera), frame.stamp_ns
        return self._covariance

    def _follow_hypotheses(self, frame: LaneFrame, camera: Camera, dt_s: float) -> list[LaneHypothesis]:
        """Every hypothesis, predicted and refined on the new frame; the published one first."""
        assert self._prior is not None
        size = camera.width_px, camera.height_px
        horizon_px = float(self._hypotheses[0].lane[HORIZON])
        rows = sampled_road_rows(horizon_px + MIN_DEPTH_BELOW_HORIZON_SHARE * size[1], size[1])
        if len(self._evidence_buffer) != 3 * MAX_SAMPLED_ROWS * size[0]:
            self._evidence_buffer = np.empty(3 * MAX_SAMPLED_ROWS * size[0], np.float32)
        evidence = self._evidence_source(frame.grey, rows, horizon_px, self._prior.pinhole, self._evidence_buffer)
        self._evidence = evidence
        prior = prior_of_followed_lane(self._prior, camera, frame.speed_mps)
        is_motion_known = self._prior.is_mounting_known and math.isfinite(frame.speed_mps)
        sideways_mps = (
            MAX_BOUNDARY_SPEED_FROM_PREDICTION_KNOWN_MOTION_MPS
            if is_motion_known
            else MAX_BOUNDARY_LATERAL_SPEED_UNKNOWN_CAR_MOTION_MPS
        )
        memory = math.exp(-dt_s / OBJECTIVE_SMOOTHING_TIME_S)
        hypotheses: list[LaneHypothesis] = []
        tight = (
            prior_of_followed_lane(self._prior, camera, ASSUMED_TIGHT_BEND_SPEED_MPS)
            if math.isnan(frame.speed_mps)
            else None
        )
        for each in self._hypotheses:
            lane = predict_lane_at_next_frame(each.lane, camera, frame.speed_mps, frame.yaw_rate_radps, dt_s, prior)
            change = lane_change_left_1_right_minus_1(lane)
            lane = shift_to_adjacent_lane(lane, change)
            is_tight = tight is not None and each.is_tight
            own = prior_at_lane_horizon(tight if tight is not None and is_tight else prior, lane, camera)
            is_slow = is_tight or frame.speed_mps < MIN_SPEED_WITHOUT_NEW_BENDS_MPS
            sides = self._predict_line_pair_if_published(each, lane, change, frame, camera, dt_s)
            own = prior_with_known_width(own, sides)
            found, last = refine_predicted_lane(evidence, lane, own, size, dt_s, sideways_mps, is_slow=is_slow)
            frames = 1 if sides is None or not sides.do_lines_agree else LINE_UPDATE_INTERVAL_FRAMES
            if sides is not None and self._n_frames % frames == 0:
                driven = bend_px2_per_curvature(camera) * driven_rightward_curvature_or_nan_1pm(
                    frame.speed_mps, frame.yaw_rate_radps
                )
                step = FrameStep(size, frames * dt_s, sideways_mps)
                found, sides = update_lane_and_line_state(sides, evidence, found, own, driven, step)
                last = float(lane_objectives(evidence, found[None], own.table)[0])
            if (
                is_tight and self._n_frames % TIGHT_BEND_SEARCH_INTERVAL_FRAMES == 0
            ):  # it must go on being better than a gentle bend
                gentle = prior_at_lane_horizon(prior, lane, camera)
                found, last, is_tight = choose_tight_or_gentle_bend(
                    evidence, lane, (found, last), gentle, size, dt_s, sideways_mps
                )
            value = memory * each.value + (1.0 - memory) * (last + each.start_penalty)
            add_or_merge_hypothesis(
                hypotheses,
                LaneHypothesis(found, value, last, each.start_penalty, each.better_s, change, sides, is_tight),
                size,
            )
        lead = hypotheses[0]
        if tight is not None:
            self._add_tight_bend_if_twice_better(
                hypotheses, evidence, prior_at_lane_horizon(tight, lead.lane, camera), size, dt_s, sideways_mps
            )
        doubtful = self._n_lost > 0 and self._n_frames % DOUBTFUL_RIVAL_SEARCH_INTERVAL_FRAMES == 0
        if doubtful or self._n_frames % RIVAL_SEARCH_INTERVAL_FRAMES == 0:
            own = tight if tight is not None and lead.is_tight else prior
            hypotheses += [
                replace(each, is_tight=lead.is_tight)
                for each in self._search_rival_hypotheses(frame, camera, hypotheses, own)
            ]
        if not self._prior.is_mounting_known and self._followed_s >= self._next_horizon_recheck_s:
            self._next_horizon_recheck_s += min(self._next_horizon_recheck_s, MAX_HORIZON_RECHECK_INTERVAL_S)
            for new in self._recheck_horizon(frame, camera, prior):
                add_or_merge_hypothesis(hypotheses, new, size)
        lead_value = hypotheses[0].value + MIN_OBJECTIVE_GAIN_TO_SWITCH
        for k, each in enumerate(hypotheses):
            better_s = each.better_s + dt_s if each.value > lead_value else 0.0
            if better_s != each.better_s:
                hypotheses[k] = replace(each, better_s=better_s)
        return hypotheses

    def _add_tight_bend_if_twice_better(
        self,
        hypotheses: list[LaneHypothesis],
        evidence: StripeEvidence,
        tight_prior: LanePrior,
        size: WidthHeightPx,
        dt_s: float,
        sideways_mps: float,
    ) -> None:
        """Add the published lane as a tight bend, if that is better in two searched frames one after the other: in one
        alone it is by chance."""
        was_better, self._is_tight_bend_better = self._is_tight_bend_better, False
        if any(each.is_tight for each in hypotheses):
            return
        if was_better or self._n_frames % TIGHT_BEND_SEARCH_INTERVAL_FRAMES == 0:
            tight_bend = find_tight_bend_hypothesis(hypotheses[0], evidence, tight_prior, size, dt_s, sideways_mps)
            self._is_tight_bend_better = tight_bend is not None
            if tight_bend is not None and was_better:
                add_or_merge_hypothesis(hypotheses, tight_bend, size)

    def _predict_line_pair_if_published(
        self, hypothesis: LaneHypothesis, lane: ImageLane, change: int, frame: LaneFrame, camera: Camera, dt_s: float
    ) -> LinePairState | None:
        """State of the published lane's two lines, predicted for this frame; None for other lanes and where the log has
        no motion of a fast car."""
        assert self._prior is not None
        is_fast = frame.speed_mps >= MIN_SPEED_WITHOUT_NEW_BENDS_MPS and math.isfinite(frame.yaw_rate_radps)
        if hypothesis is not self._hypotheses[0] or not is_fast:
            return None
        if hypothesis.line_pair is None or change:
            return initial_line_pair_state(lane)
        moved = [
            predict_lane_at_next_frame(own, camera, frame.speed_mps, frame.yaw_rate_radps, dt_s, self._prior)
            for own in hypothesis.line_pair.lanes_by_line
        ]
        return replace(hypothesis.line_pair, lanes_by_line=np.stack(moved))

    def _search_rival_hypotheses(
        self, frame: LaneFrame, camera: Camera, followed: list[LaneHypothesis], opened_prior: LanePrior
    ) -> list[LaneHypothesis]:
        """New hypotheses beside those that are followed, at the horizon and in the direction of the published one."""
        assert self._prior is not None
        assert self._evidence is not None
        table = self._prior.table.copy()
        for k in (VANISHING, BEND):
            table[k, MEAN] = followed[0].lane[k]
            table[k, SIGMA] *= RIVAL_PRIOR_SIGMA_FACTOR
            table[k, LOW], table[k, HIGH] = opened_prior.table[k, LOW], opened_prior.table[k, HIGH]
        size = camera.width_px, camera.height_px
        prior = self._prior.with_table(table)
        lanes, values = search_rival_lanes(self._evidence, prior, size, [each.lane for each in followed])
        return self._start_hypotheses(lanes, values, opened_prior)

    def _search_from_scratch(self, frame: LaneFrame, camera: Camera) -> list[LaneHypothesis]:
        """New hypotheses from a frame alone; of the frames before it uses the horizon only."""
        assert self._prior is not None
        prior = prior_with_driven_curvature(self._prior, camera, frame.speed_mps, frame.yaw_rate_radps)
        if prior.is_mounting_known:
            self._scene_votes = 1.0
            lanes, values, self._evidence = search_first_frame(frame.grey, camera, prior, self._evidence_source)
        else:
            lanes, values, self._evidence, self._scene_votes = search_first_frame_at_vanishing_points(
                frame.grey, camera, prior, self._evidence_source
            )
            self._first_frame_probabilities = first_frame_boundary_probabilities(
                self._evidence, lanes, values, self._scene_votes, camera.height_px
            )
            self._prior = prior_with_seen_horizon(self._prior, float(lanes[0, HORIZON]), camera)
        lanes, values = lanes[:MAX_FOLLOWED_LANE_HYPOTHESES], values[:MAX_FOLLOWED_LANE_HYPOTHESES]
        return self._start_hypotheses(lanes, values, prior_of_followed_lane(self._prior, camera, frame.speed_mps))

    def _recheck_horizon(self, frame: LaneFrame, camera: Camera, opened_prior: LanePrior) -> list[LaneHypothesis]:
        """A new hypothesis from a search from scratch at the horizon of the frame's own lines."""
        assert self._prior is not None
        followed = self._evidence
        # the frames before have shown the lane: another point would only move its horizon now and then
        lanes, values, self._evidence, votes = search_first_frame_at_vanishing_points(
            frame.grey, camera, self._prior, self._evidence_source, n_other_points=0
        )
        self._scene_votes = max(self._scene_votes, votes)  # once it was clear that this is a road, it is one
        hypotheses = self._start_hypotheses(
            lanes[:1], values[:1], prior_at_lane_horizon(opened_prior, lanes[0], camera)
        )
        self._evidence = followed
        return hypotheses

    def _start_hypotheses(self, lanes: ImageLanes, values: FloatArray, opened_prior: LanePrior) -> list[LaneHypothesis]:
        """New hypotheses from lanes (k, 6) and their objectives (k,) under the prior of a first frame."""
        assert self._evidence is not None
        starts = values - lane_objectives(self._evidence, lanes, opened_prior.table)
        return [
            LaneHypothesis(lane, value, value, min(start, 0.0))
            for lane, value, start in zip(lanes, values.tolist(), starts.tolist(), strict=True)
        ]

    def _choose_published_hypothesis(
        self, camera: Camera, dt_s: float
    ) -> tuple[LaneHypothesis, LeftRightProbabilities, int]:
        """Choose the hypothesis to publish and put it first; returns it, its probabilities in this frame and the lane
        change."""
        assert self._prior is not None
        assert self._evidence is not None
        first = best = self._hypotheses[0]
        chances = boundary_probabilities(
            self._evidence, first.lane, first.last_value, first.carried_side, vote_share=self._scene_votes
        )
        change = first.lane_change
        if len(self._hypotheses) > 1:
            is_seen = max(chances) >= MIN_FOUND_PROBABILITY
            patience_s = MIN_BETTER_BEFORE_SWITCH_S if is_seen else 0.0
            reach_m = MAX_BOUNDARY_LATERAL_SPEED_UNKNOWN_CAR_MOTION_MPS * dt_s + MARGIN_OF_BOUNDARY_MOVEMENT_M
            rivals = self._hypotheses[1:]
            if is_seen and first.line_pair is not None:  # what a line that leaves makes of the lane is none
                rivals = [each for each in rivals if first.line_pair.may_be_replaced_by(each.lane, self._prior)]
            better = [
                each
                for each in rivals
                if each.better_s > patience_s
                or (
                    each.better_s > 0.0
                    and max_boundary_difference_m(each.lane, first.lane, self._prior, camera.height_px) <= reach_m
                )
            ]
            if better:
                best = max(better, key=lambda each: each.value)
                chances = boundary_probabilities(
                    self._evidence, best.lane, best.last_value, vote_share=self._scene_votes
                )
                change = change or lane_change_between_left_1_right_minus_1(first.lane, best.lane)
                other = shift_to_adjacent_lane(first.lane, change) if not first.lane_change else first.lane
                self._odds = self._covariance = None
                if (
                    boundary_difference_beside_camera_m(best.lane, other, self._prior)
                    > MAX_BOUNDARY_SPEED_FROM_PREDICTION_KNOWN_MOTION_MPS * dt_s + MARGIN_OF_BOUNDARY_MOVEMENT_M
                ):
                    self._steady_s = 0.0
                if not self._prior.is_mounting_known:
                    self._prior = prior_with_seen_horizon(self._prior, float(best.lane[HORIZON]), camera)
            others = sorted((each for each in self._hypotheses if each is not best), key=lambda each: -each.value)
            if self._followed_s > 0.0:  # a first frame's lane is the mean of its rivals
                chances = share_probability_with_rivals(
                    chances, best, rivals if best is first else others, camera.height_px
                )
            self._hypotheses = [
                replace(best, better_s=0.0) if best.better_s else best,
                *others[: MAX_FOLLOWED_LANE_HYPOTHESES - 1],
            ]
        return best, chances, change

    def _publish_best_hypothesis(self, frame: LaneFrame, camera: Camera, dt_s: float) -> LaneFit:
        """The published hypothesis as a fit; drops all hypotheses when the lane is lost."""
        assert self._prior is not None
        if not self._hypotheses:
            self._pause -= 1
            self._covariance = None
            return LaneFit(BOUNDARY_NOT_FOUND, BOUNDARY_NOT_FOUND, state=LaneState.LOST)
        best, now, change = self._choose_published_hypothesis(camera, dt_s)
        if self._first_frame_probabilities is not None:
            now, self._first_frame_probabilities = self._first_frame_probabilities, None
        odds = [min(max(math.log(chance / (1.0 - chance)), -MAX_FRAME_LOG_ODDS), MAX_FRAME_LOG_ODDS) for chance in now]
        if self._odds is not None:
            kept_share = math.exp(-dt_s / LOG_ODDS_SMOOTHING_TIME_S)
            odds = [
                kept_share * before + (1.0 - kept_share) * own for before, own in zip(self._odds, odds, strict=True)
            ]
        self._odds = odds
        chances = [1.0 / (1.0 + math.exp(-own)) for own in odds]
        parabolas = fit_boundary_parabolas(best.lane, camera).tolist()
        found = [
            chance >= MIN_FOUND_PROBABILITY and all(map(math.isfinite, parabola))
            for chance, parabola in zip(chances, parabolas, strict=True)
        ]
        if any(found):
            if self._n_lost:
                self._steady_s = 0.0  # found anew
            self._n_lost, self._lost_s, self._pause = 0, 0.0, 0
            if not self._prior.is_mounting_known:
                table = self._prior.table
                row = (1.0 - HORIZON_FOLLOWING_SHARE_PER_FRAME) * table[
                    HORIZON, MEAN
                ] + HORIZON_FOLLOWING_SHARE_PER_FRAME * best.lane[HORIZON]
                self._prior = prior_with_seen_horizon(self._prior, float(row), camera)
        else:
            self._n_lost += 1
            self._lost_s += dt_s
            if (
                self._n_lost >= MIN_FRAMES_WITHOUT_LANE_TO_GIVE_UP
                and self._lost_s >= MIN_TIME_WITHOUT_LANE_TO_GIVE_UP_S
            ):
                self._hypotheses, self._covariance = [], None
                self._pause = min(
                    2 ** min(self._n_lost - MIN_FRAMES_WITHOUT_LANE_TO_GIVE_UP, 8), MAX_SEARCH_PAUSE_FRAMES
                )
                return LaneFit(BOUNDARY_NOT_FOUND, BOUNDARY_NOT_FOUND, state=LaneState.LOST)
        sides = []
        for side in range(2):
            a, b, c = parabolas[side]
            sides.append(Boundary(a, b, c, best.value, chances[side], found[side]))
        if not all(found):
            self._covariance = None
        if not any(found):
            return LaneFit(sides[0], sides[1], state=LaneState.LOST)
        is_another = change != 0 or self._steady_s == 0.0
        return LaneFit(
            sides[0],
            sides[1],
            pitch_rad=pitch_from_horizon_rad(best.lane, camera),
            roads=boundary_road_curves(best.lane, self._prior.pinhole),
            state=LaneState.FOUND if max(now) >= MIN_FOUND_PROBABILITY else LaneState.HELD,
            steady_s=self._steady_s,
            lane_change=change,
            covariance=self._fit_covariance_measured_or_reused(best.lane, frame, is_another=is_another)
            if all(found)
            else None,
        )


def search_size(width_px: int, height_px: int) -> WidthHeightPx:
    """Width and height of the search image: the camera's, scaled down to `MAX_SEARCH_PIXELS` if it has more."""
    scale = min(math.sqrt(MAX_SEARCH_PIXELS / (width_px * height_px)), 1.0)
    return round(scale * width_px), round(scale * height_px)


METHOD = Method(
    summary="both boundaries together as stripes of a marking's width, tracked; finds the horizon itself",
    search_size=search_size,
    make=LaneTracker,
    uses_motion=True,
    is_rectified=True,
    uses_colour=True,
    carry=LaneTracker.carry,
)
"""The registered default lane method."""
