"""Jobs in threads: their order, and a generator that is left before its end."""

from __future__ import annotations

from functools import partial
from threading import Event

from cwcli.vision.ordered_threads import run_jobs_in_order

LONGEST_WAIT_S = 20.0
"""Time after which an event counts as not coming, s; never reached."""


def test_results_come_in_the_order_of_the_jobs() -> None:
    assert list(run_jobs_in_order((partial(int, k) for k in range(50)), 3)) == list(range(50))


def test_closing_does_not_wait_for_a_job_that_runs() -> None:
    """The garbage collector may close it in a thread that is just starting, where waiting for a thread never ends."""
    began, may_end, ended = Event(), Event(), Event()

    def slow_job() -> int:
        began.set()
        may_end.wait(LONGEST_WAIT_S)
        ended.set()
        return 1

    results = run_jobs_in_order([lambda: 0, slow_job], 2)
    assert next(results) == 0
    assert began.wait(LONGEST_WAIT_S)
    results.close()
    assert not ended.is_set()
    may_end.set()
    assert ended.wait(LONGEST_WAIT_S)
