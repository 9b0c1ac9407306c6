"""The commit that wrote the figures last, built in a folder of its own, to be counted in another environment."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
LEDGER_PATH = "tests/budget/instructions.json"
COUNTED_PATHS = ("cwcli", "schemas", "sample_logs", "setup.py", "tests/budget/cases.py", "tests/budget/read_signals.py")
"""What the counts depend on: where none of it has changed, nothing needs to be counted."""


def git(*arguments: str) -> str | None:
    """What git prints in the checkout; None where it fails, as in an unpacked archive."""
    try:
        done = subprocess.run(["git", *arguments], check=False, cwd=ROOT, capture_output=True, text=True)
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def ledger_commit() -> str | None:
    """The last commit that changed the figures; None where the history does not reach back to it."""
    return git("log", "-1", "--format=%H", "--", LEDGER_PATH) or None


def is_unchanged(commit: str) -> bool:
    """Whether everything that the counts depend on is as it was in a commit, files that git does not know included."""
    return git("diff", "--quiet", commit, "--", *COUNTED_PATHS) is not None and not git(
        "ls-files", "--others", "--exclude-standard", "--", *COUNTED_PATHS
    )


def build_commit(commit: str, folder: Path) -> None:
    """Unpack a commit into an empty folder and compile its kernels.

    Raises:
        subprocess.CalledProcessError: Git or the compiler failed.
    """
    archive = folder.with_suffix(".tar")
    subprocess.run(["git", "archive", "--output", archive, commit], check=True, cwd=ROOT)
    folder.mkdir()
    subprocess.run(["tar", "-xf", archive, "-C", folder], check=True)
    archive.unlink()
    subprocess.run(
        [sys.executable, "setup.py", "-q", "build_ext", "--inplace"], check=True, cwd=folder, stdout=subprocess.DEVNULL
    )
