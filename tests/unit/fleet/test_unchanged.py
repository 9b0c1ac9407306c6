"""A run over logs that are all done starts no worker; one that has to be done starts some."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.fleet import run as fleet_run

SAMPLES = Path(__file__).parents[3] / "sample_logs"


def test_finished_logs_need_no_worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("straight", "rear-end"):
        shutil.copy(SAMPLES / f"{name}.mcap", tmp_path)
    logs = [str(tmp_path / "straight.mcap"), str(tmp_path / "rear-end.mcap")]
    arguments = ["run", *logs, "-d", str(tmp_path / "out"), "--stage", "estimate", "--jobs", "1", "-q"]
    assert run_command_line(arguments) == 0
    written = {path: path.read_bytes() for path in (tmp_path / "out").rglob("*.mcap")}
    assert len(written) == 2
    given: list[list[str]] = []
    do_tasks = fleet_run.run_on_local_processes

    def note(tasks: list[fleet_run.LogTask], plan: fleet_run.FleetPlan, jobs: int) -> object:
        given.append([Path(task.path).name for task in tasks])
        return do_tasks(tasks, plan, jobs)

    monkeypatch.setattr(fleet_run, "run_on_local_processes", note)
    assert run_command_line(arguments) == 0
    assert given == []
    next(iter(written)).unlink()
    assert run_command_line(arguments) == 0
    assert len(given) == 1
    assert len(given[0]) == 1
    assert {path: path.read_bytes() for path in (tmp_path / "out").rglob("*.mcap")} == written
