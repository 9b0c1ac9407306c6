"""How much work something is, as a number that no other process and no slower processor changes."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from types import FrameType

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
        threading.setprofile(None)  # type: ignore[arg-type]
    return n_calls
