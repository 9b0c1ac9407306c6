"""Make a release: `python -m tools.release 0.2.0`.

`--check` only looks whether it could be made; `--dry-run` also shows what would change in the files and what would be
run, and changes nothing.

Sets the version where it stands (`pyproject.toml`, `cwcli/__init__.py`, `CITATION.cff`) and the date of the changelog's
first section, runs `.ci/run --long`, builds the source distribution and the wheel, commits and tags. What fails leaves
the files as they were. Pushing the tag starts the workflow that builds the other platforms' wheels; nothing is pushed
here.
"""

from __future__ import annotations

import argparse
import datetime
import difflib
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VERSION = re.compile(r"\d+\.\d+\.\d+")
PLACES = {
    "pyproject.toml": re.compile(r'^(version = ")([^"]+)(")$', re.MULTILINE),
    "cwcli/version.py": re.compile(r'^(__version__ = ")([^"]+)(")$', re.MULTILINE),
    "CITATION.cff": re.compile(r"^(version: )(\S+)()$", re.MULTILINE),
}
"""File -> where its version stands."""
SECTION = re.compile(r"^## (\S+) \(([^)]+)\)$", re.MULTILINE)
UNRELEASED = "unreleased"
COMMANDS = (
    [".ci/run", "--long"],
    [sys.executable, "-m", "build", "--outdir", "dist", "."],
    [sys.executable, "-m", "tools.sbom", "dist/cwcli.cdx.json"],
)
"""What a release runs in the checkout, between the change of the files and the tag."""


def versions(root: Path) -> dict[str, str]:
    """File -> the version that it names.

    Raises:
        ValueError: A file names none, or two.
    """
    found = {}
    for name, pattern in PLACES.items():
        matches = pattern.findall((root / name).read_text(encoding="utf-8"))
        if len(matches) != 1:
            raise ValueError(f"{name} has {len(matches)} versions where one is expected")
        found[name] = matches[0][1]
    return found


def problems(root: Path, version: str) -> list[str]:
    """Why a version can't be released, one line each."""
    said = []
    if not VERSION.fullmatch(version):
        said.append(f"{version} is no version: three numbers are wanted, as in 0.2.0")
    if len(set(versions(root).values())) != 1:
        said.append("the files name different versions: " + ", ".join(f"{k} {v}" for k, v in versions(root).items()))
    section = SECTION.search((root / "CHANGELOG.md").read_text(encoding="utf-8"))
    if section is None or section[1] != version or section[2] != UNRELEASED:
        said.append(f"CHANGELOG.md does not begin with `## {version} ({UNRELEASED})`")
    if git(root, "status", "--porcelain"):
        said.append("the checkout has changes that are not committed")
    if git(root, "tag", "--list", f"v{version}"):
        said.append(f"the tag v{version} is there already")
    return said


def write(root: Path, version: str, day: datetime.date) -> None:
    """Set the version and the changelog's date."""
    for name, pattern in PLACES.items():
        path = root / name
        path.write_text(pattern.sub(rf"\g<1>{version}\g<3>", path.read_text(encoding="utf-8")), encoding="utf-8")
    path = root / "CHANGELOG.md"
    text = path.read_text(encoding="utf-8")
    path.write_text(SECTION.sub(f"## {version} ({day.isoformat()})", text, count=1), encoding="utf-8")


def show(root: Path, version: str, day: datetime.date) -> None:
    """Print the lines that a release would change, and the commands that it would run."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        names = [*PLACES, "CHANGELOG.md"]
        for name in names:
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(root / name, copy / name)
        write(copy, version, day)
        for name in names:
            before, after = ((where / name).read_text(encoding="utf-8").splitlines() for where in (root, copy))
            for line in difflib.unified_diff(before, after, name, name, n=0, lineterm=""):
                print(line)
    for command in (*COMMANDS, ["git", "commit", "--all"], ["git", "tag", f"v{version}"]):
        print("would run:", " ".join(command))


def git(root: Path, *arguments: str) -> str:
    """What git prints; it raises where git fails."""
    return subprocess.run(["git", *arguments], cwd=root, check=True, capture_output=True, text=True).stdout


def main() -> int:
    """Exit code 1 where the release can't be made."""
    parser = argparse.ArgumentParser(prog="tools.release")
    parser.add_argument("version")
    parser.add_argument("--check", action="store_true", help="only look whether the release could be made")
    parser.add_argument("--dry-run", action="store_true", help="also show what would be changed and run")
    options = parser.parse_args()
    said = problems(ROOT, options.version)
    for line in said:
        print(f"error: {line}", file=sys.stderr)
    if said and not options.dry_run:
        return 1
    if options.check:
        return 0
    day = datetime.datetime.now(datetime.UTC).date()
    if options.dry_run:
        show(ROOT, options.version, day)
        return int(bool(said))
    write(ROOT, options.version, day)
    try:
        for command in COMMANDS:
            subprocess.run(command, cwd=ROOT, check=True)
    except subprocess.CalledProcessError as error:
        git(ROOT, "checkout", "--", *PLACES, "CHANGELOG.md")
        raise SystemExit(f"error: no release: {error}") from error
    git(ROOT, "commit", "--all", "--message", f"Release {options.version}")
    git(ROOT, "tag", "--annotate", f"v{options.version}", "--message", f"cwcli {options.version}")
    print(f"tagged v{options.version}; dist/ holds what was built; `git push --follow-tags` starts the other wheels")
    return 0


if __name__ == "__main__":
    sys.exit(main())
