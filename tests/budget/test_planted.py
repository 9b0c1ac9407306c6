"""A slow-down that is planted exceeds the budget: the counts, not only the comparison, are what CI relies on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.budget.cases import READ_SIGNALS, command, cwcli, environment
from tests.budget.counting import count_by_valgrind
from tests.budget.ledger import REPEATABLE, find_excess

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]
HELP = "import runpy, sys; sys.argv = ['cwcli', '--help']; runpy.run_module('cwcli', run_name='__main__')"
LOOP_OVER_ROWS = """
from cwcli.logs.read.reader import Log
read_columns = Log.columns
def read_with_a_loop(self, topic, fields=None):
    columns = read_columns(self, topic, fields)
    for stamp_ns in columns.log_time_ns:
        int(stamp_ns)
    return columns
Log.columns = read_with_a_loop
"""


def count(script: str, folder: Path, *arguments: str) -> int:
    """The instructions of a Python script, whose modules are compiled by a first run that is not counted."""
    command = [sys.executable, "-c", script, *arguments]
    subprocess.run(command, check=True, cwd=folder, env=environment(ROOT), capture_output=True)
    return count_by_valgrind(command, folder, environment(ROOT))


def test_counts_repeat_and_a_heavy_import_is_seen(tmp_path: Path) -> None:
    plain, again = count(HELP, tmp_path), count(HELP, tmp_path)
    assert abs(again - plain) < REPEATABLE * plain
    planted = count(f"import asyncio, xml.dom.minidom\n{HELP}", tmp_path)
    assert find_excess({"help": again}, {"help": plain}) == []
    assert find_excess({"help": planted}, {"help": plain}) == ["help"]


def test_a_loop_over_rows_in_reading_is_seen(tmp_path: Path) -> None:
    simulate = command(cwcli("simulate", "straight", "-o", "log.mcap"), ROOT)
    subprocess.run(simulate, check=True, cwd=tmp_path, env={**os.environ, **environment(ROOT)}, capture_output=True)
    script = READ_SIGNALS.read_text(encoding="utf-8")

    def read(plant: str) -> int:
        return count(plant + script, tmp_path, "log.mcap", "2") - count(plant + script, tmp_path, "log.mcap", "1")

    assert find_excess({"read": read(LOOP_OVER_ROWS)}, {"read": read("")}) == ["read"]
