"""Reads rosbag2's databases (`.db3`) with SQLite.

Tables: https://github.com/ros2/rosbag2, folder rosbag2_storage_sqlite3, file sqlite_storage.cpp. Every row of
`messages` is read, or counted: the table is read by its rows, not by its index, which may be damaged, and messages
whose topic is not in `topics` are counted.

Only real tables with stored columns are read (`cwcli.logs.read.sqlite_files` bounds the rest). The definitions of the
database are schemas as they are, or in `ros2msg` what they say in IDL. A database without definitions gets those of
the latest release that the library `rosbags` knows. No code is made from either.
"""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Generator, Iterator, Mapping
from typing import Any, NamedTuple

from cwcli.errors import InputError, UsageError, install_hint
from cwcli.input import InputFile
from cwcli.logs.codecs.compressed_messages import MAX_DECOMPRESSED_MESSAGE_BYTES, ZSTD_MAGIC, decompress_message
from cwcli.logs.codecs.ros2idl import ros2msg_text_of_idl
from cwcli.logs.codecs.ros2msg import SchemaError
from cwcli.logs.format.records import Channel, Schema
from cwcli.logs.read.read_bounds import BYTES_PER_GIGABYTE, ReadBounds
from cwcli.logs.read.source_format import SourceFormat
from cwcli.text import format_first_names

READABLE_SERIALIZATION_FORMAT = "cdr"
"""The serialization format of a topic that can be read."""
MAX_TOPICS_LISTED_IN_NOTE = 5
"""The number of topics, or of their ids, that a note lists. Chosen by hand."""
MAX_SHOWN_VALUE_CHARS = 80
"""The number of characters of a value from the database that a note shows. Chosen by hand."""
STORED_COLUMN_CODE = 0
"""How `PRAGMA table_xinfo` marks a column that is stored, and neither computed nor hidden."""
MAX_DEFINITIONS_BYTES = 16_000_000
"""The greatest size of all definitions of a database. Chosen by hand."""
COUNTED_DEFINITION_BYTES_PER_IDL_CHARACTER = 4
"""A character of IDL counts as four towards that size. Chosen by hand: a megabyte of it takes 0.6 s."""
NEEDED_COLUMNS_BY_TABLE = {
    "topics": {"id", "name", "type", "serialization_format"},
    "messages": {"topic_id", "timestamp", "data"},
}
"""Table -> the columns that must be stored in it; `id` of `messages` is its row."""
DEFINITION_COLUMNS = {"topic_type", "encoding", "encoded_message_definition"}
"""The columns of the table of definitions that are read."""
LONG_MESSAGES_NOTE = "messages of more than --max-chunk, not read"
"""The note on rows that are too long."""
COMPRESSED_MESSAGES_NOTE = "compressed messages that can't be unpacked, or are too large"
"""The note on messages that stay compressed."""
Content = Schema | Channel | tuple[int, int, bytes]
MAX_CHANNELS = 0xFFFF
"""The greatest number of channels: the format has 16 bits for their ids, from 1 on (MCAP specification)."""


class TopicRow(NamedTuple):
    """A row of `topics`; `id` is the id of its channel, `topic_id` the id in the table."""

    id: int
    topic_id: int
    topic: str
    msgtype: str
    serialization_format: str


def iter_database_content(
    database: sqlite3.Connection, file: InputFile, source: SourceFormat, bounds: ReadBounds
) -> Generator[Content, None, None]:
    """Yield schemas, channels, and messages in the order of the table's rows.

    Args:
        file: The database's file.
        source: Gets what could not be read, and the compression of messages.

    Raises:
        InputError: The messages unpack to more than the bounds allow.
        sqlite3.Error, ValueError: It is damaged, or is no database of rosbag2.
        UsageError: The package is not installed that knows the message types.
    """
    topics = _read_topics(database)
    usable = [each for each in topics if each.serialization_format.lower() == READABLE_SERIALIZATION_FORMAT]
    yield from iter_schemas_and_channels(
        usable, *_load_definitions_by_type_and_type_store(database, file.name), source.notes
    )
    channel_of = {each.topic_id: each.id for each in usable}
    counts: Counter[int] = Counter()
    max_bytes = n_left = bounds.max_unpacked_bytes(file.n_stored_bytes)
    for row, topic_id, time_ns, data in _iter_message_rows(database, source, recover=bounds.recover):
        counts[topic_id] += 1
        if topic_id not in channel_of:
            continue
        payload = data
        if payload.startswith(ZSTD_MAGIC):
            payload = decompress_message(payload, min(bounds.max_chunk_bytes, MAX_DECOMPRESSED_MESSAGE_BYTES))
            source.add_compression("zstd")
            if payload is data:
                source.notes[COMPRESSED_MESSAGES_NOTE] = source.notes.get(COMPRESSED_MESSAGES_NOTE, 0) + 1
        n_left -= len(payload)
        if n_left < 0:
            what = f"its messages unpack to more than {max_bytes / BYTES_PER_GIGABYTE:.3g} GB (at message {row})"
            raise InputError(what, where=file.name, hint="--max-ratio and --max-input read more")
        yield channel_of[topic_id], time_ns, payload
    _note_unread_messages(topics, counts, source.notes)


def _iter_message_rows(
    database: sqlite3.Connection, source: SourceFormat, *, recover: bool
) -> Iterator[tuple[int, int, int, bytes]]:
    """Yield row, topic id, time in ns and data of every message; those that are too long are counted and left out.

    Args:
        source: Gets what could not be read.
        recover: Count a damaged table, whose rest is not read.

    Raises:
        sqlite3.DatabaseError: The table is damaged, and `recover` is off.
        ValueError: A topic id is not an integer, a time is not one or negative, or the data are no octets.
    """
    query = "SELECT rowid, topic_id, timestamp, data FROM messages NOT INDEXED WHERE rowid > ? ORDER BY rowid"
    last = -(1 << 63)  # the least number of a row
    while True:
        rows = database.execute(query, (last,))
        try:
            for row, topic_id, time_ns, data in rows:
                if not isinstance(topic_id, int) or not isinstance(time_ns, int) or time_ns < 0:
                    ids = f"the topic id {_shorten_value(topic_id)} and the time {_shorten_value(time_ns)}"
                    raise ValueError(f"message {row} has {ids}")
                if not isinstance(data, bytes):
                    raise ValueError(f"message {row} holds no octets")  # noqa: TRY004 - a fault of the file
                yield row, topic_id, time_ns, data
                last = row
            return
        except sqlite3.DataError:  # longer than SQLITE_LIMIT_LENGTH, which is --max-chunk
            source.notes[LONG_MESSAGES_NOTE] = source.notes.get(LONG_MESSAGES_NOTE, 0) + 1
            query_next = "SELECT min(rowid) FROM messages NOT INDEXED WHERE rowid > ?"
            (last,) = database.execute(query_next, (last,)).fetchone()
        except sqlite3.DatabaseError:
            if not recover:
                raise
            source.notes[f"damaged table of messages, read up to row {last}"] = 1
            return


def _table_column_names(database: sqlite3.Connection, table: str) -> set[str]:
    """Return the names of a table's stored columns; empty for a view or a virtual table of that name."""
    kind = database.execute("SELECT type, rootpage FROM sqlite_master WHERE name = ?", (table,)).fetchone()
    if kind is None or kind[0] != "table" or not kind[1]:
        return set()
    columns = database.execute(f"PRAGMA table_xinfo({table})")
    return {str(column[1]) for column in columns if column[6] == STORED_COLUMN_CODE}


def _read_topics(database: sqlite3.Connection) -> list[TopicRow]:
    """Read the topics, with channel ids from 1 on.

    Raises:
        ValueError: A table or a column is missing or computed, or there are more topics than channel ids.
    """
    for table, needed in NEEDED_COLUMNS_BY_TABLE.items():
        columns = _table_column_names(database, table)
        if not columns:
            raise ValueError(f"it has no table of {table}")
        if not needed <= columns:
            raise ValueError(f"its table of {table} does not store {', '.join(sorted(needed - columns))}")
    query = "SELECT id, name, type, serialization_format FROM topics NOT INDEXED ORDER BY rowid"
    found = []
    for number, (topic_id, topic, kind, serialization) in enumerate(database.execute(query), 1):
        if number > MAX_CHANNELS:
            raise ValueError(f"it has more than {MAX_CHANNELS} topics, for which a log has room")
        found.append(
            TopicRow(number, topic_id, str(topic), str(kind), str(serialization or READABLE_SERIALIZATION_FORMAT))
        )
    return found


def _load_definitions_by_type_and_type_store(
    database: sqlite3.Connection, name: str
) -> tuple[dict[str, bytes | SchemaError], Any]:
    """Return the definitions of the database by type, and a type store of `rosbags` for other types, or None.

    In the place of a definition that is not read is the reason. The store holds the types of the latest release, and is
    there if the database defines nothing.

    Raises:
        UsageError: `rosbags` is needed and is not installed.
        ValueError: The definitions are too long.
    """
    own: dict[str, bytes | SchemaError] = {}
    n_definitions = 0
    n_left = MAX_DEFINITIONS_BYTES
    if _table_column_names(database, "message_definitions") >= DEFINITION_COLUMNS:
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions NOT INDEXED"
        for kind, encoding, text in database.execute(query):
            n_left -= len(str(text)) * (COUNTED_DEFINITION_BYTES_PER_IDL_CHARACTER if encoding == "ros2idl" else 1)
            if n_left < 0:
                raise ValueError(f"its message definitions have more than {MAX_DEFINITIONS_BYTES:,} characters")
            n_definitions += encoding in ("ros2msg", "ros2idl")
            if encoding == "ros2msg":
                own[str(kind)] = str(text).encode()
            elif encoding == "ros2idl":
                try:
                    own[str(kind)] = definition = ros2msg_text_of_idl(str(kind), str(text)).encode()
                    n_left -= len(definition)  # short IDL can make a long text
                except SchemaError as error:
                    own[str(kind)] = error
    if n_definitions:
        return own, None
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        what = "a database without its message definitions needs a package that is not installed"
        raise UsageError(what, where=name, hint=install_hint("bags")) from error
    return own, get_typestore(Stores.LATEST)


def _note_unread_messages(topics: list[TopicRow], counts: Counter[int], notes: dict[str, int]) -> None:
    """Note the messages that are not read: those without a topic, and those that are not CDR."""
    known = {each.topic_id for each in topics}
    unknown = sorted(counts.keys() - known)
    if unknown:
        n = sum(counts[each] for each in unknown)
        shown = format_first_names([str(each) for each in unknown], MAX_TOPICS_LISTED_IN_NOTE)
        notes[f"messages that belong to no topic (topic id{'s' if len(unknown) > 1 else ''} {shown})"] = n
    by_format: dict[str, list[TopicRow]] = {}
    for each in topics:
        if each.serialization_format.lower() != READABLE_SERIALIZATION_FORMAT:
            by_format.setdefault(_shorten_value(each.serialization_format), []).append(each)
    for name, others in by_format.items():
        n = sum(counts[each.topic_id] for each in others)
        if n:
            what = f"messages in the format {name}, which is not read, only CDR is"
            texts = [_shorten_value(each.topic) for each in others]
            notes[f"{what} ({format_first_names(texts, MAX_TOPICS_LISTED_IN_NOTE)})"] = n


def _shorten_value(value: object) -> str:
    return str(value)[:MAX_SHOWN_VALUE_CHARS]


def iter_schemas_and_channels(
    connections: Any, definitions_of_recording: Mapping[str, bytes | SchemaError], store: Any, notes: dict[str, int]
) -> Iterator[Schema | Channel]:
    """Yield schemas and channels; channels of undefined types have no schema, which `notes` gets.

    Args:
        connections: Topics with `id`, `topic` and `msgtype`.
        definitions_of_recording: Type -> its definition (`ros2msg`), or why the one in IDL is not read.
        store: Type store of `rosbags` for other types, or None.
        notes: Gets undefined types, as text -> 1.

    Raises:
        ValueError: There are more topics than a log has ids for.
    """
    schema_ids: dict[str, int] = {}
    unknown: dict[str, str] = {}
    if len(connections) > MAX_CHANNELS:
        raise ValueError(f"it has {len(connections)} topics, and a log has room for {MAX_CHANNELS}")
    for each in connections:
        if each.msgtype not in schema_ids:
            text = definitions_of_recording.get(each.msgtype) or _definition_from_store(store, each.msgtype)
            if text is None or isinstance(text, SchemaError):
                what = "without a definition" if text is None else "whose definition in IDL is not read"
                unknown[each.msgtype] = f"message types {what} ({each.msgtype}{'' if text is None else f': {text}'})"
                schema_ids[each.msgtype] = 0
            else:
                schema_ids[each.msgtype] = len(schema_ids) + 1
                yield Schema(schema_ids[each.msgtype], each.msgtype, "ros2msg", text)
        yield Channel(each.id, schema_ids[each.msgtype], each.topic, "cdr", {})
    notes.update((unknown[name], 1) for name in sorted(unknown))


def _definition_from_store(store: Any, name: str) -> bytes | None:
    """Return the definition of a type that a type store knows, else None."""
    if store is None:
        return None
    from rosbags.typesys import TypesysError

    try:
        return str(store.generate_msgdef(name, ros_version=2)[0]).encode()
    except (KeyError, TypesysError, RecursionError):
        return None
