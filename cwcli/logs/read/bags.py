"""ROS 1 bags and rosbag2's databases as MCAP, read by the library `rosbags`.

Messages of ROS 1 become what ROS 2 would have written (CDR, `package/msg/Type`, no `seq` in a header), so that all that
reads a log reads them. A database older than ROS 2 Iron has no message definitions: those of the latest release that
the library knows are taken.
"""

from __future__ import annotations

import os
import struct
import tempfile
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from cwcli.errors import CwcliError, InputError, UsageError
from cwcli.input import InputFile
from cwcli.logs.format.records import Channel, Schema

if TYPE_CHECKING:
    from cwcli.logs.write.record_writer import RecordWriter

CHUNK_BYTES = 1 << 20
HEADER = "std_msgs/msg/Header"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_MESSAGE = struct.Struct("<BQHIQQ")
OPCODE_MESSAGE = 0x05
HEADER_BYTES = 22
EXTRA = "pip install 'cwcli[bags]'"

Message = tuple[int, int, bytes | memoryview]
"""Connection, log time, payload."""


def convert_bag(file: InputFile, notes: dict[str, int], is_ros1: bool, target: IO[bytes]) -> None:
    """Write a bag, or a database, as a log.

    Args:
        file: The bag.
        notes: Gets what could not be converted, and how often.
        is_ros1: It is a bag of ROS 1.
        target: A file on the disk.

    Raises:
        InputError: It can't be read.
        OSError: The log can't be written.
        UsageError: The library is not installed.
    """
    try:
        import rosbags.rosbag1
        import rosbags.rosbag2  # noqa: F401
    except ImportError as error:
        kind = "ROS 1 bags" if is_ros1 else "rosbag2's databases (.db3)"
        raise UsageError(f"{kind} need a package that is not installed", where=file.name, hint=EXTRA) from error
    from cwcli.logs.write.record_writer import RecordWriter
    from cwcli.output_stream import Output

    output = Output(target.fileno(), file.name)
    writer = RecordWriter(output)
    writer.header("ros2", "cwcli")
    try:
        with closing(_ros1(file, writer, notes) if is_ros1 else _ros2(file, writer, notes)) as messages:
            _write(writer, messages)
    except CwcliError:
        raise
    except Exception as error:  # of the library, or of what damaged bytes make it do
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"the library rosbags can't read it: {reason[:200]}", where=file.name) from error
    writer.finish()
    output.flush()


def _ros1(file: InputFile, writer: RecordWriter, notes: dict[str, int]) -> Generator[Message, None, None]:
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.rosbag1 import Reader
    from rosbags.serde import SerdeError
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    with _named(file) as path, Reader(path) as reader:
        types: dict[str, Any] = {}
        for each in reader.connections:
            if each.msgdef.format is not MessageDefinitionFormat.NONE:
                types.update(get_types_from_msg(each.msgdef.data, each.msgtype))
        types[HEADER] = get_typestore(Stores.LATEST).fielddefs[HEADER]  # the conversion takes `seq` out
        store.register(types)
        _define(reader.connections, writer, store, notes)
        for connection, log_time_ns, data in reader.messages():
            try:
                yield connection.id, log_time_ns, store.ros1_to_cdr(data, connection.msgtype)
            except (SerdeError, AssertionError, UnicodeDecodeError):
                what = f"messages that can't be converted on {connection.topic}"
                notes[what] = notes.get(what, 0) + 1


def _ros2(file: InputFile, writer: RecordWriter, notes: dict[str, int]) -> Generator[Message, None, None]:
    import zstandard
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    store = get_typestore(Stores.LATEST)
    with _named(file) as path:
        reader = Sqlite3Reader(Path(path))
        reader.open()
        with closing(reader):
            own: dict[str, Any] = {}
            for each in reader.connections:
                if each.msgdef.format is MessageDefinitionFormat.MSG:
                    own.update(get_types_from_msg(each.msgdef.data, each.msgtype))
                elif each.msgdef.format is MessageDefinitionFormat.IDL:
                    own.update(get_types_from_idl(each.msgdef.data))
            if own:
                store = get_typestore(Stores.EMPTY)
                store.register(own)
            _define(reader.connections, writer, store, notes)
            unpack = zstandard.ZstdDecompressor().decompress
            for connection, log_time_ns, data in reader.messages(reader.connections):
                if data[:4] == ZSTD_MAGIC:  # rosbag2 has compressed each message; CDR begins with a zero
                    data = unpack(data)  # noqa: PLW2901
                yield connection.id, log_time_ns, data


@contextmanager
def _named(file: InputFile) -> Iterator[str]:
    """A name of the open file itself, whatever has its old name by now; one without a name is copied."""
    descriptor = os.dup(file.descriptor)
    try:
        name = f"/dev/fd/{descriptor}"
        if Path(os.path.realpath(name)).exists():  # SQLite takes the name behind the link
            yield name
            return
        with tempfile.NamedTemporaryFile(prefix="cwcli-") as copy:
            for at in range(0, len(file), CHUNK_BYTES):
                copy.write(file[at : at + CHUNK_BYTES])
            copy.flush()
            yield copy.name
    finally:
        os.close(descriptor)


def _define(connections: Any, writer: RecordWriter, store: Any, notes: dict[str, int]) -> None:
    """Write the schemas and channels; a type that nobody defines has none."""
    schema_ids: dict[str, int] = {}
    unknown: set[str] = set()
    for each in connections:
        if each.msgtype not in schema_ids:
            try:
                text = store.generate_msgdef(each.msgtype, ros_version=2)[0]
            except Exception:  # KeyError and the library's own
                unknown.add(each.msgtype)
                schema_ids[each.msgtype] = 0
            else:
                schema_ids[each.msgtype] = len(schema_ids) + 1
                writer.schema(Schema(schema_ids[each.msgtype], each.msgtype, "ros2msg", text.encode()))
        writer.channel(Channel(each.id, schema_ids[each.msgtype], each.topic, "cdr", {}))
    for name in sorted(unknown):
        notes[f"message types that nothing defines ({name})"] = 1


def _write(writer: RecordWriter, messages: Iterator[Message]) -> None:
    """The messages in chunks."""
    import numpy as np

    from cwcli.logs.write.message_merge import INDEX_ENTRY, ChunkPayload

    data = bytearray()
    entries: dict[int, list[tuple[int, int]]] = {}
    sequence: dict[int, int] = {}

    def flush() -> None:
        if data:
            times = [time_ns for each in entries.values() for time_ns, _ in each]
            made = {channel_id: np.array(each, INDEX_ENTRY) for channel_id, each in entries.items()}
            writer.chunk(ChunkPayload(np.frombuffer(bytes(data), np.uint8), min(times), max(times), made))
            data.clear()
            entries.clear()

    for channel_id, log_time_ns, payload in messages:
        entries.setdefault(channel_id, []).append((log_time_ns, len(data)))
        n = sequence[channel_id] = sequence.get(channel_id, -1) + 1
        data += _MESSAGE.pack(
            OPCODE_MESSAGE, HEADER_BYTES + len(payload), channel_id, n & 0xFFFFFFFF, log_time_ns, log_time_ns
        )
        data += payload
        if len(data) >= CHUNK_BYTES:
            flush()
    flush()
