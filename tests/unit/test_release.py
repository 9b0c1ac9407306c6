"""A release is made only of a clean checkout whose versions agree, and dates the changelog."""

from __future__ import annotations

import datetime
import shutil
from pathlib import Path

import pytest

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
