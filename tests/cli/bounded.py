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

MOST_CPU_S = 5.0
MOST_MB = 1024
LIMIT_BYTES = 8 << 30
"""Of address space: a test that fails must not take the machine with it."""
KILLED_AFTER_S = 60


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    Attributes:
        code: Its exit code.
        shown: Its standard error.
        printed: Its standard output.
        cpu_s, peak_mb: Processor time, and most of the memory that it held.
    """

    code: int
    shown: str
    printed: str
    cpu_s: float
    peak_mb: float


LAUNCHER = """
import json, os, resource, signal, sys
child = os.fork()
if not child:
    resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]), int(sys.argv[2])))
    signal.alarm(int(sys.argv[3]))
    os.execv(sys.argv[4], sys.argv[4:])
_, status, usage = os.wait4(child, 0)
took = os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
open(sys.argv[1], "w").write(json.dumps(took))
"""
"""A small process in between: a child's most memory begins with what its parent held when it was forked."""


def bounded(
    folder: Path, *arguments: str | Path, most_mb: float = MOST_MB, most_cpu_s: float = MOST_CPU_S, **streams: Any
) -> Ended:
    """Run `cwcli` in a folder; it must stay within its bounds, and show no traceback."""
    took = folder / "took.json"
    command = [sys.executable, "-S", "-c", LAUNCHER, took, str(LIMIT_BYTES), str(KILLED_AFTER_S), sys.executable]
    done = subprocess.run(
        [*command, "-m", "cwcli", *map(str, arguments)],
        capture_output=True,
        check=True,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        **streams,
    )
    code, cpu_s, peak_mb = json.loads(took.read_text())
    took.unlink()
    ended = Ended(code, done.stderr.decode(), done.stdout.decode(errors="replace"), cpu_s, peak_mb)
    assert "Traceback" not in ended.shown, ended.shown
    assert ended.cpu_s < most_cpu_s, ended
    assert ended.peak_mb < most_mb, ended
    return ended
