"""The warning comes between two times to collision: not while it is longer than one, and before it is the other.

Demands: `shortest_ttc` (s), and `longest_ttc` (s), which may be missing. The time to collision is that at constant
velocities along the host's heading; where the two do not drive on one line, `to_contact = 1` counts the true time to
the contact instead.
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.conformance.encounter import Encounter
from cwcli.conformance.verdict import DrivenTrial, Verdict, WarningWindow, judge_by_window

NUMBERS_THAT_JUDGE_NEEDS = ("shortest_ttc", "longest_ttc", "to_contact")
"""Names of the numbers that it asks for."""


def warning_window(encounter: Encounter, demands: dict[str, float]) -> WarningWindow:
    """The window between the two times to collision."""
    shortest_s, longest_s = demands["shortest_ttc"], demands.get("longest_ttc", math.inf)
    if demands.get("to_contact"):
        return WarningWindow(encounter.contact_s - longest_s, encounter.contact_s - shortest_s)
    near = np.flatnonzero((encounter.ttc_s <= longest_s) & (encounter.time_s >= encounter.event_s))
    earliest_s = float(encounter.time_s[near[0]]) if math.isfinite(longest_s) and len(near) else -math.inf
    return WarningWindow(earliest_s, encounter.last_time_above_s(encounter.ttc_s, shortest_s))


def judge(driven: DrivenTrial) -> Verdict:
    """Judge one repetition."""
    driven.demanded_number_si("shortest_ttc")
    assert isinstance(driven.encounter, Encounter)
    return judge_by_window(driven, warning_window(driven.encounter, dict(driven.demands)))
