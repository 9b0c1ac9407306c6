"""`cwcli --help` without Typer is what Typer prints."""

from __future__ import annotations

import subprocess
import sys

import pytest
import typer

from cwcli.cli.app import app
from cwcli.cli.root_help import format_root_help


@pytest.mark.parametrize("columns", ["80", "81", "200", "0", "wide"])
def test_the_help_is_that_of_typer(columns: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    group = typer.main.get_command(app)
    with group.make_context("cwcli", [], resilient_parsing=True) as context:
        assert format_root_help() == context.get_help() + "\n"


def test_a_narrow_terminal_is_left_to_typer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "79")
    assert format_root_help() is None


@pytest.mark.parametrize("flag", ["--help", "-h"])
def test_help_imports_little(flag: str) -> None:
    code = f"""import sys
from cwcli.cli.main import run_command_line
assert run_command_line([{flag!r}]) == 0
names = ("typer", "dataclasses", "inspect", "numpy", "pathlib", "json", "subprocess")
print([name for name in names if name in sys.modules], file=sys.stderr)"""
    done = subprocess.run([sys.executable, "-S", "-c", code], check=True, capture_output=True, text=True)
    assert done.stderr == "[]\n"
