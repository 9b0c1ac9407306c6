"""Cases of the level `database`: a mutated database of rosbag2, compared with a plain query of SQLite."""

from __future__ import annotations

import sqlite3
import tempfile
from collections import Counter
from contextlib import closing
from functools import cache
from pathlib import Path

from rosbags.rosbag2 import StoragePlugin

from cwcli.errors import CwcliError
from cwcli.input import InputFile
from cwcli.logs.format.records import Channel, Schema
from cwcli.logs.read.bags import iter_recording_content
from cwcli.logs.read.read_bounds import ReadBounds
from cwcli.logs.read.source_format import SourceFormat
from tests.fuzz.file_cases import fast_folder
from tests.fuzz.mutate import NUMBERS, Rng, mutate
from tests.unit.logs_read.test_bags import recording

N_INPUTS = 4
TOKENS = (*NUMBERS, b"CREATE TABLE", b"CREATE VIEW", b"messages", b"topics", b" AS (", b"AUTOINCREMENT", b"cdr")
QUERY = """SELECT topics.name, timestamp, data FROM messages NOT INDEXED JOIN topics ON topics.id = messages.topic_id
WHERE lower(serialization_format) = 'cdr' OR serialization_format = '' OR serialization_format IS NULL"""
Rows = Counter[tuple[str, int, bytes]]
"""Topic, log time in ns and payload of each message, and how often it occurs."""


def check_case(rng: Rng) -> dict[str, int]:
    """Mutate a database a few times and check each; counts of inputs."""
    counts: Counter[str] = Counter()
    for _ in range(N_INPUTS):
        with tempfile.TemporaryDirectory(dir=fast_folder()) as folder:
            path = Path(folder) / "in.db3"
            path.write_bytes(mutate(rng, _database(), TOKENS))
            check_database(path, counts)
    return dict(counts)


def check_database(path: Path, counts: Counter[str]) -> None:
    """Compare the messages of a database that both accept, unless something is counted."""
    counts["inputs"] += 1
    ours, notes = read_database(path, recover=False)
    recovered, _ = read_database(path, recover=True)
    assert ours is None or recovered == ours, "recovery changes an intact database"
    if ours is None:
        return
    counts["accepted"] += 1
    official = official_rows(path)
    if official is None:
        return
    counts["compared"] += 1
    if notes:
        counts["counted"] += 1
    else:
        assert official == ours, (list((official - ours).items())[:3], list((ours - official).items())[:3])


def read_database(path: Path, *, recover: bool) -> tuple[Rows | None, dict[str, int]]:
    """The messages that cwcli reads, None if it refuses; and what it counts."""
    source = SourceFormat("a database")
    topics: dict[int, str] = {}
    rows: Rows = Counter()
    try:
        with InputFile.open(path) as file:
            for item in iter_recording_content(file, source, [], ReadBounds(recover=recover)):
                if isinstance(item, Channel):
                    topics[item.id] = item.topic
                elif not isinstance(item, Schema):
                    rows[topics[item[0]], item[1], bytes(item[2])] += 1
    except CwcliError as error:
        assert "\n" not in str(error)
        return None, source.notes
    return rows, source.notes


def official_rows(path: Path) -> Rows | None:
    """The same by a query, None if SQLite refuses, or a value is of another kind than the table says."""
    try:
        with closing(sqlite3.connect(f"file:{path}?immutable=1", uri=True)) as database:
            database.text_factory = lambda octets: octets.decode("utf-8", "replace")
            return Counter((str(topic), time_ns, bytes(data)) for topic, time_ns, data in database.execute(QUERY))
    except (sqlite3.Error, TypeError, ValueError, OverflowError, MemoryError):
        return None


@cache
def _database() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = next(recording(Path(folder) / "x", StoragePlugin.SQLITE3).glob("*.db3"))
        return path.read_bytes()
