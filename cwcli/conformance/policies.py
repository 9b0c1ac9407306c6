"""Braking policies of a trial: what the car does once it is warned."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cwcli.conformance.encounter import Encounter
from cwcli.control.closed_loop import (
    PedalPolicy,
    PedalSituation,
    RecordedMotion,
    fuzzy_controller_throttle_and_pressure,
    replay_with_policy,
    throttle_and_pressure_of_driver_braking_after_warning,
)
from cwcli.control.controller import MAX_BRAKE_PRESSURE_MPA
from cwcli.lazy_dataclass import dataclass
from cwcli.measures.outlines import outline_separation_m
from cwcli.signals.columns import FloatArray
from cwcli.signals.vehicle_state import ACCEL, HEADING, SPEED, YAW_RATE, X, Y

NO_BRAKING_POLICY = "none"
"""Name of the policy that never brakes."""


REPLAY_STEP_S = 0.02
"""Time step of the drives with a policy, s. Chosen by hand: half the processor time of the replay's own 10 ms, and the
latest warning moves by less than that."""


def full_braking_throttle_and_pressure(situation: PedalSituation) -> tuple[FloatArray, FloatArray]:
    """Throttle and brake pressure of full braking from the warning on."""
    braking = situation.since_warning_s >= 0.0
    return np.zeros(len(braking)), np.where(braking, MAX_BRAKE_PRESSURE_MPA, 0.0)


PEDALS_BY_POLICY: Mapping[str, PedalPolicy | None] = {
    NO_BRAKING_POLICY: None,
    "full": full_braking_throttle_and_pressure,
    "driver": throttle_and_pressure_of_driver_braking_after_warning,
    "fuzzy": fuzzy_controller_throttle_and_pressure,
}
"""Policy -> its pedals. `none` does not brake; `full` brakes with 10 MPa at once; `driver` brakes hard 1.5 s after the
warning; `fuzzy` is the controller of song2016, section 4."""


@dataclass(frozen=True)
class BrakedTrial:
    """A trial driven again with a braking policy.

    Attributes:
        impact_mps: Relative speed along the host's heading at first contact; 0 if there is none.
    """

    impact_mps: float


def drive_with_policy(encounter: Encounter, policy: str, braking_from_s: float) -> BrakedTrial:
    """Drive a trial again: the host as it was until `braking_from_s`, then by the policy; NaN: it never brakes."""
    is_braked = PEDALS_BY_POLICY[policy] is not None and not math.isnan(braking_from_s)
    from_s = np.array([braking_from_s if is_braked else math.inf])
    impact_mps = impact_speeds_with_policy_mps(encounter, policy if is_braked else "full", from_s)
    return BrakedTrial(float(impact_mps[0]))


def impact_speeds_with_policy_mps(encounter: Encounter, policy: str, braking_from_s: FloatArray) -> FloatArray:
    """Impact speeds (n,), m/s, of drives that brake by a policy from each time (n,); 0 where there is no contact."""
    pedals = PEDALS_BY_POLICY[policy]
    assert pedals is not None  # "none" never brakes
    runs = replay_with_policy(
        _recorded_motion(encounter, encounter.host),
        _recorded_motion(encounter, encounter.other),
        braking_from_s,
        pedals,
        step_s=REPLAY_STEP_S,
    )
    other = _recorded_motion(encounter, encounter.other).resample_at(runs.time_s)
    shape = runs.x_m.shape
    separation = outline_separation_m(
        other.x_m - runs.x_m,
        other.y_m - runs.y_m,
        runs.heading_rad,
        np.broadcast_to(other.heading_rad, shape),
        encounter.host_size,
        encounter.other_size,
    )
    touching = separation <= 0.0
    k = touching.argmax(axis=1)
    rows = np.arange(len(k))
    turn = other.heading_rad[k] - runs.heading_rad[rows, k]
    impact = np.maximum(0.0, runs.speed_mps[rows, k] - other.speed_mps[k] * np.cos(turn))
    return np.where(touching.any(axis=1), np.maximum(impact, 1e-6), 0.0)


def _recorded_motion(encounter: Encounter, state: FloatArray) -> RecordedMotion:
    """The states (k, 8) of one vehicle as the replay takes them."""
    return RecordedMotion(
        encounter.time_s, state[:, X], state[:, Y], state[:, HEADING], np.maximum(state[:, SPEED], 0.0),
        state[:, ACCEL], state[:, YAW_RATE],
    )  # fmt: skip
