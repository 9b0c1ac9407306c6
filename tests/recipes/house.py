"""A copy of the checkout in which a recipe of CONTRIBUTING.md is followed word for word.

A recipe is a section `### A measure: 2 files`. Its text names its tests, `pytest ...`. Its steps are blocks of code,
each below a line that begins with the step's number and the file in backticks: a file that is not there yet is given
whole, a change as a `diff`.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
GUIDE = ROOT / "CONTRIBUTING.md"
SAMPLES = ROOT / "sample_logs"
TIMEOUT_S = 600
COPIED = (
    "cwcli",
    "tools",
    "schemas",
    "docs",
    *("tests/laws", "tests/unit", "tests/cli"),
    *(f"tests/{path.name}" for path in (ROOT / "tests").glob("*.py")),
    "README.md",
    "CONTRIBUTING.md",
    "pyproject.toml",
)
LINKED = (".so", ".pyc", ".mcap", ".png")
"""Big files that no recipe writes to are linked to, the others copied."""
LEFT_OUT = shutil.ignore_patterns("*.c", "*.pyx", "*.pxd")
LINT = ("-c", "from importlinter.cli import lint_imports_command as lint; lint()", "--no-cache")
"""What Python runs to check the import contracts."""
_SECTION = re.compile(r"^### (?P<title>[^\n:]+): (?P<n>\d+) files\n(?P<text>.*?)(?=^##|\Z)", re.MULTILINE | re.DOTALL)
_STEP = re.compile(r"^\d\. `(?P<path>[^`]+)`[^\n]*\n\n```(?P<kind>\w+)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)


class Step(NamedTuple):
    """A file of a recipe: its path in the checkout, and its text or, of kind `diff`, what changes in it."""

    path: str
    kind: str
    text: str


class Recipe(NamedTuple):
    """A section of the guide: what is added, how many source files that takes, pytest's arguments, and the steps."""

    title: str
    n_files: int
    laws: tuple[str, ...]
    steps: tuple[Step, ...]


def recipes(text: str) -> dict[str, Recipe]:
    """The recipes of the guide by title."""
    found = {}
    for section in _SECTION.finditer(text):
        steps = tuple(Step(step["path"], step["kind"], step["text"]) for step in _STEP.finditer(section["text"]))
        (laws,) = re.findall(r"`pytest ([^`]+)`", section["text"].replace("\n", " "))
        found[section["title"]] = Recipe(section["title"], int(section["n"]), tuple(shlex.split(laws)), steps)
    return found


def changed(text: str, diff: str) -> str:
    """A text with the parts of a diff changed; parts are separated by lines `@@`.

    Raises:
        ValueError: A part's old lines are not there, or there more than once.
    """
    for part in re.split(r"^@@\n", diff, flags=re.MULTILINE):
        lines = part.splitlines(keepends=True)
        old = "".join(line[1:] or "\n" for line in lines if line[0] != "+")
        new = "".join(line[1:] or "\n" for line in lines if line[0] != "-")
        if text.count(old) != 1:
            raise ValueError(f"there {text.count(old)} times, not once:\n{old}")
        text = text.replace(old, new)
    return text


@dataclass(frozen=True)
class House:
    """The copy.

    Attributes:
        folder: Its checkout.
        laws: What tests the recipe that was followed, as arguments of pytest.
    """

    folder: Path
    laws: tuple[str, ...] = ()

    @classmethod
    def copied_to(cls, folder: Path) -> House:
        """The checkout without what no recipe needs; the kernels are linked to."""
        for name in COPIED:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, folder / name, ignore=LEFT_OUT, copy_function=_copy)
            else:
                shutil.copy2(source, folder / name)
        (folder / "cwcli" / "schemas").symlink_to(folder / "schemas")  # where an installed package has them
        (folder / "cwcli" / "sample_logs").symlink_to(SAMPLES)
        (folder / "sample_logs").symlink_to(SAMPLES)
        return cls(folder)

    def follow(self, recipe: Recipe) -> None:
        """Do what the recipe says.

        Raises:
            ValueError: A new file is there already, or a change does not fit.
        """
        for step in recipe.steps:
            target = self.folder / step.path
            if step.kind == "diff":
                target.write_text(changed(target.read_text(encoding="utf-8"), step.text), encoding="utf-8")
            elif target.exists():
                raise ValueError(f"{step.path} is there already")
            else:
                target.write_text(step.text, encoding="utf-8")

    def touched(self) -> set[str]:
        """The source files that are new or changed; those of `schemas/` count with their channel."""
        found = [path for kind in ("*.py", "*.toml") for path in (self.folder / "cwcli").rglob(kind)]
        own = [path.relative_to(self.folder) for path in found if "sample_logs" not in path.parts]
        return {path.as_posix() for path in own if not _same(self.folder / path, ROOT / path)}

    def run(self, *arguments: str | Path, **variables: str) -> str:
        """What `cwcli` prints to standard output, run from the copy."""
        return self.python("-m", "cwcli", *map(str, arguments), **variables)

    def python(self, *arguments: str, **variables: str) -> str:
        """What a program of the copy prints to standard output.

        Raises:
            AssertionError: It failed.
        """
        done = subprocess.run(
            [sys.executable, *arguments],
            capture_output=True,
            check=False,
            cwd=self.folder,
            env={**self.environment(), **variables},
            text=True,
            timeout=TIMEOUT_S,
        )
        assert done.returncode == 0, done.stderr or done.stdout
        return done.stdout

    def environment(self) -> dict[str, str]:
        """That of a process which is to import the copy."""
        own = {key: value for key, value in os.environ.items() if not key.startswith("CWCLI_")}
        return {**own, "PYTHONPATH": str(self.folder)}

    def write_docs(self) -> str:
        """Write the generated pages, and return those that differ from the checkout's, one after the other."""
        self.python("-m", "tools.reference")
        pages = [page for page in (self.folder / "docs").glob("*.md") if not _same(page, ROOT / "docs" / page.name)]
        return "\n".join(page.read_text(encoding="utf-8") for page in pages)

    def is_clean(self) -> None:
        """Check style and import contracts.

        Raises:
            AssertionError: A rule is broken.
        """
        files = sorted(self.touched())
        self.python("-m", "ruff", "check", *files)
        self.python("-m", "ruff", "format", "--check", *files)
        self.python(*LINT)

    def obeys_its_laws(self) -> None:
        """Run what the recipe names.

        Raises:
            AssertionError: A test fails, or there is none.
        """
        self.python("-m", "pytest", "-q", "-p", "no:cacheprovider", *self.laws)


def _copy(source: str, target: str) -> None:
    if source.endswith(LINKED):
        Path(target).symlink_to(source)
    else:
        shutil.copy2(source, target)


def _same(one: Path, other: Path) -> bool:
    return other.is_file() and one.read_bytes() == other.read_bytes()
