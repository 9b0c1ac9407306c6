"""`cwcli evaluate` and `cwcli compare`: exit codes, files, sources, and names that try to break out."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from junitparser import Failure, JUnitXml, Skipped

from cwcli import __version__
from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_MISSING_SIGNAL, EXIT_USAGE
from cwcli.metrics.gates import CheckStatus, check_gates
from cwcli.metrics.headline import HeadlineCollector
from cwcli.metrics.pooling import LogMetrics
from cwcli.metrics.table import Table, write_table

ROOT = Path(__file__).parents[2]
GATE = "ego.position_rmse_m < 0.5"


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output folder of a run over two bundled logs and one that is no log."""
    folder = tmp_path_factory.mktemp("fleet")
    logs = [shutil.copy(ROOT / "sample_logs" / f"{name}.mcap", folder) for name in ("intersection", "straight")]
    subprocess.run(
        [sys.executable, "-m", "cwcli", "run", *logs, "-d", "out", "--jobs", "1", "--quiet", "--gate", GATE],
        check=True,
        cwd=folder,
        env={"PATH": "", "PYTHONPATH": str(ROOT)},
    )
    return folder / "out"


def metrics_file(path: Path, logs: dict[str, float]) -> Path:
    """A table as `--metrics` writes it, with one metric a log."""
    headline = HeadlineCollector()
    for value in logs.values():
        headline.add_from_sums("ego.position_rmse_m", value**2 * 10.0, 10.0)
    table_ = headline.to_table()
    write_table(Table("metrics", {"log": list(logs), **table_.columns}), path)
    return path


def document(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, Any]:
    code_ = run_command_line([*map(str, arguments), "--json"])
    return code_, json.loads(capsys.readouterr().out)


def test_a_run_is_scored_and_its_own_gates_are_checked(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code_, found = document(capsys, "evaluate", fleet)
    assert code_ == 0
    assert [log["id"] for log in found["logs"]] == ["intersection", "straight"]
    assert [(gate["gate"], gate["status"]) for gate in found["gates"]] == [(GATE, "passed")]
    squares = [
        (log["metrics"]["ego.position_rmse_m"]["value"], log["metrics"]["ego.position_rmse_m"]["n"])
        for log in found["logs"]
    ]
    mean_square = sum(n * value**2 for value, n in squares) / sum(n for _, n in squares)
    assert found["pooled"]["ego.position_rmse_m"]["value"] == pytest.approx(mean_square**0.5)


def test_a_single_log_and_a_folder_of_logs_give_the_runs_numbers(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, of_run = document(capsys, "evaluate", fleet)
    annotated = fleet / "logs" / "intersection" / "annotated.mcap"
    _, of_log = document(capsys, "evaluate", annotated)
    expected, alone = of_run["logs"][0]["metrics"], of_log["logs"][0]["metrics"]
    assert list(alone) == list(expected)
    for name, entry in alone.items():
        assert entry["value"] == pytest.approx(expected[name]["value"], rel=1e-9), name
    shutil.copy(annotated, tmp_path / "a.mcap")
    (tmp_path / "broken.mcap").write_bytes(b"no log")
    code_, of_folder = document(capsys, "evaluate", tmp_path, "--gate", "ego.position_rmse_m < 0.5")
    assert of_folder["logs"][0]["metrics"] == alone
    assert of_folder["logs"][1]["error"].startswith(str(tmp_path / "broken.mcap"))
    assert code_ == 1


def test_a_log_on_which_nothing_has_run_lacks_what_is_scored(
    intersection: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["evaluate", str(intersection)]) == 4
    assert "no stage of cwcli has run on it" in " ".join(capsys.readouterr().err.split())
    assert (
        run_command_line(["evaluate", str(intersection), "--gate", "data.faults_count < 1"]) == 0
    )  # asks for the data alone
    assert run_command_line(["evaluate", str(intersection), "--gate", "data.duration_s > 60"]) == 1


def test_another_truth_is_computed_again(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code_, found = document(capsys, "evaluate", fleet, "--truth", "none")
    assert "ego.position_rmse_m" not in found["pooled"] and "ego.gated_share" in found["pooled"]
    assert code_ == 1  # the run's own gate asks for it
    assert run_command_line(["evaluate", str(fleet), "--truth", "/no/such"]) == 2


def test_failed_gates_make_the_exit_code_and_are_listed(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        run_command_line(
            ["evaluate", str(fleet), "--gate", "ego.speed_rmse_mps < 0.01", "--gate", "lanes.found_share > 0"]
        )
        == 1
    )
    out = capsys.readouterr().out
    assert "straight: ego.speed_rmse_mps = 0.01537 m/s" in out
    assert "intersection: ego.speed" not in out
    assert "no log has lanes.found_share" in out
    assert run_command_line(["evaluate", str(fleet), "--gate", "lanes.found_share > 0", "--allow-missing"]) == 0


def test_failed_gates_are_told_even_when_quiet(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["evaluate", str(fleet), "--gate", "ego.position_rmse_m < 0.001", "--quiet"]) == 1
    said = capsys.readouterr()
    assert not said.out
    assert said.err.startswith("gate failed: ego.position_rmse_m < 0.001 (")


def test_gates_come_from_the_configuration_file(fleet: Path, tmp_path: Path) -> None:
    config = tmp_path / "pipeline.toml"
    config.write_text('gates = ["ego.position_rmse_m < 0.001"]\n[estimate]\nmodel = "cwcli"\n', encoding="utf-8")
    assert run_command_line(["evaluate", str(fleet), "--config", str(config), "--quiet"]) == 1
    assert (
        run_command_line(
            ["evaluate", str(fleet), "--config", str(config), "--gate", "ego.position_rmse_m < 5", "--quiet"]
        )
        == 0
    )


def test_what_is_no_gate_is_a_usage_error_before_the_work(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["evaluate", "/no/such/folder", "--gate", "ego.position_rmse_m <"]) == 2
    assert "expected a metric or a number" in capsys.readouterr().err
    assert run_command_line(["evaluate", "/no/such/folder", "--gate", "ego.position_rmse_m < 1e400"]) == 2
    assert "found `1e400`" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["report", "/no/such/folder"], ["layout"]])
def test_an_empty_output_name_is_no_standard_output(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line([*command, "-o", ""]) == 6
    said = capsys.readouterr()
    assert not said.out
    assert "the output is a directory" in said.err


def test_junit_and_markdown_are_written(fleet: Path, tmp_path: Path) -> None:
    junit, summary = tmp_path / "report.xml", tmp_path / "summary.md"
    gates = ["--gate", "ego.speed_rmse_mps < 0.01", "--gate", "lanes.found_share > 0", "--allow-missing"]
    assert (
        run_command_line(["evaluate", str(fleet), *gates, "--junit", str(junit), "--markdown", str(summary), "--quiet"])
        == 1
    )
    parsed = JUnitXml.fromfile(str(junit))
    skipped = sum(suite.skipped for suite in parsed)
    assert (parsed.tests, parsed.failures, skipped, parsed.errors) == (6, 1, 2, 0)
    suites = {suite.name: suite for suite in parsed}
    failed = [case for case in suites["ego.speed_rmse_mps < 0.01"] if case.result]
    assert [(case.name, type(case.result[0])) for case in failed] == [("straight", Failure)]
    assert all(isinstance(case.result[0], Skipped) for case in suites["lanes.found_share > 0"])
    text = summary.read_text(encoding="utf-8")
    assert text.startswith("### cwcli evaluate: 1 of 3 gates failed")
    assert "| `ego.speed_rmse_mps < 0.01` | `straight` | `ego.speed_rmse_mps = 0.01537 m/s` |" in text
    assert run_command_line(["evaluate", str(fleet), "--junit", str(junit)]) == 6  # it exists


def test_metrics_table_holds_every_log_and_serves_as_a_baseline(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "baseline.parquet"
    assert run_command_line(["evaluate", str(fleet), "--metrics", str(kept), "--quiet"]) == 0
    code_, found = document(capsys, "compare", kept, fleet, "--fail-on", "worse", "--fail-on", "missing")
    assert code_ == 0 and found["pairs"] == 2
    assert {entry["verdict"] for entry in found["metrics"].values()} == {"same", "-"}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["evaluate", "/no/such.mcap"], 3),
        (["evaluate", "."], 3),
        (["evaluate", "a\0b"], 3),
        (["evaluate", "x.parquet"], 3),
        (["compare", "/no/such.mcap", "/no/such.mcap"], 3),
        (["compare", "a", "b", "--fail-on", "better"], 2),
        (["compare", "a", "b", "--tolerance", "2"], 2),
        (["compare", "a", "b", "--seed", "-1"], 2),
    ],
)
def test_wrong_sources_and_options(
    arguments: list[str], expected: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_command_line(arguments) == expected


def test_a_manifest_can_not_lead_out_of_its_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entry = {"id": "../../etc", "status": "done"}
    (tmp_path / "manifest.json").write_text(json.dumps({"format": 2, "logs": [entry]}), encoding="utf-8")
    assert run_command_line(["evaluate", str(tmp_path)]) == 3
    assert "not the name of a file" in capsys.readouterr().err


@pytest.mark.parametrize("format", [1, "2", None], ids=str)
@pytest.mark.parametrize("command", ["evaluate", "report", "compare", "compare to", "run"])
def test_a_manifest_of_another_format_is_one_line(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, format: object
) -> None:
    (tmp_path / "log.mcap").write_bytes(b"")
    other = tmp_path / "other"
    other.mkdir()
    (other / "manifest.json").write_text(json.dumps({"format": format, "cwcli": "9.0", "logs": []}), encoding="utf-8")
    arguments = {
        "report": ["report", other, "-o", tmp_path / "page.html"],
        "compare": ["compare", other, other],
        "compare to": ["compare", fleet, other],
        "run": ["run", tmp_path / "log.mcap", "-d", other, "--force"],
    }.get(command, [command, other])
    assert run_command_line([*map(str, arguments)]) == (6 if command == "run" else 3)
    assert [line for line in capsys.readouterr().err.splitlines() if line.startswith(("error", "  "))] == [
        f"error: {other}/manifest.json: a manifest of format {format!r}, and cwcli {__version__} reads format 2",
        "  hint:  use the version of cwcli that wrote it, or do the run again into a new folder",
    ]
    assert sorted(path.name for path in other.iterdir()) == ["manifest.json"]


def test_a_manifest_of_another_tool_beside_logs_is_no_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy(ROOT / "sample_logs/straight.mcap", tmp_path)
    (tmp_path / "manifest.json").write_text('{"format": 7, "files": 1}')
    assert run_command_line(["evaluate", str(tmp_path), "--gate", "data.faults_count < 1"]) == 0
    capsys.readouterr()


def test_logs_that_failed_or_were_not_done_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    error = {"exit_code": 3, "what": "it is no MCAP file", "where": "b.mcap", "hint": ""}
    logs = [
        {"id": "b", "status": "failed", "error": error},
        {"id": "c", "status": "pending"},
        {"id": "d", "status": "done"},
    ]
    (tmp_path / "manifest.json").write_text(json.dumps({"format": 2, "logs": logs}), encoding="utf-8")
    code_, found = document(capsys, "evaluate", tmp_path)
    assert code_ == 0
    assert [log["error"] for log in found["logs"]] == [
        "b.mcap: it is no MCAP file",
        "it was not processed",
        "the log has no readable table of metrics, and no annotated log to make it from",
    ]
    code_, found = document(capsys, "evaluate", tmp_path, "--gate", "data.read_count > 0")
    assert code_ == 1 and found["gates"][-1]["gate"] == "every log was evaluated"


def test_compare_finds_a_planted_regression(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    values = np.linspace(0.5, 2.0, 16)
    before = metrics_file(tmp_path / "a.parquet", {f"log{k}": float(v) for k, v in enumerate(values)})
    after = metrics_file(tmp_path / "b.parquet", {f"log{k}": float(v) * 1.05 for k, v in enumerate(values)})
    assert run_command_line(["compare", str(before), str(after)]) == 0
    assert run_command_line(["compare", str(before), str(after), "--fail-on", "worse"]) == 1
    assert "worse: ego.position_rmse_m" in capsys.readouterr().out
    assert run_command_line(["compare", str(after), str(before), "--fail-on", "worse"]) == 0
    assert run_command_line(["compare", str(before), str(after), "--fail-on", "worse", "--tolerance", "0.1"]) == 0
    assert run_command_line(["compare", str(before), str(before), "--fail-on", "unclear", "--fail-on", "missing"]) == 0


@pytest.mark.parametrize("is_raw", [(True, False), (False, True), (True, True)])
@pytest.mark.parametrize("kind", ["log", "folder"])
def test_compare_refuses_what_no_stage_has_run_on(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, is_raw: tuple[bool, bool]
) -> None:
    """A recorded log, or a folder of them that is no output of a run, on either side."""
    raw = ROOT / "sample_logs" / "intersection.mcap"
    annotated = fleet / "logs" / "intersection" / "annotated.mcap"
    if kind == "folder":
        raw, annotated = raw.parent, annotated.parent
    named = [raw if each else annotated for each in is_raw]
    assert (
        run_command_line(["compare", *map(str, named), "--markdown", str(tmp_path / "out.md")]) == EXIT_MISSING_SIGNAL
    )
    found = capsys.readouterr()
    said = " ".join(found.err.split())
    assert f"error: {raw}: no stage of cwcli has run on" in said and "hint: run `cwcli run " in said
    assert (found.out, list(tmp_path.iterdir())) == ("", [])


def test_compare_refuses_runs_without_a_common_log(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    annotated = fleet / "logs" / "straight" / "annotated.mcap"
    assert run_command_line(["compare", str(fleet), str(annotated)]) == EXIT_USAGE
    said = " ".join(capsys.readouterr().err.split())
    assert "no log in common" in said and "intersection and straight in the first, annotated.mcap in the second" in said


def test_compare_is_seeded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(4)
    names = [f"log{k}" for k in range(12)]
    files = [
        metrics_file(tmp_path / f"{k}.parquet", dict(zip(names, rng.uniform(1, 2, 12).tolist(), strict=True)))
        for k in "ab"
    ]
    outputs = [document(capsys, "compare", *files, "--seed", seed) for seed in ("1", "1", "2")]
    assert outputs[0] == outputs[1] != outputs[2]


def test_compare_of_few_logs_says_that_it_can_not_tell(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = metrics_file(tmp_path / "a.parquet", {"x": 1.0, "y": 2.0, "gone": 1.0})
    after = metrics_file(tmp_path / "b.parquet", {"x": 1.2, "y": 2.4})
    assert run_command_line(["compare", str(before), str(after), "--fail-on", "worse"]) == 0
    said = capsys.readouterr()
    assert "unclear" in said.out and "+19.7 %" in said.out
    assert "with 2 logs chance cannot be excluded" in " ".join(said.err.split())
    assert "1 log only in the baseline: gone" in said.err
    assert run_command_line(["compare", str(before), str(after), "--fail-on", "worse", "--exact"]) == 1
    assert run_command_line(["compare", str(before), str(after), "--fail-on", "missing"]) == 1
    none = metrics_file(tmp_path / "c.parquet", {"other": 1.0})
    assert run_command_line(["compare", str(before), str(none), "--fail-on", "worse"]) == 1


def test_allowing_missing_metrics_skips_a_gate_on_none() -> None:
    (result,) = check_gates(["lanes.found_share > 0"], [LogMetrics("a")], allow_missing=True)
    assert result.status is CheckStatus.SKIPPED
