"""A release is made only of a clean checkout whose versions agree, and dates the changelog."""

from __future__ import annotations

import datetime
import shutil
import sys
from pathlib import Path

import pytest

from tools import release
from tools.release import PLACES, git, problems, versions, write

ROOT = Path(__file__).parents[2]


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A repository with the files that name the version, of version 0.1.0, on the way to 0.2.0."""
    for name in PLACES:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## 0.2.0 (unreleased)\n\n- New.\n\n## 0.1.0 (2026-01-05)\n")
    for command in (
        ["init", "-q"],
        ["add", "."],
        ["-c", "user.name=a", "-c", "user.email=a@b", "commit", "-qm", "All"],
    ):
        git(tmp_path, *command)
    return tmp_path


def test_a_release_sets_the_version_everywhere_and_dates_the_changelog(checkout: Path) -> None:
    assert problems(checkout, "0.2.0") == []
    write(checkout, "0.2.0", datetime.date(2026, 3, 4))
    assert set(versions(checkout).values()) == {"0.2.0"}
    text = (checkout / "CHANGELOG.md").read_text()
    assert "## 0.2.0 (2026-03-04)" in text
    assert "## 0.1.0 (2026-01-05)" in text


@pytest.mark.parametrize("version", ["0.2", "v0.2.0", "0.2.0rc1"])
def test_odd_versions_are_refused(checkout: Path, version: str) -> None:
    assert any(f"{version} is no version" in line for line in problems(checkout, version))


def test_a_changelog_without_the_version_is_refused(checkout: Path) -> None:
    assert problems(checkout, "0.3.0") == ["CHANGELOG.md does not begin with `## 0.3.0 (unreleased)`"]


def test_changes_tags_and_versions_that_differ_are_refused(checkout: Path) -> None:
    git(checkout, "tag", "v0.2.0")
    path = checkout / "CITATION.cff"
    path.write_text(path.read_text().replace("version: 0.1.0", "version: 0.1.1"))
    said = problems(checkout, "0.2.0")
    assert [
        any(part in line for line in said) for part in ("different versions", "not committed", "is there already")
    ] == [True] * 3


def test_a_dry_run_shows_every_change_and_command_and_changes_nothing(
    checkout: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(release, "ROOT", checkout)
    monkeypatch.setattr("sys.argv", ["release", "0.2.0", "--dry-run"])
    assert release.main() == 0
    lines = capsys.readouterr().out.splitlines()
    assert {'+version = "0.2.0"', '+__version__ = "0.2.0"', "+version: 0.2.0"} <= set(lines)
    assert any(line.startswith("+## 0.2.0 (2") for line in lines)
    assert [line.split()[2] for line in lines if line.startswith("would run: ")] == [
        ".ci/run",
        sys.executable,
        sys.executable,
        "git",
        "git",
    ]
    assert git(checkout, "status", "--porcelain") == ""
    assert git(checkout, "tag", "--list") == ""


def test_a_dry_run_of_what_cannot_be_released_fails(
    checkout: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(release, "ROOT", checkout)
    monkeypatch.setattr("sys.argv", ["release", "0.3.0", "--dry-run"])
    assert release.main() == 1
    assert capsys.readouterr().err == "error: CHANGELOG.md does not begin with `## 0.3.0 (unreleased)`\n"
