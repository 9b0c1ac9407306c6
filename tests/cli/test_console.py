"""Style only where a terminal can show it; a name that means standard output is known as such."""

from __future__ import annotations

import io
import os
import pty
from pathlib import Path

import pytest

from cwcli.cli.console import Console, bold, closest, stdout_or_file
from cwcli.cli.report import input_table, print_result
from cwcli.pipeline.result import InputCount, Section, Summary


def test_bold_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    master, slave = pty.openpty()
    with os.fdopen(slave, "w") as terminal:
        assert bold("x", terminal) == "\x1b[1mx\x1b[0m"
        monkeypatch.setenv("NO_COLOR", "1")
        assert bold("x", terminal) == "x"
        monkeypatch.delenv("NO_COLOR")
        monkeypatch.setenv("TERM", "dumb")
        assert bold("x", terminal) == "x"
    os.close(master)
    assert bold("x", io.StringIO()) == "x"


def test_stdout_or_file(tmp_path: Path) -> None:
    new = str(tmp_path / "new.mcap")
    assert [stdout_or_file(target) for target in (None, "-", new, __file__)] == [None, "-", new, __file__]


def test_closest() -> None:
    assert closest("horizn", ["horizon", "step"]) == "did you mean horizon?"
    assert closest("zzz", ["horizon", "step"]) == "known: horizon, step"


def test_input_table_tells_the_reasons() -> None:
    counts = InputCount("/gps/fix", "ego_position", 100, 90, {"no fix": 3, "outside the gate": 7}, {"out of order": 2})
    assert input_table([counts]).split("\n") == [
        "topic     role          read  used  rejected  repaired",
        "--------  ------------  ----  ----  --------  --------",
        "/gps/fix  ego_position   100    90        10         2",
        "  /gps/fix rejected: 7 outside the gate, 3 no fix",
        "  /gps/fix repaired: 2 out of order",
    ]


def test_print_result(capsys: pytest.CaptureFixture[str]) -> None:
    summary = Summary(
        "warn",
        (Section("events", "Warnings", ("event",), ()), Section("n", "Counts", ("what", "n"), (("true", 3),))),
        notes=("a note\x07",),
    )
    print_result(Console(), summary)
    printed = capsys.readouterr()
    assert printed.out == "warn\n\nWarnings\n  none\n\nCounts\nwhat  n\n----  -\ntrue  3\n\n"
    assert printed.err == "note: a note\\x07\n"


def test_print_result_to_stderr_and_not_at_all(capsys: pytest.CaptureFixture[str]) -> None:
    summary = Summary("warn")
    print_result(Console(summary_to_stderr=True), summary)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "warn" in printed.err
    print_result(Console(quiet=True), summary)
    printed = capsys.readouterr()
    assert printed.out + printed.err == ""
