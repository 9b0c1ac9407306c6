"""Recorded trials: found in a log, refused out of tolerance with the number, and judged like simulated ones."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from cwcli.cli.main import run_command_line
from cwcli.conformance.clause import load_clause
from cwcli.conformance.digest import format_digest
from cwcli.conformance.online import build_trial_scenario
from cwcli.conformance.recorded import LogTrial, judge_log, judge_log_by_clauses
from cwcli.conformance.results import FAILED, NOT_VALID, PASSED, ClauseResult
from cwcli.conformance.run import ConformConfig, run_trial
from cwcli.conformance.scenes import SCENES, BuiltScene
from cwcli.errors import DataError, MissingSignalError, UsageError
from cwcli.simulate.sensor_log import write_simulated_log
from cwcli.simulation.drive import simulate_scenario

CLAUSE = "nhtsa-fcw"
CONFIG = ConformConfig(jobs=1)
MPH = 0.44704


def write_trial(path: Path, number: int, change: Mapping[str, Any] | None = None, seed: int = 0) -> LogTrial:
    """Write a trial of the clause as a log, with changed vehicles."""
    trial = load_clause(CLAUSE).trials[number]
    build = SCENES[trial.scene].build
    assert build is not None
    built = build(trial.given)
    document = deepcopy(dict(built.document))
    for name, table in (change or {}).items():
        document["vehicles"][name] = {**document["vehicles"].get(name, {}), **table}
    scenario = build_trial_scenario(BuiltScene(document, built.event_s), "fine", name="trial")
    write_simulated_log(simulate_scenario(scenario, seed), path)
    return LogTrial(str(path))


def add_flag(path: Path, raised_s: float, until_s: float) -> Path:
    """Write a copy of a log with the flag of another system, 20 times a second."""
    target = path.with_name("flagged.mcap")
    with path.open("rb") as source, target.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels: dict[str, int] = {}
        first_ns, rows = None, []
        for schema, channel, message in make_reader(source).iter_messages():
            assert schema is not None
            first_ns = message.log_time if first_ns is None else first_ns
            if channel.topic not in channels:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
            rows.append((message.log_time, channels[channel.topic], message.data))
        assert first_ns is not None
        flag = writer.register_channel(
            "/adas/fcw", "json", writer.register_schema("Flag", "jsonschema", b'{"type": "object"}')
        )
        for k in range(int(until_s * 20)):
            data = json.dumps({"data": raised_s <= k / 20 < raised_s + 1.0}).encode()
            rows.append((first_ns + k * 50_000_000, flag, data))
        for log_time, channel_id, data in sorted(rows, key=lambda row: row[0]):
            writer.add_message(channel_id, log_time, data, log_time)
        writer.finish()
    return target


def outcomes(result: ClauseResult) -> dict[str, str]:
    return {trial.trial.name: trial.outcome for trial in result.trials_with_repetitions}


def breaches(result: ClauseResult) -> tuple[str, ...]:
    return result.trials_with_repetitions[0].repetitions[0].breaches


@pytest.mark.parametrize(("number", "name"), [(0, "lead vehicle stopped"), (2, "lead vehicle slower")])
def test_a_trial_is_found_and_judged_as_it_was_simulated(tmp_path: Path, number: int, name: str) -> None:
    result = judge_log(CLAUSE, write_trial(tmp_path / "a.mcap", number), CONFIG)
    assert outcomes(result) == {name: PASSED}, breaches(result)
    simulated = run_trial(CLAUSE, number, (0,), ConformConfig(jobs=1, grade="fine"))[0].verdict
    recorded = result.trials_with_repetitions[0].repetitions[0].verdict
    assert simulated is not None
    assert recorded is not None
    # the same warning, judged on the truth and on states in hindsight
    assert recorded.margin == pytest.approx(simulated.margin, abs=0.03)


def test_a_braking_lead_is_found_with_its_gap_and_its_onset(tmp_path: Path) -> None:
    result = judge_log(CLAUSE, write_trial(tmp_path / "a.mcap", 1), CONFIG)
    assert list(outcomes(result)) == ["lead vehicle decelerating"]
    assert not breaches(result)


def test_a_subject_that_is_too_slow_makes_the_trial_not_valid(tmp_path: Path) -> None:
    result = judge_log(CLAUSE, write_trial(tmp_path / "a.mcap", 0, {"host": {"speed_mps": 43.0 * MPH}}), CONFIG)
    assert outcomes(result) == {"lead vehicle stopped": NOT_VALID}
    assert result.outcome == NOT_VALID
    (breach,) = breaches(result)
    assert breach.startswith("subject speed 19.2")
    assert breach.endswith("permitted 20.12 +- 0.45 m/s")


def test_a_lead_off_the_lane_s_middle_makes_the_trial_not_valid(tmp_path: Path) -> None:
    result = judge_log(CLAUSE, write_trial(tmp_path / "a.mcap", 0, {"other": {"y_m": 0.9}}), CONFIG)
    assert outcomes(result) == {"lead vehicle stopped": NOT_VALID}
    assert any(breach.startswith("lateral offset 0.9") for breach in breaches(result))


def test_a_subject_that_brakes_before_the_warning_makes_the_trial_not_valid(tmp_path: Path) -> None:
    braking = [{"from_s": 0, "accel_mps2": 0}, {"from_s": 8.0, "accel_mps2": -2.0, "jerk_mps3": 10.0}]
    result = judge_log(CLAUSE, write_trial(tmp_path / "a.mcap", 0, {"host": {"longitudinal": braking}}), CONFIG)
    assert outcomes(result) == {"lead vehicle stopped": NOT_VALID}
    assert any(breach.startswith("subject onset -2.") for breach in breaches(result))


def test_a_lead_that_brakes_too_weakly_makes_the_trial_not_valid(tmp_path: Path) -> None:
    weak = [{"from_s": 0, "accel_mps2": 0}, {"from_s": 5.0, "speed_mps": 0.5, "limit_mps2": 2.5, "jerk_mps3": 50.0}]
    result = judge_log(CLAUSE, write_trial(tmp_path / "a.mcap", 1, {"other": {"longitudinal": weak}}), CONFIG)
    assert outcomes(result) == {"lead vehicle decelerating": NOT_VALID}
    assert any("permitted 2.94 +- 0.29" in breach for breach in breaches(result))


@pytest.mark.parametrize(
    ("number", "change", "words"),
    [
        (2, {"speed_mps": 20.0 * MPH + 0.8}, r"other speed 9\.7\d m/s .*; permitted 8\.94 \+- 0\.45 m/s"),
        (1, {"x_m": 37.5}, r"gap 33\.0\d m .*; permitted 30\.00 \+- 2\.40 m"),
    ],
    ids=["other-speed", "gap"],
)
def test_a_lead_at_another_speed_or_gap_makes_the_trial_not_valid(
    tmp_path: Path, number: int, change: dict[str, Any], words: str
) -> None:
    result = judge_log(CLAUSE, write_trial(tmp_path / "a.mcap", number, {"other": change}), CONFIG)
    assert [trial.outcome for trial in result.trials_with_repetitions] == [NOT_VALID]
    assert re.match(words, breaches(result)[0]), breaches(result)


def test_a_driver_who_reacts_to_the_warning_does_not_spoil_the_trial(tmp_path: Path) -> None:
    braking = [{"from_s": 0, "accel_mps2": 0}, {"from_s": 10.2, "accel_mps2": -7.0, "jerk_mps3": 30.0}]
    result = judge_log(CLAUSE, write_trial(tmp_path / "a.mcap", 0, {"host": {"longitudinal": braking}}), CONFIG)
    assert outcomes(result) == {"lead vehicle stopped": PASSED}, breaches(result)


def test_a_drive_that_is_no_trial_is_refused_with_what_was_found(tmp_path: Path) -> None:
    place = write_trial(tmp_path / "a.mcap", 0, {"host": {"speed_mps": 12.0}, "other": {"x_m": 80.0}})
    with pytest.raises(DataError, match="it holds no trial of nhtsa-fcw") as caught:
        judge_log(CLAUSE, place, CONFIG)
    assert any("host 12.0 m/s" in line for line in caught.value.found)


def test_two_vehicles_that_could_be_the_lead_are_named(tmp_path: Path) -> None:
    second = {"second": {"speed_mps": 0, "x_m": 230.0, "station_id": "0badcafe"}}
    change = {**second, "other": {"station_id": "00c0ffee"}}
    place = write_trial(tmp_path / "a.mcap", 0, change)
    with pytest.raises(MissingSignalError, match="several vehicles") as caught:
        judge_log(CLAUSE, place, CONFIG)
    assert {line.split(":")[0] for line in caught.value.found} == {"00c0ffee", "0badcafe"}
    named = LogTrial(place.name, lead="0badcafe")
    assert list(outcomes(judge_log(CLAUSE, named, CONFIG))) == ["lead vehicle stopped"]
    with pytest.raises(UsageError, match="no such vehicle"):
        judge_log(CLAUSE, LogTrial(place.name, lead="12345678"), CONFIG)


def test_a_log_without_others_says_so(tmp_path: Path) -> None:
    place = write_trial(tmp_path / "a.mcap", 0, {"other": {"v2x": False}})
    with pytest.raises(MissingSignalError, match="no other vehicle than the ego"):
        judge_log(CLAUSE, place, CONFIG)


def test_a_window_that_ends_before_it_begins_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--start 5 is not before --end 2"):
        judge_log(CLAUSE, LogTrial("drive.mcap", start_s=5.0, end_s=2.0), CONFIG)


def test_a_window_that_begins_after_the_last_moment_of_a_warning_is_refused(tmp_path: Path) -> None:
    place = write_trial(tmp_path / "a.mcap", 0)
    with pytest.raises(DataError, match="lead vehicle stopped: its record is too short") as caught:
        judge_log(CLAUSE, LogTrial(place.name, start_s=11.5), CONFIG)
    assert caught.value.found[1] == "even at the trial's start, a warning would be too late"


def test_a_record_that_ends_before_the_warning_is_due_is_refused(tmp_path: Path) -> None:
    place = write_trial(tmp_path / "a.mcap", 0)
    with pytest.raises(DataError, match="lead vehicle stopped: its record ends before the warning is due"):
        judge_log(CLAUSE, LogTrial(place.name, end_s=8.0), CONFIG)


def test_warnings_of_another_rule_or_horizon_are_refused(tmp_path: Path) -> None:
    place = write_trial(tmp_path / "a.mcap", 0)
    annotated = str(tmp_path / "annotated.mcap")
    assert run_command_line(["run", place.name, "--stage", "estimate,predict,warn", "-o", annotated, "-q"]) == 0
    assert outcomes(judge_log(CLAUSE, LogTrial(annotated), CONFIG)) == {"lead vehicle stopped": PASSED}
    for change in ({"rule": "ttc"}, {"horizon_s": 3.0}):
        with pytest.raises(UsageError, match="its warnings are those of the rule cwcli"):
            judge_log(CLAUSE, LogTrial(annotated), replace(CONFIG, **change))


def test_a_pass_of_one_log_says_how_little_of_the_clause_it_is(tmp_path: Path) -> None:
    lines = format_digest([judge_log(CLAUSE, write_trial(tmp_path / "a.mcap", 0), ConformConfig(policy="full"))])
    assert "one trial of one log: the clause asks for 5 of 7 repetitions of its 3 trials" in lines
    assert not any("policy" in line for line in lines)  # this clause's judge asks for the warning alone


def test_clauses_that_a_log_does_not_hold_are_not_judged(tmp_path: Path) -> None:
    place = write_trial(tmp_path / "a.mcap", 0)
    results = judge_log_by_clauses(["etsi-101-539", "j2945-1", CLAUSE], place, CONFIG)
    assert [result.outcome for result in results] == ["not judged", "not judged", PASSED]
    assert results[0].notes == ("etsi-101-539: not judged: it has no tolerances of recorded trials",)
    with pytest.raises(DataError, match="it holds no trial of the clauses"):
        judge_log_by_clauses(["etsi-101-539", "j2945-1"], place, CONFIG)


def test_a_clause_whose_trials_name_their_rule_is_judged_too(tmp_path: Path) -> None:
    text = (files("cwcli.conformance") / "clauses" / f"{CLAUSE}.toml").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(text.replace("\ngiven = ", '\nrule = "cwcli"\ngiven = '), encoding="utf-8")
    result = judge_log(str(tmp_path / "mine.toml"), write_trial(tmp_path / "a.mcap", 0), CONFIG)
    assert outcomes(result) == {"lead vehicle stopped": PASSED}
    assert result.settings["rule"] == "cwcli"


def test_a_failed_recording_fails(tmp_path: Path) -> None:
    result = judge_log(CLAUSE, write_trial(tmp_path / "a.mcap", 0), ConformConfig(jobs=1, rule="eebl"))
    assert outcomes(result) == {"lead vehicle stopped": FAILED}  # nobody brakes hard, so that rule never warns


@pytest.mark.parametrize(("raised_s", "outcome"), [(9.5, PASSED), (10.2, FAILED)])
def test_another_system_is_judged_by_its_flag(tmp_path: Path, raised_s: float, outcome: str) -> None:
    """2.1 s from contact is 9.9 s after the start."""
    place = write_trial(tmp_path / "a.mcap", 0)
    flagged = add_flag(Path(place.name), raised_s, 13.0)
    result = judge_log(CLAUSE, LogTrial(str(flagged), system="/adas/fcw:data==true"), CONFIG)
    assert outcomes(result) == {"lead vehicle stopped": outcome}, breaches(result)
    verdict = result.trials_with_repetitions[0].repetitions[0].verdict
    assert verdict is not None
    assert verdict.margin == pytest.approx(9.9 - raised_s, abs=0.1)


def test_a_flag_that_is_always_set_is_no_warning_and_the_digest_says_so(tmp_path: Path) -> None:
    place = write_trial(tmp_path / "a.mcap", 0)
    result = judge_log(CLAUSE, LogTrial(place.name, system="/gps/fix:altitude>0"), CONFIG)
    assert result.outcome == FAILED
    assert any("a stuck flag is no warning" in line for line in format_digest([result]))


def test_a_system_without_a_condition_is_refused(tmp_path: Path) -> None:
    place = write_trial(tmp_path / "a.mcap", 0)
    with pytest.raises(UsageError, match="--system /adas/fcw: expected"):
        judge_log(CLAUSE, LogTrial(place.name, system="/adas/fcw"), CONFIG)
