"""Four driver models, and the closed loop of one with the recorded motion of another vehicle.

The models are those that UN Regulation 157 and the European Commission's study of it compare: the careful and competent
human (annex 4, appendix 3), the regulation's own criterion (5.2.5.2), RSS (Shalev-Shwartz et al. 2017) and the fuzzy
safety model (Mattas et al. 2020). Each keeps the ego's speed until it sees danger, reacts after its reaction time, and
brakes in the ego's own way; the other drives as recorded. Rows of every array are cases, which are run at once.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.measures import fuzzy_safety
from cwcli.measures.outlines import LengthAndWidthM, outline_separation_m
from cwcli.signals.columns import BoolArray, FloatArray

GRAVITY_MPS2 = 9.81
"""Acceleration of gravity as the regulation rounds it, m/s^2."""
HUMAN_BRAKING_MPS2 = 0.774 * GRAVITY_MPS2
"""Largest deceleration of the careful and competent human, m/s^2; UN Regulation 157, annex 4, appendix 3: 0.774 g."""
HUMAN_BRAKING_JERK_MPS3 = 12.65
"""Rate at which the human's deceleration grows, m/s^3; UN Regulation 157, annex 4, appendix 3: 0.774 g in 0.6 s."""
HUMAN_CRITICAL_TTC_S = 2.0
"""Time to collision below which the human takes a cut-in as dangerous, s; UN Regulation 157, annex 4, appendix 3."""
R157_BRAKING_MPS2, R157_REACTION_S, R157_CUT_IN_LATERAL_GAP_M, R157_CRITERION_ADDED_TIME_STEP_S = 6.0, 0.35, 0.5, 0.1
"""Deceleration (m/s^2), reaction time (s), lateral gap (m) at which a vehicle cuts in, and added time step (s) of the
regulation's own criterion; UN Regulation 157, 5.2.5.2, the last two as in JRC-FSM."""
RSS_REACTION_S, RSS_ACCEL_MPS2, RSS_BRAKING_MPS2 = 0.75, 3.0, 6.0
"""Reaction time (s), acceleration until then and braking after it (m/s^2) of RSS, along the road; values of the
reference implementation JRC-FSM."""
RSS_LATERAL_ACCEL_MPS2, RSS_LATERAL_MARGIN_M = 1.0, 0.3
"""Lateral acceleration (m/s^2) and lateral margin (m) of RSS; values of the reference implementation JRC-FSM."""


@dataclass(frozen=True)
class DrivingSituation:
    """The inputs of a driver model at one moment, (n,) each, along and across the ego's heading.

    Attributes:
        gap_m, lateral_gap_m: Gaps between the outlines; negative where they overlap in that direction.
        reach_m: Half of both lengths together.
        speed_mps, accel_mps2: Speed and acceleration of the ego.
        other_speed_mps: Speed of the other along the ego's heading.
        approach_mps: Speed of the other across it, towards the ego.
        is_behind: The other is behind the ego.
    """

    gap_m: FloatArray
    lateral_gap_m: FloatArray
    reach_m: FloatArray
    speed_mps: FloatArray
    accel_mps2: FloatArray
    other_speed_mps: FloatArray
    approach_mps: FloatArray
    is_behind: BoolArray

    @property
    def closing_speed_mps(self) -> FloatArray:
        """The closing speed along the ego's heading, shape (n,); positive while the gap closes."""
        return self.speed_mps - self.other_speed_mps

    @property
    def ttc_s(self) -> FloatArray:
        """The absolute value of gap over closing speed, shape (n,), s."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.abs(self.gap_m / self.closing_speed_mps)


@dataclass(frozen=True)
class DriverModel:
    """A driver model.

    Attributes:
        summary: Name in words.
        requested_deceleration_mps2: Situation -> the deceleration that it requests, (n,); 0 where it sees no danger.
        reaction_s: Time from seeing danger to braking.
        release_mps2: Deceleration while it reacts: the foot leaves the pedal.
        jerk_mps3: How fast the deceleration grows.
        is_no_longer_judged: Situation -> whether a case is no longer judged, (n,), because the cut-in left enough time.
    """

    summary: str
    requested_deceleration_mps2: Callable[[DrivingSituation], FloatArray]
    reaction_s: float
    release_mps2: float = 0.0
    jerk_mps3: float = np.inf
    is_no_longer_judged: Callable[[DrivingSituation], BoolArray] | None = None


def _human_cut_in_braking_mps2(situation: DrivingSituation) -> FloatArray:
    """Deceleration of the careful human at a cut-in: full where the other is in the way and nearer than 2 s."""
    danger = ~situation.is_behind & (situation.lateral_gap_m <= 0.0) & (situation.ttc_s <= HUMAN_CRITICAL_TTC_S)
    return np.where(danger, HUMAN_BRAKING_MPS2, 0.0)


def _is_cut_in_early_enough(situation: DrivingSituation) -> BoolArray:
    """Whether a vehicle has cut in with more time left than the human takes as dangerous."""
    return np.asarray(
        ~situation.is_behind & (situation.lateral_gap_m <= 0.0) & (situation.ttc_s > HUMAN_CRITICAL_TTC_S)
    )


def _r157_braking_mps2(situation: DrivingSituation) -> FloatArray:
    """Deceleration of the regulation's criterion: full where the time to collision is too short to brake."""
    bound_s = (
        situation.closing_speed_mps / (2.0 * R157_BRAKING_MPS2) + R157_REACTION_S + R157_CRITERION_ADDED_TIME_STEP_S
    )
    danger = (
        ~situation.is_behind & (situation.lateral_gap_m <= R157_CUT_IN_LATERAL_GAP_M) & (situation.ttc_s <= bound_s)
    )
    return np.where(danger, R157_BRAKING_MPS2, 0.0)


def _rss_braking_mps2(situation: DrivingSituation) -> FloatArray:
    """Deceleration of RSS: full where the gap along and the gap across are both below their safe values."""
    after = situation.speed_mps + RSS_REACTION_S * RSS_ACCEL_MPS2
    safe_m = situation.speed_mps * RSS_REACTION_S + RSS_ACCEL_MPS2 * RSS_REACTION_S**2 / 2.0
    safe_m = safe_m + (after**2 - situation.other_speed_mps**2) / (2.0 * RSS_BRAKING_MPS2)
    across = np.abs(situation.approach_mps)
    across_after = across + RSS_LATERAL_ACCEL_MPS2 * RSS_REACTION_S
    beside_m = (2.0 * across + RSS_LATERAL_ACCEL_MPS2 * RSS_REACTION_S) * RSS_REACTION_S / 2.0
    beside_m = RSS_LATERAL_MARGIN_M + beside_m + across_after**2 / (2.0 * RSS_LATERAL_ACCEL_MPS2)
    danger = ~situation.is_behind & (situation.gap_m < safe_m) & (situation.lateral_gap_m < beside_m)
    return np.where(danger, HUMAN_BRAKING_MPS2, 0.0)


def _fuzzy_braking_mps2(situation: DrivingSituation) -> FloatArray:
    """Deceleration of the fuzzy safety model; 0 where the other stays beside the ego until it has passed."""
    is_beside_lane = situation.lateral_gap_m > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        lateral_s = situation.lateral_gap_m / situation.approach_mps
        passing_s = (situation.gap_m + 2.0 * situation.reach_m) / situation.closing_speed_mps
    goes_by = is_beside_lane & (~(situation.approach_mps > 0.0) | (lateral_s > passing_s + 0.1))
    critical_unsafety = fuzzy_safety.critical_unsafety_of_gap(
        situation.gap_m, situation.speed_mps, situation.other_speed_mps, situation.accel_mps2
    )
    ahead = fuzzy_safety.proactive_unsafety_of_gap(situation.gap_m, situation.speed_mps, situation.other_speed_mps)
    hard = fuzzy_safety.HARDEST_BRAKING_MPS2 - fuzzy_safety.COMFORTABLE_BRAKING_MPS2
    braking_mps2 = np.where(
        critical_unsafety > 0.0,
        fuzzy_safety.COMFORTABLE_BRAKING_MPS2 + critical_unsafety * hard,
        ahead * fuzzy_safety.COMFORTABLE_BRAKING_MPS2,
    )
    return np.where(situation.is_behind | goes_by, 0.0, braking_mps2)


CAREFUL_HUMAN_DRIVER_AT_CUT_IN = DriverModel(
    "careful and competent human",
    _human_cut_in_braking_mps2,
    0.75,
    0.4,
    HUMAN_BRAKING_JERK_MPS3,
    _is_cut_in_early_enough,
)
"""The careful and competent human at a cut-in, with the regulation's reaction time and release of the pedal; UN
Regulation 157, annex 4, appendix 3."""
R157_DRIVER = DriverModel("driver of UN R157", _r157_braking_mps2, R157_REACTION_S)
"""The driver of UN Regulation 157, 5.2.5.2."""
RSS_DRIVER = DriverModel("RSS", _rss_braking_mps2, RSS_REACTION_S, 0.0, HUMAN_BRAKING_JERK_MPS3)
"""The driver of RSS (Shalev-Shwartz et al. 2017), who brakes as the careful human does."""
FUZZY_SAFETY_DRIVER = DriverModel(
    "fuzzy safety model", _fuzzy_braking_mps2, fuzzy_safety.FOLLOWER_RESPONSE_TIME_S, 0.0, HUMAN_BRAKING_JERK_MPS3
)
"""The driver of the fuzzy safety model (Mattas et al. 2020), who brakes with the human's jerk."""


@dataclass(frozen=True)
class CasePoses:
    """One vehicle in every case, (n,) each, map frame: centre, heading, speed along it, speed across it (left)."""

    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    across_mps: FloatArray


@dataclass(frozen=True)
class DriverOutcome:
    """The results of all cases, (n,) each.

    Attributes:
        crashed: The outlines overlapped.
        crash_s: When first, from the start; NaN if never.
        impact_mps: The relative speed then; NaN if never.
        braked_s: When the driver first braked; NaN if never.
        least_gap_m: Least distance by which the outlines were apart on the separating axes; negative in a crash.
    """

    crashed: BoolArray
    crash_s: FloatArray
    impact_mps: FloatArray
    braked_s: FloatArray
    least_gap_m: FloatArray


@dataclass(frozen=True)
class EgoCases:
    """The ego in n cases at the start.

    Attributes:
        speed_mps: Shape (n,).
        pose_at: Distance along the ego's path, (n,) -> x_m, y_m, heading_rad there.
        size: Length and width.
        offset_m: Distance along the path, (n,); None: 0.
    """

    speed_mps: FloatArray
    pose_at: Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
    size: LengthAndWidthM
    offset_m: FloatArray | None = None


def simulate_driver_cases(
    driver: DriverModel,
    ego: EgoCases,
    other_at: Callable[[int], tuple[CasePoses, BoolArray, LengthAndWidthM]],
    *,
    n_steps: int,
    step_s: float,
) -> DriverOutcome:
    """Simulate every case with one driver model.

    Args:
        other_at: Step -> the other's poses, whether the driver reacts to it, and its size.
        step_s: Duration of a step; positions follow from the speed at its end.
    """
    n = len(ego.speed_mps)
    speed = ego.speed_mps.astype(np.float64)
    way = np.zeros(n) if ego.offset_m is None else ego.offset_m.astype(np.float64)
    before, decel = speed.copy(), np.zeros(n)
    left_s = np.full(n, driver.reaction_s)
    crash_s, impact, braked_s = (np.full(n, np.nan) for _ in range(3))
    least, over = np.full(n, np.inf), np.zeros(n, dtype=bool)
    for step in range(n_steps):
        own = ego.pose_at(way)
        other, minded, other_size = other_at(step)
        situation = _driving_situation(own, speed, (speed - before) / step_s, other, ego.size, other_size)
        if driver.is_no_longer_judged is not None:
            over |= minded & driver.is_no_longer_judged(situation)
        requested_mps2 = np.where(minded, driver.requested_deceleration_mps2(situation), 0.0)
        acts, waits = requested_mps2 > 0.0, left_s > 0.0
        braked_s = np.where(acts & ~waits & np.isnan(braked_s), step * step_s, braked_s)
        grown = np.minimum(decel + driver.jerk_mps3 * step_s, requested_mps2)
        decel = np.where(acts, np.where(waits, driver.release_mps2, grown), decel)
        left_s = np.where(acts & waits, left_s - step_s, left_s)
        margin = outline_separation_m(
            other.x_m - own[0], other.y_m - own[1], own[2], other.heading_rad, ego.size, other_size
        )
        least = np.where(over, least, np.minimum(least, margin))
        hits = (margin < 0.0) & minded & np.isnan(crash_s) & ~over
        crash_s = np.where(hits, step * step_s, crash_s)
        impact = np.where(hits, np.hypot(situation.closing_speed_mps, situation.approach_mps), impact)
        before = speed
        speed = np.where(acts, np.maximum(speed - decel * step_s, 0.0), speed)
        way = way + speed * step_s
    return DriverOutcome(~np.isnan(crash_s), crash_s, impact, braked_s, least)


def _driving_situation(
    ego_pose: tuple[FloatArray, FloatArray, FloatArray],
    speed_mps: FloatArray,
    accel_mps2: FloatArray,
    other: CasePoses,
    ego_size: LengthAndWidthM,
    other_size: LengthAndWidthM,
) -> DrivingSituation:
    """Compute a driver's inputs: gaps and speeds of the other along and across the ego's heading."""
    cosine, sine = np.cos(ego_pose[2]), np.sin(ego_pose[2])
    dx, dy = other.x_m - ego_pose[0], other.y_m - ego_pose[1]
    ahead, left = dx * cosine + dy * sine, dy * cosine - dx * sine
    turn = other.heading_rad - ego_pose[2]
    along, across = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    reach = 0.5 * (ego_size[0] + other_size[0] * along + other_size[1] * across)
    half_widths_m = 0.5 * (ego_size[1] + other_size[0] * across + other_size[1] * along)
    velocity_ahead = other.speed_mps * np.cos(turn) - other.across_mps * np.sin(turn)
    velocity_left = other.speed_mps * np.sin(turn) + other.across_mps * np.cos(turn)
    return DrivingSituation(
        gap_m=np.abs(ahead) - reach,
        lateral_gap_m=np.abs(left) - half_widths_m,
        reach_m=reach,
        speed_mps=speed_mps,
        accel_mps2=accel_mps2,
        other_speed_mps=velocity_ahead,
        approach_mps=-np.sign(left) * velocity_left,
        is_behind=ahead < 0.0,
    )
