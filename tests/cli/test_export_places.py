"""Exports and plots in odd places: files that exist, closed pipes, full disks, no locale, narrow terminals."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import resource
import struct
import subprocess
import sys
import termios
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from cwcli.cli.commands.export import EXPORT_FORMATS, TABLE_FORMATS
from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_NOT_WRITTEN, EXIT_PIPE_CLOSED, EXIT_USAGE
from cwcli.export.track_formats import TRACK_FORMATS
from cwcli.output import PLOT_FILE_FORMATS
from cwcli.report import plots
from tests.cli import rewritten_logs
from tests.cli.conftest import ROOT, SAMPLES

ID = "Kühl-日本"
VEHICLE = f"{ID}\x1b[31m"
"""Its escape sequence is not for terminals."""
NO_LOCALE = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "NO_COLOR": "1"}
MOST_BYTES = 4096
"""That a file may hold where the disk is full: less than any export."""
TEXTS = tuple(name for name, each in TRACK_FORMATS.items() if each.is_text) + TABLE_FORMATS[:1]
EXPORTS = {
    name: ["--format", name] if name == "ros2" else ["--format", name, "--what", "remote"] for name in EXPORT_FORMATS
}
COMMANDS = {f"export-{name}": ("export", name, given) for name, given in EXPORTS.items()} | {
    f"plot-{name}-{form}": ("plot", form, ["--what", name])
    for name in plots.PLOT_NAMES
    for form in PLOT_FILE_FORMATS
    if name != "lane"  # the log has no camera
}
COMMANDS["view"] = ("view", "rrd", [])
NAMES = [pytest.param(name, marks=pytest.mark.peer("rerun")) if name == "view" else name for name in COMMANDS]


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The intersection with all results; the other vehicle's id is no ASCII."""
    from matplotlib import font_manager  # writes its cache, which plots on a full disk could not

    assert font_manager.fontManager.ttflist
    folder = tmp_path_factory.mktemp("annotated")
    before = SAMPLES / "intersection.mcap"
    told = json.dumps(VEHICLE)[1:-1].encode()
    name = rewritten_logs.of("/v2x/bsm", lambda each: replace(each, data=each.data.replace(b"d9583520", told)))
    rewritten_logs.write(folder / "drive.mcap", map(name, rewritten_logs.read(before)))
    assert run_command_line(["run", str(folder / "drive.mcap"), "-o", str(folder / "annotated.mcap"), "--quiet"]) == 0
    return folder / "annotated.mcap"


def by_itself(folder: Path, *arguments: str | Path, **settings: Any) -> subprocess.CompletedProcess[bytes]:
    """Run cwcli by itself in a folder."""
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **settings}
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | streams.pop("env", {})
    command = [sys.executable, "-m", "cwcli", *map(str, arguments)]
    return subprocess.run(command, check=False, cwd=folder, env=environment, timeout=600, **streams)


@pytest.mark.parametrize("name", NAMES)
def test_a_file_that_exists_is_kept_unless_it_is_forced(
    annotated: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command, form, given = COMMANDS[name]
    target = tmp_path / f"Straße-{ID}.{form}"
    target.write_bytes(b"mine")
    arguments = [command, str(annotated), *given, "-o", str(target), "--quiet"]
    assert run_command_line(arguments) == EXIT_NOT_WRITTEN
    assert capsys.readouterr().err.startswith(f"error: {target}: the file exists\n")
    assert target.read_bytes() == b"mine"
    assert run_command_line([*arguments, "--force"]) == 0
    assert len(target.read_bytes()) > MOST_BYTES
    assert [*tmp_path.iterdir()] == [target]


@pytest.mark.parametrize("form", EXPORTS)
def test_a_pipe_that_nobody_reads_ends_an_export_quietly(annotated: Path, tmp_path: Path, form: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = by_itself(tmp_path, "export", annotated, *EXPORTS[form], "-o", "-", "--quiet", stdout=writer)
    os.close(writer)
    assert (done.returncode, done.stderr) == (EXIT_PIPE_CLOSED, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize("form", EXPORTS)
def test_a_full_disk_behind_stdout_is_one_line(annotated: Path, tmp_path: Path, form: str) -> None:
    with Path("/dev/full").open("wb") as full:
        done = by_itself(tmp_path, "export", annotated, *EXPORTS[form], "-o", "-", "--quiet", stdout=full)
    assert (done.returncode, done.stderr) == (EXIT_NOT_WRITTEN, b"error: <stdout>: no space is left on the disk\n")


@pytest.mark.parametrize("name", [each for each in NAMES if "plot" not in str(each) or "motion" in str(each)])
def test_a_full_disk_leaves_no_file(annotated: Path, tmp_path: Path, name: str) -> None:
    command, form, given = COMMANDS[name]
    folder = tmp_path / "full"
    folder.mkdir()
    full = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (MOST_BYTES, MOST_BYTES))
    done = by_itself(folder, command, annotated, *given, "-o", f"x.{form}", "--quiet", preexec_fn=full)
    assert done.returncode == EXIT_NOT_WRITTEN, done.stderr
    where = ".*/trace.mcap" if form == "osi" else f"x.{form}"  # a trace is made in the temporary folder first
    assert re.fullmatch(f"error: {where}: the file would be larger than is allowed\n", done.stderr.decode())
    assert [*folder.iterdir()] == []


@pytest.mark.parametrize("form", EXPORTS)
def test_without_a_locale_the_bytes_are_the_same(annotated: Path, tmp_path: Path, form: str) -> None:
    """In a file and in a pipe, whatever encoding the terminal would have."""
    target = tmp_path / f"{ID}.{form}"
    arguments: list[str | Path] = ["export", annotated, *EXPORTS[form], "-o"]
    done = by_itself(tmp_path, *arguments, target.name, env=NO_LOCALE | {"COLUMNS": "20"})
    assert done.returncode == 0, done.stderr
    assert (done.stdout + done.stderr).isascii() and b"\x1b" not in done.stdout + done.stderr
    assert by_itself(tmp_path, *arguments, "with.any").returncode == 0
    made = target.read_bytes()
    assert made == (tmp_path / "with.any").read_bytes()
    if form in {"csv", "gpx", "kml", "parquet"}:
        assert ID.encode() in made
    assert by_itself(tmp_path, *arguments, "-", env=NO_LOCALE).stdout == made


@pytest.mark.parametrize("form", TEXTS)
def test_a_narrow_terminal_gets_the_text_as_it_is(annotated: Path, tmp_path: Path, form: str) -> None:
    expected = by_itself(tmp_path, "export", annotated, *EXPORTS[form]).stdout
    code, shown = on_a_terminal(20, "export", annotated, *EXPORTS[form])
    assert (code, shown.replace(b"\r\n", b"\n")) == (0, expected.replace(b"\x1b", b"\\x1b"))


@pytest.mark.parametrize("form", sorted({*EXPORTS} - {*TEXTS}))
def test_a_terminal_gets_no_binary_data(annotated: Path, form: str) -> None:
    code, shown = on_a_terminal(20, "export", annotated, *EXPORTS[form], "-o", "-")
    assert code == EXIT_USAGE
    assert b"refusing to write binary data to the terminal" in b" ".join(shown.split())  # wrapped


def on_a_terminal(n_columns: int, *arguments: str | Path) -> tuple[int, bytes]:
    """The exit code, and what a terminal of so many columns gets."""
    pid, terminal = pty.fork()
    if pid == 0:
        fcntl.ioctl(1, termios.TIOCSWINSZ, struct.pack("HHHH", 24, n_columns, 0, 0))
        os.environ |= {"PYTHONPATH": str(ROOT), "TERM": "xterm"}
        os.execv(sys.executable, [sys.executable, "-m", "cwcli", *map(str, arguments)])
    shown = b""
    try:
        while more := os.read(terminal, 65536):
            shown += more
    except OSError:  # the other end is closed
        pass
    os.close(terminal)
    _, status = os.waitpid(pid, 0)
    return os.waitstatus_to_exitcode(status), shown


def test_json_without_a_locale_is_json(annotated: Path, tmp_path: Path) -> None:
    done = by_itself(tmp_path, "export", annotated, "-o", f"{ID}.csv", "--json", env=NO_LOCALE)
    name = json.loads(done.stdout)["output"]  # as Python keeps the bytes of a name in an unknown encoding
    assert os.fsencode(name).decode() == f"{ID}.csv" and (tmp_path / f"{ID}.csv").exists()
