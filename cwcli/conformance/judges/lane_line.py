"""The warning comes between the earliest and the latest warning line beside a lane boundary.

Demands: `latest_outside` (m outside the boundary), and for an earliest line `earliest_slow` (m inside, slowest
drifts), `earliest_time` (s, times the rate of departure) and `earliest_fast` (m inside, fastest drifts).
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.conformance.lane_trials import LaneDrift
from cwcli.conformance.verdict import DrivenTrial, Verdict, WarningWindow, judge_by_window
from cwcli.errors import UsageError

NUMBERS_THAT_JUDGE_NEEDS = ("latest_outside", "earliest_slow", "earliest_time", "earliest_fast")
"""Names of the numbers that it asks for."""


def warning_window(drift: LaneDrift, demands: dict[str, float]) -> WarningWindow:
    """The window between the two lines; a warning before the earliest line is too early."""
    latest_s = drift.first_time_within_s(-demands["latest_outside"])
    if "earliest_slow" not in demands:
        return WarningWindow(-math.inf, latest_s)
    slow, fast = demands["earliest_slow"], demands["earliest_fast"]
    line_m = np.clip(demands["earliest_time"] * drift.rate_mps, slow, fast)
    within = np.flatnonzero((drift.tyre_gap_m <= line_m) & (drift.time_s >= drift.event_s))
    return WarningWindow(float(drift.time_s[within[0]]) if len(within) else math.nan, latest_s)


def judge(driven: DrivenTrial) -> Verdict:
    """Judge one repetition."""
    driven.demanded_number_si("latest_outside")
    if not isinstance(driven.encounter, LaneDrift):
        raise UsageError("a lane line is judged on a drift in a lane", hint='take the scene "lane-drift"')
    return judge_by_window(driven, warning_window(driven.encounter, dict(driven.demands)))
