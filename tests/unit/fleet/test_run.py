"""A run in pieces: what is recorded of a log, and what makes two runs the same."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from pathlib import Path
from typing import Any

import pytest

from cwcli.cli.commands.run import gather_default_options
from cwcli.errors import InputError, OutputError, UsageError
from cwcli.fleet import run as fleet_run
from cwcli.fleet import worker
from cwcli.fleet.folder import MAX_JSON_BYTES, LogOutputs, new_log_entry, read_json_object, write_json_object
from cwcli.fleet.local import WorkerDied
from cwcli.fleet.plan import FleetPlan, LogTask
from cwcli.fleet.run import run_fleet
from cwcli.fleet.worker import process_log
from cwcli.pipeline.call import Selection, StageCall, config_with_selection
from cwcli.stages import STAGES

SAMPLES = Path(__file__).parents[3] / "sample_logs"
EMPTY_SHA256 = hashlib.sha256(b"").hexdigest()


@pytest.fixture
def plan() -> FleetPlan:
    return gather_default_options().fleet_plan(replace=False)


def test_key_depends_on_what_decides_the_result(plan: FleetPlan) -> None:
    keys = {
        plan.cache_key("a"),
        plan.cache_key("b"),
        dataclasses.replace(plan, strict=True).cache_key("a"),
        dataclasses.replace(plan, start="1").cache_key("a"),
        dataclasses.replace(plan, tables=True).cache_key("a"),
        dataclasses.replace(plan, stages=plan.stages[:1]).cache_key("a"),
        dataclasses.replace(
            plan, stages=(StageCall(STAGES["estimate"], dataclasses.replace(plan.stages[0].config, rate_hz=5)),)
        ).cache_key("a"),
    }
    assert len(keys) == 7
    assert dataclasses.replace(plan, pipeline={"gates": ["a < 1"]}).cache_key("a") == plan.cache_key("a")
    assert gather_default_options().fleet_plan(replace=False).cache_key("a") == plan.cache_key("a")


def test_a_wider_bound_reruns_no_log_that_was_read_whole(plan: FleetPlan) -> None:
    wider = dataclasses.replace(plan, max_pipe_bytes=2 * plan.max_pipe_bytes, max_ratio=2 * plan.max_ratio)
    assert wider.cache_key("a") == plan.cache_key("a")
    recovered = dataclasses.replace(plan, recover=True)  # leaves out what a bound refuses: another bound, another log
    assert dataclasses.replace(recovered, max_ratio=2 * plan.max_ratio).cache_key("a") != recovered.cache_key("a")
    assert dataclasses.replace(recovered, max_pipe_bytes=1).cache_key("a") == recovered.cache_key("a")


def test_every_configuration_takes_a_selection(plan: FleetPlan) -> None:
    selection = Selection(topics={"imu": "/imu"}, start_ns=1, end_ns=2)
    for call in plan.stages:
        config: Any = config_with_selection(call.config, selection)
        chosen = getattr(config, "sources", config)
        assert (chosen.topics, chosen.start_ns, chosen.end_ns) == ({"imu": "/imu"}, 1, 2)


def test_a_bug_is_recorded_with_where_it_came_from(
    plan: FleetPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stumble(*arguments: Any, **settings: Any) -> None:
        raise KeyError("speed")

    monkeypatch.setattr(worker, "run_stages", stumble)
    task = LogTask("s", "straight.mcap", str(SAMPLES / "straight.mcap"), str(tmp_path))
    assert process_log(task, plan).status == "failed"
    entry = LogOutputs(tmp_path, "s").read_entry()
    assert entry is not None
    assert entry["error"]["exit_code"] == 70
    assert "KeyError" in entry["error"]["what"]
    assert any("in stumble" in frame for frame in entry["error"]["found"])


def test_a_log_that_fails_leaves_nothing_of_an_earlier_run(plan: FleetPlan, tmp_path: Path) -> None:
    log = tmp_path / "s.mcap"
    log.write_bytes((SAMPLES / "straight.mcap").read_bytes())
    task = LogTask("s", "s.mcap", str(log), str(tmp_path / "out"))
    assert process_log(task, plan).status == "done"
    log.write_bytes(b"broken now")
    assert process_log(task, plan).status == "failed"
    assert [path.name for path in (tmp_path / "out").rglob("*") if path.is_file()] == ["entry.json"]


def test_a_renamed_log_is_not_done_again(plan: FleetPlan, tmp_path: Path) -> None:
    out = str(tmp_path / "out")
    assert process_log(LogTask("s", "old/s.mcap", str(SAMPLES / "straight.mcap"), out), plan).status == "done"
    assert process_log(LogTask("s", "new/s.mcap", str(SAMPLES / "straight.mcap"), out), plan).status == "unchanged"
    entry = LogOutputs(tmp_path / "out", "s").read_entry()
    assert entry is not None and entry["source"] == "new/s.mcap"


def test_a_log_whose_worker_died_is_in_the_manifest(
    plan: FleetPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        fleet_run, "run_on_local_processes", lambda tasks, plan, jobs: ((task, WorkerDied()) for task in tasks)
    )
    fleet = run_fleet([str(SAMPLES / "straight.mcap")], plan, tmp_path / "out")
    assert fleet.exit_code == 70
    manifest = read_json_object(tmp_path / "out/manifest.json")
    assert manifest is not None
    assert "died twice" in manifest["logs"][0]["error"]["what"]


def test_twins_from_two_folders_keep_apart(plan: FleetPlan, tmp_path: Path) -> None:
    for day, sample in (("day1", "straight"), ("day2", "curve")):
        (tmp_path / day).mkdir()
        (tmp_path / day / "drive.mcap").write_bytes((SAMPLES / f"{sample}.mcap").read_bytes())
    plan = dataclasses.replace(plan, stages=plan.stages[:1])
    told: list[tuple[str, str, int, int]] = []

    def report(task: LogTask | None, status: str, done: int, total: int) -> None:
        told.append(("" if task is None else task.id, status, done, total))

    sources = [f"{tmp_path}/day1/*.mcap", f"{tmp_path}/day2/*.mcap"]
    fleet = run_fleet(sources, plan, tmp_path / "out", jobs=1, report=report)
    assert list(fleet.statuses) == ["day1_drive", "day2_drive"]
    assert told[0] == ("", "found", 0, 2)
    assert [(done, total) for _, _, done, total in told[1:]] == [(1, 2), (2, 2)]
    hashes = {entry["sha256"] for entry in fleet.manifest["logs"]}
    assert len(hashes) == 2


def test_ambiguous_position_is_an_error_of_the_log(plan: FleetPlan, tmp_path: Path) -> None:
    from mcap.writer import Writer

    path = tmp_path / "two.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("foxglove.LocationFix", "jsonschema", b"{}")
        for topic in ("/a", "/b"):
            channel = writer.register_channel(topic, "json", schema)
            fix = {"timestamp": {"sec": 1, "nsec": 0}, "latitude": 51.0, "longitude": 13.0, "altitude": 0.0}
            writer.add_message(channel, 10**9, json.dumps(fix).encode(), 10**9)
        writer.finish()
    assert process_log(LogTask("two", "two.mcap", str(path), str(tmp_path / "out")), plan).status == "failed"
    entry = LogOutputs(tmp_path / "out", "two").read_entry()
    assert entry is not None
    assert entry["error"]["exit_code"] == 4
    assert "--topic ego_position=/a" in entry["error"]["hint"]


def test_unfit_output_folder(plan: FleetPlan, tmp_path: Path) -> None:
    for name, words in (("https://host/out", "a web server has no folders"), ("-", "the output folder can't be '-'")):
        with pytest.raises(UsageError, match=words):
            run_fleet([str(SAMPLES / "straight.mcap")], plan, name)


def test_what_is_no_file_is_an_error_of_its_log_and_never_waited_for(plan: FleetPlan, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    fleet = run_fleet([str(tmp_path / "pipe.mcap"), "/dev/zero"], plan, tmp_path / "out", jobs=1)
    assert fleet.exit_code == 3
    what = {entry["id"]: entry["error"]["what"] for entry in fleet.manifest["logs"]}
    pipe = "it is a pipe or a device, no file"
    assert what == {"pipe": pipe, "zero": pipe}


def test_a_log_that_became_a_folder_is_an_error_of_its_log(plan: FleetPlan, tmp_path: Path) -> None:
    (tmp_path / "a.mcap").mkdir()
    assert process_log(LogTask("a", "a.mcap", str(tmp_path / "a.mcap"), str(tmp_path / "out")), plan).status == "failed"
    entry = LogOutputs(tmp_path / "out", "a").read_entry()
    assert entry is not None
    assert (entry["error"]["exit_code"], entry["error"]["what"]) == (3, "the folder holds no log")


@pytest.mark.parametrize(
    "damage",
    [
        {"outputs": None},
        {"outputs": [1]},
        {"bytes": "x"},
        {"stages": None},
        {"left_out": {"warn": ["<b>"]}},
        {"inputs": [1]},
        {"inputs": [{"read": 1, "rejected": None}]},
        {"tables": {"events": "many"}},
        {"source": 7},
        {"error": {"what": "?"}},
        {"scores": None},
    ],
    ids=json.dumps,
)
def test_a_log_whose_entry_was_tampered_with_is_done_again(
    plan: FleetPlan, tmp_path: Path, damage: dict[str, Any]
) -> None:
    log = tmp_path / "log.mcap"
    log.write_bytes(b"")
    folder = LogOutputs(tmp_path, "log")
    folder.annotated_log_path.parent.mkdir(parents=True)
    folder.annotated_log_path.write_bytes(b"annotated")
    entry = {
        **new_log_entry("log", str(log)),
        "status": "done",
        "sha256": EMPTY_SHA256,
        "key": plan.cache_key(EMPTY_SHA256),
    }
    whole = folder.write_entry(entry, [folder.annotated_log_path])
    assert folder.is_log_done_with_key(whole, plan.cache_key(EMPTY_SHA256), has_tables=True)
    write_json_object({**whole, **damage}, folder.annotated_log_path.parent / "entry.json")
    assert (
        process_log(LogTask("log", str(log), str(log), str(tmp_path)), plan).status == "failed"
    )  # it is an empty file


def test_json_of_thousands_of_lists_is_no_document(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text("[" * 100_000)
    assert read_json_object(tmp_path / "manifest.json") is None


def test_manifest_that_is_too_large_is_not_said_to_be_missing(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").touch()
    os.truncate(tmp_path / "manifest.json", MAX_JSON_BYTES + 1)  # a sparse file
    with pytest.raises(InputError, match="more than 1 GB"):
        read_json_object(tmp_path / "manifest.json")


def test_a_folder_too_deep_to_make_is_an_output_error(plan: FleetPlan, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="can't be made"):
        run_fleet([str(tmp_path / "log.mcap")], plan, tmp_path / ("b/" * 2000))
