"""A value of the wrong type is told in cwcli's words, for every option and in the configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cwcli.cli.app import load_command
from cwcli.cli.commands import HELP_LINE_BY_COMMAND
from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_USAGE
from tests.cli.conftest import SAMPLES

FOREIGN = ("Input should", "valid integer", "valid number", "valid boolean", "parse string", "pydantic", "Traceback")


def typed(command: str) -> list[Any]:
    """The parameters that take no text."""
    found = []
    for parameter in load_command(command).params:
        annotation = getattr(getattr(parameter, "type_descriptor", None), "annotation", str)
        if annotation not in (str, list[str], bool) and parameter.opts and parameter.opts[0].startswith("-"):
            found.append(parameter)
    return found


OPTIONS = [(command, max(each.opts, key=len), each) for command in HELP_LINE_BY_COMMAND for each in typed(command)]


def test_there_are_options_to_try() -> None:
    assert len(OPTIONS) > 60
    kinds = {each.type_descriptor.annotation for _, _, each in OPTIONS}
    assert {int, float} <= kinds


@pytest.mark.parametrize(("command", "option"), [each[:2] for each in OPTIONS])
def test_a_wrong_type_is_told_plainly(command: str, option: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line([command, option, "k\x1b[31mein"]) == EXIT_USAGE
    said = capsys.readouterr().err
    assert said.startswith("error: ") and "Usage" not in said
    assert [word for word in FOREIGN if word in said] == []
    assert "\x1b[31m" not in said and option in said


def test_each_kind_has_its_words(capsys: pytest.CaptureFixture[str]) -> None:
    for given, said in (
        (["run", "--jobs", "two"], "'--jobs' / '-j': it must be a whole number, not 'two'"),
        (["run", "--jobs", "1.5"], "it must be a whole number, not '1.5'"),
        (["warn", "--probability", "p"], "'--probability': it must be a number, not 'p'"),
        (["warn", "--probability", "p" * 200], f"not '{'p' * 58}…"),
    ):
        assert run_command_line(given) == EXIT_USAGE
        assert said in " ".join(capsys.readouterr().err.split())


def test_the_environment_and_a_second_try_have_them_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CWCLI_QUIET", "maybe")
    for _ in range(2):
        assert run_command_line(["warn", "x.mcap"]) == EXIT_USAGE
        assert "it must be true or false, not 'maybe'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[warn]\nprobability = "x"', "warn.probability = 'x': it must be a number, not 'x'"),
        ('[run]\njobs = "two"', "run.jobs = 'two': it must be a whole number, not 'two'"),
        ("[run]\njobs = 1.5", "it must be a whole number, not '1.5'"),
        ("quiet = 1", "quiet must be true or false"),
        ("topic = 3", "topic must be a list"),
        ("[predict]\nhorizon = [1]", "predict.horizon must not be a list"),
    ],
)
def test_the_configuration_has_them(text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "c.toml").write_text(text)
    assert run_command_line(["config", str(tmp_path / "c.toml")]) == EXIT_USAGE
    told = " ".join(capsys.readouterr().err.split())
    assert said in told and [word for word in FOREIGN if word in told] == []


def test_choices_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    """Those of an option whose type is a choice: Typer leaves them out of its own words where pydantic checks."""
    assert run_command_line(["estimate", "x.mcap", "-o", "y.mcap", "--clock", "wall"]) == EXIT_USAGE
    told = " ".join(capsys.readouterr().err.split())
    assert "--clock" in told and "one of stamp, log, not 'wall'" in told
    assert [word for word in FOREIGN if word in told] == []


@pytest.mark.parametrize("command", ["info", "join", "calibrate", "run"])
@pytest.mark.parametrize("option", ["--max-chunk", "--max-ratio", "--max-input"])
def test_a_bound_beyond_all_measure_is_one_line(
    command: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = [str(SAMPLES / "intersection.mcap")] * (2 if command == "join" else 1)
    output = [] if command == "info" else ["-d" if command == "run" else "-o", str(tmp_path / "out")]
    huge = "1" + "0" * 308 if option == "--max-chunk" else "1e308"
    assert run_command_line([command, *logs, *output, option, huge]) == EXIT_USAGE
    said = capsys.readouterr().err
    assert f"'{option}': it must be a" in said and said.count("error: ") == 1
    assert list(tmp_path.iterdir()) == []
