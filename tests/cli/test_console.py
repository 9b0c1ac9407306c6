"""Style only where a terminal can show it; a name that means standard output is known as such."""

from __future__ import annotations

import io
import os
import pty
from pathlib import Path

import pytest

from cwcli.cli.console import Console, closest_names_hint, format_bold, replace_stdout_path_by_dash
from cwcli.cli.report import format_input_table, print_stage_summary
from cwcli.pipeline.result import InputMessageCount, StageSummary, SummaryTable


def test_bold_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    master, slave = pty.openpty()
    with os.fdopen(slave, "w") as terminal:
        assert format_bold("x", terminal) == "\x1b[1mx\x1b[0m"
        monkeypatch.setenv("NO_COLOR", "1")
        assert format_bold("x", terminal) == "x"
        monkeypatch.delenv("NO_COLOR")
        monkeypatch.setenv("TERM", "dumb")
        assert format_bold("x", terminal) == "x"
    os.close(master)
    assert format_bold("x", io.StringIO()) == "x"


def test_stdout_or_file(tmp_path: Path) -> None:
    new = str(tmp_path / "new.mcap")
    assert [replace_stdout_path_by_dash(target) for target in (None, "-", new, __file__)] == [None, "-", new, __file__]


def test_closest() -> None:
    assert closest_names_hint("horizn", ["horizon", "step"]) == "did you mean horizon?"
    assert closest_names_hint("zzz", ["horizon", "step"]) == "known: horizon, step"


def test_input_table_tells_the_reasons() -> None:
    counts = InputMessageCount(
        "/gps/fix", "ego_position", 100, 90, {"no fix": 3, "outside the gate": 7}, {"out of order": 2}
    )
    assert format_input_table([counts]).split("\n") == [
        "topic     used as       read  used  rejected  repaired",
        "--------  ------------  ----  ----  --------  --------",
        "/gps/fix  ego_position   100    90        10         2",
        "  /gps/fix rejected: 7 outside the gate, 3 no fix",
        "  /gps/fix repaired: 2 out of order",
    ]


def test_print_result(capsys: pytest.CaptureFixture[str]) -> None:
    summary = StageSummary(
        "warn",
        (
            SummaryTable("events", "Warnings", ("event",), ()),
            SummaryTable("n", "Counts", ("what", "n"), (("true", 3),)),
        ),
        notes=("a note\x07",),
    )
    print_stage_summary(Console(), summary)
    printed = capsys.readouterr()
    assert printed.out == "warn\n\nWarnings\n  none\n\nCounts\nwhat  n\n----  -\ntrue  3\n\n"
    assert printed.err == "note: a note\\x07\n"


def test_print_result_to_stderr_and_not_at_all(capsys: pytest.CaptureFixture[str]) -> None:
    summary = StageSummary("warn")
    print_stage_summary(Console(summary_to_stderr=True), summary)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "warn" in printed.err
    print_stage_summary(Console(quiet=True), summary)
    printed = capsys.readouterr()
    assert printed.out + printed.err == ""
