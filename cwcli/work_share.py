"""What share of the work is done: long loops report it, and a display that follows it is told; else nothing happens.

The work is divided into parts, each within the part around it. A loop reports in a unit of its own, and only a part
that was announced in this unit takes it: the same loop may run within other work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar


class _Part:
    """A part of the work.

    Attributes:
        first, last: Share of the whole work before and after it.
        unit: In which it is reported, "" for none.
        expected: Number of units that it probably takes, where the loop does not know it.
    """

    def __init__(self, show: Callable[[float], None], first: float, last: float, unit: str, expected: float) -> None:
        self.show, self.first, self.last, self.unit, self.expected = show, first, last, unit, expected
        self.done = 0.0

    def share_of_whole(self, share: float) -> float:
        """Return the share of the whole work where this share of the part is done."""
        return self.first + (self.last - self.first) * min(max(share, 0.0), 1.0)


_CURRENT_PART_OF_WORK: ContextVar[_Part | None] = ContextVar("part", default=None)


@contextmanager
def report_work_share_to(show: Callable[[float], None]) -> Iterator[None]:
    """Tell `show` in the block the share that is done, from 0 to 1, which never falls."""
    most = 0.0

    def show_if_more(share: float) -> None:
        nonlocal most
        if share > most:
            most = share
            show(share)

    token = _CURRENT_PART_OF_WORK.set(_Part(show_if_more, 0.0, 1.0, "", 1.0))
    try:
        yield
    finally:
        _CURRENT_PART_OF_WORK.reset(token)


@contextmanager
def part_of_work(first: float, last: float, unit: str = "", expected: float = 1.0) -> Iterator[None]:
    """Do a part of the current work in the block.

    Args:
        first, last: Share of the current work before and after it.
        unit: What the loop in it reports; "": it has parts of its own, or nothing to report.
        expected: See `count_and_show_finished_work`.
    """
    outer = _CURRENT_PART_OF_WORK.get()
    if outer is None:
        yield
        return
    part = _Part(outer.show, outer.share_of_whole(first), outer.share_of_whole(last), unit, expected)
    token = _CURRENT_PART_OF_WORK.set(part)
    try:
        yield
    finally:
        _CURRENT_PART_OF_WORK.reset(token)
    part.show(part.last)


def report_work(unit: str, done: float, total: float) -> None:
    """Report the units that are done, of how many."""
    part = _CURRENT_PART_OF_WORK.get()
    if part is not None and part.unit == unit and total > 0:
        part.show(part.share_of_whole(done / total))


def count_and_show_finished_work(unit: str) -> None:
    """Report one more unit, of as many as the part expects."""
    part = _CURRENT_PART_OF_WORK.get()
    if part is not None and part.unit == unit:
        part.done += 1.0
        part.show(part.share_of_whole(part.done / part.expected))
