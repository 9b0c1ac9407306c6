"""Every hostile input ends in one line or is counted: at most 500 MB and 5 s of processor time, and nothing is left."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cwcli import input as input_files
from cwcli.errors import (
    EXIT_BAD_DATA,
    EXIT_BAD_INPUT,
    EXIT_DONE,
    EXIT_GATE_FAILED,
    EXIT_MISSING_SIGNAL,
    EXIT_NOT_WRITTEN,
    EXIT_USAGE,
    InputError,
)
from cwcli.logs.read.reader import Log
from tests.cli.conftest import ROOT
from tests.cli.hostile_inputs import ATTACKS, SAMPLE
from tests.cli.test_hostile_names import check_printed
from tests.cli.unlisted_inputs import UNLISTED

MAKERS = ATTACKS | UNLISTED
QUICK = {
    "mcap, one chunk in 100,000 entries of the summary",
    "mcap.zst, 130 GB of zeros in 4 MB",
    "mcap, a PNG that says 64 by 48 and holds 1 GB",
    "mcap, a JPEG of 5,000 scans",
    "gpx, an encoding that lies",
    "scenario, 20,000 vehicles",
    "net, weights in another file",
    "net, an output of 10^13 values",
    "zip, members above the folder",
    "db3, pages in a circle",
    "yaml, links to a device and to themselves",
    "manifest, names that climb",
    "db3, a journal that names another file",
    "dbc of a log, a signal of 10^9 bits",
    "manifest, a device",
    "bag, 60,000 connections that only its index has",
    "bag, 10 GB of hole",
    "tum, numbers of 200,000 digits",
    "mcap, 3,000 channels of 2,000 fields, on the screen",
    "mcap.zst, 240 MB of messages of nothing, estimate",
}
"""The default tests: those that found something, and one of each kind. Each takes a second."""
MOST_MB, MOST_CPU_S, LONGEST_S = 500, 5, 120
OUTPUTS = {"out.mcap", "out.import.toml", "out.html"}
CODES = {
    *(EXIT_DONE, EXIT_GATE_FAILED, EXIT_USAGE, EXIT_BAD_INPUT),
    *(EXIT_MISSING_SIGNAL, EXIT_BAD_DATA, EXIT_NOT_WRITTEN),
}
MEASURED = """
import json, resource, subprocess, sys
done = subprocess.run(sys.argv[2:], capture_output=True, stdin=subprocess.DEVNULL, timeout=int(sys.argv[1]))
used = resource.getrusage(resource.RUSAGE_CHILDREN)
texts = [each.decode(errors="surrogateescape") for each in (done.stdout, done.stderr)]
print(json.dumps([done.returncode, *texts, used.ru_maxrss / 1024, used.ru_utime + used.ru_stime]))
"""
"""A command with what it and its processes took."""


def names_below(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.long) for name in MAKERS]
)
def test_hostile_input_stays_within_its_bounds(tmp_path: Path, name: str) -> None:
    arguments = MAKERS[name](tmp_path)
    before = names_below(tmp_path)
    done = subprocess.run(
        [sys.executable, "-S", "-c", MEASURED, str(LONGEST_S), sys.executable, "-m", "cwcli", *arguments],
        capture_output=True,
        check=True,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)},
    )
    code, printed, said, peak_mb, cpu_s = json.loads(done.stdout)
    assert code in CODES, said
    assert "Traceback" not in said
    assert peak_mb < MOST_MB
    assert cpu_s < MOST_CPU_S
    assert before <= names_below(tmp_path)
    left = names_below(tmp_path) - before
    if "-d" in arguments:  # the same command goes on with that folder
        left = {each for each in left if Path(each).parts[0] != "out"}
    assert left <= OUTPUTS if code in (EXIT_DONE, EXIT_GATE_FAILED) else not left
    for text in (printed, said):
        check_printed(text.encode(errors="surrogateescape"))


def test_pipe_that_nobody_writes_into_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(input_files, "PIPE_WRITER_TIMEOUT_S", 0.1)
    os.mkfifo(tmp_path / "log.mcap")
    with pytest.raises(InputError, match="nobody has written into this pipe"):
        Log.open(tmp_path / "log.mcap")
    with pytest.raises(OSError, match="nobody has written into this pipe"):
        input_files.read_file(tmp_path / "log.mcap")


def test_pipe_that_somebody_writes_into_is_read(tmp_path: Path) -> None:
    pipe = tmp_path / "log.mcap"
    os.mkfifo(pipe)
    copy = "import shutil, sys; shutil.copyfileobj(open(sys.argv[1], 'rb'), open(sys.argv[2], 'wb'))"
    with subprocess.Popen([sys.executable, "-c", copy, str(SAMPLE), str(pipe)]), Log.open(pipe) as log:
        assert log.channels
