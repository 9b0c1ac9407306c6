"""Systems that warn always, never, ideally and 0.1 s too late fail the clauses that they must, by the right margins."""

from __future__ import annotations

import math

import pytest

from cwcli.conformance.clause import Clause, Trial, clause_names, load_clause, require_judge_module
from cwcli.conformance.lane_trials import simulate_lane_trial
from cwcli.conformance.online import build_trial_scenario, true_encounter
from cwcli.conformance.results import FAILED
from cwcli.conformance.run import ConformConfig, judge_driven_trial, run_trial
from cwcli.conformance.scenes import SCENES
from cwcli.conformance.verdict import DrivenTrial, JudgedMotion, RaisedWarning, Verdict, WarningWindow

CONFIG = ConformConfig(jobs=1, policy="none")
LATE_S = 0.1
BOUNDS_AGAINST_EARLY_WARNINGS = {"longest_ttc", "earliest_slow"}
"""Demands that a warning at once does not meet."""


def motion_of(trial: Trial, clause: Clause) -> JudgedMotion:
    """The true motion of a trial."""
    build = SCENES[trial.scene].build
    if build is None:
        return simulate_lane_trial(trial.given, 0).drift
    scene = build(trial.given)
    return true_encounter(build_trial_scenario(scene, clause.grade, name="trial"), scene)


def window_of(trial: Trial, motion: JudgedMotion) -> WarningWindow | None:
    """The window of the trial's judge; None where no warning may come."""
    judge = require_judge_module(trial.judge, "test")
    return judge.warning_window(motion, dict(trial.demands)) if hasattr(judge, "warning_window") else None


def judged(trial: Trial, motion: JudgedMotion, warned_s: float) -> Verdict:
    """The verdict on a system that warns of the principal other at a moment (NaN: never)."""
    warnings = () if math.isnan(warned_s) else (RaisedWarning(warned_s, motion.other_id),)
    return judge_driven_trial(trial, DrivenTrial(motion, warnings, trial.demands, "none"), "test")


def check_systems(trial: Trial, clause: Clause) -> None:
    """Judge systems that warn at once, never, ideally, and 0.1 s later than with some slack."""
    motion = motion_of(trial, clause)
    window = window_of(trial, motion)
    at_once, never = judged(trial, motion, 0.0), judged(trial, motion, math.nan)
    if window is None:
        assert never.is_pass, trial.name
        assert not at_once.is_pass, trial.name
        return
    assert not never.is_pass, trial.name
    assert at_once.is_pass is not (motion.event_s > 0.0 or bool(BOUNDS_AGAINST_EARLY_WARNINGS & set(trial.demands)))
    earliest_s = max(window.earliest_s, motion.event_s)
    assert judged(trial, motion, 0.5 * (earliest_s + window.latest_s)).is_pass, trial.name
    for slack_s in (0.0, 0.05, 0.15):
        found = judged(trial, motion, window.latest_s - slack_s + LATE_S)
        assert found.is_pass is (slack_s >= LATE_S), trial.name
        assert found.margin == pytest.approx(slack_s - LATE_S, abs=1e-9), trial.name


def split_slow(clause: Clause) -> tuple[list[Trial], list[Trial]]:
    """The trials of a clause that are quickly judged, and those that take a second each."""
    slow = [trial for trial in clause.trials if trial.judge == "avoided" or trial.scene == "lane-drift"]
    return [trial for trial in clause.trials if trial not in slow], slow


@pytest.mark.parametrize("name", clause_names())
def test_systems_fail_what_they_must_and_pass_all_else(name: str) -> None:
    clause = load_clause(name)
    quick, slow = split_slow(clause)
    for trial in [*quick, *slow[:1]]:
        check_systems(trial, clause)


@pytest.mark.long
@pytest.mark.parametrize("name", clause_names())
def test_every_trial_of_every_grid_can_be_passed_and_failed(name: str) -> None:
    clause = load_clause(name)
    for trial in split_slow(clause)[1]:
        check_systems(trial, clause)


def test_a_system_that_always_warns_fails_the_decelerating_lead() -> None:
    clause = load_clause("nhtsa-fcw")
    passes = {trial.name: judged(trial, motion_of(trial, clause), 0.0).is_pass for trial in clause.trials}
    # the clause has no bound against early warnings, but none of a lead that does not brake yet
    assert passes == {"lead vehicle stopped": True, "lead vehicle decelerating": False, "lead vehicle slower": True}


def test_a_warning_of_another_vehicle_is_none_of_the_lead() -> None:
    clause = load_clause("nhtsa-fcw")
    warn = lambda simulated: (RaisedWarning(3.0, "deadbeef"),)  # noqa: E731
    assert run_trial(clause.name, 0, (0,), CONFIG, warn)[0].outcome == FAILED
