"""Commands on hostile logs, with what they took: nothing small may take much."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.cli.conftest import ROOT
from tests.work import HANG_S

MOST_CALLS = 2_000_000
"""Of Python and built-in functions, with the imports of a command: a run makes 300,000 to 800,000."""
MOST_MB = 1024
LIMIT_BYTES = 8 << 30
"""Of address space: a test that fails must not take the machine with it."""


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    Attributes:
        code: Its exit code.
        shown: Its standard error.
        printed: Its standard output.
        n_calls: Calls of Python and of built-in functions, in all its threads.
        peak_mb: Most of the memory that it held.
    """

    code: int
    shown: str
    printed: str
    n_calls: int
    peak_mb: float


LAUNCHER = """
import json, os, resource, signal, sys
child = os.fork()
if not child:
    resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]), int(sys.argv[2])))
    signal.alarm(int(sys.argv[3]))
    os.execv(sys.argv[4], sys.argv[4:])
_, status, usage = os.wait4(child, 0)
took = os.waitstatus_to_exitcode(status), usage.ru_maxrss / 1024
open(sys.argv[1], "w").write(json.dumps(took))
"""
"""A small process in between: a child's most memory begins with what its parent held when it was forked."""

COUNTED = """
import sys
from pathlib import Path
from cwcli.cli.main import run_command_line
from tests.work import count_calls
codes = []
n_calls = count_calls(lambda: codes.append(run_command_line(sys.argv[2:])))
Path(sys.argv[1]).write_text(str(n_calls))
sys.stdout.flush()
sys.exit(codes[0])
"""
"""`cwcli` with its calls counted."""


def bounded(
    folder: Path, *arguments: str | Path, most_mb: float = MOST_MB, most_calls: int = MOST_CALLS, **streams: Any
) -> Ended:
    """Run `cwcli` in a folder; it must stay within its bounds, and show no traceback."""
    took, calls = folder / "took.json", folder / "calls.txt"
    command: list[str | Path] = [
        sys.executable,
        "-S",
        "-c",
        LAUNCHER,
        took,
        str(LIMIT_BYTES),
        str(round(HANG_S)),
        sys.executable,
    ]
    done: subprocess.CompletedProcess[bytes] = subprocess.run(
        [*command, "-c", COUNTED, calls, *map(str, arguments)],
        capture_output=True,
        check=True,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        **streams,
    )
    code, peak_mb = json.loads(took.read_text())
    took.unlink()
    assert calls.exists(), f"killed, or ended early: {code}, {done.stderr.decode()}"
    n_calls = int(calls.read_text())
    calls.unlink()
    ended = Ended(code, done.stderr.decode(), done.stdout.decode(errors="replace"), n_calls, peak_mb)
    assert "Traceback" not in ended.shown, ended.shown
    assert ended.n_calls < most_calls, ended
    assert ended.peak_mb < most_mb, ended
    return ended
