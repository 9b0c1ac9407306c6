"""`--github`, `compare --comment` and the times of JUnit: what a job on a pull request shows."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest
from junitparser import JUnitXml

from cwcli.cli.comment import MAX_COMMENT_CHARS, format_comment
from cwcli.cli.github import (
    MAX_ANNOTATIONS_PER_KIND,
    annotations_of_changes,
    annotations_of_gates,
    format_error_command,
    path_in_repository_or_empty,
)
from cwcli.cli.junit import format_junit_xml
from cwcli.cli.main import run_command_line
from cwcli.fleet.results import RunMetrics
from cwcli.metrics.gates import CheckStatus, GateCheck, GateResult
from cwcli.metrics.log_changes import Direction, LogChange, LogMetricChange
from cwcli.metrics.pooling import LogMetrics
from tests.cli.test_evaluate import metrics_file

COMMAND = re.compile(r"::error (?P<properties>[^:]*)::(?P<message>[^\n]*)")


def parse(line: str) -> tuple[dict[str, str], str]:
    """Read a workflow command as GitHub's runner does (actions/runner, ActionCommand.cs: TryParseV2)."""
    found = COMMAND.fullmatch(line)
    assert found is not None, line

    def unescape(text: str, *, is_property: bool) -> str:
        pairs = [("%0D", "\r"), ("%0A", "\n"), *([("%3A", ":"), ("%2C", ",")] if is_property else []), ("%25", "%")]
        for escaped, plain in pairs:
            text = text.replace(escaped, plain)
        return text

    properties = dict(each.split("=", 1) for each in found["properties"].split(","))
    return {name: unescape(value, is_property=True) for name, value in properties.items()}, unescape(
        found["message"], is_property=False
    )


def gate(name: str, *logs: str, detail: str = "0.7 < 0.5") -> GateResult:
    return GateResult(name, tuple(GateCheck(each, CheckStatus.FAILED, detail) for each in logs))


@pytest.mark.parametrize("text", ["100 % of a, b: c", "%0A%25::error::x", "a\nb", "::add-mask::x", "ü=1,title=2"])
def test_every_text_comes_back_as_it_was(text: str) -> None:
    line = format_error_command(text, title=text.replace("\n", " "), file="logs/a,b:c%.mcap")
    assert "\n" not in line
    properties, message = parse(line)
    assert message == text
    assert properties == {"file": "logs/a,b:c%.mcap", "title": text.replace("\n", " ")}


def test_the_escaping_is_that_of_the_documentation() -> None:
    line = format_error_command("50 % of\nit", title="a: b, c", file="x.mcap")
    assert line == "::error file=x.mcap,title=a%3A b%2C c::50 %25 of%0Ait"


def test_control_characters_of_names_are_shown_and_not_sent() -> None:
    line = format_error_command("a\x1b[2J\rb", title="t\x07")
    assert line == "::error title=t\\x07::a\\x1b[2J\\rb"


def test_a_failed_gate_names_its_first_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GITHUB_WORKSPACE", raising=False)
    run = RunMetrics(
        "out", (LogMetrics("a", source=str(tmp_path / "logs" / "a.mcap")), LogMetrics("b", source="b.mcap"))
    )
    passed = GateResult("g2", (GateCheck("a", CheckStatus.PASSED, ""),))
    lines = annotations_of_gates(run, [gate("g1 < 5 %", "a", "b"), passed, gate("pooled(x) > 1", "")])
    assert [parse(line) for line in lines] == [
        ({"file": "logs/a.mcap", "title": "gate failed: g1 < 5 %"}, "a: 0.7 < 0.5\nb: 0.7 < 0.5"),
        ({"title": "gate failed: pooled(x) > 1"}, "0.7 < 0.5"),
    ]


def test_more_annotations_than_github_shows_are_put_into_the_last() -> None:
    run = RunMetrics("out", (LogMetrics("a", source="a.mcap"),))
    lines = annotations_of_gates(run, [gate(f"g{k}", "a") for k in range(25)])
    assert len(lines) == MAX_ANNOTATIONS_PER_KIND
    assert parse(lines[-1]) == ({"title": "16 more gates failed"}, "\n".join(f"g{k}" for k in range(9, 25)))
    changes = annotations_of_changes([f"worse: m{k}" for k in range(11)])
    assert len(changes) == MAX_ANNOTATIONS_PER_KIND
    assert parse(changes[-1])[1] == "worse: m9\nworse: m10"
    assert len(annotations_of_changes([f"m{k}" for k in range(10)])) == 10


def test_only_files_of_the_checkout_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GITHUB_WORKSPACE", str(tmp_path))
    assert path_in_repository_or_empty(str(tmp_path / "logs" / "a.mcap")) == "logs/a.mcap"
    for name in ("", "-", "/elsewhere/a.mcap", "s3://key:secret@bucket/a.mcap"):
        assert path_in_repository_or_empty(name) == ""


def test_the_commands_print_annotations_on_stderr(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    old = metrics_file(tmp_path / "old.parquet", {f"log{k}": 1.0 for k in range(6)})
    new = metrics_file(tmp_path / "new.parquet", {f"log{k}": 2.0 for k in range(6)})
    arguments = ["evaluate", str(new), "--gate", "ego.position_rmse_m < 1.5", "--github", "--markdown", "m.md", "-q"]
    assert run_command_line(arguments) == 1
    printed = capsys.readouterr()
    [line] = [line for line in printed.err.splitlines() if line.startswith("::")]
    assert parse(line)[0] == {"title": "gate failed: ego.position_rmse_m < 1.5"}
    assert "::error" not in printed.out
    assert run_command_line(["compare", str(old), str(new), "--exact", "--fail-on", "worse", "--github"]) == 1
    [line] = [line for line in capsys.readouterr().err.splitlines() if line.startswith("::")]
    assert parse(line) == ({"title": "cwcli compare"}, "worse: ego.position_rmse_m")


def test_the_comment_has_the_worst_log_first_and_both_sides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    metrics_file(tmp_path / "old.parquet", {"a": 1.0, "b": 1.0, "c": 1.0, "same": 1.0})
    metrics_file(tmp_path / "new.parquet", {"a": 1.5, "b": 4.0, "c": 0.5, "same": 1.0})
    assert run_command_line(["compare", "old.parquet", "new.parquet", "--exact", "--comment", "c.md", "-q"]) == 0
    text = Path("c.md").read_text(encoding="utf-8")
    assert text.startswith("### cwcli compare: 1 worse\n")
    assert re.findall(r"^\*\*`(\w+)`\*\*: (.*)$", text, re.MULTILINE) == [
        ("b", "1 worse"),
        ("a", "1 worse"),
        ("c", "1 better"),
    ]
    assert "#### 3 logs with changes, 1 without" in text
    assert "| `ego.position_rmse_m` | `m` | 1.000 | 4.000 | worse, +300 % |" in text
    assert run_command_line(["compare", "old.parquet", "new.parquet", "--comment", "-", "--json"]) == 2
    assert "both want standard output" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["log", "|`<b>" * 60, "日" * 150])
@pytest.mark.parametrize("n", [1, 40, 3000])
def test_a_comment_is_never_too_long_and_says_what_is_left_out(n: int, name: str) -> None:
    change = LogMetricChange("ego.position_rmse_m", "m", 1.0, 2.0, Direction.WORSE, 1.0)
    logs = [LogChange(f"{k}-{name}", "", (change,) * (1 + k % 40)) for k in range(n)]
    text = format_comment("### summary\n\n" + "word " * 20_000, logs, n_pairs=n)
    assert len(text) <= MAX_COMMENT_CHARS
    assert len(text.encode("utf-16-le")) / 2 <= 65_536
    shown = text.count("\n**")
    assert shown
    assert ("left out, because a comment has at most 60,000 characters" in text) is (shown < n)
    if shown < n:
        assert f"{n - shown:,} log" in text or f"{n - shown} log" in text
    assert "The rest of this summary is left out" in text


def test_a_log_that_failed_is_told_and_its_name_is_no_markup() -> None:
    text = format_comment("s", [LogChange("a|<img src=x>", "it is damaged @all", ())], n_pairs=0)
    assert "<img" not in text
    assert "**<code>a&#124;&#60;img src&#61;x&#62;</code>** failed: `it is damaged @all`" in text


def test_the_times_of_all_test_cases_are_those_of_the_run() -> None:
    checks = [GateCheck(name, CheckStatus.PASSED, "") for name in ("a", "b", "c")]
    results = [GateResult("g1", tuple(checks)), GateResult("g2", (*checks[:2], GateCheck("", CheckStatus.PASSED, "")))]
    document = format_junit_xml(results, None, {"a": 3.0, "b": 1.0, "c": 0.5})
    suites = list(JUnitXml.fromstring(document))
    times = [[case.time for case in suite] for suite in suites]
    assert times == [[1.5, 0.5, 0.5], [1.5, 0.5, 0.0]]
    assert [suite.time for suite in suites] == [2.5, 2.0]
    assert math.fsum(map(math.fsum, times)) == 4.5
    assert b'time="4.5000"' in document.splitlines()[1]


def test_the_times_come_from_the_run_and_damage_is_ignored(tmp_path: Path) -> None:
    from cwcli.fleet.folder import RUN_TIMES_NAME, read_run_time_s_by_log

    assert read_run_time_s_by_log(tmp_path) == {}
    times = {"a": {"wall_s": 1.5}, "b": {"wall_s": "x"}, "c": 3, "d": {"wall_s": -1}, "e": {"wall_s": True}}
    (tmp_path / RUN_TIMES_NAME).write_text(json.dumps({"logs": times}))
    assert read_run_time_s_by_log(tmp_path) == {"a": 1.5}
    (tmp_path / RUN_TIMES_NAME).write_text('{"logs": [')
    assert read_run_time_s_by_log(tmp_path) == {}
