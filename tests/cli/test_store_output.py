"""Runs and merges into an object store: the same files as on this machine, whole, and continued after a failure."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fsspec
import pytest
from fsspec.implementations.memory import MemoryFileSystem

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BAD_INPUT, EXIT_DONE, EXIT_NOT_WRITTEN, EXIT_USAGE
from cwcli.fleet.remote_folder import make_working_folder, remove_working_folder
from tests.cli.conftest import SAMPLES
from tests.cli.fleet_logs import cut, tree

OPTIONS = ("--stage", "estimate", "--jobs", "1")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two short logs and a damaged one, and a run over them on this machine."""
    folder = tmp_path_factory.mktemp("store")
    (folder / "logs").mkdir()
    for k in range(2):
        cut(SAMPLES / "straight.mcap", folder / "logs" / f"drive_{k}.mcap", start_s=k, seconds=2.0)
    (folder / "logs" / "damaged.mcap").write_bytes((folder / "logs" / "drive_0.mcap").read_bytes()[:-20])
    assert run(folder, str(folder / "whole")) == EXIT_BAD_INPUT
    return folder


@pytest.fixture
def bucket() -> str:
    """The URL of an empty folder in a store that lives in the memory of this process."""
    store = fsspec.filesystem("memory")
    if store.exists("/bucket"):
        store.rm("/bucket", recursive=True)
    return "memory://bucket/out"


@pytest.fixture
def working_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which working folders are made."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


def run(logs: Path, directory: str, *options: str) -> int:
    return run_command_line(["run", str(logs / "logs"), "-d", directory, *OPTIONS, "-q", *options])


def tree_of_store(target: Path) -> Any:
    """The files in the store, copied to a folder of this machine, as `tree` gives them."""
    fsspec.filesystem("memory").get("/bucket/out/", f"{target}/", recursive=True)
    return tree(target)


def test_a_run_into_a_store_writes_what_one_on_this_machine_writes(
    logs: Path, bucket: str, working_folders: Path, tmp_path: Path
) -> None:
    assert run(logs, bucket) == EXIT_BAD_INPUT  # of the damaged log
    assert tree_of_store(tmp_path / "copy") == tree(logs / "whole")
    assert [*working_folders.iterdir()] == []


def test_a_repeated_run_sends_only_what_is_new(
    logs: Path, bucket: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(logs, bucket)
    sent = record_sent_files(monkeypatch)
    run(logs, bucket)
    assert [name for name in sent if name.endswith(".mcap")] == []
    assert {name for name in sent if "/logs/" in name} == {"/bucket/out/logs/damaged/entry.json"}  # it is tried again
    assert tree_of_store(tmp_path / "again") == tree(logs / "whole")
    sent.clear()
    run(logs, bucket, "--force")
    assert sum(name.endswith(".mcap") for name in sent) == 2
    assert tree_of_store(tmp_path / "forced") == tree(logs / "whole")


def record_sent_files(monkeypatch: pytest.MonkeyPatch, fail: Callable[[int], bool] = lambda n: False) -> list[str]:
    """Record the files that are sent; `fail` tells by the number of files before whether the store dies."""
    sent: list[str] = []
    put_file = MemoryFileSystem.put_file

    def put(self: MemoryFileSystem, local: str, remote: str, **options: Any) -> None:
        if fail(len(sent)):
            raise PermissionError("access denied")
        put_file(self, local, remote, **options)
        sent.append(remote)

    monkeypatch.setattr(MemoryFileSystem, "put_file", put)
    return sent


@pytest.mark.parametrize("n_sent", range(0, 12, 2))
def test_a_run_goes_on_after_a_store_that_dies(
    n_sent: int,
    logs: Path,
    bucket: str,
    working_folders: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with monkeypatch.context() as broken:
        sent = record_sent_files(broken, lambda n: n == n_sent)
        assert run(logs, bucket) == EXIT_NOT_WRITTEN
    message = " ".join(capsys.readouterr().err.split())
    assert "memory://bucket/out/" in message
    assert "it can't be written: the server does not allow it" in message
    assert len(sent) == n_sent
    assert [*working_folders.iterdir()] == []
    assert run(logs, bucket) == EXIT_BAD_INPUT
    assert tree_of_store(tmp_path / "copy") == tree(logs / "whole")


def test_the_first_file_that_a_run_sends_is_the_manifest(
    logs: Path, bucket: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A store that denies is found out before any log is processed; the last file is the whole manifest."""
    sent = record_sent_files(monkeypatch)
    run(logs, bucket)
    assert (sent[0], sent[-1]) == ("/bucket/out/manifest.json", "/bucket/out/manifest.json")
    entry = sent.index("/bucket/out/logs/drive_0/entry.json")
    assert sent.index("/bucket/out/logs/drive_0/annotated.mcap") < entry


def test_other_files_beside_the_run_stay(logs: Path, bucket: str, tmp_path: Path) -> None:
    store = fsspec.filesystem("memory")
    store.pipe_file("/bucket/out/notes/readme.txt", b"of the user")
    run(logs, bucket)
    run(logs, bucket, "--force")
    assert store.cat_file("/bucket/out/notes/readme.txt") == b"of the user"


def test_results_of_another_version_are_refused(logs: Path, bucket: str, capsys: pytest.CaptureFixture[str]) -> None:
    fsspec.filesystem("memory").pipe_file("/bucket/out/manifest.json", b'{"cwcli": "0.0.1", "format": 1, "logs": []}')
    assert run(logs, bucket) == EXIT_NOT_WRITTEN
    assert "a manifest of format 1" in " ".join(capsys.readouterr().err.split())


def test_shards_are_merged_into_a_store(logs: Path, bucket: str, tmp_path: Path) -> None:
    for k in (1, 2):
        run(logs, f"memory://bucket/shard{k}", "--shard", f"{k}/2")
    code = run_command_line(["merge", "memory://bucket/shard1", "memory://bucket/shard2", "-d", bucket, "-q"])
    assert code == EXIT_DONE
    assert tree_of_store(tmp_path / "copy") == tree(logs / "whole")


@pytest.mark.parametrize(
    ("directory", "options", "message"),
    [
        ("https://host/out", (), "a web server has no folders"),
        ("memory://bucket/out", ("--ray", "auto"), "a Ray cluster does not write into a store"),
        ("ftp://host/out", (), "can't be read from URLs that begin with 'ftp://'"),
    ],
)
def test_what_is_no_store_is_refused(
    directory: str, options: tuple[str, ...], message: str, logs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(logs, directory, *options) == EXIT_USAGE
    assert message in " ".join(capsys.readouterr().err.split())


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such locks")
def test_a_working_folder_is_removed_by_the_next_run_if_its_own_was_killed(working_folders: Path) -> None:
    code = f"import tempfile; tempfile.tempdir = {str(working_folders)!r}\n" + (
        "from cwcli.fleet.remote_folder import make_working_folder; print(make_working_folder(), flush=True); input()"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        theirs = Path(other.stdout.readline().decode().strip())
        (theirs / "log").write_bytes(b"half")
        ours = make_working_folder()
        assert {*working_folders.iterdir()} == {theirs.parent, ours.parent}  # one that is in use is left alone
        other.kill()
    remove_working_folder(make_working_folder())
    assert {*working_folders.iterdir()} == {ours.parent}
    remove_working_folder(ours)
    assert [*working_folders.iterdir()] == []
