"""The progress line: only on a terminal, only after a second, gone at the end."""

from __future__ import annotations

import fcntl
import io
import os
import pty
import struct
import sys
import termios
import time
from pathlib import Path

import pytest

from cwcli.cli import progress as progress_module
from cwcli.cli.main import run_command_line
from cwcli.cli.progress import Progress
from cwcli.errors import EXIT_MISSING_SIGNAL
from tests.cli.conftest import SAMPLES
from tests.work import count_calls


@pytest.fixture(autouse=True)
def terminal_can_wipe_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")


def test_line_tells_what_how_much_and_how_long() -> None:
    progress = Progress()
    progress.begin_step("reading drive\x1b.mcap")
    assert progress.format_line(3.4) == "reading drive\\x1b.mcap (3 s)"
    progress(1, 4)
    assert progress.format_line(61.0) == "reading drive\\x1b.mcap  25 % (61 s, about 183 s left)"
    progress(0, 4)
    assert progress.format_line(61.0) == "reading drive\\x1b.mcap   0 % (61 s)"
    progress(3, 4, skipped=1)  # two in 61 s, and one more to do
    assert progress.format_line(61.0) == "reading drive\\x1b.mcap  75 % (61 s, about 30 s left)"
    progress(1, 4, skipped=1)
    assert progress.format_line(61.0) == "reading drive\\x1b.mcap  25 % (61 s)"
    progress(4, 4)
    assert progress.format_line(61.0) == "reading drive\\x1b.mcap 100 % (61 s)"
    progress.begin_step("x" * 200)
    assert progress.format_line(2.0) == "x" * 73 + " (2 s)"
    progress.begin_step("日" * 200)  # two cells each
    assert progress.format_line(2.0) == "日" * 36 + " (2 s)"
    progress(1, 4)
    assert progress.format_line(2.0, 40) == "日" * 5 + "  25 % (2 s, about 6 s left)"  # 10 + 28 cells


def test_share_of_the_work_tells_the_time_that_is_left() -> None:
    progress = Progress()
    progress.begin_step("estimate")
    progress.show_share(0.01)  # too early to tell
    assert progress.format_line(2.0) == "estimate   1 % (2 s)"
    progress.show_share(0.2)
    assert progress.format_line(5.0) == "estimate  20 % (5 s, about 20 s left)"
    progress.show_share(1.0)
    assert progress.format_line(25.0) == "estimate 100 % (25 s)"


def test_a_long_name_is_no_more_work_than_a_short_one() -> None:
    """A name of a megabyte, as a log may hold one, against one that hardly fits."""
    progress = Progress()
    progress._what = "é" * 1_000_000
    lines = []
    n_calls = count_calls(lambda: lines.append(progress.format_line(3.0, 80)))
    assert lines == ["é" * 73 + " (3 s)"]
    progress._what = "é" * 80
    assert abs(n_calls - count_calls(lambda: progress.format_line(3.0, 80))) < 10


def test_nothing_is_drawn_without_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress_module, "PROGRESS_DELAY_S", 0.0)
    monkeypatch.setattr(progress_module, "PROGRESS_REFRESH_S", 0.01)
    drawn = io.StringIO()
    monkeypatch.setattr(sys, "stderr", drawn)
    with Progress() as progress:
        progress.begin_step("working")
        time.sleep(0.05)
    assert drawn.getvalue() == ""


def drawn_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, *, show_after_s: float, quiet: bool = False, n_columns: int = 0
) -> str:
    """What a terminal gets from a step of 0.2 s; one of 0 columns does not know how many it has."""
    monkeypatch.setattr(progress_module, "PROGRESS_DELAY_S", show_after_s)
    monkeypatch.setattr(progress_module, "PROGRESS_REFRESH_S", 0.02)
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, n_columns, 0, 0))
    with os.fdopen(slave, "w") as terminal:
        monkeypatch.setattr(sys, "stderr", terminal)
        with Progress(quiet=quiet) as progress:
            progress.begin_step("working")
            time.sleep(0.2)
        terminal.write("end")
        terminal.flush()
        shown = ""
        while not shown.endswith("end"):
            shown += os.read(master, 4096).decode()
    os.close(master)
    return shown


def test_line_is_drawn_on_a_terminal_and_wiped(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = drawn_on_a_terminal(monkeypatch, show_after_s=0.0)
    assert shown.startswith("\rworking (0 s)\x1b[K")
    assert shown.endswith("\r\x1b[Kend")


def test_short_work_draws_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert drawn_on_a_terminal(monkeypatch, show_after_s=5.0) == "end"


def test_quiet_draws_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert drawn_on_a_terminal(monkeypatch, show_after_s=0.0, quiet=True) == "end"


def test_a_narrow_terminal_gets_a_line_that_does_not_wrap(monkeypatch: pytest.MonkeyPatch) -> None:
    assert drawn_on_a_terminal(monkeypatch, show_after_s=0.0, n_columns=10).startswith("\rwor (0 s)\x1b[K")


def test_a_terminal_that_can_not_wipe_a_line_gets_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "dumb")
    assert drawn_on_a_terminal(monkeypatch, show_after_s=0.0) == "end"


def test_import_and_export_name_their_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    steps: list[str] = []
    monkeypatch.setattr(Progress, "begin_step", lambda self, what: steps.append(what))
    table = tmp_path / "drive.csv"
    table.write_text("\n".join(["t,lat,lon", *(f"{k / 10},{48 + k * 1e-5:.7f},11" for k in range(50))]))
    assert run_command_line(["import", str(table), "-o", str(tmp_path / "log.mcap")]) == 0
    log = str(SAMPLES / "straight.mcap")  # it has no states to export, which is found out later
    assert run_command_line(["export", log, "-o", str(tmp_path / "ego.tum")]) == EXIT_MISSING_SIGNAL
    assert steps == [f"import {table}", f"export {log}"]
    assert "\r" not in "".join(capsys.readouterr())  # nothing is drawn into a pipe
