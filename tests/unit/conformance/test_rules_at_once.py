"""Several rules are judged on one run of the pipeline, and each gets what it would get alone."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from cwcli.conformance import run
from cwcli.conformance.clause import load_clause
from cwcli.conformance.encounter import Encounter
from cwcli.conformance.judges import avoided
from cwcli.conformance.online import build_trial_scenario, true_encounter, warn_with_pipeline
from cwcli.conformance.policies import impact_speeds_with_policy_mps
from cwcli.conformance.results import FAILED, PASSED
from cwcli.conformance.run import ConformConfig, run_trial, run_trial_with_rules
from cwcli.conformance.scenes import build_approach
from cwcli.conformance.verdict import RaisedWarning
from cwcli.signals.columns import FloatArray
from cwcli.simulation.drive import SimulatedDrive

RULES = ("cwcli", "song2016", "ttc", "path-ttc")


def trial_index(clause_name: str, name: str) -> int:
    return next(k for k, trial in enumerate(load_clause(clause_name).trials) if trial.name == name)


def test_rules_together_get_what_each_gets_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def counted(
        drive: SimulatedDrive, rules: Sequence[str], horizon_s: float | None
    ) -> dict[str, tuple[RaisedWarning, ...]]:
        calls.append(tuple(rules))
        return warn_with_pipeline(drive, rules, horizon_s)

    monkeypatch.setattr(run, "warn_with_pipeline", counted)
    together = run_trial_with_rules("nhtsa-fcw", 2, (0,), ConformConfig(), RULES)
    assert calls == [RULES]
    assert len({repr(each) for each in together.values()}) > 1
    for rule in RULES:
        assert repr(together[rule]) == repr(run_trial("nhtsa-fcw", 2, (0,), ConformConfig(rule=rule)))


def test_a_trial_with_a_rule_of_its_own_is_the_same_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def counted(
        drive: SimulatedDrive, rules: Sequence[str], horizon_s: float | None
    ) -> dict[str, tuple[RaisedWarning, ...]]:
        calls.append(tuple(rules))
        return dict.fromkeys(rules, ())

    monkeypatch.setattr(run, "warn_with_pipeline", counted)
    found = run_trial_with_rules(
        "j2945-1", trial_index("j2945-1", "EEBL, hard braking ahead"), (0,), ConformConfig(), RULES
    )
    assert calls == [("eebl",)]
    assert set(found) == set(RULES)


def test_a_radar_without_height_warns_of_a_plate_as_of_a_car() -> None:
    """Both are the same returns, so a rule that passes one of the two trials fails the other."""
    trials = ("steel trench plate, seen by radar", "stopped car, seen by radar alone")
    plate, car = (run_trial("fmvss-127", trial_index("fmvss-127", name), (0,), ConformConfig())[0] for name in trials)
    assert (plate.outcome, car.outcome) == (FAILED, PASSED)
    assert plate.verdict is not None
    assert car.verdict is not None
    assert plate.verdict.values["warned_s"] == pytest.approx(car.verdict.values["warned_s"], abs=0.11)


def test_the_latest_warning_is_sought_once_for_all_repetitions(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def counted(encounter: Encounter, policy: str, braking_from_s: FloatArray) -> FloatArray:
        calls.append(policy)
        return impact_speeds_with_policy_mps(encounter, policy, braking_from_s)

    monkeypatch.setattr(avoided, "impact_speeds_with_policy_mps", counted)
    built = build_approach({"host_speed": 15.0})
    encounter = true_encounter(build_trial_scenario(built, "nominal", name="trial"), built)
    first = avoided.warning_window(encounter, {"impact_speed": 0.0}, "full")
    n_calls = len(calls)
    assert avoided.warning_window(encounter, {"impact_speed": 0.0}, "full") == first
    assert len(calls) == n_calls
    assert avoided.warning_window(encounter, {"impact_speed": 5.0}, "full").latest_s > first.latest_s
    assert avoided.warning_window(encounter, {"impact_speed": 0.0}, "driver").latest_s < first.latest_s - 1.0
    assert len(calls) > n_calls
