"""The default lane method: both boundaries together, several hypotheses over time.

Each hypothesis is a lane (`lane_model`). From frame to frame it is predicted from speed and yaw rate, where the log has
them, and improved on the new frame under a prior that is the product of what is known of any lane and the prediction.
Every few frames a look for other lanes brings in rivals; when nothing is left, the frame is searched as if it were the
first. The published one is the hypothesis with the best objective over the last frames.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.vision.boundary import NOT_FOUND, Boundary
from cwcli.vision.camera import Camera
from cwcli.vision.ground import MIN_DEPTH
from cwcli.vision.lane_belief import boundary_probabilities
from cwcli.vision.lane_detect import (
    MAX_ROWS,
    Evidence,
    Look,
    acquire,
    evidence_of,
    glance,
    judged,
    refined,
    rows_of,
    with_vanishing_point,
)
from cwcli.vision.lane_model import (
    BEND,
    HIGH,
    HORIZON,
    LOW,
    MEAN,
    MIDDLE,
    PITCH_SIGMA_RAD,
    SIGMA,
    VANISHING,
    WIDTH,
    LanePrior,
    coincide,
    parabolas_of_lane,
    pitch_of,
    prior_of,
)
from cwcli.vision.method import GreyImage, LaneFit, LaneFrame, Method

MAX_PIXELS = 256_000
"""Of the search image: a camera's image is halved until it has no more."""
FOUND_PROBABILITY = 0.5
N_HYPOTHESES = 3
RESCAN_FRAMES = 10
"""A look for other lanes every so many frames."""
GLANCE_SHARE = 0.3
"""Of the prior's sigmas of direction and bend, for that look."""
LOST_FRAMES = 5
MAX_PAUSE_FRAMES = 16
"""While nothing is found, the search from scratch pauses 1, 2, 4, ... frames, at most so many."""
MEMORY = 0.8
"""Of the objective: weight of the past."""
SWITCH_GAIN = 0.03
"""Objective by which another hypothesis must be better to be published."""
HORIZON_GAIN = 0.05
OVER_THE_LINE = 0.55
"""Of the lane's width: a car whose camera is farther from the middle is in the next lane."""


@dataclass(frozen=True)
class Hypothesis:
    """A lane that is followed.

    Attributes:
        lane: Shape (5,), see `lane_model`.
        value: Objective over the last frames.
        last: Objective in the last frame.
    """

    lane: FloatArray
    value: float
    last: float


class LaneTracker:
    """The search over the frames of one camera.

    Args:
        seed: Not used: nothing is random.
        look: Makes the evidence of a frame.
    """

    def __init__(self, seed: int = 0, *, look: Look = evidence_of) -> None:
        self._look = look
        self._camera: Camera | None = None
        self._prior: LanePrior | None = None
        self._hypotheses: list[Hypothesis] = []
        self._evidence: Evidence | None = None
        self._room = np.empty(0, np.float32)  # for the evidence: new memory in every frame costs as much as to fill it
        self._last_ns = 0
        self._n_frames = 0
        self._n_lost = 0
        self._pause = 0

    def step(self, frame: LaneFrame) -> LaneFit:
        """Find both boundaries in the next frame."""
        camera = frame.camera
        if self._camera is None or camera != self._camera:
            self._camera, self._prior, self._hypotheses = camera, prior_of(camera), []
        assert self._prior is not None
        dt_s = min(max((frame.stamp_ns - self._last_ns) / 1e9, 0.0), 0.5)
        self._last_ns = frame.stamp_ns
        if self._hypotheses:
            self._hypotheses = self._follow(frame, camera, dt_s)
        elif self._pause <= 0:
            self._hypotheses = self._found_afresh(frame.grey, camera)
        self._n_frames += 1
        return self._publish(camera)

    def _follow(self, frame: LaneFrame, camera: Camera, dt_s: float) -> list[Hypothesis]:
        """Every hypothesis, predicted and improved on the new frame."""
        assert self._prior is not None
        size = camera.width_px, camera.height_px
        lead = self._hypotheses[0].lane
        rows = rows_of(lead[HORIZON] + MIN_DEPTH * size[1], size[1])
        if len(self._room) != 3 * MAX_ROWS * size[0]:
            self._room = np.empty(3 * MAX_ROWS * size[0], np.float32)
        evidence = self._look(frame.grey, rows, float(lead[HORIZON]), self._prior.stretch, self._room)
        self._evidence = evidence
        made: list[Hypothesis] = []
        for hypothesis in self._hypotheses:
            lane = predicted(hypothesis.lane, camera, frame.speed_mps, frame.yaw_rate_radps, dt_s, self._prior)
            table = narrowed(self._prior, lane, dt_s)
            lane = np.minimum(np.maximum(lane, table[:, LOW]), table[:, HIGH])
            lanes, _ = refined(evidence, lane, table, size, wide=True, scale=1.0, beside=0.0)
            lanes, _ = refined(evidence, lanes, table, size, wide=False, scale=0.5, beside=0.0)
            last = float(judged(evidence, lanes, self._prior.table)[0])
            value = MEMORY * hypothesis.value + (1.0 - MEMORY) * last
            add_merged(made, Hypothesis(lanes[0], value, last), size)
        if self._n_frames % RESCAN_FRAMES == 0:
            made += self._rivals(evidence, camera, made)
        return made

    def _rivals(self, evidence: Evidence, camera: Camera, followed: list[Hypothesis]) -> list[Hypothesis]:
        """Lanes beside those that are followed, at the horizon and in the direction of the published one."""
        assert self._prior is not None
        table = self._prior.table.copy()
        table[[VANISHING, BEND], MEAN] = followed[0].lane[[VANISHING, BEND]]
        table[[VANISHING, BEND], SIGMA] *= GLANCE_SHARE
        size = camera.width_px, camera.height_px
        lanes, values = glance(evidence, replace(self._prior, table=table), size, [each.lane for each in followed])
        return [Hypothesis(lane, float(value), float(value)) for lane, value in zip(lanes, values, strict=True)]

    def _found_afresh(self, grey: GreyImage, camera: Camera) -> list[Hypothesis]:
        """The best lanes of a frame, knowing nothing of the frames before but the horizon."""
        assert self._prior is not None
        prior = self._prior if self._prior.is_mounted else with_vanishing_point(grey, self._prior)
        lanes, values, evidence = acquire(grey, camera, prior, self._look)
        lanes, values = lanes[:N_HYPOTHESES], values[:N_HYPOTHESES]
        if not self._prior.is_mounted:
            self._prior = learned(self._prior, float(lanes[0, HORIZON]), camera)
        self._evidence = evidence
        return [Hypothesis(lane, float(value), float(value)) for lane, value in zip(lanes, values, strict=True)]

    def _publish(self, camera: Camera) -> LaneFit:
        """The best hypothesis as a fit."""
        assert self._prior is not None
        if not self._hypotheses:
            self._pause -= 1
            return LaneFit(NOT_FOUND, NOT_FOUND)
        best = first = self._hypotheses[0]
        if len(self._hypotheses) > 1:
            best = max(self._hypotheses, key=lambda each: each.value + (SWITCH_GAIN if each is first else 0.0))
            others = sorted((each for each in self._hypotheses if each is not best), key=lambda each: -each.value)
            self._hypotheses = [best, *others[: N_HYPOTHESES - 1]]
        parabolas = parabolas_of_lane(best.lane, camera).tolist()
        assert self._evidence is not None
        chances: list[float] = boundary_probabilities(self._evidence, best.lane, best.last).tolist()
        found = [
            chance >= FOUND_PROBABILITY and all(map(math.isfinite, parabola))
            for chance, parabola in zip(chances, parabolas, strict=True)
        ]
        if any(found):
            self._n_lost, self._pause = 0, 0
            if not self._prior.is_mounted:
                table = self._prior.table
                row = (1.0 - HORIZON_GAIN) * table[HORIZON, MEAN] + HORIZON_GAIN * best.lane[HORIZON]
                self._prior = learned(self._prior, float(row), camera)
        else:
            self._n_lost += 1
            if self._n_lost >= LOST_FRAMES:
                self._hypotheses = []
                self._pause = min(2 ** (self._n_lost - LOST_FRAMES), MAX_PAUSE_FRAMES)
                return LaneFit(NOT_FOUND, NOT_FOUND)
        sides = []
        for side in range(2):
            a, b, c = parabolas[side]
            sides.append(Boundary(a, b, c, best.value, chances[side], found[side]))
        return LaneFit(sides[0], sides[1], pitch_rad=pitch_of(best.lane, camera) if any(found) else math.nan)


def add_merged(followed: list[Hypothesis], new: Hypothesis, size: tuple[int, int]) -> None:
    """Add a hypothesis; of two that lie on the same pixels the first stays, unless the new one is clearly better."""
    for k, other in enumerate(followed):
        if coincide(new.lane, other.lane, *size):
            if new.last > other.last + SWITCH_GAIN:
                followed[k] = new
            return
    followed.append(new)


def learned(prior: LanePrior, horizon_px: float, camera: Camera) -> LanePrior:
    """The prior with the horizon that the frames showed so far."""
    table = prior.table.copy()
    sigma = max(camera.fy * PITCH_SIGMA_RAD, 1.0)
    table[HORIZON] = horizon_px, sigma, horizon_px - 6.0 * sigma, horizon_px + 6.0 * sigma
    return replace(prior, table=table)


def predicted(
    lane: FloatArray, camera: Camera, speed_mps: float, yaw_rate_radps: float, dt_s: float, prior: LanePrior
) -> FloatArray:
    """The lane in the next frame from the car's motion; unknown motion changes nothing.

    With places and curvatures K to the right, the lane's direction seen from the car turns by (K v + yaw rate) dt, and
    its middle moves sideways by that direction times v dt.
    """
    made = np.array(lane)
    height_m = camera.mounting.height_m
    if math.isfinite(speed_mps):
        way_m = speed_mps * dt_s
        curvature_1pm = 2.0 * lane[BEND] / (camera.fx * camera.fy * height_m)
        if math.isfinite(yaw_rate_radps):
            made[VANISHING] += camera.fx * (curvature_1pm * way_m + yaw_rate_radps * dt_s)
        if prior.is_mounted:
            straight = camera.cx + camera.fx * math.tan(camera.mounting.yaw_rad)
            made[MIDDLE] += (lane[VANISHING] - straight) / camera.fx * way_m * prior.stretch / height_m
    if abs(made[MIDDLE]) > OVER_THE_LINE * made[WIDTH]:
        made[MIDDLE] -= math.copysign(made[WIDTH], made[MIDDLE])
    return made


def narrowed(prior: LanePrior, lane: FloatArray, dt_s: float) -> FloatArray:
    """The prior's table times a normal distribution around the predicted lane, to which direction and bend are left."""
    sigma = prior.drift * math.sqrt(max(dt_s, 0.02))
    table = prior.table
    before, now = table[:, SIGMA] ** -2, sigma**-2
    both = before + now
    made = table.copy()
    made[:, SIGMA] = both**-0.5
    made[:, MEAN] = (table[:, MEAN] * before + lane * now) / both
    for k in (VANISHING, BEND):  # the prior of a first frame, anew in every frame, would flatten every bend
        made[k, MEAN], made[k, SIGMA] = lane[k], sigma[k]
    return made


def search_size(width_px: int, height_px: int) -> tuple[int, int]:
    """The camera's size, halved until it has at most `MAX_PIXELS`."""
    while width_px * height_px > MAX_PIXELS:
        width_px, height_px = (width_px + 1) // 2, (height_px + 1) // 2
    return width_px, height_px


METHOD = Method(
    summary="both boundaries together as stripes of a marking's width, tracked; finds the horizon itself",
    search_size=search_size,
    make=LaneTracker,
    uses_motion=True,
    is_rectified=True,
)
