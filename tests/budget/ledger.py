"""The figures of `instructions.json`: what each case cost when its line was written, and why the line is as it is."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

LEDGER = Path(__file__).with_name("instructions.json")
TOLERANCE = 0.03
"""Share of a figure by which a case may cost more, as the project's issue on the budget sets it."""
REPEATABLE = 0.005
"""Share by which two counts of one build differ at most: a line that moved less is not written again."""
LIBRARIES = (
    "click",
    "foxglove-schemas-protobuf",
    "lap",
    "lz4",
    "mcap",
    "numpy",
    "opencv-python-headless",
    "protobuf",
    "pyarrow",
    "pyproj",
    "pyyaml",
    "rich",
    "typer",
    "zstandard",
)
"""The packages whose code the cases run."""


@dataclass(frozen=True)
class Line:
    """The figure of one case.

    Attributes:
        instructions: Of the process.
        date: When it was counted, ISO 8601.
        after: Subject of the commit before the one that wrote the line.
        reason: Why the line is as it is.
    """

    instructions: int
    date: str
    after: str
    reason: str


@dataclass(frozen=True)
class Ledger:
    """All figures, and the environment in which they hold."""

    environment: dict[str, str]
    lines: dict[str, Line]


def describe_environment(counter: str) -> dict[str, str]:
    """What the counts depend on, besides the checkout: two environments that are equal give equal counts."""
    found = {
        "counter": first_line([counter, "--version"]),
        "compiler": first_line([os.environ.get("CC", "cc"), "--version"]),
    }
    found |= {"python": sys.version, "libc": " ".join(platform.libc_ver()), "machine": platform.machine()}
    found |= {"processors": str(os.cpu_count()), "avx2": str(has_avx2())}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "-"
    return found


def has_avx2() -> bool:
    """Whether the processor has AVX2, which valgrind passes on (Linux only; elsewhere no)."""
    path = Path("/proc/cpuinfo")
    return path.exists() and "avx2" in path.read_text(encoding="utf-8").split()


def first_line(arguments: list[str]) -> str:
    """What a program says first on standard output; "-" if it is not there."""
    try:
        done = subprocess.run(arguments, check=False, capture_output=True, text=True)
    except OSError:
        return "-"
    return done.stdout.partition("\n")[0]


def read_ledger(path: Path = LEDGER) -> Ledger:
    """Read the figures."""
    document = json.loads(path.read_text(encoding="utf-8"))
    return Ledger(document["environment"], {name: Line(**line) for name, line in document["cases"].items()})


def write_ledger(ledger: Ledger, path: Path = LEDGER) -> None:
    """Write the figures."""
    cases = {name: asdict(line) for name, line in ledger.lines.items()}
    text = json.dumps({"environment": ledger.environment, "cases": cases}, indent=2)
    path.write_text(text + "\n", encoding="utf-8")


def find_excess(counted: Mapping[str, int], allowed: Mapping[str, int]) -> list[str]:
    """The cases that cost more than `TOLERANCE` above what is allowed, or have no figure, in the order counted."""
    return [name for name, n in counted.items() if name not in allowed or n > (1 + TOLERANCE) * allowed[name]]


def update_lines(
    lines: Mapping[str, Line], counted: Mapping[str, int], stamp: Line, *, all_lines: bool
) -> dict[str, Line]:
    """The lines with the new counts.

    Args:
        lines: The present ones.
        counted: Case -> instructions.
        stamp: Date, commit and reason of the new lines.
        all_lines: Also lines that moved by less than `REPEATABLE` (the environment is another).
    """
    updated = dict(lines)
    for name, n in counted.items():
        old = lines.get(name)
        if all_lines or old is None or abs(n - old.instructions) > REPEATABLE * old.instructions:
            updated[name] = Line(n, stamp.date, stamp.after, stamp.reason)
    return updated
