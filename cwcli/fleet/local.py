"""Logs on local processes: each worker does one log at a time, and one that dies takes no other log with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from multiprocessing import connection
from typing import Any

from cwcli.errors import OutputError
from cwcli.fleet.plan import Plan, Task
from cwcli.fleet.worker import Done, work

ATTEMPTS = 2
"""How often a log is begun whose worker dies: it may have been another process's fault."""

LOGS_PER_WORKER = 500
"""Then it makes room for a new one: whatever a library keeps does not add up."""


class WorkerDied(Exception):
    """The worker of a log died at every attempt."""


def run_local(
    tasks: Sequence[Task], plan: Plan, jobs: int, do: Callable[[Task, Plan], Done] = work
) -> Iterator[tuple[Task, Done | WorkerDied]]:
    """Do the logs on `jobs` processes, in order; yields each as it ends.

    When the iterator is closed, or an error passes through it, the workers are gone before it is done.

    Args:
        tasks, plan: What is to be done.
        jobs: Number of worker processes.
        do: What a worker does with a log; a function of a module.

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
    """One process per thread, so that it is known whose log killed it."""

    def __init__(self, plan: Plan, do: Callable[[Task, Plan], Done]) -> None:
        self._do = do
        methods = multiprocessing.get_all_start_methods()
        self._context = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
        if "forkserver" in methods:
            self._context.set_forkserver_preload([__name__, "cwcli.fleet.warm"])
            _start_server()
        self._plan = plan
        self._mine = threading.local()
        self._pools: set[ProcessPoolExecutor] = set()
        self._is_stopping = False
        self._read_stop, self._write_stop = self._context.Pipe(duplex=False)

    def do(self, task: Task) -> Done:
        """Do one log in this thread's process.

        Raises:
            WorkerDied: It died, more than once.
        """
        for attempt in range(1, ATTEMPTS + 1):
            try:
                done = self._pool().submit(self._do, task, self._plan).result()
            except BrokenProcessPool:
                self._dismiss()
                if self._is_stopping:
                    break
            else:
                self._mine.n_done += 1
                if self._mine.n_done >= LOGS_PER_WORKER:
                    self._dismiss()
                return replace(done, attempts=attempt)
        raise WorkerDied

    def _dismiss(self) -> None:
        self._pools.discard(self._mine.pool)
        self._mine.pool.shutdown()
        self._mine.pool = None

    def stop(self) -> None:
        """End the workers at once."""
        self._is_stopping = True
        self._write_stop.close()

    def join(self) -> None:
        """Wait until nothing of them is left, the threads that manage them included.

        One that was still at work when the interpreter ended made it print an `OSError` (Bad file descriptor).
        """
        for pool in self._pools:
            pool.shutdown()
        self._pools.clear()

    def _pool(self) -> ProcessPoolExecutor:
        if getattr(self._mine, "pool", None) is None:
            self._mine.pool = ProcessPoolExecutor(
                1, mp_context=self._context, initializer=_begin, initargs=(self._read_stop,)
            )
            self._mine.n_done = 0
            self._pools.add(self._mine.pool)
        pool: ProcessPoolExecutor = self._mine.pool
        return pool


def _start_server() -> None:
    """Start the process that forks the workers, deaf to Ctrl-C: it would print a traceback while it imports.

    It is a `python -c`, which would import from the current folder first: whatever lies there, among others cwcli's own
    sources that nobody has built.
    """
    from multiprocessing import forkserver, resource_tracker

    safe_path = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    resource_tracker.ensure_running()  # first, because it unblocks the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        forkserver.ensure_running()
    except OSError as error:
        if "too long" not in str(error):
            raise
        what = "the path of the folder for temporary files is too long for the workers' socket"
        raise OutputError(what, where=tempfile.gettempdir(), hint="set TMPDIR to a shorter one") from error
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if safe_path is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = safe_path


def _begin(read_stop: Any) -> None:
    """A worker's first call: leave Ctrl-C to the parent, and go when the parent says so or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_leave_after, args=([read_stop, parent.sentinel],), daemon=True).start()


def _leave_after(ends: list[Any]) -> None:
    connection.wait(ends)
    os._exit(1)
