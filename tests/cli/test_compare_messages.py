"""`cwcli compare --messages`: one line for identical runs, the change and its first channel for others."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_DONE, EXIT_USAGE
from tests.cli.conftest import SAMPLES


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same drive annotated twice alike, and once with another horizon of the warnings."""
    folder = tmp_path_factory.mktemp("runs")
    stages = ("run", str(SAMPLES / "rear-end.mcap"), "--stage", "estimate,predict,warn", "-q")
    for name, options in (("a", ()), ("b", ()), ("c", ("--warn-horizon", "2"))):
        assert run_command_line([*stages, "-o", str(folder / f"{name}.mcap"), *options]) == EXIT_DONE
    return folder


def test_identical_runs_print_one_line(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["compare", str(runs / "a.mcap"), str(runs / "b.mcap"), "--messages"]) == EXIT_DONE
    assert capsys.readouterr().out == "identical: every message and every setting of 1 log is the same\n"


def test_changed_option_and_its_first_channel_are_named(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before, after = str(runs / "a.mcap"), str(runs / "c.mcap")
    page = tmp_path / "compare.md"
    assert run_command_line(["compare", before, after, "--messages", "--markdown", str(page)]) == EXIT_DONE
    assert "changed: warn: rule.horizon_s was 2.5, is 2.0" in page.read_text()
    assert "changed: warn: rule.horizon_s was 2.5, is 2.0" in capsys.readouterr().out
    assert run_command_line(["compare", before, after, "--messages", "--json"]) == EXIT_DONE
    (log,) = json.loads(capsys.readouterr().out)["messages"]["differing"]
    assert [(each["stage"], each["name"]) for each in log["settings"]] == [("warn", "rule.horizon_s")]
    assert log["channels"][0]["topic"] == "/cwcli/warnings"
    assert {each["change"] for each in log["warnings"]} <= {"moved", "vanished"}
    assert log["warnings"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--fields", "speed_mps=0.1"), "--fields needs --messages"),
        (("--fields", "speed_mps", "--messages"), "expected NAME=TOLERANCE"),
        (("--fields", "speed_mps=-1", "--messages"), "expected NAME=TOLERANCE"),
        (("--fields", "speed_mps=nan", "--messages"), "expected NAME=TOLERANCE"),
    ],
)
def test_nonsense_is_refused(
    runs: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], words: str
) -> None:
    assert run_command_line(["compare", str(runs / "a.mcap"), str(runs / "b.mcap"), *options]) == EXIT_USAGE
    assert words in " ".join(capsys.readouterr().err.split())
