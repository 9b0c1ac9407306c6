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
    braking_driver_pedals,
    fuzzy_controller_pedals,
    replay_with_policy,
)
from cwcli.control.controller import MAX_BRAKE_PRESSURE_MPA
from cwcli.lazy_dataclass import dataclass
from cwcli.measures.outlines import outline_separation_m
from cwcli.signals.columns import FloatArray
from cwcli.signals.vehicle_state import ACCEL, HEADING, SPEED, YAW_RATE, X, Y

NO_BRAKING = "none"
"""Name of the policy that never brakes."""


def full_braking_pedals(situation: PedalSituation) -> tuple[FloatArray, FloatArray]:
    """Throttle and brake pressure of full braking from the warning on."""
    braking = situation.since_warning_s >= 0.0
    return np.zeros(len(braking)), np.where(braking, MAX_BRAKE_PRESSURE_MPA, 0.0)


POLICIES: Mapping[str, PedalPolicy | None] = {
    NO_BRAKING: None,
    "full": full_braking_pedals,
    "driver": braking_driver_pedals,
    "fuzzy": fuzzy_controller_pedals,
}
"""Policy -> its pedals. `none` does not brake; `full` brakes with 10 MPa at once; `driver` brakes hard 1.5 s after the
warning; `fuzzy` is the controller of song2016, section 4."""


@dataclass(frozen=True)
class BrakedTrial:
    """A trial driven again with a braking policy.

    Attributes:
        impact_mps: Relative speed along the host's heading at first contact; 0 if there is none.
        peak_deceleration_mps2: Largest deceleration of the host after the warning.
    """

    impact_mps: float
    peak_deceleration_mps2: float


def drive_with_policy(encounter: Encounter, policy: str, braking_from_s: float) -> BrakedTrial:
    """Drive a trial again: the host as it was until `braking_from_s`, then by the policy; NaN: it never brakes."""
    pedals = POLICIES[policy]
    never = pedals is None or math.isnan(braking_from_s)
    runs = replay_with_policy(
        _recorded_motion(encounter, encounter.host),
        _recorded_motion(encounter, encounter.other),
        np.array([math.inf if never else braking_from_s]),
        full_braking_pedals if pedals is None else pedals,
    )
    other = _recorded_motion(encounter, encounter.other).resample_at(runs.time_s)
    separation = outline_separation_m(
        other.x_m - runs.x_m[0],
        other.y_m - runs.y_m[0],
        runs.heading_rad[0],
        other.heading_rad,
        encounter.host_size,
        encounter.other_size,
    )
    touching = np.flatnonzero(separation <= 0.0)
    if not len(touching):
        return BrakedTrial(0.0, float(runs.peak_deceleration_mps2[0]))
    k = int(touching[0])
    turn = other.heading_rad[k] - runs.heading_rad[0, k]
    return BrakedTrial(
        max(0.0, float(runs.speed_mps[0, k] - other.speed_mps[k] * math.cos(turn))),
        float(runs.peak_deceleration_mps2[0]),
    )


def _recorded_motion(encounter: Encounter, state: FloatArray) -> RecordedMotion:
    """The states (k, 8) of one vehicle as the replay takes them."""
    return RecordedMotion(
        encounter.time_s, state[:, X], state[:, Y], state[:, HEADING], np.maximum(state[:, SPEED], 0.0),
        state[:, ACCEL], state[:, YAW_RATE],
    )  # fmt: skip
