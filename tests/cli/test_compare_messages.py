"""`cwcli compare --messages`: one line for identical runs, the change and its first channel for others."""

from __future__ import annotations

import json
import math
import re
import shutil
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.cli.message_texts import describe_difference_of_log
from cwcli.errors import EXIT_DONE, EXIT_NOT_WRITTEN, EXIT_USAGE
from cwcli.evaluation.message_changes import ChannelChange, LogDifference
from cwcli.report.drawing import EGO_COLOUR, WARNING_COLOUR
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


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output folders of runs over two logs, over one of them, and over both where one failed."""
    folder = tmp_path_factory.mktemp("folders")
    for name, is_log in (("both", True), ("one", None), ("bad", False)):
        logs = folder / f"logs-{name}"
        logs.mkdir()
        shutil.copy(SAMPLES / "rear-end.mcap", logs / "x.mcap")
        if is_log:
            shutil.copy(SAMPLES / "rear-end.mcap", logs / "y.mcap")
        elif is_log is False:
            (logs / "y.mcap").write_bytes(b"no log")
        run_command_line(["run", str(logs), "--stage", "estimate", "-q", "-d", str(folder / name)])
    return folder


@pytest.mark.parametrize(
    ("baseline", "candidate"), [("both", "one"), ("one", "both"), ("both", "bad"), ("bad", "both"), ("bad", "bad")]
)
def test_runs_that_lost_a_log_are_not_identical(
    folders: Path, capsys: pytest.CaptureFixture[str], baseline: str, candidate: str
) -> None:
    both = ("compare", str(folders / baseline), str(folders / candidate), "--messages")
    assert run_command_line([*both]) == EXIT_DONE
    text = capsys.readouterr().out
    assert "identical" not in text
    assert "messages: 0 of 1 log differs\nnot compared, as it failed or is in one run only: y" in text
    assert run_command_line([*both, "--json"]) == EXIT_DONE
    assert not json.loads(capsys.readouterr().out)["messages"]["identical"]


def test_changed_option_and_its_first_channel_are_named(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before, after = str(runs / "a.mcap"), str(runs / "c.mcap")
    page = tmp_path / "compare.md"
    assert run_command_line(["compare", before, after, "--messages", "--markdown", str(page)]) == EXIT_DONE
    assert "\n- `c.mcap`\n  - `changed: warn: rule.horizon_s was 2.5, is 2.0`\n" in page.read_text()
    assert "changed: warn: rule.horizon_s was 2.5, is 2.0" in capsys.readouterr().out
    assert run_command_line(["compare", before, after, "--messages", "--json"]) == EXIT_DONE
    (log,) = json.loads(capsys.readouterr().out)["messages"]["differing"]
    assert [(each["stage"], each["name"]) for each in log["settings"]] == [("warn", "rule.horizon_s")]
    assert log["channels"][0]["topic"] == "/cwcli/warnings"
    assert {each["change"] for each in log["warnings"]} <= {"moved", "vanished"}
    assert log["warnings"]


def test_the_page_overlays_both_runs(runs: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    compare = ("compare", str(runs / "a.mcap"), str(runs / "c.mcap"), "--messages", "-q", "--report", str(page))
    assert run_command_line([*compare]) == EXIT_DONE
    text = page.read_text()
    assert "changed: warn: rule.horizon_s was 2.5, is 2.0" in text
    assert "The positions of the ego are the same in both runs." in text  # another horizon changes no state
    assert text.count("<svg") == 2  # the map and the speeds
    dashed = re.findall(r'stroke="(#\w+)" stroke-dasharray', text)
    assert sorted(dashed) == sorted([EGO_COLOUR, WARNING_COLOUR])  # the moved warning, in both runs
    assert "<script" not in text
    assert run_command_line([*compare]) == EXIT_NOT_WRITTEN  # the page is there already


def test_the_page_measures_how_far_both_tracks_are_apart(runs: Path, tmp_path: Path) -> None:
    moved = tmp_path / "moved.mcap"
    estimate = ("run", str(SAMPLES / "rear-end.mcap"), "--stage", "estimate,predict,warn", "-q", "-o", str(moved))
    assert run_command_line([*estimate, "--estimate-latency", "/gps/fix=100"]) == EXIT_DONE
    page = tmp_path / "page.html"
    assert (
        run_command_line(["compare", str(runs / "a.mcap"), str(moved), "--messages", "-q", "--report", str(page)]) == 0
    )
    assert "distance of both positions [m]" in page.read_text()


def test_the_page_of_identical_runs_has_no_card(runs: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    both = (str(runs / "a.mcap"), str(runs / "b.mcap"))
    assert run_command_line(["compare", *both, "--messages", "-q", "--report", str(page)]) == EXIT_DONE
    assert "0 of 1 compared log differs." in page.read_text()
    assert "<article>" not in page.read_text()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--fields", "speed_mps=0.1"), "--fields needs --messages"),
        (("--fields", "speed_mps", "--messages"), "expected NAME=TOLERANCE"),
        (("--fields", "speed_mps=-1", "--messages"), "expected NAME=TOLERANCE"),
        (("--fields", "speed_mps=nan", "--messages"), "expected NAME=TOLERANCE"),
        (("--fields", "speedd_mps=0.01", "--messages"), "no compared channel has the field speedd_mps"),
        (("--fields", "speedd_mps=0.01", "--messages"), "did you mean speed_mps"),
        (("--fields", "speed_mps=0.1,horizon=1", "--messages"), "no compared channel has the field horizon"),
        (("--report", "page.html"), "--report needs --messages"),
    ],
)
def test_nonsense_is_refused(
    runs: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], words: str
) -> None:
    assert run_command_line(["compare", str(runs / "a.mcap"), str(runs / "b.mcap"), *options]) == EXIT_USAGE
    assert words in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("before", "after", "element"),
    [
        ("[1.0, 2.0, 3.0]", "[1.0, 2.5, 3.25]", ("[1]", "2.0", "2.5")),  # by 0.5, and by 0.25
        ("[[1, 2], [3, 4]]", "[[1, 2], [3, 5]]", ("[1][1]", "4", "5")),
        ("[NaN, 1]", "[NaN, 2]", ("[1]", "1", "2")),
        ("[NaN, 1]", "[0, 1]", ("", "[NaN, 1]", "[0, 1]")),
        ("[1]", "[1, 2]", ("", "[1]", "[1, 2]")),
        ("0.5", "0.6", ("", "0.5", "0.6")),
        ("[left", "", ("", "[left", "")),
    ],
)
def test_of_two_lists_the_element_that_differs_most_is_told(before: str, after: str, element: tuple[str, ...]) -> None:
    change = ChannelChange("/t", "sigma", 10**9, before, after, 1, 2, math.nan)
    found = LogDifference((), (change,), (), 0, 1)
    index, was, now = element
    line = f"first difference: /t at 1.000 s: sigma{index} was {was}, is {now or 'nothing'} (1 of 2 messages differs)"
    assert describe_difference_of_log(found) == [line]
