"""A progress line for anything longer than a second: on stderr, and only on a terminal that can wipe it again."""

from __future__ import annotations

import os
import sys
import threading
import time
from types import TracebackType

from cwcli.cli.text import WIDTH, display_width, printable
from cwcli.url import redact_urls

SHOW_AFTER_S = 1.0
REFRESH_S = 0.2


class Progress:
    """Tells on one line what is being done, for how long, and how much of it is done where that is known.

    A background thread redraws the line, so a long call that reports nothing still shows its time. An instance is
    passed on as a plain callable: `progress(done, total)`.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self._enabled = (
            not quiet and sys.stderr is not None and sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
        )
        self._what = ""
        self._fraction: float | None = None
        self._left: float | None = None  # as much as this times what has passed
        self._begin = time.monotonic()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def step(self, what: str) -> None:
        """Begin the next step."""
        self._what = printable(redact_urls(what))
        self._fraction = self._left = None

    def __call__(self, done: float, total: float, skipped: float = 0) -> None:
        """Report how much is done since the beginning, in any unit, and how much of that took no time."""
        self._fraction = min(max(done / total, 0.0), 1.0) if total > 0 else None
        self._left = (total - done) / (done - skipped) if skipped < done < total else None

    def __enter__(self) -> Progress:
        if self._enabled:
            self._thread = threading.Thread(target=self._draw, daemon=True)
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._thread is not None:
            self._stop.set()
            self._thread.join()
            self._thread = None

    def line(self, elapsed_s: float, width: int = WIDTH) -> str:
        """The line as it is shown, narrower than the terminal: a line that wraps can't be wiped.

        What is too long is cut: the name, and what follows it only where that alone does not fit.

        Args:
            elapsed_s: Since the beginning.
            width: Columns of the terminal.
        """
        done = "" if self._fraction is None else f" {100 * self._fraction:3.0f} %"
        left = "" if self._left is None else f", about {elapsed_s * self._left:.0f} s left"
        told = f"{done} ({elapsed_s:.0f} s{left})"
        return (_cut(self._what, width - 1 - display_width(told)) + told)[: max(width - 1, 0)]

    def _draw(self) -> None:
        drawn = False
        while not self._stop.wait(REFRESH_S):
            elapsed_s = time.monotonic() - self._begin
            if elapsed_s >= SHOW_AFTER_S and self._what:
                sys.stderr.write(f"\r{self.line(elapsed_s, _columns())}\x1b[K")
                sys.stderr.flush()
                drawn = True
        if drawn:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()


def _cut(text: str, width: int) -> str:
    """The beginning of a text that fills at most `width` cells of a terminal."""
    cut = text[: max(width, 0)]  # a cell or two each, but for combining marks
    while display_width(cut) > width > 0:
        cut = cut[:-1]
    return cut


def _columns() -> int:
    """Of the terminal on standard error, which may have been made narrower meanwhile."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns or WIDTH
    except (OSError, ValueError):
        return WIDTH
