"""Files that stand for more than they may cost: an error in one line, or counted, within the bounds of the import."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from cwcli.errors import EXIT_BAD_DATA, EXIT_BAD_INPUT, EXIT_DONE, EXIT_MISSING_SIGNAL, EXIT_USAGE
from tests.cli.conftest import ROOT
from tests.unit.importing.hostile_imports import HOSTILE
from tests.unit.importing.unforeseen_imports import UNFORESEEN

MAKERS = HOSTILE | UNFORESEEN
QUICK = {
    *("gpx, a billion laughs", "zip, 500 MB that say 1 MB", "blf, objects of no size", "mp4, 2^32 - 1 samples"),
    *("tum, 1 TB of zeros", "dbc, a multiplexer of 2^32 values"),
}
"""The default tests; each of the others takes a second or two."""
MOST_MB = 500
"""The processor time is bounded by the process itself."""
CODES = {EXIT_DONE, EXIT_USAGE, EXIT_BAD_INPUT, EXIT_MISSING_SIGNAL, EXIT_BAD_DATA}
MEASURED = """
import json, resource, subprocess, sys
done = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([done.returncode, done.stderr.decode(errors="replace"), used.ru_maxrss / 1024]))
"""
"""A command with what it and its processes took."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.long) for name in MAKERS]
)
def test_hostile_file_stays_within_its_bounds(tmp_path: Path, name: str) -> None:
    arguments = MAKERS[name](tmp_path)
    before = {path.name for path in tmp_path.iterdir()}
    command = [sys.executable, "-m", "cwcli", "import", *arguments, "-o", "out.mcap", "--quiet"]
    done = subprocess.run(
        [sys.executable, "-S", "-c", MEASURED, *command],
        capture_output=True,
        check=True,
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)},
    )
    code, said, peak_mb = json.loads(done.stdout)
    assert code in CODES
    assert "Traceback" not in said
    assert peak_mb < MOST_MB
    left = {path.name for path in tmp_path.iterdir()} - before
    assert left == ({"out.mcap", "out.import.toml"} if code == EXIT_DONE else set())
