"""Whether a recorded drive is a trial of a clause, and whether it was driven within the clause's tolerances.

Tolerances, by their names in a clause's file: `subject-speed` and `other-speed` (m/s), `lateral-offset` (m), `gap` (m,
of a braking lead), `lead-deceleration` (m/s^2), `subject-onset` (deceleration of the host before it is warned, which
breaks the trial) and `lead-onset` (deceleration of the lead at which its braking begins).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cwcli.conformance.clause import Clause, Trial
from cwcli.conformance.encounter import Encounter
from cwcli.conformance.verdict import Verdict
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.signals.vehicle_state import ACCEL, SPEED

SCENES_RECOGNISABLE_IN_LOGS = ("approach", "braking-lead")
"""Scenes that are found in logs: their numbers can be read off the motion of two vehicles."""
CHECKED_TIME_BEFORE_BRAKING_S = 3.0
"""Time before the lead's braking from which on a trial is checked, s (NHTSA's confirmation test, as commonly stated,
not checked)."""
MAX_TTC_OF_CHECKED_APPROACH_S = 5.0
"""Time to collision from which on an approach is checked, s (NHTSA's confirmation test, as commonly stated, not
checked)."""
TIME_FROM_LEAD_ONSET_TO_CHECK_S = 1.5
"""Time after its onset from which on the lead's deceleration is checked, s (NHTSA's confirmation test, as commonly
stated, not checked)."""
DEFAULT_SPEED_TOLERANCE_MPS = 0.56
"""Tolerance of speeds where a clause has none, m/s: 2 km/h. Chosen by hand."""
DEFAULT_LEAD_BRAKING_ONSET_MPS2 = 0.05 * 9.80665
"""Deceleration of a lead at which its braking begins, m/s^2, where a clause has none (49 CFR 571.127: 0.05 g)."""
MAX_LATERAL_OFFSET_OF_LEAD_M = 2.0
"""Lateral offset up to which a vehicle can be the lead, m. Chosen by hand: about half a lane."""


@dataclass(frozen=True)
class TrialMatch:
    """How far a recorded drive is from a trial.

    Attributes:
        distance: In tolerances; infinite where it is no such drive at all.
        text: What was found, in words.
        encounter: The drive, from the trial's event on.
    """

    distance: float
    text: str
    encounter: Encounter


def match_encounter_with_trial(clause: Clause, trial: Trial, encounter: Encounter) -> TrialMatch:
    """Compare the speeds (and the gap) of a recorded drive with those of a trial."""
    median_offset_m = float(np.median(np.abs(encounter.lateral_offset_m)))
    if median_offset_m > MAX_LATERAL_OFFSET_OF_LEAD_M or float(encounter.gap_m[0]) < 0.0:
        return TrialMatch(math.inf, f"{median_offset_m:.1f} m to the side of the host's path", encounter)
    tolerance = clause.tolerance("subject-speed") or DEFAULT_SPEED_TOLERANCE_MPS
    other_tolerance = clause.tolerance("other-speed") or DEFAULT_SPEED_TOLERANCE_MPS
    host_mps = trial.given["host_speed"]
    onset_s = lead_braking_onset_s(clause, trial, encounter)
    if trial.scene == "braking-lead":
        if math.isnan(onset_s):
            return TrialMatch(math.inf, "the other does not brake", encounter)
        before = encounter.time_s <= onset_s
        event = replace(encounter, event_s=onset_s)
        gap_m = encounter.value_at(encounter.gap_m, onset_s)
        found = float(np.median(encounter.host[before, SPEED])), float(np.median(encounter.other[before, SPEED]))
        far = max(
            abs(found[0] - host_mps) / tolerance,
            abs(found[1] - host_mps) / other_tolerance,
            abs(gap_m - trial.given["gap"]) / (clause.tolerance("gap") or 0.1 * trial.given["gap"]),
        )
        text = f"host {found[0]:.1f} m/s, other {found[1]:.1f} m/s, gap {gap_m:.1f} m when the other begins to brake"
        return TrialMatch(far, f"{text}; the trial has {host_mps:.1f} m/s and {trial.given['gap']:.1f} m", event)
    near = np.flatnonzero(encounter.ttc_s <= MAX_TTC_OF_CHECKED_APPROACH_S)
    if not len(near) or math.isfinite(onset_s):
        words = (
            "the other brakes"
            if len(near)
            else f"the time to collision is never below {MAX_TTC_OF_CHECKED_APPROACH_S:g} s"
        )
        return TrialMatch(math.inf, words, encounter)
    first = int(near[0])
    found = float(encounter.host[first, SPEED]), float(encounter.other[first, SPEED])
    other_mps = trial.given.get("other_speed", 0.0)
    far = max(abs(found[0] - host_mps) / tolerance, abs(found[1] - other_mps) / other_tolerance)
    text = f"host {found[0]:.1f} m/s, other {found[1]:.1f} m/s {MAX_TTC_OF_CHECKED_APPROACH_S:g} s from contact"
    return TrialMatch(far, f"{text}; the trial has {host_mps:.1f} and {other_mps:.1f} m/s", encounter)


def lead_braking_onset_s(clause: Clause, trial: Trial, encounter: Encounter) -> float:
    """When the lead begins to brake: the last time below the onset before its deceleration is half of the trial's.

    NaN where it never brakes so hard. For a trial without a deceleration 0.1 g counts.
    """
    decel = -encounter.other[:, ACCEL] * np.sign(np.maximum(encounter.other[:, SPEED], 0.0))
    hard = np.flatnonzero(decel >= 0.5 * trial.given.get("deceleration", 2.0))
    if not len(hard):
        return math.nan
    onset = clause.tolerance("lead-onset") or DEFAULT_LEAD_BRAKING_ONSET_MPS2
    calm = np.flatnonzero(decel[: hard[0]] < onset)
    return float(encounter.time_s[calm[-1]]) if len(calm) else float(encounter.time_s[0])


def checked_start_and_end_s(
    trial: Trial, encounter: Encounter, warned_s: float, verdict: Verdict
) -> tuple[float, float]:
    """From when to when a trial is checked: until the warning, or until it had to come."""
    latest_s = verdict.values.get("latest_s", float(encounter.time_s[-1]))
    until_s = latest_s if math.isnan(warned_s) else min(warned_s, latest_s)
    if trial.scene == "braking-lead":
        return encounter.event_s - CHECKED_TIME_BEFORE_BRAKING_S, until_s
    near = np.flatnonzero(encounter.ttc_s <= MAX_TTC_OF_CHECKED_APPROACH_S)
    return (float(encounter.time_s[near[0]]) if len(near) else float(encounter.time_s[0])), until_s


def find_tolerance_breaches(
    clause: Clause, trial: Trial, encounter: Encounter, span_s: tuple[float, float]
) -> list[str]:
    """Find the tolerances that a recorded trial breaks, each with its number, its time and what is permitted."""
    rows = np.flatnonzero((encounter.time_s >= span_s[0]) & (encounter.time_s <= span_s[1]))
    if not len(rows):
        return [f"it is not recorded between {span_s[0]:.1f} s and {span_s[1]:.1f} s"]
    host_mps = trial.given["host_speed"]
    lead = trial.scene == "braking-lead"
    other_mps = host_mps if lead else trial.given.get("other_speed", 0.0)
    before = rows[encounter.time_s[rows] <= encounter.event_s] if lead else rows
    checks: list[tuple[str, FloatArray, np.ndarray[tuple[int, ...], np.dtype[np.intp]], float, str]] = [
        ("subject-speed", encounter.host[:, SPEED], rows, host_mps, "m/s"),
        ("other-speed", encounter.other[:, SPEED], before, other_mps, "m/s"),
        ("lateral-offset", encounter.lateral_offset_m, rows, trial.given.get("lateral_offset", 0.0), "m"),
        ("subject-onset", np.minimum(encounter.host[:, ACCEL], 0.0), rows, 0.0, "m/s^2"),
    ]
    if lead:
        steady = rows[encounter.time_s[rows] >= encounter.event_s + TIME_FROM_LEAD_ONSET_TO_CHECK_S]
        steady = steady[encounter.other[steady, SPEED] > 1.0]
        checks += [
            ("gap", encounter.gap_m, before, trial.given["gap"], "m"),
            ("lead-deceleration", -encounter.other[:, ACCEL], steady, trial.given["deceleration"], "m/s^2"),
        ]
    found = []
    for name, values, where, nominal, unit in checks:
        tolerance = clause.tolerance(name)
        if tolerance is None or not len(where):
            continue
        off = np.abs(values[where] - nominal)
        worst = int(where[int(np.argmax(off))])
        if off.max() > tolerance:
            found.append(
                f"{name.replace('-', ' ')} {values[worst]:.2f} {unit} at {encounter.time_s[worst]:.2f} s; "
                f"permitted {nominal:.2f} +- {tolerance:.2f} {unit}"
            )
    return found
