"""The warning comes long enough before emergency braking has to begin, and that braking limits the impact.

Demands: `lead_time` (s) between the warning and the braking, `deceleration` (m/s^2) of that braking, and
`impact_speed` (m/s), at which the contact may still happen.

Braking has to begin when `deceleration`, built up at once, just brings the relative speed at contact down to
`impact_speed`. With a policy other than `none` the car is also driven again: the policy brakes from `lead_time` after
the warning, and the impact speed of that drive is judged.
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.conformance.encounter import Encounter
from cwcli.conformance.policies import NO_BRAKING_POLICY, drive_with_policy
from cwcli.conformance.verdict import DrivenTrial, Verdict, WarningWindow, judge_by_window
from cwcli.signals.units import KMH_PER_MPS

NUMBERS_THAT_JUDGE_NEEDS = ("lead_time", "deceleration", "impact_speed")
"""Names of the numbers that it asks for."""
VERDICT_DEPENDS_ON_BRAKING_POLICY = True
"""True says that its verdict depends on how the warned car brakes."""


def latest_braking_s(encounter: Encounter, deceleration_mps2: float, impact_mps: float) -> float:
    """Latest time at which braking limits the relative speed at contact; NaN if no time does.

    The other keeps its present acceleration until it stands. Braking that begins at t leaves, at the gap's end, the
    relative speed of the two; the closed form is v_r^2 - 2 a d = v_i^2 for another at constant speed.
    """
    at_contact = int(np.searchsorted(encounter.time_s, encounter.contact_s)) - 1
    low, high = 0, at_contact
    if _contact_speed_if_braking_from_row_mps(encounter, low, deceleration_mps2) > impact_mps + 1e-9:
        return math.nan
    while low < high:  # a later start never lessens the impact
        middle = (low + high + 1) // 2
        is_enough = _contact_speed_if_braking_from_row_mps(encounter, middle, deceleration_mps2) <= impact_mps + 1e-9
        low, high = (middle, high) if is_enough else (low, middle - 1)
    return float(encounter.time_s[low])


def _contact_speed_if_braking_from_row_mps(encounter: Encounter, row: int, deceleration_mps2: float) -> float:
    """Relative speed at contact if the host brakes from a row on; 0 without contact. The other moves as it did."""
    elapsed_s = encounter.time_s[row:] - encounter.time_s[row]
    start_mps = float(encounter.host[row, 2])
    own_mps = np.maximum(start_mps - deceleration_mps2 * elapsed_s, 0.0)
    braking_s = np.minimum(elapsed_s, start_mps / deceleration_mps2)
    own_way_m = start_mps * braking_s - 0.5 * deceleration_mps2 * braking_s**2
    theirs_mps = encounter.host[row:, 2] - encounter.closing_mps[row:]
    steps_m = 0.5 * (theirs_mps[1:] + theirs_mps[:-1]) * np.diff(encounter.time_s[row:])
    gap_m = encounter.gap_m[row] + np.concatenate([[0.0], np.cumsum(steps_m)]) - own_way_m
    touching = np.flatnonzero(gap_m <= 0.0)
    return max(0.0, float(own_mps[touching[0]] - theirs_mps[touching[0]])) if len(touching) else 0.0


def warning_window(encounter: Encounter, demands: dict[str, float]) -> WarningWindow:
    """The window that ends `lead_time` before braking has to begin."""
    braking_s = latest_braking_s(encounter, demands["deceleration"], demands["impact_speed"])
    return WarningWindow(-math.inf, braking_s - demands["lead_time"])


def judge(driven: DrivenTrial) -> Verdict:
    """Judge one repetition."""
    demands = {name: driven.demanded_number_si(name) for name in ("lead_time", "deceleration", "impact_speed")}
    encounter = driven.encounter
    assert isinstance(encounter, Encounter)
    verdict = judge_by_window(driven, warning_window(encounter, demands))
    if driven.policy == NO_BRAKING_POLICY or math.isnan(driven.warned_s):
        return verdict
    braked = drive_with_policy(encounter, driven.policy, driven.warned_s + demands["lead_time"])
    impact_kmh = braked.impact_mps * KMH_PER_MPS
    spare_kmh = demands["impact_speed"] * KMH_PER_MPS - impact_kmh
    values = {**verdict.values, "impact_kmh": impact_kmh}
    if spare_kmh < -1e-9:
        return Verdict(-abs(spare_kmh), "km/h", f"impact at {impact_kmh:.1f} km/h", values, has_failed=True)
    return Verdict(verdict.margin, verdict.unit, verdict.text, values, has_failed=verdict.has_failed)
