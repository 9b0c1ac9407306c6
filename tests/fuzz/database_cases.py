"""Cases of the level `database`: a mutated database of rosbag2, compared with a plain query of SQLite."""

from __future__ import annotations

import sqlite3
import tempfile
from collections import Counter
from contextlib import closing
from functools import cache
from pathlib import Path

from rosbags.rosbag2 import StoragePlugin

from cwcli.logs.read.bags import iter_recording_content
from tests.fuzz.container_rows import Rows, check_mutants, compare_rows
from tests.fuzz.mutate import NUMBERS, Rng, mutate
from tests.unit.logs_read.test_bags import recording

TOKENS = (*NUMBERS, b"CREATE TABLE", b"CREATE VIEW", b"messages", b"topics", b" AS (", b"AUTOINCREMENT", b"cdr")
QUERY = """SELECT topics.name, timestamp, data FROM messages NOT INDEXED JOIN topics ON topics.id = messages.topic_id
WHERE lower(serialization_format) = 'cdr' OR serialization_format = '' OR serialization_format IS NULL"""


def check_case(rng: Rng) -> dict[str, int]:
    """Mutate a database a few times and check each; counts of inputs."""
    return check_mutants(rng, "in.db3", lambda rng: mutate(rng, _database(), TOKENS), check_database)


def check_database(path: Path, counts: Counter[str]) -> None:
    """Compare the messages of a database with those of a query."""
    compare_rows(
        path, counts, lambda file, source, bounds: iter_recording_content(file, source, [], bounds), official_rows
    )


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
