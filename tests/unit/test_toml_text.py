"""TOML of users is bounded before the parser sees it."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from cwcli import toml_text
from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_USAGE
from cwcli.toml_text import MAX_KEY_PARTS, MAX_TOML_FILE_CHARS, parse_toml

LONG_KEY = ".".join("a" * 50_000)


@pytest.mark.parametrize(
    "text",
    [
        f"{LONG_KEY} = 1",
        f"[{LONG_KEY}]",
        f"[[ {LONG_KEY.replace('.', ' . ')} ]]",
        f"x = {{ {LONG_KEY} = 1 }}",
        ".".join(["'a.b'", '"c d"'] * MAX_KEY_PARTS) + " = 1",
        "#" * (MAX_TOML_FILE_CHARS + 1),
    ],
)
def test_what_would_keep_the_parser_busy_never_reaches_it(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setattr(toml_text, "tomllib", None)
    with pytest.raises(ValueError, match=r"parts|characters"):
        parse_toml(text)


@pytest.mark.parametrize(
    "text",
    [
        ".".join("a" * MAX_KEY_PARTS) + " = 1",
        "x = [" + "1.5, " * 1000 + "]",
        "# " + "one sentence. " * 1000,
        'x = "' + "one line. " * 1000 + '"',
        'x = """\n' + "a line.\n" * 1000 + '"""',
    ],
)
def test_all_else_is_what_the_parser_makes_of_it(text: str) -> None:
    assert parse_toml(text) == tomllib.loads(text)


@pytest.mark.parametrize(
    "command",
    [
        ("info", "LOG", "--config", "FILE"),
        ("info", "LOG", "--expect", "FILE"),
        ("estimate", "LOG", "--calibration", "FILE"),
        ("observe", "LOG", "--vehicle", "FILE"),
        ("simulate", "FILE", "-o", "OUT"),
    ],
)
def test_every_command_that_reads_a_file_of_users_is_guarded(
    command: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "long.toml"
    path.write_text(f"{LONG_KEY} = 1\n")
    log = Path(__file__).parents[2] / "cwcli" / "sample_logs" / "intersection.mcap"
    names: dict[str, Any] = {"LOG": str(log), "FILE": str(path), "OUT": str(tmp_path / "out.mcap")}
    assert run_command_line([names.get(each, each) for each in command]) == EXIT_USAGE
    assert f"a key has more than {MAX_KEY_PARTS} parts" in " ".join(capsys.readouterr().err.split())


def test_deep_nesting_is_told_with_its_line() -> None:
    text = 'a = 1 # [[[\nb = "[[["\nc = ' + "[" * 5000 + "]" * 5000 + "\n"
    with pytest.raises(ValueError, match=r"nested too deeply \(at line 3\)"):
        parse_toml(text)
