"""Logs on local processes: each worker does one log at a time, and one that dies takes no other log with it."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import replace
from typing import TYPE_CHECKING

from cwcli.fleet.plan import Plan, Task
from cwcli.fleet.worker import Done, work
from cwcli.fleet.worker_call import WorkerLost

if TYPE_CHECKING:
    from cwcli.fleet.fork_server import ForkServer
    from cwcli.fleet.spawned import SpawnedWorker, SpawningServer
    from cwcli.fleet.worker_call import PipeWorker

ATTEMPTS = 2
"""Attempts at a log whose worker dies; chosen: one repetition, because another process may have caused it."""

LOGS_PER_WORKER = 500
"""Logs after which a worker is replaced, so that memory that libraries keep does not add up; chosen by hand."""


class WorkerDied(Exception):
    """The worker of a log died at every attempt."""


def run_local(
    tasks: Sequence[Task], plan: Plan, jobs: int, do: Callable[[Task, Plan], Done] = work
) -> Iterator[tuple[Task, Done | WorkerDied]]:
    """Process the logs on `jobs` local processes, in order; yield each task with its result as it ends.

    All workers are stopped before the iterator closes, also after an error.

    Args:
        tasks, plan: The logs, and what is done with each.
        jobs: Number of worker processes.
        do: Function of a module that a worker calls for each log.

    Raises:
        OutputError: The output folder can't be written.
    """
    workers = _Workers(plan, do)
    threads = ThreadPoolExecutor(jobs, thread_name_prefix="log")
    try:
        running: dict[Future[Done], Task] = {}
        waiting = iter(tasks)
        while True:
            for task in waiting:
                running[threads.submit(workers.do, task)] = task
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
        workers.stop()
        threads.shutdown(cancel_futures=True)
        workers.join()


class _Workers:
    """One worker process per thread, so that it is known which log killed a worker."""

    def __init__(self, plan: Plan, do: Callable[[Task, Plan], Done]) -> None:
        self._do = do
        self._plan = plan
        self._server = _server()
        self._mine = threading.local()
        self._is_stopping = False

    def do(self, task: Task) -> Done:
        """Process one log in this thread's worker.

        Raises:
            WorkerDied: The worker died at every attempt.
        """
        for attempt in range(1, ATTEMPTS + 1):
            try:
                done: Done = self._worker().call(self._do, task, self._plan)
            except WorkerLost:
                self._dismiss()
                if self._is_stopping:
                    break
            else:
                self._mine.n_done += 1
                if self._mine.n_done >= LOGS_PER_WORKER:
                    self._dismiss()
                return replace(done, attempts=attempt)
        raise WorkerDied

    def stop(self) -> None:
        """Stop all workers at once."""
        self._is_stopping = True
        self._server.stop()

    def join(self) -> None:
        """Wait until all workers have ended."""
        self._server.join()

    def _worker(self) -> PipeWorker | SpawnedWorker:
        if getattr(self._mine, "worker", None) is None:
            self._mine.worker = self._server.start_worker()
            self._mine.n_done = 0
        worker: PipeWorker | SpawnedWorker = self._mine.worker
        return worker

    def _dismiss(self) -> None:
        worker, self._mine.worker = getattr(self._mine, "worker", None), None
        if worker is not None:
            worker.close()


def _server() -> ForkServer | SpawningServer:
    if hasattr(os, "fork"):
        from cwcli.fleet.fork_server import ForkServer

        return ForkServer()
    from cwcli.fleet.spawned import SpawningServer

    return SpawningServer()
