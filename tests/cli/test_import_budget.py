"""What a command does not need it does not import; a stage may import some more modules than today, but not many."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
INTERSECTION = str(ROOT / "sample_logs/intersection.mcap")
LIST_MODULES = """
import contextlib, io, runpy, sys
sys.argv = ["cwcli", *sys.argv[1:]]
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    runpy.run_module("cwcli", run_name="__main__")
print(*sys.modules)
"""
NO_LIBRARY = (
    "numpy",
    "google",
    "pyarrow",
    "cv2",
    "typer",
    "click",
    "rich",
    "zstandard",
    "lz4",
    "mcap",
    "json",
    "asyncio",
)
NOT_FOR_STATES = ("numpy.ma", "pyarrow", "cv2", "typer", "click", "rich", "pyproj", "mcap", "lz4", "asyncio", "ssl")


class Budget(NamedTuple):
    """What a command may import.

    Attributes:
        arguments: Of the command.
        without: Modules that it needs none of.
        n_modules: Greatest number of modules, a tenth more than it took when this was written.
    """

    arguments: tuple[str, ...]
    without: tuple[str, ...]
    n_modules: int


BUDGETS = (
    Budget(("--help",), (*NO_LIBRARY, "dataclasses", "inspect"), 106),
    Budget(("info", INTERSECTION), NO_LIBRARY, 198),
    Budget(("estimate", INTERSECTION, "-f", "-o", "estimated.mcap"), NOT_FOR_STATES, 684),
    Budget(("predict", "estimated.mcap", "-f", "-o", "predicted.mcap"), (*NOT_FOR_STATES, "numpy.fft"), 620),
    Budget(("warn", "predicted.mcap", "-f", "-o", "warned.mcap"), (*NOT_FOR_STATES, "numpy.fft"), 704),
    Budget(("run", INTERSECTION, "-f", "-o", "run.mcap"), NOT_FOR_STATES, 914),
)
"""In an order in which each command finds its log."""


def list_modules(arguments: tuple[str, ...], folder: Path, plant: str = "") -> set[str]:
    """The modules that a command imports, with a line of Python in front of it."""
    command = [sys.executable, "-c", plant + LIST_MODULES, *arguments]
    done = subprocess.run(command, check=True, cwd=folder, capture_output=True, text=True)
    return set(done.stdout.split())


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> dict[str, set[str]]:
    """Command -> the modules that it imports."""
    folder = tmp_path_factory.mktemp("imports")
    return {budget.arguments[0]: list_modules(budget.arguments, folder) for budget in BUDGETS}


@pytest.mark.parametrize("budget", BUDGETS, ids=lambda budget: budget.arguments[0])
def test_no_command_imports_what_it_does_not_need(budget: Budget, imported: dict[str, set[str]]) -> None:
    found = imported[budget.arguments[0]]
    assert "cwcli.cli.main" in found
    assert sorted(found & set(budget.without)) == []
    assert len(found) <= budget.n_modules


def test_a_planted_import_is_seen(tmp_path: Path) -> None:
    found = list_modules(BUDGETS[0].arguments, tmp_path, plant="import numpy")
    assert found & set(BUDGETS[0].without) >= {"numpy"}
    assert len(found) > BUDGETS[0].n_modules
