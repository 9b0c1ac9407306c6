"""Which logs a run has: files, patterns, URLs; and copies of remote ones."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import NoReturn

import fsspec
import pytest

from cwcli.errors import InputError, OutputError, UsageError
from cwcli.fleet.inputs import expand_sources, temporary_local_copy
from cwcli.logs.format.records import MCAP_MAGIC
from cwcli.logs.read.read_bounds import ReadBounds
from cwcli.logs.read.remote import is_remote_url


@pytest.fixture
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("logs/b.mcap", "logs/a.mcap", "logs/deep/c.mcap", "logs/note.txt", "logs/d[1].mcap"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(name.encode())
    return tmp_path


def sources(*arguments: str) -> list[str]:
    return [source for source, _ in expand_sources(arguments)]


def test_patterns_are_expanded_and_sorted(logs: Path) -> None:
    assert sources("logs/[ab].mcap") == ["logs/a.mcap", "logs/b.mcap"]
    assert sources("logs/**/*.mcap") == ["logs/a.mcap", "logs/b.mcap", "logs/d[1].mcap", "logs/deep/c.mcap"]


def test_a_file_of_that_very_name_is_no_pattern(logs: Path) -> None:
    assert sources("logs/d[1].mcap") == ["logs/d[1].mcap"]


def test_file_urls_are_files(logs: Path) -> None:
    ((source, path),) = expand_sources([f"file://{logs}/logs/a.mcap"])
    assert not is_remote_url(source)
    assert path == str((logs / "logs/a.mcap").resolve())


def test_a_log_that_is_named_twice_is_one(logs: Path) -> None:
    (logs / "link.mcap").symlink_to(logs / "logs/a.mcap")
    assert sources("logs/a.mcap", "logs/*.mcap", "./logs/b.mcap", "link.mcap") == [
        "logs/a.mcap",
        "logs/b.mcap",
        "logs/d[1].mcap",
    ]


@pytest.mark.parametrize("folder", ["logs", "logs/", "./logs", "link"])
def test_a_folder_is_the_logs_in_it(logs: Path, folder: str) -> None:
    """As a recording of rosbag2 is one; what lies deeper takes a pattern."""
    (logs / "link").symlink_to(logs / "logs")
    (logs / "logs/E.MCAP").touch()
    (logs / "logs/f.mcap").mkdir()
    assert sources(folder) == [f"{folder.rstrip('/')}/{name}" for name in ("E.MCAP", "a.mcap", "b.mcap", "d[1].mcap")]
    assert sources(f"file://{logs}/logs")[1:] == [f"file://{logs}/logs/{name}.mcap" for name in ("a", "b", "d[1]")]


def test_the_current_folder_is_the_logs_in_it(logs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(logs / "logs/deep")
    assert [Path(name) for name in sources(".")] == [Path("c.mcap")]


@pytest.mark.parametrize(
    ("folder", "hint"), [("empty", "name a file, a folder"), ("above", "cwcli run 'above/\\*/\\*.mcap'")]
)
def test_a_folder_without_logs_is_refused(logs: Path, folder: str, hint: str) -> None:
    (logs / "empty").mkdir()
    (logs / "above/bag").mkdir(parents=True)
    (logs / "above/bag/bag_0.mcap").touch()
    with pytest.raises(UsageError, match="the folder holds no log") as caught:
        sources(folder)
    assert re.search(hint, caught.value.hint)


def test_a_folder_that_can_not_be_listed(logs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path) -> NoReturn:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "scandir", refuse)
    with pytest.raises(InputError, match="can't be listed: Permission denied"):
        sources("logs")


@pytest.mark.parametrize("argument", ["", "none/*.mcap", "-", "memory://nothing/*.mcap", "nosuch://a/b.mcap"])
def test_refusals(logs: Path, argument: str) -> None:
    with pytest.raises(UsageError):
        expand_sources([argument])


def test_results_are_no_inputs(logs: Path) -> None:
    """A run again over the same pattern would take its own results; with --force it would remove its own inputs."""
    results = [str(logs / "logs/deep")]
    assert expand_sources(["logs/**/*.mcap"], results) == expand_sources(["logs/*.mcap"])
    (logs / "link.mcap").symlink_to(logs / "logs/deep/c.mcap")
    for argument in ("logs/deep/c.mcap", "logs/deep/*", "link.mcap", f"file://{logs}/logs/deep/c.mcap"):
        with pytest.raises(UsageError, match="is in the output folder"):
            expand_sources(["logs/a.mcap", argument], results)


def test_a_file_that_is_not_there_is_left_to_its_worker(logs: Path) -> None:
    assert sources("gone.mcap") == ["gone.mcap"]


def test_memory_urls(tmp_path: Path) -> None:
    system = fsspec.filesystem("memory")
    for name in ("b", "a"):
        system.pipe_file(f"/drives/{name}.mcap", MCAP_MAGIC + name.encode())
    assert sources("memory://drives/*.mcap") == ["memory:///drives/a.mcap", "memory:///drives/b.mcap"]
    assert sources("memory://drives/") == sources("memory://drives/*.mcap")
    with temporary_local_copy("memory:///drives/a.mcap", tmp_path / "scratch", ReadBounds()) as path:
        assert path.read_bytes() == MCAP_MAGIC + b"a"
        assert path.parent == tmp_path / "scratch"
    assert list((tmp_path / "scratch").iterdir()) == []


def test_a_copy_goes_when_its_work_fails(tmp_path: Path) -> None:
    fsspec.filesystem("memory").pipe_file("/drives/a.mcap", MCAP_MAGIC)
    with pytest.raises(RuntimeError), temporary_local_copy("memory:///drives/a.mcap", tmp_path, ReadBounds()):
        raise RuntimeError
    with (
        pytest.raises(InputError, match="can't be read"),
        temporary_local_copy("memory:///drives/gone.mcap", tmp_path, ReadBounds()),
    ):
        pass
    with (
        pytest.raises(InputError, match="more than 0 GB"),
        temporary_local_copy("memory:///drives/a.mcap", tmp_path, ReadBounds(max_input_bytes=0)),
    ):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_copy_without_a_place(tmp_path: Path) -> None:
    fsspec.filesystem("memory").pipe_file("/drives/a.mcap", MCAP_MAGIC)
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError), temporary_local_copy("memory:///drives/a.mcap", tmp_path / "file", ReadBounds()):
        pass
