"""The warning comes early enough that the braking policy keeps the impact below a published speed.

Demands: `impact_speed` (m/s), 0 for no contact. With `r157 = 1` the trial must be one that the regulation's own driver
(UN Regulation 157, 5.2.5.2; `control.driver_models`) avoids, else it is refused: nobody can be asked to avoid it.
The latest warning is found by driving the trial again with warnings every 20 ms. With the policy `none` that is the
latest one for full braking.
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.conformance.encounter import Encounter
from cwcli.conformance.policies import NO_BRAKING_POLICY, drive_with_policy, impact_speeds_with_policy_mps
from cwcli.conformance.verdict import DrivenTrial, Verdict, WarningWindow, judge_by_window
from cwcli.control.driver_models import R157_DRIVER, CasePoses, EgoCases, simulate_driver_cases
from cwcli.errors import UsageError
from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.signals.units import KMH_PER_MPS
from cwcli.signals.vehicle_state import HEADING, SPEED, X, Y

NUMBERS_THAT_JUDGE_NEEDS = ("impact_speed", "r157")
"""Names of the numbers that it asks for."""
VERDICT_DEPENDS_ON_BRAKING_POLICY = True
"""True says that its verdict depends on how the warned car brakes."""
WARNING_SEARCH_TIME_BEFORE_CONTACT_S = 8.0
"""Time before the contact from which on the latest warning is sought, s. Chosen by hand: no car needs longer."""
COARSE_LATEST_WARNING_SEARCH_STEP_S, FINE_LATEST_WARNING_SEARCH_STEP_S = 0.4, 0.02
"""Time steps of the search for the latest warning, s: a coarse one, and a fine one within it. Chosen by hand."""
REGULATION_DRIVER_TIME_STEP_S = 0.1
"""Time step of the regulation's driver, s; that of its criterion."""


def warning_window(encounter: Encounter, demands: dict[str, float], policy: str = "full") -> WarningWindow:
    """The window that ends with the latest warning after which the policy limits the impact."""
    known, key = encounter.latest_warning_s_by_demand, (policy, demands["impact_speed"])
    if key not in known:
        known[key] = _find_latest_warning_s(encounter, policy, demands["impact_speed"])
    return WarningWindow(-math.inf, known[key])


def _find_latest_warning_s(encounter: Encounter, policy: str, limit_mps: float) -> float:
    """Latest warning after which the policy limits the impact, s; NaN where none does."""
    begin_s, end_s = (
        max(encounter.event_s, encounter.contact_s - WARNING_SEARCH_TIME_BEFORE_CONTACT_S),
        encounter.contact_s,
    )
    latest_s = math.nan
    for step_s in (
        COARSE_LATEST_WARNING_SEARCH_STEP_S,
        FINE_LATEST_WARNING_SEARCH_STEP_S,
    ):  # a later warning never lessens the impact
        times_s = np.arange(begin_s, end_s, step_s)
        too_late = np.flatnonzero(impact_speeds_with_policy_mps(encounter, policy, times_s) > limit_mps + 1e-9)
        last = int(too_late[0]) - 1 if len(too_late) else len(times_s) - 1
        if last < 0:
            return math.nan
        latest_s = float(times_s[last])
        begin_s, end_s = latest_s, min(latest_s + step_s, encounter.contact_s)
    return latest_s


def r157_driver_avoids(encounter: Encounter) -> bool:
    """Whether the regulation's own driver avoids the contact."""
    n = int((encounter.time_s[-1] - encounter.time_s[0]) / REGULATION_DRIVER_TIME_STEP_S)
    rows = np.searchsorted(encounter.time_s, encounter.time_s[0] + REGULATION_DRIVER_TIME_STEP_S * np.arange(n) - 1e-9)
    start, heading = encounter.host[0], float(encounter.host[0, HEADING])
    sizes = encounter.host_size, encounter.other_size

    def other_at(step: int) -> tuple[CasePoses, BoolArray, tuple[float, float]]:
        state = encounter.other[rows[step]]
        x_m, y_m, heading_rad, speed = (np.array([state[k]]) for k in (X, Y, HEADING, SPEED))
        return CasePoses(x_m, y_m, heading_rad, speed, np.zeros(1)), np.ones(1, np.bool_), sizes[1]

    def pose_at(way: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        return start[X] + way * math.cos(heading), start[Y] + way * math.sin(heading), np.full(len(way), heading)

    ego = EgoCases(np.array([start[SPEED]]), pose_at, sizes[0])
    outcome = simulate_driver_cases(R157_DRIVER, ego, other_at, n_steps=n, step_s=REGULATION_DRIVER_TIME_STEP_S)
    return not bool(outcome.crashed[0])


def judge(driven: DrivenTrial) -> Verdict:
    """Judge one repetition."""
    limit_mps = driven.demanded_number_si("impact_speed")
    encounter = driven.encounter
    assert isinstance(encounter, Encounter)
    if math.isnan(encounter.contact_s):
        raise UsageError("the two would never touch, so there is nothing to avoid", hint="check the trial's numbers")
    if driven.demands.get("r157") and not r157_driver_avoids(encounter):
        raise UsageError("the driver of UN R157 does not avoid this cut-in either", hint="give it more time")
    policy = "full" if driven.policy == NO_BRAKING_POLICY else driven.policy
    verdict = judge_by_window(driven, warning_window(encounter, dict(driven.demands), policy))
    impact_mps = drive_with_policy(encounter, policy, driven.warned_s).impact_mps
    values = {**verdict.values, "impact_kmh": impact_mps * KMH_PER_MPS}
    text = verdict.text if impact_mps <= limit_mps else f"{verdict.text}, impact at {values['impact_kmh']:.1f} km/h"
    return Verdict(verdict.margin, verdict.unit, text, values, verdict.has_failed)
