"""A progress line for work longer than a second, on stderr and only on a terminal that can erase it."""

from __future__ import annotations

import os
import sys
import threading
import time
from types import TracebackType

from cwcli.cli.text import DEFAULT_OUTPUT_WIDTH_COLUMNS, escape_control_characters, terminal_cells_of_text
from cwcli.url import redact_urls

PROGRESS_DELAY_S = 1.0
"""Time after which the line is shown, s; chosen by hand."""
MIN_DONE_WORK_TO_SHOW_REMAINING_TIME_SHARE = 0.03
"""Least share of the work after which the time that is left is shown; chosen by hand: before, it jumps."""
PROGRESS_REFRESH_S = 0.2
"""Time between two updates of the line, s; chosen by hand."""


class Progress:
    """Shows on one line the current step, the elapsed time and, if known, the share that is done.

    A background thread redraws the line, so a long call that reports nothing still shows its time. An instance is
    passed on as a plain callable: `progress(done, total)`.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self._enabled = (
            not quiet and sys.stderr is not None and sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
        )
        self._what = ""
        self._fraction: float | None = None
        self._left: float | None = None  # remaining time per elapsed time
        self._begin = time.monotonic()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def is_shown(self) -> bool:
        """Whether there is a terminal that can show the line."""
        return self._enabled

    def begin_step(self, what: str) -> None:
        """Show the name of the next step."""
        self._what = escape_control_characters(redact_urls(what))
        self._fraction = self._left = None

    def show_share(self, share: float) -> None:
        """Show the share of the work that is done, from 0 to 1 (`cwcli.work_share.report_work_share_to`)."""
        self._fraction = share
        self._left = (1.0 - share) / share if MIN_DONE_WORK_TO_SHOW_REMAINING_TIME_SHARE <= share < 1.0 else None

    def __call__(self, done: float, total: float, skipped: float = 0) -> None:
        """Report the work done, the total and the part that was skipped, in any common unit."""
        self._fraction = min(max(done / total, 0.0), 1.0) if total > 0 else None
        self._left = (total - done) / (done - skipped) if skipped < done < total else None

    def __enter__(self) -> Progress:
        if self._enabled:
            self._thread = threading.Thread(target=self._redraw_until_stopped, daemon=True)
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._thread is not None:
            self._stop.set()
            self._thread.join()
            self._thread = None

    def format_line(self, elapsed_s: float, width: int = DEFAULT_OUTPUT_WIDTH_COLUMNS) -> str:
        """Format the line, narrower than the terminal, because a wrapped line can't be erased.

        The name of the step is cut first, the numbers only if they alone do not fit.

        Args:
            elapsed_s: Time since the beginning, s.
        """
        done = "" if self._fraction is None else f" {100 * self._fraction:3.0f} %"
        left = "" if self._left is None else f", about {elapsed_s * self._left:.0f} s left"
        progress_text = f"{done} ({elapsed_s:.0f} s{left})"
        return (_drop_text_beyond_width(self._what, width - 1 - terminal_cells_of_text(progress_text)) + progress_text)[
            : max(width - 1, 0)
        ]

    def _redraw_until_stopped(self) -> None:
        drawn = False
        while not self._stop.wait(PROGRESS_REFRESH_S):
            elapsed_s = time.monotonic() - self._begin
            if elapsed_s >= PROGRESS_DELAY_S and self._what:
                sys.stderr.write(f"\r{self.format_line(elapsed_s, _stderr_width())}\x1b[K")
                sys.stderr.flush()
                drawn = True
        if drawn:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()


def _drop_text_beyond_width(text: str, width: int) -> str:
    """Cut a text to at most `width` cells of a terminal."""
    cut = text[: max(width, 0)]  # a cell or two each, but for combining marks
    while terminal_cells_of_text(cut) > width > 0:
        cut = cut[:-1]
    return cut


def _stderr_width() -> int:
    """Current width of the terminal on standard error, in columns."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns or DEFAULT_OUTPUT_WIDTH_COLUMNS
    except (OSError, ValueError):
        return DEFAULT_OUTPUT_WIDTH_COLUMNS
