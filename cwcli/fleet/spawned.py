"""Workers where processes can't be forked, on Windows: each imports everything for itself."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection
from typing import Any

from cwcli.estimation.track import IS_WORKER
from cwcli.fleet.worker_call import WorkerLost


class SpawningServer:
    """Starts workers, as `cwcli.fleet.fork_server.ForkServer` does."""

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._held, self._leash = self._context.Pipe(duplex=False)
        self._workers: set[SpawnedWorker] = set()

    def start_worker(self) -> SpawnedWorker:
        """A new worker."""
        pool = ProcessPoolExecutor(1, mp_context=self._context, initializer=_begin, initargs=(self._held,))
        worker = SpawnedWorker(pool)
        self._workers.add(worker)
        return worker

    def stop(self) -> None:
        """End all workers at once."""
        self._leash.close()

    def join(self) -> None:
        """Wait until nothing of them is left, the threads that manage them included."""
        for worker in self._workers:
            worker.close()


class SpawnedWorker:
    """A process that does one thing at a time."""

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self._pool = pool

    def call(self, function: Any, *arguments: Any) -> Any:
        """What a function of a module returns; what it raises is raised here.

        Raises:
            WorkerLost: The worker went away.
        """
        try:
            return self._pool.submit(function, *arguments).result()
        except BrokenProcessPool as error:
            raise WorkerLost from error

    def close(self) -> None:
        """Wait until it is gone."""
        self._pool.shutdown()


def _begin(leash: Any) -> None:
    """A worker's first call: leave Ctrl-C to the parent, and go when the parent says so or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ[IS_WORKER] = "1"
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_leave_after, args=([leash, parent.sentinel],), daemon=True).start()


def _leave_after(ends: list[Any]) -> None:
    connection.wait(ends)
    os._exit(1)
