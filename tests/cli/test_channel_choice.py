"""`--channels`: which of the new channels are written; every stage of the run sees them all."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cwcli.channels.published import EGO_PATH, EGO_STATE, REMOTE_STATE, WARNINGS, schema_name_by_published_topic
from cwcli.cli.main import run_command_line
from cwcli.logs.read.reader import Log
from cwcli.pipeline.records import read_run_records
from tests.cli.conftest import ROOT

PSU_FOLLOW = ROOT.parent / "shared" / "logs" / "psu-follow-2obu.mcap"
STATES = {EGO_STATE.topic, REMOTE_STATE.topic}


def own_topics(path: Path) -> set[str]:
    with Log.open(path) as log:
        return {channel.topic for channel in log.channels if channel.topic in schema_name_by_published_topic()}


def payloads(path: Path, topic: str) -> list[bytes]:
    with Log.open(path) as log:
        ids = [channel.id for channel in log.channels if channel.topic == topic]
        return [
            bytes(each)
            for batch in log._get_message_reader().iter_batches(ids)
            for _, each in batch.iter_log_times_and_payloads()
        ]


@pytest.fixture(scope="module")
def whole(intersection: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("whole") / "out.mcap"
    assert run_command_line(["run", str(intersection), "-o", str(target), "-q"]) == 0
    return target


@pytest.mark.parametrize("spelled", [["/cwcli/*/state,/cwcli/warnings"], ["/cwcli/*/state", "/cwcli/warnings"]])
def test_run_writes_those_alone_with_the_same_content(
    intersection: Path, whole: Path, tmp_path: Path, spelled: list[str]
) -> None:
    target = tmp_path / "out.mcap"
    options = [part for each in spelled for part in ("--channels", each)]
    assert run_command_line(["run", str(intersection), "-o", str(target), "-q", *options]) == 0
    assert own_topics(target) == {*STATES, WARNINGS.topic} & own_topics(whole)
    assert payloads(target, WARNINGS.topic) == payloads(whole, WARNINGS.topic) != []
    assert target.stat().st_size < whole.stat().st_size
    with Log.open(target) as log:
        records = read_run_records(log)
    assert sorted(json.loads(records["estimate"]["channels_written"])) == sorted(STATES)
    assert json.loads(records["predict"]["channels_written"]) == []
    assert json.loads(records["warn"]["channels_written"]) == [WARNINGS.topic]
    with Log.open(whole) as log:
        assert "channels_written" not in read_run_records(log)["estimate"]


def test_each_stage_has_the_option(whole: Path, intersection: Path, tmp_path: Path) -> None:
    states = tmp_path / "states.mcap"
    assert run_command_line(["estimate", str(intersection), "-o", str(states), "-q"]) == 0
    target = tmp_path / "out.mcap"
    assert run_command_line(["predict", str(states), "-o", str(target), "-q", "--channels", EGO_PATH.topic]) == 0
    assert own_topics(target) - own_topics(states) == {EGO_PATH.topic}


def test_replacing_leaves_no_channel_of_the_earlier_run(whole: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.mcap"
    assert (
        run_command_line(["run", str(whole), "-o", str(target), "-q", "--replace", "--channels", WARNINGS.topic]) == 0
    )
    assert own_topics(target) == {WARNINGS.topic}


@pytest.mark.parametrize("command", ["run", "estimate"])
def test_an_unknown_channel_is_refused_with_the_list(
    intersection: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    for name in ("/cwcli/ego/stat", "/gps/*", ""):
        assert run_command_line([command, str(intersection), "-o", str(tmp_path / "out.mcap"), "--channels", name]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"error: --channels {name}: cwcli writes no such channel\n")
        assert all(topic in said for topic in schema_name_by_published_topic())
        assert not (tmp_path / "out.mcap").exists()


def test_a_channel_that_the_run_does_not_make_is_told(
    intersection: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--channels", "/cwcli/lanes*", "--channels", EGO_STATE.topic]
    assert run_command_line(["estimate", str(intersection), "-o", str(tmp_path / "a.mcap"), *options]) == 0
    assert "note: --channels /cwcli/lanes*: this run made no such channel" in capsys.readouterr().err
    assert run_command_line(["estimate", str(intersection), "-o", str(tmp_path / "b.mcap"), "--json", *options]) == 0
    assert json.loads(capsys.readouterr().out)["channels_not_made"] == ["/cwcli/lanes*"]


def test_many_logs(intersection: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = ["run", str(intersection), "-d", str(out), "-q", "--jobs", "1", "--stage", "estimate"]
    assert run_command_line([*command, "--channels", EGO_STATE.topic]) == 0
    (annotated,) = out.rglob("*.mcap")
    assert own_topics(annotated) == {EGO_STATE.topic}
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["pipeline"]["channels"] == [EGO_STATE.topic]
    assert run_command_line([*command]) == 0
    assert own_topics(annotated) > {EGO_STATE.topic}
    assert run_command_line([*command, "--channels", "/no"]) == 2


@pytest.mark.skipif(not PSU_FOLLOW.exists(), reason="the development logs in ../shared/logs are not there")
def test_annotated_log_of_six_minutes_and_two_vehicles_is_small(tmp_path: Path) -> None:
    target = tmp_path / "out.mcap"
    assert run_command_line(["run", str(PSU_FOLLOW), "-o", str(target), "-q"]) == 0
    assert target.stat().st_size < 3_000_000
