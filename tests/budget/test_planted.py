"""A slow-down that is planted exceeds the budget: the counts, not only the comparison, are what CI relies on."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from tests.budget.cases import READ_SIGNALS, command, cwcli, environment
from tests.budget.counting import count_by_valgrind
from tests.budget.ledger import REPEATABLE, find_excess

ROOT = Path(__file__).parents[2]
HELP = "import runpy, sys; sys.argv = ['cwcli', '--help']; runpy.run_module('cwcli', run_name='__main__')"
PLANTED_IMPORTS = ("asyncio, xml.dom.minidom", "typer", "dataclasses", "json, pathlib", "numpy")
"""Modules that `cwcli --help` needs none of."""
PLANTED_IN_READING = {
    "a loop over rows": "[int(stamp_ns) for stamp_ns in columns.log_time_ns]",
    "rows as texts": "[str(stamp_ns) for stamp_ns in columns.log_time_ns]",
    "a sort by a function of each row": "sorted(columns.log_time_ns, key=lambda stamp_ns: -stamp_ns)",
    "a copy of each row": "[columns.log_time_ns[k:k + 1].copy() for k in range(len(columns))]",
    "columns read twice": "read_columns(self, topic, fields)",
}
"""What is done with each channel's columns besides reading them."""
PLANT_IN_READING = """
from cwcli.logs.read.reader import Log
read_columns = Log.columns
def read_slowly(self, topic, fields=None):
    columns = read_columns(self, topic, fields)
    {planted}
    return columns
Log.columns = read_slowly
"""


def first_and_long(cases: Iterable[str]) -> list[Any]:
    """The first case as it is, the others as long tests."""
    first, *others = cases
    return [first, *(pytest.param(each, marks=pytest.mark.long) for each in others)]


def count(script: str, folder: Path, *arguments: str) -> int:
    """The instructions of a Python script, whose modules are compiled by a first run that is not counted."""
    command = [sys.executable, "-c", script, *arguments]
    subprocess.run(command, check=True, cwd=folder, env=environment(ROOT), capture_output=True)
    return count_by_valgrind(command, folder, environment(ROOT))


@pytest.fixture(scope="module")
def plain_help(tmp_path_factory: pytest.TempPathFactory) -> int:
    """What the help costs."""
    return count(HELP, tmp_path_factory.mktemp("help"))


def test_counts_repeat(plain_help: int, tmp_path: Path) -> None:
    again = count(HELP, tmp_path)
    assert abs(again - plain_help) < REPEATABLE * plain_help
    assert find_excess({"help": again}, {"help": plain_help}) == []


@pytest.mark.parametrize("modules", first_and_long(PLANTED_IMPORTS))
def test_an_import_is_seen(modules: str, plain_help: int, tmp_path: Path) -> None:
    planted = count(f"import {modules}\n{HELP}", tmp_path)
    assert find_excess({"help": planted}, {"help": plain_help}) == ["help"]


def count_reading(plant: str, folder: Path) -> int:
    """What reading all columns of a log costs."""
    script = plant + READ_SIGNALS.read_text(encoding="utf-8")
    return count(script, folder, "log.mcap", "2") - count(script, folder, "log.mcap", "1")


@pytest.fixture(scope="module")
def plain_reading(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """A folder with a log, and what reading it costs."""
    folder = tmp_path_factory.mktemp("reading")
    simulate = command(cwcli("simulate", "straight", "-o", "log.mcap"), ROOT)
    subprocess.run(simulate, check=True, cwd=folder, env={**os.environ, **environment(ROOT)}, capture_output=True)
    return folder, count_reading("", folder)


@pytest.mark.parametrize("name", first_and_long(PLANTED_IN_READING))
def test_slower_reading_is_seen(name: str, plain_reading: tuple[Path, int]) -> None:
    folder, plain = plain_reading
    planted = count_reading(PLANT_IN_READING.format(planted=PLANTED_IN_READING[name]), folder)
    assert find_excess({"read": planted}, {"read": plain}) == ["read"]
