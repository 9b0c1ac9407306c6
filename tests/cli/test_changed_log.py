"""Every command over a log that another program replaces, overwrites or cuts meanwhile: 0 or 3, never a mixture."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cwcli.cli.commands.run import gather_default_options
from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BAD_INPUT
from cwcli.fleet.plan import LogTask
from cwcli.fleet.worker import process_log
from cwcli.input import InputFile
from cwcli.output_stream import OutputStream

ROOT = Path(__file__).parents[2]
SEED = 20
N_MOMENTS = 12

COMMANDS = {
    "info": ["info", "LOG"],
    "estimate": ["estimate", "LOG", "--replace", "-o", "OUT/out.mcap", "--metrics", "OUT/out.csv"],
    "estimate a redirected file": ["estimate", "-", "--replace", "-o", "OUT/out.mcap"],
    "predict": ["predict", "LOG", "--replace", "-o", "OUT/out.mcap"],
    "warn": ["warn", "LOG", "--metrics", "OUT/out.csv"],
    "run": ["run", "LOG", "--replace", "-o", "OUT/out.mcap", "--metrics-dir", "OUT"],
    "evaluate": ["evaluate", "LOG", "--metrics", "OUT/out.csv", "--junit", "OUT/out.xml"],
    "compare": ["compare", "LOG", "OTHER", "--markdown", "OUT/out.md"],
    "report": ["report", "LOG", "-o", "OUT/out.html"],
    "layout": ["layout", "LOG", "-o", "OUT/out.json"],
}


def replace(path: Path, content: bytes) -> None:
    other = path.with_name("other.mcap")
    other.write_bytes(content)
    other.rename(path)


def overwrite(path: Path, content: bytes) -> None:
    with path.open("r+b") as file:
        file.write(content)


def shorten(path: Path, content: bytes) -> None:
    os.truncate(path, 1000)


CHANGES = (replace, overwrite, shorten)
CASES = [
    *((command, change, "middle") for command in COMMANDS for change in CHANGES),
    *(("estimate", change, moment) for change in CHANGES for moment in ("first", "last")),
]
CASES.remove(("estimate a redirected file", replace, "middle"))  # what is open stays as it is


@pytest.fixture
def log(predicted: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(predicted, tmp_path / "log.mcap"))


def arguments_of(command: str, log: Path, predicted: Path) -> list[str]:
    names = {"LOG": str(log), "OTHER": str(predicted)}
    out = log.with_name("out")
    out.mkdir()
    return [names.get(each, each.replace("OUT", str(out))) for each in COMMANDS[command]]


@pytest.mark.parametrize(("command", "change", "moment"), CASES)
def test_a_change_at_a_read_is_exit_3_and_no_file(
    log: Path,
    predicted: Path,
    command: str,
    change: Callable[[Path, bytes], None],
    moment: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The log is changed right before one of its reads; how many there are is counted first."""
    read = InputFile.__getitem__
    reads = 0
    change_at = 0
    content = predicted.read_bytes()

    def counted(file: InputFile, place: slice) -> memoryview:
        nonlocal reads
        if file.state[1] == inode:
            reads += 1
            if reads == change_at:
                change(log, content[::-1])
        return read(file, place)

    monkeypatch.setattr(InputFile, "__getitem__", counted)
    arguments = arguments_of(command, log, predicted)
    out = log.with_name("out")
    inode = log.stat().st_ino

    def done() -> int:
        with log.open("rb") as file:
            monkeypatch.setattr("sys.stdin", file)
            return run_command_line(arguments)

    assert done() == 0
    shutil.rmtree(out)
    out.mkdir()
    change_at = {"first": 2, "middle": reads // 2, "last": reads}[moment]
    reads = 0
    capsys.readouterr()
    assert done() == EXIT_BAD_INPUT
    error = capsys.readouterr().err
    assert "the log changed while it was read" in error
    assert error.count("error:") == 1
    assert list(out.iterdir()) == []


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: str(change.__name__))
def test_a_change_at_any_moment_gives_no_mixture(
    intersection: Path, tmp_path: Path, change: Callable[[Path, bytes], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before seeded steps of a run, reads and writes; what is written is what one of the two logs alone gives."""
    one, two = intersection.read_bytes(), (intersection.parent / "rear-end.mcap").read_bytes()
    log, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    n_steps, change_at = 0, 0

    def step(*_: object) -> None:
        nonlocal n_steps
        n_steps += 1
        if n_steps == change_at:
            change(log, two)

    for owner, name in ((InputFile, "__getitem__"), (InputFile, "read_into"), (OutputStream, "write")):
        monkeypatch.setattr(owner, name, _after(step, getattr(owner, name)))
    whole = []
    for content in (two, one):
        log.write_bytes(content)
        n_steps = 0
        assert run_command_line(["estimate", str(log), "-o", str(out), "--force", "--quiet"]) == 0
        whole.append(out.read_bytes())
    codes = []
    for moment in np.random.default_rng(SEED).integers(1, n_steps + 1, N_MOMENTS).tolist():
        log.write_bytes(one)
        out.unlink(missing_ok=True)
        n_steps, change_at = 0, moment
        codes.append(run_command_line(["estimate", str(log), "-o", str(out), "--quiet"]))
        change_at = 0
        assert codes[-1] in (0, EXIT_BAD_INPUT)
        assert out.exists() == (codes[-1] == 0)
        assert codes[-1] or out.read_bytes() in whole
    assert EXIT_BAD_INPUT in codes


def _after(step: Callable[..., None], method: Callable[..., object]) -> Callable[..., object]:
    """A method before each call of which there is a step."""

    def call(*arguments: object, **named: object) -> object:
        step()
        return method(*arguments, **named)

    return call


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: str(change.__name__))
def test_of_many_logs_the_changed_one_fails(
    intersection: Path,
    tmp_path: Path,
    change: Callable[[Path, bytes], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The worker's part of `run -d`; the log changes while it is hashed, or while it is read."""
    log = tmp_path / "log.mcap"
    plan = gather_default_options().fleet_plan(replace=False)
    read = InputFile.read_into
    for at in (1, 2):
        log.write_bytes(intersection.read_bytes())
        reads = 0

        def counted(file: InputFile, buffer: memoryview, start: int, at: int = at) -> memoryview:
            nonlocal reads
            reads += 1
            if reads == at:
                change(log, bytes(len(intersection.read_bytes())))
            return read(file, buffer, start)

        monkeypatch.setattr(InputFile, "read_into", counted)
        assert process_log(LogTask("log", str(log), str(log), str(tmp_path / "out")), plan).status == "failed"
        assert [each.name for each in (tmp_path / "out" / "logs" / "log").iterdir()] == ["entry.json"]
        assert '"exit_code": 3' in (tmp_path / "out" / "logs" / "log" / "entry.json").read_text()
