"""How much work something is, as a number that no other process and no slower processor changes."""

from __future__ import annotations

import sys
import threading
from collections import Counter
from collections.abc import Callable
from types import CodeType, FrameType
from typing import Any

TraceFunction = Callable[[FrameType, str, Any], Any]

HANG_S = 600.0
"""Seconds after which a test that waits gives up: it only keeps the suite from hanging, and judges nothing."""


def count_calls(function: Callable[[], object]) -> int:
    """Calls of Python and of built-in functions that `function` makes, in this thread and in those that it starts."""
    n_calls = 0

    def count(frame: FrameType, event: str, argument: object) -> None:
        nonlocal n_calls
        n_calls += event in ("call", "c_call")

    before = sys.getprofile()
    threading.setprofile(count)
    sys.setprofile(count)
    try:
        function()
    finally:
        sys.setprofile(before)
        threading.setprofile(None)
    return n_calls


def count_lines(function: Callable[[], object]) -> Counter[str]:
    """Lines of Python that `function` executes, by the function that holds them (`file:name`), in all its threads.

    Each turn of a loop counts at least one, a comprehension's and a generator's too, and so does each call from
    compiled code. What compiled code does by itself counts nothing.
    """
    by_code: Counter[CodeType] = Counter()

    def count(frame: FrameType, event: str, argument: object) -> TraceFunction:
        by_code[frame.f_code] += 1
        return count

    before = sys.gettrace()
    threading.settrace(count)
    sys.settrace(count)
    try:
        function()
    finally:
        sys.settrace(before)
        threading.settrace(None)
    lines: Counter[str] = Counter()
    for code, n_lines in by_code.items():
        lines[f"{code.co_filename}:{code.co_qualname}"] += n_lines
    return lines


def growing_functions(short: Counter[str], long: Counter[str], allowance: int) -> dict[str, int]:
    """The functions that execute over `allowance` lines more in `long` than in `short`, and how many more."""
    more = {name: long[name] - short[name] for name in long}
    return {name: n for name, n in sorted(more.items(), key=lambda item: -item[1]) if n > allowance}
