"""Reads rosbag2's databases (`.db3`): topics and messages with SQLite, message types with the library `rosbags`.

Tables: https://github.com/ros2/rosbag2, folder rosbag2_storage_sqlite3, file sqlite_storage.cpp. Every row of
`messages` is read, or counted: the table is read by its rows, not by its index, which may be damaged, and messages
whose topic is not in `topics` are counted.
"""

from __future__ import annotations

import sqlite3
from array import array
from collections import Counter
from collections.abc import Generator
from typing import TYPE_CHECKING, Any, NamedTuple

from cwcli.errors import InputError
from cwcli.input import MAX_CHUNK_BYTES
from cwcli.logs.codecs.compressed_messages import ZSTD_MAGIC, decompress_message
from cwcli.logs.format.records import Channel, Schema
from cwcli.logs.read.ros_definitions import MAX_CHANNELS, iter_schemas_and_channels

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from cwcli.logs.read.source_format import SourceFormat

CDR_FORMAT = "cdr"
"""The serialization format of a topic that can be read."""
MAX_NAMES_SHOWN = 5
"""The number of topics, or of their ids, that a note lists. Chosen by hand."""
MAX_SHOWN_VALUE_CHARS = 80
"""The number of characters of a value from the database that a note shows. Chosen by hand."""
MAX_DATABASE_VALUE_BYTES = MAX_CHUNK_BYTES
"""The greatest size in bytes of one message or text in a database: that of a chunk."""
BYTES_PER_GIGABYTE = 1_000_000_000
"""The number of bytes in a gigabyte, for messages to users."""

Content = Schema | Channel | tuple[int, int, bytes]


class TopicRow(NamedTuple):
    """A row of `topics`; `id` is the id of its channel, `topic_id` the id in the table."""

    id: int
    topic_id: int
    topic: str
    msgtype: str
    serialization_format: str


def iter_database_content(
    database: sqlite3.Connection, name: str, source: SourceFormat, max_bytes: int
) -> Generator[Content, None, None]:
    """Yield schemas, channels, and messages in the order of their times.

    Args:
        database: An open database.
        name: The file's name, for messages.
        source: Gets what could not be read, and the compression of messages.
        max_bytes: Total size in bytes to which all messages may decompress.

    Raises:
        InputError: The messages unpack to more than `max_bytes`.
        sqlite3.Error, ValueError: It is damaged, or is no database of rosbag2.
    """
    topics = _read_topics(database)
    usable = [each for each in topics if each.serialization_format.lower() == CDR_FORMAT]
    yield from iter_schemas_and_channels(usable, _load_message_types(database), source.notes)
    rows, topic_ids, times_ns = _read_message_rows_by_time(database)
    counts = Counter(topic_ids.tolist())
    _note_unread_messages(topics, counts, source.notes)
    channel_of = {each.topic_id: each.id for each in usable}
    n_left = max_bytes
    for row, topic_id, time_ns in zip(rows.tolist(), topic_ids.tolist(), times_ns.tolist(), strict=True):
        if topic_id not in channel_of:
            continue
        found = database.execute("SELECT data FROM messages WHERE rowid = ?", (row,)).fetchone()
        if found is None or not isinstance(found[0], bytes):
            raise ValueError(f"message {row} holds no octets")
        payload = found[0]
        if payload.startswith(ZSTD_MAGIC):
            payload = decompress_message(payload)
            source.add_compression("zstd")
        n_left -= len(payload)
        if n_left < 0:
            what = f"its messages unpack to more than {max_bytes / BYTES_PER_GIGABYTE:g} GB"
            raise InputError(what, where=name, hint="--max-input reads more")
        yield channel_of[topic_id], time_ns, payload


def _table_column_names(database: sqlite3.Connection, table: str) -> set[str]:
    """Return the column names of a table; empty for a view of that name, which could be endless."""
    kind = database.execute("SELECT type FROM sqlite_master WHERE name = ?", (table,)).fetchone()
    if kind is None or kind[0] != "table":
        return set()
    return {str(row[1]) for row in database.execute(f"PRAGMA table_info({table})")}


def _read_topics(database: sqlite3.Connection) -> list[TopicRow]:
    """Read the topics, with channel ids from 1 on.

    Raises:
        ValueError: A table is missing, or there are more topics than channel ids.
    """
    for table in ("topics", "messages"):
        if not _table_column_names(database, table):
            raise ValueError(f"it has no table of {table}")
    query = "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
    found = [
        TopicRow(number, topic_id, str(topic), str(kind), str(serialization or CDR_FORMAT))
        for number, (topic_id, topic, kind, serialization) in enumerate(database.execute(query), 1)
    ]
    if len(found) > MAX_CHANNELS:
        raise ValueError(f"it has {len(found)} topics, and a log has room for {MAX_CHANNELS}")
    return found


def _load_message_types(database: sqlite3.Connection) -> Any:
    """Return the message types that the database defines, or those of the latest release that the library knows."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    own: dict[str, Any] = {}
    if _table_column_names(database, "message_definitions"):
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions ORDER BY id"
        for kind, encoding, text in database.execute(query):
            if encoding == "ros2msg":
                own.update(get_types_from_msg(text, kind))
            elif encoding == "ros2idl":
                own.update(get_types_from_idl(text))
    if not own:
        return get_typestore(Stores.LATEST)
    store = get_typestore(Stores.EMPTY)
    store.register(own)
    return store


def _read_message_rows_by_time(
    database: sqlite3.Connection,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return row, topic id and time in ns of every message, each (n,), sorted by time.

    Raises:
        ValueError: A topic id is not an integer, or a time is not one or negative.
    """
    import numpy as np

    numbers = array("q")
    for row, topic_id, time_ns in database.execute("SELECT rowid, topic_id, timestamp FROM messages NOT INDEXED"):
        if not isinstance(topic_id, int) or not isinstance(time_ns, int) or time_ns < 0:
            raise ValueError(
                f"message {row} has the topic id {_shorten_value(topic_id)} and the time {_shorten_value(time_ns)}"
            )
        numbers.extend((row, topic_id, time_ns))
    rows, topic_ids, times_ns = np.array(numbers, np.int64).reshape(-1, 3).T
    order = np.lexsort((rows, times_ns))
    return rows[order], topic_ids[order], times_ns[order]


def _note_unread_messages(topics: list[TopicRow], counts: Counter[int], notes: dict[str, int]) -> None:
    """Note the messages that are not read: those without a topic, and those that are not CDR."""
    known = {each.topic_id for each in topics}
    unknown = sorted(counts.keys() - known)
    if unknown:
        n = sum(counts[each] for each in unknown)
        shown = _format_first_names([str(each) for each in unknown])
        notes[f"messages that belong to no topic (topic id{'s' if len(unknown) > 1 else ''} {shown})"] = n
    by_format: dict[str, list[TopicRow]] = {}
    for each in topics:
        if each.serialization_format.lower() != CDR_FORMAT:
            by_format.setdefault(_shorten_value(each.serialization_format), []).append(each)
    for name, others in by_format.items():
        n = sum(counts[each.topic_id] for each in others)
        if n:
            what = f"messages in the format {name}, which is not read, only CDR is"
            notes[f"{what} ({_format_first_names([_shorten_value(each.topic) for each in others])})"] = n


def _format_first_names(names: list[str]) -> str:
    more = len(names) - MAX_NAMES_SHOWN
    return ", ".join(names[:MAX_NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "")


def _shorten_value(value: object) -> str:
    return str(value)[:MAX_SHOWN_VALUE_CHARS]
