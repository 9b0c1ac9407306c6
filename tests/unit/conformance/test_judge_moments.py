"""The moments at which the verdict of each judge turns: closed forms of the trials' numbers, not the judges' own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cwcli.conformance.clause import Clause, Trial, load_clause, require_judge_module
from cwcli.conformance.encounter import Encounter
from cwcli.conformance.lane_trials import DRIFT_START_S, simulate_lane_trial
from cwcli.conformance.online import build_trial_scenario, true_encounter
from cwcli.conformance.scenes import APPROACH_START_TTC_S, SCENES
from cwcli.conformance.verdict import DrivenTrial, JudgedMotion, RaisedWarning, Verdict

TRUTH_STEP_S = 0.01
"""Step of the true motion, s: the moments are as good as that."""


def encounter_of(trial: Trial, clause: Clause) -> Encounter:
    build = SCENES[trial.scene].build
    assert build is not None
    scene = build(trial.given)
    return true_encounter(build_trial_scenario(scene, clause.grade, name="trial"), scene)


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


@pytest.mark.parametrize("name", ["nhtsa-fcw", "iso-15623", "un-r131", "un-r152", "etsi-101-539"])
def test_an_approach_at_constant_speeds_has_the_published_moments(name: str) -> None:
    clause = load_clause(name)
    trials = [trial for trial in clause.trials if trial.scene == "approach"]
    assert trials
    for trial in trials:
        start_s = trial.given.get("approach_time", APPROACH_START_TTC_S)
        closing_mps = trial.given["host_speed"] - trial.given.get("other_speed", 0.0)
        longest_s, shortest_s = needed_ttc_s(trial, closing_mps)
        assert_turns_at(trial, encounter_of(trial, clause), start_s - longest_s, start_s - shortest_s)


def test_the_braking_lead_of_nhtsa_has_the_published_moment() -> None:
    clause = load_clause("nhtsa-fcw")
    (trial,) = (each for each in clause.trials if each.scene == "braking-lead")
    decel, ramp_s, gap_m = (trial.given[name] for name in ("deceleration", "ramp_time", "gap"))
    # the way lost by a ramp of r and then a constant a is a (t - r/2)^2 / 2 + a r^2 / 24
    encounter = encounter_of(trial, clause)
    contact_s = encounter.event_s + ramp_s / 2 + math.sqrt(2.0 * (gap_m - decel * ramp_s**2 / 24) / decel)
    assert_turns_at(trial, encounter, -math.inf, contact_s - trial.demands["ttc_with_accelerations"])


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


@pytest.mark.parametrize("name", ["fmvss-127", "j2945-1"])
def test_full_braking_after_the_latest_warning_takes_the_distance_that_is_left(name: str) -> None:
    """v^2 / (2 b) is the least way to a stand; pressure that builds up takes at most as much as half a second more."""
    clause = load_clause(name)
    trial = next(each for each in clause.trials if each.scene == "approach" and not each.given.get("other_speed"))
    encounter = encounter_of(trial, clause)
    speed_mps = trial.given["host_speed"]
    least_s = speed_mps / (2.0 * 9.81)  # with 1 g
    contact_s = trial.given.get("approach_time", APPROACH_START_TTC_S)
    assert not verdict_at(trial, encounter, contact_s - least_s).is_pass
    assert verdict_at(trial, encounter, contact_s - speed_mps / (2.0 * 7.0) - 0.5).is_pass
