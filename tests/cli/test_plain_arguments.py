"""Plain arguments give a command the values that Typer gives it; all else is left to Typer."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import pytest

from cwcli.cli.app import load_command
from cwcli.cli.commands import HELP_LINE_BY_COMMAND
from cwcli.cli.load import load_command_function_and_examples
from cwcli.cli.options.lazy_typer import find_declaration_in_type_hint
from cwcli.cli.plain_arguments import parse_plain_arguments

NAMES = [name for name in HELP_LINE_BY_COMMAND if name != "config"]
SAMPLES = {int: ["3", "3.5", "x", "1e3"], float: ["2", "0.25", "x", "inf", "nan", "-1"], str: ["a", "", "-"]}


def values_of_typer(name: str, arguments: list[str]) -> dict[str, Any] | None:
    """The values that Typer gives the command's function; None where it reports a mistake."""
    command = load_command(name)
    seen: dict[str, Any] = {}
    command.callback = lambda **values: seen.update(values)
    try:
        with command.make_context(name, arguments) as context:
            command.invoke(context)
    except Exception:
        return None
    return seen


def samples(kind: Any) -> list[str]:
    """Some values for a type, good and bad."""
    several = [each for each in get_args(kind) if each is not type(None)]
    if get_origin(kind) is Literal:
        return [str(several[-1]), "neither"]
    if type(None) in get_args(kind):
        return samples(several[0])
    return SAMPLES.get(kind, SAMPLES[str])


def command_lines(name: str) -> list[list[str]]:
    """Each option with several values, and arguments in odd places."""
    function, _ = load_command_function_and_examples(name)
    lines = [[], ["a.mcap"], ["a.mcap", "b.mcap"], ["-", "--json"], ["--json", "a.mcap", "-q"], ["a.mcap", "--jsn"]]
    lines += [["a.mcap", "--", "b.mcap"], ["a.mcap", "-qf"], ["a.mcap", "-oout.mcap"], ["a.mcap", "--quiet=1"]]
    for parameter in inspect.signature(function).parameters.values():
        declaration = find_declaration_in_type_hint(parameter.annotation)
        assert declaration is not None
        kind = get_args(parameter.annotation)[0]
        for flag in [part for flags in declaration.flags for part in flags.split("/")]:
            if "--config" in declaration.flags:
                continue
            if kind is bool:
                lines += [["a.mcap", flag], [flag, "a.mcap", flag]]
                continue
            lines += [["a.mcap", flag, value] for value in samples(kind)] + [["a.mcap", flag]]
            value = samples(kind)[0]
            lines += [[f"{flag}={value}", "a.mcap"], [flag, value, "a.mcap", flag, value, "b.mcap"]]
    return lines


def same(one: Any, other: Any) -> bool:
    """Equal, and of one type."""
    return type(one) is type(other) and one == other


@pytest.mark.parametrize("name", NAMES)
def test_plain_arguments_give_the_values_of_typer(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    function, _ = load_command_function_and_examples(name)
    n_plain = 0
    every = 5 if name == "run" else 1  # its options are those of the stages
    for line in command_lines(name)[::every]:
        mine = parse_plain_arguments(function, line)
        if mine is None:
            continue
        theirs = values_of_typer(name, line)
        assert theirs is not None, line
        assert mine.keys() == theirs.keys()
        assert {key: value for key, value in mine.items() if not same(value, theirs[key])} == {}, line
        n_plain += 1
    if name in {"info", "run", "estimate", "warn", "evaluate"}:
        assert n_plain > 20


def loaded(arguments: list[str], folder: Path, **variables: str) -> bool:
    """Whether a run of cwcli imports Typer."""
    code = f"""import sys
from cwcli.cli.main import run_command_line
run_command_line({arguments!r})
print("typer" in sys.modules, file=sys.stderr)"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        check=True,
        cwd=folder,
        capture_output=True,
        text=True,
        env={**os.environ, **variables},
    )
    return done.stderr.splitlines()[-1] == "True"


CASES: dict[str, tuple[Callable[[Path], list[str]], dict[str, str], bool]] = {
    "plain": (lambda log: ["info", str(log), "--json"], {}, False),
    "mistake": (lambda log: ["info", str(log), "--jsn"], {}, True),
    "help": (lambda log: ["info", "--help"], {}, True),
    "variable": (lambda log: ["info", str(log)], {"CWCLI_STRICT": "1"}, True),
    "named-file": (lambda log: ["info", str(log), "--config", "options.toml"], {}, True),
    "no-file": (lambda log: ["info", str(log), "--config", "none"], {}, True),
    "file": (lambda log: ["info", str(log)], {}, True),
}


@pytest.mark.parametrize("case", CASES)
def test_only_what_is_not_plain_needs_typer(case: str, intersection: Path, tmp_path: Path) -> None:
    arguments, variables, expected = CASES[case]
    if case.endswith("file"):
        name = "cwcli.toml" if case == "file" else "options.toml"
        (tmp_path / name).write_text("strict = true\n", encoding="utf-8")
    assert loaded(arguments(intersection), tmp_path, **variables) is expected
