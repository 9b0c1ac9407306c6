"""Logs on local processes: each worker does one log at a time, and one that dies takes no other log with it."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import replace
from typing import TYPE_CHECKING

from cwcli.fleet.plan import FleetPlan, LogTask, TaskResult
from cwcli.fleet.worker_call import WorkerLost

if TYPE_CHECKING:
    from cwcli.fleet.fork_server import ForkServer
    from cwcli.fleet.spawned import SpawnedWorker, SpawningServer
    from cwcli.fleet.worker_call import PipeWorker

MAX_ATTEMPTS_AT_LOG = 2
"""Greatest number of attempts at a log whose worker dies. Chosen: one repetition, because another process may have
caused it."""

MAX_LOGS_BEFORE_WORKER_REPLACEMENT = 500
"""Logs after which a worker is replaced, so that memory that libraries keep does not add up; chosen by hand."""


class WorkerDied(Exception):
    """The worker of a log died at every attempt."""


def run_on_local_processes(
    tasks: Sequence[LogTask],
    plan: FleetPlan,
    jobs: int,
    process: Callable[[LogTask, FleetPlan], TaskResult] | None = None,
) -> Iterator[tuple[LogTask, TaskResult | WorkerDied]]:
    """Process the logs on `jobs` local processes, in order; yield each task with its result as it ends.

    All workers are stopped before the iterator closes, also after an error.

    Args:
        tasks, plan: The logs, and what is done with each.
        process: Function of a module that a worker calls for each log; None for `process_log`.

    Raises:
        OutputError: The output folder can't be written.
    """
    if process is None:
        from cwcli.fleet.worker import process_log

        process = process_log
    workers = _WorkerPool(plan, process)
    threads = ThreadPoolExecutor(jobs, thread_name_prefix="log")
    try:
        running: dict[Future[TaskResult], LogTask] = {}
        waiting = iter(tasks)
        while True:
            for task in waiting:
                running[threads.submit(workers.run_task_with_retries, task)] = task
                if len(running) >= 2 * jobs:
                    break
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                task = running.pop(future)
                try:
                    yield task, future.result()
                except WorkerDied as died:
                    yield task, died
    finally:
        workers.stop_workers()
        threads.shutdown(cancel_futures=True)
        workers.wait_until_stopped()


class _WorkerPool:
    """One worker process per thread, so that it is known which log killed a worker."""

    def __init__(self, plan: FleetPlan, do: Callable[[LogTask, FleetPlan], TaskResult]) -> None:
        self._do = do
        self._plan = plan
        self._server = _start_server()
        self._mine = threading.local()
        self._is_stopping = False

    def run_task_with_retries(self, task: LogTask) -> TaskResult:
        """Process one log in this thread's worker.

        Raises:
            WorkerDied: The worker died at every attempt.
        """
        for attempt in range(1, MAX_ATTEMPTS_AT_LOG + 1):
            try:
                task_result: TaskResult = self._worker_of_thread().call_function(self._do, task, self._plan)
            except WorkerLost:
                self._stop_and_replace_worker()
                if self._is_stopping:
                    break
            else:
                self._mine.n_done += 1
                if self._mine.n_done >= MAX_LOGS_BEFORE_WORKER_REPLACEMENT:
                    self._stop_and_replace_worker()
                return replace(task_result, attempts=attempt)
        raise WorkerDied

    def stop_workers(self) -> None:
        """Stop all workers at once."""
        self._is_stopping = True
        self._server.stop_workers()

    def wait_until_stopped(self) -> None:
        """Wait until all workers have ended."""
        self._server.wait_until_stopped()

    def _worker_of_thread(self) -> PipeWorker | SpawnedWorker:
        if getattr(self._mine, "worker", None) is None:
            self._mine.worker = self._server.start_worker()
            self._mine.n_done = 0
        worker: PipeWorker | SpawnedWorker = self._mine.worker
        return worker

    def _stop_and_replace_worker(self) -> None:
        worker, self._mine.worker = getattr(self._mine, "worker", None), None
        if worker is not None:
            worker.close()


def _start_server() -> ForkServer | SpawningServer:
    if hasattr(os, "fork"):
        from cwcli.fleet.fork_server import ForkServer

        return ForkServer()
    from cwcli.fleet.spawned import SpawningServer

    return SpawningServer()
