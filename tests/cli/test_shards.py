"""Shards of a run, merged: byte for byte the folder of one run, also after a shard was killed and run again."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

import fsspec
import pytest

from cwcli import __version__
from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BAD_INPUT, EXIT_DONE, EXIT_NOT_WRITTEN, EXIT_USAGE, UsageError
from cwcli.fleet.run import lock_folder
from cwcli.fleet.shard import Shard, parse_shard
from tests.cli.conftest import SAMPLES
from tests.cli.fleet_logs import cut, tree

N_SHARDS = 2
STAGES = ("--stage", "estimate", "--jobs", "1", "-q")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three short logs, one of them damaged; one run over all, and two shards."""
    folder = tmp_path_factory.mktemp("runs")
    (folder / "logs").mkdir()
    for k in range(2):
        cut(SAMPLES / "straight.mcap", folder / "logs" / f"drive_{k}.mcap", start_s=k, seconds=2.0)
    (folder / "logs" / "damaged.mcap").write_bytes((folder / "logs" / "drive_0.mcap").read_bytes()[:-20])
    for name, options in (
        ("whole", ()),
        *((f"shard{k}", ("--shard", f"{k}/{N_SHARDS}")) for k in range(1, N_SHARDS + 1)),
    ):
        run_command_line(["run", str(folder / "logs"), "-d", str(folder / name), *STAGES, *options])
    return folder


def merge(folder: Path, *names: str, out: str | Path = "merged") -> int:
    return run_command_line(["merge", *(str(folder / name) for name in names), "-d", str(folder / out), "-q"])


def shards_of(folder: Path, target: Path) -> Path:
    """A copy of the shards that a test may spoil."""
    for k in range(1, N_SHARDS + 1):
        shutil.copytree(folder / f"shard{k}", target / f"shard{k}")
    return target


def test_merged_shards_equal_one_run(runs: Path, tmp_path: Path) -> None:
    parts = [json.loads((runs / f"shard{k}" / "manifest.json").read_text())["logs"] for k in range(1, N_SHARDS + 1)]
    assert sorted(map(len, parts)) == [1, 2]
    assert merge(runs, "shard2", "shard1", out=tmp_path / "merged") == EXIT_DONE
    assert tree(tmp_path / "merged") == tree(runs / "whole")


def test_shards_in_a_store_are_merged_like_those_of_this_machine(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = fsspec.filesystem("memory")
    for k in range(1, N_SHARDS + 1):
        store.put(f"{runs}/shard{k}/", f"/bucket/shard{k}/", recursive=True)
    urls = [f"memory://bucket/shard{k}" for k in range(1, N_SHARDS + 1)]
    target = str(tmp_path / "merged")
    assert run_command_line(["merge", *urls, "-d", target, "-q"]) == EXIT_DONE
    assert tree(Path(target)) == tree(runs / "whole")
    assert not (Path(target) / ".merge").exists()
    table = next(name for name in store.find("/bucket/shard2") if name.endswith("metrics.parquet"))
    store.pipe_file(table, store.cat_file(table)[:-3])  # the upload of the shard broke off
    other = tmp_path / "other"
    assert run_command_line(["merge", *urls, "-d", str(other), "-q"]) == EXIT_BAD_INPUT
    assert "tables of the run are missing or changed" in " ".join(capsys.readouterr().err.split())
    assert run_command_line(["merge", "memory://bucket/none", "-d", str(other), "-q"]) == EXIT_BAD_INPUT
    assert "memory://bucket/none: there is no such folder" in " ".join(capsys.readouterr().err.split())
    assert run_command_line(["merge", "https://host/shard1", "-d", str(other), "-q"]) == EXIT_USAGE
    assert "a web server has no folders" in " ".join(capsys.readouterr().err.split())
    assert not other.exists()
    other.mkdir()  # a folder that the user has made stays, though nothing is merged
    assert run_command_line(["merge", "memory://bucket/none", "-d", str(other), "-q"]) == EXIT_BAD_INPUT
    assert [*other.iterdir()] == []


def test_a_merge_from_a_store_leaves_the_copies_of_another_merge_alone(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = fsspec.filesystem("memory")
    store.put(f"{runs}/shard1/", "/busy/shard1/", recursive=True)
    copies = tmp_path / "merged" / ".merge"
    with lock_folder(copies):
        (copies / "part").write_bytes(b"of the other merge")
        code = run_command_line(["merge", "memory://busy/shard1", "-d", str(tmp_path / "merged"), "-q"])
        assert code == EXIT_NOT_WRITTEN
        assert (copies / "part").read_bytes() == b"of the other merge"
    assert "another run is writing into the folder" in " ".join(capsys.readouterr().err.split())


def test_merge_that_was_killed_goes_on(runs: Path, tmp_path: Path) -> None:
    target = tmp_path / "merged"
    assert merge(runs, "shard1", "shard2", out=target) == EXIT_DONE
    entry = next((target / "logs").glob("drive_0/entry.json"))
    entry.unlink()
    (target / "metrics.parquet").write_bytes(b"half")
    assert merge(runs, "shard1", "shard2", out=target) == EXIT_DONE
    assert tree(target) == tree(runs / "whole")


def test_merge_onto_another_file_system_that_is_full_leaves_no_part(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A log can't be linked there, and is copied; the disk is full before the end of the copy."""

    def copy_half(source: BinaryIO, target: BinaryIO) -> None:
        target.write(source.read(1000))
        raise OSError(errno.ENOSPC, "no room")

    link = os.link

    def link_inside(source: str | Path, target: Path, **more: bool) -> None:
        if isinstance(source, Path):
            raise OSError(errno.EXDEV, "another file system")
        link(source, target, **more)

    monkeypatch.setattr(os, "link", link_inside)
    with monkeypatch.context() as full:
        full.setattr(shutil, "copyfileobj", copy_half)
        assert merge(runs, "shard1", "shard2", out=tmp_path / "merged") == EXIT_NOT_WRITTEN
    assert not list(tmp_path.rglob("*.part*"))
    assert merge(runs, "shard1", "shard2", out=tmp_path / "merged") == EXIT_DONE
    assert tree(tmp_path / "merged") == tree(runs / "whole")


def test_shard_that_was_killed_is_refused_until_it_ran_again(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shards_of(runs, tmp_path)
    manifest = json.loads((folder / "shard1" / "manifest.json").read_text())
    name = manifest["logs"][-1]["id"]
    manifest["logs"][-1]["status"] = "pending"
    (folder / "shard1" / "manifest.json").write_text(json.dumps(manifest))
    (folder / "shard1" / "logs" / name / "entry.json").unlink()
    assert merge(folder, "shard1", "shard2") == EXIT_BAD_INPUT
    said = " ".join(capsys.readouterr().err.split())
    assert f"the log {name} is not done" in said
    assert "run the shard again" in said
    run_command_line(["run", str(runs / "logs"), "-d", str(folder / "shard1"), *STAGES, "--shard", "1/2"])
    assert merge(folder, "shard1", "shard2") == EXIT_DONE
    assert tree(folder / "merged") == tree(runs / "whole")


def spoil_manifest(path: Path, **changes: object) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


@pytest.mark.parametrize(
    ("spoil", "names", "code", "words"),
    [
        (None, ("shard1",), EXIT_BAD_INPUT, "1 of 2 shards are missing: 2"),
        (None, ("whole", "shard1"), EXIT_USAGE, "whole holds all logs of its run, and"),
        (None, ("shard1", "shard1", "shard2"), EXIT_USAGE, "are both shard 1/2"),
        (None, ("shard1", "logs"), EXIT_BAD_INPUT, "the folder holds no run"),
        (
            {"cwcli": "0.0.1"},
            ("shard1", "shard2"),
            EXIT_USAGE,
            f'were made by another version of cwcli: "{__version__}" and "0.0.1" hint: run the shards again',
        ),
        (
            {"pipeline": {"estimate": {"rate": 7}}},
            ("shard1", "shard2"),
            EXIT_USAGE,
            "were made by another pipeline: topic is [] and not set hint: run the shards again",
        ),
        (
            {"pipeline": {"topic": ["x" * 50]}},
            ("shard1", "shard2"),
            EXIT_USAGE,
            f'another pipeline: topic is [] and ["{"x" * 38}... (54 characters) hint: run the shards again',
        ),
        (
            {"pipeline": {}},
            ("shard1", "shard2"),
            EXIT_USAGE,
            "were made by another pipeline: topic is [] and not set hint: run the shards again",
        ),
        (
            {"run_id": "0"},
            ("shard1", "shard2"),
            EXIT_USAGE,
            'another set of options or version of the tables: "RUN_ID" and "0" hint: run the shards again',
        ),
        (
            {"tables": ["details/none"]},
            ("shard1", "shard2"),
            EXIT_BAD_INPUT,
            "tables of the run are missing or changed",
        ),
        ({"format": 99}, ("shard1", "shard2"), EXIT_BAD_INPUT, "a manifest of format 99"),
        ({"shard": {"index": 2, "count": 4}}, ("shard1", "shard2"), EXIT_USAGE, "runs in 2 and 4 parts"),
        ({"logs": [{"id": "../x"}]}, ("shard1", "shard2"), EXIT_BAD_INPUT, "is not the name of a file"),
        *(
            ({"logs": [{"id": "x", "status": "failed", "outputs": each}]}, ("shard1", "shard2"), EXIT_BAD_INPUT, words)
            for words, each in (
                ("which is not in its folder", ["../evil"]),
                ("which is not in its folder", ["logs/x/../../../evil"]),
                ("which is not in its folder", ["/etc/hostname"]),
                ("which is not in its folder", ["logs/x/.."]),
                ("which is not in its folder", "logs/x/annotated.mcap"),
                ("which is not in its folder", [["logs/x/annotated.mcap"]]),
            )
        ),
        ({"logs": [{"id": "x", "status": "failed", "n": float("nan")}]}, ("shard1", "shard2"), EXIT_BAD_INPUT, "JSON"),
        ({"logs": [{"id": "x", "status": []}]}, ("shard1", "shard2"), EXIT_BAD_INPUT, "the log x is not done"),
        ({"shard": {"index": 5, "count": 2}}, ("shard1", "shard2"), EXIT_BAD_INPUT, "which shard it is"),
        ({"shard": {"index": True, "count": 2}}, ("shard1", "shard2"), EXIT_BAD_INPUT, "which shard it is"),
        ({"shard": {"index": 2, "count": 10**12}}, ("shard1", "shard2"), EXIT_BAD_INPUT, "which shard it is"),
    ],
)
def test_what_does_not_belong_together_is_refused(
    runs: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    spoil: dict[str, object] | None,
    names: tuple[str, ...],
    code: int,
    words: str,
) -> None:
    folder = shards_of(runs, tmp_path)
    (folder / "logs").mkdir()
    shutil.copytree(runs / "whole", folder / "whole")
    if spoil is not None:
        spoil_manifest(folder / "shard2" / "manifest.json", **spoil)
    assert merge(folder, *names) == code
    words = words.replace("RUN_ID", json.loads((runs / "shard1" / "manifest.json").read_text())["run_id"])
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (folder / "merged" / "manifest.json").exists()


def test_changed_files_and_other_folders_are_refused(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shards_of(runs, tmp_path)
    assert merge(folder, "shard1", "shard2", out="shard1") == EXIT_USAGE
    (folder / "other" / "logs").mkdir(parents=True)
    assert merge(folder, "shard1", "shard2", out="other") == EXIT_NOT_WRITTEN
    (folder / "shard1" / "metrics.parquet").write_bytes(b"half")
    assert merge(folder, "shard1", "shard2") == EXIT_BAD_INPUT
    assert "are missing or changed" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("text", "environment", "shard"),
    [
        ("3/8", {}, Shard(3, 8)),
        ("auto/8", {"JOB_COMPLETION_INDEX": "0"}, Shard(1, 8)),
        ("auto/8", {"AWS_BATCH_JOB_ARRAY_INDEX": "7"}, Shard(8, 8)),
        ("auto/8", {"SLURM_ARRAY_TASK_ID": "12", "SLURM_ARRAY_TASK_MIN": "10"}, Shard(3, 8)),
        ("auto/8", {"SLURM_ARRAY_TASK_ID": "2"}, Shard(3, 8)),
    ],
)
def test_shard_is_named_or_set_by_the_array_job(text: str, environment: dict[str, str], shard: Shard) -> None:
    assert parse_shard(text, environment) == shard


@pytest.mark.parametrize("text", ["", "3", "0/8", "9/8", "-1/8", "1/0", "a/8", "1/8/2", "1/1000000", "1.0/8", "auto/8"])
def test_nonsense_is_no_shard(text: str) -> None:
    with pytest.raises(UsageError, match="--shard"):
        parse_shard(text, {})


def test_environment_without_a_number_is_refused() -> None:
    for value in ("x", "-1", "8"):
        with pytest.raises(UsageError, match="--shard"):
            parse_shard("auto/8", {"JOB_COMPLETION_INDEX": value})


def test_shards_are_all_logs_each_once() -> None:
    for count in (1, 3, 8, 20):
        parts = [Shard(k, count).select_shard_items(range(10)) for k in range(1, count + 1)]
        assert sorted(each for part in parts for each in part) == list(range(10))


def test_more_shards_than_logs(runs: Path, tmp_path: Path) -> None:
    code = run_command_line(["run", str(runs / "logs"), "-d", str(tmp_path / "s"), *STAGES, "--shard", "9/9"])
    assert code == EXIT_DONE
    assert json.loads((tmp_path / "s" / "manifest.json").read_text())["logs"] == []


@pytest.mark.parametrize(
    ("n_logs", "n_shards", "n_kills"), [(12, 3, 5), pytest.param(1000, 8, 20, marks=pytest.mark.long)]
)
def test_shards_that_are_killed_at_any_moment_and_rerun_equal_one_run(
    tmp_path: Path, n_logs: int, n_shards: int, n_kills: int
) -> None:
    """`kill -9` of one shard after another, at moments spread over the time that a shard takes."""
    (tmp_path / "logs").mkdir()
    for k in range(n_logs):
        cut(SAMPLES / "straight.mcap", tmp_path / "logs" / f"d{k:03}.mcap", start_s=0.05 * (k % 300), seconds=2.0)

    def command(out: str, *options: str) -> list[str]:
        return [sys.executable, "-m", "cwcli", "run", "logs", "-d", out, *STAGES, "--no-annotate", *options]

    environment = {**os.environ, "PYTHONPATH": str(SAMPLES.parent)}
    subprocess.run(command("whole"), check=True, cwd=tmp_path, env=environment)
    begin = time.monotonic()
    subprocess.run(command("timed", "--shard", f"1/{n_shards}"), check=True, cwd=tmp_path, env=environment)
    took_s = time.monotonic() - begin
    for k in range(n_kills):
        shard = 1 + k % n_shards
        process = subprocess.Popen(
            command(f"shard{shard}", "--shard", f"{shard}/{n_shards}"),
            cwd=tmp_path,
            env=environment,
            start_new_session=True,
        )
        with suppress(subprocess.TimeoutExpired):
            process.wait(took_s * (k + 1) / n_kills)
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    for shard in range(1, n_shards + 1):
        options = ("--shard", f"{shard}/{n_shards}")
        subprocess.run(command(f"shard{shard}", *options), check=True, cwd=tmp_path, env=environment)
    assert merge(tmp_path, *(f"shard{k}" for k in range(1, n_shards + 1))) == EXIT_DONE
    assert tree(tmp_path / "merged") == tree(tmp_path / "whole")
