"""The budget of instructions: every case has a figure with its reason, and 3 % more fails."""

from __future__ import annotations

import datetime
import json
import subprocess
from pathlib import Path

import pytest

from tests.budget import __main__ as tool
from tests.budget import baseline
from tests.budget.cases import CASES
from tests.budget.counting import CountError
from tests.budget.ledger import Ledger, Line, find_excess, read_ledger, update_lines, write_ledger

NAMES = [case.name for case in CASES]
HERE = {"python": "3.11", "counter": "valgrind-3.19.0"}
OLD = Line(1000, "2026-01-01", "Begin", "the first line")


@pytest.fixture
def ledger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Figures of 1000 instructions each in this environment, and a counter that counts what `COUNTED` says."""
    path = tmp_path / "instructions.json"
    write_ledger(Ledger(HERE, dict.fromkeys(NAMES, OLD)), path)
    monkeypatch.setattr(tool, "available_counter", lambda: "valgrind")
    monkeypatch.setattr(tool, "describe_environment", lambda counter: HERE)
    monkeypatch.setattr(tool, "read_ledger", lambda: read_ledger(path))
    monkeypatch.setattr(tool, "write_ledger", lambda found: write_ledger(found, path))
    return path


def counts(monkeypatch: pytest.MonkeyPatch, **instructions: int) -> None:
    """What each case costs from now on; 1000 where nothing is said."""
    monkeypatch.setattr(tool, "count_cases", lambda tree, names, counter: {n: instructions.get(n, 1000) for n in names})


def test_every_case_has_a_figure_with_its_date_commit_and_reason() -> None:
    found = read_ledger()
    assert list(found.lines) == NAMES
    assert found.environment["counter"].startswith("valgrind")
    for line in found.lines.values():
        assert line.instructions > 1_000_000
        assert datetime.date.fromisoformat(line.date)
        assert line.after
        assert line.reason


@pytest.mark.parametrize(("n", "excess"), [(1030, []), (1031, ["info"]), (500, [])])
def test_three_percent_more_is_too_much(n: int, excess: list[str]) -> None:
    assert find_excess({"info": n}, {"info": 1000}) == excess


def test_a_case_without_a_figure_fails() -> None:
    assert find_excess({"new": 5}, {"info": 1000}) == ["new"]


def test_the_tool_fails_and_names_the_case(
    ledger: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    counts(monkeypatch)
    assert tool.main([]) == 0
    counts(monkeypatch, warn=1031)
    assert tool.main([]) == 1
    said = capsys.readouterr()
    assert "| warn | 0.0 | +3.10 % |" in said.out
    assert said.err.startswith("error: warn: more than 3 % above its figure.")


def test_a_figure_is_raised_only_with_a_reason(ledger: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    counts(monkeypatch, warn=1200, info=1002)
    with pytest.raises(SystemExit):
        tool.main(["--write"])
    assert tool.main(["--write", "--reason", "Warns twice"]) == 0
    lines = read_ledger(ledger).lines
    assert (lines["warn"].instructions, lines["warn"].reason) == (1200, "Warns twice")
    assert lines["info"] == OLD  # it moved by less than what counts differ by
    assert tool.main([]) == 0


def test_all_lines_are_written_in_another_environment() -> None:
    stamp = Line(0, "2026-02-02", "Go on", "another compiler")
    lines = update_lines({"info": OLD}, {"info": 1001}, stamp, all_lines=True)
    assert lines == {"info": Line(1001, "2026-02-02", "Go on", "another compiler")}


@pytest.mark.parametrize(("n", "code"), [(1030, 0), (1031, 1)])
def test_in_another_environment_the_commit_of_the_figures_is_counted_too(
    ledger: Path, monkeypatch: pytest.MonkeyPatch, n: int, code: int
) -> None:
    monkeypatch.setattr(tool, "describe_environment", lambda counter: HERE | {"python": "3.14"})
    monkeypatch.setattr(tool, "ledger_commit", lambda: "0123456789")
    monkeypatch.setattr(tool, "is_unchanged", lambda commit: False)
    monkeypatch.setattr(tool, "build_commit", lambda commit, folder: folder.mkdir())

    def count(tree: Path, names: set[str], counter: object) -> dict[str, int]:
        return dict.fromkeys(names, n if tree == baseline.ROOT else 1000)

    monkeypatch.setattr(tool, "count_cases", count)
    assert tool.main(["--case", "info"]) == code


def test_without_history_nothing_is_compared_and_that_is_said(
    ledger: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(tool, "describe_environment", lambda counter: HERE | {"numpy": "99"})
    monkeypatch.setattr(tool, "ledger_commit", lambda: None)
    assert tool.main([]) == 2
    said = capsys.readouterr()
    assert "another environment (numpy)" in said.out
    assert said.err.startswith("not compared: ")


def test_without_a_counter_nothing_is_counted_and_that_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(tool, "available_counter", lambda: None)
    assert tool.main([]) == 2
    assert capsys.readouterr().err.startswith("not counted: ")


def test_a_command_that_fails_is_an_error(
    ledger: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> dict[str, int]:
        raise CountError("exit code 70: cwcli info")

    monkeypatch.setattr(tool, "count_cases", fail)
    assert tool.main([]) == 2
    assert capsys.readouterr().err == "error: exit code 70: cwcli info\n"


def test_the_commit_of_the_figures_is_found_and_a_change_since_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(baseline, "ROOT", tmp_path)
    (tmp_path / "tests/budget").mkdir(parents=True)
    (tmp_path / "cwcli").mkdir()
    (tmp_path / baseline.LEDGER_PATH).write_text(json.dumps({}))
    (tmp_path / "cwcli/code.py").write_text("")

    def git(*arguments: str) -> None:
        subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b", *arguments], check=True, cwd=tmp_path)

    git("init", "-q")
    git("add", ".")
    git("commit", "-qm", "Figures")
    commit = baseline.ledger_commit()
    assert commit is not None
    (tmp_path / "README.md").write_text("words\n")
    git("add", ".")
    git("commit", "-qm", "Words")
    assert baseline.ledger_commit() == commit
    assert baseline.is_unchanged(commit)
    (tmp_path / "cwcli/code.py").write_text("1\n")
    assert not baseline.is_unchanged(commit)
    git("checkout", "-q", "cwcli")
    (tmp_path / "cwcli/new.py").write_text("1\n")
    assert not baseline.is_unchanged(commit)
