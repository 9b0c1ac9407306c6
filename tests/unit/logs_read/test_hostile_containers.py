"""Bags and databases that stand for more than they may cost: an error in one line, or counted."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin

from cwcli.errors import InputError
from cwcli.logs.read.reader import Log
from tests.unit.logs_read.hostile_containers import HOSTILE_BAGS, HOSTILE_DATABASES, database, packed
from tests.unit.logs_read.test_bags import recording

SLOW = {
    "bz2 of 300 MB",
    "bz2 of 300 MB that lies",
    "lz4 of 300 MB",
    "lz4 of 300 MB that lies",
    "20 chunks of 60 MB",
    "3,000 messages of 64,000",
    "70,000 connections",
    "2,000 definitions",
    "a definition of 20 MB",
    "a message of 4 GB in zstd",
    "100 messages of 50 MB in zstd",
    "70,000 topics",
    "nested empty arrays",
}
"""Those that take seconds to make or to read."""


def marked(names: object) -> list[object]:
    return [pytest.param(name, marks=pytest.mark.long if name in SLOW else ()) for name in names]  # type: ignore[attr-defined]


def said_of(path: Path) -> str:
    """The errors, and the faults that are counted."""
    said: list[str] = []
    try:
        with Log.open(path) as log:
            said.extend(log.faults.counts_by_reason())
            for topic in {each.topic for each in log.channels}:
                log.columns(topic)
    except InputError as error:
        said.append(f"{error} {error.hint}")
    assert not any("\n" in each for each in said)
    return "; ".join(said)


@pytest.mark.parametrize("name", marked(HOSTILE_BAGS))
def test_hostile_bag_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    make, words = HOSTILE_BAGS[name]
    path = make(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert re.search(words, said_of(path))
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("name", marked(HOSTILE_DATABASES))
def test_hostile_database_is_told(tmp_path: Path, name: str) -> None:
    statements, values, words = HOSTILE_DATABASES[name]
    base = next(recording(tmp_path / "drive", StoragePlugin.SQLITE3).glob("*.db3"))
    folder = tmp_path / "hostile"
    folder.mkdir()
    path = database(folder, base, *statements, values=packed(values))
    assert re.search(words, said_of(path))
    assert [each.name for each in folder.iterdir()] == [path.name]
