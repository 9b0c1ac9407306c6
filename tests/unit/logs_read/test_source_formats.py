"""`info` of a converted recording describes the file that the user named, not the temporary copy in MCAP."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zstandard
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from cwcli.cli.main import run_command_line
from cwcli.logs.read.reader import Log
from tests.unit.logs_read.test_bags import bag, recording

BAG, DATABASE = "converted from a ROS 1 bag", "converted from a rosbag2 database"
SQLITE3 = StoragePlugin.SQLITE3


def zstd_bag(folder: Path) -> Path:
    """An uncompressed bag inside a zstd file."""
    path = folder / "drive.bag.zst"
    path.write_bytes(zstandard.compress(bag(folder / "drive.bag").read_bytes()))
    return path


def first_file(folder: Path, ending: str) -> Path:
    return next(folder.glob(f"*.{ending}"))


Maker = Callable[[Path], tuple[Path, Path]]
"""Makes a recording: what is named on the command line, and the file whose size counts."""
CASES: dict[str, tuple[Maker, str, list[str], str]] = {
    "bag": (lambda folder: (bag(folder / "d.bag"),) * 2, BAG, [], "101 in 1 chunk, compression none"),
    "bag with bz2": (
        lambda folder: (bag(folder / "d.bag", Writer1.CompressionFormat.BZ2),) * 2,
        BAG,
        ["bz2"],
        "101 in 1 chunk, compression bz2",
    ),
    "bag with lz4": (
        lambda folder: (bag(folder / "d.bag", Writer1.CompressionFormat.LZ4),) * 2,
        BAG,
        ["lz4"],
        "101 in 1 chunk, compression lz4",
    ),
    "bag in a zstd file": (lambda folder: (zstd_bag(folder),) * 2, BAG, ["zstd"], "101 in 1 chunk, compression zstd"),
    "database": (
        lambda folder: (recording(folder / "d", SQLITE3), first_file(folder / "d", "db3")),
        DATABASE,
        [],
        "101, compression none",
    ),
    "database, messages compressed": (
        lambda folder: (recording(folder / "d", SQLITE3, CompressionMode.MESSAGE), first_file(folder / "d", "db3")),
        DATABASE,
        ["zstd"],
        "101, compression zstd",
    ),
    "database, files compressed": (
        lambda folder: (recording(folder / "d", SQLITE3, CompressionMode.FILE), first_file(folder / "d", "zstd")),
        DATABASE,
        ["zstd"],
        "101, compression zstd",
    ),
}
"""Name -> maker, library, compressions, and the line on messages: one transform and 50 messages of two topics."""


@pytest.mark.parametrize("case", CASES)
def test_info_describes_the_file_that_was_named(tmp_path: Path, capsys: pytest.CaptureFixture[str], case: str) -> None:
    make, library, compressions, line = CASES[case]
    named, stored = make(tmp_path)
    assert run_command_line(["info", str(named), "--json"]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    found = {key: document[key] for key in ("size_bytes", "library", "profile", "compression", "chunks", "messages")}
    assert found == {
        "size_bytes": stored.stat().st_size,
        "library": library,
        "profile": "",
        "compression": compressions,
        "chunks": 1 if library == BAG else 0,
        "messages": 101,
    }
    with Log.open(named) as log:  # else the test could not fail
        assert log.library != library
        assert len(log.file) != stored.stat().st_size
    assert run_command_line(["info", str(named)]) == 0
    shown = capsys.readouterr().out
    assert f"messages    {line}\n" in shown
    assert f"library     {library}\n" in shown


def test_a_recording_of_several_databases_adds_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A plain and a compressed bag as the parts of one log: both sizes, both chunks, one compression."""
    parts = [bag(tmp_path / "a.bag"), bag(tmp_path / "b.bag", Writer1.CompressionFormat.LZ4)]
    assert run_command_line(["info", *map(str, parts), "--as-one", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["size_bytes"] == sum(part.stat().st_size for part in parts)
    assert (document["compression"], document["chunks"], document["library"]) == (["lz4"], 2, BAG)
