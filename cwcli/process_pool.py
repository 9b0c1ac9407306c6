"""A pool of processes for a study, which leaves none behind when it is interrupted, and how many there can be."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress


def count_available_processors() -> int:
    """The number of processors that this process may use."""
    with suppress(AttributeError):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def process_pool_killed_on_error(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Open a pool of processes, which are ended if the block is left by an error or an interruption."""
    pool = ProcessPoolExecutor(jobs)
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in multiprocessing.active_children():
            child.kill()
        raise
    pool.shutdown()
