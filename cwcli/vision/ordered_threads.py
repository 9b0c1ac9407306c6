"""Jobs in threads whose results come in the order of the jobs."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

MAX_QUEUED_JOBS_PER_THREAD = 3
"""Greatest number of waiting jobs for each thread. Chosen by hand: it bounds the memory."""

Result = TypeVar("Result")


def run_jobs_in_order(jobs: Iterable[Callable[[], Result]], n_threads: int) -> Generator[Result, None, None]:
    """Run jobs in threads, a bounded number at a time; the results come in the order of the jobs.

    The calling thread is one of the threads: where it would wait for a result it takes the next job that nobody has
    begun. One thread more than there are processors would have to take turns with it.

    Args:
        jobs: Taken when there is room for them.
        n_threads: The calling one included; at least one other works beside it.

    Raises:
        Exception: A job raised it; it comes when the job's result is due.
    """
    waiting: deque[_Task[Result]] = deque()
    pool = ThreadPoolExecutor(max(n_threads - 1, 1), thread_name_prefix="decode")
    try:
        for job in jobs:
            waiting.append(_Task(job, pool))
            if len(waiting) > MAX_QUEUED_JOBS_PER_THREAD * n_threads:
                yield _take_oldest_result(waiting)
        while waiting:
            yield _take_oldest_result(waiting)
        pool.shutdown()
    finally:
        # It must not wait: the garbage collector may close an abandoned generator in a thread that is just starting,
        # and joining another thread there would wait for a lock that this one holds.
        pool.shutdown(wait=False, cancel_futures=True)


class _Task(Generic[Result]):
    """A job that has been handed to the threads."""

    def __init__(self, job: Callable[[], Result], pool: ThreadPoolExecutor) -> None:
        self._job = job
        self.future = pool.submit(job)

    def run_in_this_thread(self) -> None:
        """Do the job in this thread, unless another has begun it."""
        if not self.future.cancel():
            return
        self.future = Future()
        try:
            self.future.set_result(self._job())
        except Exception as error:
            self.future.set_exception(error)


def _take_oldest_result(waiting: deque[_Task[Result]]) -> Result:
    """Wait for the oldest task's result and take it out; meanwhile do younger tasks in this thread."""
    oldest = waiting[0]
    for task in waiting:
        if oldest.future.done():
            break
        task.run_in_this_thread()
    waiting.popleft()
    return oldest.future.result()
