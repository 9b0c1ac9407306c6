"""docs/ci.md: its pipeline file is valid, its YAML parses, and its commands do what the page says."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "ci.md").read_text(encoding="utf-8")
TIMEOUT_S = 600


def block(name: str) -> str:
    [text] = re.findall(rf"<!-- {name} -->\n(.*?)<!-- end -->", PAGE, re.DOTALL)
    fenced = re.fullmatch(r"```\w+\n(.*?)```\n", text, re.DOTALL)
    return fenced[1] if fenced else text


def github() -> dict[Any, Any]:
    document: dict[Any, Any] = yaml.safe_load(block("github"))
    return document


def gitlab() -> dict[str, Any]:
    document: dict[str, Any] = yaml.safe_load(block("gitlab"))
    return document


def lines_by_hand() -> list[str]:
    return [line.strip() for line in block("by-hand").splitlines()]


def commands(name: str) -> list[str]:
    """The commands of a job, without those that need a network."""
    if name == "github":
        steps = [step["run"] for step in github()["jobs"]["drives"]["steps"] if "run" in step]
    else:
        steps = [*gitlab()["drives"]["script"], *gitlab()["drives-baseline"]["script"]]
    return [step for step in steps if not step.startswith("pip ")]


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A repository with two drives, the page's pipeline file, and `cwcli` on the path."""
    (tmp_path / "logs").mkdir()
    for name in ("intersection", "rear-end"):
        shutil.copy(ROOT / "sample_logs" / f"{name}.mcap", tmp_path / "logs")
    (tmp_path / "pipeline.toml").write_text(block("pipeline"), encoding="utf-8")
    (tmp_path / "bin").mkdir()
    tool = tmp_path / "bin" / "cwcli"
    tool.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m cwcli "$@"\n', encoding="utf-8")
    tool.chmod(0o755)
    return tmp_path


def shell(project: Path, command: str) -> subprocess.CompletedProcess[str]:
    environment = {key: value for key, value in os.environ.items() if not key.startswith("CWCLI_")}
    environment |= {
        "PATH": f"{project / 'bin'}:{environment['PATH']}",
        "PYTHONPATH": str(ROOT),
        "GITHUB_STEP_SUMMARY": str(project / "summary.md"),
    }
    return subprocess.run(
        ["bash", "-e", "-o", "pipefail", "-c", command],
        capture_output=True,
        check=False,
        cwd=project,
        env=environment,
        text=True,
        timeout=TIMEOUT_S,
    )


def fresh_checkout(project: Path) -> None:
    """As the next job finds it: only the baseline comes from the cache."""
    shutil.rmtree(project / "out", ignore_errors=True)
    for name in ("report.xml", "report.html", "metrics.parquet"):
        (project / name).unlink(missing_ok=True)


def test_the_pipeline_file_is_valid(project: Path) -> None:
    done = shell(project, "cwcli config pipeline.toml")
    assert done.returncode == 0, done.stderr
    resolved = tomllib.loads(done.stdout)
    assert resolved["gates"] == tomllib.loads(block("pipeline"))["gates"]


@pytest.mark.parametrize("name", ["github", "gitlab"])
def test_the_job_passes_compares_and_leaves_a_report(project: Path, name: str) -> None:
    steps = commands(name)
    assert {"run", "evaluate", "report", "compare"} <= set(re.findall(r"cwcli (\w+)", " ".join(steps)))
    (project / "summary.md").write_text("an earlier step\n", encoding="utf-8")
    is_first = [step for step in steps if "baseline.parquet out/" not in step or step.startswith("if ")]
    for round_steps in (is_first, steps):  # the second time there is a baseline
        fresh_checkout(project)
        for step in round_steps:
            done = shell(project, step)
            assert done.returncode == 0, f"{step}\n{done.stdout}{done.stderr}"
    suites = ET.parse(project / "report.xml").getroot().iter("testcase")
    names = [case.get("name") for case in suites]
    assert len(names) >= len(tomllib.loads(block("pipeline"))["gates"])
    assert not list(ET.parse(project / "report.xml").getroot().iter("failure"))
    assert "<html" in (project / "report.html").read_text(encoding="utf-8")[:2000].lower()
    if name == "github":
        summary = (project / "summary.md").read_text(encoding="utf-8")
        assert summary.startswith("an earlier step\n")
        assert "ego.position_rmse_m" in summary and "compare" in summary


def test_a_gate_that_fails_and_a_drive_that_cannot_be_read_stop_the_job(project: Path) -> None:
    run, *_ = commands("github")
    (project / "logs" / "broken.mcap").write_bytes(b"no log")
    done = shell(project, run)
    assert done.returncode == 3
    gates = next(step for step in commands("github") if "cwcli evaluate" in step)
    failed = shell(project, gates)
    assert failed.returncode == 1
    assert "broken" in (project / "summary.md").read_text(encoding="utf-8")
    assert list(ET.parse(project / "report.xml").getroot().iter("failure"))


def test_the_page_runs_by_hand_what_the_jobs_run(project: Path) -> None:
    for line in lines_by_hand():
        done = shell(project, line)
        assert done.returncode == 0, done.stderr
    for name in ("report.xml", "metrics.parquet", "report.html", "out/manifest.json"):
        assert (project / name).is_file(), name


def test_the_jobs_keep_what_the_page_says_and_name_only_files_that_they_make() -> None:
    steps = github()["jobs"]["drives"]["steps"]
    uploaded = next(step for step in steps if "upload-artifact" in step.get("uses", ""))["with"]["path"].split()
    kept = gitlab()["drives"]["artifacts"]
    assert set(uploaded) == {"report.html", "report.xml", "out/manifest.json"}
    assert {*kept["paths"], kept["reports"]["junit"]} == {*uploaded, "metrics.parquet"}
    made = " ".join(commands("github") + commands("gitlab"))
    assert all(name.partition("/")[0] in made for name in uploaded)
    assert github()[True] == {"push": {"branches": ["main"]}, "pull_request": None}  # YAML 1.1 reads `on` as true
