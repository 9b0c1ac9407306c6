"""rosbag2's databases: every row is read or counted, journals beside them are replayed, and nothing is changed."""

from __future__ import annotations

import hashlib
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import fsspec
import numpy as np
import pytest
import zstandard
from rosbags.rosbag2 import StoragePlugin

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BAD_DATA, EXIT_DONE, InputError
from cwcli.logs.read.reader import Log
from tests.unit.logs_read.test_bags import FIX, T0_NS, N, recording

N_MESSAGES = 2 * N + 1
N_MOVED = 40
"""Messages that a journal holds, or takes back."""


@pytest.fixture
def database(tmp_path: Path) -> Path:
    """A database of one transform, fixes and rates of turn."""
    return next(recording(tmp_path / "drive", StoragePlugin.SQLITE3).glob("*.db3"))


def change(path: Path, *statements: str) -> None:
    with closing(sqlite3.connect(path)) as connection, connection:
        for each in statements:
            connection.execute(each)


def contents(folder: Path) -> dict[str, str]:
    return {each.name: hashlib.sha256(each.read_bytes()).hexdigest() for each in folder.iterdir()}


def faults(path: Path) -> tuple[int, dict[str, int]]:
    with Log.open(path) as log:
        return log.n_messages, log.faults.counts_by_reason()


def copy_unfinished(path: Path, target: Path, *statements: str, commit: bool = True) -> Path:
    """A copy of a database as a recorder that was killed behind these statements leaves it, journals and all."""
    target.mkdir()
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        for each in statements:
            connection.execute(each)
        if not commit:
            connection.execute("PRAGMA cache_size = 1")
        for file in path.parent.glob(f"{path.name}*"):
            shutil.copy(file, target / file.name)
    return target / path.name


DOUBLE = (
    f"INSERT INTO messages (topic_id, timestamp, data) SELECT topic_id, timestamp, data FROM messages LIMIT {N_MOVED}"
)


def test_a_write_ahead_log_is_replayed_and_told(database: Path, tmp_path: Path) -> None:
    wal = copy_unfinished(database, tmp_path / "cut", "PRAGMA journal_mode = WAL", DOUBLE)
    assert (wal.parent / f"{wal.name}-wal").stat().st_size > 0
    (wal.parent / f"{wal.name}-shm").unlink(missing_ok=True)
    before = contents(wal.parent)
    told = {f"messages of the write-ahead log ({wal.name}-wal)": N_MOVED}
    assert faults(wal) == (N_MESSAGES + N_MOVED, told)
    assert contents(wal.parent) == before
    link = tmp_path / "link.db3"
    link.symlink_to(wal)
    assert faults(link)[0] == N_MESSAGES + N_MOVED


def test_a_write_ahead_log_of_a_recording_in_a_folder_is_replayed(database: Path, tmp_path: Path) -> None:
    wal = copy_unfinished(database, tmp_path / "cut", "PRAGMA journal_mode = WAL", DOUBLE)
    shutil.copy(database.parent / "metadata.yaml", wal.parent)
    n_messages, counted = faults(wal.parent)
    assert n_messages == N_MESSAGES + N_MOVED
    assert counted[f"messages of the write-ahead log ({wal.name}-wal)"] == N_MOVED


def test_a_cut_write_ahead_log_tells_what_is_lost(database: Path, tmp_path: Path) -> None:
    wal = copy_unfinished(database, tmp_path / "cut", "PRAGMA journal_mode = WAL", DOUBLE)
    log = wal.parent / f"{wal.name}-wal"
    page_bytes = int.from_bytes(log.read_bytes()[8:12], "big")
    n_frames = (log.stat().st_size - 32) // (page_bytes + 24)
    data = bytearray(log.read_bytes())
    data[-1] ^= 1  # in the last page, which ends the transaction: nothing of it counts
    log.write_bytes(data)
    told = {f"unfinished or damaged pages of the write-ahead log, not read ({log.name})": n_frames}
    assert faults(wal) == (N_MESSAGES, told)


def test_a_write_ahead_log_that_was_written_back_changes_nothing(database: Path, tmp_path: Path) -> None:
    checkpoint = "PRAGMA wal_checkpoint(FULL)"
    wal = copy_unfinished(database, tmp_path / "cut", "PRAGMA journal_mode = WAL", DOUBLE, checkpoint)
    assert (wal.parent / f"{wal.name}-wal").stat().st_size > 0
    assert faults(wal) == (N_MESSAGES + N_MOVED, {})


def test_an_unfinished_transaction_is_taken_back_and_told(database: Path, tmp_path: Path) -> None:
    """A cache of one page makes SQLite write into the database before the transaction ends."""
    many = "WITH RECURSIVE k(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM k WHERE n < 200) "
    insert = f"{many}INSERT INTO messages (topic_id, timestamp, data) SELECT 1, n, zeroblob(3000) FROM k"
    hot = copy_unfinished(database, tmp_path / "cut", "PRAGMA cache_size = 1", "BEGIN", insert, commit=False)
    assert hot.stat().st_size > database.stat().st_size
    before = contents(hot.parent)
    assert any(name.endswith("-journal") for name in before)
    told = {f"unfinished changes undone by the rollback journal ({hot.name}-journal)": 1}
    assert faults(hot) == (N_MESSAGES, told)
    assert contents(hot.parent) == before


def test_a_journal_that_holds_nothing_changes_nothing(database: Path) -> None:
    for suffix in ("-wal", "-journal"):
        (database.parent / f"{database.name}{suffix}").touch()
    assert faults(database) == (N_MESSAGES, {})
    (database.parent / f"{database.name}-wal").write_bytes(b"no write-ahead log" * 100)
    assert faults(database) == (N_MESSAGES, {})


def test_no_output_overwrites_a_journal(database: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wal = copy_unfinished(database, tmp_path / "cut", "PRAGMA journal_mode = WAL", DOUBLE)
    before = contents(wal.parent)
    assert run_command_line(["estimate", str(wal), "-o", f"{wal}-wal", "--force"]) != EXIT_DONE
    assert "the input itself" in capsys.readouterr().err
    assert contents(wal.parent) == before


def test_messages_of_no_topic_are_counted(database: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (fix,) = sqlite3.connect(database).execute("SELECT id FROM topics WHERE name = '/fix'").fetchone()
    change(database, f"UPDATE messages SET topic_id = 7 + rowid % 3 WHERE topic_id = {fix} AND rowid < 25")
    with Log.open(database) as log:
        fixes = log.columns("/fix")
        (told,) = log.faults.counts_by_reason().items()
    assert told == ("messages that belong to no topic (topic ids 7, 8, 9)", N - len(fixes))
    assert told[1] == 12  # rows 2, 4, ..., 24
    assert run_command_line(["estimate", str(database), "--strict", "--quiet"]) == EXIT_BAD_DATA
    assert "messages that belong to no topic (topic ids 7, 8, 9): 12" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("serialization", ["protobuf", "json", "x" * 200])
def test_other_serialization_formats_are_left_out_by_name(database: Path, serialization: str) -> None:
    change(database, f"UPDATE topics SET serialization_format = '{serialization}' WHERE name = '/imu'")
    with Log.open(database) as log:
        assert {each.topic for each in log.channels} == {"/tf_static", "/fix"}
        told = f"messages in the format {serialization[:80]}, which is not read, only CDR is (/imu)"
        assert log.faults.counts_by_reason() == {told: N}
        assert len(log.columns("/fix")) == N


def test_a_damaged_index_loses_no_message(database: Path) -> None:
    """An index that lacks rows: what goes through it alone finds half of the messages."""
    change(database, "CREATE INDEX IF NOT EXISTS timestamp_idx ON messages (timestamp ASC)")
    change(
        database,
        "PRAGMA writable_schema = ON",
        f"UPDATE sqlite_master SET sql = sql || ' WHERE timestamp > {T0_NS + 10**9}' WHERE name = 'timestamp_idx'",
    )
    change(database, "REINDEX timestamp_idx")
    change(
        database,
        "PRAGMA writable_schema = ON",
        "UPDATE sqlite_master SET sql = substr(sql, 1, instr(sql, ' WHERE') - 1) WHERE name = 'timestamp_idx'",
    )
    by_index = "SELECT count(*) FROM (SELECT timestamp FROM messages INDEXED BY timestamp_idx ORDER BY timestamp)"
    assert sqlite3.connect(database).execute(by_index).fetchone()[0] < N_MESSAGES
    assert faults(database) == (N_MESSAGES, {})


def test_topic_ids_may_be_any_number(database: Path) -> None:
    for table, column in (("topics", "id"), ("messages", "topic_id")):
        change(database, f"UPDATE {table} SET {column} = {column} * 1000000000000 - 5")
    with Log.open(database) as log:
        assert len(log.columns("/fix")) == len(log.columns("/imu")) == N
        np.testing.assert_array_equal(log.columns("/fix").fields["latitude"], [48.0 + k * 1e-5 for k in range(N)])


@pytest.mark.parametrize(
    "statements",
    [
        ("ALTER TABLE messages RENAME TO m", "CREATE VIEW messages AS SELECT * FROM m, m AS n, m AS o"),
        ("DROP TABLE topics",),
        ("UPDATE messages SET topic_id = 'x'",),
        ("UPDATE messages SET data = 5",),
    ],
)
def test_what_is_no_recording_is_refused(database: Path, statements: tuple[str, ...]) -> None:
    change(database, *statements)
    with pytest.raises(InputError, match="can't read it"):
        Log.open(database)


def test_messages_that_unpack_to_too_much_are_refused(database: Path) -> None:
    packed = zstandard.compress(bytes(2_000_000))
    with closing(sqlite3.connect(database)) as connection, connection:
        connection.execute("UPDATE messages SET data = ?", (packed,))
    with pytest.raises(InputError, match=r"its messages unpack to more than 0\.1 GB"):
        Log.open(database, max_pipe_bytes=100_000_000)
    with pytest.raises(InputError, match=r"its messages unpack to more than 0\.00[0-9]+ GB"):
        Log.open(database, max_ratio=10, max_chunk_bytes=3_000_000)


def test_short_messages_that_do_not_shrink_fit_beside_a_small_bound_of_input(database: Path) -> None:
    """A record of the log takes more than a row of the table, and neither gets smaller by compression."""
    octets = np.random.default_rng(1).bytes(100_000 * 200)
    with closing(sqlite3.connect(database)) as connection, connection:
        connection.execute("DROP INDEX timestamp_idx")
        (topic_id,) = connection.execute("SELECT min(id) FROM topics").fetchone()
        rows = ((topic_id, T0_NS + k, octets[200 * k : 200 * (k + 1)]) for k in range(100_000))
        connection.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    with Log.open(database, max_pipe_bytes=1_000_000) as log:
        assert log.n_messages == N_MESSAGES + 100_000


def test_aliases_in_a_quality_of_service_cost_nothing(database: Path) -> None:
    """It is YAML that nobody needs: nothing of it is parsed."""
    bomb = "a: &a [x, x, x]\n" + "".join(f"b{k}: &{chr(98 + k)} [{f'*{chr(97 + k)}, ' * 9}]\n" for k in range(9))
    with closing(sqlite3.connect(database)) as connection, connection:
        connection.execute("UPDATE topics SET offered_qos_profiles = ?", (bomb,))
    assert faults(database) == (N_MESSAGES, {})
    with Log.open(database) as log:
        assert {each.schema_name for each in log.channels} >= {FIX}


def test_a_write_ahead_log_that_is_not_on_this_machine_is_told(database: Path, tmp_path: Path) -> None:
    wal = copy_unfinished(database, tmp_path / "cut", "PRAGMA journal_mode = WAL", DOUBLE)
    store = fsspec.filesystem("memory")
    for each in wal.parent.iterdir():
        store.pipe_file(f"/unfinished/{each.name}", each.read_bytes())
    told = f"write-ahead logs that are not read, as the databases are not on this machine ({wal.name}-wal)"
    with Log.open("memory://unfinished/") as log:
        assert (log.n_messages, log.faults.counts_by_reason()) == (N_MESSAGES, {told: 1})
