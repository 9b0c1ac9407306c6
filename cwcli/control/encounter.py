"""The replay of one warning of a recorded drive under each policy.

The tracks are cut to the time around the warning, extended beyond their end, and run in the closed loop.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from cwcli.control.closed_loop import (
    COLLISION_DISTANCE_M,
    PedalSituation,
    RecordedMotion,
    ReplayedRuns,
    fuzzy_controller_throttle_and_pressure,
    replay_with_policy,
    throttle_and_pressure_of_driver_braking_after_warning,
)
from cwcli.lazy_dataclass import dataclass
from cwcli.option import Option
from cwcli.signals.columns import BoolArray, FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

BRAKING_POLICY_NAMES = ("no-action", "fuzzy", "driver")
"""Names of the policies, in the order of the rows of every array below; `no-action` is the recorded motion itself."""
REPLAY_START_BEFORE_WARNING_S = 5.0
"""Time before the warning at which a replay starts, s. Chosen by hand; not fitted."""
MAX_TRACK_GAP_BRIDGED_BY_REPLAY_S = 1.0
"""Longest gap between the states of a track that a replay bridges, s. Chosen by hand; not fitted."""
TRACK_EXTENSION_STEP_S = 0.05
"""Time between the states that extend a track beyond its end, s: the states' usual period (20 Hz)."""
MIN_HOST_SPEED_FOR_HEADING_MPS = 1.0
"""Speed below which the estimated heading of the host is not used, m/s. Chosen by hand; not fitted."""
MIN_TRAVEL_FOR_HOST_DIRECTION_M = 3.0
"""Distance that a slow host must travel before its direction replaces the heading, m. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class RecordedTrack:
    """The estimated states of one vehicle.

    Attributes:
        stamp_ns: Shape (n,), strictly increasing.
        state: Shape (n, 8): x_m, y_m, speed_mps, heading_rad, accel_mps2, yaw_rate_radps, jerk_mps3, yaw_accel_radps2.
    """

    stamp_ns: Int64Array
    state: FloatArray


@dataclass(frozen=True)
class ReplaySpan:
    """How much of a drive is replayed.

    Attributes:
        duration_s: At most this long after the warning.
        after_s: At most this far beyond the last state of a vehicle, at its last speed and yaw rate.
    """

    duration_s: Annotated[
        float, Option("--duration", "Replay at most this long after a warning.", metavar="SECONDS")
    ] = 15.0
    after_s: Annotated[
        float,
        Option(
            "--after",
            "Extrapolate at most this long after the last state of a vehicle, at its last speed and yaw rate.",
            metavar="SECONDS",
        ),
    ] = 6.0


@dataclass(frozen=True)
class ReplayedWarning:
    """The replays of one warning; times are seconds after it, arrays have one row per policy.

    Attributes:
        outcome: The replay, on a grid that has the warning at 0.
        other: The other vehicle on the same grid.
        is_behind: The other vehicle was behind the host at the warning. It moves as recorded and may run into it.
        recorded_until_s: Time from which one of the two motions is extrapolated, not recorded.
        after_warning_mask: Shape (k,), bool: steps from the warning on. The values below are taken over these steps.
        min_distance_m, min_distance_time_s: Least distance of the reference points.
        collided: The distance fell below `COLLISION_DISTANCE_M`.
        collision_time_s, impact_speed_mps: When it first did, and the relative speed then; NaN if never.
        peak_deceleration_mps2, peak_jerk_mps3: Magnitudes. Without action: of the estimated states.
        stopped_time_s: When the host first stands; NaN if never.
    """

    outcome: ReplayedRuns
    other: RecordedMotion
    is_behind: bool
    recorded_until_s: float
    after_warning_mask: BoolArray
    min_distance_m: FloatArray
    min_distance_time_s: FloatArray
    collided: BoolArray
    collision_time_s: FloatArray
    impact_speed_mps: FloatArray
    peak_deceleration_mps2: FloatArray
    peak_jerk_mps3: FloatArray
    stopped_time_s: FloatArray


def replay_warning(host: RecordedTrack, other: RecordedTrack, warning_ns: int, span: ReplaySpan) -> ReplayedWarning:
    """Replay both tracks around a warning, the host under every policy.

    Only the stretches without a gap longer than 1 s around the warning are used, from 5 s before it.

    Raises:
        ValueError: A track begins more than 1 s after the warning.
    """
    motions, jerks, ends_s = [], [], []
    for track in (host, other):
        rows = contiguous_rows_around(track.stamp_ns, warning_ns)
        state = track.state[rows]
        motion = RecordedMotion(
            (track.stamp_ns[rows] - warning_ns) / NS_PER_S,
            state[:, 0],
            state[:, 1],
            np.unwrap(state[:, 3]),
            np.maximum(state[:, 2], 0.0),
            state[:, 4],
            state[:, 5],
        )
        motions.append(motion)
        ends_s.append(float(motion.time_s[-1]))
        jerks.append(state[:, 6])
    end_s = min(span.duration_s, max(min(ends_s), 0.0) + span.after_s)
    start_s = max(-REPLAY_START_BEFORE_WARNING_S, *(float(motion.time_s[0]) for motion in motions))
    # Whole steps before the warning, at least one: the grid has the warning at 0, and a recorded state before it.
    start_s = -max(float(np.floor(-start_s / TRACK_EXTENSION_STEP_S + 1e-9)), 1.0) * TRACK_EXTENSION_STEP_S
    host_motion, other_motion = (extend_motion(motion, end_s) for motion in motions)
    host_motion = cut_motion(host_motion, start_s, end_s)
    other_motion = cut_motion(other_motion, start_s, end_s)
    warnings_s = np.array([np.inf, 0.0, 0.0])
    outcome = replay_with_policy(host_motion, other_motion, warnings_s - 1e-6, _throttle_and_pressure_of_all_policies)
    known_jerk = np.interp(outcome.time_s, motions[0].time_s, jerks[0], right=0.0)
    return _summarise_replayed_runs(outcome, other_motion.resample_at(outcome.time_s), min(ends_s), known_jerk)


def contiguous_rows_around(stamp_ns: Int64Array, at_ns: int) -> slice:
    """The rows around a time between which there is no gap longer than `MAX_TRACK_GAP_BRIDGED_BY_REPLAY_S`.

    Raises:
        ValueError: The first row is longer than that after the time.
    """
    max_gap_ns = MAX_TRACK_GAP_BRIDGED_BY_REPLAY_S * NS_PER_S
    # A sender whose clock is ahead may be known before its stamp.
    row_at_time = max(int(np.searchsorted(stamp_ns, at_ns, side="right")) - 1, 0)
    if stamp_ns[row_at_time] - at_ns > max_gap_ns:
        raise ValueError("the track begins after the warning")
    breaks = np.flatnonzero(np.diff(stamp_ns) > max_gap_ns)
    first = int(breaks[breaks < row_at_time][-1]) + 1 if (breaks < row_at_time).any() else 0
    last = int(breaks[breaks >= row_at_time][0]) if (breaks >= row_at_time).any() else len(stamp_ns) - 1
    return slice(first, last + 1)


def extend_motion(motion: RecordedMotion, end_s: float) -> RecordedMotion:
    """Extend the motion to `end_s` at its last speed and yaw rate (an arc)."""
    last_s = float(motion.time_s[-1])
    if end_s <= last_s:
        return motion
    more_s = np.append(np.arange(TRACK_EXTENSION_STEP_S, end_s - last_s - 1e-9, TRACK_EXTENSION_STEP_S), end_s - last_s)
    speed, heading = float(motion.speed_mps[-1]), float(motion.heading_rad[-1])
    turn_rate = float(motion.turn_rate_radps[-1])
    half_turn = 0.5 * turn_rate * more_s
    chord = speed * more_s * np.sinc(half_turn / np.pi)  # of the arc: 2 r sin(angle / 2)
    return RecordedMotion(
        np.append(motion.time_s, last_s + more_s),
        np.append(motion.x_m, motion.x_m[-1] + chord * np.cos(heading + half_turn)),
        np.append(motion.y_m, motion.y_m[-1] + chord * np.sin(heading + half_turn)),
        np.append(motion.heading_rad, heading + 2.0 * half_turn),
        np.append(motion.speed_mps, np.full(len(more_s), speed)),
        np.append(motion.acceleration_mps2, np.zeros(len(more_s))),
        np.append(motion.turn_rate_radps, np.full(len(more_s), turn_rate)),
    )


def cut_motion(motion: RecordedMotion, start_s: float, end_s: float) -> RecordedMotion:
    """Cut the motion to `start_s` to `end_s`, with points at both ends."""
    inside = (motion.time_s > start_s) & (motion.time_s < end_s)
    return motion.resample_at(np.concatenate(([start_s], motion.time_s[inside], [end_s])))


def _throttle_and_pressure_of_all_policies(situation: PedalSituation) -> tuple[FloatArray, FloatArray]:
    """Throttle and brake pressure of all policies, one row each; shape (3,) each."""
    throttle, pressure = np.zeros(len(BRAKING_POLICY_NAMES)), np.zeros(len(BRAKING_POLICY_NAMES))
    for row, policy in (
        (1, fuzzy_controller_throttle_and_pressure),
        (2, throttle_and_pressure_of_driver_braking_after_warning),
    ):
        opening, brake = policy(situation)
        throttle[row], pressure[row] = opening[row], brake[row]
    return throttle, pressure


def _summarise_replayed_runs(
    outcome: ReplayedRuns, other: RecordedMotion, recorded_until_s: float, known_jerk_mps3: FloatArray
) -> ReplayedWarning:
    """Summarise the replayed runs: least distance, collision, peaks and standstill from the warning on."""
    after = outcome.time_s >= -1e-6
    distance = np.where(after, outcome.distance_m, np.inf)
    nearest = distance.argmin(axis=1)
    rows = np.arange(len(BRAKING_POLICY_NAMES))
    hit = distance < COLLISION_DISTANCE_M
    first_hit = hit.argmax(axis=1)
    collided = np.asarray(hit.any(axis=1))
    relative = np.hypot(
        other.speed_mps * np.cos(other.heading_rad) - outcome.speed_mps * np.cos(outcome.heading_rad),
        other.speed_mps * np.sin(other.heading_rad) - outcome.speed_mps * np.sin(outcome.heading_rad),
    )
    standing = (outcome.speed_mps < 0.01) & after
    deceleration, jerk = outcome.peak_deceleration_mps2.copy(), outcome.peak_jerk_mps3.copy()
    deceleration[0] = max(float(np.max(-outcome.accel_mps2[0, after])), 0.0)
    jerk[0] = float(np.abs(known_jerk_mps3[after]).max())
    return ReplayedWarning(
        outcome=outcome,
        other=other,
        is_behind=_is_other_behind_host(outcome, other, int(after.argmax())),
        recorded_until_s=recorded_until_s,
        after_warning_mask=after,
        min_distance_m=distance.min(axis=1),
        min_distance_time_s=outcome.time_s[nearest],
        collided=collided,
        collision_time_s=np.where(collided, outcome.time_s[first_hit], np.nan),
        impact_speed_mps=np.where(collided, relative[rows, first_hit], np.nan),
        peak_deceleration_mps2=deceleration,
        peak_jerk_mps3=jerk,
        stopped_time_s=np.where(standing.any(axis=1), outcome.time_s[standing.argmax(axis=1)], np.nan),
    )


def _is_other_behind_host(outcome: ReplayedRuns, other: RecordedMotion, row_at_time: int) -> bool:
    """Whether the other vehicle is behind the host at step `here`.

    The heading of a standing host is not reliable, so there the direction of its next few metres is used.
    """
    x, y = outcome.x_m[0, row_at_time], outcome.y_m[0, row_at_time]
    heading = float(outcome.heading_rad[0, row_at_time])
    if outcome.speed_mps[0, row_at_time] < MIN_HOST_SPEED_FOR_HEADING_MPS:
        has_moved_far = (
            np.hypot(outcome.x_m[0, row_at_time:] - x, outcome.y_m[0, row_at_time:] - y)
            > MIN_TRAVEL_FOR_HOST_DIRECTION_M
        )
        if not has_moved_far.any():
            return False
        row_after_move = row_at_time + int(has_moved_far.argmax())
        heading = float(np.arctan2(outcome.y_m[0, row_after_move] - y, outcome.x_m[0, row_after_move] - x))
    return bool((other.x_m[row_at_time] - x) * np.cos(heading) + (other.y_m[row_at_time] - y) * np.sin(heading) < 0.0)
