"""Which tests a run collects: those whose needs are installed, and the long ones only on request."""

from __future__ import annotations

import gc
import os
from collections import Counter
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from tests.requirements import FOLDER, describe_left_out, find_missing, is_available, is_long, needs_more

SHARED = Path(__file__).parents[2] / "shared"
BEGIN_S = pytest.StashKey[float]()
CPU = "processor_s"
LONG_HINT = "long tests are left out: `pytest --rest` runs what .ci/run adds, `pytest --long` all"


def pytest_report_header() -> list[str]:
    """One line for each kind of shared data that is absent, whose tests say so, too."""
    return [
        f"skipped: the tests with {what} (needs ../shared/{folder} beside the checkout)"
        for folder, what in (("logs", "the development logs"), ("oracles", "the results of other programs"))
        if not (SHARED / folder).is_dir()
    ]


def pytest_addoption(parser: pytest.Parser) -> None:
    """The options by which .ci/run reaches everything."""
    group = parser.getgroup("cwcli")
    group.addoption("--long", action="store_true", help="run all tests, those marked `long` too")
    group.addoption("--cpu", action="store_true", help="print the processor seconds of each test file")
    group.addoption(
        "--rest", action="store_true", help="run only what .ci/run adds: the peers and the folders of long tests"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Name the markers, and let no example of Hypothesis fail because the machine is busy."""
    settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
    settings.load_profile("any machine")
    config.addinivalue_line(
        "markers", "long: the whole of what another test samples; run by `pytest --long` and `.ci/run --long`"
    )
    config.addinivalue_line("markers", "peer(module): needs a module of the extra `[peers]`")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave a file out whose needs are not installed, or of which this run wants no test; lines at the end say so.

    Every worker would import the file, only to leave its tests out.
    """
    is_test = collection_path.match("test_*.py")
    return True if find_missing(collection_path) or (is_test and not may_be_wanted(config, collection_path)) else None


def may_be_wanted(config: pytest.Config, path: Path) -> bool:
    """Whether the options may ask for a test of a file, as far as its path and its markers' names tell."""
    if is_named(config, path):
        return True
    if config.getoption("--rest") and not config.getoption("--long"):
        return "mark.peer" in path.read_text(encoding="utf-8") or is_long(path) or needs_more(path)
    return bool(config.getoption("--long")) or not is_long(path)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect what this run does not want, or can't run."""
    split: dict[bool, list[pytest.Item]] = {True: [], False: []}
    for item in items:
        split[is_wanted(config, item)].append(item)
    if split[False]:
        config.hook.pytest_deselected(items=split[False])
        items[:] = split[True]


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Let no search for cycles walk through the tests and modules that stay to the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give each worker runs of consecutive tests: what a file's tests share is then made once, in most cases."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log) if config.getoption("dist") == "load" else None


def is_wanted(config: pytest.Config, item: pytest.Item) -> bool:
    """Whether the options ask for a test, and the module of its marker `peer` is there."""
    marker = item.get_closest_marker("peer")
    if marker is not None and not all(map(is_available, marker.args)):
        return False
    is_marked_long, wants_all = item.get_closest_marker("long") is not None, bool(config.getoption("--long"))
    if config.getoption("--rest"):
        is_rest = is_long(item.path) or marker is not None or needs_more(item.path)
        tries_more = wants_all and "tries" in getattr(item, "fixturenames", ())
        return wants_all if is_marked_long else is_rest or tries_more
    return wants_all or not (is_marked_long or is_long(item.path)) or is_named(config, item.path)


def is_named(config: pytest.Config, file: Path) -> bool:
    """Whether the command line names a test file or a folder of it below `tests`: who asks for it gets it."""
    named = {Path(argument.partition("::")[0]).resolve() for argument in config.args}
    return any(path in named for path in (file, *file.parents) if FOLDER in path.parents)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Note the processor time at the begin of a test, before its set-up."""
    item.stash[BEGIN_S] = processor_seconds()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Hand the processor time on with the report of the teardown; a report travels from worker to controller."""
    report = yield
    if report.when == "teardown":
        report.user_properties.append((CPU, processor_seconds() - item.stash[BEGIN_S]))
    return report


@pytest.fixture
def tries(request: pytest.FixtureRequest) -> Callable[[int, int], int]:
    """Returns the first of two numbers of tries, and with `--long` the second."""
    return lambda few, many: many if request.config.getoption("--long") else few


def processor_seconds() -> float:
    """Processor time of this process and of its children that have ended, in seconds."""
    return sum(os.times()[:4])


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Say in a line each what was not collected and what was left out."""
    if config.getoption("--cpu"):
        seconds: Counter[str] = Counter()
        for reports in terminalreporter.stats.values():
            for report in reports:
                file = getattr(report, "nodeid", "").partition("::")[0]
                seconds[file] += sum(value for name, value in getattr(report, "user_properties", ()) if name == CPU)
        terminalreporter.section("processor seconds of each file")
        for file, value in seconds.most_common():
            terminalreporter.write_line(f"{value:9.1f}  {file}")
        terminalreporter.write_line(f"{seconds.total():9.1f}  together")
    for line in (describe_left_out(), None if config.getoption("--long") or config.getoption("--rest") else LONG_HINT):
        if line is not None:
            terminalreporter.write_line(line)
