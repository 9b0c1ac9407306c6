"""docs/tutorial.md: its commands run as they stand there, and what it shows is what they print."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import ROOT, SAMPLES

PAGE = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^## \d+\. ([^\n]+)\n(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL))
RTOL = 0.02
ATOL = 0.011
"""One in the last digit that is shown, which other versions of NumPy may change, and rounding."""
TIMEOUT_S = 300


def commands(section: str) -> list[str]:
    """The command lines of a section."""
    return [line.strip() for line in re.findall(r"^ {4}(?:cwcli|CWCLI)\b.*$", SECTIONS[section], re.MULTILINE)]


def run_line(line: str, folder: Path) -> str:
    """What a command line prints. A pipe into `jq`, which may not be installed, is left out.

    Raises:
        CalledProcessError: It ended with another exit code than 0.
    """
    script = f'cwcli() {{ {shlex.quote(sys.executable)} -m cwcli "$@"; }}\n{re.sub(r"[|] jq .*", "", line)}'
    environment = {key: value for key, value in os.environ.items() if not key.startswith("CWCLI_")}
    return subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script],
        cwd=folder,
        env={**environment, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
        timeout=TIMEOUT_S,
    ).stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the tutorial, after section 2."""
    folder = tmp_path_factory.mktemp("tutorial")
    shutil.copy(SAMPLES / "intersection.mcap", folder / "drive.mcap")
    for line in commands("All of it, and the tables"):
        run_line(line, folder)
    return folder


def test_the_commands_that_can_run_at_once_are_those_named(folder: Path) -> None:
    plain, document = commands("What is in the log")
    assert "/gps/fix" in run_line(plain, folder)
    ready = [name for name, command in json.loads(run_line(document, folder))["commands"].items() if command["ready"]]
    assert f"the commands that can run at once: {', '.join(f'`{name}`' for name in ready)}." in " ".join(PAGE.split())


def test_the_printed_numbers_are_those_of_the_page(folder: Path) -> None:
    text = SECTIONS["All of it, and the tables"]
    (code,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    shown = re.findall(r"^ {4}(.*)$", text.partition(code)[2], re.MULTILINE)
    printed = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
        exec(compile(code, "tutorial", "exec"), {})
    lines = [line for line in printed.getvalue().splitlines() if line.strip()]
    assert len(shown) == len(lines) == 10
    for ours, theirs in zip(shown, lines, strict=True):
        assert len(ours.split()) == len(theirs.split())
        for word, expected in zip(ours.split(), theirs.split(), strict=True):
            if re.fullmatch(r"-?\d+\.\d+", expected):
                assert float(word) == pytest.approx(float(expected), rel=RTOL, abs=ATOL)
            else:
                assert word == expected


def test_the_tables_are_those_that_are_written(folder: Path) -> None:
    named = re.findall(r"^\| (`.*?) \| ", SECTIONS["All of it, and the tables"], re.MULTILINE)
    assert sorted(name.strip("`") for cell in named for name in cell.split(", ")) == sorted(
        path.stem for path in (folder / "metrics").iterdir()
    )


@pytest.mark.parametrize("section", ["Pipes and JSON", "In CI", "Late brakes", "A lane departure"])
def test_the_other_commands_run(folder: Path, section: str) -> None:
    lines = commands(section)
    assert lines
    for line in lines:
        run_line(line, folder)
