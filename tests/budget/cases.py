"""What is counted: one command each, on bundled logs and on simulated ones of a fixed seed."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

READ_SIGNALS = Path(__file__).with_name("read_signals.py")

Arguments = tuple[str, ...]


@dataclass(frozen=True)
class Case:
    """A process whose instructions are counted.

    Attributes:
        name: Its line in `instructions.json`.
        arguments: Behind the interpreter; `{samples}` stands for the folder of the bundled logs.
        less: A second process, whose count is subtracted: what both do is not the subject. Empty: nothing is.
    """

    name: str
    arguments: Arguments
    less: Arguments = ()


def cwcli(*arguments: str) -> Arguments:
    """The arguments of a cwcli process."""
    return ("-m", "cwcli", *arguments)


SETUP = (
    cwcli("simulate", "city", "-o", "city.mcap"),
    cwcli("simulate", "road", "--seed", "1", "--set", "size=320x240", "--set", "duration_s=1", "-o", "road.mcap"),
    cwcli("estimate", "{samples}/intersection.mcap", "-o", "estimated.mcap"),
    cwcli("predict", "estimated.mcap", "-o", "predicted.mcap"),
)
"""Processes that make the logs of the cases; they are not counted."""

CASES = (
    Case("help", cwcli("--help")),
    Case("info", cwcli("info", "{samples}/intersection.mcap")),
    Case("read", (str(READ_SIGNALS), "city.mcap", "2"), less=(str(READ_SIGNALS), "city.mcap", "1")),
    Case("estimate", cwcli("estimate", "{samples}/intersection.mcap", "-f", "-o", "estimate.mcap")),
    Case("warn", cwcli("warn", "predicted.mcap", "-f", "-o", "warn.mcap")),
    Case("run", cwcli("run", "{samples}/rear-end.mcap", "-f", "-o", "run.mcap")),
    Case("lanes", cwcli("lanes", "road.mcap", "-f", "-o", "lanes.mcap")),
)
"""`read` is the reading of all columns of 39,605 messages alone: within a whole process it would be lost, and a loop
over messages in Python would not be seen."""


def environment(tree: Path) -> dict[str, str]:
    """The variables of a counted process: nothing of the caller's but the path, nothing that varies from run to run."""
    return {
        "PATH": "/usr/local/bin:/usr/bin:/bin",
        "HOME": "/nonexistent",
        "LC_ALL": "C.UTF-8",
        "TZ": "UTC",
        "PYTHONPATH": str(tree),
        "PYTHONHASHSEED": "0",
        "PYTHONNOUSERSITE": "1",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }


def command(arguments: Arguments, tree: Path) -> list[str]:
    """The interpreter with the arguments, their placeholders filled."""
    return [sys.executable, *(argument.replace("{samples}", str(tree / "sample_logs")) for argument in arguments)]


def prepare(tree: Path, folder: Path, names: set[str]) -> None:
    """Make the logs, and run the named cases once uncounted, so that every module has its byte code.

    Raises:
        subprocess.CalledProcessError: A process failed.
    """
    for arguments in (*SETUP, *(case.arguments for case in CASES if case.name in names)):
        subprocess.run(command(arguments, tree), check=True, cwd=folder, env=environment(tree), capture_output=True)
