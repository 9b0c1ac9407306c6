"""Opens SQLite databases with the journals that an unfinished writer has left in their folder.

A write-ahead log (`-wal`) holds messages that are not in the database yet, a rollback journal (`-journal`) pages to be
restored. SQLite reads both, but changes the files. So a database with a journal is copied with it into a private folder
and opened there; one without is opened in place, as a file that does not change.

Formats: https://www.sqlite.org/fileformat2.html, https://www.sqlite.org/walformat.html
"""

from __future__ import annotations

import os
import sqlite3
import struct
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import IO

from cwcli.errors import InputError, OutputError
from cwcli.input import InputFile
from cwcli.logs.read.read_bounds import COPY_BLOCK_BYTES

WAL_SUFFIX, JOURNAL_SUFFIX = "-wal", "-journal"
"""The suffixes of a write-ahead log and of a rollback journal (https://www.sqlite.org/fileformat2.html)."""
ROLLBACK_JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")
"""The first bytes of a rollback journal, and the last ones where it names a file (sqlite.org/fileformat2.html)."""
WAL_HEADER_STRUCT = struct.Struct(">IIIIIIII")
"""The header of a write-ahead log: magic number, version, page size in bytes, number of the checkpoint, two salts, two
checksums (https://www.sqlite.org/walformat.html)."""
WAL_FRAME_HEADER_STRUCT = struct.Struct(">IIIIII")
"""The header of a frame in a write-ahead log: page, size of the database, two salts, two checksums; the page
follows."""
WAL_MAGIC_NUMBERS = (0x377F0682, 0x377F0683)
"""The magic numbers of a write-ahead log, one for each byte order of its checksums (sqlite.org/fileformat2.html)."""
SALT_INDICES_OF_WAL_HEADER = slice(4, 6)
"""The places of the salts among the numbers of `WAL_HEADER_STRUCT`."""
SALT_INDICES_OF_WAL_FRAME = slice(2, 4)
"""The places of the salts among the numbers of `WAL_FRAME_HEADER_STRUCT`."""

SQLITE_LIMITS = {
    "SQLITE_LIMIT_SQL_LENGTH": 100_000,
    "SQLITE_LIMIT_COLUMN": 100,
    "SQLITE_LIMIT_EXPR_DEPTH": 10,
    "SQLITE_LIMIT_COMPOUND_SELECT": 3,
    "SQLITE_LIMIT_VDBE_OP": 25_000,
    "SQLITE_LIMIT_FUNCTION_ARG": 8,
    "SQLITE_LIMIT_ATTACHED": 0,
    "SQLITE_LIMIT_LIKE_PATTERN_LENGTH": 50,
    "SQLITE_LIMIT_VARIABLE_NUMBER": 10,
    "SQLITE_LIMIT_TRIGGER_DEPTH": 10,
    "SQLITE_LIMIT_WORKER_THREADS": 0,
}
"""The limits that SQLite's authors advise for databases of unknown origin (https://www.sqlite.org/security.html)."""
SAFETY_PRAGMAS_ADVISED_BY_SQLITE = ("trusted_schema = OFF", "cell_size_check = ON", "mmap_size = 0")
"""The settings that they advise."""
READABLE_DATABASE_TABLES = frozenset({"sqlite_master", "topics", "messages", "message_definitions"})
"""The tables that are read."""
CALLABLE_SQL_FUNCTIONS = frozenset({"count", "min"})
"""The functions that queries may call."""
READABLE_PRAGMAS = frozenset({"table_xinfo", "wal_checkpoint"})
"""The pragmas that queries may use: one describes a table, one writes a journal into a private copy."""
MIN_ALLOWED_QUERY_STEPS, ALLOWED_QUERY_STEPS_PER_FILE_BYTE, QUERY_STEPS_BETWEEN_CHECKS = 1_000_000, 8, 10_000
"""A query may take this number of steps of SQLite's machine, and so many more for each byte of the file; it is asked
each so many steps. Chosen by hand: a row takes about ten steps and has at least eight bytes."""


def open_journals(file: InputFile) -> list[InputFile]:
    """Open the journals of a database that are not empty; a database without a name on the disk has none.

    Raises:
        InputError: One can't be read.
    """
    name = _path_of_open_file(file)
    found: list[InputFile] = []
    try:
        for suffix in (WAL_SUFFIX, JOURNAL_SUFFIX) if name is not None else ():
            path = Path(f"{name}{suffix}")
            if path.is_file() and path.stat().st_size:
                found.append(InputFile.open(path, f"{file.name}{suffix}"))
    except BaseException:
        for each in found:
            each.close()
        raise
    return found


def _path_of_open_file(file: InputFile) -> str | None:
    """Return the path of an open file with links resolved; None if it has no name on the disk."""
    name = os.path.realpath(f"/dev/fd/{file.descriptor}")
    with suppress(OSError):
        if os.path.samestat(os.stat(name), os.fstat(file.descriptor)):  # noqa: PTH116 - the descriptor's twin
            return name
    return None


@contextmanager
def open_database(
    file: InputFile, journals: Sequence[InputFile], max_value_bytes: int, notes: dict[str, int]
) -> Iterator[sqlite3.Connection]:
    """Yield a connection to a database, with its journals replayed in a private copy.

    Args:
        journals: From `open_journals`.
        max_value_bytes: A longer text or blob is an error.
        notes: Gets what the journals changed, as text -> how often.

    Raises:
        InputError: One of the files changed while it was copied, or the journal names a file.
        OutputError: There is no room for the copy.
        sqlite3.Error: It is damaged.
    """
    if not journals and _path_of_open_file(file) is not None:
        uri = f"file:/dev/fd/{file.descriptor}?immutable=1"
        with closing(_open_connection(uri, max_value_bytes, len(file))) as database:
            yield database
        return
    n_bytes = len(file) + sum(map(len, journals))
    kinds = {WAL_SUFFIX if each.name.endswith(WAL_SUFFIX) else JOURNAL_SUFFIX: each for each in journals}
    for each in journals:
        _require_journal_without_file_name(each)
    with ExitStack() as stack:
        with translate_copy_errors(file.name):
            copy = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="cwcli-"))) / "log.db3"
            with copy.open("xb") as stream:
                copy_file(file, stream)
        n_before = _count_messages_without_journals_or_zero(copy, max_value_bytes, n_bytes)
        for suffix, each in kinds.items():
            with translate_copy_errors(each.name), Path(f"{copy}{suffix}").open("xb") as stream:
                copy_file(each, stream)
        for each in (file, *journals):
            each.check_unchanged()
        with closing(_open_connection(f"file:{copy}?mode=rw", max_value_bytes, n_bytes)) as database:
            (n_after,) = database.execute("SELECT count(*) FROM messages NOT INDEXED").fetchone()
            if WAL_SUFFIX in kinds:
                _, n_frames, _ = database.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
                shown = Path(kinds[WAL_SUFFIX].name).name
                _add_positive_note(notes, f"messages of the write-ahead log ({shown})", n_after - n_before)
                n_lost = _count_current_wal_frames(kinds[WAL_SUFFIX]) - max(n_frames, 0)
                _add_positive_note(
                    notes, f"unfinished or damaged pages of the write-ahead log, not read ({shown})", n_lost
                )
            if JOURNAL_SUFFIX in kinds and not Path(f"{copy}{JOURNAL_SUFFIX}").exists():
                shown = Path(kinds[JOURNAL_SUFFIX].name).name
                _add_positive_note(notes, f"unfinished changes undone by the rollback journal ({shown})", 1)
            yield database


def _require_journal_without_file_name(journal: InputFile) -> None:
    """Refuse a rollback journal that ends with the name of a super-journal: SQLite would remove that file, whichever.

    Raises:
        InputError: It does.
    """
    n = len(ROLLBACK_JOURNAL_MAGIC)
    if len(journal) >= n and bytes(journal[len(journal) - n :]) == ROLLBACK_JOURNAL_MAGIC:
        what = "it names another file, as of a change to several databases at once, which is not read"
        raise InputError(what, where=journal.name, hint="open the database with SQLite where it was written")


def _open_connection(uri: str, max_value_bytes: int, n_bytes: int) -> sqlite3.Connection:
    """Open a database of unknown origin, as https://www.sqlite.org/security.html advises.

    Args:
        max_value_bytes: A longer text or blob is an error.
        n_bytes: Size of the database with its journals.
    """
    database = sqlite3.connect(uri, uri=True)
    database.text_factory = lambda octets: octets.decode("utf-8", "replace")
    for name, limit in SQLITE_LIMITS.items():
        database.setlimit(getattr(sqlite3, name), limit)
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max_value_bytes)
    for pragma in SAFETY_PRAGMAS_ADVISED_BY_SQLITE:
        database.execute(f"PRAGMA {pragma}")
    database.set_authorizer(_sqlite_permission_of_action)
    _limit_query_steps(database, n_bytes)
    return database


def _sqlite_permission_of_action(
    action: int, first: str | None, second: str | None, _: str | None, inner: str | None
) -> int:
    """Allow reading the named tables, with a few functions and pragmas, and nothing through a view or a trigger."""
    is_allowed = inner is None and (
        action == sqlite3.SQLITE_SELECT
        or (action == sqlite3.SQLITE_READ and (first or "").lower() in READABLE_DATABASE_TABLES)
        or (action == sqlite3.SQLITE_FUNCTION and second in CALLABLE_SQL_FUNCTIONS)
        or (action == sqlite3.SQLITE_PRAGMA and first in READABLE_PRAGMAS)
    )
    return sqlite3.SQLITE_OK if is_allowed else sqlite3.SQLITE_DENY


def _limit_query_steps(database: sqlite3.Connection, n_bytes: int) -> None:
    """Stop a database whose queries take more steps than a file of `n_bytes` can have rows for."""
    n_left = (MIN_ALLOWED_QUERY_STEPS + ALLOWED_QUERY_STEPS_PER_FILE_BYTE * n_bytes) // QUERY_STEPS_BETWEEN_CHECKS

    def count_steps() -> int:
        nonlocal n_left
        n_left -= 1
        return n_left < 0

    database.set_progress_handler(count_steps, QUERY_STEPS_BETWEEN_CHECKS)


@contextmanager
def translate_copy_errors(name: str) -> Iterator[None]:
    """Turn an `OSError` inside the block into the error that a temporary copy can't be written.

    Raises:
        OutputError: There was one.
    """
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"the temporary copy of {name} can't be written: {error.strerror}",
            where=tempfile.gettempdir(),
            hint="point TMPDIR to a folder with more room",
        ) from error


def copy_file(file: InputFile, target: IO[bytes]) -> None:
    """Copy all of a file, piece by piece."""
    for at in range(0, len(file), COPY_BLOCK_BYTES):
        target.write(file[at : at + COPY_BLOCK_BYTES])


def _count_messages_without_journals_or_zero(path: Path, max_value_bytes: int, n_bytes: int) -> int:
    """Return the number of messages of a database without its journals; 0 if it can't be read without them."""
    try:
        with closing(_open_connection(f"file:{path}?immutable=1", max_value_bytes, n_bytes)) as database:
            return int(database.execute("SELECT count(*) FROM messages NOT INDEXED").fetchone()[0])
    except sqlite3.Error:
        return 0


def _count_current_wal_frames(wal: InputFile) -> int:
    """Return the number of frames in a write-ahead log that belong to its current checkpoint, whole or not."""
    if len(wal) < WAL_HEADER_STRUCT.size:
        return 0
    header = WAL_HEADER_STRUCT.unpack(wal[: WAL_HEADER_STRUCT.size])
    page_bytes = header[2]
    if header[0] not in WAL_MAGIC_NUMBERS or not page_bytes:
        return 0
    places = range(
        WAL_HEADER_STRUCT.size, len(wal) - WAL_FRAME_HEADER_STRUCT.size + 1, WAL_FRAME_HEADER_STRUCT.size + page_bytes
    )
    frames = (WAL_FRAME_HEADER_STRUCT.unpack(wal[at : at + WAL_FRAME_HEADER_STRUCT.size]) for at in places)
    return sum(frame[SALT_INDICES_OF_WAL_FRAME] == header[SALT_INDICES_OF_WAL_HEADER] for frame in frames)


def _add_positive_note(notes: dict[str, int], what: str, n: int) -> None:
    if n > 0:
        notes[what] = n
