"""The name of the package for pip: the same everywhere, and never `cwcli`, which is a stranger's package."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

import pytest

from cwcli.errors import PIP_DISTRIBUTION_NAME, install_hint

ROOT = Path(__file__).parents[1]
NAME = r"(?<![\w./-])cwcli(?![\w.-])"
"""The bare name: not `cwcli-drive`, a path (`./cwcli`, `bin/cwcli`) or a module (`cwcli.errors`)."""
TOOL = r"\b(?:pip3?|pipx|uv|uvx|poetry|pdm|conda|mamba)\b"
COMMAND = rf"{TOOL}[^\n`&|;]*?\s(?:install|download|add|run|wheel)\s[^\n`&|;#]*?{NAME}"
REQUIREMENT = rf"{NAME}\s*(?:\[[a-z, ]+\]|(?:==|>=|~=)\s*\d)"
WRONG = re.compile(f"{COMMAND}|{REQUIREMENT}")


def texts() -> list[Path]:
    """The files of the checkout that hold text, this one aside."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    paths = [ROOT / name for name in names.split("\0") if name]
    return [path for path in paths if path.is_file() and path != Path(__file__) and b"\0" not in path.read_bytes()]


@pytest.mark.parametrize(
    "text",
    [
        "pip install cwcli",
        "    - pip install 'cwcli[report]'",
        "pip install -q --pre cwcli",
        "pip download --no-deps cwcli",
        "uv tool install cwcli",
        "pipx run cwcli",
        "the extra `cwcli[can]`",
        "cwcli==0.1.0",
        "dependencies = ['cwcli>=0.1']",
    ],
)
def test_the_strangers_name_is_found(text: str) -> None:
    assert WRONG.search(text)


@pytest.mark.parametrize(
    "text",
    [
        "pip install 'cwcli-drive[report]'",
        "pip install './cwcli[report]'",
        "pip install -q . && .venv/bin/cwcli demo",
        "pip install . && cwcli demo",
        "python -m cwcli run",
        "import cwcli.errors",
    ],
)
def test_what_is_right_is_not_found(text: str) -> None:
    assert not WRONG.search(text)


def test_no_text_tells_to_install_the_strangers_package() -> None:
    found = {
        f"{path.relative_to(ROOT)}: {match[0]}"
        for path in texts()
        for match in WRONG.finditer(path.read_text(encoding="utf-8", errors="replace"))
    }
    assert found == set()


def test_hints_name_the_package_and_an_extra_that_it_has() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["name"] == PIP_DISTRIBUTION_NAME != "cwcli"
    assert project["scripts"] == {"cwcli": "cwcli.cli.main:main"}
    assert install_hint("report") == f"pip install '{PIP_DISTRIBUTION_NAME}[report]'"
    named = {
        extra
        for path in texts()
        for pattern in (rf"{re.escape(PIP_DISTRIBUTION_NAME)}\[([a-z]+)\]", r"install_hint\([\"'](\w+)[\"']\)")
        for extra in re.findall(pattern, path.read_text(encoding="utf-8", errors="replace"))
    }
    assert {"report", "can", "bags", "ray", "remote", "view", "plots"} <= named <= {*project["optional-dependencies"]}
