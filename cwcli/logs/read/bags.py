"""Converts ROS 1 bags and rosbag2's databases to MCAP.

Messages of ROS 1 become messages of ROS 2 (CDR, `package/msg/Type`, no `seq` in a header). A database older than ROS 2
Iron has no message definitions: those of the latest release that the library `rosbags` knows are used.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from typing import IO

from cwcli.errors import CwcliError, InputError
from cwcli.input import InputFile
from cwcli.logs.format.message_log import MessageLog
from cwcli.logs.format.records import Channel, Schema
from cwcli.logs.read.read_bounds import ReadBounds
from cwcli.logs.read.source_format import SourceFormat
from cwcli.output_stream import OutputStream

ChannelTimePayload = tuple[int, int, bytes]
"""The channel id, the log time in ns and the payload of a message."""
Content = Schema | Channel | ChannelTimePayload


def convert_bag(
    file: InputFile,
    source: SourceFormat,
    journals: Sequence[InputFile] | None,
    bounds: ReadBounds,
    target: IO[bytes],
) -> None:
    """Write a bag, or a database, as a log.

    Args:
        file: The bag or database.
        source: Gets what could not be converted, the compressions and the number of chunks.
        journals: The journals of a database; None for a bag of ROS 1.
        bounds: What it may cost.
        target: A file on the disk.

    Raises:
        InputError: It can't be read, or exceeds its bounds.
        MemoryError: It exceeds the memory of the process.
        OSError: The log can't be written.
        UsageError: A package is not installed.
    """
    output = OutputStream(target.fileno(), file.name)
    log = MessageLog(output, "ros2", "cwcli")
    with closing(iter_recording_content(file, source, journals, bounds)) as content:
        _write_content_to_log(log, content)
    log.finish()
    output.flush()


def iter_recording_content(
    file: InputFile, source: SourceFormat, journals: Sequence[InputFile] | None, bounds: ReadBounds
) -> Generator[Content, None, None]:
    """Yield the schemas, channels and messages of a bag or a database; arguments and errors as of `convert_bag`."""
    if journals is None:
        reader, bag = "cwcli", _iter_ros1_content(file, source, bounds)
    else:
        reader, bag = "SQLite", _iter_ros2_content(file, journals, source, bounds)
    with closing(bag) as content:
        yield from _iter_with_errors_as_input_errors(content, file.name, reader)


def _iter_with_errors_as_input_errors(content: Iterator[Content], name: str, reader: str) -> Iterator[Content]:
    """Yield what a library reads, and turn its errors, but not those of the caller, into `InputError`."""
    while True:
        try:
            item = next(content)
        except StopIteration:
            return
        except (CwcliError, MemoryError):
            raise
        except Exception as error:  # damaged bytes make the library raise whatever its parsers do
            reason = " ".join(str(error).split()) or type(error).__name__
            if isinstance(error, RecursionError):
                reason = "a definition of its message types is nested too deeply"
            elif reason == "interrupted":  # SQLite, by its bound of steps
                reason = "its tables take more steps than a file of its size can need"
            raise InputError(f"{reader} can't read it: {reason[:200]}", where=name) from error
        yield item


def _iter_ros1_content(file: InputFile, source: SourceFormat, bounds: ReadBounds) -> Generator[Content, None, None]:
    """Return schemas, channels and converted messages of a ROS 1 bag, whose times always fit in a log."""
    from cwcli.logs.ros1.bag import BagReader

    return BagReader(file, source, bounds).iter_content()


def _iter_ros2_content(
    file: InputFile, journals: Sequence[InputFile], source: SourceFormat, bounds: ReadBounds
) -> Generator[Content, None, None]:
    """Yield schemas, channels and messages of a rosbag2 database."""
    from cwcli.logs.read.ros2_database import iter_database_content
    from cwcli.logs.read.sqlite_files import open_database

    with open_database(file, journals, bounds.max_chunk_bytes, source.notes) as database:
        yield from iter_database_content(database, file, source, bounds)


def _write_content_to_log(log: MessageLog, content: Iterator[Content]) -> None:
    """Add schemas, channels and messages to a log; ids become those that it assigns."""
    schema_ids: dict[int, int] = {0: 0}
    channel_ids: dict[int, int] = {}
    for item in content:
        if isinstance(item, Schema):
            schema_ids[item.id] = log.add_schema(item.name, item.encoding, item.data)
        elif isinstance(item, Channel):
            channel_ids[item.id] = log.add_channel(item._replace(schema_id=schema_ids[item.schema_id]))
        else:
            channel_id, log_time_ns, payload = item
            log.add_message(channel_ids[channel_id], log_time_ns, payload)
