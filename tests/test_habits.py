"""The habits that a machine keeps: CI runs what a person runs, actions are pinned, templates are well formed."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
PINNED = re.compile(r"^[\w.-]+/[\w./-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+$")


def document(path: Path) -> dict[Any, Any]:
    found: dict[Any, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    return found


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_actions_are_pinned_by_commit_with_their_version(path: Path) -> None:
    used = re.findall(r"uses: (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    assert used
    assert [each for each in used if not PINNED.match(each)] == []
    assert document(path)["permissions"] == {"contents": "read"}


def test_an_action_has_one_commit_in_all_workflows() -> None:
    text = "\n".join(path.read_text(encoding="utf-8") for path in WORKFLOWS)
    pins = set(re.findall(r"uses: ([\w./-]+)@(\w+)", text))
    assert len({action for action, _ in pins}) == len(pins)


def test_every_push_and_pull_request_calls_what_a_person_calls() -> None:
    workflow = document(ROOT / ".github" / "workflows" / "ci.yml")
    assert set(workflow[True]) == {"push", "pull_request"}  # YAML 1.1 reads `on` as true
    steps = workflow["jobs"]["run"]["steps"]
    assert steps[-1] == {"run": ".ci/run"}
    assert steps[0]["with"]["fetch-depth"] == 0  # the budget needs the history
    assert any("valgrind" in step.get("run", "") for step in steps)


def test_the_forms_for_issues_have_what_github_asks_for() -> None:
    forms = [path for path in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml") if path.name != "config.yml"]
    assert len(forms) >= 2
    for form in map(document, forms):
        assert {"name", "description", "body"} <= set(form)
        ids = [part["id"] for part in form["body"]]
        assert len(ids) == len(set(ids))
        assert all(part["attributes"]["label"] for part in form["body"])
    assert (ROOT / ".github" / "pull_request_template.md").exists()


def test_the_hooks_before_a_commit_are_the_projects_own_ruff(tmp_path: Path) -> None:
    [local] = document(ROOT / ".pre-commit-config.yaml")["repos"]
    assert local["repo"] == "local"
    assert [hook["id"] for hook in local["hooks"]] == ["ruff-check", "ruff-format"]
    for hook in local["hooks"]:
        assert hook["language"] == "system"
        assert hook["entry"].startswith("python -m ruff ")


@pytest.mark.parametrize("folder", ["studies", "bench"])
def test_every_research_script_has_its_line(folder: str) -> None:
    path = ROOT / "tests" / folder
    rows = re.findall(r"^\| `(\w+\.py)` \| \S", (path / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert rows == sorted(script.name for script in path.glob("*.py") if script.name != "__init__.py")
    assert list(path.glob("test_*.py")) == []


def test_the_release_has_a_dry_run_that_changes_nothing() -> None:
    before = subprocess.run(["git", "status", "--porcelain"], check=False, cwd=ROOT, capture_output=True).stdout
    command = [sys.executable, "-m", "tools.release", "0.0.0", "--check"]
    done = subprocess.run(command, check=False, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 1
    assert "error: CHANGELOG.md does not begin with `## 0.0.0 (unreleased)`" in done.stderr.splitlines()
    after = subprocess.run(["git", "status", "--porcelain"], check=False, cwd=ROOT, capture_output=True).stdout
    assert after == before
