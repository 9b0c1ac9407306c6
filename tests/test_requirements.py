"""The table of what tests need names every file that needs more than `[test]`, and no test of a default run does."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests import requirements
from tests.requirements import (
    FOLDER,
    LONG_FOLDERS,
    NEEDED,
    QUICK,
    describe_left_out,
    find_missing,
    is_available,
    is_long,
)

ROOT = FOLDER.parent
FOUND_OTHERWISE = {"Cython", "grpc_tools", "s3fs", "valgrind"}
"""Needs that a file has through `setup.py`, a tool, fsspec or the counter of instructions."""
PEER_FILES = {path.relative_to(FOLDER).as_posix() for path in (FOLDER / "peers").glob("test_*.py")}


def text_and_imports(path: Path) -> tuple[str, set[str]]:
    """A file's text, and the top names of the modules that it imports, itself or through helpers in its folder."""
    text = path.read_text(encoding="utf-8")
    found = set()
    for node in ast.walk(ast.parse(text)):
        names = [each.name for each in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module]
        for name in names:
            found.add(name.partition(".")[0])
            if name.startswith("tests.peers."):
                found |= text_and_imports(FOLDER / "peers" / f"{name.rpartition('.')[2]}.py")[1]
    return text, found


def test_every_peer_has_a_row_and_every_row_a_file() -> None:
    assert {name for name in NEEDED if name.startswith("peers/")} == PEER_FILES
    assert all((FOLDER / name).exists() for name in NEEDED)


@pytest.mark.parametrize("name", NEEDED)
def test_a_row_names_what_its_file_imports_or_runs(name: str) -> None:
    text, imported = text_and_imports(FOLDER / name)
    for need in NEEDED[name]:
        assert need in imported or need in text or need in FOUND_OTHERWISE


def test_what_is_not_installed_is_not_collected_and_said_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(NEEDED, "peers/test_viewers.py", ("no_such_module",))
    monkeypatch.setattr(requirements, "is_available", lambda name: name != "no_such_module")
    assert find_missing(FOLDER / "peers" / "test_viewers.py") == ("no_such_module",)
    assert find_missing(FOLDER / "cli" / "test_main.py") == ()
    line = describe_left_out()
    assert line is not None
    assert line.startswith("1 test files are not collected, as these are not installed: no_such_module")
    assert "\n" not in line


def test_availability_is_that_of_modules_programs_and_npm_packages(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "@mcap" / "core").mkdir(parents=True)
    monkeypatch.setattr(requirements, "NPM_FOLDER", tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert [is_available(name) for name in ("json", "no_such_module", "node", "@mcap/core", "@mcap/none")] == [
        True,
        False,
        False,
        True,
        False,
    ]


def test_long_folders_and_quick_files_are_there() -> None:
    assert all((FOLDER / name).is_dir() for name in LONG_FOLDERS)
    assert all((FOLDER / name).is_file() for name in QUICK)
    assert is_long(FOLDER / "recipes" / "test_map.py")
    assert is_long(FOLDER / "cli" / "test_report.py")
    assert not is_long(FOLDER / QUICK[0])
    assert not is_long(FOLDER / "unit" / "test_registry.py")


CASES = """
import pytest

@pytest.mark.long
def test_long(): pass

@pytest.mark.peer("no_such_module")
def test_peer_that_is_missing(): pass

@pytest.mark.peer("json")
def test_peer(): pass

def test_plain(): pass

def test_random(tries): assert tries(1, 2) == 1
"""


@pytest.mark.parametrize(
    ("options", "collected"),
    [
        ([], {"test_peer", "test_plain", "test_random"}),
        (["--long"], {"test_long", "test_peer", "test_plain", "test_random"}),
        (["--rest"], {"test_peer"}),
        (["--rest", "--long"], {"test_long", "test_peer", "test_random"}),
    ],
    ids=["default", "long", "rest", "rest-long"],
)
def test_a_run_collects_what_its_options_ask_for(tmp_path: Path, options: list[str], collected: set[str]) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "test_cases.py").write_text(CASES)
    command = [sys.executable, "-m", "pytest", "-p", "tests.conftest", "-p", "no:cacheprovider", "--collect-only"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    environment.pop("PYTEST_XDIST_WORKER", None)
    done = subprocess.run(
        [*command, "-q", "--rootdir", tmp_path, tmp_path, *options],
        check=False, capture_output=True, text=True, cwd=tmp_path, env=environment, timeout=600,
    )  # fmt: skip
    assert {line.rpartition("::")[2] for line in done.stdout.splitlines() if "::" in line} == collected, done.stdout


def test_a_folder_that_is_named_is_collected_although_it_is_long() -> None:
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--collect-only", "-q"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    file = "tests/cli/test_leftovers.py"
    done = subprocess.run(
        [*command, file], check=False, capture_output=True, text=True, cwd=ROOT, env=environment, timeout=600
    )
    assert file in done.stdout


def test_processor_seconds_of_each_file_are_printed(tmp_path: Path) -> None:
    (tmp_path / "test_busy.py").write_text("def test_busy(): sum(range(10**7))\n")
    command = [sys.executable, "-m", "pytest", "-p", "tests.conftest", "-p", "no:cacheprovider", "--cpu", "-q"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    environment["PYTHONPATH"] = str(ROOT)
    done = subprocess.run(
        [*command, "--rootdir", tmp_path, tmp_path],
        check=False, capture_output=True, text=True, cwd=tmp_path, env=environment, timeout=600,
    )  # fmt: skip
    [line] = [line for line in done.stdout.splitlines() if line.endswith("  test_busy.py")]
    assert float(line.split()[0]) > 0.0, done.stdout
