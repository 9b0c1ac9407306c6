"""ISO 15623: the warning must have come at one moment, and must not have come before another.

It must have come once the deceleration that the driver needs after the reaction time exceeds a limit,

    a_lead + v_r^2 / (2 (d - tau v_r)) > limit,

with the lead's deceleration, the closing speed v_r and the gap d; and it must not come while the time to collision at
constant velocities is longer than `longest_ttc`.

Demands: `reaction_time` (s), `required_deceleration` (m/s^2), `longest_ttc` (s).
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.conformance.encounter import Encounter
from cwcli.conformance.verdict import DrivenTrial, Verdict, WarningWindow, judge_by_window
from cwcli.signals.columns import FloatArray

NUMBERS_THAT_JUDGE_NEEDS = ("reaction_time", "required_deceleration", "longest_ttc")
"""Names of the numbers that it asks for."""


def required_deceleration_mps2(encounter: Encounter, reaction_s: float) -> FloatArray:
    """Deceleration that the host needs after the reaction time, (k,); infinity where the gap is gone by then."""
    closing = np.maximum(encounter.closing_mps, 0.0)
    left_m = encounter.gap_m - reaction_s * closing
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(closing > 0.0, np.where(left_m > 0.0, closing**2 / (2.0 * left_m), np.inf), 0.0)
    return np.asarray(needed + np.maximum(-encounter.other_accel_mps2, 0.0))


def warning_window(encounter: Encounter, demands: dict[str, float]) -> WarningWindow:
    """The window between the two moments."""
    needed = required_deceleration_mps2(encounter, demands["reaction_time"])
    must = np.flatnonzero((needed > demands["required_deceleration"]) & (encounter.time_s >= encounter.event_s))
    latest_s = float(encounter.time_s[must[0]]) if len(must) else math.nan
    near = np.flatnonzero((encounter.ttc_s <= demands["longest_ttc"]) & (encounter.time_s >= encounter.event_s))
    earliest_s = float(encounter.time_s[near[0]]) if len(near) else math.nan
    return WarningWindow(earliest_s, latest_s)


def judge(driven: DrivenTrial) -> Verdict:
    """Judge one repetition."""
    demands = {
        name: driven.demanded_number_si(name) for name in ("reaction_time", "required_deceleration", "longest_ttc")
    }
    assert isinstance(driven.encounter, Encounter)
    return judge_by_window(driven, warning_window(driven.encounter, demands))
