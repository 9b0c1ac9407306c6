"""What share of an import is done: the process that imports writes it into a pipe, the one that started it follows."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

READING_TIME_SHARE = 0.12
"""Share of the time of an import that goes by until the log is written; measured on a CSV of 3,000,000 rows."""
PROGRESS_REPORT_INTERVAL_S = 0.3
"""Time between two reports, s. Chosen by hand."""


def open_pipe_for_shares(progress: Callable[[float, float], None]) -> int:
    """Return the end of a pipe into which shares are written, a line each; the caller closes it."""
    reading, writing = os.pipe()

    def forward_progress_lines() -> None:
        with os.fdopen(reading) as lines:
            for line in lines:
                with suppress(ValueError):
                    progress(float(line), 1.0)

    threading.Thread(target=forward_progress_lines, daemon=True).start()
    return writing


class ShareReport:
    """Writes the share that is done into a pipe; nothing where there is none, or where nobody reads it."""

    def __init__(self, descriptor: int | None, reading_share: float) -> None:
        self._descriptor = descriptor
        self._reading_share = reading_share
        self._last_s = 0.0

    @contextmanager
    def report_reading_progress_of_files(self, files: Sequence[str]) -> Iterator[None]:
        """Report in the block how far the files are read, by the positions of the open ones."""
        stop = threading.Event()
        sizes = {os.path.realpath(path): max(Path(path).stat().st_size, 1) for path in files if Path(path).is_file()}

        def report_positions_until_end() -> None:
            most: dict[str, int] = {}
            while not stop.wait(PROGRESS_REPORT_INTERVAL_S):
                for path, position in _positions_of_open_files():
                    if path in sizes:
                        most[path] = max(most.get(path, 0), position)
                self.report_share(self._reading_share * min(sum(most.values()) / sum(sizes.values()), 1.0))

        if self._descriptor is not None and sizes:
            threading.Thread(target=report_positions_until_end, daemon=True).start()
        try:
            yield
        finally:
            stop.set()

    def report_share(self, share: float) -> None:
        """Report the share of the whole import that is done."""
        now_s = time.monotonic()
        if self._descriptor is None or now_s - self._last_s < PROGRESS_REPORT_INTERVAL_S:
            return
        self._last_s = now_s
        with suppress(OSError):
            os.write(self._descriptor, f"{share:.4f}\n".encode())


def _positions_of_open_files() -> Iterator[tuple[str, int]]:
    """Yield name and position of each open file of this process; none where the system does not tell (proc(5))."""
    with suppress(OSError):
        for descriptor in Path("/proc/self/fd").iterdir():
            with suppress(OSError, ValueError):
                name = str(descriptor.readlink())
                first = Path(f"/proc/self/fdinfo/{descriptor.name}").read_text().splitlines()[0]
                yield name, int(first.partition(":")[2])
