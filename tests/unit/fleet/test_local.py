"""Local workers: one that dies costs its own log only."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Generator

import pytest

from cwcli.errors import OutputError
from cwcli.fleet import local
from cwcli.fleet.fork_server import ForkServer
from cwcli.fleet.local import WorkerDied, run_on_local_processes
from cwcli.fleet.plan import FleetPlan, LogTask, TaskResult
from cwcli.fleet.spawned import SpawningServer

PLAN = FleetPlan(())


def task(name: str) -> LogTask:
    return LogTask(name, f"{name}.mcap", f"/{name}.mcap", "/out")


def die_on_b(task: LogTask, plan: FleetPlan) -> TaskResult:
    """Stands for a log that kills whoever reads it."""
    if task.id.startswith("b"):
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.05)
    return TaskResult(task.id, "done", float(os.getpid()), 0.0)


def leave_on_b(task: LogTask, plan: FleetPlan) -> TaskResult:
    """Stands for a library that ends the process."""
    if task.id.startswith("b"):
        os._exit(3)
    return TaskResult(task.id, "done", 0.0, 0.0)


def no_disk(task: LogTask, plan: FleetPlan) -> TaskResult:
    """Stands for an output folder that is full."""
    raise OutputError("no space is left on the disk")


@pytest.fixture(params=[ForkServer, SpawningServer], ids=["forked", "spawned"])
def server(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Either way of starting workers; the second is that of systems that can't fork."""
    monkeypatch.setattr(local, "_start_server", request.param)


@pytest.mark.usefixtures("server")
@pytest.mark.parametrize(
    ("do", "jobs"),
    [
        (die_on_b, 1),
        (leave_on_b, 2),
        pytest.param(leave_on_b, 1, marks=pytest.mark.long),
        pytest.param(die_on_b, 2, marks=pytest.mark.long),
    ],
)
def test_a_log_that_kills_its_workers_stops_no_other(do: Callable[[LogTask, FleetPlan], TaskResult], jobs: int) -> None:
    names = ["a", "b1", "c", "d", "b2", "e"]
    ended = {each.id: done for each, done in run_on_local_processes([task(name) for name in names], PLAN, jobs, do)}
    assert set(ended) == set(names)
    assert {name for name, done in ended.items() if isinstance(done, WorkerDied)} == {"b1", "b2"}


def test_workers_are_kept_from_log_to_log() -> None:
    ended = [done for _, done in run_on_local_processes([task(f"a{k}") for k in range(12)], PLAN, 2, die_on_b)]
    assert len({done.wall_s for done in ended if isinstance(done, TaskResult)}) <= 2


def test_workers_are_renewed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local, "MAX_LOGS_BEFORE_WORKER_REPLACEMENT", 3)
    ended = [done for _, done in run_on_local_processes([task(f"a{k}") for k in range(7)], PLAN, 1, die_on_b)]
    assert len(ended) == 7
    assert len({done.wall_s for done in ended if isinstance(done, TaskResult)}) == 3


def test_no_thread_outlives_the_run() -> None:
    """One that still manages workers when the interpreter ends may print an error then."""
    before = set(threading.enumerate())
    for _ in range(2):
        list(run_on_local_processes([task("a"), task("c"), task("d")], PLAN, 2, die_on_b))
        assert set(threading.enumerate()) <= before


@pytest.mark.usefixtures("server")
def test_an_error_of_the_folder_ends_the_run() -> None:
    with pytest.raises(OutputError, match="no space"):
        list(run_on_local_processes([task("a"), task("c")], PLAN, 2, no_disk))


@pytest.mark.usefixtures("server")
def test_stopping_early_leaves_no_worker() -> None:
    running = run_on_local_processes([task(f"a{k}") for k in range(50)], PLAN, 2, die_on_b)
    _, done = next(running)
    assert isinstance(done, TaskResult)
    assert isinstance(running, Generator)
    running.close()
    until = time.monotonic() + 600
    while time.monotonic() < until:
        try:
            os.kill(int(done.wall_s), 0)
        except ProcessLookupError:
            break
        time.sleep(0.01)
    else:
        pytest.fail("the worker is still there")
