"""`cwcli run` over many logs: the same whoever does the work, resumable, and safe from any one log."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from cwcli.fleet.table_schemas import TABLES_SCHEMA_VERSION
from tests.cli.conftest import ROOT, Run
from tests.cli.fleet_logs import cut, tree

HOSTILE = "x;<b>&'\"$(id).mcap"
N_LOGS = 6


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four good logs, one of them with a hostile name, one without another vehicle, one that is no log."""
    folder = tmp_path_factory.mktemp("fleet") / "logs"
    folder.mkdir()
    intersection = ROOT / "sample_logs" / "intersection.mcap"
    for k, name in enumerate(("a.mcap", "b.mcap", "2026.mcap", HOSTILE)):
        cut(intersection, folder / name, start_s=k, seconds=4.0)
    cut(ROOT / "sample_logs" / "straight.mcap", folder / "alone.mcap", seconds=4.0)
    (folder / "broken.mcap").write_bytes(b"no log at all")
    return folder


def start(folder: Path, *arguments: str, **environment: str) -> subprocess.Popen[bytes]:
    """`cwcli run` in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "cwcli", "run", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def family(pid: int) -> dict[int, int]:
    """Process -> parent, of every process in the group that `pid` leads."""
    found = {}
    for entry in Path("/proc").iterdir():
        with contextlib.suppress(OSError, ValueError, IndexError):
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
            if int(fields[2]) == pid and fields[0] != "Z":
                found[int(entry.name)] = int(fields[1])
    return found


def workers(pid: int) -> list[int]:
    """The workers: grandchildren of the command, made by its fork server."""
    parents = family(pid)
    return [child for child, parent in parents.items() if parents.get(parent) == pid]


def wait_until(is_true: Any, timeout_s: float = 600.0) -> None:
    until = time.monotonic() + timeout_s
    while not is_true():
        assert time.monotonic() < until
        time.sleep(0.01)


def entries(out: Path) -> list[Path]:
    return sorted(out.glob("logs/*/entry.json"))


@pytest.fixture(scope="module")
def reference(logs: Path) -> Path:
    """What one process makes of the logs."""
    process = start(logs.parent, "logs/*.mcap", "-d", "one", "--jobs", "1", "--tables")
    out, error = process.communicate(timeout=600)
    assert process.returncode == 3, error.decode()  # broken.mcap
    assert b"6 logs" in out
    return logs.parent / "one"


@pytest.mark.parametrize("jobs", ["2", "4"])
def test_same_bytes_however_many_jobs(logs: Path, reference: Path, tmp_path: Path, jobs: str) -> None:
    process = start(logs.parent, "logs/*.mcap", "-d", str(tmp_path / "out"), "--tables", "--jobs", jobs)
    _, error = process.communicate(timeout=600)
    assert process.returncode == 3, error.decode()
    assert tree(tmp_path / "out") == tree(reference)


def test_rejected_measurements_are_the_same_bytes(cwcli: Run, tmp_path: Path) -> None:
    """The sample of a straight road rejects speeds: its table names topics that several quantities share."""
    tables = []
    for jobs in ("1", "2", "4"):
        samples = [ROOT / "sample_logs" / name for name in ("straight.mcap", "intersection.mcap")]
        done = cwcli("run", *samples, "-d", f"out{jobs}", "--jobs", jobs, "--stage", "estimate", "--quiet")
        assert done.returncode == 0, done.stderr
        tables.append((tmp_path / f"out{jobs}/details/rejected.parquet").read_bytes())
    assert len(set(tables)) == 1


def test_layout_and_manifest(reference: Path) -> None:
    manifest = json.loads((reference / "manifest.json").read_text())
    assert (manifest["format"], manifest["cwcli"]) == (2, "0.1.0")
    assert manifest["pipeline"]["run"]["stages"] == ["estimate", "track", "lanes", "observe", "predict", "warn"]
    by_id = {entry["id"]: entry for entry in manifest["logs"]}
    assert len(by_id) == N_LOGS
    assert list(by_id) == sorted(by_id)
    assert {"a", "alone", "b", "broken", "log-2026"} < set(by_id)
    assert by_id["a"]["stages"] == ["estimate", "predict", "warn"]
    assert by_id["alone"]["left_out"]["warn"] == "the log has no messages of other vehicles (BSM or CAM)"
    assert by_id["broken"]["status"] == "failed"
    assert by_id["broken"]["error"]["exit_code"] == 3
    assert by_id["broken"]["error"]["where"] == "logs/broken.mcap"
    assert by_id["broken"]["outputs"] == []
    tables = {f"{name}.parquet" for name in manifest["tables"]}
    assert {"metrics.parquet", "details/estimate.parquet", "tables/gps.fix.parquet"} < tables
    named = {name for entry in by_id.values() for name in entry["outputs"]}
    found = {path.relative_to(reference).as_posix() for path in reference.rglob("*") if path.is_file()}
    others = {"manifest.json", "run_times.json", "views.sql"}
    assert found == named | tables | {f"logs/{i}/entry.json" for i in by_id} | others
    for i, entry in by_id.items():
        assert json.loads((reference / "logs" / i / "entry.json").read_text()) == entry
        assert entry["source"].startswith("logs/")


def test_annotated_logs_equal_those_of_single_runs(cwcli: Run, logs: Path, reference: Path, tmp_path: Path) -> None:
    done = cwcli("run", logs / "a.mcap", "-o", "a.mcap", "--metrics-dir", "metrics", "--quiet")
    assert done.returncode == 0
    assert (tmp_path / "a.mcap").read_bytes() == (reference / "logs/a/annotated.mcap").read_bytes()
    for path in (tmp_path / "metrics").iterdir():
        table = pq.read_table(reference / "details" / path.name)
        of_a = table.filter(pc.equal(table["log"], "a")).drop(["log", "run_id", "schema_version"])
        alone = pq.read_table(path)
        assert str(of_a.cast(alone.schema).to_pylist()) == str(alone.to_pylist())  # NaN is not NaN


def test_tables_hold_every_message(logs: Path, reference: Path) -> None:
    with (reference / "logs/a/annotated.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
    assert summary is not None and summary.statistics is not None
    for channel in summary.channels.values():
        name = channel.topic.removeprefix("/").replace("/", ".")
        logs = pq.read_table(reference / "tables" / f"{name}.parquet", columns=["log"])["log"]
        assert pc.sum(pc.equal(logs, "a")).as_py() == summary.statistics.channel_message_counts.get(channel.id, 0)
    states = pq.read_table(reference / "tables" / "cwcli.ego.state.parquet")
    assert {"speed_mps", "log_time_ns", "log"} <= set(states.column_names)
    assert len(states["log"].unique()) == N_LOGS - 1


def test_schemas_are_those_of_the_schema_version(reference: Path) -> None:
    """A changed column is a new `TABLES_SCHEMA_VERSION`; then write the file anew with what the test prints."""
    found = {
        path.relative_to(reference).as_posix(): {field.name: str(field.type) for field in pq.read_schema(path)}
        for path in sorted([reference / "metrics.parquet", *(reference / "details").iterdir()])
    }
    document = {"schema_version": TABLES_SCHEMA_VERSION, "tables": found}
    assert json.loads((Path(__file__).parent / "table_schemas.json").read_text()) == document, json.dumps(document)


def test_second_run_does_nothing_again(logs: Path, reference: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(reference, out)
    before = {path: path.stat().st_mtime_ns for path in out.rglob("annotated.mcap")}
    process = start(logs.parent, "logs/*.mcap", "-d", str(out), "--tables", "--json")
    text, error = process.communicate(timeout=600)
    document = json.loads(text)
    assert process.returncode == 3, error.decode()
    assert (document["unchanged"], document["failed"], document["done"]) == (N_LOGS - 1, 1, 0)
    assert {path: path.stat().st_mtime_ns for path in out.rglob("annotated.mcap")} == before
    assert tree(out) == tree(reference)


def statuses(process: subprocess.Popen[bytes]) -> dict[str, str]:
    text, error = process.communicate(timeout=600)
    assert text, error.decode()
    return {entry["id"]: entry["status"] for entry in json.loads(text)["logs"]}


def test_what_has_changed_is_done_again(logs: Path, tmp_path: Path) -> None:
    shutil.copytree(logs, tmp_path / "logs", ignore=shutil.ignore_patterns("broken*", "x*", "2026*"))
    arguments = ("logs/*.mcap", "-d", "out", "--json", "--stage", "estimate")
    assert statuses(start(tmp_path, *arguments)) == {"a": "done", "alone": "done", "b": "done"}
    first = tree(tmp_path / "out")
    shutil.copy(logs / "b.mcap", tmp_path / "logs/a.mcap")  # another input
    assert statuses(start(tmp_path, *arguments)) == {"a": "done", "alone": "unchanged", "b": "unchanged"}
    (tmp_path / "out/details/estimate.parquet").unlink()  # a table is gone, and with it rows of all logs
    assert set(statuses(start(tmp_path, *arguments)).values()) == {"done"}
    with (tmp_path / "out/logs/b/annotated.mcap").open("r+b") as file:  # an output was cut
        file.truncate(100)
    shutil.copy(logs / "a.mcap", tmp_path / "logs/a.mcap")
    assert statuses(start(tmp_path, *arguments)) == {"a": "done", "alone": "unchanged", "b": "done"}
    assert tree(tmp_path / "out") == first
    everything = statuses(start(tmp_path, *arguments, "--estimate-rate", "10"))
    assert set(everything.values()) == {"done"}
    assert set(statuses(start(tmp_path, *arguments)).values()) == {"done"}
    assert tree(tmp_path / "out") == first


def test_a_table_that_is_not_made_any_more_goes(logs: Path, tmp_path: Path) -> None:
    process = start(logs.parent, "logs/a.mcap", "-d", str(tmp_path / "out"), "--quiet")
    assert process.wait(60) == 0
    assert (tmp_path / "out/details/events.parquet").is_file()
    process = start(logs.parent, "logs/a.mcap", "-d", str(tmp_path / "out"), "--quiet", "--stage", "estimate")
    assert process.wait(60) == 0
    assert sorted(path.name for path in (tmp_path / "out/details").iterdir()) == [
        "estimate.parquet",
        "link.parquet",
        "rejected.parquet",
    ]


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with twelve logs, and what a run makes of them."""
    folder = tmp_path_factory.mktemp("many")
    (folder / "logs").mkdir()
    for k in range(12):
        cut(ROOT / "sample_logs" / "intersection.mcap", folder / f"logs/d{k:02}.mcap", start_s=0.3 * k, seconds=3.0)
    assert start(folder, "logs/*.mcap", "-d", "whole", "--quiet").wait(120) == 0
    return folder


@pytest.mark.parametrize("signal_number", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM], ids=lambda s: s.name)
def test_killed_run_is_taken_up_again(many: Path, tmp_path: Path, signal_number: signal.Signals) -> None:
    out = tmp_path / "out"
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    process = start(many, "logs/*.mcap", "-d", str(out), "--jobs", "2", TMPDIR=str(temporary))
    wait_until(lambda: len(entries(out)) >= 3)
    os.killpg(process.pid, signal.SIGSTOP)  # a run that ends before the signal comes has not been interrupted
    assert len(entries(out)) <= 9
    os.killpg(process.pid, signal_number)
    os.killpg(process.pid, signal.SIGCONT)
    _, error = process.communicate(timeout=600)
    code = {signal.SIGKILL: -signal.SIGKILL, signal.SIGINT: 130, signal.SIGTERM: 143}[signal_number]
    assert process.returncode == code, error.decode()
    assert b"Traceback" not in error
    wait_until(lambda: not family(process.pid))
    assert list(temporary.iterdir()) == []
    finished = {path.parent.name: path.stat().st_mtime_ns for path in entries(out)}
    assert 3 <= len(finished) < 12
    manifest = json.loads((out / "manifest.json").read_text())
    assert len(manifest["logs"]) == 12
    assert "pending" in {entry["status"] for entry in manifest["logs"]}
    again = start(many, "logs/*.mcap", "-d", str(out), "--jobs", "2", "--json")
    found = statuses(again)
    assert again.returncode == 0
    assert {i for i, status in found.items() if status == "unchanged"} == set(finished)
    assert {i for i, status in found.items() if status == "done"} == set(found) - set(finished)
    assert all((out / f"logs/{i}/entry.json").stat().st_mtime_ns == at for i, at in finished.items())
    assert tree(out) == tree(many / "whole")


def test_only_the_parent_is_killed(many: Path, tmp_path: Path) -> None:
    """Workers whose parent is gone go too: they would write into a folder that a new run has taken over."""
    process = start(many, "logs/*.mcap", "-d", str(tmp_path / "out"), "--jobs", "2")
    wait_until(lambda: len(entries(tmp_path / "out")) >= 2)
    process.kill()
    process.wait()
    wait_until(lambda: not family(process.pid), 10)


def test_killed_worker_costs_its_log_a_second_attempt(many: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = start(many, "logs/*.mcap", "-d", str(out), "--jobs", "2", "--quiet")
    wait_until(lambda: len(entries(out)) >= 2)
    os.kill(workers(process.pid)[0], signal.SIGKILL)
    _, error = process.communicate(timeout=600)
    assert (process.returncode, error) == (0, b"")
    assert tree(out) == tree(many / "whole")
    times = json.loads((out / "run_times.json").read_text())["logs"]
    assert len(times) == 12
    assert sum(entry["attempts"] for entry in times.values()) <= 13


def test_two_runs_do_not_share_a_folder(cwcli: Run, many: Path, tmp_path: Path) -> None:
    process = start(many, "logs/*.mcap", "-d", str(tmp_path / "out"), "--jobs", "1", "--quiet")
    wait_until(lambda: len(entries(tmp_path / "out")) >= 1)
    os.killpg(process.pid, signal.SIGSTOP)  # a busy machine could let it end before the second has begun
    done = cwcli("run", many / "logs/d00.mcap", "-d", "out")
    assert (done.returncode, done.stdout) == (6, b"")
    assert b"another run" in done.stderr
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


def test_quiet_without_a_terminal(many: Path, tmp_path: Path) -> None:
    process = start(many, "logs/d0[01].mcap", "-d", str(tmp_path / "out"))
    out, error = process.communicate(timeout=600)
    assert process.returncode == 0
    assert b"\r" not in error and b"\x1b" not in out + error
    assert all(line.startswith((b"note: ", b"      ")) for line in error.splitlines())
    assert max(map(len, out.decode().splitlines()[1:])) <= 80  # the first names the folder
    process = start(many, "logs/d0[01].mcap", "-d", str(tmp_path / "out"), "--quiet")
    assert process.communicate(timeout=600) == (b"", b"")


def test_folder_is_exactly_what_the_run_names(cwcli: Run, many: Path, tmp_path: Path) -> None:
    one, two = many / "logs/d00.mcap", many / "logs/d01.mcap"
    assert cwcli("run", one, "-d", "out", "-q", "--stage", "estimate").returncode == 0
    assert cwcli("run", one, two, "-d", "out", "-q", "--stage", "estimate").returncode == 0
    refused = cwcli("run", two, "-d", "out", "-q", "--stage", "estimate")
    assert refused.returncode == 2
    assert b"d00" in refused.stderr and b"--force" in refused.stderr
    assert cwcli("run", two, "-d", "out", "-q", "--stage", "estimate", "--force").returncode == 0
    assert [path.parent.name for path in entries(tmp_path / "out")] == ["d01"]
    assert not list((tmp_path / "out").glob("**/log=d00"))


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["LOG", "LOG2"], 2, "-d"),
        (["mine/logs"], 2, "a folder of logs needs an output folder"),
        (["LOG", "--jobs", "2"], 2, "-d"),
        (["LOG", "--ray", "auto"], 2, "-d"),
        (["LOG", "--tables"], 2, "-d"),
        (["LOG", "-d", "out", "-o", "x.mcap"], 2, "-o"),
        (["LOG", "-d", "out", "--metrics-dir", "m"], 2, "--metrics-dir"),
        (["LOG", "-d", "out", "--jobs", "0"], 2, "--jobs"),
        (["-", "-d", "out"], 2, "standard input"),
        (["none*.mcap", "-d", "out"], 2, "no file matches"),
        (["LOG", "-d", "https://host/out"], 2, "a web server has no folders"),
        (["LOG", "-d", "there"], 6, "File exists"),
        (["LOG", "-d", "mine"], 6, "but logs"),
        (["LOG", "-d", "out", "--stage", "estimat"], 2, "estimate"),
        (["LOG", "-d", "out", "--gate", "import os"], 2, "gate"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_refusals(cwcli: Run, many: Path, tmp_path: Path, arguments: list[str], code: int, words: str) -> None:
    names = {"LOG": str(many / "logs/d00.mcap"), "LOG2": str(many / "logs/d01.mcap")}
    (tmp_path / "there").write_text("mine")
    (tmp_path / "mine/logs").mkdir(parents=True)
    for name in ("drive", "other"):
        (tmp_path / f"mine/logs/{name}.mcap").write_text("mine")
    done = cwcli("run", *(names.get(argument, argument) for argument in arguments))
    shown = done.stderr.decode()
    assert (done.returncode, done.stdout) == (code, b""), shown
    assert shown.startswith("error: ")
    assert words in shown
    assert "Traceback" not in shown
    assert (tmp_path / "there").read_text() == (tmp_path / "mine/logs/drive.mcap").read_text() == "mine"
    assert not (tmp_path / "out/logs").exists()


def test_pipeline_file(cwcli: Run, many: Path, tmp_path: Path) -> None:
    (tmp_path / "pipeline.toml").write_text(
        'gates = ["ego.position_rmse_m < 0.5"]\n[run]\nstages = ["estimate", "predict"]\njobs = 1\n'
        "[predict]\nhorizon = 1\n"
    )
    done = cwcli("run", many / "logs/d00.mcap", "--config", "pipeline.toml", "-d", "out", "--quiet")
    assert done.returncode == 0, done.stderr.decode()
    manifest = json.loads((tmp_path / "out/manifest.json").read_text())
    assert manifest["pipeline"]["gates"] == ["ego.position_rmse_m < 0.5"]
    assert manifest["pipeline"]["predict"]["horizon"] == 1.0
    assert manifest["logs"][0]["stages"] == ["estimate", "predict"]


def test_gates_of_an_earlier_run_are_not_forgotten_silently(cwcli: Run, many: Path) -> None:
    log = many / "logs/d00.mcap"
    gates = ["--gate", "ego.position_rmse_m < 0.5", "--gate", "doubts.count < 1"]
    first = cwcli("run", log, "-d", "out", "--stage", "estimate", *gates)
    assert first.returncode == 0, first.stderr.decode()
    assert b"no longer holds" not in first.stderr
    again = cwcli("run", log, "-d", "out", "--stage", "estimate", *gates[:2])
    assert again.returncode == 0, again.stderr.decode()
    notes = " ".join(again.stderr.decode().split())
    assert "note: --gate 'doubts.count < 1' of the earlier run into this folder no longer holds" in notes
    assert "rmse" not in notes


def test_single_log_runs_the_stages_that_it_has_signals_for(cwcli: Run, many: Path) -> None:
    done = cwcli("run", many / "logs/d00.mcap", "--json")
    document = json.loads(done.stdout)
    assert list(document["stages"]) == ["estimate", "predict", "warn"]
    assert set(document["left_out"]) == {"track", "lanes", "observe"}
    none = cwcli("run", many / "logs/d00.mcap", "--stage", "lanes")
    assert none.returncode == 4
    assert b"no channel holds the camera (needed by `cwcli run`)" in none.stderr
