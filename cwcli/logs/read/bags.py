"""ROS 1 bags and rosbag2's databases as MCAP, with the library `rosbags`.

Messages of ROS 1 become what ROS 2 would have written (CDR, `package/msg/Type`, no `seq` in a header), so that all that
reads a log reads them. A database older than ROS 2 Iron has no message definitions: those of the latest release that
the library knows are taken.
"""

from __future__ import annotations

import os
import struct
import tempfile
from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from cwcli.errors import CwcliError, InputError, UsageError, install_hint
from cwcli.input import InputFile
from cwcli.logs.format.records import Channel, Schema
from cwcli.logs.read.ros2_database import MAX_VALUE_BYTES, read_database
from cwcli.logs.read.ros_definitions import definitions
from cwcli.logs.read.sqlite_files import copy_file, open_database, writing_copy_of

if TYPE_CHECKING:
    from cwcli.logs.write.record_writer import RecordWriter

CHUNK_BYTES = 1 << 20
HEADER = "std_msgs/msg/Header"
_MESSAGE = struct.Struct("<BQHIQQ")
OPCODE_MESSAGE = 0x05
HEADER_BYTES = 22

Message = tuple[int, int, bytes | memoryview]
"""Connection, log time, payload."""
Content = Schema | Channel | Message


def convert_bag(
    file: InputFile,
    notes: dict[str, int],
    journals: Sequence[InputFile] | None,
    max_bytes: int,
    target: IO[bytes],
) -> None:
    """Write a bag, or a database, as a log.

    Args:
        file: The bag.
        notes: Gets what could not be converted, and how often.
        journals: Those of a database; None: it is a bag of ROS 1.
        max_bytes: What the messages of a database may unpack to.
        target: A file on the disk.

    Raises:
        InputError: It can't be read.
        OSError: The log can't be written.
        UsageError: The library is not installed.
    """
    is_ros1 = journals is None
    try:
        import rosbags.rosbag1
        import rosbags.typesys  # noqa: F401
    except ImportError as error:
        kind = "ROS 1 bags" if is_ros1 else "rosbag2's databases (.db3)"
        raise UsageError(
            f"{kind} need a package that is not installed", where=file.name, hint=install_hint("bags")
        ) from error
    from cwcli.logs.write.record_writer import RecordWriter
    from cwcli.output_stream import Output

    output = Output(target.fileno(), file.name)
    writer = RecordWriter(output)
    writer.header("ros2", "cwcli")
    bag = _ros1(file, notes) if journals is None else _ros2(file, journals, notes, max_bytes)
    with closing(bag) as content:
        _write(writer, _read(content, file.name, "the library rosbags" if is_ros1 else "SQLite"))
    writer.finish()
    output.flush()


def _read(content: Iterator[Content], name: str, reader: str) -> Iterator[Content]:
    """What a library reads; its errors alone are the file's, not those of what is done with it."""
    while True:
        try:
            item = next(content)
        except StopIteration:
            return
        except CwcliError:
            raise
        except Exception as error:  # damaged bytes make the library raise whatever its parsers do
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"{reader} can't read it: {reason[:200]}", where=name) from error
        yield item


def _ros1(file: InputFile, notes: dict[str, int]) -> Generator[Content, None, None]:
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
        yield from definitions(reader.connections, store, notes)
        for connection, log_time_ns, data in reader.messages():
            try:
                yield _message(connection.id, log_time_ns, store.ros1_to_cdr(data, connection.msgtype))
            except (SerdeError, AssertionError, UnicodeDecodeError):
                what = f"messages that can't be converted on {connection.topic}"
                notes[what] = notes.get(what, 0) + 1


def _ros2(
    file: InputFile, journals: Sequence[InputFile], notes: dict[str, int], max_bytes: int
) -> Generator[Content, None, None]:
    with open_database(file, journals, MAX_VALUE_BYTES, notes) as database:
        for item in read_database(database, file.name, notes, max_bytes):
            yield item if isinstance(item, Schema | Channel) else _message(*item)


def _message(channel_id: int, log_time_ns: int, data: bytes | memoryview) -> Message:
    """A message; numbers that no log can hold, and what is no bytes, raise here, as faults of the bag."""
    _MESSAGE.pack(OPCODE_MESSAGE, HEADER_BYTES, channel_id, 0, log_time_ns, log_time_ns)
    return channel_id, log_time_ns, memoryview(data)


@contextmanager
def _named(file: InputFile) -> Iterator[str]:
    """A name of the open file itself, whatever has its old name by now; one without a name is copied."""
    descriptor = os.dup(file.descriptor)
    try:
        name = f"/dev/fd/{descriptor}"
        if Path(os.path.realpath(name)).exists():  # SQLite takes the name behind the link
            yield name
            return
        with ExitStack() as stack:
            with writing_copy_of(file.name):
                copy = stack.enter_context(tempfile.NamedTemporaryFile(prefix="cwcli-"))
                copy_file(file, copy)
                copy.flush()
            yield copy.name
    finally:
        os.close(descriptor)


def _write(writer: RecordWriter, content: Iterator[Content]) -> None:
    """The schemas and channels, then the messages in chunks."""
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

    for item in content:
        if isinstance(item, Schema):
            writer.schema(item)
            continue
        if isinstance(item, Channel):
            writer.channel(item)
            continue
        channel_id, log_time_ns, payload = item
        entries.setdefault(channel_id, []).append((log_time_ns, len(data)))
        n = sequence[channel_id] = sequence.get(channel_id, -1) + 1
        data += _MESSAGE.pack(
            OPCODE_MESSAGE, HEADER_BYTES + len(payload), channel_id, n & 0xFFFFFFFF, log_time_ns, log_time_ns
        )
        data += payload
        if len(data) >= CHUNK_BYTES:
            flush()
    flush()
