"""The page on paper: Chromium prints it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
from contextlib import suppress
from math import ceil
from pathlib import Path
from typing import IO

from cwcli.bounded_process import Limits, command_with_limits
from cwcli.errors import OutputError, UsageError

BROWSER_PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
"""Programs that can print a page, in the order in which they are looked for."""
PRINT_TIMEOUT_S = 120.0
"""Time that the browser may take to start and to print, in s. Chosen by hand; not fitted."""
PRINT_TIMEOUT_PER_FIGURE_S = 2.0
"""Time that the browser may take in addition for each figure, in s. Chosen by hand; not fitted."""
BROWSER_CPU_S_PER_ALLOWED_S = 8
"""Processor time that one process of the browser may take for each second that the browser may take: it has threads.
Chosen by hand; not fitted."""
MAX_BROWSER_FILE_BYTES = 2_000_000_000
"""Greatest size of a file that the browser writes. Chosen by hand: pages of an hour make 100 MB."""
MAX_BROWSER_OPEN_FILES = 4096
"""The greatest number of files that one process of the browser has open at once. Chosen by hand."""
FIGURE_TAG = b'<script type="text/plain" id="log-'
"""The tag by which the page's figures are counted."""
DRAWING_TIME_BUDGET_MS = 60_000
"""Virtual time that the browser gives the page to draw its figures, in ms. Chosen by hand; not fitted."""


def find_browser() -> str:
    """Find a browser that can print the page.

    Raises:
        UsageError: There is none.
    """
    found = next((path for path in map(shutil.which, BROWSER_PROGRAMS) if path), None)
    if found is None:
        raise UsageError(
            "a PDF needs Chromium, which is not installed",
            hint="install it (Debian: apt-get install chromium), or write report.html and print it from a browser",
        )
    return found


def print_html_to_pdf(html: bytes, browser: str) -> bytes:
    """Print the page as a PDF, every log unfolded.

    Raises:
        OutputError: The browser did not print it.
    """
    limit_s = PRINT_TIMEOUT_S + PRINT_TIMEOUT_PER_FIGURE_S * html.count(FIGURE_TAG)
    try:
        with tempfile.TemporaryDirectory(prefix="cwcli-", ignore_cleanup_errors=True) as folder:
            return _print_pdf_in_folder(Path(folder), html, browser, limit_s)
    except subprocess.TimeoutExpired as error:
        raise OutputError(f"{browser} did not print the page: it took longer than {limit_s:.0f} s") from error
    except OSError as error:
        raise OutputError(f"{browser} did not print the page: {error}") from error


def _print_pdf_in_folder(folder: Path, html: bytes, browser: str, limit_s: float) -> bytes:
    """Print the page inside a temporary folder."""
    page, target, talk = folder / "report.html", folder / "report.pdf", folder / "talk.txt"
    page.write_bytes(html.replace(b'<details class="log"', b'<details open class="log"'))
    command = [
        browser,
        "--headless",
        "--disable-gpu",
        *(["--no-sandbox"] if os.geteuid() == 0 else []),  # root has no sandbox: a container of CI
        "--no-first-run",
        "--disable-background-networking",
        "--host-resolver-rules=MAP * ~NOTFOUND",  # the page needs no network
        "--no-pdf-header-footer",
        f"--user-data-dir={folder / 'profile'}",
        f"--virtual-time-budget={DRAWING_TIME_BUDGET_MS}",
        f"--print-to-pdf={target}",
        page.as_uri(),
    ]
    # no limit of memory: the browser reserves terabytes of addresses, and has a limit for each page
    limits = Limits(
        ceil(limit_s) * BROWSER_CPU_S_PER_ALLOWED_S,
        MAX_BROWSER_FILE_BYTES,
        n_files=MAX_BROWSER_OPEN_FILES,
        has_threads=True,
    )
    # without privileges, giving up the network takes the right to a sandbox, which is worth more
    command = command_with_limits(command, limits, has_no_network=os.geteuid() == 0)
    with talk.open("wb") as said:  # no pipe: it would stay open as long as any child of the browser lives
        code = _run_and_end_children(command, said, limit_s)
    if code or not target.is_file():
        lines = talk.read_text("utf-8", "replace").strip().splitlines()
        raise OutputError(f"{browser} did not print the page: {lines[-1] if lines else 'it says nothing'}")
    return target.read_bytes()


def _run_and_end_children(command: list[str], stderr_file: IO[bytes], limit_s: float) -> int:
    """Run a program and return its exit code; its children are ended with it, as they write into its folder."""
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=stderr_file, start_new_session=True
    )
    try:
        return process.wait(limit_s)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
