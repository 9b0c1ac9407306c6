"""Workers for Windows, where processes can't be forked: each imports all modules itself."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection
from typing import Any

from cwcli.estimation.track import WORKER_ENVIRONMENT_VARIABLE
from cwcli.fleet.worker_call import WorkerLost


class SpawningServer:
    """Starts workers with the interface of `cwcli.fleet.fork_server.ForkServer`."""

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._held, self._parent_pipe = self._context.Pipe(duplex=False)
        self._workers: set[SpawnedWorker] = set()

    def start_worker(self) -> SpawnedWorker:
        """Start a new worker."""
        pool = ProcessPoolExecutor(1, mp_context=self._context, initializer=_initialise_worker, initargs=(self._held,))
        worker = SpawnedWorker(pool)
        self._workers.add(worker)
        return worker

    def stop_workers(self) -> None:
        """Stop all workers at once."""
        self._parent_pipe.close()

    def wait_until_stopped(self) -> None:
        """Wait until all workers and the threads that manage them have ended."""
        for worker in self._workers:
            worker.close()


class SpawnedWorker:
    """A worker process that makes one call at a time."""

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self._pool = pool

    def call_function(self, function: Any, *arguments: Any) -> Any:
        """Call a function of a module in the worker and return its result; its errors are raised here.

        Raises:
            WorkerLost: The worker went away.
        """
        try:
            return self._pool.submit(function, *arguments).result()
        except BrokenProcessPool as error:
            raise WorkerLost from error

    def close(self) -> None:
        """Wait until the worker has ended."""
        self._pool.shutdown()


def _initialise_worker(parent_pipe: Any) -> None:
    """Initialise a worker: ignore Ctrl-C, and exit when the parent stops it or has gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ[WORKER_ENVIRONMENT_VARIABLE] = "1"
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_exit_when_any_end_closes, args=([parent_pipe, parent.sentinel],), daemon=True).start()


def _exit_when_any_end_closes(ends: list[Any]) -> None:
    connection.wait(ends)
    os._exit(1)
