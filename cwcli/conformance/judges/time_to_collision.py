"""The warning comes while the time to collision is still the published one.

Demands: `ttc` (at constant velocities) or `ttc_with_accelerations`, s. By the second, the lead's present deceleration
counts. A warning before the trial's event (the lead's braking) does not count: the gap does not close yet.
"""

from __future__ import annotations

import math

from cwcli.conformance.encounter import Encounter
from cwcli.conformance.verdict import DrivenTrial, Verdict, WarningWindow, judge_by_window

NUMBERS_THAT_JUDGE_NEEDS = ("ttc", "ttc_with_accelerations")
"""Names of the numbers that it asks for."""


def warning_window(encounter: Encounter, demands: dict[str, float]) -> WarningWindow:
    """The window from the event to the moment at which the time to collision falls below the number."""
    if "ttc" in demands:
        return WarningWindow(-math.inf, encounter.last_time_above_s(encounter.ttc_s, demands["ttc"]))
    needed_s = demands["ttc_with_accelerations"]
    return WarningWindow(-math.inf, encounter.last_time_above_s(encounter.ttc_with_accelerations_s, needed_s))


def judge(driven: DrivenTrial) -> Verdict:
    """Judge one repetition."""
    if "ttc" not in driven.demands:
        driven.demanded_number_si("ttc_with_accelerations")
    assert isinstance(driven.encounter, Encounter)
    return judge_by_window(driven, warning_window(driven.encounter, dict(driven.demands)))
