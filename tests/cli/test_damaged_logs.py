"""Every command on logs that were made to break readers: a documented exit code, no traceback, nothing left behind.

The logs are in `../shared/damaged`; without that folder nothing is collected.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from cwcli.errors import EXIT_BUG, EXIT_CODES, EXIT_DONE, EXIT_NOT_WRITTEN
from tests.cli.bounded import LIMIT_BYTES, MOST_MB
from tests.cli.conftest import ROOT, SAMPLES
from tests.cli.warm_process import WarmProcess
from tests.work import HANG_S

DAMAGED = sorted((ROOT.parent / "shared" / "damaged").glob("*.mcap"))
COMMANDS = [
    ("info", "LOG"),
    ("info", "LOG", "--doctor", "--json"),
    ("estimate", "LOG", "-o", "out.mcap"),
    ("estimate", "LOG", "-o", "out.mcap", "--recover"),
    ("predict", "LOG", "-o", "out.mcap"),
    ("track", "LOG", "-o", "out.mcap"),
    ("lanes", "LOG", "-o", "out.mcap"),
    ("observe", "LOG", "-o", "out.mcap"),
    ("warn", "LOG", "-o", "out.mcap"),
    ("measure", "LOG", "-o", "out.mcap"),
    ("run", "LOG", "-o", "out.mcap", "--metrics-dir", "metrics"),
    ("run", "LOG", "-d", "out", "--jobs", "1"),
    ("cut", "LOG", "--start", "1", "-o", "out.mcap"),
    ("find", "LOG", "sensor-gap"),
    ("join", "LOG", "GOOD", "-o", "out.mcap"),
    ("join", "GOOD", "LOG", "-o", "out.mcap"),
    ("calibrate", "LOG", "-o", "car.toml"),
    ("evaluate", "LOG", "--json"),
    ("compare", "LOG", "LOG"),
    ("report", "LOG", "-o", "page.html"),
    ("export", "LOG", "-o", "states.csv"),
    ("export", "LOG", "-o", "states.parquet"),
    ("export", "LOG", "-o", "track.gpx"),
    ("export", "LOG", "-o", "track.tum"),
    ("export", "LOG", "-o", "ros.mcap", "--format", "ros2"),
    ("export", "LOG", "-o", "trace.mcap", "--format", "osi"),
    ("plot", "LOG", "-o", "plot.svg"),
    ("layout", "LOG", "-o", "layout.json"),
]
"""LOG is the damaged log, GOOD a sound one. `view` hands the log to a program of others."""
RUN_ALL = """
import io, json, os, resource, shutil, signal, sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
limit, seconds, folder, commands = int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]), json.loads(sys.argv[4])
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
signal.alarm(seconds)
from cwcli.cli.main import run_command_line
ended = []
for command in commands:
    (folder / "work").mkdir()
    os.chdir(folder / "work")
    shown = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    with redirect_stdout(shown), redirect_stderr(shown):
        code = run_command_line(command)
    shown.flush()
    left = sorted(path.name for path in (folder / "work").iterdir())
    temporary = sorted(path.name for path in Path(os.environ["TMPDIR"]).iterdir())
    ended.append([code, shown.buffer.getvalue().decode("utf-8", "replace"), left, temporary])
    os.chdir(folder)
    shutil.rmtree(folder / "work")
peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
sys.__stdout__.write(json.dumps([peak_mb, ended]))
"""
"""All commands in one process, which imports the libraries once; it dies of a hang or of too much memory."""


def run_all(warm: WarmProcess, folder: Path, commands: list[list[str]]) -> tuple[float, list[Any]]:
    """The most memory in MB, and of each command the exit code, all words, and the names of what it left."""
    (folder / "tmp").mkdir()
    words = [str(LIMIT_BYTES), str(round(HANG_S)), str(folder), json.dumps(commands)]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "TMPDIR": str(folder / "tmp")}
    done = warm.run(words, ROOT, environment, 2.0 * HANG_S, RUN_ALL)
    assert done.returncode == 0, (done.returncode, done.stderr.decode()[-2000:])
    peak_mb, ended = json.loads(done.stdout)
    return peak_mb, ended


def check_all(warm: WarmProcess, folder: Path, log: Path) -> None:
    """Run every command on a log.

    Raises:
        AssertionError: One ended with a bug, left a file though it failed, or took too much memory.
    """
    names = {"LOG": str(log), "GOOD": str(SAMPLES / "straight.mcap")}
    peak_mb, ended = run_all(warm, folder, [[names.get(word, word) for word in command] for command in COMMANDS])
    for command, (code, said, left, temporary) in zip(COMMANDS, ended, strict=True):
        told = f"{' '.join(command)}: {code}, left {left}\n{said}"
        assert code in EXIT_CODES and code not in (EXIT_BUG, EXIT_NOT_WRITTEN), told
        assert "Traceback" not in said, told
        assert temporary == [], told
        assert code == EXIT_DONE or left == [] or "-d" in command, told  # `run -d` tells of the failure in its folder
    assert peak_mb < MOST_MB


@pytest.mark.parametrize("log", DAMAGED, ids=lambda path: path.stem)
def test_every_command_survives_a_damaged_log(warm_process: WarmProcess, tmp_path: Path, log: Path) -> None:
    check_all(warm_process, tmp_path, log)


def test_every_command_survives_half_a_log(warm_process: WarmProcess, tmp_path: Path) -> None:
    half = tmp_path / "half.mcap"
    half.write_bytes((SAMPLES / "intersection.mcap").read_bytes()[:40_000])
    check_all(warm_process, tmp_path, half)
