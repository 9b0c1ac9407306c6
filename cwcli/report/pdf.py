"""The page on paper: Chromium prints it."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from cwcli.errors import OutputError, UsageError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
TIMEOUT_S = 120.0
DRAWING_MS = 60_000
"""Of the page's own time, which runs as fast as the figures are drawn."""


def find_browser() -> str:
    """The browser's program.

    Raises:
        UsageError: There is none.
    """
    found = next((path for path in map(shutil.which, BROWSERS) if path), None)
    if found is None:
        raise UsageError(
            "--pdf needs Chromium, and none is installed",
            hint="install it (Debian: apt-get install chromium), or write the page and print it from a browser",
        )
    return found


def printed(html: bytes, browser: str) -> bytes:
    """The page as a PDF, every log unfolded.

    Raises:
        OutputError: The browser did not print it.
    """
    with tempfile.TemporaryDirectory(prefix="cwcli-") as folder:
        page, target = Path(folder) / "report.html", Path(folder) / "report.pdf"
        page.write_bytes(html.replace(b'<details class="log"', b'<details open class="log"'))
        command = [
            browser,
            "--headless",
            "--disable-gpu",
            *(["--no-sandbox"] if os.geteuid() == 0 else []),  # root has no sandbox: a container of CI
            "--no-first-run",
            "--disable-background-networking",
            "--no-pdf-header-footer",
            f"--user-data-dir={Path(folder) / 'profile'}",
            f"--virtual-time-budget={DRAWING_MS}",
            f"--print-to-pdf={target}",
            page.as_uri(),
        ]
        try:
            done = subprocess.run(command, capture_output=True, check=False, timeout=TIMEOUT_S)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise OutputError(f"{browser} did not print the page: {error}") from error
        if done.returncode or not target.is_file():
            lines = done.stderr.decode("utf-8", "replace").strip().splitlines()
            said = lines[-1] if lines else "it says nothing"
            raise OutputError(f"{browser} did not print the page: {said}")
        return target.read_bytes()
