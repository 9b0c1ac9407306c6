"""Systems that warn always, never, ideally and 0.1 s too late fail the clauses that they must, by the right margins."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from cwcli.conformance.clause import Clause, Trial, clause_names, load_clause, require_judge_module
from cwcli.conformance.online import SimulatedTrial
from cwcli.conformance.results import FAILED, PASSED, Repetition
from cwcli.conformance.run import ConformConfig, run_trial
from cwcli.conformance.verdict import RaisedWarning

CONFIG = ConformConfig(jobs=1, policy="none")
LATE_S = 0.1


def window_of(trial: Trial, simulated: SimulatedTrial) -> tuple[float, float] | None:
    """The window of the trial's judge; None where no warning may come."""
    judge = require_judge_module(trial.judge, "test")
    if not hasattr(judge, "warning_window"):
        return None
    window = judge.warning_window(simulated.encounter, dict(trial.demands))
    return window.earliest_s, window.latest_s


def judged(clause: Clause, k: int, when: Callable[[SimulatedTrial, Trial], float]) -> Repetition:
    """The verdict on a system that warns of the principal other at a moment (NaN: never)."""
    trial = clause.trials[k]

    def warn(simulated: SimulatedTrial) -> tuple[RaisedWarning, ...]:
        at_s = when(simulated, trial)
        return () if math.isnan(at_s) else (RaisedWarning(at_s, simulated.encounter.other_id),)

    return run_trial(clause.name, k, (0,), CONFIG, warn)[0]


def always(simulated: SimulatedTrial, trial: Trial) -> float:
    return 0.0


def never(simulated: SimulatedTrial, trial: Trial) -> float:
    return math.nan


def ideal(simulated: SimulatedTrial, trial: Trial) -> float:
    window = window_of(trial, simulated)
    if window is None:
        return math.nan
    earliest_s = max(window[0], simulated.encounter.event_s)
    return 0.5 * (earliest_s + window[1])


def just_too_late(simulated: SimulatedTrial, trial: Trial) -> float:
    window = window_of(trial, simulated)
    return math.nan if window is None else window[1] + LATE_S


def must_warn(clause: Clause, k: int) -> bool:
    return hasattr(require_judge_module(clause.trials[k].judge, "test"), "warning_window")


def sample(clause: Clause) -> list[tuple[int, Trial]]:
    """The trials of a clause, few of the kinds that take a second each; the long test has all."""
    slow = [k for k, trial in enumerate(clause.trials) if trial.judge == "avoided" or trial.scene == "lane-drift"]
    kept = slow[:1] if clause.name in ("un-r157-cut-in", "un-r130") else []
    return [(k, trial) for k, trial in enumerate(clause.trials) if k not in slow or k in kept]


@pytest.mark.parametrize("name", clause_names())
def test_an_ideal_system_passes_every_trial(name: str) -> None:
    clause = load_clause(name)
    for k, trial in sample(clause):
        assert judged(clause, k, ideal).outcome == PASSED, trial.name


@pytest.mark.parametrize("name", clause_names())
def test_a_system_that_never_warns_fails_what_must_be_warned_of(name: str) -> None:
    clause = load_clause(name)
    for k, trial in sample(clause):
        assert judged(clause, k, never).outcome == (FAILED if must_warn(clause, k) else PASSED), trial.name


@pytest.mark.parametrize("name", clause_names())
def test_a_system_that_is_too_late_fails_by_just_that(name: str) -> None:
    clause = load_clause(name)
    for k, trial in sample(clause):
        if must_warn(clause, k):
            found = judged(clause, k, just_too_late)
            assert found.outcome == FAILED, trial.name
            assert found.verdict is not None
            assert found.verdict.margin == pytest.approx(-LATE_S, abs=1e-9), trial.name


@pytest.mark.long
@pytest.mark.parametrize("name", clause_names())
def test_every_trial_of_every_grid_can_be_passed_and_failed(name: str) -> None:
    clause = load_clause(name)
    for k, trial in enumerate(clause.trials):
        assert judged(clause, k, ideal).outcome == PASSED, trial.name
        if must_warn(clause, k):
            assert judged(clause, k, just_too_late).outcome == FAILED, trial.name


def test_a_system_that_always_warns_fails_every_clause_with_a_false_warning_in_it() -> None:
    for name in clause_names():
        clause = load_clause(name)
        for k, trial in enumerate(clause.trials):
            if not must_warn(clause, k) and clause.trials[k].scene != "lane-drift":
                assert judged(clause, k, always).outcome == FAILED, trial.name


def test_a_system_that_always_warns_fails_the_decelerating_lead() -> None:
    clause = load_clause("nhtsa-fcw")
    outcomes = {trial.name: judged(clause, k, always).outcome for k, trial in enumerate(clause.trials)}
    # the clause has no bound against early warnings, but none of a lead that does not brake yet
    assert outcomes == {
        "lead vehicle stopped": PASSED,
        "lead vehicle decelerating": FAILED,
        "lead vehicle slower": PASSED,
    }


def test_a_warning_of_another_vehicle_is_none_of_the_lead() -> None:
    clause = load_clause("nhtsa-fcw")
    warn = lambda simulated: (RaisedWarning(3.0, "deadbeef"),)  # noqa: E731
    assert run_trial(clause.name, 0, (0,), CONFIG, warn)[0].outcome == FAILED


def test_a_warning_at_the_published_number_passes_and_a_millisecond_later_fails() -> None:
    clause = load_clause("nhtsa-fcw")
    for shift_s, expected in ((0.0, PASSED), (0.001, FAILED)):
        # stopped lead: 7 s from contact at the start, so 2.1 s is at 4.9 s

        def moment_s(simulated: SimulatedTrial, trial: Trial, shift_s: float = shift_s) -> float:
            return 7.0 - 2.1 + shift_s

        found = judged(clause, 0, moment_s)
        assert found.outcome == expected
