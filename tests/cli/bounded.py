"""Commands on hostile logs, with what they took: nothing small may take much."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

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


def bounded(folder: Path, *arguments: str | Path, most_mb: float = MOST_MB, most_cpu_s: float = MOST_CPU_S) -> Ended:
    """Run `cwcli` in a folder; it must stay within its bounds, and show no traceback."""
    command = ["prlimit", f"--as={LIMIT_BYTES}", "timeout", str(KILLED_AFTER_S), sys.executable, "-m", "cwcli"]
    with (folder / "stdout").open("w+b") as out, (folder / "stderr").open("w+b") as talk:
        process = subprocess.Popen(
            [*command, *map(str, arguments)],
            cwd=folder,
            stdout=out,
            stderr=talk,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        talk.seek(0)
        out.seek(0)
        shown, printed = talk.read().decode(), out.read().decode()
    for name in ("stdout", "stderr"):
        (folder / name).unlink()
    ended = Ended(process.returncode, shown, printed, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)
    assert "Traceback" not in shown, shown
    assert ended.cpu_s < most_cpu_s, shown
    assert ended.peak_mb < most_mb, shown
    return ended
