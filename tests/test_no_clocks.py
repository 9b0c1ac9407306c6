"""No test depends on how fast or how busy the machine is: none reads a clock but those that wait, each with its reason.

How much work something is, is counted (`tests.work`); seconds belong into tests/bench.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.work import HANG_S

TESTS = Path(__file__).parent
CLOCKS = {"perf_counter", "process_time", "monotonic", "thread_time", "getrusage"} | {
    f"{name}_ns" for name in ("perf_counter", "process_time", "monotonic", "thread_time")
}
MEASURED = ("bench", "studies")  # they print seconds, and are no tests
WAITS = {
    "cli/browser.py": "waits until a page is open; a study prints the times that the browser itself tells",
    "cli/test_fleet.py": "waits until a state is reached, `HANG_S` at most",
    "cli/test_leftovers.py": "waits for a temporary file",
    "cli/test_pipeline.py": "waits for a temporary file",
    "cli/test_shards.py": "a run's length only says how far apart the moments are at which a shard is killed",
    "disturb.py": "a run's length only says how far apart the moments of its disturbances are",
    "fuzz/__main__.py": "a person says how many minutes it runs",
    "fuzz/drive.py": "a person says how many minutes it runs",
    "peers/test_s3.py": "waits for a server",
    "unit/fleet/test_local.py": "waits for the end of a process",
    "unit/test_array_memory.py": "waits for a thread",
}
"""Test file -> why it reads a clock all the same: no assertion compares what it reads."""


def clocks(source: str) -> list[int]:
    """The lines that read a clock."""
    if not any(name in source for name in CLOCKS):
        return []
    tree = ast.parse(source)
    names = [
        (node.lineno, node.attr if isinstance(node, ast.Attribute) else node.id)
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute | ast.Name)
    ]
    scripts = [
        (node.lineno, name)
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        for name in CLOCKS
        if f"time.{name}(" in node.value
    ]
    return sorted({line for line, name in [*names, *scripts] if name in CLOCKS})


def short_timeouts(source: str) -> list[int]:
    """The lines with a time limit in digits that a busy machine may reach."""
    if "timeout" not in source:
        return []
    return [
        keyword.value.lineno
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Call)
        for keyword in node.keywords
        if keyword.arg == "timeout"
        and isinstance(keyword.value, ast.Constant)
        and isinstance(keyword.value.value, int | float)
        and 2 < keyword.value.value < HANG_S
    ]


FILES = [path for path in sorted(TESTS.rglob("*.py")) if path.relative_to(TESTS).parts[0] not in MEASURED]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(TESTS).as_posix())
def test_no_test_judges_seconds(path: Path) -> None:
    name, source = path.relative_to(TESTS).as_posix(), path.read_text(encoding="utf-8")
    if path == Path(__file__):
        return
    if name not in WAITS:
        assert not clocks(source), f"{name} reads a clock: count work (tests/work.py), or move it to tests/bench"
    assert not short_timeouts(source), f"{name}: a time limit below {HANG_S:g} s judges the machine"


def test_the_list_of_those_that_wait_is_not_longer_than_they_are() -> None:
    assert {name for name in WAITS if not clocks((TESTS / name).read_text(encoding="utf-8"))} == set()


def test_a_clock_and_a_short_limit_are_found() -> None:
    assert clocks("import time\nbegin = time.process_time()\nassert time.monotonic_ns() - begin < 5") == [2, 3]
    assert clocks("SCRIPT = 'time.perf_counter()'") == [1]
    assert clocks("time.sleep(1)") == []
    assert short_timeouts("run(timeout=20)\nrun(timeout=600)\nrun(timeout=LIMIT)") == [1]
