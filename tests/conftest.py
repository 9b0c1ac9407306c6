"""What is not installed is not collected, and said in one line above the tests; nothing is skipped silently."""

from __future__ import annotations

import shutil
from pathlib import Path

TESTS = Path(__file__).parent
SHARED = TESTS.parents[1] / "shared"
HAS_TYPESCRIPT_READER = (
    bool(shutil.which("node")) and (TESTS / "typescript" / "node_modules" / "@mcap" / "core").is_dir()
)

collect_ignore = [] if HAS_TYPESCRIPT_READER else ["cli/test_typescript_reader.py"]


def pytest_report_header() -> list[str]:
    """One line for each part of the tests that does not run here, with what it needs."""
    lines = []
    if not HAS_TYPESCRIPT_READER:
        lines.append(
            "not collected: tests/cli/test_typescript_reader.py (needs Node.js, and `npm ci --prefix tests/typescript`)"
        )
    for folder, what in (("logs", "the development logs"), ("oracles", "the results of other programs")):
        if not (SHARED / folder).is_dir():
            lines.append(f"skipped: the tests with {what} (needs ../shared/{folder} beside the checkout)")
    return lines
