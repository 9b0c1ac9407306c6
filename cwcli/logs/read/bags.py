"""Converts ROS 1 bags and rosbag2's databases to MCAP, with the library `rosbags`.

Messages of ROS 1 become messages of ROS 2 (CDR, `package/msg/Type`, no `seq` in a header). A database older than ROS 2
Iron has no message definitions: those of the latest release that the library knows are used.
"""

from __future__ import annotations

import os
import struct
import tempfile
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

from cwcli.errors import CwcliError, InputError, UsageError, install_hint
from cwcli.input import InputFile
from cwcli.logs.format.records import Channel, Schema
from cwcli.logs.read.ros2_database import MAX_DATABASE_VALUE_BYTES, iter_database_content
from cwcli.logs.read.ros_definitions import iter_schemas_and_channels
from cwcli.logs.read.sqlite_files import copy_file, open_database, raise_copy_errors

if TYPE_CHECKING:
    from mcap.writer import Writer

    from cwcli.logs.read.source_format import SourceFormat

ROS_HEADER_TYPE = "std_msgs/msg/Header"
"""The message type whose ROS 1 definition is replaced by that of ROS 2."""
MAX_SEQUENCE = 0xFFFFFFFF
"""The greatest sequence number of a message: the format has 32 bits for it (MCAP specification)."""
MAX_LOG_TIME_NS = (1 << 64) - 1
"""The greatest log time in ns: the format has 64 bits for it (MCAP specification)."""

Message = tuple[int, int, bytes | memoryview]
"""The channel id, the log time in ns and the payload of a message."""
Content = Schema | Channel | Message


def convert_bag(
    file: InputFile,
    source: SourceFormat,
    journals: Sequence[InputFile] | None,
    max_bytes: int,
    target: IO[bytes],
) -> None:
    """Write a bag, or a database, as a log.

    Args:
        file: The bag or database.
        source: Gets what could not be converted, the compressions and the number of chunks.
        journals: The journals of a database; None for a bag of ROS 1.
        max_bytes: Total size in bytes to which the messages of a database may decompress.
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
    from mcap.writer import CompressionType, Writer

    from cwcli.output_stream import OutputStream

    output = OutputStream(target.fileno(), file.name)
    writer = Writer(cast("IO[bytes]", output), compression=CompressionType.LZ4)
    writer.start("ros2", "cwcli")
    if journals is None:
        bag = _iter_ros1_content(file, source)
    else:
        bag = _iter_ros2_content(file, journals, source, max_bytes)
    with closing(bag) as content:
        _write_content(
            writer, _iter_with_read_errors(content, file.name, "the library rosbags" if is_ros1 else "SQLite")
        )
    writer.finish()  # type: ignore[no-untyped-call]
    output.flush()


def _iter_with_read_errors(content: Iterator[Content], name: str, reader: str) -> Iterator[Content]:
    """Yield what a library reads, and turn its errors, but not those of the caller, into `InputError`."""
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


def _iter_ros1_content(file: InputFile, source: SourceFormat) -> Generator[Content, None, None]:
    """Yield schemas, channels and converted messages of a ROS 1 bag."""
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.rosbag1 import Reader
    from rosbags.serde import SerdeError
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    with _path_of_open_file(file) as path, Reader(path) as reader:
        types: dict[str, Any] = {}
        for each in reader.connections:
            if each.msgdef.format is not MessageDefinitionFormat.NONE:
                types.update(get_types_from_msg(each.msgdef.data, each.msgtype))
        types[ROS_HEADER_TYPE] = get_typestore(Stores.LATEST).fielddefs[
            ROS_HEADER_TYPE
        ]  # the conversion takes `seq` out
        store.register(types)
        yield from iter_schemas_and_channels(reader.connections, store, source.notes)
        source.n_chunks = len(reader.chunk_infos)
        for chunk in reader.chunk_infos:
            source.add_compression(_bag_chunk_compression(file, chunk.pos))
        for connection, log_time_ns, data in reader.messages():
            try:
                yield _validate_message(connection.id, log_time_ns, store.ros1_to_cdr(data, connection.msgtype))
            except (SerdeError, AssertionError, UnicodeDecodeError):
                what = f"messages that can't be converted on {connection.topic}"
                source.notes[what] = source.notes.get(what, 0) + 1


def _bag_chunk_compression(file: InputFile, at: int) -> str:
    """Return the compression that a chunk's record names at byte `at` of a bag; "" for none.

    The header is a list of fields `length (u32), name=value` (http://wiki.ros.org/Bags/Format/2.0).
    """
    (size,) = struct.unpack_from("<I", file[at : at + 4])
    header, here = bytes(file[at + 4 : at + 4 + size]), 0
    while here < len(header):
        (length,) = struct.unpack_from("<I", header, here)
        name, _, value = header[here + 4 : here + 4 + length].partition(b"=")
        if name == b"compression":
            compression = value.decode("ascii", "replace")
            return "" if compression == "none" else compression
        here += 4 + length
    return ""


def _iter_ros2_content(
    file: InputFile, journals: Sequence[InputFile], source: SourceFormat, max_bytes: int
) -> Generator[Content, None, None]:
    """Yield schemas, channels and messages of a rosbag2 database."""
    with open_database(file, journals, MAX_DATABASE_VALUE_BYTES, source.notes) as database:
        for item in iter_database_content(database, file.name, source, max_bytes):
            yield item if isinstance(item, Schema | Channel) else _validate_message(*item)


def _validate_message(channel_id: int, log_time_ns: int, data: bytes | memoryview) -> Message:
    """Return a message, after a check that its time fits in a log and its payload is bytes.

    Raises:
        ValueError, TypeError: They don't.
    """
    if not 0 <= log_time_ns <= MAX_LOG_TIME_NS:
        raise ValueError(f"a message has the time {log_time_ns} ns")
    return channel_id, log_time_ns, memoryview(data)


@contextmanager
def _path_of_open_file(file: InputFile) -> Iterator[str]:
    """Yield a path of the open file, even if its name is taken by another file now; a nameless file is copied."""
    descriptor = os.dup(file.descriptor)
    try:
        name = f"/dev/fd/{descriptor}"
        if Path(os.path.realpath(name)).exists():  # SQLite takes the name behind the link
            yield name
            return
        with ExitStack() as stack:
            with raise_copy_errors(file.name):
                copy = stack.enter_context(tempfile.NamedTemporaryFile(prefix="cwcli-"))
                copy_file(file, copy)
                copy.flush()
            yield copy.name
    finally:
        os.close(descriptor)


def _write_content(writer: Writer, content: Iterator[Content]) -> None:
    """Write schemas, channels and messages; ids become those that the writer assigns."""
    schema_ids: dict[int, int] = {0: 0}
    channel_ids: dict[int, int] = {}
    counts: Counter[int] = Counter()
    for item in content:
        if isinstance(item, Schema):
            schema_ids[item.id] = writer.register_schema(item.name, item.encoding, item.data)
        elif isinstance(item, Channel):
            channel_ids[item.id] = writer.register_channel(
                item.topic, item.message_encoding, schema_ids[item.schema_id], item.metadata
            )
        else:
            channel_id, log_time_ns, payload = item
            sequence = counts[channel_id] & MAX_SEQUENCE
            writer.add_message(channel_ids[channel_id], log_time_ns, bytes(payload), log_time_ns, sequence)
            counts[channel_id] += 1
