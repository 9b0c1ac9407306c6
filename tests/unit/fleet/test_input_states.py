"""A finished log is read again only where its file is not, to the file system, the one that was read."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cwcli.cli.commands.run import gather_default_options
from cwcli.fleet import folder
from cwcli.fleet import index as fleet_index
from cwcli.fleet import run as fleet_run
from cwcli.fleet.input_states import FileState, file_states_from_run_times, file_states_to_document, read_file_state
from cwcli.fleet.plan import FleetPlan, LogTask, TaskResult
from cwcli.fleet.results import read_run_metrics
from cwcli.fleet.run import run_fleet
from cwcli.fleet.worker import process_log
from tests.cli.fleet_logs import tree

SAMPLES = Path(__file__).parents[3] / "sample_logs"
STATE = FileState(1, 2, 3, 4, 5)


class Runs:
    """Runs over a folder of two logs; `read` holds the ids of the logs that the last run gave to a worker."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        plan = gather_default_options().fleet_plan(replace=False)
        self.plan = dataclasses.replace(plan, stages=plan.stages[:1])
        self.logs, self.out, self.read = folder / "logs", folder / "out", list[str]()
        self.logs.mkdir()
        for name in ("straight", "curve"):
            shutil.copy(SAMPLES / f"{name}.mcap", self.logs)
        monkeypatch.setattr(fleet_run, "run_on_local_processes", self._run_here)

    def __call__(self, *, rehash: bool = False) -> dict[str, str]:
        self.read = []
        plan = dataclasses.replace(self.plan, rehash=rehash)
        return run_fleet([str(self.logs)], plan, self.out, jobs=1).statuses

    def _run_here(self, tasks: Sequence[LogTask], plan: FleetPlan, jobs: int) -> Iterator[tuple[LogTask, TaskResult]]:
        for task in tasks:
            self.read.append(task.id)
            yield task, process_log(task, plan)


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Runs:
    runs = Runs(tmp_path, monkeypatch)
    assert runs() == {"curve": "done", "straight": "done"}
    assert runs.read == ["curve", "straight"]
    return runs


def test_logs_that_did_not_change_are_not_read(runs: Runs) -> None:
    before = tree(runs.out)
    for _ in range(2):  # the second time from what the first left
        assert runs() == {"curve": "unchanged", "straight": "unchanged"}
        assert runs.read == []
    assert tree(runs.out) == before


def test_rehash_reads_all_logs(runs: Runs) -> None:
    assert runs(rehash=True) == {"curve": "unchanged", "straight": "unchanged"}
    assert runs.read == ["curve", "straight"]


def test_other_content_of_the_same_size_and_modification_time_is_found(runs: Runs) -> None:
    path = runs.logs / "curve.mcap"
    before = path.stat()
    content = bytearray(path.read_bytes())
    at = content.index(b"/gps")
    content[at : at + 4] = b"/gpt"
    path.write_bytes(content)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert (path.stat().st_size, path.stat().st_mtime_ns) == (before.st_size, before.st_mtime_ns)
    assert runs()["straight"] == "unchanged"
    assert runs.read == ["curve"]


def test_another_log_moved_to_the_same_name_is_found(runs: Runs) -> None:
    (runs.logs / "straight.mcap").replace(runs.logs / "curve.mcap")
    shutil.copy(SAMPLES / "straight.mcap", runs.logs)
    assert runs() == {"curve": "done", "straight": "unchanged"}
    assert runs.read == ["curve", "straight"]


def test_a_touched_log_is_hashed_and_then_known_again(runs: Runs) -> None:
    os.utime(runs.logs / "curve.mcap")
    assert runs() == {"curve": "unchanged", "straight": "unchanged"}
    assert runs.read == ["curve"]
    assert runs() == {"curve": "unchanged", "straight": "unchanged"}
    assert runs.read == []


def remove_table(runs: Runs) -> None:
    (runs.out / "metrics.parquet").unlink()


def remove_annotated_log(runs: Runs) -> None:
    (runs.out / "logs/curve/annotated.mcap").unlink()


def change_options(runs: Runs) -> None:
    runs.plan = dataclasses.replace(runs.plan, start="1")


@pytest.mark.parametrize(
    ("change", "read"),
    [
        (remove_table, ["curve", "straight"]),
        (remove_annotated_log, ["curve"]),
        (change_options, ["curve", "straight"]),
    ],
)
def test_results_that_are_gone_or_of_other_options_are_made_again(
    runs: Runs, change: Callable[[Runs], None], read: list[str]
) -> None:
    change(runs)
    assert [id for id, status in runs().items() if status == "done"] == read
    assert runs.read == read


def test_finished_logs_are_known_from_one_index(runs: Runs, monkeypatch: pytest.MonkeyPatch) -> None:
    """No entry of a log is read, and nothing is written."""
    opened: list[str] = []
    read = folder.read_json_object

    def read_and_note(path: Path) -> dict[str, Any] | None:
        opened.append(path.name)
        return read(path)

    for module in (fleet_index, folder):
        monkeypatch.setattr(module, "read_json_object", read_and_note)
    monkeypatch.setattr(fleet_run, "write_json_object", lambda *arguments, **options: opened.append("written"))
    assert set(runs().values()) == {"unchanged"}
    assert opened == ["manifest.json", "run_times.json"]


def test_a_run_that_was_killed_before_its_tables_writes_them(runs: Runs, monkeypatch: pytest.MonkeyPatch) -> None:
    before = tree(runs.out)
    shutil.rmtree(runs.out)

    def kill(*arguments: object) -> list[str]:
        raise KeyboardInterrupt

    with monkeypatch.context() as killed:
        killed.setattr(fleet_run, "write_tables", kill)
        with pytest.raises(KeyboardInterrupt):
            runs()
    assert not (runs.out / "metrics.parquet").exists()
    assert all(log.rows for log in read_run_metrics(str(runs.out)).logs)
    assert set(runs().values()) == {"unchanged"}
    assert tree(runs.out) == before


def test_no_annotate_writes_the_same_tables_and_no_logs(runs: Runs) -> None:
    def rows() -> dict[str, pa.Table]:
        names = [name for name in tree(runs.out) if name.endswith(".parquet")]
        return {name: pq.read_table(runs.out / name).drop(["run_id"]) for name in names}

    tables = {name: table.to_pylist() for name, table in rows().items()}
    shutil.rmtree(runs.out)
    runs.plan = dataclasses.replace(runs.plan, annotate=False)
    assert set(runs().values()) == {"done"}
    assert not list(runs.out.rglob("*.mcap"))
    assert str({name: table.to_pylist() for name, table in rows().items()}) == str(tables)  # NaN is not NaN
    assert set(runs().values()) == {"unchanged"}
    assert runs.read == []


def test_a_log_that_failed_is_read_again(runs: Runs) -> None:
    (runs.logs / "curve.mcap").write_bytes(b"no log")
    for _ in range(2):
        assert runs()["curve"] == "failed"
        assert runs.read == ["curve"]


def test_without_the_run_times_all_logs_are_read(runs: Runs) -> None:
    (runs.out / "run_times.json").unlink()
    assert set(runs().values()) == {"unchanged"}
    assert runs.read == ["curve", "straight"]


def test_states_survive_the_file_and_nothing_else_is_one() -> None:
    document = json.loads(json.dumps({"inputs": file_states_to_document({"a": STATE})}))
    assert file_states_from_run_times(document) == {"a": STATE}
    whole = STATE._asdict()
    values: Any
    for values in ([], None, {**whole, "inode": True}, {**whole, "inode": "2"}, {**whole, "more": 1}, {"inode": 2}):
        assert file_states_from_run_times({"inputs": {"a": values, "b": whole}}) == {"b": STATE}
    for document in (None, {}, {"inputs": []}):
        assert file_states_from_run_times(document) == {}


def test_only_a_regular_file_has_a_state(tmp_path: Path) -> None:
    assert read_file_state(str(tmp_path)) is None
    assert read_file_state(str(tmp_path / "none")) is None
    assert read_file_state("zero\0byte") is None
