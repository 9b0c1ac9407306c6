"""The moments at which the verdict of each judge turns: closed forms of the trials' numbers, not the judges' own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cwcli.conformance.clause import Trial, clause_names, load_clause, require_judge_module
from cwcli.conformance.lane_trials import DRIFT_START_S, simulate_lane_trial
from cwcli.conformance.run import ConformConfig, run_trial
from cwcli.conformance.scenes import LANE_WIDTH_M
from cwcli.conformance.verdict import DrivenTrial, JudgedMotion, RaisedWarning, Verdict

TRUTH_STEP_S = 0.01
"""Step of the true motion, s: the moments are as good as that."""
LEAD_BRAKES_S = 5.0
"""When the lead begins to brake in a trial, s, as `cwcli.conformance.scenes` drives it."""
APPROACH_S = 12.0
"""How long an approach takes that names no time, s, as `cwcli.conformance.scenes` drives it."""
SURE_BRAKING_MPS2 = 7.0
"""Braking that the car surely reaches, m/s^2. Chosen by hand, below what friction allows on a dry road."""
SURE_BUILD_UP_S = 0.5
"""Time in which the pressure of the brakes surely builds up, s. Chosen by hand."""
IMPOSSIBLE_BRAKING_MPS2 = 12.0
"""Braking that no road car reaches, m/s^2. Chosen by hand, above what friction allows on a dry road."""
LEAD_RAMP_S = 0.5
"""Time in which the lead's braking builds up where a trial names none, s, as `cwcli.conformance.scenes` drives it."""
JUDGES_WITH_BOUNDS = (
    *("no-warning", "lane-line", "avoided", "time-to-collision", "warned-by", "must-and-must-not", "before-braking"),
)
"""Judges whose moments follow here from a trial's numbers; one of a further clause is held to a test of its own."""


def verdict_at(trial: Trial, motion: JudgedMotion, warned_s: float) -> Verdict:
    judge = require_judge_module(trial.judge, "test").judge
    found = judge(DrivenTrial(motion, (RaisedWarning(warned_s, motion.other_id),), trial.demands, "none"))
    assert isinstance(found, Verdict)
    return found


def assert_turns_at(trial: Trial, motion: JudgedMotion, earliest_s: float, latest_s: float) -> None:
    """A warning just inside passes, one just outside fails, and one 0.1 s too late or too early by that margin."""
    step_s = 1.5 * TRUTH_STEP_S
    assert verdict_at(trial, motion, latest_s - step_s).is_pass, trial.name
    assert not verdict_at(trial, motion, latest_s + step_s).is_pass, trial.name
    assert verdict_at(trial, motion, latest_s + 0.1).margin == pytest.approx(-0.1, abs=step_s), trial.name
    assert verdict_at(trial, motion, latest_s - 0.2).margin == pytest.approx(0.2, abs=step_s), trial.name
    if math.isfinite(earliest_s):
        assert verdict_at(trial, motion, earliest_s + step_s).is_pass, trial.name
        assert not verdict_at(trial, motion, earliest_s - step_s).is_pass, trial.name
        assert verdict_at(trial, motion, earliest_s - 0.1).margin == pytest.approx(-0.1, abs=step_s), trial.name


def needed_ttc_s(trial: Trial, closing_mps: float) -> tuple[float, float]:
    """Longest and shortest time to collision of a warning at a constant closing speed v, s, from the clause's text."""
    demands = trial.demands
    if trial.judge == "time-to-collision":
        return math.inf, demands["ttc"]
    if trial.judge == "warned-by":
        return demands.get("longest_ttc", math.inf), demands["shortest_ttc"]
    if trial.judge == "must-and-must-not":
        # a = v^2 / (2 (d - tau v)) is the limit at d = tau v + v^2 / (2 a)
        return demands["longest_ttc"], demands["reaction_time"] + closing_mps / (2.0 * demands["required_deceleration"])
    # braking from v to v_i takes (v^2 - v_i^2) / (2 a) of the gap, and begins the lead time after the warning
    assert trial.judge == "before-braking"
    braking_m = (closing_mps**2 - demands["impact_speed"] ** 2) / (2.0 * demands["deceleration"])
    return math.inf, demands["lead_time"] + braking_m / closing_mps


def sure_braking_s(trial: Trial) -> float:
    """Time before the contact at which braking surely avoids it, s."""
    speed_mps = trial.given["host_speed"]
    # who crosses must stop before the other's lane, and so may have to before the other is there
    entered_s = LANE_WIDTH_M / speed_mps if trial.scene in ("turn-across", "crossing") else 0.0
    return speed_mps / (2.0 * SURE_BRAKING_MPS2) + SURE_BUILD_UP_S + entered_s


def closed_form_window_s(trial: Trial, contact_s: float) -> tuple[float, float]:
    """Earliest and latest warning, s of the trial, from its numbers; of a contact that braking avoids, a sure one."""
    given, demands = trial.given, trial.demands
    if trial.scene == "approach":
        contact_s = given.get("approach_time", APPROACH_S)
    if trial.scene == "braking-lead":
        decel, ramp_s = given["deceleration"], given.get("ramp_time", LEAD_RAMP_S)
        # the way lost by a ramp of r and then a constant a is a s^2 / 2 + a r^2 / 24, s = t - r / 2
        left_m, begin_s = given["gap"] - decel * ramp_s**2 / 24, LEAD_BRAKES_S + ramp_s / 2
        if "ttc_with_accelerations" in demands:
            return -math.inf, begin_s + math.sqrt(2.0 * left_m / decel) - demands["ttc_with_accelerations"]
        if trial.judge == "must-and-must-not":
            # with k, the limit less the lead's a: k = (a s)^2 / (2 (d - tau a s)); before that d = T a s
            spare, tau = demands["required_deceleration"] - decel, demands["reaction_time"]
            late = np.roots([decel**2 + spare * decel, 2.0 * spare * tau * decel, -2.0 * spare * left_m])
            early = np.roots([decel / 2.0, demands["longest_ttc"] * decel, -left_m])
            return begin_s + float(early.max()), begin_s + float(late.max())
    closing_mps = given["host_speed"] - (given.get("other_speed", 0.0) if trial.scene == "approach" else 0.0)
    if trial.judge == "avoided":
        return -math.inf, contact_s - sure_braking_s(trial)
    longest_s, shortest_s = needed_ttc_s(trial, closing_mps)
    return contact_s - longest_s, contact_s - shortest_s


def run_ideal_rule(name: str, k: int, moment: str, late_s: float) -> Verdict:
    """The verdict on a rule that is told the truth and warns `late_s` after a moment of the closed form."""
    trial = load_clause(name).trials[k]

    def warn(motion: JudgedMotion) -> tuple[RaisedWarning, ...]:
        if trial.judge == "no-warning":
            return () if moment == "latest" else (RaisedWarning(motion.event_s + late_s),)
        if trial.judge == "lane-line":
            return (RaisedWarning(motion.contact_s + late_s, motion.other_id),)
        earliest_s, latest_s = closed_form_window_s(trial, motion.contact_s)
        return (RaisedWarning((latest_s if moment == "latest" else earliest_s) + late_s, motion.other_id),)

    verdict = run_trial(name, k, (0,), ConformConfig(jobs=1, policy="none"), warn)[0].verdict
    assert verdict is not None
    return verdict


def check_ideal_rule(name: str, k: int) -> None:
    """An ideal rule passes just inside each end of the closed form's window, and fails 0.1 s outside by that much."""
    trial, step_s = load_clause(name).trials[k], 1.5 * TRUTH_STEP_S
    where = f"{name}, {trial.name}"
    if trial.judge == "no-warning":
        assert run_ideal_rule(name, k, "latest", 0.0).is_pass, where
        assert not run_ideal_rule(name, k, "earliest", 0.1).is_pass, where
        return
    if trial.judge == "lane-line":  # the rate on the line holds within 0.1 m/s until the latest line
        rate, outside_m = abs(trial.given["drift_rate"]), trial.demands["latest_outside"]
        found = run_ideal_rule(name, k, "latest", 0.0)
        assert found.is_pass, where
        assert found.values["latest_s"] - found.values["warned_s"] >= outside_m / (rate + 0.1) - step_s, where
        slow_mps = max(rate - 0.1, 0.5 * rate)
        assert found.values["latest_s"] - found.values["warned_s"] <= outside_m / slow_mps + step_s, where
        assert not run_ideal_rule(name, k, "latest", outside_m / slow_mps + 0.1).is_pass, where
        return
    assert run_ideal_rule(name, k, "latest", -step_s).is_pass, where
    if trial.judge == "avoided":  # a brake's pressure builds up without a closed form; no car brakes with 12 m/s^2
        least_s = (trial.given["host_speed"] - along_mps(trial)) / (2.0 * IMPOSSIBLE_BRAKING_MPS2)
        assert not run_ideal_rule(name, k, "latest", sure_braking_s(trial) - least_s).is_pass, where
        return
    assert run_ideal_rule(name, k, "latest", 0.1).margin == pytest.approx(-0.1, abs=step_s), where
    if math.isfinite(closed_form_window_s(trial, 0.0)[0]):
        assert run_ideal_rule(name, k, "earliest", step_s).is_pass, where
        assert run_ideal_rule(name, k, "earliest", -0.1).margin == pytest.approx(-0.1, abs=step_s), where


def along_mps(trial: Trial) -> float:
    """Speed of the other along the host's way, m/s, at most."""
    if trial.scene in ("approach", "cut-in"):
        return trial.given.get("other_speed", 0.0)
    return trial.given["host_speed"] if trial.scene in ("braking-lead", "convoy") else 0.0


def is_slow(trial: Trial) -> bool:
    """Whether a verdict takes about a second: a search with a braking car, or many drives of a drift."""
    return trial.judge == "avoided" or trial.scene == "lane-drift"


@pytest.mark.parametrize("name", clause_names())
def test_an_ideal_rule_is_judged_by_the_closed_forms(name: str) -> None:
    trials = load_clause(name).trials
    bounded = [k for k, trial in enumerate(trials) if trial.judge in JUDGES_WITH_BOUNDS]
    slow = [k for k in bounded if is_slow(trials[k])]
    for k in bounded:
        if k not in slow[1:]:
            check_ideal_rule(name, k)


def test_the_catalogue_has_all_judges_with_bounds() -> None:
    judges = {trial.judge for name in clause_names() for trial in load_clause(name).trials}
    assert judges >= {*JUDGES_WITH_BOUNDS}


@pytest.mark.long
@pytest.mark.parametrize("name", [name for name in clause_names() if any(map(is_slow, load_clause(name).trials))])
def test_an_ideal_rule_is_judged_by_the_closed_forms_in_every_slow_trial(name: str) -> None:
    for k, trial in enumerate(load_clause(name).trials):
        if is_slow(trial):
            check_ideal_rule(name, k)


@pytest.mark.parametrize("name", ["iso-17361", "un-r130"])
def test_a_drift_is_warned_of_between_the_published_lines(name: str) -> None:
    clause = load_clause(name)
    trial = next(each for each in clause.trials if each.judge == "lane-line")
    drift = simulate_lane_trial(trial.given, 0).drift
    outside_m = trial.demands["latest_outside"]
    time_s = drift.time_s[drift.time_s > DRIFT_START_S]
    gap_m, rate_mps = (np.interp(time_s, drift.time_s, each) for each in (drift.tyre_gap_m, drift.rate_mps))
    earliest_s = -math.inf
    if "earliest_time" in trial.demands:
        line_m = trial.demands["earliest_time"] * rate_mps
        line_m = np.clip(line_m, trial.demands["earliest_slow"], trial.demands["earliest_fast"])
        earliest_s = float(time_s[np.argmax(gap_m <= line_m)])
    latest_s = float(np.interp(outside_m, -gap_m, time_s))
    assert -np.gradient(gap_m, time_s)[5:-5] == pytest.approx(rate_mps[5:-5], abs=0.03)
    assert_turns_at(trial, drift, earliest_s, latest_s)
