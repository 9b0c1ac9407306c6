"""Jobs in threads whose results come in order."""

from __future__ import annotations

import threading
import time
from functools import partial

import pytest

from cwcli.vision.ordered_threads import run_jobs_in_order


def test_only_a_few_jobs_wait() -> None:
    started = []
    lock = threading.Lock()

    def job(k: int) -> int:
        with lock:
            started.append(k)
        time.sleep(0.001 * (5 - k % 5))
        return k

    results = run_jobs_in_order((partial(job, k) for k in range(100)), 2)
    assert [next(results) for _ in range(10)] == list(range(10))
    assert len(started) <= 10 + 2 * 3 + 1
    results.close()


def test_the_calling_thread_works_where_it_would_wait() -> None:
    second_is_done = threading.Event()

    def first() -> str:
        return "in time" if second_is_done.wait(20.0) else "too late"

    def second() -> str:
        second_is_done.set()
        return threading.current_thread().name

    # the one other thread is busy with the first job, which ends when the second has been done
    results = list(run_jobs_in_order([first, second], 2))
    assert results == ["in time", threading.current_thread().name]


@pytest.mark.parametrize("n_threads", [1, 2, 3])
def test_an_error_comes_when_its_result_is_due(n_threads: int) -> None:
    def job(k: int) -> int:
        if k == 5:
            raise ValueError("five")
        return k

    results = run_jobs_in_order((partial(job, k) for k in range(20)), n_threads)
    assert [next(results) for _ in range(5)] == [0, 1, 2, 3, 4]
    with pytest.raises(ValueError, match="five"):
        next(results)
